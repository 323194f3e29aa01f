"""Comparison of an archive with the schema: groups, variables, metadata and coordinates."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import zarr

from gliderhpc.errors import InputError, first_line
from gliderhpc.store_schema.commits import UNREADABLE
from gliderhpc.store_schema.consolidation import stored_metadata, without_members
from gliderhpc.store_schema.location import CONSOLIDATED, Location, describe_other, group_at, is_archive, store_at
from gliderhpc.store_schema.schema import (
    CHUNK_KEYS,
    CODECS,
    COMPLETE,
    MISSION,
    PROFILE,
    STATUS,
    STUDIES,
    ArchiveVariable,
    Group,
    chunks,
    group_called,
    is_shared,
)

Arrays = dict[str, zarr.Array[Any]]

DESCRIPTION = "long_name"
"""Attribute that describes an array in words."""


def check_archive(location: Location) -> list[str]:
    """List the differences between an archive and the schema; a study that has not been run is not a difference.

    Parameters
    ----------
    location : str or Path
        The archive.

    Returns
    -------
    list of str
        One line for each difference, with group, variable and deviation; empty if the archive conforms.

    Raises
    ------
    InputError
        There is no archive of gliderhpc.
    """
    root, as_written = _with_members(location)
    differences = list(_structure_differences(location, root, STUDIES, as_written))
    return differences if _other_version(root) else [*differences, *_content_differences(root)]


def structure_differences(location: Location, studies: bool = True) -> list[str]:
    """List only the differences of the metadata, with or without those of studies, which no resumed run can repair.

    Raises
    ------
    InputError
        There is no archive of gliderhpc.
    """
    root, as_written = _with_members(location)
    return list(_structure_differences(location, root, STUDIES if studies else (), as_written))


def other_version(location: Location) -> str:
    """Return a message if an archive was made with another version of the schema, else an empty text.

    Raises
    ------
    InputError
        There is no archive of gliderhpc.
    """
    return _other_version(_opened(location))


def version_note(location: Location) -> str:
    """Return what can be done with an archive of another minor version of the schema; empty for any other archive.

    Raises
    ------
    InputError
        There is no archive of gliderhpc.
    """
    version = str(_opened(location).attrs.get("schema_version"))
    if version == MISSION.version or version.partition(".")[0] != MISSION.version.partition(".")[0]:
        return ""
    return (
        f"the archive has schema version {version}, and this program's is {MISSION.version}: it can be opened, studied "
        "and reported, but not resumed or appended to"
    )


def _other_version(root: zarr.Group) -> str:
    version = root.attrs.get("schema_version")
    if version == MISSION.version:
        return ""
    return (
        f"schema_version is {version!r}, but this program's is '{MISSION.version}'; use the version of gliderhpc that "
        "made it, or run the mission again"
    )


def _opened(location: Location) -> zarr.Group:
    if not is_archive(location):
        raise InputError(describe_other(location))
    return group_at(location)


def _with_members(location: Location) -> tuple[zarr.Group, bool]:
    """Open an archive, and return whether its consolidated metadata equals that of every group and variable.

    If it does, the members are read from it, in half the time of opening each of them separately.
    """
    root = _opened(location)
    if not is_consolidated(location):
        return root, False
    try:
        return zarr.open_group(store_at(location, read_only=True), mode="r", use_consolidated=True), True
    except UNREADABLE:
        return root, True


def _structure_differences(
    location: Location, root: zarr.Group, studies: Iterable[Group], as_written: bool
) -> Iterator[str]:
    if other := _other_version(root):
        yield f"/: {other}"
        return
    for group in MISSION:
        node = root if group.name == "/" else _member(root, group.name)
        if isinstance(node, zarr.Group):
            yield from _group_differences(node, group, as_written)
        else:
            yield f"{group.name}: {node or 'the group is missing'}"
    for study in studies:
        node = _member(root, study.name)
        if isinstance(node, zarr.Group):
            if not is_shared(study) or COMPLETE in node.attrs:
                yield from _study_differences(node, study, as_written)
        elif node is not None:
            yield f"{study.name}: {node}"
    if studies and not as_written:
        yield from _consolidated_differences(location, root)


def _study_differences(node: zarr.Group, group: Group, as_written: bool) -> Iterator[str]:
    if not node.attrs.get(COMPLETE, False):
        yield f"{group.name}: the study was interrupted; run it again"
    yield from _group_differences(node, group, as_written)


def _group_differences(node: zarr.Group, group: Group, as_written: bool) -> Iterator[str]:
    arrays, unreadable = _arrays(node, group)
    known = {variable.name for variable in group_called(group.name).variables}
    yield from (f"{group.name}/{name}: not in the schema" for name in sorted(set(arrays) - known))
    yield from (f"{group.name}/{name}: the metadata cannot be read ({why})" for name, why in unreadable.items())
    sizes = {name: array.shape[0] for name, array in arrays.items() if array.ndim == 1 and name in group.dims}
    for variable in group.variables:
        if variable.name in arrays:
            label, array = f"{group.name}/{variable.name}", arrays[variable.name]
            differences = variable_differences(array, group, variable, sizes, as_written)
            yield from (f"{label}: {text}" for text in differences)
        elif variable.name not in unreadable:
            yield f"{group.name}/{variable.name}: the variable is missing"


def variable_differences(
    array: zarr.Array[Any], group: Group, variable: ArchiveVariable, sizes: dict[str, int], as_written: bool
) -> Iterator[str]:
    """Yield the differences between an array's metadata and its variable in the schema, given the dimensions' sizes.

    Versions of the program with the same schema may word a description differently. Where the consolidated metadata
    repeats the array's, the description is as it was written, and its wording is not a difference.
    """
    dims = tuple(getattr(array.metadata, "dimension_names", None) or ())
    if dims != variable.dims:
        yield f"dimensions are {dims}, not {variable.dims}"
        return
    shape = tuple(sizes.get(dim, -1) for dim in dims)
    if -1 not in shape and array.shape != shape:
        yield f"shape is {array.shape}, but its coordinates have {shape}"
    if not _chunks_fit(array, group, variable):
        yield f"chunks are {array.chunks}, not {chunks(group, variable, array.shape)}"
    if _settings_of(array.compressors) != _settings_of(CODECS):
        yield f"codecs are {_named(array.compressors)}, not {_named(CODECS)}"
    if array.metadata.to_dict().get("chunk_key_encoding") != {
        "name": CHUNK_KEYS["name"],
        "configuration": {"separator": CHUNK_KEYS["separator"]},
    }:
        yield "chunks are not named as in the schema"
    if _dtype_name(array) != variable.dtype:
        yield f"dtype is {_dtype_name(array)}, not {variable.dtype}"
    elif not _is_equal(array.fill_value, variable.fill_value):
        yield f"fill value is {array.fill_value}, not {variable.fill_value}"
    stored, expected = dict(array.attrs), variable.all_attributes()
    if as_written and DESCRIPTION in stored:
        del expected[DESCRIPTION]
    yield from _attribute_differences(stored, expected)


def _chunks_fit(array: zarr.Array[Any], group: Group, variable: ArchiveVariable) -> bool:
    """Return whether chunks have the schema's shape; rows that have grown continue in further chunks."""
    if variable.is_row:
        return array.chunks[0] == 1 and array.chunks[1:] <= array.shape[1:]
    return array.chunks == chunks(group, variable, array.shape)


