"""Positions at the surface of a Dataset of any source: those of the GPS receiver, or those of the samples there."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.depth_screening import impossible_depths
from gliderhpc.observations.checks.validation import check_fixes
from gliderhpc.observations.fixes import AS_MINUTES, SurfaceFixes, agree_as_minutes, rounding_error, screen_fixes
from gliderhpc.observations.navigation.columns import NavigationColumns
from gliderhpc.observations.profiles import SURFACE_MARGIN, IntArray, floating_level
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.surface_intervals import MAX_GPS_DEPTH
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR, SECOND, plausible_times

Mask = npt.NDArray[np.bool_]

RECEIVER_ERROR = 5.0
"""Standard deviation of a GPS fix in each of north and east (m)."""

POSITION_ERROR = 50.0
"""Standard deviation, in each of north and east, of a surface position in a file without GPS variables (m)."""

SURFACE = 2.0
"""Positions above this depth (m) are taken as positions at the surface, unless the record never rises above it."""

SAME_SAMPLE = np.timedelta64(60, "s")
"""Maximum difference between the times of a fix and of the sample in the same row whose depth is that of the fix."""


@dataclass(frozen=True, eq=False)
class SurfacePositions:
    """Positions at the surface.

    Attributes
    ----------
    fixes : SurfaceFixes
        The positions.
    error : float
        Their standard deviation in each of north and east (m).
    remarks : list of str
        Remarks for the user.
    """

    fixes: SurfaceFixes
    error: float
    remarks: list[str]


def find_positions(columns: NavigationColumns) -> SurfacePositions:
    """GPS fixes, or positions at the surface if there are none."""
    remarks: list[str] = []
    if columns.find("fix_latitude") and columns.find("fix_longitude"):
        found = _of_receiver(columns, remarks)
        if found is not None:
            return found
    if not (columns.find("latitude") and columns.find("longitude")):
        return SurfacePositions(
            SurfaceFixes.none(), RECEIVER_ERROR, [*remarks, "the GPS variables contain no position"]
        )
    time, latitude, longitude = columns.times(columns.find("time")), *_pair(columns, "")
    known = np.isfinite(latitude + longitude) if len(latitude) == len(longitude) == len(time) else np.zeros(0, bool)
    if not known.any():
        remarks += ["no sample has a position", *_out_of_range(columns, "")]
        return SurfacePositions(SurfaceFixes.none(), RECEIVER_ERROR, remarks)
    surface, depth, offset = _surface(columns, time, latitude[known], longitude[known])
    with np.errstate(invalid="ignore"):
        surfaced = known & (depth < surface)
    remarks += [
        *offset,
        f"no variables of the GPS receiver: positions above {surface:.3g} m are taken as fixes, with an error of "
        f"{POSITION_ERROR:g} m",
    ]
    return _with_rounding(SurfacePositions(screen_fixes(time, latitude, longitude, surfaced), POSITION_ERROR, remarks))


def _with_rounding(found: SurfacePositions) -> SurfacePositions:
    """Return positions with the error of the grid to which they were rounded, if it is larger, and a remark on it."""
    error, remark = rounding_error(found.fixes.latitude, found.fixes.longitude)
    if error <= found.error:
        return found
    return SurfacePositions(found.fixes, error, [*found.remarks, remark])


def _of_receiver(columns: NavigationColumns, remarks: list[str]) -> SurfacePositions | None:
    """Fixes of the GPS variables; None if these contain no position. Remarks on those out of range are added."""
    latitude, longitude = _pair(columns, "fix_")
    name = columns.find("fix_time") or columns.find("time")
    time = columns.times(name)
    if not len(time) == len(latitude) == len(longitude):
        return None
    remarks += _out_of_range(columns, "fix_")
    known = np.isfinite(latitude + longitude)
    if not known.any():
        return None
    if not plausible_times(time[known]).any():
        remarks.append(f"no position of the GPS receiver has a time ({name}) between {FIRST_YEAR} and {LAST_YEAR}")
    submerged = _under_water(columns, time, latitude, longitude)
    if submerged.any():
        remarks.append(
            f"{columns.find('fix_latitude')} has {np.count_nonzero(submerged)} positions under water, which no GPS "
            f"receiver gives: only those at the surface are used, with an error of {POSITION_ERROR:g} m"
        )
    error = POSITION_ERROR if submerged.any() else RECEIVER_ERROR
    fixes = screen_fixes(time, latitude, longitude, known & ~submerged)
    if not len(fixes.time) and agree_as_minutes(time, latitude, longitude, known & ~submerged):
        remarks.append(AS_MINUTES)
    return _with_rounding(SurfacePositions(fixes, error, remarks))


def _out_of_range(columns: NavigationColumns, kind: str) -> list[str]:
    """Remarks on the positions of the GPS variables (`fix_`), or of the samples, that are not on the globe."""
    names = {f"fix_{axis}": columns.find(f"{kind}{axis}") for axis in ("latitude", "longitude")}
    latitude, longitude = (columns.converted(name, "degree") for name in names.values())
    _, texts = check_fixes(latitude, longitude, np.zeros(len(latitude), dtype=bool))
    return [
        text.replace(ours, theirs) for text, (ours, theirs) in itertools.product(texts, names.items()) if ours in text
    ]


def _pair(columns: NavigationColumns, kind: str) -> tuple[FloatArray, FloatArray]:
    return columns.quantity(f"{kind}latitude"), columns.quantity(f"{kind}longitude")


def _under_water(columns: NavigationColumns, time: TimeArray, latitude: FloatArray, longitude: FloatArray) -> Mask:
    """Mask of the positions in rows of samples under water; empty unless some lie deeper than GPS can be received."""
    known = np.isfinite(latitude + longitude)
    nowhere = np.zeros(len(time), dtype=bool)
    if not (columns.lies_along_samples("fix_latitude") and columns.lies_along_samples("fix_longitude")):
        return nowhere
    samples = columns.times(columns.find("time"))
    own_row = known & (np.abs(time - samples) < SAME_SAMPLE)
    if not own_row.any():
        return nowhere
    surface, depth, _ = _surface(columns, samples, latitude[known], longitude[known])
    with np.errstate(invalid="ignore"):
        if not (own_row & (depth > MAX_GPS_DEPTH)).any():
            return nowhere
        return np.asarray(own_row & (depth >= surface))


def _surface(
    columns: NavigationColumns, time: TimeArray, latitude: FloatArray, longitude: FloatArray
) -> tuple[float, FloatArray, list[str]]:
    """Depth (m) above which samples are at the surface, their screened depth, and a remark on an offset."""
    depth = columns.depth(SurfaceFixes(time, latitude, longitude, time[:0], ()))
    depth[impossible_rows(time, depth)] = np.nan
    order = time_order(time)
    order = order[np.isfinite(depth[order])]
    if not len(order) or depth[order].min() <= SURFACE:
        return SURFACE, depth, []
    level = floating_level((time[order] - time[order[0]]) / SECOND, depth[order])
    least = float(depth[order].min())
    lacking = f"the depth is nowhere less than {least:.3g} m: the sensor has an offset, or the surface is missing"
    return level + SURFACE_MARGIN, depth, [lacking]


NEIGHBOURS, MIN_DOUBTS, DOUBTED = 5, 2, 0.25
"""Profiles on either side that are considered, and the number and share of doubted ones from which all are."""


def with_neighbours(doubts: Mapping[int, str], numbers: Sequence[int]) -> dict[int, str]:
    """Extend the warnings about fixes to the profiles among many doubtful ones.

    With a wrong clock, some fixes lie under water by their times, and others at another surfacing than their own, where
    they look right.

    Parameters
    ----------
    doubts : mapping of int to str
        Reasons why the fixes around a profile are not used, by number (`submerged_fixes`).
    numbers : sequence of int
        Numbers of all profiles, in time order.
    """
    found = dict(doubts)
    for place, number in enumerate(numbers):
        near = numbers[max(0, place - NEIGHBOURS) : place + NEIGHBOURS + 1]
        count = sum(other in doubts for other in near)
        if number not in doubts and count >= max(MIN_DOUBTS, DOUBTED * len(near)):
            found[number] = (
                f"fixes of {count} of the profiles before and after are under water: the clocks of fixes and samples "
                "disagree, so fixes are not used"
            )
    return found


def impossible_rows(time: TimeArray, depth: FloatArray) -> Mask:
    """Mask of the impossible depths among samples in any order (`impossible_depths`)."""
    found, order = np.zeros(len(time), dtype=bool), time_order(time)
    if len(order):
        found[order] = impossible_depths((time[order] - time[order[0]]) / SECOND, depth[order])
    return found


def time_order(time: TimeArray) -> IntArray:
    """Rows with a plausible time in the order of their times, each time once."""
    order = np.argsort(time, kind="stable")
    order = order[plausible_times(time[order])]
    _, first = np.unique(time[order], return_index=True)
    return np.asarray(order[first])


def first_known(time: TimeArray, values: FloatArray, at: TimeArray) -> FloatArray:
    """Values at some times ``(m,)``, each the first known one among the rows of that time; NaN where there is none.

    Files in which the rows of several sensors were put one after the other have several rows of one time, each with a
    part of the values.

    Parameters
    ----------
    time, values : (n,) arrays
        Times and values of all rows.
    at : (m,) array
        Increasing times among those of the rows.
    """
    known = np.flatnonzero(np.isfinite(values))
    place = np.minimum(np.searchsorted(at, time[known]), len(at) - 1)
    known, place = known[at[place] == time[known]], place[at[place] == time[known]]
    found = np.full(len(at), np.nan)
    found[place[::-1]] = values[known[::-1]]
    return found
