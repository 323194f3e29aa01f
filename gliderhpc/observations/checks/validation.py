"""Faults of an observation file: variables, clock, profile numbers, and fixes.

Faults of the file raise `InputError` with a message of one line. Faults of a profile are returned as text and do not
prevent the estimation of the other profiles (`gliderhpc.observations.checks.profile_checks`). Sample numbers start at
0 along ``time``.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.files.file_content import describe_groups
from gliderhpc.observations.files.foreign import HELPFUL_ORDER, OWN_FILES, describe_found, importer_of
from gliderhpc.observations.format import VARIABLES, Variable
from gliderhpc.observations.importing.position_form import may_be_minutes
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR, SECOND, check_resolution, check_time_unit, texts_in
from gliderhpc.wording import counted

MAX_PROFILE_NUMBER = 1_000_000
"""Maximum profile number; greater values are undeclared fill values."""

CLOCK_SET_BACK = 60.0
"""Backward step (s) above which the clock was set back; smaller steps are corrections by GPS."""

Span = tuple[int, int]
"""First sample of a profile and the sample after its last."""


def check_variables(dataset: xr.Dataset, path: str) -> None:
    """Refuse a dataset that lacks a required variable, or has one with the wrong dimension or unit.

    Raises
    ------
    InputError
        A variable is missing or wrong; the message names it and the remedy.
    """
    _check_complete([str(name) for name in dataset.variables], path)
    for name in ("time", "fix_time"):
        if name in dataset.variables:
            _check_time(dataset[name], "time" if name == "time" else "fix", path)
    for variable in VARIABLES.values():
        if variable.name in dataset.variables:
            _check_variable(dataset[variable.name], variable, path)


def check_clock(
    time: TimeArray, spans: Mapping[int, Span], path: str, implausible: npt.NDArray[np.bool_]
) -> dict[int, str]:
    """Find times that are missing, do not increase, or are outside the years of gliders.

    If all of these are inside profiles, and the file is in order without those profiles, only the profiles are faulty.

    Parameters
    ----------
    time : (n,) array
        Times of the samples; NaT where missing or implausible.
    spans : mapping of int to Span
        Sample ranges of the profiles.
    path : str
        Name of the file in messages.
    implausible : (n,) array of bool
        Mask of the times that are present but implausible.

    Returns
    -------
    dict
        Faults by profile number.

    Raises
    ------
    InputError
        The times do not increase even without the faulty profiles.
    """
    faults: dict[int, str] = {}
    in_order = np.ones(len(time), dtype=bool)
    count = np.concatenate(([0], np.cumsum(_bad_times(time))))
    for number, (start, stop) in spans.items():
        bad = _first_bad_time(time[start:stop]) if count[stop] > count[start] else None
        if bad is not None:
            faults[number] = f"profile {number}: {_describe_clock(time, start + bad, implausible)}"
            in_order[start:stop] = False
    ordered = np.flatnonzero(in_order)
    bad = _first_bad_time(time[ordered])
    if bad is not None:
        sample = int(ordered[bad])
        step = _find_clock_step(time, int(ordered[max(bad - 1, 0)]), sample)
        before, sample = (sample, sample) if step is None else step
        raise InputError(f"{path}: {_name_profile(before, spans)}{_describe_clock(time, sample, implausible)}")
    return faults


def clock_set_back(time: TimeArray) -> float | None:
    """Greatest backward step of a clock (s); None if it was not set back."""
    known = time[~np.isnat(time)]
    if len(known) < 2:
        return None
    step = float((known[:-1] - known[1:]).max() / SECOND)
    return step if step > CLOCK_SET_BACK else None


def _find_clock_step(time: TimeArray, first: int, last: int) -> tuple[int, int] | None:
    """Samples before and after the greatest backward step between two samples; None if the clock was not set back."""
    if np.isnat(time[last]):
        return None
    known = first + np.flatnonzero(~np.isnat(time[first : last + 1]))
    if clock_set_back(time[known]) is None:
        return None
    place = int(np.argmax(time[known[:-1]] - time[known[1:]]))
    return int(known[place]), int(known[place + 1])


def check_profile_numbers(numbers: FloatArray, path: str) -> None:
    """Refuse values that cannot be profile numbers, such as fill values.

    Raises
    ------
    InputError
        There are such values; the message names the first one.
    """
    odd = np.flatnonzero((numbers != np.rint(numbers)) | (numbers < 0) | (numbers > MAX_PROFILE_NUMBER))
    if len(odd):
        raise InputError(
            f"{path}: profile is {numbers[odd[0]]:g} at sample {odd[0]}; it must be a whole number up to "
            f"{MAX_PROFILE_NUMBER}, 0 outside any profile; a fill value must be declared (_FillValue)"
        )


MIN_UNNUMBERED_DEPTH = 20.0
"""Depth (m) below which samples without a profile number are reported; many records have some at the surface."""


def describe_unnumbered(numbers: FloatArray, time: TimeArray, depth: FloatArray) -> str | None:
    """Describe samples under water whose profile number is missing (NaN); None if there are none.

    Parameters
    ----------
    numbers, time, depth : (n,) arrays
        Profile numbers, times and depths (m) of the samples.
    """
    with np.errstate(invalid="ignore"):
        lost = np.flatnonzero(np.isnan(numbers) & (depth > MIN_UNNUMBERED_DEPTH))
    if not len(lost):
        return None
    return (
        f"profile is missing (NaN) in {counted(len(lost), 'sample')} below {MIN_UNNUMBERED_DEPTH:g} m, from "
        f"{describe_time(time[lost[0]])} to {describe_time(time[lost[-1]])}: they are not used; number their dive"
    )


def check_fixes(
    latitude: FloatArray, longitude: FloatArray, implausible: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.bool_], list[str]]:
    """Mask of the usable fixes, and warnings about the first ones out of range.

    The mask `implausible` marks the fixes with an implausible time.
    """
    usable = np.isfinite(latitude) & np.isfinite(longitude) & ~implausible
    warnings = []
    if implausible.any():
        warnings.append(
            f"fix_time is not between {FIRST_YEAR} and {LAST_YEAR} at fix {np.flatnonzero(implausible)[0]}: such fixes "
            f"({np.count_nonzero(implausible)}) are left out"
        )
    form = "; convert them from DDMM.mmm to decimal degrees" if may_be_minutes(latitude, longitude) else ""
    for name, values in (("fix_latitude", latitude), ("fix_longitude", longitude)):
        bad = np.flatnonzero(outside_range(VARIABLES[name], values))
        if len(bad):
            warnings.append(
                f"{name} is {values[bad[0]]:g} degree at fix {bad[0]}, outside {describe_range(VARIABLES[name])}: "
                f"such fixes ({len(bad)}) are left out{form}"
            )
            usable[bad] = False
    return usable, warnings


def profile_spans(numbers: npt.NDArray[np.int64]) -> tuple[dict[int, Span], dict[int, str]]:
    """Span of each profile in the file, and faults of the profiles that are not contiguous.

    Parameters
    ----------
    numbers : (n,) int array
        Values of the variable ``profile``: 0 outside any profile.
    """
    spans: dict[int, Span] = {}
    faults: dict[int, str] = {}
    edges = np.concatenate(([0], np.flatnonzero(np.diff(numbers)) + 1, [len(numbers)])).tolist()
    for start, stop in pairwise(edges):
        number = int(numbers[start]) if stop > start else 0
        if number == 0:
            continue
        if number in spans:
            faults.setdefault(
                number,
                f"profile {number}: not contiguous: number {number} reappears at sample {start}; each profile must be "
                "one block of consecutive samples",
            )
        else:
            spans[number] = (start, stop)
    return spans, faults


def _check_complete(names: Sequence[str], path: str) -> None:
    """Refuse a file that lacks required variables; the message begins with the one found only in the glider's files."""
    lacking = [name for name in HELPFUL_ORDER if name not in names]
    if not lacking:
        return
    first, *others = lacking
    parts = [f"required variable {first} is missing" + (f", and so are {', '.join(others)}" if others else "")]
    kind, found = importer_of(names), describe_found(names, lacking)
    if kind is not None:
        parts.append(
            f"the file contains {kind[1]}: convert it to the observation format with `gliderhpc import {kind[0]}`"
        )
    elif len(lacking) == 1:
        parts.append(_remedy_missing(first))
    if kind is None and first == "ballast_volume":
        parts.append(f"without the ballast, which drives the glide, there is nothing to invert: {OWN_FILES}")
    elif kind is None and others:
        parts.append("convert the file to the observation format (`gliderhpc import`)")
    if found:
        parts.append(f"it has {found}")
    raise InputError(f"{path}: {'; '.join(parts)}{describe_groups(Path(path))}")


