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

MINIMUM_SAMPLES = 30
"""A profile of fewer samples cannot carry an estimate."""

MINIMUM_DURATION = 120.0
"""Nor can a shorter one (s)."""

Span = tuple[int, int]
"""First sample of a profile and the one after its last."""


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


def check_clock(time: TimeArray, spans: Mapping[int, Span], path: str) -> dict[int, str]:
    """Find times that do not increase.

    Where all of them lie inside some profiles, and the file is in order without those, only these are at fault.

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
    for number, (start, stop) in spans.items():
        bad = _first_bad_time(time[start:stop])
        if bad is not None:
            faults[number] = f"profile {number}: {_say_clock(time, start + bad)}"
            in_order[start:stop] = False
    kept = np.flatnonzero(in_order)
    bad = _first_bad_time(time[kept])
    if bad is not None:
        sample = int(kept[bad])
        raise InputError(f"{path}: {_name_profile(sample, spans)}{_say_clock(time, sample)}")
    return faults


def check_length(number: int, time: TimeArray) -> str | None:
    """Fault of a profile with too few samples or too short a time, or None."""
    if len(time) < MINIMUM_SAMPLES:
        return f"profile {number}: only {len(time)} samples, at least {MINIMUM_SAMPLES} are needed"
    duration = float((time[-1] - time[0]) / np.timedelta64(1, "s"))
    if duration < MINIMUM_DURATION:
        return f"profile {number}: lasts only {duration:.0f} s, at least {MINIMUM_DURATION:.0f} s are needed"
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


def check_fixes(latitude: FloatArray, longitude: FloatArray) -> tuple[npt.NDArray[np.bool_], list[str]]:
    """Which fixes can be used, and a warning about the first one out of range."""
    usable = np.isfinite(latitude) & np.isfinite(longitude)
    warnings = []
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
    if not np.issubdtype(array.dtype, np.datetime64):
        raise InputError(
            f"{path}: {array.name} has no CF time unit of the standard calendar; "
            "give it units such as 'seconds since 1970-01-01'"
        )


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
    missing = np.isnat(time)
    bad = missing.copy()
    bad[1:] |= ~(time[1:] > time[:-1]) & ~missing[:-1]
    first = np.flatnonzero(bad)
    return int(first[0]) if len(first) else None


def _say_clock(time: TimeArray, sample: int) -> str:
    if np.isnat(time[sample]):
        return f"time is missing at sample {sample}; every sample needs a time"
    before = time[:sample][~np.isnat(time[:sample])][-1]
    verb = "is repeated" if time[sample] == before else "runs backwards"
    return (
        f"time {verb} at sample {sample} ({_say_time(time[sample])} after {_say_time(before)}); "
        "sort the samples by time and drop the repeated ones"
    )


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
