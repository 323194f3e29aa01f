"""Writing of an archive's rows, commits and tables, and reading of its attributes and profiles.

A worker owns its profile's chunks in every group but the root; the coordinator alone owns the tables. All writes are
whole chunks at integer positions; writing a row twice has the same effect as writing it once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike, NDArray

from gliderhpc.store_schema.commits import (
    UNREADABLE,
    AsyncArray,
    array_at,
    arrays_at,
    as_texts,
    label_of,
    row_chunks,
    row_names,
    writable_arrays,
    write_values,
)
from gliderhpc.store_schema.create import coordinate_values
from gliderhpc.store_schema.digests import Digests, RecordingStore
from gliderhpc.store_schema.location import Location, group_at, store_at
from gliderhpc.store_schema.schema import COMMITS, MISSION, PROFILE, ArchiveVariable, group_called

MARKER, MANIFEST = f"{COMMITS}/marker", f"{COMMITS}/manifest"


def encoded(variable: ArchiveVariable, values: Any) -> Any:
    """Convert times to seconds since 1970 (NaT to NaN); return other values unchanged."""
    if not (variable.is_time and np.asarray(values).dtype.kind == "M"):
        return values
    instants = np.asarray(values).astype("datetime64[ns]")
    since = np.datetime64(0, "ns")
    return np.where(np.isnat(instants), np.nan, (instants - since) / np.timedelta64(1, "s"))


def padded_row(variable: ArchiveVariable, label: str, row: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Check a row against its variable and pad it with the fill value to its shape."""
    values = np.asarray(encoded(variable, row))
    if values.ndim != len(shape) or any(size > length for size, length in zip(values.shape, shape, strict=True)):
        raise ValueError(f"{label}: a row of shape {values.shape} does not fit into one of shape {shape}")
    if not variable.dtype.startswith("float") and values.dtype.kind not in "iub":
        raise ValueError(f"{label}: {values.dtype} values cannot be stored in {variable.dtype} without loss")
    padded = np.full(shape, variable.fill_value, dtype=variable.dtype)
    padded[tuple(slice(length) for length in values.shape)] = values
    return padded


def check_position(index: int, count: int) -> None:
    """Check that a position lies within the archive."""
    # Zarr interprets -1 as the last row; a worker's error could then overwrite another profile's data.
    if not 0 <= index < count:
        raise ValueError(f"position {index} is outside the archive's {count} profiles")


