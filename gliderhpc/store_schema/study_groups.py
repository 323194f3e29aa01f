"""Groups of the studies: creation, completion, restoring after a failure, and digests of their chunks."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import MemoryStore

from gliderhpc.store_schema.commits import (
    Damage,
    array_at,
    arrays_at,
    differing_chunks,
    row_arrays,
    row_chunks,
    row_names,
    stored_digests,
)
from gliderhpc.store_schema.consolidation import consolidate
from gliderhpc.store_schema.create import as_json, create_variables, sizes_of
from gliderhpc.store_schema.digests import Digests
from gliderhpc.store_schema.location import (
    ROOT,
    Location,
    group_at,
    read_group,
    remove_group,
    store_at,
    wait_for,
    write_group,
)
from gliderhpc.store_schema.schema import (
    COMPLETE,
    DIGESTS,
    MANIFEST,
    MISSION,
    PROFILE,
    STUDIES,
    Group,
    is_shared,
    study_called,
)

log = logging.getLogger(__name__)


def create_study(
    location: Location,
    name: str,
    sizes: Mapping[str, int] | None = None,
    attributes: Mapping[str, Any] | None = None,
    labels: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Add a study's empty group to an archive, replacing that of an earlier run.

    Parameters
    ----------
    location : str or Path
        The archive.
    name : str
        Name of a group in :data:`gliderhpc.store_schema.schema.STUDIES`.
    sizes : mapping of str to int, optional
        Sizes of the dimensions that the mission's groups do not have.
    attributes : mapping, optional
        Initial attributes of the group (anything that JSON holds).
    labels : mapping of str to sequence of str, optional
        Names along the dimensions whose coordinate is text.

    Notes
    -----
    The group spans all profiles of the archive, as other groups do; values of profiles that are not studied remain
    missing. The group is marked incomplete until `finish_study`.
    """
    group = study_called(name)
    root = group_at(location, writable=True)
    numbers = _numbers_of(root)
    content: dict[str, Buffer] = {}
    title = MISSION[name].title if is_shared(group) else group.title
    its_attributes = {"title": title, COMPLETE: False, **as_json(attributes or {})}
    node = zarr.create_group(MemoryStore(content), zarr_format=3, attributes=its_attributes)
    labels = labels or {}
    named = {dim: len(names) for dim, names in labels.items()}
    create_variables(node, group, numbers, {PROFILE: len(numbers), **sizes_of(root), **(sizes or {}), **named})
    for dim, names in labels.items():
        coordinate = node[dim]
        if isinstance(coordinate, zarr.Array):
            coordinate[:] = np.array(list(names), dtype=np.dtypes.StringDType())
    remove_study(location, group)
    write_group(content, location, name)
    consolidate(location)


def remove_study(location: Location, group: Group) -> None:
    """Remove everything that a study has written; in a group shared with the mission, only the study's variables."""
    if is_shared(group):
        _mark_incomplete(location, group)
    for path in _own_paths(group):
        remove_group(location, path)


def _mark_incomplete(location: Location, group: Group) -> None:
    """Mark a study of a shared group as interrupted, if it has been run."""
    node = group_at(location, group.name, writable=True)
    if COMPLETE in node.attrs:
        node.attrs[COMPLETE] = False


def has_study(location: Location, group: Group) -> bool:
    """Return whether a study has written anything."""
    return any(not wait_for(store_at(location).is_empty(path)) for path in _own_paths(group))


def _own_paths(group: Group) -> list[str]:
    """Return the paths that belong to a study alone: its group, or its variables in one of the mission's groups."""
    return [f"{group.name}/{v.name}" for v in group.variables] if is_shared(group) else [group.name]


@dataclass(frozen=True, eq=False)
class _Snapshot:
    """Bytes of a study's own groups and variables by path and key, and of the metadata that it changes, by key."""

    content: dict[str, dict[str, Buffer]]
    metadata: dict[str, Buffer]

    @classmethod
    def of(cls, location: Location, group: Group) -> _Snapshot:
        keys = [ROOT, f"{group.name}/{ROOT}"] if is_shared(group) else [ROOT]
        stored = {key: wait_for(store_at(location).get(key, default_buffer_prototype())) for key in keys}
        metadata = {key: value for key, value in stored.items() if value is not None}
        return cls({path: read_group(location, path) for path in _own_paths(group)}, metadata)

    def equals(self, other: _Snapshot) -> bool:
        return all(
            one.keys() == two.keys() and all(one[key].to_bytes() == two[key].to_bytes() for key in one)
            for one, two in zip(self._parts, other._parts, strict=True)
        )

    @property
    def _parts(self) -> list[dict[str, Buffer]]:
        return [*self.content.values(), self.metadata]

    def restore(self, location: Location, group: Group) -> None:
        remove_study(location, group)
        for path, content in self.content.items():
            write_group(content, location, path)
        for key, value in self.metadata.items():
            wait_for(store_at(location).set(key, value))


