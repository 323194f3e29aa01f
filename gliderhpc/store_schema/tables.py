"""The archive's tables of profiles and its coordinates, which the coordinator of a run writes alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from gliderhpc.store_schema.access import read_profiles
from gliderhpc.store_schema.commits import array_at, arrays_at, label_of
from gliderhpc.store_schema.encoding import check_position, encoded
from gliderhpc.store_schema.mission_groups import COMMITS, MISSION
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.schema import PROFILE, Variable
from gliderhpc.store_schema.studies import group_called

Rows = Mapping[int, Mapping[str, Any]]
"""By position along the profile dimension, values by variable (``GROUP/NAME``, without the group at the root)."""


def write_table_rows(place: Place, rows: Rows, group: str = "/") -> None:
    """Write values into a group's table of profiles; for the coordinator alone, since all profiles share a chunk.

    Parameters
    ----------
    place : str or Path
        The archive.
    rows : mapping of int to mapping of str to value
        By position along the profile dimension (from 0), values by variable, one of a group below as ``GROUP/NAME``;
        what is not named is left as it is. Times are seconds since 1970 or datetime64. Variables that are written whole
        take a row of values.
    group : str
        The root, or a study's group.

    Raises
    ------
    KeyError
        The table has no such variable.
    ValueError
        A position is outside the archive.
    """
    root = _open(place)
    for name in dict.fromkeys(name for row in rows.values() for name in row):
        below, _, own = name.rpartition("/")
        owner = below or group
        variable = group_called(owner)[own]
        if own == PROFILE:
            raise ValueError("the profiles' numbers are fixed when the archive is created")
        if not variable.is_table:
            raise ValueError(f"{owner}/{own} is no column of a table")
        array = array_at(root, label_of(owner, own))
        column = np.asarray(array[:])
        _put(column, variable, name, rows)
        array[:] = column


def write_mission_table(place: Place, rows: Rows) -> None:
    """Write the whole of the mission's table, whatever it holds: profiles and values not named become missing.

    Parameters
    ----------
    place : str or Path
        The archive.
    rows : mapping of int to mapping of str to value
        As for `write_table_rows`, of the root.
    """
    root = _open(place)
    size = array_at(root, PROFILE).shape[0]
    columns = dict(mission_columns(rows, size))
    for name, array in arrays_at(root, columns).items():
        array[:] = columns[name]


def mission_columns(rows: Rows, size: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Columns of the mission's table for an archive of so many profiles, by path within the archive."""
    for group in MISSION:
        for variable in group.variables:
            if not variable.is_table or variable.name == PROFILE or group.name == COMMITS:
                continue
            name = label_of(group.name, variable.name)
            dtype = np.dtypes.StringDType() if variable.dtype == "string" else np.dtype(variable.dtype)
            column: NDArray[Any] = np.full(size, variable.fill_value, dtype=dtype)
            _put(column, variable, name, rows)
            yield name, column


def write_coordinates(place: Place) -> None:
    """Write the mission's coordinates anew, the profiles' numbers as `read_profiles` finds them."""
    numbers = np.array(read_profiles(place), dtype=np.int64)
    root = _open(place)
    names = [label_of(group.name, v.name) for group in MISSION for v in group.variables if v.dims == (v.name,)]
    for name, array in arrays_at(root, names).items():
        array[:] = numbers if name.rpartition("/")[2] == PROFILE else np.arange(array.shape[0])


def write_whole(place: Place, group: str, values: Mapping[str, ArrayLike]) -> None:
    """Write variables that no profile owns, each whole; for the coordinator alone.

    Parameters
    ----------
    place : str or Path
        The archive.
    group : str
        A study's group.
    values : mapping of str to array_like
        By variable, of the array's own shape, or empty to leave the filling. Times are seconds since 1970 or
        datetime64.

    Raises
    ------
    KeyError
        The schema has no such group or variable.
    ValueError
        The shape is another, or the variable belongs to profiles.
    """
    root = _open(place)
    for name, content in values.items():
        variable, array = group_called(group)[name], array_at(root, label_of(group, name))
        if variable.dims[0] == PROFILE:
            raise ValueError(f"{group}/{name} belongs to profiles")
        told = np.asarray(encoded(variable, content))
        if told.size == 0:
            continue
        if told.shape != array.shape:
            raise ValueError(f"{group}/{name}: values of shape {told.shape} do not fit into {array.shape}")
        array[...] = told.astype(np.dtypes.StringDType() if variable.dtype == "string" else variable.dtype)


def _put(column: NDArray[Any], variable: Variable, name: str, rows: Rows) -> None:
    for index, row in rows.items():
        check_position(index, len(column))
        if name in row:
            column[index] = encoded(variable, row[name])


def _open(place: Place) -> zarr.Group:
    return zarr.open_group(store_at(place), mode="r+", use_consolidated=False)
