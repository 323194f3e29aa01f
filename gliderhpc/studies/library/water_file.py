"""Variables, axes and units of files of water velocity, recognised by their attributes."""

from collections.abc import Container
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.foreign import FACTORS

COMPONENTS = {
    "northward_sea_water_velocity": ("vo", "water_v", "v"),
    "eastward_sea_water_velocity": ("uo", "water_u", "u"),
}
"""Standard names of the velocities, north first, and names of variables that stand for a missing one."""

ROLES = ("time", "depth", "latitude", "longitude")
_LETTERS = {"T": "time", "Z": "depth", "Y": "latitude", "X": "longitude"}
_NAMES = {"time": "time", "depth": "depth", "lat": "latitude", "lon": "longitude"}


def velocity_name(dataset: xr.Dataset, standard: str, dimensions: Container[int]) -> str | None:
    """Variable of a velocity on so many dimensions, by its standard name, else by a customary name."""
    sized = [str(name) for name, variable in dataset.data_vars.items() if variable.ndim in dimensions]
    named = [name for name in sized if dataset[name].attrs.get("standard_name") == standard]
    return next(iter([*named, *(name for name in COMPONENTS[standard] if name in sized)]), None)


def role_of(coordinate: xr.DataArray) -> str | None:
    """Return the axis that a coordinate is, by standard name, CF axis, unit or, last of all, its name."""
    attributes, name = coordinate.attrs, str(coordinate.name).lower()
    standard = str(attributes.get("standard_name", ""))
    if standard in ROLES:
        return standard
    if attributes.get("axis") in _LETTERS:
        return _LETTERS[attributes["axis"]]
    units = str(attributes.get("units", ""))
    if " since " in units:
        return "time"
    if units.startswith("degree") and units.endswith(("north", "east")):
        return "latitude" if units.endswith("north") else "longitude"
    return next((role for start, role in _NAMES.items() if name.startswith(start)), None)


def downward(depth: xr.DataArray) -> float:
    """1 for depths counted downward, -1 for heights."""
    return -1.0 if str(depth.attrs.get("positive", "down")).lower() == "up" else 1.0


def times_of(label: str, coordinate: xr.Variable, name: str) -> NDArray[Any]:
    """Decode the times of a coordinate: datetime64, in nanoseconds.

    Raises
    ------
    InputError
        It is no time, empty, or misses some.
    """
    try:
        decoded = np.asarray(xr.conventions.decode_cf_variable(name, coordinate).values)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{label}: {name} is in '{coordinate.attrs.get('units', '')}', no unit of time") from error
    if decoded.dtype.kind != "M":
        raise InputError(f"{label}: {name} has no unit of time since an instant of the usual calendar")
    times = decoded.astype("datetime64[ns]")
    if times.size == 0 or np.isnat(times).any():
        raise InputError(f"{label}: {name} is empty, or misses some of its times")
    return times


def factor_of(label: str, variable: xr.DataArray, unit: str) -> float:
    """Return what a variable's values are multiplied by to come in a unit of `gliderhpc.observations.foreign`.

    Raises
    ------
    InputError
        Its own unit is missing or another quantity's.
    """
    declared = str(variable.attrs.get("units", "")).strip()
    factor = FACTORS[unit].get(declared.lower())
    if factor is None:
        raise InputError(f"{label}: {variable.name} is in '{declared}', of which no '{unit}' can be made")
    return factor
