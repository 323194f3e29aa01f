"""Files of a SeaExplorer mission, and their rows as numbers; junk is dropped and counted by reason.

Every cycle has one navigation file and one or two payload files. The vehicle sends a sub-sampled payload record
(``pld1.sub``) from sea and stores the full record (``pld1.raw``), which is available after recovery (delayed mode). A
folder may contain both.
"""

import gzip
import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.validation import describe_time
from gliderhpc.observations.files.file_content import describe_content
from gliderhpc.observations.files.foreign import files_of
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.importing.clock_steps import ClockStep, find_clock_steps
from gliderhpc.observations.importing.excursions import SUBMERGED, find_lost, in_excursion
from gliderhpc.observations.importing.rows import NOT_INCREASING, Rows, increasing, join_rows, keep_rows
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR

_NAME = re.compile(
    r"(?P<vehicle>\w+)\.(?P<mission>\d{1,9})\.(?P<kind>gli|pld1)\.(?P<rate>sub|raw)\.(?P<cycle>\d{1,6})(?:\.gz)?",
    re.IGNORECASE,
)

MAX_CONTENT = 500_000_000
"""Maximum size of a cycle's unpacked record (bytes); a week of records at 1 Hz takes 100 MB."""

PREFERENCE = {"gli": ("sub", "raw"), "pld1": ("raw", "sub")}
"""Rates of a cycle's files, the preferred one first: the full payload record, and the usual navigation record."""


@dataclass(frozen=True)
class SeaExplorerFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    vehicle : str
        Name of the glider in capitals, for example SEA035.
    mission : int
        Number of the mission.
    navigation : dict of int to Path
        The ``gli`` file of every cycle, by ascending cycle.
    payload : dict of int to tuple of Path
        The ``pld1`` files of every cycle with any, by ascending cycle: the full record before the sub-sampled one.
    """

    vehicle: str
    mission: int
    navigation: dict[int, Path]
    payload: dict[int, tuple[Path, ...]]


def is_seaexplorer_file(path: Path) -> bool:
    """Return whether a file is named like a record of the glider."""
    return _NAME.fullmatch(path.name) is not None


def find_files(sources: Sequence[Path]) -> SeaExplorerFiles:
    """Collect the files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them.

    Raises
    ------
    InputError
        A source does not exist or is not a SeaExplorer file, there is no navigation file, two files of the same cycle
        differ in content, or the files belong to more than one mission.
    """
    found: dict[tuple[str, str], dict[int, Path]] = {
        (kind, rate): {} for kind in PREFERENCE for rate in PREFERENCE[kind]
    }
    owners: dict[tuple[str, int], Path] = {}
    for path in files_of(sources, is_seaexplorer_file):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise InputError(
                f"{path}: is not named like a SeaExplorer record (*.gli.sub.N, *.pld1.sub.N or *.pld1.raw.N)"
            )
        owners.setdefault((match["vehicle"].upper(), int(match["mission"])), path)
        cycles, cycle = found[match["kind"].lower(), match["rate"].lower()], int(match["cycle"])
        first = cycles.setdefault(cycle, path)
        if first != path and read_content(first) != read_content(path):
            raise InputError(
                f"{path}: cycle {cycle} is already given as {first}, with other content; give every cycle once"
            )
    navigation = {cycle: paths[0] for cycle, paths in _by_cycle(found, "gli").items()}
    if not navigation:
        raise InputError(
            f"{', '.join(map(str, sources))}: no *.gli.sub.* file found; give the folder that contains them"
        )
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another mission than {first}; import one mission at a time")
    (vehicle, mission), _ = owners.popitem()
    return SeaExplorerFiles(vehicle, mission, navigation, _by_cycle(found, "pld1"))


def read_content(path: Path) -> bytes:
    """Bytes of a file, plain or gzipped.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, or is larger than the record of any cycle.
    """
    try:
        with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as stream:
            content = stream.read(MAX_CONTENT + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    if len(content) > MAX_CONTENT:
        raise InputError(f"{path}: contains more than {MAX_CONTENT / 1e6:.0f} MB, too much for the record of one cycle")
    return content


def _by_cycle(found: Mapping[tuple[str, str], Mapping[int, Path]], kind: str) -> dict[int, tuple[Path, ...]]:
    """Files of a kind by ascending cycle, for each cycle the preferred rate first."""
    rates = [found[kind, rate] for rate in PREFERENCE[kind]]
    cycles = sorted({cycle for rate in rates for cycle in rate})
    return {cycle: tuple(rate[cycle] for rate in rates if cycle in rate) for cycle in cycles}


CLOCK_STEP = np.timedelta64(1, "D")
"""Time step within one cycle's file above which the clock was set in between."""

