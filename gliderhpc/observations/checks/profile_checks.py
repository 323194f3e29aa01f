"""Faults of single profiles: implausible values, lengths, gaps and vertical speeds.

Faults are returned as text and do not prevent the estimation of the other profiles. Sample numbers start at 0 along
``time``.
"""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.validation import (
    Span,
    describe_range,
    describe_time,
    outside_range,
)
from gliderhpc.observations.format import MEASURED, Variable
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import SECOND
from gliderhpc.wording import counted

MIN_SAMPLES = 30
"""Minimum number of samples of a profile that can be estimated."""

MIN_DURATION = 120.0
"""Minimum duration of a profile that can be estimated (s)."""

MAX_PROFILE_DURATION = 20.0 * 86_400.0
"""Maximum plausible time from surfacing to surfacing (s): the deepest dives take half a day, drifts under ice two
weeks."""

MAX_GAP = 86_400.0
"""Longest gap within a profile (s); the motion over a longer one is unknown."""

MIN_BALLAST = 2.0
"""Minimum magnitude that the ballast volume of a glider reaches (cm3); gliders move hundreds of cm3."""

MIN_PITCH = 1.6
"""Minimum magnitude that the pitch of a glide reaches (degree); in radians, no pitch exceeds it."""

_MIN_MAGNITUDE = {"ballast_volume": MIN_BALLAST, "pitch": MIN_PITCH}
"""Minimum magnitude that a variable reaches somewhere in a profile; one that stays below it is in another unit."""

_CIRCLE = (-3.15, 6.29)
"""Limits of headings in radians, from -pi or from 0 on, with a margin for rounding."""

_MIN_TURN = 1.0
"""Range of headings above which those within `_CIRCLE` are in radians. In degrees no glider keeps its course that well:
in 243 dives of six gliders the smallest range within a dive is 50 degrees."""


def check_extents(time: TimeArray, spans: Mapping[int, Span], faults: Mapping[int, str]) -> dict[int, str]:
    """Faults of extent in profiles that have no fault yet: too few samples, too short or long a time, too long a gap.

    Returns
    -------
    dict
        Profile number to its fault.
    """
    return faults_of(lambda number, own: check_length(number, time[own]), spans, faults)


