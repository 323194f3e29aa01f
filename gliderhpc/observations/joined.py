"""Joining of one glider's observation files, of one or several dives each, into one file."""

import logging
from bisect import bisect_right, insort
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.observations.dataset import open_observations
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.format import REFERENCE, VARIABLES
from gliderhpc.observations.in_memory import FIXES, read_records, write_records
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.observations.writer import TIMES

log = logging.getLogger(__name__)

Array = NDArray[np.float64]

_SAME_TIME, _SAME_DEPTH, _MIN_AGREEING_SHARE = 5.0, 2.0, 0.95
"""Two records are of the same dive if their ends agree within 5 s and 0.95 of the depths within 2 m."""


def join_observations(paths: Sequence[Path], out: Path, reads: Reads = read_directly) -> dict[str, str]:
    """Join observation files by time.

    Parameters
    ----------
    paths : sequence of Path
        Files in the observation format, in the order of their arrival. Of two that contradict each other, the first one
        is used. A file that contains earlier ones completely, with more samples, replaces them: many gliders send
        decimated records first.
    out : Path
        The file to write; an existing file is replaced.
    reads : Reads
        Function that reads each file.

    Returns
    -------
    dict of str to str
        Reasons for the files that were left out, by file name. A file is left out if it is unreadable, overlaps a file
        given before it in time or repeats one of its profile numbers, or alone has or lacks profile numbers; without a
        reason, if another file contains it.

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
    chosen = _ChosenFiles()
    for path, content in opened.items():
        met = chosen.in_conflict_with(content)
        if met and all(_is_part_of(one, content) for one in met):
            for one in met:
                log.info("%s: replaced by %s, which contains it and has more samples", one.path, path.name)
                chosen.remove(one)
        elif any(_is_part_of(content, one) for one in met):
            log.info("%s: not used, because another file contains it", path)
            continue
        elif met:
            left_out[path.name] = f"{path}: {_conflict(content, met[0])}"
            continue
        chosen.add(content)
    if not chosen.in_order:
        raise InputError(next(iter(left_out.values()), "no observation file"))
    out.unlink(missing_ok=True)
    write_records(_joined(chosen.in_order), out)
    return left_out


@dataclass(frozen=True, eq=False)
class _FileContent:
    """A file, its variables by name (dimensions, values and attributes), and its global attributes."""

    path: Path
    variables: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]]
    attributes: dict[str, Any]

    def values(self, name: str) -> NDArray[Any]:
        """Return the values of a variable."""
        return self.variables[name][1]

    @cached_property
    def span(self) -> tuple[np.datetime64, np.datetime64]:
        """Times of the first and the last sample that have one."""
        time = self.values("time")
        known = time[~np.isnat(time)]
        return known[0], known[-1]

    @cached_property
    def fault_count(self) -> int:
        """Number of the profiles that cannot be used; the file is searched for them when this is first asked."""
        with open_observations(self.path) as observations:
            return len(observations.faults)

    @cached_property
    def numbers(self) -> frozenset[int]:
        """Numbers of the profiles; empty if the file does not number them."""
        if "profile" not in self.variables:
            return frozenset()
        return frozenset(np.unique(np.nan_to_num(self.values("profile"))).astype(int).tolist()) - {0}


def _read_file(path: Path) -> _FileContent:
    with read_records(path) as records:
        if np.isnat(records["time"].values).all():
            raise InputError(f"{path}: has no samples with a time")
        variables = {
            str(name): (tuple(map(str, variable.dims)), variable.values, dict(variable.attrs))
            for name, variable in records.variables.items()
            if name in (*VARIABLES, *TIMES) and name not in REFERENCE
        }
        return _FileContent(path, variables, {str(key): value for key, value in records.attrs.items()})


class _ChosenFiles:
    """Files without any conflict, ordered by time; with hundreds of files, not every pair is compared.

    Attributes
    ----------
    in_order : list of _FileContent
        The files.
    """

    def __init__(self) -> None:
        self.in_order: list[_FileContent] = []
        self._by_number: dict[int, _FileContent] = {}

    def add(self, content: _FileContent) -> None:
        """Add a file that contradicts none of the others."""
        insort(self.in_order, content, key=_begin)
        self._by_number |= dict.fromkeys(content.numbers, content)

    def remove(self, content: _FileContent) -> None:
        """Remove a file."""
        self.in_order.remove(content)
        for number in content.numbers:
            del self._by_number[number]

    def in_conflict_with(self, content: _FileContent) -> list[_FileContent]:
        """Return the files that contradict another one."""
        start, end = content.span
        if self.in_order and _is_numbered(self.in_order[0]) != _is_numbered(content):
            candidates = list(self.in_order)
        else:
            # No two of the files overlap, so only the last that begins before the record can reach into it.
            first = max(bisect_right(self.in_order, start, key=_begin) - 1, 0)
            candidates = self.in_order[first : bisect_right(self.in_order, end, key=_begin)]
            candidates += [self._by_number[number] for number in sorted(content.numbers & self._by_number.keys())]
        return [one for one in dict.fromkeys(candidates) if _conflict(content, one)]


def _begin(content: _FileContent) -> np.datetime64:
    return content.span[0]


def _is_numbered(content: _FileContent) -> bool:
    return "profile" in content.variables


def _conflict(records: _FileContent, other: _FileContent) -> str:
    """Describe why records contradict others; empty if they do not."""
    (start, end), (taken_from, taken_until) = records.span, other.span
    if start <= taken_until and taken_from <= end:
        return f"overlaps {other.path.name} in time; give every sample once"
    if _is_numbered(records) != _is_numbered(other):
        return "has profile numbers and the others have none, or the reverse; give them in all files or in none"
    shared = records.numbers & other.numbers
    if shared:
        return f"profile {min(shared)} is also in {other.path.name}; give every profile its own number"
    return ""


def _is_part_of(records: _FileContent, other: _FileContent) -> bool:
    """Return whether other records have every profile of these with the same depths, and more samples in all.

    Without profile numbers, a file counts as one profile. Neither fixes nor usable profiles of the part may be lost.
    """
    fixed, numbers = all(name in records.variables for name in FIXES), records.numbers
    if bool(numbers) != bool(other.numbers) or (fixed and not all(name in other.variables for name in FIXES)):
        return False
    if len(other.values("time")) <= len(records.values("time")):
        return False
    held = all(_holds(_samples(other, number), _samples(records, number)) for number in numbers or {0})
    return held and other.fault_count <= records.fault_count


def _samples(records: _FileContent, number: int) -> tuple[Array, Array]:
    """Times (s since 1970) and depths (m) of a profile; of the whole file if the number is 0."""
    time = epoch_seconds(records.values("time"))
    depth = np.asarray(records.values("depth"), dtype=np.float64)
    if number:
        chosen = records.values("profile") == number
        time, depth = time[chosen], depth[chosen]
    known = np.isfinite(time) & np.isfinite(depth)
    return time[known], depth[known]


def _holds(whole: tuple[Array, Array], part: tuple[Array, Array]) -> bool:
    """Return whether a record has at least the samples of another, from its beginning to its end, at its depths."""
    (time, depth), (at, wanted) = whole, part
    if not len(at):
        return True
    if len(time) < len(at) or at[0] < time[0] - _SAME_TIME or at[-1] > time[-1] + _SAME_TIME:
        return False
    return bool(np.mean(np.abs(np.interp(at, time, depth) - wanted) < _SAME_DEPTH) > _MIN_AGREEING_SHARE)


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
