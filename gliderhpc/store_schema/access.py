"""Writing an archive's rows, and its commit markers.

A worker owns its profile's chunks in every group but the root; the coordinator alone owns the root's table. All writes
are whole chunks at integer positions, so writing a row twice leaves what writing it once does.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from gliderhpc.store_schema.schema import PROFILE, Variable
from gliderhpc.store_schema.studies import group_called


class ArchiveRows:
    """Rows of an archive's profiles, for writing several: every array is opened once.

    Parameters
    ----------
    path : str or Path
        The archive.
    """

    def __init__(self, path: str | Path) -> None:
        self._root = _open(path)
        self._arrays: dict[tuple[str, str], zarr.Array[Any]] = {}

    def write(self, profile_index: int, group: str, values: Mapping[str, ArrayLike]) -> None:
        """Write one profile's row of some variables of a group.

        Parameters
        ----------
        profile_index : int
            Position of the profile along the profile dimension, from 0 (not its number).
        group : str
            Name of a group with a second dimension, ``series`` for one.
        values : mapping of str to array_like
            Rows by variable, shape (m,) with m up to the row's length, in the units of the file (degrees); the rest of
            the row is filled. Times are seconds since 1970 or datetime64.

        Raises
        ------
        KeyError
            The schema has no such group or variable.
        ValueError
            A row is too long or not one-dimensional, or the position is outside the archive.
        """
        for name, row in values.items():
            variable = group_called(group)[name]
            array = self._array(group, name)
            if len(variable.dims) != 2:
                raise ValueError(f"{group}/{name} is no row of a profile")
            _check_index(profile_index, array)
            array[profile_index, :] = _padded(variable, f"{group}/{name}", row, array.shape[1])

    def mark(self, profile_index: int, content: Mapping[str, Any]) -> None:
        """Mark a profile as complete, with anything that JSON holds; the last write a worker makes for it."""
        array = self._array("commits", "marker")
        _check_index(profile_index, array)
        array[profile_index : profile_index + 1] = np.array(
            [json.dumps(dict(content), allow_nan=False)], dtype=np.dtypes.StringDType()
        )

    def _array(self, group: str, name: str) -> zarr.Array[Any]:
        if (group, name) not in self._arrays:
            self._arrays[group, name] = _array(self._root[group], name)
        return self._arrays[group, name]


def write_profile(path: str | Path, profile_index: int, group: str, values: Mapping[str, ArrayLike]) -> None:
    """Write one profile's row of some variables of a group, as `ArchiveRows.write` does."""
    ArchiveRows(path).write(profile_index, group, values)


def write_table_rows(path: str | Path, rows: Mapping[int, Mapping[str, Any]], group: str = "/") -> None:
    """Write values into a group's table of profiles; for the coordinator alone, since all profiles share a chunk.

    Parameters
    ----------
    path : str or Path
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
    root = _open(path)
    for name in dict.fromkeys(name for row in rows.values() for name in row):
        below, _, own = name.rpartition("/")
        owner = below or group
        variable = group_called(owner)[own]
        if own == PROFILE:
            raise ValueError("the profiles' numbers are fixed when the archive is created")
        if not variable.is_table:
            raise ValueError(f"{owner}/{own} is no column of a table")
        array = _array(root if owner == "/" else root[owner], own)
        column = np.asarray(array[:])
        for index, row in rows.items():
            _check_index(index, array)
            if name in row:
                column[index] = _encoded(variable, row[name])
        array[:] = column


def write_marker(path: str | Path, profile_index: int, content: Mapping[str, Any]) -> None:
    """Mark a profile as complete, as `ArchiveRows.mark` does."""
    ArchiveRows(path).mark(profile_index, content)


def read_markers(path: str | Path) -> dict[int, dict[str, Any]]:
    """Contents of the commit markers by position along the profile dimension; profiles without one are left out."""
    texts = np.asarray(_array(_open(path, "r")["commits"], "marker")[:])
    return {index: json.loads(str(text)) for index, text in enumerate(texts) if text}


def clear_marker(path: str | Path, profile_index: int) -> None:
    """Take a profile's commit marker away, before it is computed anew."""
    array = _array(_open(path)["commits"], "marker")
    _check_index(profile_index, array)
    array[profile_index : profile_index + 1] = np.array([""], dtype=np.dtypes.StringDType())


def read_attributes(path: str | Path) -> dict[str, Any]:
    """Root attributes of an archive."""
    return dict(_open(path, "r").attrs)


def read_profiles(path: str | Path) -> list[int]:
    """Numbers of an archive's profiles, in the order of its profile dimension."""
    return [int(number) for number in np.asarray(_array(_open(path, "r"), PROFILE)[:])]


def _open(path: str | Path, mode: Any = "r+") -> zarr.Group:
    return zarr.open_group(str(path), mode=mode, use_consolidated=False)


def _array(node: Any, name: str) -> zarr.Array[Any]:
    array = node[name]
    if not isinstance(array, zarr.Array):
        raise TypeError(f"'{name}' is a group, not an array")
    return array


def _check_index(index: int, array: zarr.Array[Any]) -> None:
    # zarr takes -1 for the last row, and a worker's slip would then damage another profile's data.
    if not 0 <= index < array.shape[0]:
        raise ValueError(f"position {index} is outside the archive's {array.shape[0]} profiles")


def _encoded(variable: Variable, values: Any) -> Any:
    """Instants as seconds since 1970 (NaT as NaN); everything else as it is."""
    if not (variable.is_time and np.asarray(values).dtype.kind == "M"):
        return values
    instants = np.asarray(values).astype("datetime64[ns]")
    since = np.datetime64(0, "ns")
    return np.where(np.isnat(instants), np.nan, (instants - since) / np.timedelta64(1, "s"))


def _padded(variable: Variable, label: str, row: ArrayLike, length: int) -> NDArray[Any]:
    values = np.asarray(_encoded(variable, row))
    if values.ndim != 1 or values.size > length:
        raise ValueError(f"{label}: a row of shape {values.shape} does not fit into {length} columns")
    if not variable.dtype.startswith("float") and values.dtype.kind not in "iub":
        raise ValueError(f"{label}: {values.dtype} values cannot go into {variable.dtype} without loss")
    padded = np.full(length, variable.fill_value, dtype=variable.dtype)
    padded[: values.size] = values
    return padded
