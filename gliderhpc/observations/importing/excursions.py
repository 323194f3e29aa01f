"""Excursions of a clock: rows whose times were wrong for a while, between rows whose times are right.

A damaged time, or a file with a wrong date, contradicts the rows after it. This alone does not show which of the two is
wrong: the rows before may be an excursion, or the clock may have been set back for good. An excursion fits between the
rows before and after it: three hours with tomorrow's date lie in a gap of at least three hours. Where a clock is set
back for good, there is no such gap. If both the rows ahead and those behind fit, the fewer are the excursion.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.validation import CLOCK_SET_BACK, describe_time
from gliderhpc.observations.records import FloatArray, TimeArray

SUBMERGED = 5.0
"""Depth (m) below which a row belongs to a dive."""

_NANOSECONDS = 1_000_000_000
_STEP = int(CLOCK_SET_BACK * _NANOSECONDS)

_MAX_DURATION = 86_400 * _NANOSECONDS
"""Longest duration (ns) of an excursion whose times overlap with those before and after it."""

_SURFACING = 1800 * _NANOSECONDS
"""Longest usual pause (ns) of a record at the surface."""

_CLOCK_JUMP = 3600 * _NANOSECONDS
"""Step forward (ns) that does not count as elapsed time: the clock may have gone from one wrong time to another."""


@dataclass(frozen=True, eq=False)
class Excursion:
    """Rows that are ahead of the rows after them, or behind the rows before them, while these agree.

    Attributes
    ----------
    start, stop : int
        Its first row and the row after its last.
    seconds : float
        Time that its rows last (s).
    begin, end : numpy.datetime64
        Times of its first and last row.
    before, after : numpy.datetime64
        Times of the rows before and after it; NaT at the beginning of the record.
    """

    start: int
    stop: int
    seconds: float
    begin: np.datetime64
    end: np.datetime64
    before: np.datetime64
    after: np.datetime64

    @property
    def brief(self) -> bool:
        """Return whether the excursion affects no more than a few rows."""
        return self.seconds <= CLOCK_SET_BACK

    def describe(self) -> str:
        """Clause that describes the excursion in a message, with the remedy."""
        begin, end, after = (_whole_seconds(time) for time in (self.begin, self.end, self.after))
        follows = "" if np.isnat(self.before) else f"follow {_whole_seconds(self.before)} and "
        return f"the clock was wrong: times from {begin} to {end} {follows}precede {after}; correct these times"


def _whole_seconds(time: np.datetime64) -> str:
    return describe_time(time.astype("datetime64[s]"))


def find_excursions(time: TimeArray) -> list[Excursion]:
    """Find the excursions of a clock.

    Parameters
    ----------
    time : (n,) array
        Times in the order of the record; NaT is skipped.

    Returns
    -------
    list of Excursion
        Excursions in the order of their ends. A row may belong to more than one.
    """
    known = np.flatnonzero(~np.isnat(time))
    clock = time[known].astype("datetime64[ns]").astype(np.int64)
    if not np.any(clock[:-1] - clock[1:] > _STEP):
        return []
    ranges = _ranges(clock.tolist())
    return [_excursion(time, known, *each) for each in ranges]


def in_excursion(time: TimeArray, *, brief: bool = False) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the rows in an excursion of the clock, or only of those in one of at most a minute."""
    found = np.zeros(len(time), dtype=bool)
    for excursion in find_excursions(time):
        if excursion.brief or not brief:
            found[excursion.start : excursion.stop] = True
    return found


def find_lost(
    time: TimeArray, part: npt.NDArray[np.int64], depth: FloatArray, keep: npt.NDArray[np.bool_]
) -> dict[int, str]:
    """Find the parts of a record lost to wrong times.

    Parameters
    ----------
    time : (n,) array
        Times in the order of the record.
    part : (n,) int array
        Number of the part of each row (cycle, dive).
    depth : (n,) array
        Depths of the rows (m); NaN where missing.
    keep : (n,) array of bool
        Mask of the rows that remain.

    Returns
    -------
    dict of int to str
        Reasons by part that has no remaining row, or lost more than a minute of a dive to an excursion of the clock.
    """
    whole = set(np.unique(part[~np.isnat(time)]).tolist()) - set(np.unique(part[keep]).tolist())
    lost: dict[int, str] = {}
    for excursion in find_excursions(time):
        rows = slice(excursion.start, excursion.stop)
        concerned = whole & set(np.unique(part[rows]).tolist())
        if not excursion.brief and np.any(depth[rows] > SUBMERGED):
            concerned |= set(np.unique(part[rows][depth[rows] > SUBMERGED]).tolist())
            concerned |= _around(excursion, part)
        lost |= {number: excursion.describe() for number in sorted(concerned - lost.keys())}
    return lost | {number: _describe_late(time, part == number, keep) for number in sorted(whole - lost.keys())}


def _around(excursion: Excursion, part: npt.NDArray[np.int64]) -> set[int]:
    """Part that begins before and ends after an excursion; empty if there is none."""
    if excursion.start == 0 or excursion.stop == len(part) or part[excursion.start - 1] != part[excursion.stop]:
        return set()
    return {int(part[excursion.stop])}


def _describe_late(time: TimeArray, own: npt.NDArray[np.bool_], keep: npt.NDArray[np.bool_]) -> str:
    """Describe why no row of a part remains: its times do not follow those before it."""
    rows = np.flatnonzero(own & ~np.isnat(time))
    begin, end = (_whole_seconds(time[row]) for row in (rows[0], rows[-1]))
    earlier = time[: rows[0]][keep[: rows[0]]]
    after = f", {_whole_seconds(earlier[-1])}" if len(earlier) else ""
    return (
        f"the clock was set back, or the record is given twice: its times from {begin} to {end} do not follow the "
        f"last one before it{after}; correct these times"
    )


