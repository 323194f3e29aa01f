"""Files of ocean models and other records of water velocity: variables, units, axes and products."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit, urlunsplit

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError, first_line
from gliderhpc.observations.files.columns import FACTORS

Array = NDArray[np.float64]

COMPONENTS = {
    "northward_sea_water_velocity": ("vo", "water_v", "v"),
    "eastward_sea_water_velocity": ("uo", "water_u", "u"),
}
"""Standard names of the velocities, north first, and customary names of variables without one."""

ROLES = ("time", "depth", "latitude", "longitude")
_LETTERS = {"T": "time", "Z": "depth", "Y": "latitude", "X": "longitude"}
_NAMES = {"time": "time", "depth": "depth", "lat": "latitude", "lon": "longitude"}

FULL_CIRCLE = 360.0
"""Period of longitude, degree."""

_CIRCLE_TOLERANCE = 0.01

PRODUCTS = (
    ("HYCOM", ("hycom",)),
    ("GLORYS12", ("glorys", "global_multiyear_phy", "global_reanalysis_phy", "mod_glo_phy_my")),
    ("GLO12", ("glo12", "global_analysisforecast_phy", "global_analysis_forecast_phy", "mod_glo_phy_anfc")),
)
"""Names of the products, and the words in a file's global attributes that identify each; the first match is used."""

_TEXTS = ("source", "title", "product", "id", "institution", "experiment", "dataset_id")


def velocity_name(dataset: xr.Dataset, standard: str, dimensions: Container[int]) -> str | None:
    """Variable of a velocity with an allowed number of dimensions, by standard name, else by customary name."""
    sized = [str(name) for name, variable in dataset.data_vars.items() if variable.ndim in dimensions]
    named = [name for name in sized if dataset[name].attrs.get("standard_name") == standard]
    return next(iter([*named, *(name for name in COMPONENTS[standard] if name in sized)]), None)


def role_of(coordinate: xr.DataArray) -> str | None:
    """Return the axis that a coordinate represents, from its standard name, CF axis, unit or, at last, name."""
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
    """Return 1 for depths, which are positive downward, and -1 for heights."""
    return -1.0 if str(depth.attrs.get("positive", "down")).lower() == "up" else 1.0


def times_of(label: str, coordinate: xr.Variable, name: str) -> NDArray[Any]:
    """Decode the times of a coordinate, as datetime64 in nanoseconds.

    Raises
    ------
    InputError
        The coordinate is not a time, is empty, or has missing times.
    """
    try:
        decoded = np.asarray(xr.conventions.decode_cf_variable(name, coordinate).values)
    except (ValueError, OverflowError) as error:
        raise InputError(
            f"{label}: {name} is in '{coordinate.attrs.get('units', '')}', which is not a unit of time"
        ) from error
    if decoded.dtype.kind != "M":
        raise InputError(f"{label}: {name} has no unit of time since a date of the standard calendar")
    times = decoded.astype("datetime64[ns]")
    if times.size == 0 or np.isnat(times).any():
        raise InputError(f"{label}: {name} is empty, or has missing times")
    return times


def factor_of(label: str, variable: xr.DataArray, unit: str) -> float:
    """Return the factor to one of the units of `gliderhpc.observations.files.columns` from that of a variable.

    Raises
    ------
    InputError
        The variable's unit is missing, or belongs to another quantity.
    """
    declared = str(variable.attrs.get("units", "")).strip()
    factor = FACTORS[unit].get(declared.lower())
    if factor is None:
        raise InputError(f"{label}: {variable.name} is in '{declared}', which cannot be converted to '{unit}'")
    return factor


@dataclass(frozen=True, eq=False)
class Cells:
    """Neighbours of positions along one axis.

    Attributes
    ----------
    lower, upper : (n,) int arrays
        Indices on the axis, in the file's order, between which each position lies.
    weight : (n,) array
        Weight of the upper neighbour, 0 to 1.
    inside : (n,) bool array
        True where the position lies within the axis; elsewhere the other values are meaningless.
    """

    lower: NDArray[np.int64]
    upper: NDArray[np.int64]
    weight: Array
    inside: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Axis:
    """Coordinates along one dimension.

    Parameters
    ----------
    values : (k,) array
        Strictly increasing or strictly decreasing coordinates, as in the file.
    longest : float
        Longest interval between two values; positions in longer intervals are outside.
    """

    values: Array
    longest: float = np.inf

    def cells(self, positions: Array) -> Cells:
        """Neighbours of each position ``(n,)``; positions beyond an end are outside, the ends themselves inside."""
        return _cells(self.values, positions, self.longest)