def _check_time(array: xr.DataArray, dimension: str, path: str) -> None:
    _check_dimension(array, dimension, path)
    if not np.issubdtype(array.dtype, np.number):
        if texts_in(array.values) is not None:
            return
        raise InputError(
            f"{path}: {array.name} contains {array.dtype} values; it must contain numbers in a CF unit of time, or "
            "texts in ISO 8601"
        )
    units, calendar = (str(array.attrs.get(key, "")) for key in ("units", "calendar"))
    check_time_unit(units, calendar, f"{path}: {array.name}")
    check_resolution(array.values, units, f"{path}: {array.name}")


def _check_dimension(array: xr.DataArray, dimension: str, path: str) -> None:
    if array.dims != (dimension,):
        raise InputError(
            f"{path}: {array.name} has dimensions ({', '.join(map(str, array.dims))}); "
            f"it must have the one dimension {dimension}"
        )


def _check_variable(array: xr.DataArray, variable: Variable, path: str) -> None:
    _check_dimension(array, variable.dimension, path)
    unit = array.attrs.get("units", "" if variable.dimensionless else None)
    if unit is None:
        raise InputError(f"{path}: {variable.name} has no units attribute; it must be '{variable.unit}'")
    if not variable.accepts_unit(str(unit)):
        raise InputError(
            f"{path}: {variable.name} is in '{unit}'; convert it to '{variable.unit}'{_hint(variable, unit)}"
        )
    if not (np.issubdtype(array.dtype, np.number) or array.dtype == bool):
        raise InputError(f"{path}: {variable.name} contains {array.dtype} values; it must contain numbers")


