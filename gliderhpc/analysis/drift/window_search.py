"""Search of a series for the window in which it leaves the mission's line, over all positions and lengths."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.analysis.drift.noise_models import NOISE_MODELS, NoiseModel, WeightedBaseline

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHORTEST = 3
"""Profiles of a window, and before and after it, at least; a window may also last until the end."""

OWN_SLOPE = 4
"""Profiles from which on a window may have a slope of its own."""

CAREFUL = 2.0
"""Loss by which a more persistent noise may be the worse one and is still taken for the null series."""

_FINE, _GROWTH = 6, 1.2
"""Places a window length, and ratio of one length to the next, of the candidates."""

_TABLE = 2**17
"""Entries of a table of windows and series, which go into a core's cache."""

_LEAST = 1e-9


@dataclass(frozen=True, eq=False)
class Strongest:
    """The strongest window of each of some series.

    Attributes
    ----------
    gain : (m,)
        Drop of minus twice the restricted log likelihood, less the logarithm of the number of values for each
        coefficient, from the mission's line alone.
    window : (m,)
        Which window.
    null : (m,)
        Noise model of the null series: the most persistent of those that fit the line alone about as well as any.
    noise : (m,)
        Noise model with the window.
    """

    gain: Array
    window: Index
    null: Index
    noise: Index


class WindowSearch:
    """Candidate windows of a series, and what they explain under every noise model.

    Parameters
    ----------
    days : (n,)
        Days of the values.
    positions : (n,)
        Their positions along the mission, in profiles.
    shapes : sequence of (n,)
        Changes that are already known, beside a level and a line.

    Notes
    -----
    In a window the series may have another level, and from `OWN_SLOPE` values on another slope. With the inverse
    covariance P of the noise, baseline projected out, what a window explains of a series y takes the sums of ``P y``
    and of ``t P y`` over the window alone, so all windows are searched by cumulative sums. Both hypotheses choose their
    noise model: a wander that explains a window as well takes its gain away.
    """

    def __init__(self, days: Array, positions: Index, shapes: Sequence[Array] = ()) -> None:
        self.days, self.positions = days, positions
        self.time: Array = (days - days.mean()) / max(float(np.ptp(days)), _LEAST)
        self.baseline: Array = np.column_stack([np.ones(len(days)), self.time, *shapes])
        self.windows = candidate_windows(len(days))

    @cached_property
    def _scans(self) -> list["_Scan"]:
        return [_Scan(model, self) for model in NOISE_MODELS]

    def strongest(self, values: Array) -> Strongest:
        """Find the strongest window of each series ``(n, m)``."""
        columns = max(_TABLE // len(self.windows), 1)
        parts = [self._strongest(values[:, start : start + columns]) for start in range(0, values.shape[1], columns)]
        return Strongest(*(np.concatenate([getattr(one, name) for one in parts])
                           for name in ("gain", "window", "null", "noise")))  # fmt: skip

    def gains(self, values: Array) -> Array:
        """Give the gain of the strongest window of each series ``(n, m)``."""
        return self.strongest(values).gain

    def _strongest(self, values: Array) -> Strongest:
        found = [scan.losses(values) for scan in self._scans]
        line, window, which = (np.stack([one[k] for one in found]) for k in range(3))
        noise, every = window.argmin(axis=0), np.arange(values.shape[1])
        fits = line <= line.min(axis=0) + CAREFUL
        null = len(NOISE_MODELS) - 1 - fits[::-1].argmax(axis=0)
        return Strongest(line.min(axis=0) - window.min(axis=0), which[noise, every], null, noise)

    def innovations(self, values: Array, window: int, noise: int) -> Array:
        """Independent errors ``(n,)`` of a series ``(n,)`` that line and window leave, of unit variance."""
        first, stop = self.windows[window]
        inside = np.zeros(len(values))
        inside[first:stop] = 1.0
        own = [inside, inside * self.time] if stop - first >= OWN_SLOPE else [inside]
        root = np.linalg.cholesky(NOISE_MODELS[noise].covariance(self.positions))
        columns = np.linalg.solve(root, np.column_stack([self.baseline, *own, values]))
        fitted = np.linalg.lstsq(columns[:, :-1], columns[:, -1], rcond=None)[0]
        rest = columns[:, -1] - columns[:, :-1] @ fitted
        return np.asarray((rest - rest.mean()) / max(float(rest.std()), _LEAST))


def candidate_windows(n: int) -> Index:
    """Give first value and stop ``(w, 2)`` of the windows to search in series of n values.

    Lengths grow by a fifth, places are a sixth of the length apart, and every window that lasts until the end is
    among them.
    """
    found = {(first, n) for first in range(SHORTEST, n - SHORTEST + 1)}
    length = SHORTEST
    while length <= n - 2 * SHORTEST:
        places = range(SHORTEST, n - SHORTEST - length + 1, max(1, length // _FINE))
        found |= {(first, first + length) for first in places}
        length = max(length + 1, int(length * _GROWTH))
    return np.array(sorted(found), dtype=np.int64).reshape(-1, 2)


class _Scan:
    """What every window explains under one noise model."""

    def __init__(self, model: NoiseModel, search: WindowSearch) -> None:
        self.baseline = WeightedBaseline(model, search.positions, search.baseline)
        self.time = search.time[:, None]
        self.first, self.stop = search.windows.T
        projected = self.baseline.projected
        level = self._blocks(projected)
        mixed = self._blocks(projected * self.time)
        slope = self._blocks(projected * self.time * self.time.T)
        # A slope beside the level, made orthogonal to it.
        own = slope - mixed**2 / np.maximum(level, _LEAST)
        usable = (self.stop - self.first >= OWN_SLOPE) & (own > _LEAST * np.maximum(slope, _LEAST))
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, own, 1.0)), 0.0)
        self.by_level: Array = (1.0 / np.sqrt(np.maximum(level, _LEAST)))[:, None]
        self.by_slope: Array = scale[:, None]
        self.mixed: Array = (-scale * mixed / np.maximum(level, _LEAST))[:, None]
        self.penalty = float(np.log(len(search.days)))

    def losses(self, values: Array) -> tuple[Array, Array, Index]:
        """Loss of the line alone and with the best window, and that window, of each series ``(n, m)``."""
        weighted = self.baseline.projected @ values
        left = np.einsum("nm,nm->m", values, weighted)
        floor = _LEAST * left
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
