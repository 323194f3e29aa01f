"""The archive's schema: elements, groups of the mission and of the studies, and chunks.

The groups are listed in text tables with one line for each variable: ``mission.txt`` and ``studies.txt``. Creation,
writing, checks and ``docs/archive-variables.md`` are derived from them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Literal, cast

from zarr.codecs import BloscCodec, Crc32cCodec

from gliderhpc.vocabulary import (
    CHANNELS,
    COMPONENTS,
    HULL_PARAMETERS,
    NOISE_ASSUMPTIONS,
    PHASES,
    QUALITY,
    STATES,
    Flags,
)

SCHEMA_NAME = "gliderhpc-mission"
"""Root attribute ``schema``, which identifies an archive of this program."""

SCHEMA_VERSION = "1.9"
"""Root attribute ``schema_version``: the first number changes when old readers can no longer follow."""

CONVENTIONS = "CF-1.11"

TIME_UNITS = "seconds since 1970-01-01T00:00:00Z"

PROFILE = "profile"

COMMITS = "commits"
"""Group of the commit markers."""

COMPLETE = "complete"
"""Attribute of a study's group: true once the study is finished."""

DIGESTS = "chunk_digests"
"""Attribute of a study's group: digest of every chunk of its tables."""

MANIFEST = "manifest"
"""Variable of every study that has rows: digests of the chunks of each profile's rows."""

Dtype = Literal["float32", "float64", "int64", "int32", "int8", "uint8", "string"]


@dataclass(frozen=True)
class ArchiveVariable:
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
        True if `fill` means missing (CF ``_FillValue``; integers then decode to floats).
    flags : Flags, optional
        Meanings of the values of a flag variable.
    attributes : mapping
        Further attributes.
    whole : bool
        True for a variable of several dimensions that is one chunk, written for all profiles at once by one writer.
    labels : tuple of str, optional
        Values of a coordinate of text that is the same in every archive.
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
    labels: tuple[str, ...] | None = None

    @property
    def is_table(self) -> bool:
        """Return whether it is a column of a table, written by one writer: one value, or a few, for each profile."""
        return self.dims == (PROFILE,) or (self.whole and self.dims[0] == PROFILE)

    @property
    def is_row(self) -> bool:
        """Return whether it holds a row for each profile, in separate chunks that the profile's worker writes."""
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
    variables: tuple[ArchiveVariable, ...]

    def __getitem__(self, name: str) -> ArchiveVariable:
        """Return the variable called `name`."""
        for variable in self.variables:
            if variable.name == name:
                return variable
        raise KeyError(f"the archive's group '{self.name}' has no variable '{name}'")

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of its variables, in order of appearance."""
        return tuple(dict.fromkeys(dim for variable in self.variables for dim in variable.dims))

    @property
    def label_sizes(self) -> dict[str, int]:
        """Sizes of the dimensions whose labels are the same in every archive."""
        return {v.name: len(v.labels) for v in self.variables if v.labels is not None}


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
"""Values of a profile's `buoyancy`: computed from the hull's depth slope, or from density and compressibility."""

_FLAGS = {
    "QUALITY": QUALITY,
    "OUTCOME": OUTCOME,
    "DISTURBANCE_PRIOR": DISTURBANCE_PRIOR,
    "BUOYANCY": BUOYANCY,
    "YES_NO": Flags("flag_values", {"no": 0, "yes": 1}),
}
"""Flags by their names in the tables."""


_LABELS = {
    "HULL_PARAMETERS": HULL_PARAMETERS,
    "NOISE_ASSUMPTIONS": NOISE_ASSUMPTIONS,
    "PHASES": PHASES,
    "CHANNELS": tuple(CHANNELS),
    "COMPONENTS": COMPONENTS,
    "QUANTITIES": (*STATES, *CHANNELS),
}
"""Labels along a dimension by their names in the tables."""


def _read_schema(file: str) -> Schema:
    """Read the groups of the schema from a text table."""
    groups: list[tuple[str, str, list[ArchiveVariable]]] = []
    for line in (resources.files(__package__) / file).read_text("utf-8").splitlines():
        if line.startswith("["):
            name, _, title = line.removeprefix("[").partition("] ")
            groups.append((name, title, []))
        elif line and not line.startswith("#"):
            groups[-1][2].append(_read_variable(line))
    return Schema(SCHEMA_VERSION, tuple(Group(name, title, tuple(variables)) for name, title, variables in groups))


def _read_variable(line: str) -> ArchiveVariable:
    """Read a line of a table: name, dimensions, type, unit, long name, and optionally CF standard name and options."""
    cells = [cell.strip() for cell in line.split("|")]
    name, dims, dtype, units, long_name, standard_name, options = (*cells, "", "")[:7]
    attributes = dict(option.partition("=")[::2] for option in options.split("; ") if option)
    missing, fill = attributes.pop("missing", None), attributes.pop("fill", None)
    whole, flags, labels = (attributes.pop(option, None) for option in ("whole", "flags", "labels"))
    return ArchiveVariable(
        name,
        tuple(dims.split()),
        cast("Dtype", dtype),
        units,
        long_name,
        standard_name or None,
        fill=fill if missing is None else int(missing),
        masked=missing is not None,
        flags=None if flags is None else _FLAGS[flags],
        attributes=attributes,
        whole=whole is not None,
        labels=None if labels is None else _LABELS[labels],
    )


MISSION = _read_schema("mission.txt")
"""Groups of every mission's archive."""

