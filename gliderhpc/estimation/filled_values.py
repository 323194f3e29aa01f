"""Values that were not measured but filled in: repeated from the last measurement, or interpolated between two.

Tools that convert a glider's sensors to common times do one or the other. Treated as measurements, such values are far
too smooth, and their errors last as long as the true sample interval: on twins interpolated from 4 s to 1 s, the error
of the speed would be five times its stated deviation.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.observations.format import MEASURED
from gliderhpc.observations.records import FloatArray, ProfileRecord

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_INSTRUMENTS: tuple[tuple[str, ...], ...] = (("roll", "pitch", "heading"), ("depth",))
"""Measurements of one instrument, whose values have the same times."""
_MIN_CHANGES = 15
"""Minimum number of changes for a pattern."""
_MIN_SHARED_CHANGES = 5
"""Minimum number of changes for a comparison with the times of the other instrument."""
_MAX_PERIOD = 60
"""Maximum number of rows from one measured value to the next."""
_NEIGHBOURS = 11
"""Number of distances between changes that determine the local period."""
_EQUAL_STEPS, _MIN_EQUAL_SHARE = 0.02, 0.9
"""Relative difference of steps of the depth that are considered equal, and share of such steps in a rounded record."""
_MIN_REGULAR_SHARE = 0.95
"""Minimum share of the changes that occur at the same position in every period, or at the other instrument's times."""
_MIN_FILLED_SHARE = 0.3
"""Minimum share of filled values if the times of the measured ones are irregular."""
_MAX_ADJACENT_SHARE = 0.1
"""Maximum share of changes in neighbouring rows; manoeuvres have more."""
_MIN_SIZES, _MAIN_SHARE = 6, 0.8
"""Minimum number of distinct sizes of this share of the changes; with fewer sizes, the record is rounded."""
_GAP_RATIO = 20.0
"""Ratio to the median time without a change above which such a time is a gap, or a glide without noise."""
_ROUNDING = 4.0 * float(np.finfo(np.float32).eps)
"""Relative rounding of values in single precision, as most files have them."""


def without_filled_values(record: ProfileRecord) -> tuple[ProfileRecord, tuple[str, ...]]:
    """Return a record with its filled values missing, and the names of the variables that had any.

    Notes
    -----
    Repeated values equal the previous one; interpolated ones lie on the line between their neighbours. Both also occur
    in rounded records of a steady glide, but there neither at the same position in every period, nor between many
    changes of different size. Nothing is left out if attitude and depth would then have no times in common.
    """
    rows = np.flatnonzero(np.isfinite(np.column_stack([getattr(record, name) for name in MEASURED])).all(axis=1))
    if len(rows) <= _MIN_CHANGES:
        return record, ()
    measured = _measured_rows(record, rows)
    if not measured or 2 * np.count_nonzero(np.all(list(measured.values()), axis=0)) < min(map(sum, measured.values())):
        return record, ()
    filled = {name: rows[~mask] for names, mask in measured.items() for name in names}
    cleaned = {name: _with_missing(getattr(record, name), rows) for name, rows in filled.items()}
    return replace(record, **cleaned), tuple(name for name in MEASURED if name in cleaned)  # type: ignore[arg-type]


def _with_missing(values: FloatArray, rows: NDArray[np.int64]) -> FloatArray:
    values = values.copy()
    values[rows] = np.nan
    return values


def _measured_rows(record: ProfileRecord, rows: NDArray[np.int64]) -> dict[tuple[str, ...], Mask]:
    """Return the mask of the measured values among some rows, for each instrument with filled values."""
    time = record.time[rows]
    values = {names: np.array([_continuous(record, name)[rows] for name in names]) for names in _INSTRUMENTS}
    masks = {names: mask for names in _INSTRUMENTS if (mask := _measured(values[names], time)) is not None}
    if len(masks) == 1:
        (known,) = masks.values()
        (other,) = set(_INSTRUMENTS) - set(masks)
        steps, bends = _steps(values[other]), _bends(values[other], time)
        if _coincide(steps > 1.0, known) or _coincide((bends > 1.0) & _local_maxima(bends), known):
            masks[other] = known
    return masks


def _continuous(record: ProfileRecord, name: str) -> FloatArray:
    values: FloatArray = getattr(record, name)
    known = np.isfinite(values)
    if name == "heading":
        values = values.copy()
        values[known] = np.unwrap(values[known])
    return values


def _measured(values: Array, time: FloatArray) -> Mask | None:
    """Return the mask of an instrument's measured values; None if no filled ones are recognised."""
    repeated = _where_repeated(values, time)
    return _where_interpolated(values, time) if repeated is None else repeated


def _where_repeated(values: Array, time: FloatArray) -> Mask | None:
    """Return the mask of the values that differ from the one before, None if these are not the measured ones."""
    steps, any_row = _steps(values), np.full(len(time), True)
    regular = None if _are_one_quantum(values, steps) else _in_periods(steps > 1.0, time)
    if regular is None and _are_irregular(steps, any_row, any_row):
        return np.asarray(steps > 1.0)
    return regular