def _attribute_differences(stored: dict[str, Any], expected: dict[str, Any]) -> Iterator[str]:
    for name, value in expected.items():
        if name not in stored:
            yield f"attribute {name} is missing"
        elif stored[name] != value:
            yield f"attribute {name} is {stored[name]!r}, not {value!r}"


def _consolidated_differences(location: Location, root: zarr.Group) -> Iterator[str]:
    """Yield the differences between the consolidated metadata and that of groups and variables."""
    try:
        consolidated = _members(zarr.open_group(store_at(location, read_only=True), mode="r", use_consolidated=True))
    except UNREADABLE:
        yield "/: the consolidated metadata is missing or damaged"
        return
    try:
        members = _members(root)
    except UNREADABLE:
        return  # reported by name in the comparison of the groups with the schema
    for name in members.keys() - consolidated.keys():
        yield f"{name}: not in the consolidated metadata"
    for name in consolidated.keys() - members.keys():
        yield f"{name}: in the consolidated metadata, but not in the archive"
    for name in sorted(members.keys() & consolidated.keys()):
        if members[name] != consolidated[name]:
            yield f"{name}: the consolidated metadata differs from its own"


def is_consolidated(location: Location) -> bool:
    """Return whether the consolidated metadata equals that of every group and variable; False without a root."""
    try:
        members = stored_metadata(store_at(location, read_only=True))
        consolidated = members.pop("")[CONSOLIDATED]["metadata"]
        return members.keys() == consolidated.keys() and all(
            without_members(consolidated[path]) == without_members(members[path]) for path in members
        )
    except (*UNREADABLE, AttributeError, FileNotFoundError):
        return False


