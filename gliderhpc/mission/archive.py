"""Opening a mission's archive, and saying what is in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.mission.taken_current import taken_current
from gliderhpc.store_schema import SCHEMA_VERSION, STATUS, is_archive, read_markers
from gliderhpc.store_schema.grow import OUTDATED
from gliderhpc.store_schema.place import Place, is_empty, store_at
from gliderhpc.store_schema.schema import PROFILE
from gliderhpc.store_schema.studies import COMPLETE
from gliderhpc.store_schema.tables import mission_columns
from gliderhpc.store_schema.verified import VerifiedStore


@dataclass(frozen=True)
class Current:
    """Median over profiles of the depth-averaged current, m/s, how many profiles have one, and what made them."""

    north: float
    east: float
    count: int
    label: str


@dataclass(frozen=True)
class Summary:
    """What an archive holds.

    Attributes
    ----------
    path : str or Path
        The archive.
    attributes : mapping
        Root attributes as stored: mission, platform, engine, versions, settings and the rest.
    statuses : mapping of str to int
        Number of profiles by status.
    messages : mapping of int to tuple of str
        By profile number, status and message of the profiles that have one, failed ones first.
    groups : mapping of str to mapping of str to int
        Sizes of the dimensions by group.
    variables : mapping of str to int
        Number of variables by group, coordinates left out.
    notes : mapping of str to str
        What to mind about a study's group: that it was interrupted, or made before the archive changed.
    first_time, last_time : numpy.datetime64
        First observation of the mission's first and of its last profile, NaT where nothing is done yet.
    current : Current
        Median depth-averaged current.
    run_seconds : float
        Computing time of all profiles, s.
    """

    path: Place
    attributes: Mapping[str, Any]
    statuses: Mapping[str, int]
    messages: Mapping[int, tuple[str, str]]
    groups: Mapping[str, Mapping[str, int]]
    variables: Mapping[str, int]
    notes: Mapping[str, str]
    first_time: np.datetime64
    last_time: np.datetime64
    current: Current
    run_seconds: float


def open_mission(path: Place) -> xr.DataTree:
    """Open a mission's archive lazily.

    Parameters
    ----------
    path : str or Path
        The archive that `gliderhpc run-mission` wrote, finished or not: a folder, or an address such as
        ``s3://bucket/mission.zarr`` (extra ``cloud``).

    Returns
    -------
    xarray.DataTree
        The profiles' table at the root, the groups of interfaces.md 5 below it; values are read when they are used.

    Raises
    ------
    InputError
        There is nothing, or something else, or an archive of a version that this program cannot read.

    Examples
    --------
    >>> tree = open_mission("mission.zarr")  # doctest: +SKIP
    >>> tree["series"].ds.B_cr.sel(profile=68)  # doctest: +SKIP
    """
    return _with_committed_table(path, _opened(path, chunks={}))


def open_for_reading(path: Place) -> xr.DataTree:
    """Open an archive as `open_mission` does, but without Dask: half the time for whoever reads a profile or two.

    Values are read when they are used here too, but what is taken of a variable is read at once and kept.
    """
    return _with_committed_table(path, _opened(path, chunks=None))


def open_for_job(path: Place) -> xr.DataTree:
    """Open an archive as `open_for_reading` does, with its table as stored, for one of a study's many jobs."""
    return _opened(path, chunks=None)


def _opened(path: Place, chunks: Mapping[str, int] | None) -> xr.DataTree:
    if is_empty(path):
        raise InputError(f"{path}: no such archive; give the folder that `gliderhpc run-mission --store` wrote")
    if not is_archive(path):
        raise InputError(f"{path}: no archive of gliderhpc; give the folder that `gliderhpc run-mission --store` wrote")
    source: Any = VerifiedStore(store_at(path, read_only=True), str(path))
    tree = xr.open_datatree(source, engine="zarr", chunks=chunks)
    _check_version(path, tree)
    return tree


def _with_committed_table(path: Place, tree: xr.DataTree) -> xr.DataTree:
    """Put what the profiles' commits say in place of the tables, which a killed run leaves behind them."""
    columns = dict(mission_columns(read_markers(path), tree.sizes[PROFILE]))
    for node in tree.subtree:
        group, dataset = node.path.strip("/"), node.to_dataset(inherit=False)
        own = {
            name: (array.dims, columns[label], {**array.attrs, **_packing(array)})
            for name, array in dataset.data_vars.items()
            if (label := f"{group}/{name}".lstrip("/")) in columns
        }
        if own:
            node.dataset = dataset.assign(xr.decode_cf(xr.Dataset(own)).data_vars)
    return tree


def _packing(variable: xr.DataArray) -> dict[str, Any]:
    """What decoding took out of a variable's attributes."""
    return {key: variable.encoding[key] for key in ("units", "calendar", "_FillValue") if key in variable.encoding}


def describe(path: Place) -> Summary:
    """Say what an archive holds, from its metadata and its table of profiles alone.

    Parameters
    ----------
    path : str or Path
        The archive.

    Raises
    ------
    InputError
        As :func:`open_mission`.
    """
    with open_mission(path) as tree:
        table = tree.to_dataset().load()
        nodes = {node.path.lstrip("/") or "/": node.to_dataset(inherit=False) for node in tree.subtree}
        times = table["start_time"].values
        known = np.sort(times[~np.isnat(times)])
        return Summary(
            path=path,
            attributes={str(key): value for key, value in tree.attrs.items()},
            statuses={status: int((table["status"] == status).sum()) for status in STATUS},
            messages=_messages(table),
            groups={name: {str(dim): size for dim, size in node.sizes.items()} for name, node in nodes.items()},
            variables={name: len(node.data_vars) for name, node in nodes.items()},
            notes={name: note for name, node in nodes.items() if (note := _note(node))},
            first_time=known[0] if known.size else np.datetime64("NaT", "ns"),
            last_time=known[-1] if known.size else np.datetime64("NaT", "ns"),
            current=_median_current(table),
            run_seconds=float(table["run_seconds"].sum()),
        )


def _check_version(path: Place, tree: xr.DataTree) -> None:
    version = str(tree.attrs.get("schema_version", "none"))
    if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
        tree.close()
        raise InputError(
            f"{path}: the archive's schema has version {version}, this program reads {SCHEMA_VERSION}; "
            "open it with the version of gliderhpc that wrote it, or run the mission anew"
        )


def _note(node: xr.Dataset) -> str:
    if not node.attrs.get(COMPLETE, True):
        return "interrupted"
    return str(node.attrs.get(OUTDATED, ""))


def _messages(table: xr.Dataset) -> dict[int, tuple[str, str]]:
    rows = [
        (int(number), str(status), str(message))
        for number, status, message in zip(
            table["profile"].values, table["status"].values, table["message"].values, strict=True
        )
        if message
    ]
    rows.sort(key=lambda row: (row[1] != "failed", row[0]))
    return {number: (status, message) for number, status, message in rows}


def _median_current(table: xr.Dataset) -> Current:
    current = taken_current(table)
    known = current.known
    if not known.any():
        return Current(float("nan"), float("nan"), 0, current.label)
    north, east = (float(np.median(values[known])) for values in (current.north, current.east))
    return Current(north, east, int(known.sum()), current.label)