class ArchiveRows:
    """Writer of the rows of an archive's profiles; an array is opened once, when it is first written.

    Parameters
    ----------
    location : str or Path
        The archive.
    """

    def __init__(self, location: Location) -> None:
        self._store = RecordingStore(store_at(location))
        self._root = zarr.open_group(self._store, mode="r+", use_consolidated=False)
        self._arrays: dict[str, AsyncArray] = {}

    def write(self, profile_index: int, group: str, values: Mapping[str, ArrayLike]) -> None:
        """Write one profile's row of some variables of a group.

        Parameters
        ----------
        profile_index : int
            Position of the profile along the profile dimension, from 0 (not its number).
        group : str
            Name of a group with a second dimension, ``series`` for one.
        values : mapping of str to array_like
            Rows by variable, with the dimensions after the profile and at most their lengths, in the units of the file
            (degrees); the rest of the row is filled. Times are seconds since 1970 or datetime64.

        Raises
        ------
        KeyError
            The schema has no such group or variable.
        ValueError
            A row is too long or has other dimensions, or the position is outside the archive.
        """
        labels = {f"{group}/{name}": group_called(group)[name] for name in values}
        for label, variable in labels.items():
            if not variable.is_row:
                raise ValueError(f"{label} is not a row of a profile")
        arrays = self._opened(labels, profile_index)
        write_values(
            (array, profile_index, padded_row(labels[label], label, values[labels[label].name], array.shape[1:]))
            for label, array in arrays.items()
        )

    def begin(self, profile_index: int) -> None:
        """Clear a profile's marker; the profile is treated as missing until it is committed."""
        self._put_text(MARKER, profile_index, "")
        self._store.digests.clear()

    def commit(
        self,
        profile_index: int,
        row: Mapping[str, Any],
        inputs: Mapping[str, str],
        finished: str,
        *,
        extra: Mapping[str, Any] | None = None,
        amended: Digests | None = None,
    ) -> None:
        """Commit a profile: fill the rows not written since `begin`, write the manifest, and last the marker.

        Parameters
        ----------
        profile_index : int
            Position of the profile along the profile dimension.
        row : mapping
            The profile's row of the table, anything that JSON holds.
        inputs : mapping of str to str
            Digests of the profile's inputs, by kind.
        finished : str
            Time of completion, ISO 8601.
        extra : mapping, optional
            Content stored with the commit for a later run (`Commit.extra`).
        amended : dict, optional
            Manifest of the commit that is amended: rows not written since `begin` stay as they are, and are not filled.
        """
        arrays = self._opened(row_names(MISSION), profile_index)
        chunks = row_chunks(arrays, profile_index)
        if amended is None:
            missing = dict.fromkeys(name for key, name in chunks.items() if key not in self._store.digests)
            write_values((arrays[name], profile_index, arrays[name].metadata.fill_value) for name in missing)
        previous = amended or {}
        manifest = {key: self._store.digests.get(key, previous.get(key)) for key in chunks}
        text, marker = as_texts(row, inputs, manifest, finished, extra)
        self._put_text(MANIFEST, profile_index, text)
        self._put_text(MARKER, profile_index, marker)

    def taken_digests(self) -> Digests:
        """Return the digest by key of every chunk written since the last call."""
        taken = dict(self._store.digests)
        self._store.digests.clear()
        return taken

    def _put_text(self, name: str, profile_index: int, text: str) -> None:
        (array,) = self._opened([name], profile_index).values()
        write_values(
            [(array, slice(profile_index, profile_index + 1), np.array([text], dtype=np.dtypes.StringDType()))]
        )

    def _opened(self, names: Iterable[str], profile_index: int) -> dict[str, AsyncArray]:
        """Return arrays by path, and open those that are not open yet."""
        names = list(names)
        unopened = [name for name in names if name not in self._arrays]
        if unopened:
            self._arrays.update(writable_arrays(self._root, unopened))
        for name in names:
            check_position(profile_index, self._arrays[name].shape[0])
        return {name: self._arrays[name] for name in names}


def read_attributes(location: Location) -> dict[str, Any]:
    """Read the root attributes of an archive."""
    return dict(group_at(location).attrs)


def read_profiles(location: Location) -> list[int]:
    """Read the numbers of an archive's profiles, in the order of its profile dimension.

    Every group repeats them; those of the first group in which they are readable and increasing are returned.

    Raises
    ------
    ValueError
        They are damaged in every group.
    """
    root = group_at(location)
    for group in MISSION:
        try:
            numbers = np.asarray(array_at(root, label_of(group.name, PROFILE))[:])
        except UNREADABLE:
            continue
        if numbers.size == 1 or (np.diff(numbers) > 0).all():
            return [int(number) for number in numbers]
    raise ValueError(f"{location}: the profiles' numbers are damaged in every group")


Rows = Mapping[int, Mapping[str, Any]]
"""Values by position along the profile dimension and by variable (``GROUP/NAME``, at the root ``NAME``)."""