def _members(root: zarr.Group) -> dict[str, Any]:
    """Return the metadata of all groups and arrays below the root, by path."""
    return {
        name: member.metadata.to_dict() if isinstance(member, zarr.Array) else dict(member.attrs)
        for name, member in root.members(max_depth=None)
    }


def _content_differences(root: zarr.Group) -> Iterator[str]:
    numbers = _values(root, PROFILE)
    for group in (*MISSION, *STUDIES):
        node = root if group.name == "/" else _member(root, group.name)
        if isinstance(node, zarr.Group):
            yield from _coordinate_differences(node, group, numbers)
    yield from _status_differences(root)


def _coordinate_differences(node: zarr.Group, group: Group, numbers: Any) -> Iterator[str]:
    for variable in group.variables:
        if variable.dims != (variable.name,) or (variable.dtype == "string" and variable.labels is None):
            continue
        values = _values(node, variable.name)
        label = f"{group.name}/{variable.name}"
        if values is None:
            continue
        if isinstance(values, str):
            yield f"{label}: {values}"
        elif variable.labels is not None:
            if tuple(values) != variable.labels:
                yield f"{label}: its labels differ from those of the schema"
        elif variable.name != PROFILE:
            if not np.array_equal(values, np.arange(len(values))):
                yield f"{label}: does not count from 0"
        elif group.name == "/":
            if (np.diff(values) <= 0).any():
                yield f"{label}: the profiles' numbers do not increase"
        elif not isinstance(numbers, str) and not np.array_equal(values, numbers):
            yield f"{label}: the profiles' numbers differ from those of the root"


def _status_differences(root: zarr.Group) -> Iterator[str]:
    values = _values(root, "status")
    if isinstance(values, str):
        yield f"/status: {values}"
    elif values is not None and values.dtype.kind in "TOU":
        for index, value in enumerate(values):
            if value not in STATUS:
                yield f"/status: entry {index} is '{value}', not one of {', '.join(STATUS)}"


def _member(node: zarr.Group, name: str) -> Any:
    """Return a member of a group, None where there is none, and a string where it cannot be read."""
    try:
        return node.get(name)
    except UNREADABLE as error:
        return f"the metadata cannot be read ({first_line(error)})"


def _arrays(node: zarr.Group, group: Group) -> tuple[Arrays, dict[str, str]]:
    """Open a group's arrays; return those that are readable, and the errors of the others."""
    try:
        return dict(node.arrays()), {}
    except UNREADABLE:
        members = {variable.name: _member(node, variable.name) for variable in group.variables}
    return (
        {name: member for name, member in members.items() if isinstance(member, zarr.Array)},
        {name: member for name, member in members.items() if isinstance(member, str)},
    )


def _values(node: zarr.Group, name: str) -> Any:
    """Return an array's values, None where there is no such array, and a string where they cannot be read."""
    array = _member(node, name)
    if not isinstance(array, zarr.Array):
        return None
    try:
        return np.asarray(array[:])
    except UNREADABLE as error:
        return f"the values cannot be read ({first_line(error)})"


def _settings_of(codecs: tuple[Any, ...]) -> list[dict[str, Any]]:
    """Return the configuration of codecs without the width of the numbers, which they take from the array."""
    codecs_as_dicts = [codec.to_dict() for codec in codecs]
    return [
        {**codec, "configuration": {**codec.get("configuration", {}), "typesize": None}} for codec in codecs_as_dicts
    ]


def _named(codecs: tuple[Any, ...]) -> str:
    return ", ".join(str(codec.to_dict()["name"]) for codec in codecs) or "none"


def _dtype_name(array: zarr.Array[Any]) -> str:
    return "string" if array.dtype.kind in "TOU" else array.dtype.name


def _is_equal(stored: Any, expected: Any) -> bool:
    if isinstance(expected, float) and math.isnan(expected):
        return bool(np.isnan(stored))
    return bool(stored == expected)
