"""Observation files of one glider, a dive or several each, joined into one."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.format import REFERENCE
from gliderhpc.observations.in_memory import FIXES, read_records, write_records
from gliderhpc.observations.stored_reads import Reads, read_directly


def join_observations(paths: Sequence[Path], out: Path, reads: Reads = read_directly) -> dict[str, str]:
    """Join observation files by time.

    Parameters
    ----------
    paths : sequence of Path
        Files in the observation format; they may be given in any order.
    out : Path
        The file to write; one that exists is replaced.
    reads : Reads
        Reads each file.

    Returns
    -------
    dict of str to str
        Files that were left out, by name, and why: unreadable ones, and such as overlap an earlier file in time or
        repeat its profiles' numbers.

    Raises
    ------
    InputError
        No file can be used, or `out` cannot be written.
    """
    opened: dict[Path, xr.Dataset] = {}
    left_out: dict[str, str] = {}
    for path in paths:
        try:
            opened[path] = reads(_read_file, path).dataset(path.name)
        except InputError as error:
            left_out[path.name] = str(error)
    chosen: list[xr.Dataset] = []
    owners: dict[int, str] = {}
    for path in sorted(opened, key=lambda path: (opened[path]["time"].values[0], path.name)):
        numbers = _numbers(opened[path])
        conflict = _conflict(opened[path], numbers, chosen, owners)
        if conflict:
            left_out[path.name] = f"{path}: {conflict}"
        else:
            chosen.append(opened[path])
            owners |= dict.fromkeys(numbers, path.name)
    if not chosen:
        raise InputError(next(iter(left_out.values()), "no observation file"))
    out.unlink(missing_ok=True)
    write_records(_joined(chosen), out)
    return left_out


@dataclass(frozen=True, eq=False)
class _FileContent:
    """Variables of a file by name, with their dimensions, values and attributes; and its global attributes."""

    variables: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]
    attributes: dict[str, Any]

    def dataset(self, source: str) -> xr.Dataset:
        dataset = xr.Dataset(self.variables, attrs=self.attributes)
        dataset.encoding["source"] = source
        return dataset


def _read_file(path: Path) -> _FileContent:
    with read_records(path) as records:
        if not records.sizes["time"]:
            raise InputError(f"{path}: has no samples")
        variables = {
            str(name): (tuple(map(str, variable.dims)), variable.values, dict(variable.attrs))
            for name, variable in records.variables.items()
            if name not in REFERENCE
        }
        return _FileContent(variables, {str(key): value for key, value in records.attrs.items()})


def _conflict(records: xr.Dataset, numbers: set[int], before: Sequence[xr.Dataset], owners: Mapping[int, str]) -> str:
    """Describe why records, and the profiles in them, cannot follow others; empty where they can."""
    if not before:
        return ""
    last, time = before[-1], records["time"].values
    if time[0] <= last["time"].values[-1]:
        return f"overlaps {last.encoding['source']} in time; give every sample once"
    if ("profile" in records) != ("profile" in last):
        return "has profile numbers where the others have none, or none where they have; give them to all files or none"
    shared = numbers & owners.keys()
    if shared:
        return f"profile {min(shared)} is in {owners[min(shared)]} too; give every profile its own number"
    return ""


def _numbers(records: xr.Dataset) -> set[int]:
    """Numbers of the profiles in a file, none where it does not number them."""
    if "profile" not in records:
        return set()
    return set(np.unique(np.nan_to_num(records["profile"].values)).astype(int).tolist()) - {0}


def _joined(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    names = {str(name) for part in parts for name in part.variables}
    fixed = [part for part in parts if all(name in part.variables for name in FIXES)]
    variables = {
        name: _along(name, fixed if name in FIXES else parts) for name in sorted(names) if name not in FIXES or fixed
    }
    if fixed:
        order = np.unique(variables["fix_time"].values, return_index=True)[1]
        variables |= {name: variables[name][order] for name in FIXES}
    return xr.Dataset(variables, attrs=dict(parts[0].attrs))


def _along(name: str, parts: Iterable[xr.Dataset]) -> xr.Variable:
    """Join one variable; NaN for the samples of a file that does not have it."""
    pieces: list[xr.Variable] = [
        part.variables[name] if name in part.variables else xr.Variable("time", np.full(part.sizes["time"], np.nan))
        for part in parts
    ]
    known = next(piece for piece in pieces if piece.attrs or piece.dtype.kind != "f")
    dimension = str(known.dims[0])
    return xr.Variable(dimension, np.concatenate([piece.values for piece in pieces]), known.attrs)
