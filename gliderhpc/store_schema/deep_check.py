"""Holding every chunk of an archive against the digest with which it was written."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import zarr

from gliderhpc.store_schema.access import read_profiles
from gliderhpc.store_schema.commits import (
    UNREADABLE,
    Commit,
    array_at,
    compared,
    damages,
    read_commits,
    row_arrays,
    row_chunks,
    stored_digests,
)
from gliderhpc.store_schema.mission_groups import COMMITS
from gliderhpc.store_schema.place import Place, store_at
from gliderhpc.store_schema.schema import Group
from gliderhpc.store_schema.studies import COMPLETE, MANIFEST, STUDIES
from gliderhpc.store_schema.study_digests import table_damages
from gliderhpc.store_schema.tables import mission_columns

BY_RESUME = "run-mission --resume mends it"


def damaged_chunks(place: Place) -> list[str]:
    """Chunks of an archive whose structure is sound that are not what was written, and what mends them.

    Parameters
    ----------
    place : str or Path
        The archive.

    Returns
    -------
    list of str
        One line a chunk, naming profile and variable; empty where all is as it was written.
    """
    return list(_damaged(place))


def _damaged(place: Place) -> Iterator[str]:
    numbers = read_profiles(place)
    commits = read_commits(place)
    valid = {index: commit for index, commit in commits.items() if not isinstance(commit, str)}
    for index, commit in commits.items():
        if isinstance(commit, str):
            yield f"profile {numbers[index]}, {COMMITS}: {commit}; {BY_RESUME}"
    for damage in damages(place, valid):
        yield f"profile {numbers[damage.profile_index]}, {damage.variable}: {damage.what}; {BY_RESUME}"
    root = zarr.open_group(store_at(place, read_only=True), mode="r", use_consolidated=False)
    yield from _table_damages(root, numbers, valid, set(commits))
    for group in STUDIES:
        node = root.get(group.name)
        if isinstance(node, zarr.Group) and node.attrs.get(COMPLETE, False):
            yield from _study_damages(place, root, group, numbers)


def _table_damages(
    root: zarr.Group, numbers: list[int], commits: Mapping[int, Commit], marked: set[int]
) -> Iterator[str]:
    """Hold the tables against the commits, which repeat them."""
    rows = {index: commit.row for index, commit in commits.items()}
    for name, wanted in mission_columns(rows, len(numbers)):
        try:
            found = np.asarray(array_at(root, name)[:])
        except UNREADABLE:
            yield f"every profile, {name}: the chunk is damaged; {BY_RESUME}"
            continue
        for index in commits:
            if not _equal(found[index], wanted[index]):
                yield (
                    f"profile {numbers[index]}, {name}: the table has {found[index]!s}, the commit {wanted[index]!s}; "
                    f"{BY_RESUME}"
                )
        if name == "status":
            for index, status in enumerate(found):
                if index not in marked and str(status) != "pending":
                    yield f"profile {numbers[index]}, {COMMITS}: the marker is missing; {BY_RESUME}"


def _study_damages(place: Place, root: zarr.Group, group: Group, numbers: list[int]) -> Iterator[str]:
    """Hold a study's chunks against the digests that it was finished with."""
    again = f"run {group.name} again"
    store = store_at(place, read_only=True)
    for damage in table_damages(place, group):
        yield f"every profile, {damage.variable}: {damage.what}; {again}"
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
            yield f"profile {number}, {damage.variable}: {damage.what}; {again}"


def _equal(found: Any, wanted: Any) -> bool:
    return bool(found == wanted or (found != found and wanted != wanted))
