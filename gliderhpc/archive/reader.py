"""Reader of an archive that opens each group when it is first asked for.

An archive with every study has some twenty groups and seven hundred variables; a study or a page reads a few.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr
import zarr
from numpy.typing import NDArray
from xarray.backends import ZarrStore

from gliderhpc.store_schema.commits import array_at
from gliderhpc.store_schema.schema import PROFILE

Columns = Mapping[str, NDArray[Any]]
"""Columns of the tables by label, such as ``run_seconds`` or ``windows/outcome``."""


class ArchiveGroup:
    """A group of an archive, opened on first use.

    Parameters
    ----------
    node : zarr.Group
        The group.
    columns : mapping of str to array
        Columns that replace those stored.
    """

    def __init__(self, node: zarr.Group, columns: Columns) -> None:
        self._node, self._columns = node, columns
        self._dataset: xr.Dataset | None = None

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the group."""
        return dict(self._node.attrs)

    @property
    def sizes(self) -> Mapping[Any, int]:
        """Sizes of the group's dimensions."""
        return self.to_dataset().sizes

    def to_dataset(self) -> xr.Dataset:
        """Return the group's variables; values are read on use."""
        if self._dataset is None:
            opened = xr.open_dataset(ZarrStore(self._node, mode="r"))
            self._dataset = with_committed_rows(opened, self._node.path, self._columns)
        return self._dataset


class ArchiveReader(ArchiveGroup):
    """A mission's archive: the table of profiles, and the other groups by name, as those of an xarray.DataTree."""

    def __init__(self, node: zarr.Group, columns: Columns | None = None) -> None:
        super().__init__(node, columns or {})
        self._groups = {name: ArchiveGroup(group, self._columns) for name, group in node.groups()}

    def with_columns(self, columns: Columns) -> ArchiveReader:
        """Return the archive with columns of its tables replaced."""
        return ArchiveReader(self._node, columns)

    @property
    def profile_count(self) -> int:
        """Number of the archive's profiles."""
        return int(array_at(self._node, PROFILE).shape[0])

    @property
    def children(self) -> Mapping[str, ArchiveGroup]:
        """Groups by name."""
        return self._groups

    def __getitem__(self, name: str) -> Any:
        """Return a group, or a variable of the table."""
        return self._groups[name] if name in self._groups else self.to_dataset()[name]

    def __enter__(self) -> ArchiveReader:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing stays open: every read opens the file that it reads."""


Archive = xr.DataTree | ArchiveReader
"""An opened archive, by `gliderhpc.archive.mission.open_mission` or `open_for_reading`."""


def with_committed_rows(dataset: xr.Dataset, group: str, columns: Columns) -> xr.Dataset:
    """Return a group with some columns of its tables replaced; the same dataset where none is."""
    own = {
        name: (array.dims, columns[label], {**array.attrs, **_packing(array)})
        for name, array in dataset.data_vars.items()
        if (label := f"{group}/{name}".lstrip("/")) in columns
    }
    return dataset.assign(xr.decode_cf(xr.Dataset(own)).data_vars) if own else dataset


def _packing(variable: xr.DataArray) -> dict[str, Any]:
    """Return the attributes that decoding has removed from a variable."""
    return {key: variable.encoding[key] for key in ("units", "calendar", "_FillValue") if key in variable.encoding}
