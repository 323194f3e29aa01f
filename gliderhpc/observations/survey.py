"""Survey of an observation file (places of its profiles, faults, usable fixes), and its variables as arrays."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.heading_values import check_circle
from gliderhpc.observations.checks.profile_checks import (
    check_extents,
    check_heading_unit,
    check_pace,
    check_variable_of_profiles,
)
from gliderhpc.observations.checks.sign_checks import GLIDE, check_signs, sense_fault
from gliderhpc.observations.checks.validation import (
    Span,
    check_clock,
    check_fixes,
    check_profile_numbers,
    check_variables,
    clock_set_back,
    describe_unnumbered,
    outside_range,
    profile_spans,
)
from gliderhpc.observations.files.columns import describe_fills, usual_fills
from gliderhpc.observations.files.valid_limits import declared_limits, describe_outside, outside
from gliderhpc.observations.fixes import SurfaceFixes, decimal_degrees, rounding_error, screen_fixes
from gliderhpc.observations.format import PROFILE_VARIABLES, VARIABLES
from gliderhpc.observations.navigation.checks import check_depth_unit
from gliderhpc.observations.profile_numbers import as_ranges
from gliderhpc.observations.profiles import MIN_DEPTH, IntArray, detect_profiles
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import (
    FIRST_YEAR,
    LAST_YEAR,
    SECOND,
    DecodedTimes,
    decode_texts,
    decode_times,
    texts_in,
)
from gliderhpc.wording import counted


class StoredVariables:
    """Variables of an open file, read whole or in slices.

    Times that have been read as a whole stay in memory, since decoding slices takes about a millisecond each. So do the
    other variables of a file in memory, since slicing a variable takes a hundred times as long as slicing its values.

    Parameters
    ----------
    dataset : xarray.Dataset
        The open file, with undecoded times.
    path : Path
        Its path in messages.
    in_memory : bool
        Whether the values of the file are in memory.
    """

    def __init__(self, dataset: xr.Dataset, path: Path, *, in_memory: bool = False) -> None:
        self.dataset = dataset
        self.path = path
        self._in_memory = in_memory
        self._whole: dict[str, DecodedTimes] = {}
        self._whole_numbers: dict[str, FloatArray] = {}
        self._untimed: IntArray = np.zeros(0, dtype=np.int64)

    def __contains__(self, name: str) -> bool:
        return name in self.dataset.variables

    def leave_out(self, rows: IntArray) -> None:
        """Leave out samples without a usable time: their values are missing, and their times interpolated.

        The times increase, and the numbers of the samples remain.
        """
        if np.array_equal(rows, self._untimed):
            return
        self._untimed = rows
        self._whole_numbers.clear()
        if "time" in self._whole:
            self._whole["time"] = self._with_times(self._whole["time"], 0)

    def size(self, dimension: str) -> int:
        """Length of a dimension, 0 if the file does not have it."""
        return int(self.dataset.sizes.get(dimension, 0))

    def numbers(self, name: str, start: int, stop: int) -> FloatArray:
        """Read a slice of one variable as doubles; zeros if the variable is absent.

        Values outside the limits that the file declares, and usual fill values of depth and ballast volume, are missing
        (NaN).
        """
        if name not in self:
            return np.zeros(stop - start)
        if not self._in_memory:
            return self._numbers(name, start, stop)
        if name not in self._whole_numbers:
            self._whole_numbers[name] = self._numbers(name, 0, self.dataset.variables[name].size)
        return self._whole_numbers[name][start:stop]

    def _numbers(self, name: str, start: int, stop: int) -> FloatArray:
        values = np.asarray(self._read(name, start, stop), dtype=np.float64)
        lost = self._lost(name, values) if self._may_lose(name) else np.zeros(len(values), dtype=bool)
        if name != "profile" and "time" in self.dataset.variables[name].dims:
            lost[self._untimed_within(start, stop)] = True
        return np.where(lost, np.nan, values) if lost.any() else values

    def _untimed_within(self, start: int, stop: int) -> IntArray:
        first, last = np.searchsorted(self._untimed, (start, stop))
        return np.asarray(self._untimed[first:last] - start)

    def loses_values(self, name: str) -> bool:
        """Return whether values of a variable are missing although they are in the file."""
        return self._may_lose(name) and bool(self._lost(name, self._whole_variable(name)).any())

    def _may_lose(self, name: str) -> bool:
        return name in _FILLED or declared_limits(self.dataset.variables[name]) is not None

    def _lost(self, name: str, values: FloatArray) -> npt.NDArray[np.bool_]:
        return outside(values, declared_limits(self.dataset.variables[name])) | _plausible_fills(name, values)

    def _whole_variable(self, name: str) -> FloatArray:
        return np.asarray(self._read(name, 0, self.dataset.variables[name].size), dtype=np.float64)

    def describe_missing(self) -> list[str]:
        """Remarks on the values outside the limits that the file declares, and on undeclared fill values.

        Raises
        ------
        InputError
            Most values of a required variable are outside.
        """
        remarks = []
        for name in (each for each in VARIABLES if each in self and self._may_lose(each)):
            values, limits = self._whole_variable(name), declared_limits(self.dataset.variables[name])
            refuse_in = str(self.path) if VARIABLES[name].required else ""
            what = "sample" if VARIABLES[name].dimension == "time" else "fix"
            remarks.append(describe_outside(name, values, limits, refuse_in=refuse_in, what=what))
            fills = _plausible_fills(name, values) & ~outside(values, limits)
            remarks += [describe_fills(name, values, fills)] if fills.any() else []
        remarks += [self._describe_times(name) for name in ("time", "fix_time") if name in self]
        return [remark for remark in remarks if remark]

    def _describe_times(self, name: str) -> str:
        """Remark on the times outside the limits that the file declares; empty without any."""
        values, limits = self._read(name, 0, self.dataset[name].size), declared_limits(self.dataset.variables[name])
        if limits is None or values.dtype.kind not in "fiu":
            return ""
        refuse_in, what = (str(self.path), "sample") if name == "time" else ("", "fix")
        return describe_outside(name, values.astype(np.float64), limits, refuse_in=refuse_in, what=what)

    def times(self, name: str, start: int, stop: int) -> DecodedTimes:
        """Read a slice of one of the time variables.

        Times outside the limits that the file declares are missing; those of samples that are left out (`leave_out`)
        are interpolated.
        """
        if name in self._whole:
            return self._whole[name].part(start, stop)
        attributes, where = self.dataset[name].attrs, f"{self.path}: {name}"
        units, calendar = (str(attributes.get(key, "")) for key in ("units", "calendar"))
        values = self._read(name, start, stop)
        texts, limits = texts_in(values), declared_limits(self.dataset.variables[name])
        if limits is not None and values.dtype.kind in "fiu":
            lost = outside(values.astype(np.float64), limits)
            values = np.where(lost, np.nan, values) if lost.any() else values
        decoded = decode_times(values, units, calendar, where) if texts is None else decode_texts(texts, where)
        decoded = self._with_times(decoded, start) if name == "time" else decoded
        if start == 0 and stop == self.dataset[name].size:
            self._whole[name] = decoded
        return decoded

    def _with_times(self, decoded: DecodedTimes, start: int) -> DecodedTimes:
        """Interpolate the times of the samples that are left out; beyond the others, they are a millisecond apart."""
        rows = self._untimed_within(start, start + len(decoded.time))
        known = np.setdiff1d(np.arange(len(decoded.time)), rows)
        if not len(rows) or not len(known):
            return decoded
        time, epoch = decoded.time.copy(), decoded.time[known[0]]
        elapsed = (time[known] - epoch).astype(np.int64)
        before = np.maximum(np.searchsorted(known, rows) - 1, 0)
        after = np.minimum(before + 1, len(known) - 1)
        share = (rows - known[before]) / np.maximum(known[after] - known[before], 1)
        filled = elapsed[before] + np.rint(share * (elapsed[after] - elapsed[before])).astype(np.int64)
        beyond = (rows < known[0]) | (rows > known[-1])
        nearest = np.where(rows < known[0], 0, len(known) - 1)
        filled[beyond] = (elapsed[nearest] + (rows - known[nearest]) * 1_000_000)[beyond]
        time[rows] = epoch + filled.astype("timedelta64[ns]")
        return DecodedTimes(time, decoded.implausible & ~np.isin(np.arange(len(time)), rows))

    def _read(self, name: str, start: int, stop: int) -> npt.NDArray[np.generic]:
        try:
            # Slicing the variable takes a fifth of the time of slicing it with its coordinates.
            return np.asarray(self.dataset.variables[name][start:stop].values)
        except (OSError, RuntimeError, ValueError, KeyError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(
                f"{self.path}: {name} cannot be read, the file is damaged ({reason}); copy it again"
            ) from error


_FILLED = ("depth", "ballast_volume")
"""Variables in whose plausible ranges there are usual fill values; in those of the water, they are implausible."""


def _plausible_fills(name: str, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the usual fill values within the plausible range; those outside are faults of their profiles."""
    if name not in _FILLED:
        return np.zeros(len(values), dtype=bool)
    return usual_fills(values) & ~outside_range(VARIABLES[name], values)


