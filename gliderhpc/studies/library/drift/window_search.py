"""Search of a series for the window in which it leaves the mission's line, over all positions and lengths."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.trends import MAD

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_WINDOW = 3
"""Profiles of a window, and before and after it, at least; a window may also last until the end."""

OWN_SLOPE = 4
"""Profiles from which on a window may have a slope of its own."""

MODEL_MARGIN = 2.0
"""Loss by which a more persistent noise may be the worse one and is still taken for the null series."""

LARGEST_ERROR = 4.0
"""Robust standard deviations to which errors are limited."""

_FINE, _GROWTH = 6, 1.2
"""Places a window length, and ratio of one length to the next, of the candidates."""

_ALL = 100
"""Values up to which all windows are candidates."""

_TABLE = 2**17
"""Entries of a table of windows and series, which go into a core's cache."""

_MIN_POWER = 1e-9


@dataclass(frozen=True)
class NoiseModel:
    """First-order autoregression and independent scatter.

    Attributes
    ----------
    correlation : float
        Of the wander from one profile to the next.
    part : float
        Of the variance that wanders; the rest is independent.
    """

    correlation: float
    part: float

    def covariance(self, positions: Index) -> Array:
        """Covariance ``(n, n)`` at unit variance of profiles at some positions ``(n,)`` along the mission."""
        apart = np.abs(positions[:, None] - positions[None])
        return np.asarray(self.part * self.correlation**apart + (1.0 - self.part) * (apart == 0))


NOISE_MODELS = (
    NoiseModel(0.0, 0.0),
    NoiseModel(0.6, 0.5),
    NoiseModel(0.6, 1.0),
    NoiseModel(0.85, 0.5),
    NoiseModel(0.85, 1.0),
    NoiseModel(0.97, 0.5),
    NoiseModel(0.97, 1.0),
)
"""Candidates, the more persistent the later."""


class WeightedBaseline:
    """Generalised least squares about a baseline, under one noise model.

    Parameters
    ----------
    model : NoiseModel
        The noise.
    positions : (n,)
        Of the values along the mission, in profiles.
    baseline : (n, p)
        Columns that every fit holds, a level and a line among them.

    Attributes
    ----------
    model : NoiseModel
        The noise.
    projected : (n, n)
        Inverse covariance without what the baseline explains: ``y' projected y`` is what the baseline leaves of `y`.
    constant : float
        Part of the restricted loss that does not depend on the values.
    freedom : int
        Values less columns.
    """

    def __init__(self, model: NoiseModel, positions: Index, baseline: Array) -> None:
        self.model = model
        covariance = model.covariance(positions)
        weighted = np.linalg.solve(covariance, baseline)
        normal = baseline.T @ weighted
        self.projected: Array = np.linalg.inv(covariance) - weighted @ np.linalg.solve(normal, weighted.T)
        self.constant = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1])
        self.freedom = baseline.shape[0] - baseline.shape[1]

    def loss(self, left: Array) -> Array:
        """Minus twice the restricted log likelihood, its scale fitted, of weighted sums of squares ``(m,)``."""
        return np.asarray(self.constant + self.freedom * np.log(left))

    def left(self, values: Array) -> Array:
        """Weighted sums of squares ``(m,)`` that the baseline leaves of series ``(n, m)``."""
        return np.asarray(np.einsum("nm,nm->m", values, self.projected @ values))


def best_baseline(positions: Index, baseline: Array, values: Array) -> WeightedBaseline:
    """Return the baseline under the noise model of the least loss for a series ``(n,)``."""
    fits = [WeightedBaseline(model, positions, baseline) for model in NOISE_MODELS]
    return min(fits, key=lambda one: float(one.loss(one.left(values[:, None]))[0]))


@dataclass(frozen=True)
class Strongest:
    """The strongest window of a series.

    Attributes
    ----------
    gain : float
        Drop of minus twice the restricted log likelihood, less the logarithm of the number of values for each
        coefficient, from the mission's line alone.
    first, stop : int
        The first value of the window, and the first one after it.
    null : NoiseModel
        Noise of null series: the most persistent of those with which the line alone fits about as well as with any.
    noise : NoiseModel
        Noise with the window.
    """

    gain: float
    first: int
    stop: int
    null: NoiseModel
    noise: NoiseModel


