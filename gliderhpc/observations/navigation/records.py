"""Records from which a depth-averaged current is computed: time, depth, pitch, heading and positions at the surface.

Files of any source (the observation format, OG1, pyglider, data centres) are read by the names and standard names of
their variables. Neither ballast nor battery is needed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.depth_screening import noise_window
from gliderhpc.observations.checks.heading_values import frozen_profiles
from gliderhpc.observations.checks.validation import (
    check_profile_numbers,
    describe_time,
    describe_unnumbered,
    profile_spans,
)
from gliderhpc.observations.dataset import open_stored
from gliderhpc.observations.dive_phases import dive_notes
from gliderhpc.observations.fixes import SurfaceFixes, describe_fixes, pair_fault, rounding_error, screen_fixes
from gliderhpc.observations.navigation.checks import check_heading, check_pitch, describe_short_dives
from gliderhpc.observations.navigation.clock import ClockDoubt, doubted_by_clock, find_clock_doubts
from gliderhpc.observations.navigation.columns import NavigationColumns, join_velocity, read_velocity
from gliderhpc.observations.navigation.fixes import (
    SURFACE,
    find_positions,
    first_known,
    impossible_rows,
    time_order,
    with_neighbours,
)
from gliderhpc.observations.profiles import IntArray, detect_profiles
from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord, TimeArray
from gliderhpc.observations.surface_intervals import MAX_FIX_AGE, submerged_fixes, time_spans
from gliderhpc.observations.times import SECOND
from gliderhpc.wording import counted

RECORD_BREAK = 86_400.0
"""Longest pause of the record within a profile (s); a longer one ends the profile."""

MIN_SAMPLES = 10
"""Minimum number of samples of depth, of pitch and of heading in a usable profile."""

_DEPTH_ALLOWANCE, _MAX_DEPTH_RATE, _MIN_DIFFERENT = 20.0, 2.0, 20
"""Largest difference of depth (m) between two files of one glider at one time, its growth with the time to the nearest
sample (m/s), and number of larger differences from which files are of two gliders."""


@dataclass(frozen=True, eq=False)
class Navigation:
    """Records of a mission that are needed for a current, sorted by time.

    Attributes
    ----------
    source : str
        Name of the file in messages.
    vehicle : str
        Text of the file's attributes that describe the glider, in lower case.
    time : (n,) array
        Times of the samples (UTC, ns).
    depth, pitch, heading, roll : (n,) arrays
        Depth (m) and attitude (rad), NaN where missing.
    profile : (n,) int array
        Number of the profile, 0 outside any usable one.
    dives : (n,) int array
        The same of every profile, usable or not.
    fixes : SurfaceFixes
        Positions at the surface.
    fix_error : float
        Their standard deviation in each of north and east (m).
    remarks : tuple of str
        Remarks for the user on the reading of the file.
    declination : float
        Declination that is added to the heading (degree).
    impossible : (n,) bool array
        Samples whose depth is left out because no glider can have reached it.
    without_fixes : mapping of int to str
        Reasons why none of the fixes around a profile can be used, by number.
    velocity : (n, 3) array or None
        Measured velocity relative to the water in the body frame (m/s), NaN where missing; None without it.
    clock_doubts : tuple of ClockDoubt
        Intervals in which the samples have times by two clocks.
    """

    source: str
    vehicle: str
    time: TimeArray
    depth: FloatArray
    pitch: FloatArray
    heading: FloatArray
    roll: FloatArray
    profile: IntArray
    dives: IntArray
    fixes: SurfaceFixes
    fix_error: float
    remarks: tuple[str, ...]
    declination: float
    impossible: npt.NDArray[np.bool_]
    without_fixes: Mapping[int, str]
    velocity: FloatArray | None = None
    clock_doubts: tuple[ClockDoubt, ...] = ()

    @property
    def numbers(self) -> list[int]:
        """Numbers of the profiles, in time order."""
        found, first = np.unique(self.profile[self.profile > 0], return_index=True)
        return [int(number) for number in found[np.argsort(first, kind="stable")]]

    @cached_property
    def faults(self) -> dict[int, str]:
        """Reasons why profiles cannot be used, by number: times by two clocks, or a compass that failed."""
        frozen = frozen_profiles(_seconds(self.time), self.heading, self.pitch, self.roll, self.profile)
        return frozen | doubted_by_clock(self.clock_doubts, self.time, self.profile)

    def has_unused_dive(self, first: np.datetime64, last: np.datetime64) -> bool:
        """Return whether there is a dive between two times that is no usable profile."""
        inside = (self.time > first) & (self.time < last)
        return bool(((self.dives > 0) & (self.profile == 0))[inside].any())

    def longest_pause(self, first: np.datetime64, last: np.datetime64) -> float:
        """Return the longest time without a depth between two times, s."""
        known = self.time[np.isfinite(self.depth) & (self.time > first) & (self.time < last)]
        moments = np.concatenate([[first], known, [last]])
        return float(np.diff(moments).max() / SECOND)

    def record(self, number: int) -> ProfileRecord:
        """Return one profile's record; the unknown controls of the glider are set to zero."""
        rows = np.flatnonzero(self.profile == number)
        span = slice(int(rows[0]), int(rows[-1]) + 1)
        time = self.time[span]
        still = np.zeros(len(time))
        seconds = (time - time[0]) / SECOND
        before, after, notes = self._fixes(number, span)
        return ProfileRecord(
            number=number, epoch=time[0], time=seconds,
            roll=np.nan_to_num(self.roll[span]), pitch=self.pitch[span], heading=self.heading[span],
            depth=self.depth[span], battery_position=still, battery_rotation=still, ballast_volume=still, rudder=still,
            entry_fix=before[-1] if before else None, exit_fix=after[0] if after else None,
            surface_fixes_before=before, surface_fixes_after=after,
            notes=(
                *describe_fixes(before, after, notes, MAX_FIX_AGE),
                *(self.fixes.notes_between_dives(time, self.depth[span]) if number not in self.without_fixes else []),
                *_describe_depth(seconds, self.depth[span], self.impossible[span]),
                *_describe_gap(seconds, self.depth[span], self.pitch[span] + self.heading[span]),
                *dive_notes(seconds, self.depth[span], self.pitch[span] + self.heading[span]),
            ),
            velocity=None if self.velocity is None else self.velocity[span],
        )  # fmt: skip

    def _fixes(self, number: int, span: slice) -> tuple[tuple[Fix, ...], tuple[Fix, ...], tuple[str, ...]]:
        """Fixes of the surface intervals before and after a profile, and the reasons why others are unused."""
        doubt = self.without_fixes.get(number)
        if doubt is not None:
            return (), (), (doubt,)
        others = np.flatnonzero((self.dives > 0) & (self.dives != number))
        earlier, later = others[others < span.start], others[others >= span.stop]
        begin = self.time[earlier[-1]] if len(earlier) else self.time[0] - np.timedelta64(1, "D")
        end = self.time[later[0]] if len(later) else self.time[-1] + np.timedelta64(1, "D")
        sides = ((begin, self.time[span.start]), (self.time[span.stop - 1], end))
        before, after = (self.fixes.between(*side) for side in sides)
        before = _of_same_surfacing(before[::-1], self.time[span.start])[::-1]
        after = _of_same_surfacing(after, self.time[span.stop - 1])
        reasons = [reason for side in sides for reason in self.fixes.reasons_between(*side)]
        if not (before and after):
            reasons += self.fixes.notes_inside(self.time[span.start], self.time[span.stop - 1])
        fault = pair_fault(before[-1], after[0]) if before and after else None
        if fault is None:
            return before, after, tuple(dict.fromkeys(reasons))
        return (), (), tuple(dict.fromkeys([fault, *reasons]))