MAX_FIX_AGE = np.timedelta64(1800, "s")
"""Maximum time between a fix and the beginning or end of the profile whose position it gives."""

MAX_GPS_DEPTH = 20.0
"""Depth (m) below which a glider cannot receive GPS, because the antenna is under water."""


@dataclass(frozen=True)
class ProfileSpan:
    """Span of one profile in its file.

    Attributes
    ----------
    number : int
        Number of the profile.
    start, stop : int
        Its first sample and the sample after its last.
    start_time, end_time : numpy.datetime64
        Times of its first and its last sample.
    fixes_from, fixes_until : numpy.datetime64
        Begin of the surface interval before it, and end of the surface interval after it.
    """

    number: int
    start: int
    stop: int
    start_time: np.datetime64
    end_time: np.datetime64
    fixes_from: np.datetime64
    fixes_until: np.datetime64


@dataclass(frozen=True, eq=False)
class Survey:
    """Results of a survey of the whole file.

    Attributes
    ----------
    spans : dict of int to ProfileSpan
        Spans of the profiles by number, in the order of the file.
    faults : dict of int to str
        Reasons why profiles cannot be inverted, by number.
    warnings : tuple of str
        Warnings about the file, to be shown to the user once.
    fixes : SurfaceFixes
        Fixes of the file.
    without_fixes : dict of int to str
        Reasons why none of the fixes around a profile can be used, by number.
    untimed : (k,) int array
        Samples that are left out because their time is missing or implausible.
    """

    spans: dict[int, ProfileSpan]
    faults: dict[int, str]
    warnings: tuple[str, ...]
    fixes: SurfaceFixes = field(default_factory=SurfaceFixes.none)
    without_fixes: dict[int, str] = field(default_factory=dict)
    untimed: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def only(self, numbers: Iterable[int]) -> "Survey":
        """Restrict the survey to some profiles, for a worker that processes only these."""
        wanted = set(numbers)
        spans = {number: self.spans[number] for number in self.spans.keys() & wanted}
        fixes = self.fixes
        if spans:
            first, last = (f(getattr(span, name) for span in spans.values()) for f, name in _REACH)
            fixes = fixes.cut(first, last)
        return replace(
            self,
            spans=dict(sorted(spans.items(), key=lambda item: item[1].start)),
            faults={number: self.faults[number] for number in self.faults.keys() & wanted},
            fixes=fixes,
            without_fixes={number: self.without_fixes[number] for number in self.without_fixes.keys() & wanted},
        )