@contextmanager
def restored_on_error(location: Location, name: str) -> Iterator[None]:
    """Restore a study's group, or remove it if there was none, when the block ends with an error.

    Parameters
    ----------
    location : str or Path
        The archive.
    name : str
        Name of a group in :data:`gliderhpc.store_schema.schema.STUDIES`.

    Notes
    -----
    The group's bytes are stored in memory, some megabytes for a mission of hundreds of profiles. An object store cannot
    rename, and a copy in the archive would remain after a killed run.
    """
    group = study_called(name)
    earlier = _Snapshot.of(location, group)
    try:
        yield
    except BaseException:
        try:
            if not earlier.equals(_Snapshot.of(location, group)):
                earlier.restore(location, group)
        except OSError as error:
            log.warning("%s: the earlier results of %s cannot be restored (%s)", location, name, error)
        raise


def studies_in(root: zarr.Group, *, finished: bool = False) -> Iterator[tuple[Group, zarr.Group]]:
    """Yield the studies of an archive, or only the finished ones, with their groups."""
    for study in STUDIES:
        node = root.get(study.name)
        if not isinstance(node, zarr.Group) or (is_shared(study) and COMPLETE not in node.attrs):
            continue
        if not finished or node.attrs.get(COMPLETE, False):
            yield study, node


def study_attributes(location: Location, name: str) -> dict[str, Any]:
    """Return the attributes of a study's group, empty if the archive has no such group."""
    root = group_at(location)
    return dict(root[name].attrs) if name in root else {}


def finish_study(location: Location, name: str, attributes: Mapping[str, Any]) -> None:
    """Add a study's findings to its group as attributes (anything that JSON holds), mark it complete, consolidate."""
    group = study_called(name)
    complete_manifests(location, group)
    node = group_at(location, name, writable=True)
    node.attrs.update({**as_json(attributes), DIGESTS: table_digests(location, group), COMPLETE: True})
    consolidate(location)


def set_study_attributes(location: Location, name: str, attributes: Mapping[str, Any]) -> None:
    """Add or replace attributes of a study's group (anything that JSON holds) and consolidate; for the coordinator."""
    node = group_at(location, name, writable=True)
    node.attrs.update(as_json(attributes))
    consolidate(location)


def _numbers_of(root: zarr.Group) -> NDArray[np.int64]:
    array = root[PROFILE]
    if not isinstance(array, zarr.Array):
        raise TypeError(f"'{PROFILE}' is a group, not an array")
    return np.asarray(array[:], dtype=np.int64)


def write_manifests(location: Location, name: str, written: Mapping[int, Digests]) -> None:
    """Write the manifest of every profile's rows of a study whose group has just been created.

    Parameters
    ----------
    location : str or Path
        The archive.
    name : str
        Name of the study's group.
    written : mapping of int to mapping of str to str or None
        Digests of all chunks written, by position along the profile dimension.
    """

    def digests(index: int, chunks: Mapping[str, str]) -> Digests:
        return {key: written.get(index, {}).get(key) for key in chunks}

    _put_manifests(group_at(location, writable=True), study_called(name), digests)


def complete_manifests(location: Location, group: Group) -> None:
    """Write the manifests of a study's rows from the stored chunks, if any manifest is missing."""
    store = store_at(location)
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    if row_names([group]) and not all(np.asarray(array_at(root, f"{group.name}/{MANIFEST}")[:])):
        _put_manifests(root, group, lambda _, chunks: stored_digests(store, chunks))


def _put_manifests(root: zarr.Group, group: Group, digests: Callable[[int, Mapping[str, str]], Digests]) -> None:
    if row_names([group]):
        arrays = row_arrays(root, [group])
        manifests = array_at(root, f"{group.name}/{MANIFEST}")
        texts = [json.dumps(digests(i, row_chunks(arrays, i)), sort_keys=True) for i in range(manifests.shape[0])]
        manifests[:] = np.array(texts, dtype=np.dtypes.StringDType())


def table_digests(location: Location, group: Group) -> Digests:
    """Return the digests of the chunks of a study's tables, by key."""
    store = store_at(location, read_only=True)
    root = zarr.open_group(store, mode="r", use_consolidated=False)
    return stored_digests(store, _table_chunks(root, group))


def table_damages(location: Location, group: Group) -> list[Damage]:
    """Find chunks of a study's tables that have changed since it was finished; their profile is -1."""
    store = store_at(location, read_only=True)
    node = zarr.open_group(store, mode="r", path=group.name, use_consolidated=False)
    attributes: dict[str, Any] = dict(node.attrs)
    expected = dict(attributes.get(DIGESTS, {}))
    variables = {key: key.rpartition("/")[0] for key in expected}
    return differing_chunks(-1, variables, expected, stored_digests(store, expected))


def _table_chunks(root: zarr.Group, group: Group) -> dict[str, str]:
    """Return the variables of the tables' chunks, by key, without the profiles' numbers, which the root repeats."""
    names = [f"{group.name}/{v.name}" for v in group.variables if not v.is_row and v.name != PROFILE]
    arrays = arrays_at(root, names)
    return {f"{name}/{array.metadata.encode_chunk_key((0,) * array.ndim)}": name for name, array in arrays.items()}