def faults_of(
    check: Callable[[int, slice], str | None], spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Check every profile that has no fault yet, given its number and its samples; return the faults by number."""
    found = ((number, check(number, slice(*span))) for number, span in spans.items() if number not in faults)
    return {number: fault for number, fault in found if fault is not None}


def check_variable_of_profiles(
    variable: Variable, values: FloatArray, spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Faults of one variable in all profiles that have no fault yet (`check_values`).

    Returns
    -------
    dict
        Profile number to its fault.
    """
    numbers = [number for number in spans if number not in faults]
    if not numbers:
        return {}
    starts, stops = np.array([spans[number] for number in numbers]).T
    ends = np.column_stack([starts, stops]).ravel()

    def count(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
        """Count the true values by profile; the appended value allows a profile to end with the file."""
        return np.asarray(np.add.reduceat(np.append(mask, False), ends, dtype=np.int64)[::2])

    suspect = count(outside_range(variable, values)) > 0
    if variable.required:
        suspect |= count(np.isfinite(values)) < MIN_SAMPLES
    if variable.name in _MIN_MAGNITUDE:
        with np.errstate(invalid="ignore"):
            suspect |= count(np.abs(values) >= _MIN_MAGNITUDE[variable.name]) == 0
    places = ((numbers[index], int(starts[index]), int(stops[index])) for index in np.flatnonzero(suspect).tolist())
    found = ((number, check_values(variable, values[start:stop], number, start)) for number, start, stop in places)
    return {number: fault for number, fault in found if fault is not None}


def check_heading_unit(heading: FloatArray, spans: Mapping[int, Span], path: str, name: str = "heading") -> str | None:
    """Refuse a heading in radians, which never leaves one circle of radians in any profile.

    A glider on a northward course does not look like this: its heading passes through north, to negative values or to
    those near 360 degrees. Where all headings lie within 1 radian or degree of each other, they are not decisive.

    Parameters
    ----------
    heading : (n,) array
        Headings (degree), NaN where missing; before a declination is added, which would move them out of the circle.
    spans : mapping of int to Span
        Sample ranges of the profiles.
    path, name : str
        Names of the file and of the variable in messages.

    Returns
    -------
    str or None
        A remark if the heading may be in radians; None if it is in degrees, or there is none.

    Raises
    ------
    InputError
        The heading is in radians; the message gives the remedy.
    """
    inside = np.concatenate([np.zeros(0), *(heading[start:stop] for start, stop in spans.values())])
    known = inside[np.isfinite(inside)]
    if not len(known) or known.min() < _CIRCLE[0] or known.max() > _CIRCLE[1]:
        return None
    found = f"{name} lies between {known.min():.3f} and {known.max():.3f} degree in every profile"
    if np.ptp(known) > _MIN_TURN:
        raise InputError(f"{path}: {found}, so it is in radians; convert it to degrees")
    return f"{found}: if it is in radians, convert it to degrees"


def check_length(number: int, time: TimeArray) -> str | None:
    """Fault of a profile with too few samples, too short or too long a time, or too long a gap; None if it has none."""
    if len(time) < MIN_SAMPLES:
        return f"profile {number}: only {counted(len(time), 'sample')}, but at least {MIN_SAMPLES} are needed"
    duration = float((time[-1] - time[0]) / SECOND)
    if duration < MIN_DURATION:
        return f"profile {number}: lasts only {duration:.0f} s, but at least {MIN_DURATION:.0f} s are needed"
    gap = int(np.argmax(np.diff(time)))
    longest = float((time[gap + 1] - time[gap]) / SECOND)
    if longest > MAX_GAP:
        return (
            f"profile {number}: a gap of {_describe_days(longest)} from {describe_time(time[gap])} on, but at most "
            f"{_describe_days(MAX_GAP)} are bridged; correct the times or split the profile there"
        )
    if duration > MAX_PROFILE_DURATION:
        return (
            f"profile {number}: lasts {_describe_days(duration)}, but at most {_describe_days(MAX_PROFILE_DURATION)} "
            "are plausible; check the unit of time, and that every dive is a profile"
        )
    return None


def check_values(variable: Variable, values: FloatArray, number: int, start: int) -> str | None:
    """Fault of one variable of one profile; None if it has none.

    Parameters
    ----------
    variable : Variable
        Variable of the values.
    values : (n,) array
        The profile's values in the unit of the file; NaN where missing.
    number : int
        Number of the profile.
    start : int
        Sample number of the first value in the file.
    """
    bad = np.flatnonzero(outside_range(variable, values))
    if len(bad) and variable.name == "depth" and np.nanmedian(values) < 0.0:
        first = f"{values[bad[0]]:g} m at sample {start + bad[0]}"
        return f"profile {number}: depth is negative under water ({first}); make it positive down"
    if len(bad):
        return (
            f"profile {number}: {variable.name} is {values[bad[0]]:g} {variable.unit} at sample {start + bad[0]}, "
            f"outside {describe_range(variable)}; {_other_unit(variable)}correct it or mark it missing (NaN)"
        )
    if not variable.required:
        return None
    implausible = _implausible_unit(variable, values)
    if implausible:
        return f"profile {number}: {implausible}"
    count = int(np.count_nonzero(np.isfinite(values)))
    if count == 0:
        return (
            f"profile {number}: {variable.name} is missing (NaN) in all {len(values)} samples, from sample {start} on; "
            "fill it in or leave the profile out"
        )
    needed = MIN_SAMPLES if variable.name in MEASURED else 2
    if count < needed:
        there = "sample that is" if count == 1 else "samples that are"
        return f"profile {number}: {variable.name} has only {count} {there} not NaN, but {needed} are needed"
    return None


def _other_unit(variable: Variable) -> str:
    return "convert it if it is in centimetres, " if variable.name == "battery_position" else ""


def _implausible_unit(variable: Variable, values: FloatArray) -> str | None:
    """Describe values that are in another unit than the declared one; None if they may be right."""
    known = values[np.isfinite(values)]
    if variable.name not in _MIN_MAGNITUDE or not known.any() or np.abs(known).max() >= _MIN_MAGNITUDE[variable.name]:
        return None
    extent = f"{variable.name} lies between {known.min():.3g} and {known.max():.3g} {variable.unit}"
    if variable.name == "pitch":
        return f"{extent}, too flat for a glide; if it is in radians, convert it to degrees"
    return f"{extent}, too little oil to drive a glider; if it is in m3 or litres, convert it to cm3"


def _describe_days(seconds: float) -> str:
    return f"{seconds / 86_400.0:.3g} days"


SLOWEST_GLIDE = 0.01
"""Vertical speed (m/s) that every glide exceeds somewhere; the slowest gliders sink at 0.03 m/s."""

FASTEST_GLIDE = 2.0
"""Mean vertical speed (m/s) of a whole profile that no glider reaches; the fastest dive at 0.5 m/s."""

_MIN_RANGE = 5.0
"""Depth range (m) below which the vertical speed of a profile is not checked."""

_PART = 0.25
"""Fraction of the depth range that is passed in one glide."""


def check_pace(
    time: TimeArray, depth: FloatArray, spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Faults of vertical speed in profiles that have no fault yet: too slow or too fast for any glider.

    Parameters
    ----------
    time : (n,) array
        Times (UTC).
    depth : (n,) array
        Depths (m), NaN where missing.
    spans : mapping of int to Span
        Sample ranges of the profiles.
    faults : mapping of int to str
        Faults found before, by profile number.
    """
    return faults_of(lambda number, own: fault_of_pace(number, time[own], depth[own]), spans, faults)


def fault_of_pace(number: int, time: TimeArray, depth: FloatArray) -> str | None:
    """Fault of the vertical speed of one profile, from its times and depths (m) ``(n,)``; None if it has none."""
    known = np.isfinite(depth)
    seconds, depth = (time[known] - time[0]) / SECOND, depth[known]
    extent = float(np.ptp(depth))
    if extent < _MIN_RANGE:
        return None
    mean = 2.0 * extent / float(seconds[-1] - seconds[0])
    if mean > FASTEST_GLIDE:
        return (
            f"profile {number}: dives {extent:.0f} m and returns at a mean vertical speed of {mean:.3g} m/s, faster "
            "than any glider; check the units of time and depth"
        )
    # The slowest glide passes this fraction of the range in one bin; a faster glide passes it within one bin, or most
    # of it in two.
    bins = np.floor(seconds * (SLOWEST_GLIDE / (_PART * extent)))
    begins = np.flatnonzero(np.diff(bins, prepend=-1.0))
    passed = np.maximum.reduceat(depth, begins) - np.minimum.reduceat(depth, begins)
    if len(begins) > 1 and passed.max() < _PART * extent:
        return (
            f"profile {number}: nowhere moves faster than {SLOWEST_GLIDE:g} m/s up or down between the surface and "
            f"{depth.max():.0f} m, slower than any glide; check the units of time and depth"
        )
    return None


MIN_CONSTANT_SAMPLES, MIN_CONSTANT_RANGE = 30, 50.0
"""Minimum number of samples, and range of their depths (m), over which a temperature or salinity is not constant."""


def constant_values(depth: FloatArray, measured: Mapping[str, FloatArray | None]) -> list[str]:
    """Remarks on temperature and salinity that are the same to the last digit in all samples of a dive.

    Parameters
    ----------
    depth : (n,) array
        Depth, m; NaN where missing.
    measured : mapping of str to (n,) array or None
        Values by the name of the variable, NaN where missing; None if absent.
    """
    remarks = []
    for name, values in measured.items():
        known = np.zeros(0, bool) if values is None else np.isfinite(values) & np.isfinite(depth)
        if values is None or np.count_nonzero(known) < MIN_CONSTANT_SAMPLES:
            continue
        if np.ptp(values[known]) == 0.0 and np.ptp(depth[known]) > MIN_CONSTANT_RANGE:
            remarks.append(
                f"{name} is {values[known][0]:.6g} in all its samples from {depth[known].min():.0f} to "
                f"{depth[known].max():.0f} m: unless the water is that uniform, it was not measured, and a buoyancy by "
                "density is wrong"
            )
    return remarks