_REACH = ((min, "fixes_from"), (max, "fixes_until"))


def survey_of(stored: StoredVariables) -> Survey:
    """Survey a file.

    Raises
    ------
    InputError
        The file lacks a required variable, has one in a wrong unit, or its time runs backwards. Faults of single
        profiles are collected instead.
    """
    path = str(stored.path)
    check_variables(stored.dataset, path)
    _check_sense(stored)
    missing = stored.describe_missing()
    untimed, remark = _untimed_samples(stored)
    stored.leave_out(untimed)
    missing += remark
    clock = stored.times("time", 0, stored.size("time"))
    time = clock.time
    numbers = stored.numbers("profile", 0, len(time)) if "profile" in stored else None
    places, faults = _locate(stored, time, numbers)
    places = _with_timed_ends(places, untimed)
    clock_faults = check_clock(time, places, path, clock.implausible)
    faults |= {number: text for number, text in clock_faults.items() if number not in faults}
    faults |= check_extents(time, places, faults)
    glide: dict[str, FloatArray] = {}
    doubtful_unit: str | None = None
    for name in PROFILE_VARIABLES:
        values = stored.numbers(name, 0, len(time))
        if name in GLIDE:
            glide[name] = values
        faults |= check_variable_of_profiles(VARIABLES[name], values, places, faults)
        if name == "heading":
            check_circle(values, f"{path}: heading")
            doubtful_unit = check_heading_unit(values, places, path)
    depth = glide["depth"]
    faults |= check_pace(time, depth, places, faults)
    faults |= check_signs(time, glide, places, faults)
    wrong_units, doubtful_depth = _compare_with_pressure(stored, depth, places, faults)
    faults |= wrong_units
    faults = {number: faults[number] for number in places if number in faults}
    fixes, warnings = _fixes(stored)
    spans = time_spans(time, places)
    doubts = submerged_fixes(time, depth, spans, faults, fixes) | _after_clock_steps(time, places, clock_faults)
    unnumbered = None if numbers is None else describe_unnumbered(numbers, time, depth)
    remarks = (
        doubtful_unit,
        doubtful_depth,
        unnumbered,
        *warnings,
        _describe_without_fix_between(spans, faults, fixes),
    )
    return Survey(spans, faults, (*missing, *filter(None, remarks)), fixes, doubts, untimed)