class WindowSearch:
    """Candidate windows of a series, and what they explain under every noise model.

    Parameters
    ----------
    days : (n,)
        Days of the values.
    positions : (n,)
        Their positions along the mission, in profiles.
    shapes : sequence of (n,)
        Changes that are already known, in addition to a level and a line.

    Notes
    -----
    In a window the series may have another level, and from `OWN_SLOPE` values on another slope. With the inverse
    covariance P of the noise, baseline projected out, what a window explains of a series y takes the sums of ``P y``
    and of ``t P y`` over the window alone, so all windows are searched by cumulative sums. Both hypotheses choose their
    noise model: a wander that explains a window as well takes its gain away.
    """

    def __init__(self, days: Array, positions: Index, shapes: Sequence[Array] = ()) -> None:
        self.days, self.positions = days, positions
        self.time: Array = (days - days.mean()) / max(float(np.ptp(days)), _MIN_POWER)
        self.baseline: Array = np.column_stack([np.ones(len(days)), self.time, *shapes])
        self.windows = candidate_windows(len(days))

    @cached_property
    def _scans(self) -> list["_Scan"]:
        return [_Scan(model, self, self.windows) for model in NOISE_MODELS]

    def strongest(self, values: Array) -> Strongest:
        """Find the strongest window of a series ``(n,)``, its edges value by value."""
        series = values[:, None]
        found = [scan.losses(series) for scan in self._scans]
        line = np.array([float(one[0][0]) for one in found])
        near = [
            _Scan(model, self, windows_near(len(values), *map(int, self.windows[one[2][0]])))
            for model, one in zip(NOISE_MODELS, found, strict=True)
        ]
        refined = [scan.losses(series) for scan in near]
        noise = int(np.argmin([float(one[1][0]) for one in refined]))
        best = int(refined[noise][2][0])
        null = int(np.flatnonzero(line <= line.min() + MODEL_MARGIN)[-1])
        return Strongest(
            gain=float(line.min() - refined[noise][1][0]),
            first=int(near[noise].first[best]),
            stop=int(near[noise].stop[best]),
            null=NOISE_MODELS[null],
            noise=NOISE_MODELS[noise],
        )

    def gains(self, values: Array) -> Array:
        """Return the gain of the strongest candidate of each series ``(n, m)``."""
        columns = max(_TABLE // len(self.windows), 1)
        parts = [self._gains(values[:, start : start + columns]) for start in range(0, values.shape[1], columns)]
        return np.concatenate(parts)

    def _gains(self, values: Array) -> Array:
        line, window = (np.stack(rows) for rows in zip(*(s.losses(values)[:2] for s in self._scans), strict=True))
        return np.asarray(line.min(axis=0) - window.min(axis=0))

    def innovations(self, values: Array, best: Strongest) -> Array:
        """Independent errors ``(n,)`` of a series ``(n,)`` that line and window leave, of unit variance."""
        inside = np.zeros(len(values))
        inside[best.first : best.stop] = 1.0
        own = [inside, inside * self.time] if best.stop - best.first >= OWN_SLOPE else [inside]
        root = np.linalg.cholesky(best.noise.covariance(self.positions))
        columns = np.linalg.solve(root, np.column_stack([self.baseline, *own, values]))
        fitted = np.linalg.lstsq(columns[:, :-1], columns[:, -1], rcond=None)[0]
        rest = columns[:, -1] - columns[:, :-1] @ fitted
        # Jumps of further changes, which the next search is for, are no part of the noise.
        limit = LARGEST_ERROR * MAD * float(np.median(np.abs(rest)))
        rest = np.clip(rest, -limit, limit)
        return np.asarray((rest - rest.mean()) / max(float(rest.std()), _MIN_POWER))


def candidate_windows(n: int) -> Index:
    """Return first value and stop ``(w, 2)`` of the windows to search in series of n values.

    All of them in short series. In long ones lengths grow by a fifth and places are a sixth of the length apart, but
    every window that lasts until the end is among them.
    """
    found = {(first, n) for first in range(MIN_WINDOW, n - MIN_WINDOW + 1)}
    length, every = MIN_WINDOW, n <= _ALL
    while length <= n - 2 * MIN_WINDOW:
        places = range(MIN_WINDOW, n - MIN_WINDOW - length + 1, 1 if every else max(1, length // _FINE))
        found |= {(first, first + length) for first in places}
        length = length + 1 if every else max(length + 1, int(length * _GROWTH))
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 2)


def windows_near(n: int, first: int, stop: int) -> Index:
    """Return all windows ``(w, 2)`` whose edges lie within a step of the candidates from those of a window."""
    reach = max(1, (stop - first) // _FINE)
    found = [
        (begin, end)
        for begin in range(max(first - reach, MIN_WINDOW), first + reach + 1)
        for end in range(stop - reach, min(stop + reach, n) + 1)
        if end - begin >= MIN_WINDOW and (end == n or end <= n - MIN_WINDOW)
    ]
    return np.array(found, dtype=np.int64)


class _Scan:
    """Variance explained by windows under one noise model."""

    def __init__(self, model: NoiseModel, search: WindowSearch, windows: Index) -> None:
        self.baseline = WeightedBaseline(model, search.positions, search.baseline)
        self.time = search.time[:, None]
        self.first, self.stop = windows.T
        projected = self.baseline.projected
        level = self._blocks(projected)
        mixed = self._blocks(projected * self.time)
        slope = self._blocks(projected * self.time * self.time.T)
        # A slope in addition to the level, made orthogonal to it.
        own = slope - mixed**2 / np.maximum(level, _MIN_POWER)
        usable = (self.stop - self.first >= OWN_SLOPE) & (own > _MIN_POWER * np.maximum(slope, _MIN_POWER))
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, own, 1.0)), 0.0)
        self.by_level: Array = (1.0 / np.sqrt(np.maximum(level, _MIN_POWER)))[:, None]
        self.by_slope: Array = scale[:, None]
        self.mixed: Array = (-scale * mixed / np.maximum(level, _MIN_POWER))[:, None]
        self.penalty = float(np.log(len(search.days)))

    def losses(self, values: Array) -> tuple[Array, Array, Index]:
        """Loss of the line alone and with the best window, and that window, of each series ``(n, m)``."""
        weighted = self.baseline.projected @ values
        left = np.einsum("nm,nm->m", values, weighted)
        floor = _MIN_POWER * left
        sums = self._inside(weighted)
        other = self._inside(weighted * self.time)
        other *= self.by_slope
        other += sums * self.mixed
        np.square(other, out=other)
        sums *= self.by_level
        np.square(sums, out=sums)
        other += sums
        best = sums.argmax(axis=0), other.argmax(axis=0)
        explained = [
            table[places, np.arange(values.shape[1])] for table, places in zip((sums, other), best, strict=True)
        ]
        losses = [
            self.baseline.loss(np.maximum(left - part, floor)) + count * self.penalty
            for count, part in enumerate(explained, start=1)
        ]
        return (
            self.baseline.loss(np.maximum(left, np.finfo(np.float64).tiny)),
            np.minimum(*losses),
            np.where(losses[0] <= losses[1], *best),
        )

    def _inside(self, rows: Array) -> Array:
        """Sums ``(w, m)`` over every window of rows ``(n, m)``."""
        sums = np.pad(rows.cumsum(axis=0), ((1, 0), (0, 0)))
        inside: Array = sums[self.stop]
        inside -= sums[self.first]
        return inside

    def _blocks(self, table: Array) -> Array:
        """Sums ``(w,)`` over the square block of every window of a table ``(n, n)``."""
        sums = np.pad(table.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        first, stop = self.first, self.stop
        return np.asarray(sums[stop, stop] - sums[first, stop] - sums[stop, first] + sums[first, first])


def amplitude(positions: NDArray[np.int64], baseline: Array, unit: Array, values: Array) -> tuple[float, float]:
    """Size of a shape ``(n,)`` in a series ``(n,)`` about a baseline ``(n, p)``, and its standard deviation."""
    noise = best_baseline(positions, np.column_stack([baseline, unit]), values)
    own = WeightedBaseline(noise.model, positions, baseline)
    power = float(unit @ own.projected @ unit)
    value = float(unit @ own.projected @ values) / power
    rest = values - value * unit
    variance = float(rest @ own.projected @ rest) / max(own.freedom - 1, 1)
    return value, float(np.sqrt(max(variance, 0.0) / power))
