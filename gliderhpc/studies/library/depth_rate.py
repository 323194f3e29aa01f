"""The filter by which depth becomes a vertical velocity: the slope of a straight line through the samples of a window.

It is a weighted mean of the rate with parabolic weights, so that anything whose rate is known can be put through the
same filter: what a model sinks at, or what the water does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.profiles import stretches

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 60.0
MIN_INTERVALS = 4
"""Length of the window, s, and how many sample intervals it has at least."""

SLOW = 0.9
"""Quantile by time of the distances between samples that counts as the sample interval: the rate may change."""

MAX_PAUSE = 2.5
"""Samples further apart than so many sample intervals do not belong together."""

_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class DepthRateFilter:
    """Slopes at n samples.

    Attributes
    ----------
    window : float
        Length of the window, s.
    operator : (n, n) sparse array
        Makes slopes of values.
    whole : (n,) of bool
        Where the window lies within an unbroken stretch of samples; elsewhere the operator's row is that of the part
        that does, and no slope where that has less than three samples.
    time : (n,)
        Of the samples, s.
    """

    window: float
    operator: scipy.sparse.csr_array
    whole: Mask
    time: Array

    @property
    def half_power(self) -> float:
        """Frequency at which half the power passes, Hz."""
        return half_power() / self.window

    def of(self, values: Array) -> Array:
        """Slope a second of values (n,) or (n, k); NaN where the window is cut short."""
        slopes = self.operator @ values
        slopes[~self.whole] = np.nan
        return np.asarray(slopes)

    def cut_short_too(self, values: Array) -> Array:
        """The same, from a shorter window near the ends of a stretch."""
        return np.asarray(self.operator @ values)

    def of_rate(self, rate: Array) -> Array:
        """Filter a rate that is known at the samples (n,) or (n, k), linear in between."""
        steps = np.diff(self.time).reshape(-1, *[1] * (rate.ndim - 1))
        risen = np.cumsum(0.5 * steps * (rate[1:] + rate[:-1]), axis=0)
        return self.of(np.concatenate([np.zeros((1, *rate.shape[1:])), risen]))

    def noise(self, deviation: float) -> Array:
        """Standard deviation (n,) of the slope where every sample has an independent error."""
        return np.asarray(deviation * np.sqrt((self.operator.power(2)).sum(axis=1)))


def depth_rate_filter(time: Array, usable: Mask) -> DepthRateFilter:
    """Lay out the filter for samples at times (s) of which some are not usable.

    Notes
    -----
    The window is `WINDOW` long, or `MIN_INTERVALS` sample intervals where that is longer.
    """
    interval = usual_interval(without_gaps(np.diff(time)), SLOW) if len(time) > 1 else WINDOW
    window = max(WINDOW, MIN_INTERVALS * interval)
    rows, columns, weights = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    whole = np.zeros(len(time), dtype=np.bool_)
    for begin, end in unbroken(time, usable, MAX_PAUSE * interval):
        own = time[begin:end]
        first = np.searchsorted(own, own - 0.5 * window - _TOLERANCE)
        last = np.searchsorted(own, own + 0.5 * window + _TOLERANCE)
        whole[begin:end] = (own - 0.5 * window >= own[0] - _TOLERANCE) & (own + 0.5 * window <= own[-1] + _TOLERANCE)
        for row, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            if b - a > 2:
                lever = own[a:b] - own[a:b].mean()
                rows.append(np.full(b - a, begin + row))
                columns.append(np.arange(begin + a, begin + b))
                weights.append(lever / (lever @ lever))
    operator = scipy.sparse.csr_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(len(time), len(time))
    )
    return DepthRateFilter(window, operator, whole, time)


def unbroken(time: Array, usable: Mask, longest: float) -> list[tuple[int, int]]:
    """Find the stretches of usable samples that no pause longer than `longest` (s) interrupts."""
    parts: list[tuple[int, int]] = []
    for begin, end in stretches(usable):
        breaks = begin + 1 + np.flatnonzero(np.diff(time[begin:end]) > longest)
        edges = [begin, *breaks.tolist(), end]
        parts += pairwise(edges)
    return parts


def transfer(cycles: float) -> float:
    """Share that the filter leaves of a sinusoidal velocity of so many cycles in the window (finely sampled)."""
    x = np.pi * cycles
    return float(3.0 * (np.sin(x) - x * np.cos(x)) / x**3)


@cache
def half_power() -> float:
    """Cycles in the window of which half the power is left."""
    return float(scipy.optimize.brentq(lambda cycles: transfer(cycles) - np.sqrt(0.5), 0.1, 1.0))
