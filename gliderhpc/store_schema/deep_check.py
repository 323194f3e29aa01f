"""Holding every chunk of an archive against the digest with which it was written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr

from gliderhpc.errors import first_line
from gliderhpc.store_schema.access import read_profiles
from gliderhpc.store_schema.commits import (
    BY_RESUME,
    UNREADABLE,
    Commit,
    array_at,
    compared,
    damages,
    read_commits,
    row_arrays,
    row_chunks,
    stored_digests,
    stored_keys,
)
from gliderhpc.store_schema.mission_groups import COMMITS
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.schema import Group
from gliderhpc.store_schema.studies import COMPLETE, DIGESTS, MANIFEST, STUDIES
from gliderhpc.store_schema.study_digests import table_damages
from gliderhpc.store_schema.tables import mission_columns

_SHOWN = 3
"""Chunks of a profile that are named, each in a line or all in one."""


def damaged_chunks(place: Place) -> list[str]:
    """Chunks of an archive whose structure is sound that are not what was written, and what mends them.

    Parameters
    ----------
    place : str or Path
        The archive.

    Returns
    -------
    list of str
        A line a chunk, naming profile and variable, and one line where a profile has more than a few; empty where all
        is as it was written.
    """
    return _as_lines(_damaged(place))


def missing_chunks(place: Place) -> list[str]:
    """Chunks of an archive that are not there, and rows of its tables that commits contradict; no other chunk is read.

    Parameters
    ----------
    place : str or Path
        The archive.

    Returns
    -------
    list of str
        As for :func:`damaged_chunks`.
    """
    return _as_lines(_missing(place))


def damaged_studies(place: Place) -> list[str]:
    """Chunks of finished studies that are not what was written, which a run cannot mend; lines as above."""
    root = zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False)
    return _as_lines(_damaged_in_studies(place, root, read_profiles(place)))


@dataclass(frozen=True)
class _Fault:
    """Something that is not as it was written: where, what is wrong, and what mends it."""

    profile: str
    variable: str
    what: str
    remedy: str


def _as_lines(faults: Iterable[_Fault]) -> list[str]:
    """One line a fault, or one for all of a profile that need the same remedy where there are more than a few."""
    grouped: dict[tuple[str, str], list[_Fault]] = {}
    for fault in faults:
        grouped.setdefault((fault.profile, fault.remedy), []).append(fault)
    lines: list[str] = []
    for (profile, remedy), found in grouped.items():
        if len(found) <= _SHOWN:
            lines += [f"{profile}, {fault.variable}: {fault.what}; {remedy}" for fault in found]
        else:
            names = ", ".join(fault.variable for fault in found[:_SHOWN])
            lines.append(f"{profile}: {len(found)} chunks are missing or damaged ({names}, ...); {remedy}")
    return lines


def _damaged(place: Place) -> Iterator[_Fault]:
    numbers = read_profiles(place)
    commits = read_commits(place)
    valid = _valid(commits)
    yield from _commit_faults(commits, numbers)
    for damage in damages(place, valid):
        yield _Fault(f"profile {numbers[damage.profile_index]}", damage.variable, damage.what, BY_RESUME)
    root = zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False)
    yield from _table_damages(root, numbers, valid, set(commits))
    yield from _damaged_in_studies(place, root, numbers)


def _damaged_in_studies(place: Place, root: zarr.Group, numbers: list[int]) -> Iterator[_Fault]:
    for group in STUDIES:
        node = root.get(group.name)
        if isinstance(node, zarr.Group) and node.attrs.get(COMPLETE, False):
            yield from _study_damages(place, root, group, numbers)


def _missing(place: Place) -> Iterator[_Fault]:
    numbers = read_profiles(place)
    commits = read_commits(place)
    yield from _commit_faults(commits, numbers)
    stored = stored_keys(place)
    for index, commit in _valid(commits).items():
        for key, digest in commit.manifest.items():
            if digest is not None and key not in stored:
                yield _Fault(f"profile {numbers[index]}", key.rpartition("/")[0], "the chunk is missing", BY_RESUME)
    root = zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False)
    yield from _table_damages(root, numbers, _valid(commits), set(commits))
    for group in STUDIES:
        node = root.get(group.name)
        if isinstance(node, zarr.Group) and node.attrs.get(COMPLETE, False):
            yield from _missing_of_study(node, group, numbers, stored)


def _missing_of_study(node: zarr.Group, group: Group, numbers: list[int], stored: Set[str]) -> Iterator[_Fault]:
    again = f"run {group.name} again"
    attributes: dict[str, Any] = dict(node.attrs)
    for key, digest in dict(attributes.get(DIGESTS, {})).items():
        if digest is not None and key not in stored:
            yield _Fault("every profile", key.rpartition("/")[0], "the chunk is missing", again)
    try:
        manifests = [str(text) for text in np.asarray(array_at(node, MANIFEST)[:])] if MANIFEST in node else []
    except UNREADABLE as error:
        yield _Fault("every profile", f"{group.name}/{MANIFEST}", first_line(error), again)
        return
    for number, manifest in zip(numbers, manifests, strict=False):
        for key, digest in (json.loads(manifest) if manifest else {}).items():
            if digest is not None and key not in stored:
                yield _Fault(f"profile {number}", key.rpartition("/")[0], "the chunk is missing", again)


def _valid(commits: Mapping[int, Commit | str]) -> dict[int, Commit]:
    return {index: commit for index, commit in commits.items() if not isinstance(commit, str)}


def _commit_faults(commits: Mapping[int, Commit | str], numbers: list[int]) -> Iterator[_Fault]:
    for index, commit in commits.items():
        if isinstance(commit, str):
            yield _Fault(f"profile {numbers[index]}", COMMITS, commit, BY_RESUME)


def _table_damages(
    root: zarr.Group, numbers: list[int], commits: Mapping[int, Commit], marked: set[int]
) -> Iterator[_Fault]:
    """Hold the tables against the commits, which repeat them."""
    rows = {index: commit.row for index, commit in commits.items()}
    for name, wanted in mission_columns(rows, len(numbers)):
        try:
            found = np.asarray(array_at(root, name)[:])
        except UNREADABLE:
            yield _Fault("every profile", name, "the chunk is damaged", BY_RESUME)
            continue
        for index in commits:
            if not _equal(found[index], wanted[index]):
                what = f"the table has {found[index]!s}, the commit {wanted[index]!s}"
                yield _Fault(f"profile {numbers[index]}", name, what, BY_RESUME)
        if name == "status":
            for index, status in enumerate(found):
                if index not in marked and str(status) != "pending":
                    yield _Fault(f"profile {numbers[index]}", COMMITS, "the marker is missing", BY_RESUME)


def _study_damages(place: Place, root: zarr.Group, group: Group, numbers: list[int]) -> Iterator[_Fault]:
    """Hold a study's chunks against the digests that it was finished with."""
    again = f"run {group.name} again"
    store = store_at(place, read_only=True)
    for damage in table_damages(place, group):
        yield _Fault("every profile", damage.variable, damage.what, again)
    arrays = row_arrays(root, [group])
    if not arrays:
        return
    try:
        manifests = np.asarray(array_at(root, f"{group.name}/{MANIFEST}")[:])
    except UNREADABLE:
        return  # told of above: the manifests are a table
    for index, number in enumerate(numbers):
        chunks = row_chunks(arrays, index)
        manifest = json.loads(str(manifests[index])) if manifests[index] else {}
        for damage in compared(index, chunks, manifest, stored_digests(store, chunks)):
            yield _Fault(f"profile {number}", damage.variable, damage.what, again)


def _equal(found: Any, wanted: Any) -> bool:
    return bool(found == wanted or (found != found and wanted != wanted))
