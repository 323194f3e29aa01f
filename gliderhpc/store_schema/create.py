"""Creation of an archive: the whole schema at once, before the first profile.

Only chunks change afterwards. The metadata is therefore consolidated immediately, and an unfinished archive opens like
a finished one. Module `replacement` handles an existing archive.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray
from zarr.core.buffer import Buffer
from zarr.storage import MemoryStore

from gliderhpc.errors import InputError
from gliderhpc.store_schema.commits import write_values
from gliderhpc.store_schema.consolidation import consolidate, consolidate_store
from gliderhpc.store_schema.location import (
    ROOT,
    Location,
    group_at,
    is_address,
    is_archive,
    is_empty,
    kind_of_other,
    wait_for_all,
    write_group,
)
from gliderhpc.store_schema.replacement import new_token, replace, replacing
from gliderhpc.store_schema.schema import (
    CHUNK_KEYS,
    CODECS,
    CONVENTIONS,
    MISSION,
    PROFILE,
    SCHEMA_NAME,
    ArchiveVariable,
    Group,
    chunks,
)


def create_archive(
    location: Location,
    profiles: ArrayLike,
    sizes: Mapping[str, int],
    attributes: Mapping[str, Any],
    overwrite: bool = False,
) -> None:
    """Create an empty archive with every group and variable of the schema.

    Parameters
    ----------
    location : str or Path
        Location of the new archive; missing parent folders are created.
    profiles : array_like of int
        Numbers of the profiles, shape (profile,), increasing.
    sizes : mapping of str to int
        Sizes of the dimensions ``sample``, ``record``, ``window`` and ``segment``: those of the longest profile.
    attributes : mapping
        Root attributes, anything that JSON holds; the schema's name and version and the conventions are added.
    overwrite : bool
        Replace an existing archive. Anything other than an archive of this program is never removed.

    Raises
    ------
    InputError
        An archive exists and may not be replaced, something else exists, or the location cannot be written.
    """
    check_location(location, overwrite)
    replace(location, _builder(profiles, sizes, attributes), new_token()).discard()


def new_archive(
    location: Location, profiles: ArrayLike, sizes: Mapping[str, int], attributes: Mapping[str, Any], token: str
) -> AbstractContextManager[Callable[[], None]]:
    """Create an archive for a run in place of an existing one, which is restored if no profile is committed.

    Parameters
    ----------
    location, profiles, sizes, attributes
        Arguments of :func:`create_archive`.
    token : str
        Sixteen hexadecimal digits, unique to the run.

    Returns
    -------
    context manager
        See :func:`gliderhpc.store_schema.replacement.replacing`.
    """
    return replacing(location, _builder(profiles, sizes, attributes), token)


def check_location(location: Location, overwrite: bool) -> None:
    """Check that an archive may be created at a location.

    Raises
    ------
    InputError
        Something other than an archive exists there, an archive that may not be replaced or has foreign content, or
        the location is within another archive.
    """
    _refuse_within_archive(location)
    if is_empty(location):
        return
    if not is_archive(location):
        raise InputError(
            f"{location}: exists and is {kind_of_other(location)}, so it is not replaced; give another `store`"
        )
    if not overwrite:
        raise InputError(
            f"{location}: this archive exists; finish it with `resume=True` or start again with `overwrite=True`"
        )
    if (foreign := _foreign_entry(location)) is not None:
        raise InputError(
            f"{location}: contains {foreign}, which is not part of the archive, so it is not replaced; move {foreign} "
            "elsewhere, or give another `store`"
        )


def _refuse_within_archive(location: Location) -> None:
    if is_address(location):
        return
    within = next((str(folder) for folder in Path(location).absolute().parents if is_archive(folder)), None)
    if within is not None:
        raise InputError(f"{location}: is within the archive {within}; give another `store`")


def _foreign_entry(location: Location) -> str | None:
    """Return the name of a file, folder or archive in an archive's folder that is not part of it; None without any."""
    if is_address(location):
        return None
    for entry in sorted(Path(location).iterdir()):
        is_node = (entry / ROOT).is_file() and not is_archive(entry)
        if entry.name != ROOT and not entry.name.startswith(".") and not is_node:
            return entry.name
    return None


def _builder(
    profiles: ArrayLike, sizes: Mapping[str, int], attributes: Mapping[str, Any]
) -> Callable[[Location], None]:
    numbers = _profile_numbers(profiles)
    return partial(_create, numbers=numbers, sizes={PROFILE: len(numbers), **sizes}, attributes=attributes)


def set_attributes(location: Location, attributes: Mapping[str, Any]) -> None:
    """Add or replace root attributes (anything that JSON holds) and consolidate; only for the coordinator."""
    root = group_at(location, writable=True)
    root.attrs.update(as_json(attributes))
    consolidate(location)