def _excursion(time: TimeArray, known: npt.NDArray[np.int64], start: int, stop: int, seconds: float) -> Excursion:
    """Describe the excursion in a range of the known times."""
    return Excursion(
        start=int(known[start]),
        stop=int(known[stop - 1]) + 1,
        seconds=seconds,
        begin=time[known[start]],
        end=time[known[stop - 1]],
        before=time[known[start - 1]] if start else np.datetime64("NaT", "ns"),
        after=time[known[stop]],
    )


@dataclass
class _Increasing:
    """Times found so far that increase: their rows, and the time elapsed without jumps (ns)."""

    clock: Sequence[int]
    rows: list[int] = field(default_factory=list)
    elapsed: list[int] = field(default_factory=list)

    def add(self, row: int) -> None:
        """Add a row that is later than all."""
        step = self.clock[row] - self.clock[self.rows[-1]] if self.rows else 0
        self.elapsed.append((self.elapsed[-1] if self.rows else 0) + (step if step <= _CLOCK_JUMP else 0))
        self.rows.append(row)

    def lasts(self, place: int) -> int:
        """Time elapsed since a place (ns)."""
        return self.elapsed[-1] - self.elapsed[place]

    def cut(self, place: int) -> None:
        """Remove the rows from a place on."""
        del self.rows[place:], self.elapsed[place:]


def _ranges(clock: list[int]) -> list[tuple[int, int, float]]:
    """Find the range (first, after last) and the duration (s) of every excursion of a clock (ns)."""
    later = _next_later(clock)
    found: list[tuple[int, int, float]] = []
    rising = _Increasing(clock)
    ended = 0
    for row, now in enumerate(clock):
        if row < ended:
            continue
        if not rising.rows or now > clock[rising.rows[-1]]:
            rising.add(row)
        elif clock[row - 1] - now > _STEP:
            ahead = _place_ahead(rising, row, later[rising.rows[-1]])
            ended = row if ahead is not None else _end_behind(rising, row, later[rising.rows[-1]])
            if ahead is not None:
                found.append((rising.rows[ahead], row, rising.lasts(ahead) / _NANOSECONDS))
                rising.cut(ahead)
                rising.add(row)
            elif ended > row:
                found.append((row, ended, max(clock[ended - 1] - now, 0) / _NANOSECONDS))
    return found


def _place_ahead(rising: _Increasing, row: int, resumed: int) -> int | None:
    """Find the place from which the times are an excursion that ends before a row; None if there is none."""
    clock = rising.clock
    ahead = bisect_left(rising.rows, clock[row], key=clock.__getitem__)
    if _is_ahead(rising, ahead, row, resumed):
        return ahead
    # The excursion may have begun earlier, if it is shorter than its rows last.
    back = clock[rising.rows[-1]] - clock[row]
    for place in range(ahead - 1, 0, -1):
        first, before = clock[rising.rows[place]], clock[rising.rows[place - 1]]
        if _is_return(first - before, back):
            return place
        if clock[row] - first > _MAX_DURATION:
            break
    return None


def _end_behind(rising: _Increasing, row: int, resumed: int) -> int:
    """Find the row after an excursion that begins with a row; the row itself if there is none."""
    clock = rising.clock
    if _is_behind(rising, row, resumed):
        return resumed
    back = clock[rising.rows[-1]] - clock[row]
    for end in range(row + 1, len(clock)):
        if _is_return(clock[end] - clock[end - 1], back):
            return end
        if abs(clock[end] - clock[row]) > _MAX_DURATION:
            break
    return row


def _is_return(forward: int, back: int) -> bool:
    """Return whether a step forward compensates a step back of the clock (ns), apart from the time between the rows.

    A short step forward may be a surfacing between two dives.
    """
    return _SURFACING < back < forward <= 1.1 * back + _STEP


def _is_ahead(rising: _Increasing, ahead: int, row: int, resumed: int) -> bool:
    """Return whether the times from a place on are an excursion, rather than those from a row on that precede them."""
    clock = rising.clock
    fewer = len(rising.rows) - ahead < resumed - row
    if ahead == 0:
        return fewer and not _is_behind(rising, row, resumed)
    room, lasts = clock[row] - clock[rising.rows[ahead - 1]], rising.lasts(ahead)
    if lasts >= room:
        return False
    if resumed == len(clock):
        # At the end of the record nothing else confirms the rows behind; a few of them may be damaged themselves.
        return fewer or clock[-1] - clock[row] > _STEP
    return fewer or not _is_behind(rising, row, resumed)


def _is_behind(rising: _Increasing, row: int, resumed: int) -> bool:
    """Return whether there is room for the rows from one on that are behind, before the times are resumed."""
    clock = rising.clock
    return resumed < len(clock) and clock[resumed - 1] - clock[row] < clock[resumed] - clock[rising.rows[-1]]


def _next_later(clock: Sequence[int]) -> list[int]:
    """Find, for each time, the next row with a later one; the number of rows if there is none."""
    found = [len(clock)] * len(clock)
    waiting: list[int] = []
    for row, now in enumerate(clock):
        while waiting and clock[waiting[-1]] < now:
            found[waiting.pop()] = row
        waiting.append(row)
    return found