_MAX_UNTIMED = 0.5
"""Share of the samples without a usable time above which the clock is wrong, and they are not left out."""


def _untimed_samples(stored: StoredVariables) -> tuple[IntArray, list[str]]:
    """Samples whose time is missing or implausible, and a remark on them; empty if these are most samples."""
    clock = stored.times("time", 0, stored.size("time"))
    rows = np.flatnonzero(np.isnat(clock.time))
    if not len(rows) or len(rows) > _MAX_UNTIMED * len(clock.time):
        return np.zeros(0, dtype=np.int64), []
    implausible = np.count_nonzero(clock.implausible)
    kinds = ["missing"] if implausible < len(rows) else []
    kinds += [f"not between {FIRST_YEAR} and {LAST_YEAR}"] if implausible else []
    count = counted(len(rows), "sample")
    remedy = "; correct the clock, or declare the fill value (_FillValue)" if implausible else ""
    return rows, [f"time is {' or '.join(kinds)} in {count}, the first at sample {rows[0]}: left out{remedy}"]


def _with_timed_ends(places: Mapping[int, Span], untimed: IntArray) -> dict[int, Span]:
    """Spans of the profiles without samples that are left out at their ends; unchanged if no other is in a profile."""
    found: dict[int, Span] = {}
    for number, (start, stop) in places.items():
        first, last = np.searchsorted(untimed, (start, stop))
        timed = np.setdiff1d(np.arange(start, stop), untimed[first:last]) if last > first else np.arange(0)
        found[number] = (int(timed[0]), int(timed[-1]) + 1) if len(timed) else (start, stop)
    return found


def _describe_without_fix_between(
    spans: Mapping[int, ProfileSpan], faults: Mapping[int, str], fixes: SurfaceFixes
) -> str | None:
    """Warn of sequences of profiles that have a fix only before the first and after the last; None without any."""
    sequences: list[list[int]] = []
    begun: list[int] = []
    for span in sorted(spans.values(), key=lambda each: each.start):
        if span.number in faults:
            begun = []
            continue
        if fixes.between(span.fixes_from, span.start_time):
            begun = [span.number]
        elif begun:
            begun.append(span.number)
        if fixes.between(span.end_time, span.fixes_until):
            sequences += [begun] if len(begun) > 1 else []
            begun = []
    if not sequences:
        return None
    shown = ", ".join(map(as_ranges, sequences[:_MAX_SEQUENCES]))
    more = f" and {len(sequences) - _MAX_SEQUENCES} more sequences" if len(sequences) > _MAX_SEQUENCES else ""
    return (
        f"no GPS fix between the dives of profiles {shown}{more}: they are inverted, but have no current; `gliderhpc "
        "currents` estimates the mean current from fix to fix"
    )


