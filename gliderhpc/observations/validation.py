"""What makes an observation file, or one of its profiles, unusable, and how that is said in one line.

Faults of the file raise `InputError`. Faults of a profile are returned as text, so that the other profiles are still
estimated. Sample numbers count from 0 along ``time``.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.foreign_names import HELPFUL_ORDER, OWN_FILES, describe_found, importer_of
from gliderhpc.observations.format import MEASURED, VARIABLES, Variable
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR, check_time_unit

MINIMUM_SAMPLES = 30
"""A profile of fewer samples cannot carry an estimate."""

LARGEST_NUMBER = 1_000_000
"""Of a profile: greater ones are undeclared fill values."""

MINIMUM_DURATION = 120.0
"""Nor can a shorter one (s)."""

LONGEST_PROFILE = 20.0 * 86_400.0
"""A longer time from surfacing to surfacing (s) is no dive: the deepest take half a day, drifts under ice two weeks."""

LONGEST_GAP = 86_400.0
"""The motion over a longer gap within a profile (s) is unknown."""

CLOCK_SET_BACK = 60.0
"""A clock that goes back by more (s) was set: smaller steps are its correction by GPS."""

LEAST_BALLAST = 2.0
"""A bladder that never holds more oil than this (cm3), out or in, drives no glider: they move hundreds."""

LEAST_PITCH = 1.6
"""A glide is steeper than this (degree); in radians no pitch is."""

Span = tuple[int, int]
"""First sample of a profile and the one after its last."""

_LEAST = {"ballast_volume": LEAST_BALLAST, "pitch": LEAST_PITCH}
"""Least magnitude that a variable reaches somewhere in a profile; below, it is in another unit."""

_MOST_OF_A_CIRCLE = 5.0
"""Of 2 pi."""


def check_variables(dataset: xr.Dataset, path: str) -> None:
    """Refuse a dataset that lacks a required variable, or has one with the wrong dimension or unit.

    Raises
    ------
    InputError
        Naming the variable and the remedy.
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
    """Find times that do not increase, or lie in years in which no glider flew.

    Where all of them lie inside some profiles, and the file is in order without those, only these are at fault.

    Parameters
    ----------
    time : (n,) array
        NaT where missing or implausible.
    spans : mapping of int to Span
        Where the profiles lie.
    path : str
        The file, for messages.
    implausible : (n,) array of bool
        Times that are there but cannot be right.

    Returns
    -------
    dict
        Profile number to its fault.

    Raises
    ------
    InputError
        The time of the file as a whole does not increase.
    """
    faults: dict[int, str] = {}
    in_order = np.ones(len(time), dtype=bool)
    count = np.concatenate(([0], np.cumsum(_bad_times(time))))
    for number, (start, stop) in spans.items():
        bad = _first_bad_time(time[start:stop]) if count[stop] > count[start] else None
        if bad is not None:
            faults[number] = f"profile {number}: {_say_clock(time, start + bad, implausible)}"
            in_order[start:stop] = False
    kept = np.flatnonzero(in_order)
    bad = _first_bad_time(time[kept])
    if bad is not None:
        sample = int(kept[bad])
        raise InputError(f"{path}: {_name_profile(sample, spans)}{_say_clock(time, sample, implausible)}")
    return faults


def clock_set_back(time: TimeArray) -> float | None:
    """Time by which a clock was set back at most (s), None where it was not."""
    known = time[~np.isnat(time)]
    if len(known) < 2:
        return None
    step = float((known[:-1] - known[1:]).max() / np.timedelta64(1, "s"))
    return step if step > CLOCK_SET_BACK else None


def check_extents(time: TimeArray, spans: Mapping[int, Span], faults: Mapping[int, str]) -> dict[int, str]:
    """Faults of profiles, but for those that have one: too few samples, too short or long a time, too long a gap.

    Returns
    -------
    dict
        Profile number to its fault.
    """
    found = ((n, check_length(n, time[start:stop])) for n, (start, stop) in spans.items() if n not in faults)
    return {number: fault for number, fault in found if fault is not None}


def check_profile_numbers(numbers: FloatArray, path: str) -> None:
    """Refuse numbers of profiles that are none, fill values among them.

    Raises
    ------
    InputError
        Naming the first one.
    """
    odd = np.flatnonzero((numbers != np.rint(numbers)) | (numbers < 0) | (numbers > LARGEST_NUMBER))
    if len(odd):
        raise InputError(
            f"{path}: profile is {numbers[odd[0]]:g} at sample {odd[0]}; it must be a whole number, 0 outside any "
            "profile; a fill value must be declared (_FillValue)"
        )


