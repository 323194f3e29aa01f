"""Opening and summary of a mission's archive."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from numbers import Real
from os import PathLike
from typing import Any

import numpy as np
import xarray as xr
import zarr

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.reader import ArchiveReader, Columns, ConsolidatedMetadata, Node, with_committed_rows
from gliderhpc.errors import GliderhpcError, InputError, first_line
from gliderhpc.output_files import NO_SPACE
from gliderhpc.store_schema import (
    SCHEMA_VERSION,
    STATUS,
    check_archive,
    committed_rows,
    damaged_chunks,
    is_archive,
    other_version,
    read_attributes,
    structure_differences,
)
from gliderhpc.store_schema.location import (
    Location,
    describe_other,
    folder_identity,
    is_empty,
    own_metadata,
    root_content,
    store_at,
)
from gliderhpc.store_schema.maintenance import OUTDATED
from gliderhpc.store_schema.rows import mission_columns
from gliderhpc.store_schema.schema import COMPLETE, PROFILE
from gliderhpc.store_schema.verified import VerifiedStore

ATTRIBUTES: dict[str, type | tuple[type, ...]] = {
    "platform": Mapping, "settings": Mapping, "step": Real, "output_interval": Real, "mission": (str, type(None)),
    "observations": str, "observations_digest": str, "observations_source": (str, type(None)), "software_version": str,
    "engine": str, "preset": str, "platform_id": (str, type(None)),
}  # fmt: skip
"""Root attributes that a run writes, and their types."""

_INTERRUPTED = "the study was interrupted"

_FILE_SYSTEM_ERRORS = (errno.EACCES, errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.EIO, errno.ESTALE, errno.ELOOP)
"""Errors of the file system that prevent reading an archive."""


@dataclass(frozen=True)
class MedianCurrent:
    """Median over profiles of the depth-averaged current (m/s), with the number of profiles and the estimator."""

    north: float
    east: float
    count: int
    label: str


@dataclass(frozen=True)
class Summary:
    """Contents of an archive.

    Attributes
    ----------
    path : str or Path
        The archive.
    attributes : mapping
        Root attributes as stored: mission, platform, engine, versions, settings and the rest.
    statuses : mapping of str to int
        Number of profiles by status.
    messages : mapping of int to tuple of str
        Status and message by profile number, for the profiles with a message, failed ones first.
    groups : mapping of str to mapping of str to int
        Sizes of the dimensions by group.
    variables : mapping of str to int
        Number of variables by group, without coordinates.
    notes : mapping of str to str
        Caveat of a study by group: interrupted, or outdated by a change of the archive.
    first_time, last_time : numpy.datetime64
        Times of the first observation of the mission's first profile and of the last one of its last profile, NaT if
        no profile is done yet.
    current : MedianCurrent
        Median depth-averaged current.
    run_seconds : float
        Computing time of all profiles, s.
    """

    path: Location
    attributes: Mapping[str, Any]
    statuses: Mapping[str, int]
    messages: Mapping[int, tuple[str, str]]
    groups: Mapping[str, Mapping[str, int]]
    variables: Mapping[str, int]
    notes: Mapping[str, str]
    first_time: np.datetime64
    last_time: np.datetime64
    current: MedianCurrent
    run_seconds: float


def check_is_path(location: Any, name: str = "archive") -> None:
    """Require a string or path; `name` is the argument named in the message.

    Raises
    ------
    InputError
        It is neither a string nor a path.
    """
    if not isinstance(location, str | PathLike):
        raise InputError(f"{name}: give its path, not a {type(location).__name__}")


def open_mission(path: Location) -> xr.DataTree:
    """Open a mission's archive lazily.

    Parameters
    ----------
    path : str or Path
        Archive written by `gliderhpc run-mission`, finished or not: a folder, or an address such as
        ``s3://bucket/mission.zarr`` (extra ``cloud``).

    Returns
    -------
    xarray.DataTree
        Table of profiles at the root, and the other groups below it; values are read on use.

    Raises
    ------
    InputError
        There is no archive, or its version cannot be read by this program.

    Examples
    --------
    >>> tree = open_mission("mission.zarr")  # doctest: +SKIP
    >>> tree["series"].ds.B_cr.sel(profile=68)  # doctest: +SKIP
    """
    check_is_path(path)
    with archive_errors(path):
        tree = xr.open_datatree(_store(path), engine="zarr", chunks={})
        try:
            _check_attributes(path, tree.attrs)
        except InputError:
            tree.close()
            raise
        columns = _committed_columns(path, tree.sizes[PROFILE])
        for node in tree.subtree:
            dataset = node.to_dataset(inherit=False)
            committed = with_committed_rows(dataset, node.path.strip("/"), columns)
            if committed is not dataset:
                node.dataset = committed
        return tree


def open_for_reading(path: Location) -> ArchiveReader:
    """Open an archive like `open_mission`, but without Dask and with each group opened on first use.

    Opening takes a fifth of the time, and reading a profile or two takes half of the time. Values are also read on use,
    but a selection of a variable is read at once and cached.
    """
    with archive_errors(path):
        archive = ArchiveReader(_nodes(path))
        _check_attributes(path, archive.attrs)
        return archive.with_columns(_committed_columns(path, archive.profile_count))


def _nodes(path: Location) -> dict[str, Node]:
    """Return an archive's groups by path, with the empty path for the root."""
    store = _store(path)
    content = root_content(store_at(path, read_only=True))
    metadata = None if own_metadata(content) is None else _metadata(content or b"")
    if metadata is not None and metadata.is_consolidated:
        return metadata.nodes(store)
    root = zarr.open_group(store, mode="r", zarr_format=3)
    groups: dict[str, zarr.Group] = {"": root, **dict(root.groups())}
    return {name: Node(name, dict(group.attrs), partial(_itself, group)) for name, group in groups.items()}


