"""Maintenance of an existing archive: growth for new profiles, and repair of damaged metadata from the schema.

Repair rewrites metadata only; the chunks are verified by their digests.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from zarr.core.buffer import default_buffer_prototype
from zarr.storage import StorePath

from gliderhpc.errors import InputError
from gliderhpc.store_schema.check import is_consolidated, variable_differences
from gliderhpc.store_schema.commits import UNREADABLE, label_of, readable_arrays
from gliderhpc.store_schema.consolidation import consolidate
from gliderhpc.store_schema.create import create_variable, mission_sizes
from gliderhpc.store_schema.location import (
    ROOT,
    Location,
    group_at,
    is_archive,
    is_empty,
    root_metadata,
    store_at,
    stored_bytes,
    wait_for,
    wait_for_all,
)
from gliderhpc.store_schema.rows import read_profiles
from gliderhpc.store_schema.schema import (
    COMMITS,
    COMPLETE,
    CONVENTIONS,
    DIGESTS,
    MISSION,
    PROFILE,
    SCHEMA_NAME,
    STUDIES,
    ArchiveVariable,
    Group,
    chunks,
)
from gliderhpc.store_schema.study_groups import has_study, studies_in, table_damages, table_digests

OUTDATED = "outdated"
"""Attribute of a study's group that describes the change of the archive that made it outdated."""


def grow_archive(location: Location, profiles: Sequence[int], sizes: Mapping[str, int]) -> None:
    """Extend an archive for the profiles of a grown observation file; existing data are unchanged.

    Longer rows continue in further chunks. An interrupted extension is completed by another call.

    Parameters
    ----------
    location : str or Path
        The archive.
    profiles : sequence of int
        Numbers of all profiles, the existing ones first.
    sizes : mapping of str to int
        Minimum sizes of the mission's dimensions.

    Raises
    ------
    InputError
        The profiles do not continue the archive's.
    """
    existing = read_profiles(location)
    check_continuation(location, existing, profiles)
    present_sizes = mission_sizes(location)
    new_sizes = {dim: max(size, sizes.get(dim, 0)) for dim, size in present_sizes.items()} | {PROFILE: len(profiles)}
    if new_sizes == present_sizes | {PROFILE: len(existing)}:
        return
    root = group_at(location, writable=True)
    for study, study_node in studies_in(root):
        _grow_study(location, study_node, study, new_sizes, profiles)
    for group in reversed(MISSION.groups):
        node = root if group.name == "/" else root[group.name]
        if isinstance(node, zarr.Group):
            _grow_group(node, group, new_sizes, profiles)
    consolidate(location)


def check_continuation(location: Location, existing: Sequence[int], profiles: Sequence[int]) -> None:
    """Check that profiles continue the existing ones of an archive.

    Raises
    ------
    InputError
        They do not.
    """
    if list(profiles[: len(existing)]) != list(existing):
        raise InputError(
            f"{location}: the chosen profiles do not begin with those of the archive; append only adds profiles after "
            f"number {existing[-1]}; otherwise use `overwrite=True`"
        )


def mark_studies_outdated(location: Location, reason: str) -> None:
    """Mark every study's group as outdated by a change of the archive."""
    root = group_at(location, writable=True)
    for _, node in studies_in(root):
        node.attrs[OUTDATED] = reason


def _grow_study(
    location: Location, node: zarr.Group, group: Group, sizes: Mapping[str, int], profiles: Sequence[int]
) -> None:
    """Grow a study; it is marked incomplete in the meantime, and permanently if its tables are damaged."""
    was_complete = bool(node.attrs.get(COMPLETE)) and not table_damages(location, group)
    node.attrs[COMPLETE] = False
    _grow_group(node, group, sizes, profiles)
    node.attrs.update({DIGESTS: table_digests(location, group), COMPLETE: was_complete})