def mission_sizes(location: Location) -> dict[str, int]:
    """Return the sizes of the mission's own dimensions, without ``profile``."""
    sizes = sizes_of(group_at(location))
    return {dim: size for dim, size in sizes.items() if dim != PROFILE}


def sizes_of(root: zarr.Group) -> dict[str, int]:
    """Return the sizes of the mission's own dimensions, from their coordinates."""
    sizes: dict[str, int] = {}
    # The groups repeat the coordinates; while an archive grows, the last groups get the new sizes first.
    for group in reversed(MISSION.groups):
        for variable in group.variables:
            if variable.dims == (variable.name,) and variable.name not in sizes:
                array = root.get(f"{group.name}/{variable.name}".lstrip("/"))
                if isinstance(array, zarr.Array):
                    sizes[variable.name] = int(array.shape[0])
    return {dim: sizes[dim] for dim in MISSION.dims if dim in sizes}


def _profile_numbers(profiles: ArrayLike) -> NDArray[np.int64]:
    numbers = np.asarray(profiles)
    if numbers.ndim != 1 or numbers.size == 0 or not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError("profiles must be a non-empty one-dimensional array of integers")
    if np.any(np.diff(numbers) <= 0):
        raise ValueError("profiles must be increasing and distinct")
    return numbers.astype(np.int64)


def _create(
    location: Location, numbers: NDArray[np.int64], sizes: Mapping[str, int], attributes: Mapping[str, Any]
) -> None:
    root_attributes = as_json(attributes) | {
        "Conventions": CONVENTIONS,
        "schema": SCHEMA_NAME,
        "schema_version": MISSION.version,
    }
    # Created in memory first: an object store would otherwise receive a thousand requests, one after the other.
    content: dict[str, Buffer] = {}
    memory = MemoryStore(content)
    root = zarr.create_group(memory, zarr_format=3, attributes=root_attributes)
    for group in MISSION:
        node = root if group.name == "/" else root.create_group(group.name, attributes={"title": group.title})
        create_variables(node, group, numbers, sizes)
    consolidate_store(memory)
    write_group(content, location)


def create_variables(node: zarr.Group, group: Group, numbers: NDArray[np.int64], sizes: Mapping[str, int]) -> None:
    """Create all variables of a group, with its numeric coordinates and those whose labels are in the schema."""
    sizes = {**sizes, **group.label_sizes}
    # Dimensions of size 0, as in a mission without windows or segments, get size 1; otherwise no array would open.
    shapes = [tuple(max(1, int(sizes[dim])) for dim in variable.dims) for variable in group.variables]
    # One by one would take nearly twice as long.
    created = wait_for_all(
        zarr.api.asynchronous.create_array(
            node.store_path, name=variable.name, zarr_format=3, **_form(group, variable, shape)
        )
        for variable, shape in zip(group.variables, shapes, strict=True)
    )
    write_values(
        (array, ..., coordinate_values(variable, numbers, array.shape[0]))
        for variable, array in zip(group.variables, created, strict=True)
        if variable.dims == (variable.name,) and (variable.dtype != "string" or variable.labels is not None)
    )


def coordinate_values(variable: ArchiveVariable, numbers: NDArray[np.int64], size: int) -> NDArray[Any]:
    """Return the values of a coordinate: the profiles' numbers, the schema's labels, or numbers from 0."""
    if variable.labels is not None:
        return np.array(variable.labels, dtype=np.dtypes.StringDType())
    return numbers if variable.name == PROFILE else np.arange(size)


def create_variable(
    node: zarr.Group,
    group: Group,
    variable: ArchiveVariable,
    shape: tuple[int, ...],
    chunk_shape: tuple[int, ...] | None = None,
) -> zarr.Array[Any]:
    """Create a variable's empty array in its group, with the schema's chunks or with those of rows that have grown."""
    return node.create_array(variable.name, **_form(group, variable, shape, chunk_shape))


def _form(
    group: Group, variable: ArchiveVariable, shape: tuple[int, ...], chunk_shape: tuple[int, ...] | None = None
) -> dict[str, Any]:
    """Return the arguments with which zarr creates a variable's array."""
    return {
        "shape": shape,
        "dtype": variable.dtype,
        "chunks": chunk_shape or chunks(group, variable, shape),
        "compressors": CODECS,
        "chunk_key_encoding": CHUNK_KEYS,
        "fill_value": variable.fill_value,
        "dimension_names": variable.dims,
        "attributes": variable.all_attributes(),
    }


def as_json(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes after checking that JSON can represent them, before anything is written."""
    for key, value in attributes.items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise TypeError(f"attribute '{key}' is not plain JSON: {error}") from None
    return dict(attributes)
