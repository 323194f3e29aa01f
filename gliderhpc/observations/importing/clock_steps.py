"""Clocks that are set back during a mission: the steps, and the profiles and fixes that they make doubtful.

Rows around a clock step have no reliable time. The importers drop the rows whose times occur a second time. If these
rows belong to a profile, it is incomplete. If they are at the surface, the fixes on the two sides of the step have
times by two different clocks.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.validation import CLOCK_SET_BACK
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.importing.excursions import SUBMERGED, in_excursion
from gliderhpc.observations.importing.rows import Columns, increasing
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import EARLIEST, LATEST, SECOND


@dataclass(frozen=True, eq=False)
class ClockStep:
    """A backward step of the clock.

    Attributes
    ----------
    place : int
        Index of the first row after the step, among the remaining rows.
    at : numpy.datetime64
        Time of the last row before the step.
    seconds : float
        Size of the step (s).
    submerged : bool
        True if the step caused rows of a dive to be dropped.
    """

    place: int
    at: np.datetime64
    seconds: float
    submerged: bool

    def describe(self) -> str:
        """Clause that describes the step in a message."""
        return f"the clock was set back by {self.seconds:.0f} s at {self.at.astype('datetime64[s]')}"


def find_clock_steps(time: TimeArray, keep: npt.NDArray[np.bool_], depth: FloatArray) -> list[ClockStep]:
    """Find the backward steps of a clock, without those at the beginning or end of an excursion.

    Parameters
    ----------
    time : (n,) array
        Times of the rows, in the order of the files; NaT is skipped.
    keep : (n,) array of bool
        Mask of the remaining rows: those later than all preceding rows.
    depth : (n,) array
        Depths of the rows (m); NaN where missing.
    """
    there = np.flatnonzero(~np.isnat(time) & ~in_excursion(time))
    steps: dict[int, ClockStep] = {}
    for index in np.flatnonzero((time[there[:-1]] - time[there[1:]]) / SECOND > CLOCK_SET_BACK).tolist():
        before, after = int(there[index]), int(there[index + 1])
        following = np.flatnonzero(keep[after:])
        resumed = after + int(following[0]) if len(following) else len(time)
        lost = depth[after:resumed][~keep[after:resumed]]
        place = int(np.count_nonzero(keep[:after]))
        step = ClockStep(
            place, time[before], float((time[before] - time[after]) / SECOND), bool(np.any(lost > SUBMERGED))
        )
        known = steps.get(place)
        steps[place] = step if known is None else replace(known, submerged=known.submerged or step.submerged)
    return list(steps.values())


class ClockScreening(NamedTuple):
    """Profiles and fixes that remain after the clock steps of a record.

    Attributes
    ----------
    profile : (n,) int array
        Profile numbers of the rows, 0 for the profiles left out.
    fixes : Fixes
        GPS fixes, without those around a step at the surface.
    left_out : dict of int to str
        Reasons by number of the profile left out.
    remarks : list of str
        Remarks on the steps that caused fixes to be left out, one line each.
    """

    profile: npt.NDArray[np.int64]
    fixes: Fixes
    left_out: dict[int, str]
    remarks: list[str]


def screen_clock_steps(
    steps: Iterable[ClockStep], profile: npt.NDArray[np.int64], time: TimeArray, fixes: Fixes
) -> ClockScreening:
    """Remove the profiles that are incomplete because of a clock step, and the fixes with times by two clocks.

    Parameters
    ----------
    steps : iterable of ClockStep
        Steps found in the record.
    profile : (n,) int array
        Number of the profile of each row, 0 outside any.
    time : (n,) array
        Times of the rows, increasing.
    fixes : Fixes
        GPS fixes.
    """
    profile, left_out, remarks = profile.copy(), {}, []
    for step in steps:
        number = _profile_at(step, profile)
        if number:
            left_out[number] = f"{step.describe()}: part of the profile is lost"
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
    return ClockScreening(profile, fixes, left_out, remarks)


def _profile_at(step: ClockStep, profile: npt.NDArray[np.int64]) -> int:
    """Number of the profile that lost rows because of a step; 0 if there is none."""
    if 0 < step.place < len(profile) and profile[step.place] and profile[step.place] == profile[step.place - 1]:
        return int(profile[step.place])
    if not step.submerged:
        return 0
    later = profile[step.place :]
    return int(later[np.argmax(later > 0)]) if len(later) else 0


def _surfacing(place: int, profile: npt.NDArray[np.int64], time: TimeArray) -> tuple[np.datetime64, np.datetime64]:
    """Time of the last profile sample before a row, and of the first one from it on."""
    before, after = np.flatnonzero(profile[:place]), np.flatnonzero(profile[place:])
    return (
        time[before[-1]] if len(before) else EARLIEST,
        time[place + after[0]] if len(after) else LATEST,
    )


def times_by_two_clocks(time: TimeArray) -> list[tuple[np.datetime64, np.datetime64]]:
    """Find the intervals of time that occur twice in a record: before its clock was set back, and again after.

    Pieces of a record that are merely in another order do not overlap in time, and nothing is found.

    Parameters
    ----------
    time : (n,) array
        Times in the order of the record; NaT is skipped.

    Returns
    -------
    list of (numpy.datetime64, numpy.datetime64)
        Begin and end of each interval.
    """
    known = time[~np.isnat(time) & ~in_excursion(time, brief=True)]
    if not len(known):
        return []
    edges = [0, *(np.flatnonzero((known[:-1] - known[1:]) / SECOND > CLOCK_SET_BACK) + 1).tolist(), len(known)]
    pieces = sorted((known[start:stop].min(), known[start:stop].max()) for start, stop in pairwise(edges))
    found: list[tuple[np.datetime64, np.datetime64]] = []
    for (_, reached), (begin, end) in zip(_reached(pieces), pieces[1:], strict=False):
        if begin < reached:
            found.append((begin, min(reached, end)))
    return found


def _reached(
    pieces: Sequence[tuple[np.datetime64, np.datetime64]],
) -> Iterator[tuple[np.datetime64, np.datetime64]]:
    """Iterate over the extent (begin, end) of all pieces up to and including each one."""
    return accumulate(pieces, lambda before, piece: (before[0], max(before[1], piece[1])))


def in_time_order(columns: Columns) -> tuple[Columns, int, list[ClockStep]]:
    """Keep the samples later than all preceding ones; also return the number of the others and the clock steps."""
    time = columns["time"].astype("datetime64[ns]")
    keep = increasing(time)
    steps = find_clock_steps(time, keep, columns["depth"].astype(np.float64))
    return {name: values[keep] for name, values in columns.items()}, int(np.count_nonzero(~keep)), steps
