"""Differences between two archives: attributes, profiles, tables and series.

Rows whose chunks have equal digests in both archives are equal; only the others are read, one profile at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from gliderhpc.store_schema.commits import Commit, array_at, label_of, read_commits, row_arrays, row_chunks
from gliderhpc.store_schema.location import Location, group_at
from gliderhpc.store_schema.rows import read_attributes, read_profiles
from gliderhpc.store_schema.schema import COMMITS, MISSION, PROFILE
from gliderhpc.wording import counted

TIMED = ("run_seconds",)
"""Variables of computing time, which differ between any two runs."""


@dataclass(frozen=True)
class Difference:
    """Difference of a variable over the profiles that both archives hold.

    Attributes
    ----------
    variable : str
        ``GROUP/NAME``.
    profiles : tuple of int
        Numbers of the profiles in which it differs.
    largest : float
        Largest difference between two known values; NaN if only missing values, or texts, differ.
    typical : float
        Root mean square of the known values of the first archive in these profiles; NaN in the same cases.
    missing : int
        Number of values that are missing in only one archive.
    """

    variable: str
    profiles: tuple[int, ...]
    largest: float
    typical: float
    missing: int

    def describe(self) -> str:
        """Describe the difference in one line."""
        where = f"{self.variable}: differs in {counted(len(self.profiles), 'profile')} ({_abbreviated(self.profiles)})"
        if np.isfinite(self.largest):
            where += f", by {self.largest:.3g} at most (root mean square of the values {self.typical:.3g})"
        return where + (f", {counted(self.missing, 'value')} missing in only one of the two" if self.missing else "")


@dataclass(frozen=True)
class ArchiveComparison:
    """Differences between two archives.

    Attributes
    ----------
    attributes : tuple of str
        One line for each attribute, setting or platform value that differs.
    only_first, only_second : tuple of int
        Profiles that only one archive holds.
    variables : tuple of Difference
        Variables that differ in the profiles of both.
    same : int
        Number of profiles of both archives in which nothing differs.
    """

    attributes: tuple[str, ...]
    only_first: tuple[int, ...]
    only_second: tuple[int, ...]
    variables: tuple[Difference, ...]
    same: int

    @property
    def equal(self) -> bool:
        """Return whether the archives are equal."""
        return not (self.attributes or self.only_first or self.only_second or self.variables)


def compare_archives(first: Location, second: Location) -> ArchiveComparison:
    """Compare the mission's groups of two archives; studies and computing times are excluded.

    Parameters
    ----------
    first, second : str or Path
        Archives of the current schema.
    """
    numbers = [read_profiles(location) for location in (first, second)]
    attributes = _without_file_name(read_attributes(first), read_attributes(second))
    both = sorted(set(numbers[0]) & set(numbers[1]))
    pairs = {number: (numbers[0].index(number), numbers[1].index(number)) for number in both}
    roots = [group_at(p) for p in (first, second)]
    differences = [*_table_differences(roots, pairs), *_row_differences(roots, (first, second), pairs)]
    differing = {number for difference in differences for number in difference.profiles}
    return ArchiveComparison(
        tuple(_attribute_differences(attributes[0], attributes[1])),
        tuple(sorted(set(numbers[0]) - set(both))),
        tuple(sorted(set(numbers[1]) - set(both))),
        tuple(differences),
        len(both) - len(differing),
    )


def _without_file_name(*attributes: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Leave out the name of the observation file where both archives are made from the same bytes."""
    if len({archive.get("observations_digest") for archive in attributes}) > 1:
        return [dict(archive) for archive in attributes]
    return [{key: value for key, value in archive.items() if key != "observations"} for archive in attributes]


def _attribute_differences(first: Mapping[str, Any], second: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key in dict.fromkeys((*first, *second)):
        ours, theirs = first.get(key), second.get(key)
        if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
            yield from _attribute_differences(ours, theirs, f"{prefix}{key}.")
        elif ours != theirs:
            yield f"{prefix}{key}: {ours} and {theirs}"


def _table_differences(roots: list[zarr.Group], pairs: Mapping[int, tuple[int, int]]) -> Iterator[Difference]:
    for group in MISSION:
        for variable in group.variables:
            if not variable.is_table or variable.name in (PROFILE, *TIMED) or group.name == COMMITS:
                continue
            name = label_of(group.name, variable.name)
            columns = [np.asarray(array_at(root, name)[:]) for root in roots]
            values = ((number, columns[0][i : i + 1], columns[1][j : j + 1]) for number, (i, j) in pairs.items())
            yield from _difference(name, values, None)


def _row_differences(
    roots: list[zarr.Group], locations: tuple[Location, Location], pairs: Mapping[int, tuple[int, int]]
) -> Iterator[Difference]:
    arrays = [row_arrays(root, MISSION) for root in roots]
    commits = [read_commits(location) for location in locations]
    for name in arrays[0]:
        first, second = ({name: of_archive[name]} for of_archive in arrays)
        values = (
            (number, np.asarray(first[name][i]), np.asarray(second[name][j]))
            for number, (i, j) in pairs.items()
            if _digests(first, commits[0].get(i), i) != _digests(second, commits[1].get(j), j)
        )
        yield from _difference(name, values, first[name].fill_value)


def _digests(array: Mapping[str, zarr.Array[Any]], commit: Commit | str | None, index: int) -> object:
    """Return the digests of a row's chunks and its length; without a commit, a value that equals no other."""
    if not isinstance(commit, Commit):
        return object()
    return [commit.manifest.get(key) for key in row_chunks(array, index)], {a.shape[1] for a in array.values()}


def _difference(name: str, values: Iterable[tuple[int, NDArray[Any], NDArray[Any]]], fill: Any) -> Iterator[Difference]:
    """Yield the difference of a variable, if any, from its values by profile number."""
    differing, largest, squares, count, missing = [], np.nan, 0.0, 0, 0
    for number, ours, theirs in values:
        ours, theirs = _same_length(ours, theirs, fill)
        if _equal(ours, theirs):
            continue
        differing.append(number)
        if ours.dtype.kind in "iufb":
            known = np.isfinite(ours) & np.isfinite(theirs)
            missing += int(np.count_nonzero(np.isfinite(ours) != np.isfinite(theirs)))
            if known.any():
                first, second = ours[known].astype(np.float64), theirs[known].astype(np.float64)
                largest = float(np.fmax(largest, np.abs(first - second).max()))
                squares, count = squares + float(first @ first), count + first.size
    if differing:
        yield Difference(name, tuple(differing), largest, np.sqrt(squares / count) if count else np.nan, missing)


def _same_length(ours: NDArray[Any], theirs: NDArray[Any], fill: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Pad both rows with the fill value to the length of the longer."""
    length = max(ours.size, theirs.size)

    def filled(row: NDArray[Any]) -> NDArray[Any]:
        if row.size == length:
            return row
        return np.concatenate([row, np.full(length - row.size, fill, dtype=row.dtype)])

    return filled(ours), filled(theirs)


def _equal(ours: NDArray[Any], theirs: NDArray[Any]) -> bool:
    return bool(np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f"))


def _abbreviated(numbers: tuple[int, ...], limit: int = 8) -> str:
    listed = ", ".join(map(str, numbers[:limit]))
    return listed + (" ..." if len(numbers) > limit else "")