@dataclass(frozen=True, eq=False)
class LongitudeAxis:
    """Longitudes (degree) on any branch; those around the globe are periodic.

    Parameters
    ----------
    values : (k,) array
        Longitudes as in the file: 0 to 360, -180 to 180, with a jump at the antimeridian, or those on both sides of it
        in ascending order, with a jump of nearly a full circle in between.
    """

    values: Array

    def cells(self, positions: Array) -> Cells:
        """Neighbours of each position ``(n,)``, on any branch."""
        unwrapped = self.unwrapped
        closed = np.append(unwrapped, unwrapped[0] + np.sign(self._spacing) * FULL_CIRCLE) if self.closes else unwrapped
        middle = 0.5 * (closed[0] + closed[-1])
        cells = _cells(closed, positions - FULL_CIRCLE * np.round((positions - middle) / FULL_CIRCLE), np.inf)
        lower, upper = ((index + self._first) % len(self.values) for index in (cells.lower, cells.upper))
        return Cells(lower, upper, cells.weight, cells.inside)

    @property
    def unwrapped(self) -> Array:
        """Values ``(k,)`` from the first one on, without the jump at the antimeridian."""
        return np.unwrap(np.roll(self.values, -self._first), period=FULL_CIRCLE)

    @property
    def _first(self) -> int:
        """Index of the first value; not zero if the file begins in the middle, at the antimeridian."""
        jumps = np.abs(np.diff(self.values))
        if not is_monotone(self.values) or not jumps.size or jumps.max() < 0.5 * FULL_CIRCLE:
            return 0
        return int(jumps.argmax()) + 1

    @property
    def closes(self) -> bool:
        """Return whether the longitudes go around the globe, with the last value one spacing before the first."""
        if len(self.values) < 2:
            return False
        span = abs(self.unwrapped[-1] - self.unwrapped[0])
        return bool(abs(span + abs(self._spacing) - FULL_CIRCLE) < _CIRCLE_TOLERANCE * abs(self._spacing))

    @property
    def _spacing(self) -> float:
        unwrapped = self.unwrapped
        return float((unwrapped[-1] - unwrapped[0]) / (len(unwrapped) - 1))


def is_monotone(values: Array) -> bool:
    """Return whether values ``(k,)`` are strictly increasing or strictly decreasing."""
    steps = np.diff(values)
    return bool(np.isfinite(values).all() and ((steps > 0.0).all() or (steps < 0.0).all()))


def _cells(values: Array, positions: Array, longest: float) -> Cells:
    count = len(values)
    falling = count > 1 and values[-1] < values[0]
    rising = values[::-1] if falling else values
    lower = np.clip(np.searchsorted(rising, positions, side="right") - 1, 0, max(count - 2, 0))
    upper = np.minimum(lower + 1, count - 1)
    width = rising[upper] - rising[lower]
    weight = np.divide(positions - rising[lower], width, out=np.zeros(len(positions)), where=width > 0.0)
    inside = (positions >= rising[0]) & (positions <= rising[-1])
    inside &= (width <= longest) | (weight == 0.0) | (weight == 1.0)
    if falling:
        lower, upper = count - 1 - lower, count - 1 - upper
    return Cells(lower.astype(np.int64), upper.astype(np.int64), weight, inside)


@dataclass(frozen=True, eq=False)
class ModelFile:
    """An open file of an ocean model, whose velocities are read a box at a time.

    Attributes
    ----------
    label : str
        Name of the file, or URL without a password, as used in messages and the archive.
    product : str
        Name in `PRODUCTS`, or the file's stem.
    dataset : xarray.Dataset
        Lazily opened file.
    components : tuple of (str, float)
        Variables of the north and the east component, and their factors to m/s.
    dims : tuple of str
        Names of the dimensions time, depth, latitude, longitude.
    time : (t,) datetime64 array
        Times of the fields.
    depth : Axis
        Depths, m, positive down.
    latitude : Axis
        Latitudes, degree.
    longitude : LongitudeAxis
        Longitudes, degree.
    """

    label: str
    product: str
    dataset: xr.Dataset
    components: tuple[tuple[str, float], ...]
    dims: tuple[str, ...]
    time: NDArray[Any]
    depth: Axis
    latitude: Axis
    longitude: LongitudeAxis

    def read(self, *box: slice) -> Array:
        """Read velocities in a box.

        Parameters
        ----------
        *box : slice
            Slices along time, depth, latitude, longitude.

        Returns
        -------
        (t, d, j, i, 2) array
            North and east components, m/s; NaN on land and below the bottom.

        Raises
        ------
        InputError
            The file was cut short, or the server does not answer.
        """
        where = dict(zip(self.dims, box, strict=True))
        parts = []
        for name, factor in self.components:
            lazy = self.dataset[name].isel(where)
            try:
                loaded = lazy.transpose(*self.dims).values
            except (OSError, RuntimeError, ValueError) as error:
                raise InputError(f"{self.label}: {name} cannot be read ({first_line(error)})") from error
            parts.append(factor * loaded.astype(np.float64))
        return np.stack(parts, axis=-1)