def _grow_group(node: zarr.Group, group: Group, sizes: Mapping[str, int], profiles: Sequence[int]) -> None:
    """Grow a group's arrays, its coordinates after the others, and its profiles' numbers last."""
    arrays = [_Growth(node.store_path / each.name, group, each, sizes, profiles) for each in group.variables]
    wait_for_all(array.grow() for array in arrays if not array.is_coordinate)
    for array in reversed(arrays):
        if array.is_coordinate:
            wait_for(array.grow())


@dataclass(frozen=True)
class _Growth:
    """Growth of an array: its metadata is written again and, if it is one chunk, its values.

    Creating the arrays again, or having zarr change their shapes, takes five times as long.
    """

    place: StorePath
    group: Group
    variable: ArchiveVariable
    sizes: Mapping[str, int]
    profiles: Sequence[int]

    @property
    def is_coordinate(self) -> bool:
        return self.variable.dims == (self.variable.name,)

    async def grow(self) -> None:
        content = await stored_bytes(self.place.store, self._key)
        if content is None:
            raise KeyError(self.place.path)
        metadata = json.loads(content)
        before = tuple(metadata["shape"])
        shape = tuple(self.sizes.get(dim, size) for dim, size in zip(self.variable.dims, before, strict=True))
        if shape == before:
            return
        stored, metadata["shape"] = dict(metadata), list(shape)
        if self.variable.is_row or (self.group.name == COMMITS and self.variable.name != PROFILE):
            await self._write(metadata)
            return
        values = await self._values(zarr.AsyncArray.from_dict(self.place, stored), shape)
        one_chunk = {"chunk_shape": list(chunks(self.group, self.variable, shape))}
        metadata["chunk_grid"] = metadata["chunk_grid"] | {"configuration": one_chunk}
        await self._write(metadata)
        await zarr.AsyncArray.from_dict(self.place, metadata).setitem(..., values)

    @property
    def _key(self) -> str:
        return f"{self.place.path}/{ROOT}"

    async def _write(self, metadata: Mapping[str, Any]) -> None:
        text = json.dumps(metadata, indent=zarr.config.get("json_indent"))
        await self.place.store.set(self._key, default_buffer_prototype().buffer.from_bytes(text.encode()))

    async def _values(self, array: zarr.AsyncArray[Any], shape: tuple[int, ...]) -> Any:
        """Return the values of the grown array: those before, or fill values where they are damaged."""
        if self.is_coordinate:
            return np.array(self.profiles) if self.variable.name == PROFILE else np.arange(shape[0])
        values = np.full(shape, self.variable.fill_value, dtype=array.dtype)
        with suppress(*UNREADABLE):  # A mission's table is rewritten from the commits.
            values[tuple(map(slice, array.shape))] = await array.getitem(...)
        return values


Arrays = dict[str, zarr.Array[Any]]


def mend_metadata(location: Location) -> list[str]:
    """Rewrite damaged or missing metadata of an archive.

    Parameters
    ----------
    location : str or Path
        The archive; nothing is done if too little is left to determine its sizes.

    Returns
    -------
    list of str
        Paths within the archive of the groups and variables with rewritten metadata.

    Raises
    ------
    InputError
        Too little is left of a study's group.
    """
    if is_empty(location) or _is_of_another_version(location):
        return []
    as_written = is_consolidated(location)
    damaged = _damaged(location, list(MISSION), as_written)
    if damaged is None or (damaged and not is_archive(location)):
        return []  # too little is left, or the version of the schema is unknown
    mended = [*_mend_groups(location, list(MISSION)), *_rewrite(location, damaged)]
    for study in STUDIES:
        if not has_study(location, study):
            continue
        damaged = _damaged(location, [study], as_written)
        if damaged is None:
            raise InputError(
                f"{location}: {study.name}: its metadata is damaged beyond what the schema can restore; remove that "
                f"folder and run {study.name} again"
            )
        mended += [*_mend_groups(location, [study]), *_rewrite(location, damaged)]
    return mended


@dataclass(frozen=True)
class _Damaged:
    """A variable whose metadata differs from the schema, with the shapes of the array and of its chunks."""

    group: Group
    variable: ArchiveVariable
    shape: tuple[int, ...]
    chunks: tuple[int, ...]