def _where_interpolated(values: Array, time: FloatArray) -> Mask | None:
    """Return the mask of the values off the line between their neighbours, None if these are not the measured ones."""
    bends, moving = _bends(values, time), np.append(_steps(values)[1:], np.inf) > 1.0
    regular = _in_periods(bends > 1.0, time)
    if regular is None and _are_irregular(bends, moving, _local_maxima(bends)):
        return np.asarray((bends > 1.0) & _local_maxima(bends))
    return regular


def _steps(values: Array) -> FloatArray:
    """Return the change of the values since the row before, the largest of them, in units of their rounding."""
    return np.append(np.inf, np.abs(np.diff(values)).max(axis=0) / _rounding(values))


def _bends(values: Array, time: FloatArray) -> FloatArray:
    """Return the distance of the values from the line between their neighbours, as `_steps`."""
    fraction = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])
    distances = np.abs(values[:, 1:-1] - values[:, :-2] - fraction * (values[:, 2:] - values[:, :-2]))
    return np.concatenate([[np.inf], distances.max(axis=0) / _rounding(values), [np.inf]])


def _are_one_quantum(values: Array, steps: FloatArray) -> bool:
    """Return whether the steps of a depth are those of its rounding, which a constant speed makes regular."""
    if len(values) > 1:
        return False
    known = steps[(steps > 1.0) & np.isfinite(steps)]
    return len(known) > 0 and float(np.mean(np.abs(known / np.median(known) - 1.0) <= _EQUAL_STEPS)) >= _MIN_EQUAL_SHARE


def _local_maxima(bends: FloatArray) -> Mask:
    """Return whether bends are larger than both neighbours: a value between two rows bends the line at both."""
    return np.asarray((bends >= np.append(0.0, bends[:-1])) & (bends >= np.append(bends[1:], 0.0)))


def _rounding(values: Array) -> float:
    return _ROUNDING * max(1.0, float(np.abs(values).max()))


def _in_periods(changed: Mask, time: FloatArray) -> Mask | None:
    """Return the mask of one row in every period if the changes occur periodically, else None."""
    step = float(np.median(np.diff(time)))
    if not step > 0.0:
        return None
    slots = np.rint((time - time[0]) / step).astype(np.int64)
    # Whether the first and the last row were measured is unknown.
    changes = slots[1:-1][changed[1:-1]]
    distances = np.diff(changes)
    if len(distances) < _MIN_CHANGES:
        return None
    regular = [n for n in range(2, _MAX_PERIOD + 1) if np.mean(distances % n == 0) >= _MIN_REGULAR_SHARE]
    if not regular:
        return None
    last_change = np.clip(np.searchsorted(changes, slots, side="right") - 1, 0, len(distances))
    periods = np.append(_local_periods(distances, regular[-1]), regular[-1])
    return np.asarray((slots - changes[last_change]) % periods[last_change] == 0)


def _local_periods(distances: NDArray[np.int64], common: int) -> NDArray[np.int64]:
    """Return the local period at each distance between changes, which varies with depth; all are multiples of one."""
    periods = np.full(len(distances), common)
    for period in range(2 * common, _MAX_PERIOD + 1, common):
        share = scipy.ndimage.uniform_filter1d(
            (distances % period == 0).astype(np.float64), _NEIGHBOURS, mode="nearest"
        )
        periods[share > 1.0 - 1.5 / _NEIGHBOURS] = period
    return periods


def _are_irregular(sizes: FloatArray, possible: Mask, nearest: Mask) -> bool:
    """Return whether the rows without a change were filled in between others at irregular times.

    Parameters
    ----------
    sizes : (m,) array
        Size of the change at each row.
    possible : (m,) array of bool
        Whether a row without a change may be a filled one.
    nearest : (m,) array of bool
        Whether a row with a change is the one nearest to a measured value.
    """
    changed = sizes > 1.0
    distances = np.diff(np.flatnonzero(changed & nearest))
    if (
        len(distances) < 2 * _MIN_CHANGES
        or np.mean(~changed[possible]) < _MIN_FILLED_SHARE
        or np.mean(distances == 1) > _MAX_ADJACENT_SHARE
    ):
        return False
    if distances[distances > _GAP_RATIO * np.median(distances)].sum() > 0.5 * distances.sum():
        return False
    _, counts = np.unique(np.rint(0.25 * sizes[changed & np.isfinite(sizes)]), return_counts=True)
    is_frequent = np.cumsum(np.sort(counts)[::-1]) < _MAIN_SHARE * counts.sum()
    return int(np.count_nonzero(is_frequent)) + 1 >= _MIN_SIZES


def _coincide(changed: Mask, known: Mask) -> bool:
    """Return whether an instrument's changes, even if few, occur at the measured values of the other one."""
    return (
        int(np.count_nonzero(changed)) >= _MIN_SHARED_CHANGES and float(np.mean(known[changed])) >= _MIN_REGULAR_SHARE
    )