def _of_same_surfacing(fixes: Sequence[Fix], moment: np.datetime64) -> tuple[Fix, ...]:
    """Return the fixes, given from the nearest one on, up to the first pause that a missing dive would leave."""
    kept: list[Fix] = []
    for fix in fixes:
        if abs(fix.time - moment) > MAX_FIX_AGE:
            break
        kept.append(fix)
        moment = fix.time
    return tuple(kept)


def open_part(path: Path, declination: float | None = None) -> Navigation:
    """Read the navigation of a netCDF file or Zarr folder, as `read_part` does.

    Raises
    ------
    InputError
        The file cannot be read, or lacks a quantity needed for a current; the message names it.
    """
    with open_stored(path) as dataset:
        return read_part(dataset, str(path), declination)


def read_navigation(dataset: xr.Dataset, source: str = "dataset", declination: float | None = None) -> Navigation:
    """Read the navigation of a Dataset, as `read_part` does, and refuse one without a dive.

    Raises
    ------
    InputError
        As for `read_part`, or there is no dive.
    """
    return with_dives(read_part(dataset, source, declination))


def with_dives(navigation: Navigation) -> Navigation:
    """Return the navigation; raise `InputError` if it has no dive."""
    if not navigation.profile.any():
        raise InputError(
            f"{navigation.source}: no dive below 10 m with enough samples of depth, pitch and heading, so there is no "
            f"current to estimate{''.join(f'; {remark}' for remark in navigation.remarks)}"
        )
    return navigation


