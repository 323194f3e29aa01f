"""Since when: the day from which a series that was level grows or falls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.drift.slopes import epoch_draws, interval
from gliderhpc.studies.library.trend import LEAST

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEFT = 3
"""Values that the slope is left with, at least."""

_CANDIDATES, _RESAMPLES = 101, 400


@dataclass(frozen=True)
class Onset:
    """The day of the change.

    Attributes
    ----------
    day, low, high : float
        Estimate and its 95 % interval.
    first : float
        First day of the series.
    """

    day: float
    low: float
    high: float
    first: float

    @property
    def from_the_start(self) -> bool:
        """Whether the series may have changed from its first day on."""
        return bool(self.low <= self.first)


def find_onset(days: Array, values: Array, epoch: Index, resamples: int, seed: int) -> Onset:
    """Fit a level that turns into a straight slope, by least squares.

    Parameters
    ----------
    days, values, epoch : (n,)
        The series, missing values left out, and the epoch of each.
    resamples, seed : int
        Of the bootstrap by epochs.

    Notes
    -----
    Candidates are evenly over the series but for its end, which would leave the slope to a single value.
    """
    known = np.isfinite(values) & np.isfinite(days)
    t, y, own = days[known], values[known], epoch[known]
    if len(y) < LEAST:
        return Onset(*[float("nan")] * 4)
    candidates = np.linspace(t[0], np.sort(t)[-LEFT], _CANDIDATES)
    rng = np.random.default_rng(seed)
    draws = epoch_draws(own, min(resamples, _RESAMPLES), rng)
    found = np.array([_best(t[drawn], y[drawn], candidates) for drawn in draws])
    return Onset(_best(t, y, candidates), *interval(found), float(t[0]))


def _best(t: Array, y: Array, candidates: Array) -> float:
    """Candidate of the least sum of squares: that whose hinge correlates most with the series."""
    hinges = np.maximum(0.0, t[None] - candidates[:, None])
    hinges = hinges - hinges.mean(axis=1, keepdims=True)
    power = (hinges**2).sum(axis=1)
    explained = np.where(power > 0.0, (hinges @ (y - y.mean())) ** 2 / np.where(power > 0.0, power, 1.0), 0.0)
    return float(candidates[int(np.argmax(explained))])
