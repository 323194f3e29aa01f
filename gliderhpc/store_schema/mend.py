"""Writing damaged metadata of an archive again: the schema knows all of it but the sizes, which other arrays have.

Chunks are not touched. Whether they are those that were written is for their digests to say.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import zarr

from gliderhpc.errors import InputError
from gliderhpc.store_schema.check import variable_differences
from gliderhpc.store_schema.commits import UNREADABLE, label_of, readable_arrays
from gliderhpc.store_schema.create import chunks, create_variable
from gliderhpc.store_schema.mission_groups import MISSION
from gliderhpc.store_schema.place import Place, is_archive, is_empty, root_metadata, store_at, wait_for
from gliderhpc.store_schema.schema import CONVENTIONS, SCHEMA_NAME, Group, Variable
from gliderhpc.store_schema.studies import COMPLETE, STUDIES

Arrays = dict[str, zarr.Array[Any]]


def mend_metadata(place: Place) -> list[str]:
    """Write again what of an archive's metadata is damaged or missing.

    Parameters
    ----------
    place : str or Path
        The archive; nothing is done where too little of one is left to know its sizes.

    Returns
    -------
    list of str
        Paths within the archive of the groups and variables whose metadata was written again.

    Raises
    ------
    InputError
        Too little is left of a study's group.
    """
    if is_empty(place) or _is_of_another_version(place):
        return []
    damaged = _damaged(place, list(MISSION))
    if damaged is None or (damaged and not is_archive(place)):
        return []  # too little is left, or nothing says which version's schema it follows
    mended = [*_mend_groups(place, list(MISSION)), *_written_again(place, damaged)]
    for study in STUDIES:
        if wait_for(store_at(place).is_empty(study.name)):
            continue
        damaged = _damaged(place, [study])
        if damaged is None:
            raise InputError(
                f"{place}: {study.name}: its metadata is damaged beyond what the schema tells; remove that folder and "
                f"run {study.name} again"
            )
        mended += [*_mend_groups(place, [study]), *_written_again(place, damaged)]
    return mended


@dataclass(frozen=True)
class _Damaged:
    """A variable whose metadata is not the schema's, and the shapes that it should have."""

    group: Group
    variable: Variable
    shape: tuple[int, ...]
    chunks: tuple[int, ...]


def _damaged(place: Place, groups: list[Group]) -> list[_Damaged] | None:
    """Variables of some groups whose metadata is damaged, None where too little is left to know their sizes."""
    arrays = readable_arrays(place, [label_of(group.name, v.name) for group in groups for v in group.variables])
    shapes = _Shapes(arrays, groups)
    if not shapes.complete:
        return None
    return [
        _Damaged(group, variable, shapes.of(variable), shapes.chunks_of(group, variable))
        for group in groups
        for variable in group.variables
        if _differs(arrays.get(label_of(group.name, variable.name)), group, variable, shapes)
    ]


def _written_again(place: Place, damaged: list[_Damaged]) -> Iterator[str]:
    root = zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
    for one in damaged:
        label = label_of(one.group.name, one.variable.name)
        _delete_metadata(place, label)
        node: Any = root if one.group.name == "/" else root[one.group.name]
        create_variable(node, one.group, one.variable, one.shape, one.chunks)
        yield label


def _is_of_another_version(place: Place) -> bool:
    metadata = root_metadata(place) if is_archive(place) else None
    return metadata is not None and metadata["attributes"].get("schema_version") != MISSION.version


class _Shapes:
    """Sizes of the mission's dimensions and of their chunks, as most of the arrays have them."""

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

    def of(self, variable: Variable) -> tuple[int, ...]:
        return tuple(self._sizes[dim] for dim in variable.dims)

    def chunks_of(self, group: Group, variable: Variable) -> tuple[int, ...]:
        whole = chunks(group, variable, self.of(variable))
        if not variable.is_row:
            return whole
        return (1, *(self._lengths.get(dim, size) for dim, size in zip(variable.dims[1:], whole[1:], strict=True)))


def _differs(array: zarr.Array[Any] | None, group: Group, variable: Variable, shapes: _Shapes) -> bool:
    if array is None or array.shape != shapes.of(variable) or array.chunks != shapes.chunks_of(group, variable):
        return True
    sizes = dict(zip(variable.dims, shapes.of(variable), strict=True))
    return any(True for _ in variable_differences(array, group, variable, sizes))


def _mend_groups(place: Place, groups: list[Group]) -> Iterator[str]:
    store = store_at(place)
    if not is_archive(place):
        _delete_metadata(place, "")
        attributes = {"Conventions": CONVENTIONS, "schema": SCHEMA_NAME, "schema_version": MISSION.version}
        zarr.create_group(store, zarr_format=3, attributes=attributes)
        yield "/"
    for group in groups:
        if group.name == "/":
            continue
        try:
            zarr.open_group(store, path=group.name, mode="r", use_consolidated=False)
        except (*UNREADABLE, FileNotFoundError):
            _delete_metadata(place, group.name)
            study = {} if group in MISSION.groups else {COMPLETE: False}
            zarr.create_group(store, path=group.name, zarr_format=3, attributes={"title": group.title, **study})
            yield group.name


def _delete_metadata(place: Place, label: str) -> None:
    wait_for(store_at(place).delete(f"{label}/zarr.json".lstrip("/")))