def read_part(dataset: xr.Dataset, source: str, declination: float | None = None) -> Navigation:
    """Read the navigation of a Dataset, by the names, standard names and units of its variables.

    Without a dive, as in the file of a surfacing, its fixes may still be those of other files' dives.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset with decoded or undecoded times.
    source : str
        Its name in messages.
    declination : float, optional
        Declination to add to a magnetic heading, instead of the one in the file (degree).

    Raises
    ------
    InputError
        The Dataset lacks time, depth or pressure, pitch, heading or positions, has too few samples, or a quantity is in
        another unit than declared, or in one that cannot be converted.
    """
    columns = NavigationColumns(dataset, source)
    columns.check_complete()
    flagged = columns.reject_flagged()
    time = columns.times(columns.find("time"))
    order = time_order(time)
    if len(order) < MIN_SAMPLES:
        raise InputError(
            f"{source}: {counted(len(order), 'sample has', 'samples have')} a time between 2000 and 2099, which is "
            f"too few for a current{columns.describe_clock()}"
        )
    positions = find_positions(columns)
    depth = columns.depth(positions.fixes)
    doubts, clock_remarks = find_clock_doubts(time, depth)
    fixes = _without_doubted(positions.fixes, doubts)
    rows, time = time, time[order]
    depth = first_known(rows, depth, time)
    impossible = impossible_rows(time, depth)
    added, remarks = columns.declination(declination)
    remarks = [*flagged, *positions.remarks, *remarks, *columns.undeclared(), *columns.out_of_range(), *clock_remarks]
    measured, pitch = (first_known(rows, columns.quantity(name), time) for name in ("heading", "pitch"))
    pitch, heading, roll = np.radians(pitch), np.radians(measured + added), np.zeros(len(order))
    if columns.find("roll"):
        roll = np.radians(first_known(rows, columns.quantity("roll"), time))
    check_pitch(source, pitch, depth, SURFACE)
    remarks += columns.compare_with_pressure(depth, order)
    if impossible.any():
        remarks.append(_describe_dropouts(time, depth, impossible))
        depth = np.where(impossible, np.nan, depth)
    if len(order) < dataset.sizes[columns.dimension]:
        lost = counted(dataset.sizes[columns.dimension] - len(order), "sample")
        remarks.append(f"left out: {lost} without a valid time, or with the time of another sample")
    dives = _profiles(columns, order, time, depth)
    profile = _usable(dives, depth, pitch, heading)
    remarks += [*describe_short_dives(time, depth, dives, profile, MIN_SAMPLES)]
    if _has_numbers(columns):
        remarks += filter(None, [describe_unnumbered(columns.quantity("profile")[order], time, depth)])
    remarks += check_heading(source, measured, profile, columns.find("heading"))
    velocity, unusable = read_velocity(columns, order)
    remarks += unusable
    return Navigation(
        source, _vehicle(dataset), time, depth, pitch, heading, roll, profile, dives, fixes, positions.error,
        tuple(remarks), added, impossible, _submerged(time, depth, profile, fixes), velocity, tuple(doubts),
    )  # fmt: skip