def _itself(group: zarr.Group) -> zarr.Group:
    return group


@lru_cache(maxsize=2)
def _metadata(content: bytes) -> ConsolidatedMetadata:
    """Parse an archive's metadata once for all readers of the same bytes."""
    return ConsolidatedMetadata(content)


def _store(path: Location) -> Any:
    if is_empty(path):
        raise InputError(f"{path}: no such archive; give the folder that `gliderhpc run-mission` wrote")
    if not is_archive(path):
        raise InputError(describe_other(path))
    return VerifiedStore(store_at(path, read_only=True), str(path))


def _check_attributes(path: Location, attributes: Mapping[Any, Any]) -> None:
    version = str(attributes.get("schema_version", "none"))
    if version.split(".")[0] != SCHEMA_VERSION.split(".")[0]:
        raise InputError(
            f"{path}: the archive's schema has version {version}, but this program reads {SCHEMA_VERSION}; "
            "open it with the version of gliderhpc that wrote it, or run the mission again"
        )
    for fault in attribute_faults(attributes):
        raise InputError(f"{path}: damaged: {fault}; run the mission again")


def _committed_columns(path: Location, count: int) -> Columns:
    """Return the tables' columns from the profiles' commits, which are newer than the tables after a killed run."""
    return dict(mission_columns(committed_rows(path), count))


@contextmanager
def archive_errors(*locations: Location) -> Iterator[Callable[[], None]]:
    """Convert errors from a damaged or unreadable archive to an `InputError` of one line; re-raise all others.

    All commands read archives in this context. Its end also checks that the archives are those that were there at its
    beginning; a command that writes a file within the context checks this first.

    Parameters
    ----------
    *locations : str or Path
        Archives to be read.

    Yields
    ------
    callable
        Function that checks that no archive has been replaced since.

    Raises
    ------
    InputError
        An archive is damaged, or the file system denies access, or another run has replaced the archive meanwhile.
    """
    before = {location: folder_identity(location) for location in locations}

    def check_unchanged(cause: Exception | None = None) -> None:
        for location, identity in before.items():
            if identity not in (None, folder_identity(location)):
                raise InputError(f"{location}: another run replaced it while it was read; try again") from cause

    try:
        yield check_unchanged
        check_unchanged()
    except GliderhpcError as error:
        check_unchanged(error)
        raise
    except Exception as error:
        check_unchanged(error)
        for location in locations:
            fault = _describe_fault(location, error)
            if fault:
                raise InputError(f"{location}: {fault}") from error
        raise


