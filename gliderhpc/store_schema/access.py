"""Writing an archive's rows and their commits, and reading what it says of itself.

A worker owns its profile's chunks in every group but the root; the coordinator alone owns the tables. All writes are
whole chunks at integer positions, so writing a row twice leaves what writing it once does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import zarr
from numpy.typing import ArrayLike

from gliderhpc.store_schema.commits import (
    UNREADABLE,
    array_at,
    as_texts,
    committed_rows,
    label_of,
    row_chunks,
    row_names,
)
from gliderhpc.store_schema.encoding import check_position, padded_row
from gliderhpc.store_schema.mission_groups import COMMITS, MISSION
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.recording import Digests, RecordingStore
from gliderhpc.store_schema.schema import PROFILE
from gliderhpc.store_schema.studies import group_called

MARKER, MANIFEST = f"{COMMITS}/marker", f"{COMMITS}/manifest"


class ArchiveRows:
    """Rows of an archive's profiles, for writing several: an array is opened once, when it is first written.

    Parameters
    ----------
    place : str or Path
        The archive.
    """

    def __init__(self, place: Place) -> None:
        self._store = RecordingStore(store_at(place))
        self._root = zarr.open_group(self._store, mode="r+", use_consolidated=False)
        self._arrays: dict[str, zarr.Array[Any]] = {}

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
            label = f"{group}/{name}"
            if not variable.is_row:
                raise ValueError(f"{label} is no row of a profile")
            array = self._array(label, profile_index)
            array[profile_index, :] = padded_row(variable, label, row, array.shape[1])

    def begin(self, profile_index: int) -> None:
        """Take a profile's marker away: until it is committed it counts as not there."""
        self._put_text(MARKER, profile_index, "")
        self._store.digests.clear()

    def commit(self, profile_index: int, row: Mapping[str, Any], inputs: Mapping[str, str], finished: str) -> None:
        """Close a profile: what was not written since `begin` is filled, then the manifest and last the marker.

        Parameters
        ----------
        profile_index : int
            Position of the profile along the profile dimension.
        row : mapping
            Its row of the table, anything that JSON holds.
        inputs : mapping of str to str
            Digest by kind of what it was made from.
        finished : str
            When, in ISO 8601.
        """
        chunks = row_chunks({name: self._array(name, profile_index) for name in row_names(MISSION)}, profile_index)
        for name in dict.fromkeys(name for key, name in chunks.items() if key not in self._store.digests):
            array = self._array(name, profile_index)
            array[profile_index, :] = array.fill_value
        manifest = {key: self._store.digests[key] for key in chunks}
        text, marker = as_texts(row, inputs, manifest, finished)
        self._put_text(MANIFEST, profile_index, text)
        self._put_text(MARKER, profile_index, marker)

    def taken_digests(self) -> Digests:
        """Digest by key of every chunk written since this was last asked."""
        taken = dict(self._store.digests)
        self._store.digests.clear()
        return taken

    def _put_text(self, name: str, profile_index: int, text: str) -> None:
        array = self._array(name, profile_index)
        array[profile_index : profile_index + 1] = np.array([text], dtype=np.dtypes.StringDType())

    def _array(self, name: str, profile_index: int) -> zarr.Array[Any]:
        if name not in self._arrays:
            self._arrays[name] = array_at(self._root, name)
        check_position(profile_index, self._arrays[name].shape[0])
        return self._arrays[name]


def write_profile(place: Place, profile_index: int, group: str, values: Mapping[str, ArrayLike]) -> None:
    """Write one profile's row of some variables of a group, as `ArchiveRows.write` does."""
    ArchiveRows(place).write(profile_index, group, values)


def clear_marker(place: Place, profile_index: int) -> None:
    """Take a profile's commit marker away, before it is computed anew."""
    ArchiveRows(place).begin(profile_index)


def read_markers(place: Place) -> dict[int, dict[str, Any]]:
    """Rows of the table as the commit markers hold them, by position along the profile dimension."""
    return committed_rows(place)


def read_attributes(place: Place) -> dict[str, Any]:
    """Root attributes of an archive."""
    return dict(_open(place, "r").attrs)


def read_profiles(place: Place) -> list[int]:
    """Numbers of an archive's profiles, in the order of its profile dimension.

    Every group repeats them; the first group whose numbers can be read and make sense is believed.

    Raises
    ------
    ValueError
        No group has any.
    """
    root = _open(place, "r")
    for group in MISSION:
        try:
            numbers = np.asarray(array_at(root, label_of(group.name, PROFILE))[:])
        except UNREADABLE:
            continue
        if numbers.size == 1 or (np.diff(numbers) > 0).all():
            return [int(number) for number in numbers]
    raise ValueError(f"{place}: the profiles' numbers are damaged in every group")


def _open(place: Place, mode: Any = "r+") -> zarr.Group:
    return zarr.open_group(store_at(place, read_only=mode == "r"), mode=mode, use_consolidated=False)
