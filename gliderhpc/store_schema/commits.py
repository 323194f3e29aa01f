"""Commits of profiles: a manifest of a profile's chunks and, written last, a commit marker.

Zarr does not store chunks that contain only fill values, so an absent chunk does not prove damage. The manifest names
every possible chunk of the profile with its digest, or with null where there must be none. The marker contains the
manifest's digest; both are valid only together.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice, product
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.store import Store
from zarr.storage import StorePath

from gliderhpc.errors import first_line
from gliderhpc.store_schema.digests import Digests, digest_of
from gliderhpc.store_schema.location import (
    Location,
    group_at,
    is_archive,
    is_empty,
    store_at,
    stored_bytes,
    wait_for,
    wait_for_all,
)
from gliderhpc.store_schema.schema import COMMITS, MISSION, Group

BY_RESUME = "run-mission --resume repairs it"

AsyncArray = zarr.AsyncArray[Any]

_MAX_CONCURRENT_WRITES = 8
"""Number of arrays that are written concurrently, whose values are in memory together."""

UNREADABLE = (ValueError, RuntimeError, KeyError, TypeError)
"""Errors of codecs and of JSON on damaged bytes."""


@dataclass(frozen=True)
class Commit:
    """A valid commit of a profile.

    Attributes
    ----------
    row : mapping
        The profile's row of the archive's table, without its missing values.
    inputs : mapping of str to str
        Digests of the profile's inputs, by kind.
    manifest : mapping of str to str or None
        Digest by key of every possible chunk of the profile, None where there is no chunk.
    extra : mapping
        Content that the writer stored for a later run, anything that JSON holds; may be empty.
    """

    row: Mapping[str, Any]
    inputs: Mapping[str, str]
    manifest: Digests
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Damage:
    """A chunk that differs from the one written.

    Attributes
    ----------
    profile_index : int
        Position of the profile along the profile dimension.
    variable : str
        ``GROUP/NAME``.
    what : str
        Description of the damage.
    """

    profile_index: int
    variable: str
    what: str


def row_arrays(root: zarr.Group, groups: Iterable[Group]) -> dict[str, zarr.Array[Any]]:
    """Open the arrays of some groups that hold profiles' rows, by path within the archive."""
    return arrays_at(root, row_names(groups))


def row_names(groups: Iterable[Group]) -> list[str]:
    """Return the paths of the arrays of some groups that hold profiles' rows."""
    return [label_of(group.name, variable.name) for group in groups for variable in group.variables if variable.is_row]


