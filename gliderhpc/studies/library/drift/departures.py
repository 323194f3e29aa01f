"""Search of a series for the window in which it departs from the mission's line, over all positions and lengths."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import MAD_TO_STD

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_WINDOW = 3
"""Minimum number of profiles in a window, and before and after it; a window may also last until the end."""

OWN_SLOPE = 4
"""Minimum number of profiles in a window with its own slope."""

MODEL_MARGIN = 2.0
"""Maximum excess loss of a more persistent noise model that is preferred for the null series."""

MAX_ERROR = 4.0
"""Robust standard deviations to which errors are limited."""

_FINE, _GROWTH = 6, 1.2
"""Number of candidate places in a window's length, and ratio of one candidate length to the next."""

_ALL = 100
"""Maximum number of values for which all windows are candidates."""

_TABLE = 2**17
"""Number of entries in a table of windows and series that fit into a core's cache."""

_MIN_POWER = 1e-9


@dataclass(frozen=True)
class AutoregressiveNoise:
    """First-order autoregression with independent scatter.

    Attributes
    ----------
    correlation : float
        Correlation of the autoregression from one profile to the next.
    part : float
        Share of the autoregression in the variance; the rest is independent.
    """

    correlation: float
    part: float

    def covariance(self, positions: Index) -> Array:
        """Covariance ``(n, n)``, at unit variance, of profiles at positions ``(n,)`` along the mission."""
        apart = np.abs(positions[:, None] - positions[None])
        return np.asarray(self.part * self.correlation**apart + (1.0 - self.part) * (apart == 0))


NOISE_MODELS = (
    AutoregressiveNoise(0.0, 0.0),
    AutoregressiveNoise(0.6, 0.5),
    AutoregressiveNoise(0.6, 1.0),
    AutoregressiveNoise(0.85, 0.5),
    AutoregressiveNoise(0.85, 1.0),
    AutoregressiveNoise(0.97, 0.5),
    AutoregressiveNoise(0.97, 1.0),
)
"""Candidate noise models, from less to more persistent."""


class WeightedBaseline:
    """Generalised least squares about a baseline, under one noise model.

    Parameters
    ----------
    model : NoiseModel
        Noise model.
    positions : (n,)
        Positions of the values along the mission, in profiles.
    baseline : (n, p)
        Columns included in every fit, among them a level and a line.

    Attributes
    ----------
    model : NoiseModel
        Noise model.
    projected : (n, n)
        Inverse covariance with the baseline projected out: ``y' projected y`` is the weighted sum of squares of `y`
        that the baseline does not explain.
    constant : float
        Part of the restricted loss that does not depend on the values.
    freedom : int
        Number of values minus number of columns.
    """

    def __init__(self, model: AutoregressiveNoise, positions: Index, baseline: Array) -> None:
        self.model = model
        covariance = model.covariance(positions)
        weighted = np.linalg.solve(covariance, baseline)
        normal = baseline.T @ weighted
        self.projected: Array = np.linalg.inv(covariance) - weighted @ np.linalg.solve(normal, weighted.T)
        self.constant = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1])
        self.freedom = baseline.shape[0] - baseline.shape[1]

    def loss(self, left: Array) -> Array:
        """Minus twice the restricted log-likelihood of weighted sums of squares ``(m,)``, with fitted scale."""
        return np.asarray(self.constant + self.freedom * np.log(left))

    def unexplained(self, values: Array) -> Array:
        """Weighted sums of squares ``(m,)`` of series ``(n, m)`` that the baseline does not explain."""
        return np.asarray(np.einsum("nm,nm->m", values, self.projected @ values))


def best_baseline(positions: Index, baseline: Array, values: Array) -> WeightedBaseline:
    """Return the baseline under the noise model with the least loss for a series ``(n,)``."""
    fits = [WeightedBaseline(model, positions, baseline) for model in NOISE_MODELS]
    return min(fits, key=lambda fit: float(fit.loss(fit.unexplained(values[:, None]))[0]))


@dataclass(frozen=True)
class StrongestWindow:
    """Strongest window of a series.

    Attributes
    ----------
    gain : float
        Decrease of minus twice the restricted log-likelihood relative to the mission's line alone, minus the logarithm
        of the number of values for each coefficient.
    first, stop : int
        Indices of the first value in the window, and of the first value after it.
    null : NoiseModel
        Noise of null series: the most persistent model with which the line alone fits about as well as with the best.
    noise : NoiseModel
        Noise that fits best with the window.
    """

    gain: float
    first: int
    stop: int
    null: AutoregressiveNoise
    noise: AutoregressiveNoise