_MAX_SEQUENCES = 3
"""Maximum number of sequences of profiles that a warning lists."""


def _check_sense(stored: StoredVariables) -> None:
    """Refuse a depth that is positive under water and declared positive up."""
    positive = str(stored.dataset["depth"].attrs.get("positive", ""))
    depth = stored.numbers("depth", 0, stored.size("time"))
    if positive.strip().lower() == "up" and (depth > MIN_DEPTH).any() and not (depth < -MIN_DEPTH).any():
        found, remedy = sense_fault(positive)
        raise InputError(f"{stored.path}: depth is {found}; {remedy}")


def _compare_with_pressure(
    stored: StoredVariables, depth: FloatArray, places: Mapping[int, Span], faults: Mapping[int, str]
) -> tuple[dict[int, str], str]:
    """Faults of profiles whose depth is in another unit than the pressure shows, and a remark on other differences.

    The remark is on the first of these profiles; it is empty if there are none.
    """
    if "pressure" not in stored:
        return {}, ""
    pressure = stored.numbers("pressure", 0, len(depth))
    found: dict[int, str] = {}
    remarks: list[str] = []
    for number, (start, stop) in places.items():
        if number in faults:
            continue
        try:
            doubts = check_depth_unit(f"profile {number}", depth[start:stop], pressure[start:stop])
        except InputError as error:
            found[number] = str(error)
        else:
            remarks += [f"profile {number}: {doubt}" for doubt in doubts]
    more = f" (and in {len(remarks) - 1} more)" if len(remarks) > 1 else ""
    return found, f"{remarks[0]}{more}" if remarks else ""


def _locate(
    stored: StoredVariables, time: TimeArray, numbers: FloatArray | None
) -> tuple[dict[int, Span], dict[int, str]]:
    """Spans and faults of the profiles, from the profile numbers in the file or, without these, from depth."""
    path = str(stored.path)
    if numbers is not None:
        numbers = np.nan_to_num(numbers)
        check_profile_numbers(numbers, path)
        places, faults = profile_spans(numbers.astype(np.int64))
    else:
        check_clock(time, {}, path, stored.times("time", 0, len(time)).implausible)
        seconds = (time - time[0]) / SECOND if len(time) else np.zeros(0)
        depth = stored.numbers("depth", 0, len(time))
        places, faults = profile_spans(detect_profiles(seconds, depth))
    if not len(time):
        raise InputError(f"{path}: has no samples: time has length 0; write the records again")
    if not places:
        raise InputError(
            f"{path}: has no profile; depth never leaves the surface, or the variable profile is 0 everywhere"
        )
    return places, faults


def time_spans(time: TimeArray, places: dict[int, Span]) -> dict[int, ProfileSpan]:
    """Spans of the profiles with their times and surface intervals.

    A surface interval is limited by the adjacent profile and by the greatest age of a fix (`MAX_FIX_AGE`).
    """
    spans: dict[int, ProfileSpan] = {}
    ordered = sorted(places.items(), key=lambda item: item[1])
    for index, (number, (start, stop)) in enumerate(ordered):
        first, last = time[start], time[stop - 1]
        since, until = first - MAX_FIX_AGE, last + MAX_FIX_AGE
        if index > 0:
            since = max(since, time[ordered[index - 1][1][1] - 1])
        if index + 1 < len(ordered):
            until = min(until, time[ordered[index + 1][1][0]])
        spans[number] = ProfileSpan(number, start, stop, first, last, since, until)
    return spans


AS_MINUTES = (
    "the fixes agree with each other if they are DDMM.mmm, which within a degree of 0 N, 0 E are plausible degrees: "
    "convert them to decimal degrees"
)


def agree_as_minutes(
    time: TimeArray, latitude: FloatArray, longitude: FloatArray, usable: npt.NDArray[np.bool_]
) -> bool:
    """Return whether most fixes that contradict each other in decimal degrees do not if they are DDMM.mmm."""
    found = screen_fixes(time, decimal_degrees(latitude), decimal_degrees(longitude), usable)
    return bool(usable.any()) and 2 * len(found.time) > int(usable.sum())


