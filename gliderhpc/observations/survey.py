"""Survey of an observation file: where its profiles are, which of them have faults, and which fixes are usable."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

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
    describe_unnumbered,
    profile_spans,
)
from gliderhpc.observations.fixes import (
    AS_MINUTES,
    SurfaceFixes,
    agree_as_minutes,
    rounding_error,
    screen_fixes,
)
from gliderhpc.observations.format import PROFILE_VARIABLES, VARIABLES
from gliderhpc.observations.navigation.checks import check_depth_unit
from gliderhpc.observations.profiles import MIN_DEPTH, IntArray, detect_profiles
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.stored_variables import StoredVariables
from gliderhpc.observations.surface_intervals import (
    ProfileSpan,
    describe_without_fix_between,
    profiles_after_clock_steps,
    submerged_fixes,
    time_spans,
)
from gliderhpc.observations.times import (
    SECOND,
)
from gliderhpc.observations.untimed_samples import untimed_samples, without_untimed_ends


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
    untimed, remark = untimed_samples(stored.times("time", 0, stored.size("time")))
    stored.leave_out(untimed)
    missing += remark
    clock = stored.times("time", 0, stored.size("time"))
    time = clock.time
    numbers = stored.numbers("profile", 0, len(time)) if "profile" in stored else None
    places, faults = _locate(stored, time, numbers)
    places = without_untimed_ends(places, untimed)
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
    doubts = submerged_fixes(time, depth, spans, faults, fixes) | profiles_after_clock_steps(time, places, clock_faults)
    unnumbered = None if numbers is None else describe_unnumbered(numbers, time, depth)
    remarks = (
        doubtful_unit,
        doubtful_depth,
        unnumbered,
        *warnings,
        describe_without_fix_between(spans, faults, fixes),
    )
    return Survey(spans, faults, (*missing, *filter(None, remarks)), fixes, doubts, untimed)


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
