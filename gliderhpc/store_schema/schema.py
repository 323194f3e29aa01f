"""Elements of an archive's schema: variables, groups, flags, and the tables that several groups share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gliderhpc.vocabulary import Flags

SCHEMA_NAME = "gliderhpc-mission"
"""Root attribute ``schema``, which identifies an archive of this program."""

SCHEMA_VERSION = "1.5"
"""Root attribute ``schema_version``: the first number changes when old readers can no longer follow."""

CONVENTIONS = "CF-1.11"

TIME_UNITS = "seconds since 1970-01-01T00:00:00Z"

PROFILE = "profile"

Dtype = Literal["float32", "float64", "int64", "int32", "int8", "uint8", "string"]


@dataclass(frozen=True)
class Variable:
    """Definition of one array of the archive.

    Parameters
    ----------
    name : str
        Name within its group.
    dims : tuple of str
        Names of its dimensions, outermost first.
    dtype : str
        Number type on disk, or ``string``.
    units : str
        UDUNITS string, ``1`` for counts, flags and text.
    long_name : str
        Description.
    standard_name : str, optional
        CF standard name where there is one.
    fill : optional
        Fill value; NaN, 0 or empty text by default.
    masked : bool
        Whether `fill` means missing (CF ``_FillValue``; integers then decode to floats).
    flags : Flags, optional
        Meanings of the values of a flag variable.
    attributes : mapping
        Further attributes.
    whole : bool
        Whether a variable of two dimensions is one chunk, written for all profiles at once by one writer.
    """

    name: str
    dims: tuple[str, ...]
    dtype: Dtype
    units: str
    long_name: str
    standard_name: str | None = None
    fill: float | str | None = None
    masked: bool = False
    flags: Flags | None = None
    attributes: Mapping[str, Any] | None = None
    whole: bool = False

    @property
    def is_table(self) -> bool:
        """Return whether it is a column of a table, filled by one writer: one value, or a few, for each profile."""
        return self.dims == (PROFILE,) or (self.whole and self.dims[0] == PROFILE)

    @property
    def is_row(self) -> bool:
        """Return whether it holds a row for each profile, in chunks of its own that the profile's worker writes."""
        return len(self.dims) > 1 and self.dims[0] == PROFILE and not self.whole

    @property
    def fill_value(self) -> float | str:
        """Fill value."""
        if self.fill is not None:
            return self.fill
        if self.dtype == "string":
            return ""
        return float("nan") if self.dtype.startswith("float") else 0

    @property
    def is_time(self) -> bool:
        """Return whether the values are times, in seconds since 1970."""
        return self.units == TIME_UNITS

    def all_attributes(self) -> dict[str, Any]:
        """Return all attributes of the array on disk."""
        attributes: dict[str, Any] = {"units": self.units, "long_name": self.long_name}
        if self.standard_name is not None:
            attributes["standard_name"] = self.standard_name
        if self.is_time:
            attributes["calendar"] = "proleptic_gregorian"
        if self.masked:
            attributes["_FillValue"] = self.fill_value
        if self.flags is not None:
            attributes |= self.flags.attributes()
        return attributes | dict(self.attributes or {})


@dataclass(frozen=True)
class Group:
    """One group of the archive with its variables; the root is called ``/``."""

    name: str
    title: str
    variables: tuple[Variable, ...]

    def __getitem__(self, name: str) -> Variable:
        """Return the variable called `name`."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise KeyError(f"the archive's group '{self.name}' has no variable '{name}'")

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of its variables, in order of appearance."""
        return tuple(dict.fromkeys(dim for variable in self.variables for dim in variable.dims))


@dataclass(frozen=True)
class Schema:
    """Every group of the archive."""

    version: str
    groups: tuple[Group, ...]

    def __iter__(self) -> Iterator[Group]:
        """Iterate over the groups, root first."""
        return iter(self.groups)

    def __getitem__(self, name: str) -> Group:
        """Return the group called `name`."""
        for group in self.groups:
            if group.name == name:
                return group
        raise KeyError(f"the archive has no group '{name}'")

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions whose sizes belong to the mission, ``profile`` first."""
        return tuple(dict.fromkeys(dim for group in self.groups for dim in group.dims))


STATUS = ("pending", "done", "failed")
"""Values of a profile's `status`."""

OUTCOME = Flags("flag_values", {"converged": 0, "iteration_limit": 1, "stalled": 2, "diverged": 3, "no_data": 4})
"""Values of a window's `outcome`."""

DISTURBANCE_PRIOR = Flags("flag_values", {"usual": 0, "rough_water": 1})
"""Values of a profile's `disturbance_prior`: the hull's usual one, or the one that lets sway and roll follow gusts."""

BUOYANCY = Flags("flag_values", {"depth_slope": 0, "density": 1})
"""Values of a profile's `buoyancy`: by the hull's depth slope, or by density and compressibility."""

YES_NO = Flags("flag_values", {"no": 0, "yes": 1})

MOTION = {
    "X": ("m", "distance north of the start through the water"),
    "Y": ("m", "distance east of the start through the water"),
    "u": ("m s-1", "velocity through the water along the surge axis"),
    "v": ("m s-1", "velocity through the water along the sway axis"),
    "w": ("m s-1", "velocity through the water along the heave axis"),
    "p": ("degree s-1", "angular rate about the roll axis"),
    "q": ("degree s-1", "angular rate about the pitch axis"),
    "r": ("degree s-1", "angular rate about the yaw axis"),
}
"""Track and velocities of the reconstruction: unit and name."""

CONTROLS = {
    "battery_position": ("m", "translation of the moving battery, forward positive"),
    "battery_rotation": ("degree", "rotation of the moving battery"),
    "ballast_volume": ("cm3", "oil in the external bladder, buoyant positive"),
    "rudder": ("degree", "rudder angle"),
}
"""The recorded controls: unit and name."""

SEAWATER = {
    "water_density": ("kg m-3", "in-situ density of the water that the buoyancy goes by", "sea_water_density"),
    "water_temperature": ("degree_Celsius", "in-situ temperature of that water", "sea_water_temperature"),
    "water_pressure": ("dbar", "pressure of that water", "sea_water_pressure"),
}
"""The seawater along the record, where the buoyancy goes by it: unit, name and CF name."""


def profile_coordinate() -> Variable:
    """Return the coordinate of the profiles' numbers, the first variable of every group."""
    return Variable(PROFILE, (PROFILE,), "int64", "1", "number of the profile, from one surfacing to the next")


def index_coordinate(dim: str, long_name: str) -> Variable:
    """Return a coordinate that counts a group's second dimension from 0."""
    return Variable(dim, (dim,), "int64", "1", long_name)


def on_records(table: Mapping[str, tuple[str, str]], on: Mapping[str, Any]) -> tuple[Variable, ...]:
    """Return the variables on the records of a table of unit and name; `on` holds the attribute ``coordinates``."""
    return tuple(
        Variable(name, (PROFILE, "record"), "float32", units, long_name, attributes=on)
        for name, (units, long_name) in table.items()
    )


def of_profile(
    name: str, units: str, long_name: str, standard_name: str | None = None, dtype: Dtype = "float64"
) -> Variable:
    """Return a variable with one value for each profile."""
    return Variable(name, (PROFILE,), dtype, units, long_name, standard_name)
