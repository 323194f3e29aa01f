"""The axes of a gridded field: between which two of its points a position lies, and how near to either."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TURN = 360.0
"""Degrees of longitude after which the Earth repeats itself."""

_CLOSES = 0.01


@dataclass(frozen=True, eq=False)
class Cells:
    """Neighbours of positions along one axis.

    Attributes
    ----------
    lower, upper : (n,) int arrays
        Places on the axis, in the file's order, between which each position lies.
    weight : (n,) array
        Of the upper one, 0 to 1.
    inside : (n,) bool array
        Whether the position lies on the axis at all; where it does not, the rest means nothing.
    """

    lower: NDArray[np.int64]
    upper: NDArray[np.int64]
    weight: Array
    inside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Axis:
    """Coordinates along one dimension.

    Parameters
    ----------
    values : (k,) array
        Strictly increasing or strictly decreasing, as they stand in the file.
    longest : float
        Positions between two values further apart than this lie in a hole, which is outside.
    """

    values: Array
    longest: float = np.inf

    def cells(self, positions: Array) -> Cells:
        """Neighbours of each position ``(n,)``; beyond either end is outside, an end itself is inside."""
        return _cells(self.values, positions, self.longest)


@dataclass(frozen=True, eq=False)
class LongitudeAxis:
    """Longitudes (degree), on whatever branch the file has them; those of the whole circle close on themselves.

    Parameters
    ----------
    values : (k,) array
        As they stand in the file, 0 to 360, -180 to 180, or jumping from one to the other at the antimeridian.
    """

    values: Array

    def cells(self, positions: Array) -> Cells:
        """Neighbours of each position ``(n,)``, whichever branch it is on."""
        unwrapped = self.unwrapped
        closed = np.append(unwrapped, unwrapped[0] + np.sign(self._spacing) * TURN) if self.closes else unwrapped
        middle = 0.5 * (closed[0] + closed[-1])
        cells = _cells(closed, positions - TURN * np.round((positions - middle) / TURN), np.inf)
        return Cells(cells.lower % len(self.values), cells.upper % len(self.values), cells.weight, cells.inside)

    @property
    def unwrapped(self) -> Array:
        """The values ``(k,)`` without the jump at the antimeridian."""
        return np.unwrap(self.values, period=TURN)

    @property
    def closes(self) -> bool:
        """Whether the last value lies one spacing short of the first, all around the Earth."""
        if len(self.values) < 2:
            return False
        span = abs(self.unwrapped[-1] - self.unwrapped[0])
        return bool(abs(span + abs(self._spacing) - TURN) < _CLOSES * abs(self._spacing))

    @property
    def _spacing(self) -> float:
        unwrapped = self.unwrapped
        return float((unwrapped[-1] - unwrapped[0]) / (len(unwrapped) - 1))


def is_monotone(values: Array) -> bool:
    """Whether values ``(k,)`` increase, or decrease, from each to the next."""
    steps = np.diff(values)
    return bool(np.isfinite(values).all() and ((steps > 0.0).all() or (steps < 0.0).all()))


def _cells(values: Array, positions: Array, longest: float) -> Cells:
    count = len(values)
    falling = count > 1 and values[-1] < values[0]
    rising = values[::-1] if falling else values
    lower = np.clip(np.searchsorted(rising, positions, side="right") - 1, 0, max(count - 2, 0))
    upper = np.minimum(lower + 1, count - 1)
    width = rising[upper] - rising[lower]
    weight = np.divide(positions - rising[lower], width, out=np.zeros(len(positions)), where=width > 0.0)
    inside = (positions >= rising[0]) & (positions <= rising[-1])
    inside &= (width <= longest) | (weight == 0.0) | (weight == 1.0)
    if falling:
        lower, upper = count - 1 - lower, count - 1 - upper
    return Cells(lower.astype(np.int64), upper.astype(np.int64), weight, inside)