def _hint(variable: Variable, unit: object) -> str:
    if variable.name == "depth" and VARIABLES["pressure"].accepts_unit(str(unit)):
        return " (a variable in decibars is a pressure, not a depth)"
    return ""


def _remedy_missing(name: str) -> str:
    if name == "time":
        return "it must contain the time of every sample"
    variable = VARIABLES[name]
    return f"it must contain the {variable.long_name} in '{variable.unit}' along {variable.dimension}"


def _first_bad_time(time: TimeArray) -> int | None:
    """Index of the first time that is missing or not later than the preceding one; None if there is none."""
    first = np.flatnonzero(_bad_times(time))
    return int(first[0]) if len(first) else None


def _bad_times(time: TimeArray) -> npt.NDArray[np.bool_]:
    missing = np.isnat(time)
    bad = missing.copy()
    bad[1:] |= ~(time[1:] > time[:-1]) & ~missing[:-1]
    return bad


def _describe_clock(time: TimeArray, sample: int, implausible: npt.NDArray[np.bool_]) -> str:
    if implausible[sample]:
        return (
            f"time is not between {FIRST_YEAR} and {LAST_YEAR} at sample {sample}; correct the clock or the unit of "
            "time, or declare the fill value (_FillValue)"
        )
    if np.isnat(time[sample]):
        return f"time is missing at sample {sample}; every sample needs a time"
    before = time[:sample][~np.isnat(time[:sample])][-1]
    place = f"at sample {sample} ({describe_time(time[sample])} after {describe_time(before)})"
    step = float((before - time[sample]) / SECOND)
    if step > CLOCK_SET_BACK:
        return (
            f"the clock was set back by {step:.0f} s {place}; correct the times from there on or leave these samples "
            "out, and sort the samples by time only if just their order is wrong"
        )
    verb = "is repeated" if step == 0.0 else "runs backwards"
    return f"time {verb} {place}; sort the samples by time and remove the repeated ones"


def describe_time(time: np.datetime64) -> str:
    """Format a time for a message."""
    return str(time.astype("datetime64[ms]")).removesuffix(".000")


def _name_profile(sample: int, spans: Mapping[int, Span]) -> str:
    inside = [number for number, (start, stop) in spans.items() if start <= sample < stop]
    return f"profile {inside[0]}: " if inside else ""


def outside_range(variable: Variable, values: FloatArray) -> npt.NDArray[np.bool_]:
    """Return the mask ``(n,)`` of the values outside a variable's plausible range."""
    if variable.open_ended:
        return (values <= variable.low) | (values >= variable.high)
    return (values < variable.low) | (values > variable.high)


def describe_range(variable: Variable) -> str:
    """Format a variable's plausible range for a message."""
    low, high = f"{variable.low:g}", f"{variable.high:g}"
    return f"the open range {low} to {high}" if variable.open_ended else f"{low} to {high}"
