"""Reader of an archive that opens each group on first use.

An archive with every study has about twenty groups and seven hundred variables; a study or a page reads only a few.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np
import xarray as xr
import zarr
from numpy.typing import NDArray
from xarray.backends import ZarrStore
from zarr.abc.store import Store
from zarr.core.group import GroupMetadata
from zarr.storage import StorePath

from gliderhpc.store_schema.commits import array_at
from gliderhpc.store_schema.location import CONSOLIDATED, parsed_root
from gliderhpc.store_schema.schema import PROFILE

Columns = Mapping[str, NDArray[Any]]
"""Columns of the tables by label, such as ``run_seconds`` or ``windows/outcome``."""


class Node:
    """A group in the store; the metadata of its variables are parsed on first use.

    Parameters
    ----------
    path : str
        Its path within the archive, empty for the root.
    attributes : mapping
        Its attributes.
    open_group : callable
        Function that opens it.
    """

    def __init__(self, path: str, attributes: Mapping[str, Any], open_group: Callable[[], zarr.Group]) -> None:
        self.path, self.attributes, self._open_group = path, attributes, open_group

    @cached_property
    def group(self) -> zarr.Group:
        """The opened group."""
        return self._open_group()


class ConsolidatedMetadata:
    """Consolidated metadata of an archive, parsed group by group.

    Zarr parses the metadata of all seven hundred variables at once, which takes longer than most readers need for the
    few variables that they use.

    Parameters
    ----------
    content : bytes
        Content of the root's ``zarr.json``.

    Attributes
    ----------
    is_consolidated : bool
        False if only the root's own metadata is present.

    Raises
    ------
    ValueError, KeyError, TypeError
        The metadata is damaged.
    """

    def __init__(self, content: bytes) -> None:
        root = dict(parsed_root(content))
        consolidated = root.pop(CONSOLIDATED, None)
        self.is_consolidated = consolidated is not None
        members: dict[str, dict[str, Any]] = consolidated["metadata"] if self.is_consolidated else {}
        self._groups = {"": root} | {path: node for path, node in members.items() if node["node_type"] == "group"}
        self._members: dict[str, dict[str, Any]] = {path: {} for path in self._groups}
        for path, member in members.items():
            if path not in self._groups:
                group, _, name = path.rpartition("/")
                self._members[group][name] = member
        self._parsed: dict[str, GroupMetadata] = {}

    def nodes(self, store: Store) -> dict[str, Node]:
        """Return all groups by path in a store; the path of the root is empty."""
        opening = {path: partial(self._open, store, path) for path in self._groups}
        return {path: Node(path, group["attributes"], opening[path]) for path, group in self._groups.items()}

    def _open(self, store: Store, path: str) -> zarr.Group:
        if path not in self._parsed:
            members = {"kind": "inline", "must_understand": False, "metadata": self._members[path]}
            self._parsed[path] = GroupMetadata.from_dict({**self._groups[path], CONSOLIDATED: members})
        return zarr.Group(zarr.AsyncGroup(metadata=self._parsed[path], store_path=StorePath(store, path)))


class ArchiveGroup:
    """A group of an archive, opened on first use.

    Parameters
    ----------
    node : Node
        The group.
    columns : mapping of str to array
        Columns that replace the stored ones.
    """

    def __init__(self, node: Node, columns: Columns) -> None:
        self._node, self._columns = node, columns
        self._dataset: xr.Dataset | None = None

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the group."""
        return dict(self._node.attributes)

    @property
    def sizes(self) -> Mapping[Any, int]:
        """Sizes of the group's dimensions."""
        return self.to_dataset().sizes

    def to_dataset(self) -> xr.Dataset:
        """Return the group's variables; values are read on use."""
        if self._dataset is None:
            opened = xr.open_dataset(ZarrStore(self._node.group, mode="r"))
            self._dataset = with_committed_rows(opened, self._node.path, self._columns)
        return self._dataset


class ArchiveReader(ArchiveGroup):
    """A mission's archive: the table of profiles, and the other groups by name, as in an xarray.DataTree."""

    def __init__(self, nodes: Mapping[str, Node], columns: Columns | None = None) -> None:
        super().__init__(nodes[""], columns or {})
        self._nodes = nodes
        self._groups = {path: ArchiveGroup(node, self._columns) for path, node in nodes.items() if path}

    def with_columns(self, columns: Columns) -> ArchiveReader:
        """Return the archive with columns of its tables replaced."""
        return ArchiveReader(self._nodes, columns)

    @property
    def profile_count(self) -> int:
        """Number of the archive's profiles."""
        return int(array_at(self._node.group, PROFILE).shape[0])

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
        """Do nothing: no file stays open, because every read opens its own file."""


Archive = xr.DataTree | ArchiveReader
"""An archive opened with `gliderhpc.archive.mission.open_mission` or `open_for_reading`."""


def with_committed_rows(dataset: xr.Dataset, group: str, columns: Columns) -> xr.Dataset:
    """Return a group with some columns of its tables replaced; the same dataset if none is replaced."""
    replaced = {
        name: _with_values(str(name), stored, columns[label])
        for name, stored in dataset.variables.items()
        if (label := f"{group}/{name}".lstrip("/")) in columns
    }
    return dataset.assign(replaced) if replaced else dataset


def _with_values(name: str, stored: xr.Variable, column: NDArray[Any]) -> xr.Variable:
    """Return a variable with a column of values in its stored form, decoded."""
    packing = _packing(stored)
    if column.dtype.kind == "f" and "units" not in packing and np.isnan(packing.get("_FillValue", np.nan)):
        return xr.Variable(stored.dims, column, stored.attrs)
    variable = xr.Variable(stored.dims, column, {**stored.attrs, **packing})
    return xr.conventions.decode_cf_variable(name, variable)


def _packing(variable: xr.Variable) -> dict[str, Any]:
    """Return the attributes of a variable that were removed by decoding."""
    return {key: variable.encoding[key] for key in ("units", "calendar", "_FillValue") if key in variable.encoding}
