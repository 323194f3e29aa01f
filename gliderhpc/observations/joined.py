"""Joining of one glider's observation files, of one or several dives each, into one file."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.format import REFERENCE, VARIABLES
from gliderhpc.observations.in_memory import FIXES, read_records, write_records
from gliderhpc.observations.stored_reads import Reads, read_directly
from gliderhpc.observations.writer import TIMES


def join_observations(paths: Sequence[Path], out: Path, reads: Reads = read_directly) -> dict[str, str]:
    """Join observation files by time.

    Parameters
    ----------
    paths : sequence of Path
        Files in the observation format, in any order; of two that contradict each other, the first one is used.
    out : Path
        The file to write; an existing file is replaced.
    reads : Reads
        Function that reads each file.

    Returns
    -------
    dict of str to str
        Reasons for the files that were left out, by file name. A file is left out if it is unreadable, overlaps a file
        given before it in time or repeats one of its profile numbers, or alone has or lacks profile numbers.

    Raises
    ------
    InputError
        No file can be used, or `out` cannot be written.
    """
    opened: dict[Path, _FileContent] = {}
    left_out: dict[str, str] = {}
    for path in paths:
        try:
            opened[path] = reads(_read_file, path)
        except InputError as error:
            left_out[path.name] = str(error)
    chosen: list[tuple[np.datetime64, Path]] = []
    owners: dict[int, str] = {}
    for path, content in opened.items():
        numbers, entry = _numbers(content), (content.values("time")[0], path)
        place = bisect_left(chosen, entry)
        neighbours = [neighbour for _, neighbour in chosen[max(place - 1, 0) : place + 1]]
        conflicts = (_conflict(content, numbers, opened[one], one.name, owners) for one in neighbours)
        conflict = next(filter(None, conflicts), "")
        if conflict:
            left_out[path.name] = f"{path}: {conflict}"
        else:
            chosen.insert(place, entry)
            owners |= dict.fromkeys(numbers, path.name)
    if not chosen:
        raise InputError(next(iter(left_out.values()), "no observation file"))
    out.unlink(missing_ok=True)
    write_records(_joined([opened[path] for _, path in chosen]), out)
    return left_out


@dataclass(frozen=True, eq=False)
class _FileContent:
    """Variables of a file by name (dimensions, values and attributes), and its global attributes."""

    variables: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]
    attributes: dict[str, Any]

    def values(self, name: str) -> NDArray[Any]:
        """Return the values of a variable."""
        return self.variables[name][1]


def _read_file(path: Path) -> _FileContent:
    with read_records(path) as records:
        if not records.sizes["time"]:
            raise InputError(f"{path}: has no samples")
        variables = {
            str(name): (tuple(map(str, variable.dims)), variable.values, dict(variable.attrs))
            for name, variable in records.variables.items()
            if name in (*VARIABLES, *TIMES) and name not in REFERENCE
        }
        return _FileContent(variables, {str(key): value for key, value in records.attrs.items()})


def _conflict(
    records: _FileContent, numbers: set[int], other: _FileContent, other_name: str, owners: Mapping[int, str]
) -> str:
    """Describe why records and their profiles contradict those next to them in time; empty if they do not."""
    time, taken = records.values("time"), other.values("time")
    if time[0] <= taken[-1] and taken[0] <= time[-1]:
        return f"overlaps {other_name} in time; give every sample once"
    if ("profile" in records.variables) != ("profile" in other.variables):
        return "has profile numbers and the others have none, or the reverse; give them in all files or in none"
    shared = numbers & owners.keys()
    if shared:
        return f"profile {min(shared)} is also in {owners[min(shared)]}; give every profile its own number"
    return ""


def _numbers(records: _FileContent) -> set[int]:
    """Numbers of the profiles in a file; empty if it does not number them."""
    if "profile" not in records.variables:
        return set()
    return set(np.unique(np.nan_to_num(records.values("profile"))).astype(int).tolist()) - {0}


def _joined(parts: Sequence[_FileContent]) -> xr.Dataset:
    names = {name for part in parts for name in part.variables}
    fixed = [part for part in parts if all(name in part.variables for name in FIXES)]
    variables = {
        name: _along(name, fixed if name in FIXES else parts) for name in sorted(names) if name not in FIXES or fixed
    }
    if fixed:
        order = np.unique(variables["fix_time"].values, return_index=True)[1]
        variables |= {name: variables[name][order] for name in FIXES}
    return xr.Dataset(variables, attrs=dict(parts[0].attributes))


def _along(name: str, parts: Sequence[_FileContent]) -> xr.Variable:
    """Join one variable; NaN for the samples of a file that does not have it."""
    pieces = [
        part.variables[name] if name in part.variables else (("time",), np.full(len(part.values("time")), np.nan), {})
        for part in parts
    ]
    dimensions, _, attributes = next(piece for piece in pieces if piece[2] or piece[1].dtype.kind != "f")
    return xr.Variable(dimensions[0], np.concatenate([values for _, values, _ in pieces]), attributes)