def row_chunks(arrays: Mapping[str, zarr.Array[Any]] | Mapping[str, AsyncArray], profile_index: int) -> dict[str, str]:
    """Return the path of the array by key of every possible chunk of a profile's rows."""
    return {
        f"{name}/{array.metadata.encode_chunk_key((profile_index, *location))}": name
        for name, array in arrays.items()
        for location in product(*(range(-(-n // m)) for n, m in zip(array.shape[1:], array.chunks[1:], strict=True)))
    }


def as_texts(
    row: Mapping[str, Any],
    inputs: Mapping[str, str],
    manifest: Digests,
    finished: str,
    extra: Mapping[str, Any] | None = None,
) -> tuple[str, str]:
    """Return manifest and marker as stored text."""
    text = json.dumps(manifest, sort_keys=True)
    marker = {"inputs": dict(inputs), "manifest": digest_of(text.encode()), "finished": finished, "row": dict(row)}
    if extra:
        marker["kept"] = dict(extra)
    return text, json.dumps(marker, allow_nan=False)


def read_commits(location: Location, positions: Iterable[int] | None = None) -> dict[int, Commit | str]:
    """Read the commits of all or some profiles, by position along the profile dimension.

    Profiles without a marker, or beyond the end of the archive, are left out; a damaged marker or manifest yields a
    string that describes the damage.
    """
    root = group_at(location)
    markers, manifests = (array_at(root, f"{COMMITS}/{name}") for name in ("marker", "manifest"))
    count = markers.shape[0]
    wanted = [index for index in (range(count) if positions is None else positions) if index < count]
    commits = _commits(markers, manifests, wanted)
    return {index: commit for index, commit in commits.items() if commit is not None}


def _commits(
    markers: zarr.Array[Any], manifests: zarr.Array[Any], positions: list[int]
) -> dict[int, Commit | str | None]:
    """Read commits at once, which is much faster than one by one; read them one by one if a text is damaged."""
    try:
        texts = zip(_texts_at(markers, positions), _texts_at(manifests, positions), strict=True)
        return {index: parsed_commit(*both) for index, both in zip(positions, texts, strict=True)}
    except UNREADABLE:
        return {index: _commit(markers, manifests, index) for index in positions}


def _texts_at(array: zarr.Array[Any], positions: list[int]) -> list[str]:
    """Read several values of an array of texts."""
    return list(map(str, np.asarray(array.oindex[np.array(positions)]))) if positions else []


@dataclass(frozen=True)
class Marker:
    """Content of a commit's marker, which does not prove that the manifest matches it.

    Attributes
    ----------
    row, inputs : mapping
        Those of the `Commit`.
    """

    row: Mapping[str, Any]
    inputs: Mapping[str, str]


def read_markers(location: Location) -> dict[int, Marker]:
    """Read the markers alone, by position along the profile dimension; unreadable ones are left out."""
    root = group_at(location)
    markers = array_at(root, f"{COMMITS}/marker")
    try:
        texts = list(map(str, np.asarray(markers[:])))
    except UNREADABLE:
        texts = [_text_or_empty(markers, index) for index in range(markers.shape[0])]
    read = {index: _marker(text) for index, text in enumerate(texts) if text}
    return {index: marker for index, marker in read.items() if marker is not None}


def committed_rows(location: Location) -> dict[int, dict[str, Any]]:
    """Read the table's rows from the markers, by position along the profile dimension; unreadable ones are left out."""
    return {index: dict(marker.row) for index, marker in read_markers(location).items()}


def _text_or_empty(array: zarr.Array[Any], index: int) -> str:
    try:
        return text_at(array, index)
    except UNREADABLE:
        return ""


def _marker(text: str) -> Marker | None:
    try:
        content = _parsed_marker(text)
        return Marker(dict(content["row"]), dict(content["inputs"]))
    except UNREADABLE:
        return None


def has_commits(location: Location) -> bool:
    """Return whether any profile of an archive was committed, judged by the names of its chunks alone."""

    async def first_marker(store: Store) -> bool:
        async for key in store.list_prefix(f"{COMMITS}/marker/"):
            if not key.endswith("zarr.json") and not key.endswith(".partial"):
                return True
        return False

    return wait_for(first_marker(store_at(location, read_only=True)))


def is_begun(location: Location) -> bool:
    """Return whether a location holds anything worth preserving: anything but an archive without committed profiles."""
    return not is_empty(location) and (not is_archive(location) or has_commits(location))


def damages(location: Location, commits: Mapping[int, Commit]) -> list[Damage]:
    """Find the chunks of committed profiles that differ from their manifests."""
    store = store_at(location, read_only=True)
    arrays = row_arrays(zarr.open_group(store, mode="r", use_consolidated=False), MISSION)
    damaged = []
    for index, commit in commits.items():
        chunks = row_chunks(arrays, index)
        damaged += differing_chunks(index, chunks, commit.manifest, stored_digests(store, chunks))
    return damaged


def stored_digests(store: Any, keys: Mapping[str, str]) -> Digests:
    """Return the digest of the stored value of each key, None where there is none."""

    async def digest(key: str) -> str | None:
        content = await stored_bytes(store, key)
        return None if content is None else digest_of(content)

    async def all_digests() -> list[str | None]:
        return await asyncio.gather(*(digest(key) for key in keys))

    return dict(zip(keys, wait_for(all_digests()), strict=True))


def stored_keys(location: Location) -> frozenset[str]:
    """Return all keys of an archive's store."""

    async def keys(store: Store) -> frozenset[str]:
        return frozenset([key async for key in store.list_prefix("")])

    return wait_for(keys(store_at(location, read_only=True)))


def differing_chunks(index: int, variables: Mapping[str, str], expected: Digests, stored: Digests) -> list[Damage]:
    """Return the damage of chunks whose digests differ; `variables` holds the variable of each key."""
    return [
        Damage(index, variable, _difference(expected.get(key), stored[key]))
        for key, variable in variables.items()
        if expected.get(key) != stored[key]
    ]


def arrays_at(root: zarr.Group, names: Iterable[str]) -> dict[str, zarr.Array[Any]]:
    """Open arrays of an archive by path, concurrently, in a third of the time of opening them one by one.

    Raises
    ------
    KeyError
        An array does not exist.
    """
    return {name: zarr.Array(array) for name, array in writable_arrays(root, names).items()}


def writable_arrays(root: zarr.Group, names: Iterable[str]) -> dict[str, AsyncArray]:
    """Open arrays of an archive by path, concurrently, for `write_values`; errors as in `arrays_at`."""
    arrays = _opened(root.store_path, names)
    for name, array in arrays.items():
        if isinstance(array, FileNotFoundError):
            raise KeyError(name)
        if isinstance(array, BaseException):
            raise array
    return arrays


def write_values(writes: Iterable[tuple[AsyncArray, Any, Any]]) -> None:
    """Write values into arrays, each given with its selection, several at a time.

    Waiting for each array separately takes three times as long. If one write fails, those under way finish first;
    nothing is written after the error is raised.

    Raises
    ------
    Exception
        The first error of a write.
    """
    remaining = iter(writes)
    while batch := list(islice(remaining, _MAX_CONCURRENT_WRITES)):
        wait_for_all(array.setitem(selection, values) for array, selection, values in batch)


def readable_arrays(location: Location, names: Iterable[str]) -> dict[str, zarr.Array[Any]]:
    """Open those of an archive's arrays, by path, whose metadata can be read."""
    opened = _opened(StorePath(store_at(location, read_only=True)), names)
    for error in opened.values():
        if isinstance(error, BaseException) and not isinstance(error, (*UNREADABLE, FileNotFoundError)):
            raise error
    return {name: zarr.Array(array) for name, array in opened.items() if not isinstance(array, BaseException)}


def _opened(root: StorePath, names: Iterable[str]) -> dict[str, Any]:
    """Open arrays concurrently, by path; return the error of an array that cannot be opened."""

    async def opened(names: list[str]) -> list[Any]:
        opening = (zarr.AsyncArray.open(root / name, zarr_format=3) for name in names)
        return await asyncio.gather(*opening, return_exceptions=True)

    names = list(names)
    return dict(zip(names, wait_for(opened(names)), strict=True))


def values_at(root: zarr.Group, names: Iterable[str]) -> dict[str, NDArray[Any] | None]:
    """Read the values of arrays of an archive by path, concurrently; None where they cannot be read."""

    async def values(name: str) -> NDArray[Any] | None:
        try:
            array = await zarr.AsyncArray.open(root.store_path / name, zarr_format=3)
            return np.asarray(await array.getitem(...))
        except (*UNREADABLE, FileNotFoundError):
            return None

    async def all_values(names: list[str]) -> list[NDArray[Any] | None]:
        return await asyncio.gather(*map(values, names))

    names = list(names)
    return dict(zip(names, wait_for(all_values(names)), strict=True))


def array_at(root: zarr.Group, name: str) -> zarr.Array[Any]:
    """Return an array of an archive by its path.

    Raises
    ------
    TypeError
        The path is that of a group.
    """
    array = root[name]
    if not isinstance(array, zarr.Array):
        raise TypeError(f"'{name}' is a group, not an array")
    return array


def label_of(group: str, name: str) -> str:
    """Return the path of a variable within its archive."""
    return name if group == "/" else f"{group}/{name}"


def text_at(array: zarr.Array[Any], index: int) -> str:
    """Read one value of an array of texts."""
    return str(np.asarray(array[index : index + 1])[0])


def _commit(markers: zarr.Array[Any], manifests: zarr.Array[Any], index: int) -> Commit | str | None:
    try:
        marker = text_at(markers, index)
        return parsed_commit(marker, text_at(manifests, index)) if marker else None
    except UNREADABLE as error:
        return f"marker or manifest cannot be read ({first_line(error)})"


def parsed_commit(marker: str, manifest: str) -> Commit | str | None:
    """Parse a commit from marker and manifest; None without a marker, a string where they are inconsistent.

    Raises
    ------
    ValueError, KeyError, TypeError
        A text is damaged.
    """
    if not marker:
        return None
    content = _parsed_marker(marker)
    if digest_of(manifest.encode()) != content["manifest"]:
        return "the manifest does not match the marker"
    return Commit(dict(content["row"]), dict(content["inputs"]), json.loads(manifest), dict(content.get("kept", {})))


@lru_cache(maxsize=1024)
def _parsed_marker(text: str) -> Any:
    """Parse a marker; the result is cached, as a run and the readers after it parse the same, and not changed."""
    return json.loads(text)


def _difference(expected: str | None, stored: str | None) -> str:
    if stored is None:
        return "the chunk is missing"
    return "there should be no chunk" if expected is None else "the chunk is damaged"