class WindowSearch:
    """Candidate windows of a series, and the variance that they explain under every noise model.

    Parameters
    ----------
    days : (n,)
        Days of the values.
    positions : (n,)
        Positions of the values along the mission, in profiles.
    shapes : sequence of (n,)
        Changes already found, added to the level and the line.

    Notes
    -----
    In a window the series may have another level and, with `OWN_SLOPE` values or more, another slope. Let P be the
    inverse covariance of the noise with the baseline projected out. The sum of squares of a series y that a window
    explains depends only on the sums of ``P y`` and ``t P y`` over the window, so all windows are searched by
    cumulative sums. The noise model is chosen separately with and without the window: if persistent noise explains the
    series as well, the window has no gain.
    """

    def __init__(self, days: Array, positions: Index, shapes: Sequence[Array] = ()) -> None:
        self.days, self.positions = days, positions
        self.time: Array = (days - days.mean()) / max(float(np.ptp(days)), _MIN_POWER)
        self.baseline: Array = np.column_stack([np.ones(len(days)), self.time, *shapes])
        self.windows = candidate_windows(len(days))

    @cached_property
    def _scans(self) -> list["_Scan"]:
        return [_Scan(model, self, self.windows) for model in NOISE_MODELS]

    def strongest(self, values: Array) -> StrongestWindow:
        """Find the strongest window of a series ``(n,)``, with its edges refined value by value."""
        series = values[:, None]
        results = [scan.losses(series) for scan in self._scans]
        line = np.array([float(result[0][0]) for result in results])
        near = [
            _Scan(model, self, windows_near(len(values), *map(int, self.windows[result[2][0]])))
            for model, result in zip(NOISE_MODELS, results, strict=True)
        ]
        refined = [scan.losses(series) for scan in near]
        noise = int(np.argmin([float(result[1][0]) for result in refined]))
        best = int(refined[noise][2][0])
        null = int(np.flatnonzero(line <= line.min() + MODEL_MARGIN)[-1])
        return StrongestWindow(
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

    def innovations(self, values: Array, best: StrongestWindow) -> Array:
        """Independent residuals ``(n,)`` of a series ``(n,)`` from line and window, with unit variance."""
        inside = np.zeros(len(values))
        inside[best.first : best.stop] = 1.0
        own = [inside, inside * self.time] if best.stop - best.first >= OWN_SLOPE else [inside]
        root = np.linalg.cholesky(best.noise.covariance(self.positions))
        columns = np.linalg.solve(root, np.column_stack([self.baseline, *own, values]))
        fitted = np.linalg.lstsq(columns[:, :-1], columns[:, -1], rcond=None)[0]
        rest = columns[:, -1] - columns[:, :-1] @ fitted
        # Jumps due to further changes, which later searches will find, are not noise.
        limit = MAX_ERROR * MAD_TO_STD * float(np.median(np.abs(rest)))
        rest = np.clip(rest, -limit, limit)
        return np.asarray((rest - rest.mean()) / max(float(rest.std()), _MIN_POWER))


def candidate_windows(n: int) -> Index:
    """Return first index and stop ``(w, 2)`` of the windows to search in series of n values.

    In short series these are all windows. In long series, lengths increase by a fifth and places are a sixth of the
    length apart, and every window that lasts until the end is included.
    """
    windows = {(first, n) for first in range(MIN_WINDOW, n - MIN_WINDOW + 1)}
    length, every = MIN_WINDOW, n <= _ALL
    while length <= n - 2 * MIN_WINDOW:
        places = range(MIN_WINDOW, n - MIN_WINDOW - length + 1, 1 if every else max(1, length // _FINE))
        windows |= {(first, first + length) for first in places}
        length = length + 1 if every else max(length + 1, int(length * _GROWTH))
    return np.array(sorted(windows), dtype=np.int64).reshape(-1, 2)


def windows_near(n: int, first: int, stop: int) -> Index:
    """Return all windows ``(w, 2)`` whose edges lie within one candidate step of those of a window."""
    reach = max(1, (stop - first) // _FINE)
    windows = [
        (begin, end)
        for begin in range(max(first - reach, MIN_WINDOW), first + reach + 1)
        for end in range(stop - reach, min(stop + reach, n) + 1)
        if end - begin >= MIN_WINDOW and (end == n or end <= n - MIN_WINDOW)
    ]
    return np.array(windows, dtype=np.int64)


class _Scan:
    """Variance explained by windows under one noise model."""

    def __init__(self, model: AutoregressiveNoise, search: WindowSearch, windows: Index) -> None:
        self.baseline = WeightedBaseline(model, search.positions, search.baseline)
        self.time = search.time[:, None]
        self.first, self.stop = windows.T
        projected = self.baseline.projected
        level = self._blocks(projected)
        mixed = self._blocks(projected * self.time)
        slope = self._blocks(projected * self.time * self.time.T)
        # The slope is made orthogonal to the level.
        own = slope - mixed**2 / np.maximum(level, _MIN_POWER)
        usable = (self.stop - self.first >= OWN_SLOPE) & (own > _MIN_POWER * np.maximum(slope, _MIN_POWER))
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, own, 1.0)), 0.0)
        self.by_level: Array = (1.0 / np.sqrt(np.maximum(level, _MIN_POWER)))[:, None]
        self.by_slope: Array = scale[:, None]
        self.mixed: Array = (-scale * mixed / np.maximum(level, _MIN_POWER))[:, None]
        self.penalty = float(np.log(len(search.days)))

    def losses(self, values: Array) -> tuple[Array, Array, Index]:
        """Loss of each series ``(n, m)`` with the line alone and with the best window, and that window's index."""
        weighted = self.baseline.projected @ values
        left = np.einsum("nm,nm->m", values, weighted)
        # Of a series without any scatter, no window explains more than the line.
        left = np.maximum(left, np.finfo(np.float64).tiny)
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
            self.baseline.loss(left),
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
    """Size of a shape ``(n,)`` in a series ``(n,)`` with a baseline ``(n, p)``, and its standard deviation."""
    noise = best_baseline(positions, np.column_stack([baseline, unit]), values)
    own = WeightedBaseline(noise.model, positions, baseline)
    power = float(unit @ own.projected @ unit)
    value = float(unit @ own.projected @ values) / power
    rest = values - value * unit
    variance = float(rest @ own.projected @ rest) / max(own.freedom - 1, 1)
    return value, float(np.sqrt(max(variance, 0.0) / power))
