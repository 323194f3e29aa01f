"""Rows of an instrument's files, columns of an observation file under construction, and clocks that are set back.

Rows around a step of the clock have no reliable time. The importers drop the rows whose times come a second time.
Where they were rows of a dive, that dive has lost a part; where they were rows at the surface, the fixes on both
sides of the step have times by two clocks.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import EARLIEST, LATEST
from gliderhpc.observations.validation import CLOCK_SET_BACK

NOT_INCREASING = "time not increasing"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one or more files.

    Attributes
    ----------
    time : (n,) array
        UTC (ns).
    part : (n,) int array
        Number of the file each row comes from.
    columns : dict of str to (n,) array
        The values, in the file's units; NaN where a field is empty.
    """

    time: TimeArray
    part: npt.NDArray[np.int64]
    columns: dict[str, FloatArray]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def where(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> "Rows":
        """Select some of the rows, by a mask or by their indices."""
        columns = {name: values[chosen] for name, values in self.columns.items()}
        return Rows(self.time[chosen], self.part[chosen], columns)


def increasing(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the times that are present and lie after all before."""
    there = ~np.isnat(time)
    since = np.where(there, time.astype("datetime64[ns]").astype(np.int64), np.iinfo(np.int64).min)
    there[1:] &= since[1:] > np.maximum.accumulate(since)[:-1]
    return there


def keep_rows(rows: Rows, keep: npt.NDArray[np.bool_], reason: str, dropped: Counter[str]) -> Rows:
    """Keep some of the rows and count the others in `dropped` under `reason`."""
    lost = int(np.count_nonzero(~keep))
    if lost:
        dropped[reason] += lost
    return rows.where(keep)


def join_rows(parts: Sequence[Rows], names: Iterable[str]) -> Rows:
    """Put the rows of several files one after the other; the columns are `names`."""
    if not parts:
        return Rows(np.zeros(0, "datetime64[ns]"), np.zeros(0, np.int64), {name: np.zeros(0) for name in names})
    return Rows(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.part for part in parts]),
        {name: np.concatenate([part[name] for part in parts]) for name in names},
    )


Columns = dict[str, npt.NDArray[np.generic]]
"""Variables of the observation format by name, in its units."""


def join_columns(parts: Sequence[Columns]) -> Columns:
    """Put the samples of several files one after the other; what one of them lacks is missing (NaN) there.

    Parameters
    ----------
    parts : sequence of dict
        Columns along ``time``, which each of them has.
    """
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate([part.get(name, np.full(len(part["time"]), np.nan)) for part in parts]) for name in names
    }


def nearest_rows(time: npt.NDArray[Any], wanted: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Find the row of increasing times ``(n,)``, n >= 1, nearest to each wanted one ``(m,)``; the earlier of two."""
    right = np.clip(np.searchsorted(time, wanted), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(np.abs(wanted - time[left]) <= np.abs(time[right] - wanted), left, right)


def onto_nearest(
    time: TimeArray, sampled: TimeArray, values: FloatArray, within: np.timedelta64 | TimeArray
) -> FloatArray:
    """Put each sample on the nearest of other times, NaN where there is none within reach.

    Nothing is interpolated: a sample that was not measured is no datum.

    Parameters
    ----------
    time : (n,) array
        Times to put the samples on, increasing, n >= 1.
    sampled : (m,) array
        Times of the samples.
    values : (m,) array
        The samples.
    within : numpy.timedelta64, or (m,) array of them
        Largest distance by which a sample is moved, or each of them.

    Returns
    -------
    (n,) array
    """
    nearest = nearest_rows(time, sampled)
    distance = np.abs(sampled - time[nearest])
    # Farthest first, so that of two samples on one place the nearer is the one that stays.
    order = np.argsort(-distance, kind="stable")
    order = order[(distance <= within)[order] & np.isfinite(values[order])]
    placed = np.full(len(time), np.nan)
    for index in order.tolist():
        placed[nearest[index]] = values[index]
    return placed


SUBMERGED = 5.0
"""Rows deeper than this (m) are of a dive."""

_SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True, eq=False)
class ClockStep:
    """A clock that was set back.

    Attributes
    ----------
    place : int
        First row after the step, among the rows that remain.
    at : numpy.datetime64
        Time of the last row before it.
    seconds : float
        Time by which it was set back.
    submerged : bool
        True where rows of a dive were dropped for it.
    """

    place: int
    at: np.datetime64
    seconds: float
    submerged: bool

    def describe(self) -> str:
        """Sentence on the step."""
        return f"the clock was set back by {self.seconds:.0f} s at {self.at.astype('datetime64[s]')}"


def find_clock_steps(time: TimeArray, keep: npt.NDArray[np.bool_], depth: FloatArray) -> list[ClockStep]:
    """Find where a clock was set back.

    Parameters
    ----------
    time : (n,) array
        Of the rows, in the order of the files; NaT is skipped.
    keep : (n,) array of bool
        Rows that stay: those whose time lies after all before them.
    depth : (n,) array
        m; NaN where missing.
    """
    there = np.flatnonzero(~np.isnat(time))
    steps: dict[int, ClockStep] = {}
    for index in np.flatnonzero((time[there[:-1]] - time[there[1:]]) / _SECOND > CLOCK_SET_BACK).tolist():
        before, after = int(there[index]), int(there[index + 1])
        following = np.flatnonzero(keep[after:])
        resumed = after + int(following[0]) if len(following) else len(time)
        lost = depth[after:resumed][~keep[after:resumed]]
        place = int(np.count_nonzero(keep[:after]))
        step = ClockStep(
            place, time[before], float((time[before] - time[after]) / _SECOND), bool(np.any(lost > SUBMERGED))
        )
        known = steps.get(place)
        steps[place] = step if known is None else replace(known, submerged=known.submerged or step.submerged)
    return list(steps.values())


def without_doubtful(
    steps: Iterable[ClockStep], profile: npt.NDArray[np.int64], time: TimeArray, fixes: Fixes
) -> tuple[npt.NDArray[np.int64], Fixes, dict[int, str], list[str]]:
    """Take out the profiles that a step of the clock has cost a part, and the fixes with times by two clocks.

    Parameters
    ----------
    steps : iterable of ClockStep
        Steps found in the record.
    profile : (n,) int array
        Number of the profile of each row, 0 outside any.
    time : (n,) array
        Of the rows, increasing.
    fixes : Fixes
        GPS fixes.

    Returns
    -------
    profile : (n,) int array
        Without the profiles left out.
    fixes : Fixes
        Without those around a step at the surface.
    left_out : dict of int to str
        Profiles left out, and why.
    remarks : list of str
        A line for each step that cost fixes.
    """
    profile, left_out, remarks = profile.copy(), {}, []
    for step in steps:
        number = _profile_at(step, profile)
        if number:
            left_out[number] = f"{step.describe()}: a part of the profile is lost"
            profile[profile == number] = 0
            continue
        begin, end = _surfacing(step.place, profile, time)
        doubtful = (fixes.time >= begin) & (fixes.time <= end)
        if doubtful.any():
            fixes = fixes.where(~doubtful)
            remarks.append(
                f"{step.describe()}: {np.count_nonzero(doubtful)} GPS fixes of that surfacing are left out, so the "
                "profiles on either side have no current"
            )
    return profile, fixes, left_out, remarks


def _profile_at(step: ClockStep, profile: npt.NDArray[np.int64]) -> int:
    """Number of the profile that has lost rows by a step, 0 where none has."""
    if 0 < step.place < len(profile) and profile[step.place] and profile[step.place] == profile[step.place - 1]:
        return int(profile[step.place])
    if not step.submerged:
        return 0
    later = profile[step.place :]
    return int(later[np.argmax(later > 0)]) if len(later) else 0


def _surfacing(place: int, profile: npt.NDArray[np.int64], time: TimeArray) -> tuple[np.datetime64, np.datetime64]:
    """Last time of a profile before a place, and the first of one after it."""
    before, after = np.flatnonzero(profile[:place]), np.flatnonzero(profile[place:])
    return (
        time[before[-1]] if len(before) else EARLIEST,
        time[place + after[0]] if len(after) else LATEST,
    )


def times_by_two_clocks(time: TimeArray) -> list[tuple[np.datetime64, np.datetime64]]:
    """Find the times that come twice in a record: once before its clock was set back, once after.

    Pieces of a record that only lie in another order have no times in common, and none is found.

    Parameters
    ----------
    time : (n,) array
        In the order of the record; NaT is skipped.

    Returns
    -------
    list of (numpy.datetime64, numpy.datetime64)
        Begin and end of each stretch.
    """
    known = time[~np.isnat(time)]
    if not len(known):
        return []
    edges = [0, *(np.flatnonzero((known[:-1] - known[1:]) / _SECOND > CLOCK_SET_BACK) + 1).tolist(), len(known)]
    pieces = sorted((known[start:stop].min(), known[start:stop].max()) for start, stop in pairwise(edges))
    found: list[tuple[np.datetime64, np.datetime64]] = []
    for (_, reached), (begin, end) in zip(_reached(pieces), pieces[1:], strict=False):
        if begin < reached:
            found.append((begin, min(reached, end)))
    return found


def _reached(
    pieces: Sequence[tuple[np.datetime64, np.datetime64]],
) -> Iterator[tuple[np.datetime64, np.datetime64]]:
    """Pieces up to each one, as one."""
    return accumulate(pieces, lambda before, piece: (before[0], max(before[1], piece[1])))


def in_time_order(columns: Columns) -> tuple[Columns, int, list[ClockStep]]:
    """Keep the samples whose time lies after all before them; the number of the others, and the steps of the clock."""
    time = columns["time"].astype("datetime64[ns]")
    keep = increasing(time)
    steps = find_clock_steps(time, keep, columns["depth"].astype(np.float64))
    return {name: values[keep] for name, values in columns.items()}, int(np.count_nonzero(~keep)), steps