def write_table_rows(location: Location, rows: Rows, group: str = "/") -> None:
    """Write values into a group's table of profiles; only for the coordinator, since all profiles share a chunk.

    Parameters
    ----------
    location : str or Path
        The archive.
    rows : mapping of int to mapping of str to value
        Values by position along the profile dimension (from 0) and by variable, ``GROUP/NAME`` for one of a subgroup;
        other values are unchanged. Times are seconds since 1970 or datetime64. A variable with `whole` set takes a row
        of values.
    group : str
        Name of the group: the root, or a study's group.

    Raises
    ------
    KeyError
        The table has no such variable.
    ValueError
        A position is outside the archive.
    """
    root = group_at(location, writable=True)
    for name in dict.fromkeys(name for row in rows.values() for name in row):
        subgroup, _, column_name = name.rpartition("/")
        owner = subgroup or group
        variable = group_called(owner)[column_name]
        if column_name == PROFILE:
            raise ValueError("the profiles' numbers are fixed when the archive is created")
        if not variable.is_table:
            raise ValueError(f"{owner}/{column_name} is not a column of a table")
        array = array_at(root, label_of(owner, column_name))
        column = np.asarray(array[:])
        _fill_column(column, variable, name, rows)
        array[:] = column


def write_mission_table(location: Location, rows: Rows) -> None:
    """Write the whole table of the mission; profiles and values that are not given become missing.

    Parameters
    ----------
    location : str or Path
        The archive.
    rows : mapping of int to mapping of str to value
        Rows as for `write_table_rows` at the root.
    """
    root = group_at(location, writable=True)
    size = array_at(root, PROFILE).shape[0]
    columns = dict(mission_columns(rows, size))
    write_values((array, ..., columns[name]) for name, array in writable_arrays(root, columns).items())


def mission_columns(rows: Rows, size: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the columns of the mission's table for `size` profiles, by path within the archive."""
    for group in MISSION:
        for variable in group.variables:
            if not variable.is_table or variable.name == PROFILE or group.name == COMMITS:
                continue
            name = label_of(group.name, variable.name)
            dtype = np.dtypes.StringDType() if variable.dtype == "string" else np.dtype(variable.dtype)
            column: NDArray[Any] = np.full(size, variable.fill_value, dtype=dtype)
            _fill_column(column, variable, name, rows)
            yield name, column


def write_coordinates(location: Location) -> None:
    """Rewrite the mission's coordinates, with the profiles' numbers of `read_profiles`."""
    numbers = np.array(read_profiles(location), dtype=np.int64)
    root = group_at(location, writable=True)
    coordinates = {label_of(group.name, v.name): v for group in MISSION for v in group.variables if v.dims == (v.name,)}
    for name, array in arrays_at(root, list(coordinates)).items():
        array[:] = coordinate_values(coordinates[name], numbers, array.shape[0])


def write_whole(location: Location, group: str, values: Mapping[str, ArrayLike]) -> None:
    """Write whole variables that do not belong to profiles; only for the coordinator.

    Parameters
    ----------
    location : str or Path
        The archive.
    group : str
        Name of a study's group.
    values : mapping of str to array_like
        Values by variable, in the array's shape, or empty to leave it unchanged. Times are seconds since 1970 or
        datetime64.

    Raises
    ------
    KeyError
        The schema has no such group or variable.
    ValueError
        The shape differs, or the variable belongs to profiles.
    """
    root = group_at(location, writable=True)
    for name, content in values.items():
        variable = group_called(group)[name]
        if variable.dims[0] == PROFILE:
            raise ValueError(f"{group}/{name} belongs to profiles")
        array = array_at(root, label_of(group, name))
        new = np.asarray(encoded(variable, content))
        if new.size == 0:
            continue
        if new.shape != array.shape:
            raise ValueError(f"{group}/{name}: values of shape {new.shape} do not fit into {array.shape}")
        array[...] = new.astype(np.dtypes.StringDType() if variable.dtype == "string" else variable.dtype)


def _fill_column(column: NDArray[Any], variable: ArchiveVariable, name: str, rows: Rows) -> None:
    for index in (min(rows, default=0), max(rows, default=0)):
        check_position(index, len(column))
    given = {index: row[name] for index, row in rows.items() if name in row}
    if given:
        # Value by value would take ten times as long.
        values = np.array(list(given.values()), dtype=column.dtype if variable.dtype == "string" else None)
        column[list(given)] = encoded(variable, values)
