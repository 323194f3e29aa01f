"""Order of a file's rows in time: repeated rows are taken once, and rows that are merely in another order are sorted.

A file may join its parts in the order of their names, repeat the end of one part in the next one, or give a few rows
late. Times by a clock that was wrong, or set back, look alike, but overlap with others or lie apart from them. Such
rows are left in the order of the file, where the checks of the clock find them.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.intervals import local_intervals
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.wording import counted

IntArray = npt.NDArray[np.int64]

SEGMENT_BREAK, LONGEST_PAUSE = 600.0, 6.0 * 3600.0
"""Pause (s) at which a file's rows are divided into segments, and longest pause between two segments of a mission."""

_NANOSECONDS = 1_000_000_000

_MIN_EXCESS, _MAX_EXCESS = 0.5, 2.5
"""Limits of the width of a gap into which late rows fit: usual intervals in excess of the number of these rows."""


@dataclass(frozen=True, eq=False)
class RowOrder:
    """Order in which to take a file's rows.

    Attributes
    ----------
    rows : (m,) int array
        Indices of the rows.
    repeated : int
        Number of rows that are left out, because they repeat others.
    parts, late : int
        Numbers of the parts of the file, and of the single rows, that are sorted.
    """

    rows: IntArray
    repeated: int = 0
    parts: int = 0
    late: int = 0

    def describe(self) -> tuple[str, ...]:
        """Sentences on the rows that are left out or sorted."""
        once = f"{counted(self.repeated, 'row')} repeated from elsewhere in the file, each taken once"
        parts = f"its rows are not in time order; {self.parts} parts are sorted"
        late = f"its rows are not in time order; {counted(self.late, 'row')} moved to where the time fits"
        texts = ((self.repeated, once), (self.parts, parts), (self.late, late))
        return tuple(text for count, text in texts if count)


def order_of_rows(time: TimeArray, columns: Sequence[FloatArray]) -> RowOrder:
    """Find the order of a file's rows in time.

    The order of the file remains if its times do not decrease, or if another order would not explain them.

    Parameters
    ----------
    time : (n,) array
        Times of the rows; NaT where missing, and these rows come last where others are sorted.
    columns : sequence of (n,) arrays
        Values of the rows; a row that equals another one in its time and in all of these repeats it.
    """
    as_given = np.arange(len(time))
    known = np.flatnonzero(~np.isnat(time))
    clock = time[known].astype("datetime64[ns]").astype(np.int64)
    if not (np.diff(clock) < 0).any():
        return RowOrder(as_given)
    first = ~_repeats(clock, [values[known] for values in columns])
    rest, clock = known[first], clock[first]
    without = np.flatnonzero(np.isnat(time))
    repeated = int(np.count_nonzero(~first))
    if not (np.diff(clock) < 0).any():
        return RowOrder(np.sort(np.concatenate([rest, without])), repeated)
    order = np.argsort(clock, kind="stable")
    parts = _count_parts(clock)
    late = 0 if parts else _count_late(clock, order)
    if not (parts or late):
        return RowOrder(as_given)
    return RowOrder(np.concatenate([rest[order], without]), repeated, parts, late)


def _repeats(clock: IntArray, columns: Sequence[FloatArray]) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the rows that equal an earlier one in the time and in all columns."""
    found = np.zeros(len(clock), dtype=bool)
    _, place, count = np.unique(clock, return_inverse=True, return_counts=True)
    twice = np.flatnonzero(count[place] > 1)
    columns = [values[twice] for values in columns]
    order = np.lexsort([*columns, clock[twice]])
    one, other = order[:-1], order[1:]
    equal = clock[twice[one]] == clock[twice[other]]
    for values in columns:
        equal &= (values[one] == values[other]) | (np.isnan(values[one]) & np.isnan(values[other]))
    # The sort is stable: of equal rows the first one of the file comes first.
    found[twice[other[equal]]] = True
    return found


def _count_parts(clock: IntArray) -> int:
    """Count the parts of a file that follow one another closely when they are sorted; 0 if they overlap or do not."""
    steps = np.diff(clock)
    first = np.append(0, np.flatnonzero((steps < 0) | (steps > SEGMENT_BREAK * _NANOSECONDS)) + 1)
    last = np.append(first[1:], len(clock)) - 1
    order = np.argsort(clock[first], kind="stable")
    pauses = clock[first[order[1:]]] - clock[last[order[:-1]]]
    # A long pause between segments that also follow one another in the file, as between two missions, is no fault.
    joints = np.diff(order) != 1
    if (pauses < 0).any() or (pauses[joints] > LONGEST_PAUSE * _NANOSECONDS).any():
        return 0
    return int(np.count_nonzero(steps < 0)) + 1


def _count_late(clock: IntArray, order: IntArray) -> int:
    """Count the rows that are out of order and fill the gaps that they left; 0 if some do not.

    Where a clock was set back, the rows after it come between others that leave no gap.
    """
    moved = ~_in_longest_rise(clock)
    others, late = clock[order][~moved[order]], clock[order][moved[order]]
    if len(others) < 3 or np.isin(late, others).any() or (np.diff(late) == 0).any():
        return 0
    usual = local_intervals(np.diff(others))
    usual = np.concatenate([usual[:1], usual, usual[-1:]])
    place = np.searchsorted(others, late)
    count = np.bincount(place, minlength=len(usual))
    # Before the first of the other rows and after the last, the gap ends with the usual interval.
    begin, end = min(late[0], others[0]) - usual[0], max(late[-1], others[-1]) + usual[-1]
    widths = np.diff(np.concatenate([[begin], others, [end]]))
    fits = (widths > (count + _MIN_EXCESS) * usual) & (widths < (count + _MAX_EXCESS) * usual)
    return int(count.sum()) if fits[count > 0].all() else 0


def _in_longest_rise(clock: IntArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of a longest choice of rows whose times do not decrease."""
    ahead = clock > np.minimum.accumulate(clock[::-1])[::-1]
    behind = clock < np.maximum.accumulate(clock)
    doubtful = np.flatnonzero(ahead | behind)
    ends: list[int] = []
    rows: list[int] = []
    before = np.full(len(doubtful), -1)
    for row, now in enumerate(clock[doubtful].tolist()):
        place = bisect_right(ends, now)
        ends[place : place + 1], rows[place : place + 1] = [now], [row]
        before[row] = rows[place - 1] if place else -1
    chosen = ~(ahead | behind)
    row = rows[-1] if rows else -1
    while row >= 0:
        chosen[doubtful[row]] = True
        row = int(before[row])
    return chosen