def merge_navigation(parts: Sequence[Navigation]) -> Navigation:
    """Join the navigation of several files of one glider, such as one file per dive.

    Raises
    ------
    InputError
        There are no files, or two of them have different depths at the same time.
    """
    if not parts:
        raise InputError("no file to read")
    if len(parts) == 1:
        return parts[0]
    order = np.unique(np.concatenate([part.time for part in parts]), return_index=True)[1]
    _check_one_glider(parts)
    time, depth, pitch, heading, roll, impossible = (
        np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("time", "depth", "pitch", "heading", "roll", "impossible")
    )
    at, latitude, longitude = (
        np.concatenate([getattr(part.fixes, name) for part in parts]) for name in ("time", "latitude", "longitude")
    )
    fixes = screen_fixes(at, latitude, longitude, np.ones(len(at), dtype=bool))
    # A file of one dive has too few positions to show that they are rounded.
    rounded, coarse = rounding_error(fixes.latitude, fixes.longitude)
    dives = detect_profiles(_seconds(time), depth, record_break=RECORD_BREAK)
    profile = _usable(dives, depth, pitch, heading)
    source = f"{parts[0].source} and {len(parts) - 1} more"
    measured = np.concatenate([np.degrees(part.heading) - part.declination for part in parts])[order]
    check_heading(source, measured, profile, "heading")
    return Navigation(
        source, parts[0].vehicle, time, depth, pitch, heading, roll, profile, dives, fixes,
        max(rounded, *(part.fix_error for part in parts)),
        tuple(dict.fromkeys([*(remark for part in parts for remark in part.remarks), *([coarse] if coarse else [])])),
        float(np.median([part.declination for part in parts])), impossible,
        _submerged(time, depth, profile, fixes),
        join_velocity([part.velocity for part in parts], [len(part.time) for part in parts], order),
        tuple(doubt for part in parts for doubt in part.clock_doubts),
    )  # fmt: skip


def _check_one_glider(parts: Sequence[Navigation]) -> None:
    """Refuse files that overlap in time and have different depths there: those of two gliders."""
    ordered = sorted((part for part in parts if len(part.time)), key=lambda part: part.time[0])
    for place, first in enumerate(ordered):
        for second in ordered[place + 1 :]:
            if second.time[0] > first.time[-1]:
                break
            if _differ(first, second):
                raise InputError(
                    f"{first.source} and {second.source}: overlap in time, and their depths differ; give the files of "
                    "one glider at a time"
                )


def _differ(first: Navigation, second: Navigation) -> bool:
    """Return whether most depths of two files differ by more than a glider's motion between their samples allows."""
    (one, depth), (other, known) = (
        (part.time[finite].astype(np.int64) * 1e-9, part.depth[finite])
        for part in (first, second)
        for finite in [np.isfinite(part.depth)]
    )
    if not len(other):
        return False
    both = (one >= other[0]) & (one <= other[-1])
    at, depth = one[both], depth[both]
    after = np.clip(np.searchsorted(other, at), 1, len(other) - 1) if len(other) > 1 else np.zeros(len(at), dtype=int)
    nearest = np.minimum(np.abs(other[after] - at), np.abs(at - other[np.maximum(after - 1, 0)]))
    far = np.abs(np.interp(at, other, known) - depth) > _DEPTH_ALLOWANCE + _MAX_DEPTH_RATE * nearest
    return bool(np.count_nonzero(far) >= _MIN_DIFFERENT and far.mean() > 0.5)


def _submerged(time: TimeArray, depth: FloatArray, profile: IntArray, fixes: SurfaceFixes) -> dict[int, str]:
    """Profiles with a fix under water, and the reason why their fixes are not used."""
    places, _ = profile_spans(profile)
    return with_neighbours(submerged_fixes(time, depth, time_spans(time, places), {}, fixes), list(places))