WRONG_FIELDS = "wrong number of fields"
UNREADABLE = "unreadable value"
CLOCK_NOT_SET = "clock not set"

_DAY_FIRST = re.compile(r"(\d\d)/(\d\d)/(\d{4}) (\d\d:\d\d:\d\d(?:\.\d+)?)")


@dataclass(frozen=True, eq=False)
class MissionRows:
    """Rows of a mission's files, and what was left out.

    Attributes
    ----------
    rows : Rows
        The rows.
    dropped : Counter
        Number of dropped rows by reason.
    rejected : dict of int to str
        Reason for every cycle whose file cannot be read, lacks a column, or has times that contradict those of the
        other files; no row of such a cycle is used.
    steps : list of ClockStep
        Backward steps of the clock, if they were searched for.
    """

    rows: Rows
    dropped: Counter[str]
    rejected: dict[int, str]
    steps: list[ClockStep]


def read_rows(
    files: Mapping[int, Path],
    clock: str,
    ranges: Mapping[str, tuple[float, float]],
    *,
    label: str = "",
    with_steps: bool = False,
    reads: Reads = read_directly,
) -> MissionRows:
    """Read the files of a mission and drop their junk rows.

    Parameters
    ----------
    files : mapping of int to Path
        The file of every cycle, by ascending cycle.
    clock : str
        Name of the time column.
    ranges : mapping of str to (float, float)
        Columns to read, with the open ranges of their plausible values.
    label : str
        Prefix of the reasons of dropped rows.
    with_steps : bool
        Whether to search for backward steps of the clock, which requires a column ``Depth``.
    reads : Reads
        Function that reads each file.
    """
    found: Counter[str] = Counter()
    rejected: dict[int, str] = {}
    parts: list[Rows] = []
    for cycle, path in files.items():
        try:
            rows, left_out = reads(_read_file, path, cycle, clock, tuple(ranges))
            found.update(left_out)
            rows = keep_rows(rows, ~np.isnat(rows.time), CLOCK_NOT_SET, found)
            rows = _drop_implausible(rows, ranges, found)
            parts.append(_drop_unset_clock(rows, f"{path}: {clock}", found))
        except InputError as error:
            rejected[cycle] = str(error)
    rows = _drop_contradicting(join_rows(parts, ranges), files, clock, rejected)
    keep = increasing(rows.time)
    steps = find_clock_steps(rows.time, keep, rows["Depth"]) if with_steps else []
    rows = keep_rows(rows, keep, NOT_INCREASING, found)
    dropped = Counter({label + reason: count for reason, count in found.items()})
    return MissionRows(rows, dropped, rejected, steps)


def _drop_contradicting(rows: Rows, files: Mapping[int, Path], clock: str, rejected: dict[int, str]) -> Rows:
    """Drop the cycles whose times contradict those before and after them, and add the reasons to `rejected`."""
    depth = rows.columns.get("Depth", np.full(len(rows), np.inf))
    lost = find_lost(rows.time, rows.part, depth, increasing(rows.time))
    rejected.update({cycle: f"{files[cycle]}: {why} ({clock})" for cycle, why in lost.items()})
    return rows.where(~np.isin(rows.part, list(lost)))


