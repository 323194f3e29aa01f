"""Creating an archive: the whole schema at once, before the first profile.

Nothing but chunks changes afterwards, so the metadata is consolidated straight away and an archive in the making opens
as cleanly as a finished one. See `replacement` for what becomes of an archive that is there.
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.abc.store import Store
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.buffer import Buffer, default_buffer_prototype
from zarr.storage import MemoryStore

from gliderhpc.errors import InputError
from gliderhpc.store_schema.mission_groups import MISSION
from gliderhpc.store_schema.place import (
    ROOT,
    Place,
    is_archive,
    is_empty,
    read_group,
    remove_group,
    store_at,
    wait_for,
    write_group,
)
from gliderhpc.store_schema.replacement import new_token, replace, replacing
from gliderhpc.store_schema.schema import CONVENTIONS, PROFILE, SCHEMA_NAME, Group, Variable
from gliderhpc.store_schema.studies import COMPLETE, DIGESTS, study_called
from gliderhpc.store_schema.study_digests import complete_manifests, table_digests

log = logging.getLogger(__name__)

CODECS = (BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"), Crc32cCodec())
"""Shuffling the bytes first makes times and slowly varying series several times smaller than zstd alone; the checksum
lets any reader refuse a damaged chunk."""

CHUNK_KEYS: dict[str, Any] = {"name": "default", "separator": "."}
"""A variable's chunks lie side by side in its folder: with a slash each would have a folder of its own."""


