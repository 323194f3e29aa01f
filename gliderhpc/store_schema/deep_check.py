"""Comparison of every chunk of an archive with the digest that was recorded when it was written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import zarr

from gliderhpc.errors import first_line
from gliderhpc.store_schema.commits import (
    BY_RESUME,
    UNREADABLE,
    Commit,
    array_at,
    damages,
    differing_chunks,
    read_commits,
    row_arrays,
    row_chunks,
    stored_digests,
    stored_keys,
    values_at,
)
from gliderhpc.store_schema.digests import Digests
from gliderhpc.store_schema.location import Location, group_at, store_at
from gliderhpc.store_schema.rows import mission_columns, read_profiles
from gliderhpc.store_schema.schema import COMMITS, DIGESTS, MANIFEST, Group
from gliderhpc.store_schema.study_groups import studies_in, table_damages

_MAX_NAMED_CHUNKS = 3
"""Largest number of damaged chunks of a profile that are listed one by one."""


@dataclass(frozen=True)
class Fault:
    """Deviation from the written data: profile, variable, description and remedy."""

    profile: str
    variable: str
    what: str
    remedy: str


def as_lines(faults: Iterable[Fault]) -> list[str]:
    """Return one line for each fault, or one for all faults of a profile with the same remedy if there are many."""
    grouped: dict[tuple[str, str], list[Fault]] = {}
    for fault in faults:
        grouped.setdefault((fault.profile, fault.remedy), []).append(fault)
    lines: list[str] = []
    for (profile, remedy), group in grouped.items():
        if len(group) <= _MAX_NAMED_CHUNKS:
            lines += [f"{profile}, {fault.variable}: {fault.what}; {remedy}" for fault in group]
        else:
            names = ", ".join(fault.variable for fault in group[:_MAX_NAMED_CHUNKS])
            lines.append(f"{profile}: {len(group)} chunks are missing or damaged ({names}, ...); {remedy}")
    return lines


def damaged_chunks(location: Location) -> list[str]:
    """List the damaged chunks of an archive of valid structure, with their remedies.

    Parameters
    ----------
    location : str or Path
        The archive.

    Returns
    -------
    list of str
        One line for each chunk, with profile and variable, or one line for a profile with many; empty if all chunks are
        unchanged.
    """
    return as_lines(_damaged(location))


def missing_chunks(location: Location) -> list[str]:
    """List the missing chunks of an archive, and rows of its tables that differ from the commits; read nothing else.

    Parameters
    ----------
    location : str or Path
        The archive.

    Returns
    -------
    list of str
        Lines like those of :func:`damaged_chunks`.
    """
    return as_lines(_missing(location))


def committed_chunk_faults(location: Location, *, deep: bool) -> list[str]:
    """List the chunks of committed profiles that are missing, in an archive of any minor version of the schema.

    The commits list the chunks, whatever the variables are. Tables and studies are not compared.

    Parameters
    ----------
    location : str or Path
        The archive.
    deep : bool
        Also list the chunks whose digest is another one.

    Returns
    -------
    list of str
        Lines like those of :func:`damaged_chunks`.
    """
    return as_lines(_committed_chunk_faults(location, deep))


def _committed_chunk_faults(location: Location, deep: bool) -> Iterator[Fault]:
    remedy = "resume it with the version of gliderhpc that made it, or run the mission again"
    numbers, commits = read_profiles(location), read_commits(location)
    for fault in _commit_faults(commits, numbers):
        yield replace(fault, remedy=remedy)
    stored, store = stored_keys(location), store_at(location, read_only=True)
    for index, commit in _valid(commits).items():
        profile = f"profile {numbers[index]}"
        if not deep:
            yield from _missing_of(commit.manifest, stored, profile, remedy)
            continue
        names = {key: key.rpartition("/")[0] for key, digest in commit.manifest.items() if digest is not None}
        for damage in differing_chunks(index, names, commit.manifest, stored_digests(store, names)):
            yield Fault(profile, damage.variable, damage.what, remedy)


def damaged_studies(location: Location) -> list[str]:
    """List the damaged chunks of finished studies, which a run cannot repair, as :func:`damaged_chunks` does."""
    root = group_at(location)
    return as_lines(_damaged_in_studies(location, root, read_profiles(location)))


def _damaged(location: Location) -> Iterator[Fault]:
    numbers = read_profiles(location)
    commits = read_commits(location)
    valid = _valid(commits)
    yield from _commit_faults(commits, numbers)
    for damage in damages(location, valid):
        yield Fault(f"profile {numbers[damage.profile_index]}", damage.variable, damage.what, BY_RESUME)
    root = group_at(location)
    yield from _table_damages(root, numbers, valid, set(commits))
    yield from _damaged_in_studies(location, root, numbers)


def _damaged_in_studies(location: Location, root: zarr.Group, numbers: list[int]) -> Iterator[Fault]:
    for group, _ in studies_in(root, finished=True):
        yield from _study_damages(location, root, group, numbers)


def _missing(location: Location) -> Iterator[Fault]:
    numbers = read_profiles(location)
    commits = read_commits(location)
    yield from _commit_faults(commits, numbers)
    stored = stored_keys(location)
    for index, commit in _valid(commits).items():
        yield from _missing_of(commit.manifest, stored, f"profile {numbers[index]}", BY_RESUME)
    root = group_at(location)
    yield from _table_damages(root, numbers, _valid(commits), set(commits))
    for group, node in studies_in(root, finished=True):
        yield from _missing_of_study(node, group, numbers, stored)


def _missing_of_study(node: zarr.Group, group: Group, numbers: list[int], stored: Set[str]) -> Iterator[Fault]:
    remedy = f"run {group.name} again"
    attributes: dict[str, Any] = dict(node.attrs)
    yield from _missing_of(dict(attributes.get(DIGESTS, {})), stored, "every profile", remedy)
    try:
        manifests = [str(text) for text in np.asarray(array_at(node, MANIFEST)[:])] if MANIFEST in node else []
    except UNREADABLE as error:
        yield Fault("every profile", f"{group.name}/{MANIFEST}", first_line(error), remedy)
        return
    for number, manifest in zip(numbers, manifests, strict=False):
        yield from _missing_of(json.loads(manifest) if manifest else {}, stored, f"profile {number}", remedy)


def _missing_of(digests: Digests, stored: Set[str], profile: str, remedy: str) -> Iterator[Fault]:
    for key, digest in digests.items():
        if digest is not None and key not in stored:
            yield Fault(profile, key.rpartition("/")[0], "the chunk is missing", remedy)


def _valid(commits: Mapping[int, Commit | str]) -> dict[int, Commit]:
    return {index: commit for index, commit in commits.items() if not isinstance(commit, str)}


def _commit_faults(commits: Mapping[int, Commit | str], numbers: list[int]) -> Iterator[Fault]:
    for index, commit in commits.items():
        if isinstance(commit, str):
            yield Fault(f"profile {numbers[index]}", COMMITS, commit, BY_RESUME)


def _table_damages(
    root: zarr.Group, numbers: list[int], commits: Mapping[int, Commit], marked: set[int]
) -> Iterator[Fault]:
    """Compare the tables with the commits, which repeat them."""
    rows = {index: commit.row for index, commit in commits.items()}
    columns = dict(mission_columns(rows, len(numbers)))
    stored = values_at(root, columns)
    for name, committed in columns.items():
        column = stored[name]
        if column is None:
            yield Fault("every profile", name, "the chunk is damaged", BY_RESUME)
            continue
        for index in commits:
            if not _is_equal(column[index], committed[index]):
                what = f"the table has {column[index]!s}, but the commit has {committed[index]!s}"
                yield Fault(f"profile {numbers[index]}", name, what, BY_RESUME)
        if name == "status":
            for index, status in enumerate(column):
                if index not in marked and str(status) != "pending":
                    yield Fault(f"profile {numbers[index]}", COMMITS, "the marker is missing", BY_RESUME)


def _study_damages(location: Location, root: zarr.Group, group: Group, numbers: list[int]) -> Iterator[Fault]:
    """Compare a study's chunks with their digests when it was finished."""
    remedy = f"run {group.name} again"
    store = store_at(location, read_only=True)
    for damage in table_damages(location, group):
        yield Fault("every profile", damage.variable, damage.what, remedy)
    arrays = row_arrays(root, [group])
    if not arrays:
        return
    try:
        manifests = np.asarray(array_at(root, f"{group.name}/{MANIFEST}")[:])
    except UNREADABLE:
        return  # reported above: the manifests are a table
    for index, number in enumerate(numbers):
        chunks = row_chunks(arrays, index)
        manifest = json.loads(str(manifests[index])) if manifests[index] else {}
        for damage in differing_chunks(index, chunks, manifest, stored_digests(store, chunks)):
            yield Fault(f"profile {number}", damage.variable, damage.what, remedy)


def _is_equal(first: Any, second: Any) -> bool:
    return bool(first == second or (first != first and second != second))
