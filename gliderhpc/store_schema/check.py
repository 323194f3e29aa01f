"""Holding an archive against the schema."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from gliderhpc.errors import InputError
from gliderhpc.store_schema.create import chunks, is_archive
from gliderhpc.store_schema.mission_groups import MISSION
from gliderhpc.store_schema.schema import PROFILE, STATUS, Group, Variable
from gliderhpc.store_schema.studies import COMPLETE, STUDIES


def check_archive(path: str | Path) -> list[str]:
    """Differences between an archive and the schema; a study that has not been run is none.

    Parameters
    ----------
    path : str or Path
        The archive.

    Returns
    -------
    list of str
        One line a difference, each naming group, variable and what differs; empty where all is as it should be.

    Raises
    ------
    InputError
        There is no archive of ours.
    """
    if not is_archive(path):
        raise InputError(f"{path}: no archive of gliderhpc; give the folder that run-mission wrote")
    root = zarr.open_group(str(path), mode="r", use_consolidated=False)
    return list(_differences(root))


def _differences(root: zarr.Group) -> Iterator[str]:
    version = root.attrs.get("schema_version")
    if version != MISSION.version:
        yield f"/: schema_version is {version!r}, this program's is '{MISSION.version}'"
    for group in MISSION:
        node = root if group.name == "/" else root.get(group.name)
        if isinstance(node, zarr.Group):
            yield from _group_differences(root, node, group)
        else:
            yield f"{group.name}: the group is missing"
    for study in STUDIES:
        node = root.get(study.name)
        if isinstance(node, zarr.Group):
            yield from _study_differences(root, node, study)
    yield from _status_differences(root)


def _study_differences(root: zarr.Group, node: zarr.Group, group: Group) -> Iterator[str]:
    if not node.attrs.get(COMPLETE, False):
        yield f"{group.name}: the study was interrupted; run it again"
    yield from _group_differences(root, node, group)


def _group_differences(root: zarr.Group, node: zarr.Group, group: Group) -> Iterator[str]:
    arrays = dict(node.arrays())
    known = {variable.name for variable in group.variables}
    yield from (f"{group.name}/{name}: not in the schema" for name in sorted(set(arrays) - known))
    sizes = {name: array.shape[0] for name, array in arrays.items() if array.ndim == 1 and name in group.dims}
    for variable in group.variables:
        if variable.name not in arrays:
            yield f"{group.name}/{variable.name}: the variable is missing"
            continue
        label, array = f"{group.name}/{variable.name}", arrays[variable.name]
        yield from (f"{label}: {text}" for text in _variable_differences(array, group, variable, sizes))
    yield from _coordinate_differences(root, group, arrays)


def _variable_differences(
    array: zarr.Array[Any], group: Group, variable: Variable, sizes: dict[str, int]
) -> Iterator[str]:
    dims = tuple(getattr(array.metadata, "dimension_names", None) or ())
    if dims != variable.dims:
        yield f"dimensions are {dims}, not {variable.dims}"
        return
    shape = tuple(sizes.get(dim, -1) for dim in dims)
    if -1 not in shape and array.shape != shape:
        yield f"shape is {array.shape}, its coordinates have {shape}"
    if array.chunks != chunks(group, variable, array.shape):
        yield f"chunks are {array.chunks}, not {chunks(group, variable, array.shape)}"
    if _dtype_name(array) != variable.dtype:
        yield f"dtype is {_dtype_name(array)}, not {variable.dtype}"
    elif not _same(array.fill_value, variable.fill_value):
        yield f"fill value is {array.fill_value}, not {variable.fill_value}"
    yield from _attribute_differences(dict(array.attrs), variable.all_attributes())


def _attribute_differences(found: dict[str, Any], wanted: dict[str, Any]) -> Iterator[str]:
    for name, value in wanted.items():
        if name not in found:
            yield f"attribute {name} is missing"
        elif found[name] != value:
            yield f"attribute {name} is {found[name]!r}, not {value!r}"


def _coordinate_differences(root: zarr.Group, group: Group, arrays: dict[str, zarr.Array[Any]]) -> Iterator[str]:
    numbers = root.get(PROFILE)
    if group.name == "/" or PROFILE not in arrays or not isinstance(numbers, zarr.Array):
        return
    if not np.array_equal(np.asarray(arrays[PROFILE][:]), np.asarray(numbers[:])):
        yield f"{group.name}/{PROFILE}: the profiles' numbers are not those of the root"


def _status_differences(root: zarr.Group) -> Iterator[str]:
    status = root.get("status")
    if not isinstance(status, zarr.Array) or _dtype_name(status) != "string":
        return
    for index, value in enumerate(np.asarray(status[:])):
        if value not in STATUS:
            yield f"/status: entry {index} is '{value}', not one of {', '.join(STATUS)}"


def _dtype_name(array: zarr.Array[Any]) -> str:
    return "string" if array.dtype.kind in "TOU" else array.dtype.name


def _same(found: Any, wanted: Any) -> bool:
    if isinstance(wanted, float) and math.isnan(wanted):
        return bool(np.isnan(found))
    return bool(found == wanted)
