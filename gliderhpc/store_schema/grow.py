"""An archive that grows: more profiles, and rows as long as the longest of them needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import zarr

from gliderhpc.errors import InputError
from gliderhpc.store_schema.access import read_profiles
from gliderhpc.store_schema.commits import UNREADABLE, array_at
from gliderhpc.store_schema.create import consolidate, create_variable, mission_sizes
from gliderhpc.store_schema.mission_groups import COMMITS, MISSION
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.schema import PROFILE, Group, Variable
from gliderhpc.store_schema.studies import COMPLETE, DIGESTS, STUDIES
from gliderhpc.store_schema.study_digests import table_damages, table_digests

OUTDATED = "outdated"
"""Attribute of a study's group that says since what it no longer speaks for the whole archive."""


def grow_archive(place: Place, profiles: Sequence[int], sizes: Mapping[str, int]) -> None:
    """Make room for the profiles of a grown observation file; what is there stays.

    Rows that become longer go on in chunks of their own. A growth that was interrupted is finished by another.

    Parameters
    ----------
    place : str or Path
        The archive.
    profiles : sequence of int
        Numbers of all profiles, those that are there first.
    sizes : mapping of str to int
        Least sizes of the mission's dimensions.

    Raises
    ------
    InputError
        The profiles do not go on where the archive's end.
    """
    before = read_profiles(place)
    check_continuation(place, before, profiles)
    now = mission_sizes(place)
    wanted = {dim: max(size, sizes.get(dim, 0)) for dim, size in now.items()} | {PROFILE: len(profiles)}
    if wanted == now | {PROFILE: len(before)}:
        return
    root = zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
    for study in STUDIES:
        node = root.get(study.name)
        if isinstance(node, zarr.Group):
            _grow_study(place, node, study, wanted, profiles)
    for group in reversed(MISSION.groups):
        node = root if group.name == "/" else root[group.name]
        if isinstance(node, zarr.Group):
            _grow_group(node, group, wanted, profiles)
    consolidate(place)


def check_continuation(place: Place, before: Sequence[int], profiles: Sequence[int]) -> None:
    """Make sure that profiles go on where those of an archive end.

    Raises
    ------
    InputError
        They do not.
    """
    if list(profiles[: len(before)]) != list(before):
        raise InputError(
            f"{place}: holds profiles that these are no continuation of; append only adds profiles after number "
            f"{before[-1]}, or use --overwrite"
        )


def mark_studies_outdated(place: Place, why: str) -> None:
    """Note in every study's group that the archive has changed since."""
    root = zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
    for group in STUDIES:
        node = root.get(group.name)
        if isinstance(node, zarr.Group):
            node.attrs[OUTDATED] = why


def _grow_study(
    place: Place, node: zarr.Group, group: Group, sizes: Mapping[str, int], profiles: Sequence[int]
) -> None:
    """Grow a study, which counts as unfinished until that is done, and for good where its tables were damaged."""
    sound = bool(node.attrs.get(COMPLETE)) and not table_damages(place, group)
    node.attrs[COMPLETE] = False
    _grow_group(node, group, sizes, profiles)
    node.attrs.update({DIGESTS: table_digests(place, group), COMPLETE: sound})


def _grow_group(node: zarr.Group, group: Group, sizes: Mapping[str, int], profiles: Sequence[int]) -> None:
    """Grow a group's arrays, its profiles' numbers last."""
    for variable in reversed(group.variables):
        array = array_at(node, variable.name)
        shape = tuple(sizes.get(dim, size) for dim, size in zip(variable.dims, array.shape, strict=True))
        if shape == array.shape:
            continue
        if variable.is_row or (group.name == COMMITS and variable.name != PROFILE):
            array.resize(shape)
        else:
            _replace(node, group, variable, array, shape, profiles)


def _replace(
    node: zarr.Group,
    group: Group,
    variable: Variable,
    array: zarr.Array[Any],
    shape: tuple[int, ...],
    profiles: Sequence[int],
) -> None:
    """Make what is written whole anew, in one chunk, with what it held."""
    if variable.name == PROFILE:
        values = np.array(profiles)
    elif variable.dims == (variable.name,):
        values = np.arange(shape[0])
    else:
        values = np.full(shape, variable.fill_value, dtype=array.dtype)
        values[tuple(slice(size) for size in array.shape)] = _held(array)
    del node[variable.name]
    create_variable(node, group, variable, shape)[:] = values


def _held(array: zarr.Array[Any]) -> Any:
    """What an array holds, missing where it is damaged: a mission's table is written anew from the commits."""
    try:
        return np.asarray(array[:])
    except UNREADABLE:
        return array.fill_value