def create_archive(
    place: Place,
    profiles: ArrayLike,
    sizes: Mapping[str, int],
    attributes: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Create an empty archive with every group and variable of the schema.

    Parameters
    ----------
    place : str or Path
        Where the archive is to be; missing parent folders are made.
    profiles : array_like of int
        Numbers of the profiles, shape (profile,), increasing.
    sizes : mapping of str to int
        Sizes of the dimensions ``sample``, ``record``, ``window`` and ``segment``: those of the longest profile.
    attributes : mapping
        Root attributes, anything that JSON holds; the schema's name and version and the conventions are added.
    overwrite : bool
        Replace an archive that is there. Whatever is not an archive of ours is never removed.

    Raises
    ------
    InputError
        An archive is there and may not be replaced, something else is there, or the place cannot be written.
    """
    check_place(place, overwrite)
    replace(place, _builder(profiles, sizes, attributes), new_token()).discard()


def new_archive(
    place: Place, profiles: ArrayLike, sizes: Mapping[str, int], attributes: Mapping[str, Any], token: str
) -> AbstractContextManager[Callable[[], None]]:
    """Create an archive for a run, in place of the one that is there, which comes back when no profile is committed.

    Parameters
    ----------
    place, profiles, sizes, attributes
        As for :func:`create_archive`.
    token : str
        Sixteen hexadecimal digits that no other run has.

    Returns
    -------
    context manager
        See :func:`gliderhpc.store_schema.replacement.replacing`.
    """
    return replacing(place, _builder(profiles, sizes, attributes), token)


def check_place(place: Place, overwrite: bool) -> None:
    """Make sure that an archive may be created here.

    Raises
    ------
    InputError
        Something else is there, or an archive that is not to be replaced.
    """
    if is_empty(place):
        return
    if not is_archive(place):
        raise InputError(f"{place}: exists and is no archive of gliderhpc, so it is left alone; give another --store")
    if not overwrite:
        raise InputError(f"{place}: this archive exists; finish it with --resume or start anew with --overwrite")


def _builder(profiles: ArrayLike, sizes: Mapping[str, int], attributes: Mapping[str, Any]) -> Callable[[Place], None]:
    numbers = _profile_numbers(profiles)
    return partial(_create, numbers=numbers, sizes={PROFILE: len(numbers), **sizes}, attributes=attributes)


def consolidate(place: Place) -> None:
    """Gather all metadata at the root, so that the archive opens with one read; needed after a group is added."""
    _consolidate(store_at(place))


def _consolidate(store: Store) -> None:
    with warnings.catch_warnings():
        # The format's authors may still change how this is spelt; readers that do not know it read the groups instead.
        warnings.filterwarnings("ignore", message="Consolidated metadata is currently not part", category=UserWarning)
        zarr.consolidate_metadata(store, zarr_format=3)


def set_attributes(place: Place, attributes: Mapping[str, Any]) -> None:
    """Add or replace root attributes (anything that JSON holds) and consolidate; for the coordinator alone."""
    root = zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
    root.attrs.update(_as_json(attributes))
    consolidate(place)


def create_study(
    place: Place,
    name: str,
    sizes: Mapping[str, int] | None = None,
    attributes: Mapping[str, Any] | None = None,
    labels: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Add a study's empty group to an archive, in place of what an earlier run of the study left.

    Parameters
    ----------
    place : str or Path
        The archive.
    name : str
        Name of a group in :data:`gliderhpc.store_schema.studies.STUDIES`.
    sizes : mapping of str to int, optional
        Sizes of the dimensions that the mission's groups do not have.
    attributes : mapping, optional
        What the group says of itself from the start (anything that JSON holds).
    labels : mapping of str to sequence of str, optional
        Names along the dimensions whose coordinate is text.

    Notes
    -----
    The group spans all of the archive's profiles, so that it stands beside the others; what the study leaves out stays
    missing. Until `finish_study` it says of itself that it is not complete.
    """
    group = study_called(name)
    root = zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
    numbers = _numbers_of(root)
    content: dict[str, Buffer] = {}
    its_attributes = {"title": group.title, COMPLETE: False, **_as_json(attributes or {})}
    node = zarr.create_group(MemoryStore(content), zarr_format=3, attributes=its_attributes)
    labels = labels or {}
    named = {dim: len(names) for dim, names in labels.items()}
    _create_variables(node, group, numbers, {PROFILE: len(numbers), **_mission_sizes(root), **(sizes or {}), **named})
    for dim, names in labels.items():
        coordinate = node[dim]
        if isinstance(coordinate, zarr.Array):
            coordinate[:] = np.array(list(names), dtype=np.dtypes.StringDType())
    remove_group(place, name)
    write_group(content, place, name)
    consolidate(place)


@contextmanager
def earlier_study_safe(place: Place, name: str) -> Iterator[None]:
    """Put a study's group back as it was, or remove it where there was none, when the block does not end well.

    Parameters
    ----------
    place : str or Path
        The archive.
    name : str
        Name of a group in :data:`gliderhpc.store_schema.studies.STUDIES`.

    Notes
    -----
    The group's bytes are kept in memory, some megabytes for a mission of hundreds of profiles: an object store cannot
    rename, and a copy beside the group would outlive a killed run.
    """
    metadata, earlier = wait_for(store_at(place).get(ROOT, default_buffer_prototype())), read_group(place, name)
    try:
        yield
    except BaseException:
        try:
            if not _same_bytes(read_group(place, name), earlier):
                remove_group(place, name)
                write_group(earlier, place, name)
                if metadata is not None:
                    wait_for(store_at(place).set(ROOT, metadata))
        except OSError as error:
            log.warning("%s: the earlier results of %s cannot be put back (%s)", place, name, error)
        raise


def _same_bytes(one: Mapping[str, Buffer], other: Mapping[str, Buffer]) -> bool:
    return one.keys() == other.keys() and all(one[key].to_bytes() == other[key].to_bytes() for key in one)


def study_attributes(place: Place, name: str) -> dict[str, Any]:
    """Attributes of a study's group, none where the archive has no such group."""
    root = zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False)
    return dict(root[name].attrs) if name in root else {}


def finish_study(place: Place, name: str, attributes: Mapping[str, Any]) -> None:
    """Add a study's findings to its group as attributes (anything that JSON holds), mark it complete, consolidate."""
    group = study_called(name)
    complete_manifests(place, group)
    node = zarr.open_group(store_at(place), mode="r+", path=name, use_consolidated=False)
    node.attrs.update({**_as_json(attributes), DIGESTS: table_digests(place, group), COMPLETE: True})
    consolidate(place)