def _describe_dropouts(time: TimeArray, depth: FloatArray, impossible: npt.NDArray[np.bool_]) -> str:
    """Remark on the depths of a file that are left out."""
    first = int(np.flatnonzero(impossible)[0])
    reached = "that no glider can have reached from those before and after"
    left_out = counted(int(np.count_nonzero(impossible)), f"depth {reached} it is", f"depths {reached} them are")
    return f"{left_out} left out, the first, {depth[first]:.4g} m, at {describe_time(time[first])}"


def _without_doubted(fixes: SurfaceFixes, doubts: Sequence[ClockDoubt]) -> SurfaceFixes:
    """Leave out the fixes in intervals with times by two clocks."""
    for doubt in doubts:
        fixes = fixes.without(doubt.begin, doubt.end, doubt.step)
    return fixes


def _describe_depth(seconds: FloatArray, depth: FloatArray, impossible: npt.NDArray[np.bool_]) -> Iterator[str]:
    """Notes on the depths of a profile that are left out or smoothed."""
    count = np.count_nonzero(impossible)
    if count:
        yield f"{count} impossible {'depth is' if count == 1 else 'depths are'} left out"
    window = noise_window(seconds, depth)
    if window > 0.0:
        yield f"the depth is noisy and is smoothed over {window:.0f} s"


NOTED_GAP = 900.0
"""Longest gap (s) between samples of a profile without a note; a glider moves by 200 to 300 m in this time."""


def _describe_gap(seconds: FloatArray, *measured: FloatArray) -> Iterator[str]:
    """Note on the longest gap of any measurement in a profile, if it is longer than `NOTED_GAP`."""
    gaps = [_longest_gap(seconds[np.isfinite(values)]) for values in measured]
    begin, lasts = max(gaps, key=lambda gap: gap[1])
    if lasts > NOTED_GAP:
        yield (
            f"no depth or attitude for {lasts / 60.0:.0f} minutes, from {begin:.0f} s on: the displacement over this "
            "gap is only a guess"
        )


def _longest_gap(seconds: FloatArray) -> tuple[float, float]:
    """Begin and duration (s) of the longest gap between some times."""
    if len(seconds) < 2:
        return 0.0, 0.0
    gap = int(np.argmax(np.diff(seconds)))
    return float(seconds[gap]), float(seconds[gap + 1] - seconds[gap])


def _profiles(columns: NavigationColumns, order: IntArray, time: TimeArray, depth: FloatArray) -> IntArray:
    """Number of the profile of every sample: the file's own in the observation format, else detected from depth."""
    if _has_numbers(columns):
        numbers = np.nan_to_num(columns.quantity("profile"))
        check_profile_numbers(numbers, columns.source)
        return numbers[order].astype(np.int64)
    return detect_profiles(_seconds(time), depth, record_break=RECORD_BREAK)


def _has_numbers(columns: NavigationColumns) -> bool:
    """Return whether the profiles are numbered: whether the columns are those of the observation format."""
    return bool(columns.find("profile")) and columns.find("fix_time") == "fix_time"


def _usable(found: IntArray, depth: FloatArray, pitch: FloatArray, heading: FloatArray) -> IntArray:
    """Profile number of every sample, 0 for profiles with too few samples of depth, pitch or heading."""
    counts = [
        np.bincount(found[np.isfinite(values) & (found > 0)], minlength=int(found.max(initial=0)) + 1)
        for values in (depth, pitch, heading)
    ]
    return np.where(np.min(counts, axis=0)[found] >= MIN_SAMPLES, found, 0)


def _vehicle(dataset: xr.Dataset) -> str:
    """Text of a file's attributes and variables that describe its glider, in lower case."""
    words = ("platform", "model", "vehicle", "glider", "instrument", "title", "source", "manufacturer", "name")
    texts = [str(value) for key, value in dataset.attrs.items() if any(word in str(key).lower() for word in words)]
    named = [name for name in ("PLATFORM_MODEL", "PLATFORM_TYPE", "platform_model") if name in dataset.variables]
    texts += [str(dataset[name].values) for name in named if dataset[name].ndim == 0]
    return " ".join(texts).lower()


def _seconds(time: TimeArray) -> FloatArray:
    return np.asarray((time - time[0]) / SECOND, dtype=np.float64)