def _describe_fault(location: Location, error: Exception) -> str:
    """Describe the fault of an archive that could not be read; empty if it is intact."""
    if isinstance(error, OSError):
        if error.errno in _FILE_SYSTEM_ERRORS and str(error.filename or "").startswith(str(location)):
            return f"cannot be read ({error.filename}: {error.strerror})"
        if error.errno in NO_SPACE:
            return ""
    if type(error).__module__.startswith("obstore"):
        return f"cannot be read ({first_line(error)})"
    try:
        if other := other_version(location):
            return other
        damages = (
            structure_differences(location, studies=False)
            or damaged_chunks(location)
            or [line for line in check_archive(location) if _INTERRUPTED not in line]
            or list(attribute_faults(read_attributes(location), complete=True))
        )
    except GliderhpcError:
        raise
    except Exception as second:  # noqa: BLE001 - what cannot even be checked is damaged; the first error is the cause
        damages = [f"{type(second).__name__}: {first_line(second)}"]
    if not damages:
        return ""
    more = f", and {len(damages) - 1} more (`gliderhpc check --deep` lists them)" if len(damages) > 1 else ""
    return f"damaged: {damages[0]}{more}"


def attribute_faults(attributes: Mapping[Any, Any], complete: bool = False) -> Iterator[str]:
    """Yield the faults of the root attributes: wrong values, and missing ones if the attributes must be `complete`."""
    for name, kind in ATTRIBUTES.items():
        if name not in attributes:
            if complete:
                yield f"the root attribute {name} is missing"
        elif not isinstance(attributes[name], kind) or isinstance(attributes[name], bool):
            yield f"the root attribute {name} is {str(attributes[name])[:40]!r}, which is not a valid value"
        elif kind is Real and not attributes[name] > 0:
            yield f"the root attribute {name} is {attributes[name]}, not a positive number"


def describe(path: Location) -> Summary:
    """Summarise an archive from its metadata and its table of profiles only.

    Parameters
    ----------
    path : str or Path
        The archive.

    Raises
    ------
    InputError
        As for :func:`open_mission`.
    """
    with archive_errors(path), open_for_reading(path) as archive:
        table = archive.to_dataset().load()
        nodes = {"/": table, **{name: group.to_dataset() for name, group in archive.children.items()}}
        starts = table["start_time"].values.astype("datetime64[ns]")
        known = ~np.isnat(starts)
        starts = starts[known]
        ends = starts + np.round(np.nan_to_num(table["duration"].values[known])).astype("timedelta64[s]")
        return Summary(
            path=path,
            attributes={str(key): value for key, value in archive.attrs.items()},
            statuses={status: int((table["status"] == status).sum()) for status in STATUS},
            messages=_messages(table),
            groups={name: {str(dim): size for dim, size in node.sizes.items()} for name, node in nodes.items()},
            variables={name: len(node.data_vars) for name, node in nodes.items()},
            notes={name: note for name, node in nodes.items() if (note := _note(node))},
            first_time=starts.min() if starts.size else np.datetime64("NaT", "ns"),
            last_time=ends.max() if ends.size else np.datetime64("NaT", "ns"),
            current=_median_current(table),
            run_seconds=float(table["run_seconds"].sum()),
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


def _median_current(table: xr.Dataset) -> MedianCurrent:
    current = adopted_current(table)
    known = current.known
    if not known.any():
        return MedianCurrent(float("nan"), float("nan"), 0, current.label)
    north, east = (float(np.median(values[known])) for values in (current.north, current.east))
    return MedianCurrent(north, east, int(known.sum()), current.label)


def platform_name(attributes: Mapping[str, Any]) -> str:
    """Return the name of an archive's platform from its root attributes."""
    platform = attributes.get("platform")
    return str(platform.get("name")) if isinstance(platform, Mapping) else "unknown platform"