def _damaged(location: Location, groups: list[Group], as_written: bool) -> list[_Damaged] | None:
    """Find variables with damaged metadata in some groups; None where too little is left to determine their sizes."""
    arrays = readable_arrays(location, [label_of(group.name, v.name) for group in groups for v in group.variables])
    shapes = _Shapes(arrays, groups)
    if not shapes.complete:
        return None
    return [
        _Damaged(group, variable, shapes.of(variable), shapes.chunks_of(group, variable))
        for group in groups
        for variable in group.variables
        if _differs(arrays.get(label_of(group.name, variable.name)), group, variable, shapes, as_written)
    ]


def _rewrite(location: Location, damaged: list[_Damaged]) -> Iterator[str]:
    root = group_at(location, writable=True)
    for array in damaged:
        label = label_of(array.group.name, array.variable.name)
        _delete_metadata(location, label)
        node: Any = root if array.group.name == "/" else root[array.group.name]
        create_variable(node, array.group, array.variable, array.shape, array.chunks)
        yield label


def _is_of_another_version(location: Location) -> bool:
    metadata = root_metadata(location) if is_archive(location) else None
    return metadata is not None and metadata["attributes"].get("schema_version") != MISSION.version


class _Shapes:
    """Sizes of the dimensions and of their chunks, from the majority of the readable arrays."""

    def __init__(self, arrays: Arrays, groups: list[Group]) -> None:
        sizes: dict[str, Counter[int]] = {dim: Counter() for group in groups for dim in group.dims}
        lengths: dict[str, Counter[int]] = {dim: Counter() for dim in sizes}
        for group in groups:
            for variable in group.variables:
                array = arrays.get(label_of(group.name, variable.name))
                if array is None or array.ndim != len(variable.dims):
                    continue
                for dim, size, length in zip(variable.dims, array.shape, array.chunks, strict=True):
                    sizes[dim][size] += 1
                    if variable.is_row:
                        lengths[dim][length] += 1
        self.complete = all(sizes.values())
        self._sizes = {dim: count.most_common(1)[0][0] for dim, count in sizes.items() if count}
        self._lengths = {dim: count.most_common(1)[0][0] for dim, count in lengths.items() if count}

    def of(self, variable: ArchiveVariable) -> tuple[int, ...]:
        return tuple(self._sizes[dim] for dim in variable.dims)

    def chunks_of(self, group: Group, variable: ArchiveVariable) -> tuple[int, ...]:
        whole = chunks(group, variable, self.of(variable))
        if not variable.is_row:
            return whole
        return (1, *(self._lengths.get(dim, size) for dim, size in zip(variable.dims[1:], whole[1:], strict=True)))


def _differs(
    array: zarr.Array[Any] | None, group: Group, variable: ArchiveVariable, shapes: _Shapes, as_written: bool
) -> bool:
    if array is None or array.shape != shapes.of(variable) or array.chunks != shapes.chunks_of(group, variable):
        return True
    sizes = dict(zip(variable.dims, shapes.of(variable), strict=True))
    return any(True for _ in variable_differences(array, group, variable, sizes, as_written))


def _mend_groups(location: Location, groups: list[Group]) -> Iterator[str]:
    store = store_at(location)
    if not is_archive(location):
        _delete_metadata(location, "")
        attributes = {"Conventions": CONVENTIONS, "schema": SCHEMA_NAME, "schema_version": MISSION.version}
        zarr.create_group(store, zarr_format=3, attributes=attributes)
        yield "/"
    for group in groups:
        if group.name == "/":
            continue
        try:
            zarr.open_group(store, path=group.name, mode="r", use_consolidated=False)
        except (*UNREADABLE, FileNotFoundError):
            _delete_metadata(location, group.name)
            study = {} if group in MISSION.groups else {COMPLETE: False}
            zarr.create_group(store, path=group.name, zarr_format=3, attributes={"title": group.title, **study})
            yield group.name


def _delete_metadata(location: Location, label: str) -> None:
    wait_for(store_at(location).delete(f"{label}/zarr.json".lstrip("/")))