def _fixes(stored: StoredVariables) -> tuple[SurfaceFixes, tuple[str, ...]]:
    """Fixes of the file, and warnings about them."""
    count = stored.size("fix")
    absent = [name for name in ("fix_time", "fix_latitude", "fix_longitude") if name not in stored]
    if absent:
        count = 0
    found = SurfaceFixes.none()
    warnings: list[str] = []
    if count:
        latitude, longitude = (stored.numbers(f"fix_{name}", 0, count) for name in ("latitude", "longitude"))
        clock = stored.times("fix_time", 0, count)
        usable, warnings = check_fixes(latitude, longitude, clock.implausible)
        found = screen_fixes(clock.time, latitude, longitude, usable)
    if not len(found.time):
        missing = [f"time or position is missing in all {count}"] if count else _describe_absent(stored, absent)
        form = [AS_MINUTES] if count and agree_as_minutes(clock.time, latitude, longitude, usable) else []
        why = "; ".join([*warnings, *found.reasons[:1], *form] or missing)
        return found, (
            f"there is no usable GPS fix in the file{f' ({why})' if why else ''}: profiles are inverted, but their "
            "currents will be NaN",
        )
    rounded, remark = rounding_error(found.latitude, found.longitude)
    if remark:
        warnings.append(f"{remark}; give the positions in full, or `current.fix_error={rounded:.0f}`")
    if found.reasons:
        others = f", and {len(found.reasons) - 1} more" if len(found.reasons) > 1 else ""
        warnings.append(f"{found.reasons[0]}{others}")
    return found, tuple(warnings)


_OTHER_NAMES = re.compile(r"(?i)(?:gps_?)?(?:lat(?:itude)?|lon(?:gitude)?)(?:_gps)?")
"""Names of positions in other formats."""


def _describe_absent(stored: StoredVariables, absent: Sequence[str]) -> list[str]:
    """Describe the variables of the fixes that a file lacks, and those with other names; empty if it lacks none."""
    if not absent:
        return []
    found = [name for name in map(str, stored.dataset.variables) if _OTHER_NAMES.fullmatch(name)]
    lacks = f"it lacks {', '.join(absent)}"
    return [f"{lacks}, but has {', '.join(found)}: rename the positions of the GPS receiver" if found else lacks]


def _after_clock_steps(time: TimeArray, places: Mapping[int, Span], clock_faults: Mapping[int, str]) -> dict[int, str]:
    """Profiles that follow one in which the clock was set back; the clocks of samples and fixes may differ there."""
    ordered = sorted(places.items(), key=lambda item: item[1])
    doubts: dict[int, str] = {}
    for (number, (start, stop)), (after, _) in pairwise(ordered):
        if number in clock_faults:
            step = clock_set_back(time[start:stop])
            if step is not None:
                doubts[after] = (
                    f"the clock was set back by {step:.0f} s in profile {number}, the preceding one: fixes are not used"
                )
    return doubts


def submerged_fixes(
    time: TimeArray,
    depth: FloatArray,
    spans: Mapping[int, ProfileSpan],
    faults: Mapping[int, str],
    fixes: SurfaceFixes,
) -> dict[int, str]:
    """Profiles with a fix while the glider is under water; the clocks of samples and fixes disagree there."""
    sound = [span for number, span in spans.items() if number not in faults]
    if not sound or not len(fixes.time):
        return {}
    starts = np.array([span.start_time for span in sound])
    ends = np.array([span.end_time for span in sound])
    inside = np.searchsorted(starts, fixes.time) - 1
    candidates = np.flatnonzero((inside >= 0) & (fixes.time < ends[np.maximum(inside, 0)]))
    doubts: dict[int, str] = {}
    for index in candidates.tolist():
        span = sound[inside[index]]
        place = span.start + int(np.searchsorted(time[span.start : span.stop], fixes.time[index]))
        around = depth[max(place - 1, span.start) : place + 1]
        if np.all(around > MAX_GPS_DEPTH) and len(around):
            doubts.setdefault(
                span.number,
                f"GPS fix of {fixes.time[index].astype('datetime64[s]')} at {around.min():.0f} m depth: the clocks of "
                "fixes and samples disagree, so fixes are not used",
            )
    return doubts