def set_study_attributes(place: Place, name: str, attributes: Mapping[str, Any]) -> None:
    """Add or replace attributes of a study's group (anything that JSON holds) and consolidate; for the coordinator."""
    node = zarr.open_group(store_at(place), mode="r+", path=name, use_consolidated=False)
    node.attrs.update(_as_json(attributes))
    consolidate(place)


def _numbers_of(root: zarr.Group) -> NDArray[np.int64]:
    array = root[PROFILE]
    if not isinstance(array, zarr.Array):
        raise TypeError(f"'{PROFILE}' is a group, not an array")
    return np.asarray(array[:], dtype=np.int64)


def mission_sizes(place: Place) -> dict[str, int]:
    """Sizes of the mission's own dimensions, ``profile`` left out."""
    sizes = _mission_sizes(zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False))
    return {dim: size for dim, size in sizes.items() if dim != PROFILE}


def _mission_sizes(root: zarr.Group) -> dict[str, int]:
    """Sizes of the mission's own dimensions, from their coordinates."""
    sizes = {}
    for group in MISSION:
        for variable in group.variables:
            array = root.get(f"{group.name}/{variable.name}".lstrip("/"))
            if variable.dims == (variable.name,) and isinstance(array, zarr.Array):
                sizes[variable.name] = int(array.shape[0])
    return sizes


def _profile_numbers(profiles: ArrayLike) -> NDArray[np.int64]:
    numbers = np.asarray(profiles)
    if numbers.ndim != 1 or numbers.size == 0 or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError("profiles must be a non-empty one-dimensional array of integers")
    if np.any(np.diff(numbers) <= 0):
        raise ValueError("profiles must be increasing and distinct")
    return numbers.astype(np.int64)


def _create(place: Place, numbers: NDArray[np.int64], sizes: Mapping[str, int], attributes: Mapping[str, Any]) -> None:
    root_attributes = _as_json(attributes) | {
        "Conventions": CONVENTIONS,
        "schema": SCHEMA_NAME,
        "schema_version": MISSION.version,
    }
    # Made in memory: an object store would be asked a thousand times, one answer waited for after the other.
    content: dict[str, Buffer] = {}
    memory = MemoryStore(content)
    root = zarr.create_group(memory, zarr_format=3, attributes=root_attributes)
    for group in MISSION:
        node = root if group.name == "/" else root.create_group(group.name, attributes={"title": group.title})
        _create_variables(node, group, numbers, sizes)
    _consolidate(memory)
    write_group(content, place)


def _create_variables(node: zarr.Group, group: Group, numbers: NDArray[np.int64], sizes: Mapping[str, int]) -> None:
    for variable in group.variables:
        # A mission without a single window or segment still needs an array that opens.
        array = create_variable(node, group, variable, tuple(max(1, int(sizes[dim])) for dim in variable.dims))
        if variable.dims == (variable.name,) and variable.dtype != "string":
            array[:] = numbers if variable.name == PROFILE else np.arange(array.shape[0])


def create_variable(
    node: zarr.Group,
    group: Group,
    variable: Variable,
    shape: tuple[int, ...],
    chunk_shape: tuple[int, ...] | None = None,
) -> zarr.Array[Any]:
    """Create a variable's empty array in its group's node, in the schema's chunks or those of rows that have grown."""
    return node.create_array(
        variable.name,
        shape=shape,
        dtype=variable.dtype,
        chunks=chunk_shape or chunks(group, variable, shape),
        compressors=CODECS,
        chunk_key_encoding=CHUNK_KEYS,
        fill_value=variable.fill_value,
        dimension_names=variable.dims,
        attributes=variable.all_attributes(),
    )


def chunks(group: Group, variable: Variable, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Chunk shape of a variable: one row for what a worker writes, everything for tables and coordinates."""
    if variable.dims == (variable.name,) or variable.whole:
        return shape
    if variable.dims[0] == PROFILE and (len(shape) > 1 or group.name == "commits"):
        return (1, *shape[1:])
    return shape


def _as_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Fail here, by name, on what JSON cannot hold, rather than after half an archive is written."""
    for key, value in attributes.items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise TypeError(f"attribute '{key}' is not plain JSON: {error}") from None
    return dict(attributes)