@contextmanager
def open_model_file(source: str) -> Iterator[ModelFile]:
    """Open a file or an OPeNDAP URL of an ocean model, and identify its variables and axes.

    Raises
    ------
    InputError
        The source cannot be opened, or has no horizontal velocity of sea water on a regular grid of time, depth,
        latitude and longitude.
    """
    label = without_password(source)
    if not is_url(source) and not Path(source).exists():
        raise InputError(f"{label}: no such file")
    try:
        # Times are not decoded here: one auxiliary variable with an invalid unit (HYCOM's `tau`, in "hours since
        # analysis") would make the whole file unreadable. Only the time axis is decoded, below.
        dataset = xr.open_dataset(source, decode_times=False, cache=False)
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        raise InputError(f"{label}: cannot be opened as netCDF ({first_line(error)})") from error
    with dataset:
        yield _identify(label, Path(urlsplit(source).path).stem, dataset)


def is_url(source: str) -> bool:
    """Return whether a model's source is an address, as opposed to a file."""
    return "://" in source


def without_password(source: str) -> str:
    """Remove user and password from a source's address."""
    if not is_url(source):
        return source
    parts = urlsplit(source)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def product_of(attributes: dict[str, Any], stem: str) -> str:
    """Name of the product from a file's global attributes, or the file's stem if they name none."""
    text = " ".join(str(attributes.get(name, "")) for name in _TEXTS).lower()
    known = (product for product, words in PRODUCTS if any(word in text for word in words))
    return next(known, stem)


def _identify(label: str, stem: str, dataset: xr.Dataset) -> ModelFile:
    names = [_component_name(label, dataset, standard) for standard in COMPONENTS]
    dims = _dims(label, dataset, names[0])
    if sorted(map(str, dataset[names[1]].dims)) != sorted(dims):
        raise InputError(f"{label}: {names[0]} and {names[1]} do not have the same dimensions")
    time, depth, latitude, longitude = dims
    return ModelFile(
        label=label,
        product=product_of({str(key): value for key, value in dataset.attrs.items()}, stem),
        dataset=dataset,
        components=tuple((name, factor_of(label, dataset[name], "m s-1")) for name in names),
        dims=dims,
        time=times_of(label, dataset[time].variable, time),
        depth=Axis(_monotone(label, depth, downward(dataset[depth]) * _coordinate(label, dataset[depth], "m"))),
        latitude=Axis(_monotone(label, latitude, _coordinate(label, dataset[latitude], "degree"))),
        longitude=_longitudes(label, dataset[longitude]),
    )


def _component_name(label: str, dataset: xr.Dataset, standard: str) -> str:
    name = velocity_name(dataset, standard, (len(ROLES),))
    if name is None:
        raise InputError(
            f"{label}: has no {standard} on time, depth, latitude and longitude; give a file of an ocean model "
            "with both horizontal velocities"
        )
    return name


def _dims(label: str, dataset: xr.Dataset, name: str) -> tuple[str, ...]:
    """Dimensions of a velocity in the order time, depth, latitude, longitude."""
    by_role: dict[str, str] = {}
    for dim in map(str, dataset[name].dims):
        if dim not in dataset.coords and dim not in dataset.variables:
            raise InputError(f"{label}: dimension {dim} of {name} has no coordinate; a regular grid is needed")
        role = role_of(dataset[dim])
        if role is not None:
            by_role[role] = dim
    lacking = [role for role in ROLES if role not in by_role]
    if lacking:
        raise InputError(f"{label}: {name} has no axis of {' and '.join(lacking)}; a regular grid is needed")
    return tuple(by_role[role] for role in ROLES)


def _longitudes(label: str, coordinate: xr.DataArray) -> LongitudeAxis:
    axis = LongitudeAxis(_coordinate(label, coordinate, "degree"))
    _monotone(label, str(coordinate.name), axis.unwrapped)
    return axis


def _coordinate(label: str, coordinate: xr.DataArray, unit: str) -> Array:
    if coordinate.size == 0:
        raise InputError(f"{label}: {coordinate.name} is empty")
    return np.asarray(factor_of(label, coordinate, unit) * coordinate.values.astype(np.float64))


def _monotone(label: str, name: str, values: Array) -> Array:
    if not is_monotone(values):
        raise InputError(f"{label}: {name} is not monotonic; a regular grid is needed")
    return values