STUDIES = _read_schema("studies.txt")
"""Groups that studies may add."""


def check_manifests(studies: Iterable[Group]) -> None:
    """Check that every study with a row for each profile declares the variable for the digests of these rows.

    Raises
    ------
    ValueError
        A study does not; the message gives the line that it needs.
    """
    for group in studies:
        rows = [variable.name for variable in group.variables if variable.is_row]
        if rows and all(variable.name != MANIFEST for variable in group.variables):
            raise ValueError(
                f"studies.txt, [{group.name}]: {', '.join(rows)} has a row for each profile, so the group needs the "
                f"line '{MANIFEST} | {PROFILE} | string | 1 | digests of the chunks of the profile's rows, as JSON'"
            )


check_manifests(STUDIES)


def _described(group: str, names: str) -> dict[str, tuple[str, str]]:
    return {name: (MISSION[group][name].units, MISSION[group][name].long_name) for name in names.split()}


MOTION = _described("state", "X Y u v w p q r")
"""Track and velocities of the reconstruction: unit and name."""

CONTROLS = _described("observed", "battery_position battery_rotation ballast_volume rudder")
"""The recorded controls: unit and name."""

SEAWATER = _described("observed", "water_density water_temperature water_pressure")
"""The seawater along the record, where the buoyancy follows it: unit and name."""


def study_called(name: str) -> Group:
    """Return a study's group.

    Raises
    ------
    KeyError
        No study writes a group of that name.
    """
    return STUDIES[name]


def group_called(name: str) -> Group:
    """Return a group of the mission's or of the studies' schema, with the variables of both where they share it.

    Raises
    ------
    KeyError
        There is no group of that name.
    """
    groups = [group for group in (*MISSION, *STUDIES) if group.name == name]
    if not groups:
        raise KeyError(f"the archive has no group '{name}'")
    return Group(name, groups[0].title, tuple(variable for group in groups for variable in group.variables))


def is_shared(study: Group) -> bool:
    """Return whether a study adds its variables to one of the mission's groups, which outlives the study."""
    return any(group.name == study.name for group in MISSION)


CODECS = (BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"), Crc32cCodec())
"""Codecs of the chunks: byte shuffling compresses times and slowly varying series several times better than zstd alone,
and the checksum lets any reader detect a damaged chunk."""

CHUNK_KEYS: dict[str, Any] = {"name": "default", "separator": "."}
"""Chunk keys with a dot: all chunks of a variable are files in its folder; with a slash, there would be subfolders."""


def chunks(group: Group, variable: ArchiveVariable, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the chunk shape of a variable: one profile for rows and commits, else the whole array."""
    if variable.dims == (variable.name,) or variable.whole:
        return shape
    if variable.dims[0] == PROFILE and (len(shape) > 1 or group.name == COMMITS):
        return (1, *shape[1:])
    return shape