def read_columns(path: Path) -> list[str]:
    """Names of the columns of a file.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    return _fields(_lines(path)[0])


def _read_file(path: Path, cycle: int, clock: str, names: Sequence[str]) -> tuple[Rows, Counter[str]]:
    """Read the rows of a file, and count the dropped rows by reason."""
    dropped: Counter[str] = Counter()
    header, *lines = _lines(path)
    if not header:
        raise InputError(f"{path}: is empty; copy it again")
    fields = _fields(header)
    absent = [name for name in (clock, *names) if name not in fields]
    if absent:
        other = ", or the declination with `declination`" if absent[0] == "Declination" else ""
        what = describe_content(path)
        separated = "" if len(fields) > 1 else "; its columns must be separated by semicolons"
        raise InputError(
            f"{path}: {what or f'has no column {absent[0]}; give a complete SeaExplorer record{other}{separated}'}"
        )
    places = [fields.index(name) for name in names]
    clock_place = fields.index(clock)
    times: list[np.datetime64] = []
    values: list[list[float]] = []
    unreadable = ""
    for number, line in enumerate(lines, start=1):
        parts = line.split(";")
        if len(parts) != len(fields):
            dropped[WRONG_FIELDS] += 1
            continue
        try:
            time, row = _parse_time(parts[clock_place]), [_parse_number(parts[place]) for place in places]
        except ValueError:
            dropped[UNREADABLE] += 1
            unreadable = unreadable or f"row {number}: {_unreadable_value(parts, clock, fields, names)}"
            continue
        times.append(time)
        values.append(row)
    if unreadable and not values:
        raise InputError(f"{path}: no row can be read; {unreadable}")
    table = np.array(values, dtype=np.float64).reshape(len(values), len(names))
    rows = Rows(
        np.array(times, dtype="datetime64[ns]"),
        np.full(len(times), cycle, dtype=np.int64),
        {name: table[:, column] for column, name in enumerate(names)},
    )
    return rows, dropped


def _lines(path: Path) -> list[str]:
    """Lines of a text file, plain or gzipped, without the closing semicolon of each."""
    text = read_content(path).decode("utf-8-sig", errors="replace")
    # Only the semicolon that closes a row is removed; removing more would hide empty last fields.
    return [line.removesuffix(";") for line in text.splitlines() if line.strip()] or [""]


def _fields(header: str) -> list[str]:
    return [name.strip() for name in header.split(";")]


def _parse_time(text: str) -> np.datetime64:
    match = _DAY_FIRST.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    day, month, year, clock = match.groups()
    # Years outside the range of datetime64[ns] would wrap around to other years.
    if not FIRST_YEAR <= int(year) <= LAST_YEAR:
        return np.datetime64("NaT", "ns")
    return np.datetime64(f"{year}-{month}-{day}T{clock}", "ns")


def _parse_number(text: str) -> float:
    return float(text) if text.strip() else float("nan")


def _unreadable_value(parts: Sequence[str], clock: str, fields: Sequence[str], names: Sequence[str]) -> str:
    """Describe the first value of a row that cannot be read, and the remedy."""
    for name in (clock, *names):
        text = parts[fields.index(name)].strip()
        try:
            if name == clock:
                _parse_time(text)
            else:
                _parse_number(text)
        except ValueError:
            remedy = "decimals must have a point" if "," in text else "it must be a number"
            return f"{name} is '{text}'; {'it must be DD/MM/YYYY hh:mm:ss' if name == clock else remedy}"
    return ""


def _drop_implausible(rows: Rows, ranges: Mapping[str, tuple[float, float]], dropped: Counter[str]) -> Rows:
    """Drop the rows with a value outside the open range of its column."""
    for name, (low, high) in ranges.items():
        # An empty field (NaN) compares false: it is missing, and not out of range.
        plausible = ~((rows[name] <= low) | (rows[name] >= high))
        rows = keep_rows(rows, plausible, f"{name} out of range", dropped)
    return rows


def _drop_unset_clock(rows: Rows, where: str, dropped: Counter[str]) -> Rows:
    """Select the longest part of a file without a clock step; single rows with a damaged time do not divide it.

    Raises
    ------
    InputError
        The other rows belong to a dive, which would be cut short; the message begins with `where`.
    """
    rows = keep_rows(rows, ~in_excursion(rows.time, brief=True), NOT_INCREASING, dropped)
    steps = np.flatnonzero(np.abs(np.diff(rows.time)) > CLOCK_STEP) + 1
    if len(steps) == 0:
        return rows
    stretch = np.searchsorted(steps, np.arange(len(rows)), side="right")
    longest = stretch == np.bincount(stretch).argmax()
    if "Depth" in rows.columns and np.any(rows["Depth"][~longest] > SUBMERGED):
        before, after = (describe_time(rows.time[row]) for row in (steps[0] - 1, steps[0]))
        raise InputError(f"{where} goes from {before} to {after} during a dive; correct these times")
    return keep_rows(rows, longest, CLOCK_NOT_SET, dropped)