def check_variable_of_profiles(
    variable: Variable, values: FloatArray, spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Faults of one variable over all profiles but those that have a fault (`check_values`).

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
        """Count by profile; the value appended lets a profile end with the file."""
        return np.asarray(np.add.reduceat(np.append(mask, False), ends, dtype=np.int64)[::2])

    suspect = count(_outside(variable, values)) > 0
    if variable.required:
        suspect |= count(np.isfinite(values)) < MINIMUM_SAMPLES
    if variable.name in _LEAST:
        with np.errstate(invalid="ignore"):
            suspect |= count(np.abs(values) >= _LEAST[variable.name]) == 0
    places = ((numbers[index], int(starts[index]), int(stops[index])) for index in np.flatnonzero(suspect).tolist())
    found = ((number, check_values(variable, values[start:stop], number, start)) for number, start, stop in places)
    return {number: fault for number, fault in found if fault is not None}


def check_heading_unit(heading: FloatArray, spans: Mapping[int, Span], path: str) -> None:
    """Refuse a heading that goes nearly all round the circle of radians and never leaves it.

    Raises
    ------
    InputError
        With the remedy.
    """
    inside = np.concatenate([heading[start:stop] for start, stop in spans.values()])
    known = inside[np.isfinite(inside)]
    if len(known) and known.min() >= -np.pi and known.max() <= 2.0 * np.pi and np.ptp(known) > _MOST_OF_A_CIRCLE:
        raise InputError(
            f"{path}: heading lies between {known.min():.3f} and {known.max():.3f} degree in every profile: it is in "
            "radians; convert it to degrees"
        )


def check_length(number: int, time: TimeArray) -> str | None:
    """Fault of a profile with too few samples, too short or too long a time, or too long a gap, or None."""
    if len(time) < MINIMUM_SAMPLES:
        return f"profile {number}: only {len(time)} samples, at least {MINIMUM_SAMPLES} are needed"
    duration = float((time[-1] - time[0]) / np.timedelta64(1, "s"))
    if duration < MINIMUM_DURATION:
        return f"profile {number}: lasts only {duration:.0f} s, at least {MINIMUM_DURATION:.0f} s are needed"
    gap = int(np.argmax(np.diff(time)))
    longest = float((time[gap + 1] - time[gap]) / np.timedelta64(1, "s"))
    if longest > LONGEST_GAP:
        return (
            f"profile {number}: a gap of {_say_days(longest)} from {_say_time(time[gap])} on, at most "
            f"{_say_days(LONGEST_GAP)} are bridged; correct the times or split the profile there"
        )
    if duration > LONGEST_PROFILE:
        return (
            f"profile {number}: lasts {_say_days(duration)}, at most {_say_days(LONGEST_PROFILE)} are plausible; is "
            "the unit of time right, and is every dive a profile?"
        )
    return None


def check_values(variable: Variable, values: FloatArray, number: int, start: int) -> str | None:
    """Fault of one variable of one profile, or None.

    Parameters
    ----------
    variable : Variable
        What the values are.
    values : (n,) array
        The profile's values in the unit of the file; NaN where missing.
    number : int
        Number of the profile.
    start : int
        Number of the first of the values in the file.
    """
    bad = np.flatnonzero(_outside(variable, values))
    if len(bad):
        return (
            f"profile {number}: {variable.name} is {values[bad[0]]:g} {variable.unit} at sample {start + bad[0]}, "
            f"outside {_say_range(variable)}; correct it or mark it missing (NaN)"
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
    needed = MINIMUM_SAMPLES if variable.name in MEASURED else 2
    if count < needed:
        return f"profile {number}: {variable.name} has only {count} samples that are not NaN, {needed} are needed"
    return None


def check_fixes(
    latitude: FloatArray, longitude: FloatArray, implausible: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.bool_], list[str]]:
    """Which fixes can be used, and warnings about the first ones out of range; `implausible` are those by time."""
    usable = np.isfinite(latitude) & np.isfinite(longitude) & ~implausible
    warnings = []
    if implausible.any():
        warnings.append(
            f"fix_time is not between {FIRST_YEAR} and {LAST_YEAR} at fix {np.flatnonzero(implausible)[0]}: such fixes "
            f"({np.count_nonzero(implausible)}) are left out"
        )
    for name, values in (("fix_latitude", latitude), ("fix_longitude", longitude)):
        bad = np.flatnonzero(_outside(VARIABLES[name], values))
        if len(bad):
            warnings.append(
                f"{name} is {values[bad[0]]:g} degree at fix {bad[0]}, outside {_say_range(VARIABLES[name])}: "
                f"such fixes ({len(bad)}) are left out"
            )
            usable[bad] = False
    return usable, warnings


def profile_spans(numbers: npt.NDArray[np.int64]) -> tuple[dict[int, Span], dict[int, str]]:
    """Where each profile lies in the file, and which of them are not in one piece.

    Parameters
    ----------
    numbers : (n,) int array
        The variable ``profile``: 0 outside any profile.
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
                f"profile {number}: interrupted, profile takes up the number {number} again at sample {start}; "
                "number every profile once, in one stretch",
            )
        else:
            spans[number] = (start, stop)
    return spans, faults


def _check_complete(names: Sequence[str], path: str) -> None:
    """Refuse a file that lacks required variables, naming first what only the glider's own files have."""
    lacking = [name for name in HELPFUL_ORDER if name not in names]
    if not lacking:
        return
    first, *others = lacking
    parts = [f"required variable {first} is missing" + (f", and so are {', '.join(others)}" if others else "")]
    kind, found = importer_of(names), describe_found(names, lacking)
    if kind is not None:
        parts.append(f"the file holds {kind[1]}: bring it into the observation format by `gliderhpc import {kind[0]}`")
    elif len(lacking) == 1:
        parts.append(_remedy_missing(first))
    if kind is None and first == "ballast_volume":
        parts.append(f"without the oil that drives the glide there is nothing to invert: {OWN_FILES}")
    elif kind is None and others:
        parts.append("bring the file into the observation format (`gliderhpc import`)")
    if found:
        parts.append(f"it has {found}")
    raise InputError(f"{path}: {'; '.join(parts)}")


def _check_time(array: xr.DataArray, dimension: str, path: str) -> None:
    _check_dimension(array, dimension, path)
    if not np.issubdtype(array.dtype, np.number):
        raise InputError(f"{path}: {array.name} holds {array.dtype} values; it must hold numbers in a CF unit of time")
    units, calendar = (str(array.attrs.get(key, "")) for key in ("units", "calendar"))
    check_time_unit(units, calendar, f"{path}: {array.name}")


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
        raise InputError(f"{path}: {variable.name} has no units attribute; it must say '{variable.unit}'")
    if not variable.accepts_unit(str(unit)):
        raise InputError(
            f"{path}: {variable.name} is in '{unit}'; convert it to '{variable.unit}'{_hint(variable, unit)}"
        )
    if not (np.issubdtype(array.dtype, np.number) or array.dtype == bool):
        raise InputError(f"{path}: {variable.name} holds {array.dtype} values; it must hold numbers")


def _hint(variable: Variable, unit: object) -> str:
    if variable.name == "depth" and VARIABLES["pressure"].accepts_unit(str(unit)):
        return " (what is in decibars is a pressure, not a depth)"
    return ""


def _remedy_missing(name: str) -> str:
    if name == "time":
        return "it must hold the time of every sample"
    variable = VARIABLES[name]
    return f"it must hold the {variable.long_name} in '{variable.unit}' along {variable.dimension}"


def _first_bad_time(time: TimeArray) -> int | None:
    """Index of the first time that is missing or not after the one before it."""
    first = np.flatnonzero(_bad_times(time))
    return int(first[0]) if len(first) else None


def _bad_times(time: TimeArray) -> npt.NDArray[np.bool_]:
    missing = np.isnat(time)
    bad = missing.copy()
    bad[1:] |= ~(time[1:] > time[:-1]) & ~missing[:-1]
    return bad


def _say_clock(time: TimeArray, sample: int, implausible: npt.NDArray[np.bool_]) -> str:
    if implausible[sample]:
        return (
            f"time is not between {FIRST_YEAR} and {LAST_YEAR} at sample {sample}; correct the clock or the unit of "
            "time, or declare the fill value (_FillValue)"
        )
    if np.isnat(time[sample]):
        return f"time is missing at sample {sample}; every sample needs a time"
    before = time[:sample][~np.isnat(time[:sample])][-1]
    verb = "is repeated" if time[sample] == before else "runs backwards"
    return (
        f"time {verb} at sample {sample} ({_say_time(time[sample])} after {_say_time(before)}); "
        "sort the samples by time and drop the repeated ones"
    )


def _implausible_unit(variable: Variable, values: FloatArray) -> str | None:
    """Say that values are those of another unit than the file declares, None where they may be right."""
    known = values[np.isfinite(values)]
    if variable.name not in _LEAST or not known.any() or np.abs(known).max() >= _LEAST[variable.name]:
        return None
    extent = f"{variable.name} lies between {known.min():.3g} and {known.max():.3g} {variable.unit}"
    if variable.name == "pitch":
        return f"{extent}, too flat for a glide: is it in radians? convert it to degrees"
    return f"{extent}, too little oil to drive a glider: is it in m3 or in litres? convert it to cm3"


def _say_days(seconds: float) -> str:
    return f"{seconds / 86_400.0:.3g} days"


def _say_time(time: np.datetime64) -> str:
    return str(time.astype("datetime64[ms]")).removesuffix(".000")


def _name_profile(sample: int, spans: Mapping[int, Span]) -> str:
    inside = [number for number, (start, stop) in spans.items() if start <= sample < stop]
    return f"profile {inside[0]}: " if inside else ""


def _outside(variable: Variable, values: FloatArray) -> npt.NDArray[np.bool_]:
    if variable.open_ended:
        return (values <= variable.low) | (values >= variable.high)
    return (values < variable.low) | (values > variable.high)


def _say_range(variable: Variable) -> str:
    low, high = f"{variable.low:g}", f"{variable.high:g}"
    return f"the open range {low} to {high}" if variable.open_ended else f"{low} to {high}"
