"""All files of a Slocum mission as two tables, one of the flight computer and one of the science computer.

Unreadable files are skipped.
"""

import logging
import tempfile
from collections import Counter
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.heading_values import describe_impossible, outside, remove_turns
from gliderhpc.observations.checks.sign_checks import refuse_negative_depth
from gliderhpc.observations.checks.validation import clock_set_back
from gliderhpc.observations.files.stored_reads import Reads
from gliderhpc.observations.importing.clock_steps import times_by_two_clocks
from gliderhpc.observations.importing.excursions import in_excursion
from gliderhpc.observations.importing.rows import NOT_INCREASING, Rows, increasing, join_rows, keep_rows
from gliderhpc.observations.importing.time_order import order_of_rows
from gliderhpc.observations.instruments.slocum_binary import BinaryReader
from gliderhpc.observations.instruments.slocum_files import (
    FLIGHT_CLOCK,
    FLIGHT_SENSORS,
    SCIENCE_CLOCK,
    SCIENCE_SENSORS,
    Sensor,
    SlocumFiles,
    read_decoded,
)
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import SECOND

_NO_PART = -1
"""Number of science records, which need none because profiles consist of flight records."""

log = logging.getLogger(__name__)

CLOCK_NOT_SET = "clock not set"
HUNG = "measurements of a delayed cycle of the computer"

HANGING_CYCLE = 2.0
"""Length of a cycle of the flight computer, in usual cycles, above which it was waiting for a sensor (mostly the
compass).

The record of such a cycle has the time of its beginning, but the delayed measurement and the following ones are from
its end. On the mission of modena, the depth in such a record is in error by 3 m during the climb.
"""

NEIGHBOURING_CYCLES = 20
"""Cycles before and as many after a cycle that show whether the sampling rate has changed there. On the mission of
modena the compass delays up to 19 cycles in a row, which does not count as a change of the rate."""

CHANGED_RATE = 2.0
"""Ratio of the median length of the neighbouring cycles to the mission's, or its inverse, above which the sampling rate
has changed."""

_MEASURED = ("m_depth", "m_pitch", "m_roll", "m_heading")


@dataclass(frozen=True, eq=False)
class Mission:
    """The records of a mission.

    Attributes
    ----------
    vehicles : tuple of str
        Names of the gliders, as far as the files give them.
    parts : tuple of str
        Names of the segments or files, indexed by the rows' `part`.
    flight, science : Rows
        Rows in time order, with junk values replaced by NaN.
    rejected : dict of Path to str
        Reasons by unreadable file.
    cut_short : tuple of Path
        Truncated files; the tables contain their complete records.
    dropped : dict of str to int
        Number of rows and values left out, by reason.
    set_back : tuple of (numpy.datetime64, numpy.datetime64)
        Begin and end of the intervals of time that occur twice in flight records, because the clock was set back.
    """

    vehicles: tuple[str, ...]
    parts: tuple[str, ...]
    flight: Rows
    science: Rows
    rejected: dict[Path, str]
    cut_short: tuple[Path, ...]
    dropped: dict[str, int]
    set_back: tuple[tuple[np.datetime64, np.datetime64], ...]


@dataclass(frozen=True, eq=False)
class _Collected:
    """Records read so far, file by file, with the attributes of `Mission`."""

    vehicles: dict[str, None] = field(default_factory=dict)
    parts: list[str] = field(default_factory=list)
    flight: list[Rows] = field(default_factory=list)
    science: list[Rows] = field(default_factory=list)
    rejected: dict[Path, str] = field(default_factory=dict)
    cut_short: list[Path] = field(default_factory=list)


def read_mission(files: SlocumFiles, cache: Path | None, reads: Reads) -> Mission:
    """Read all files of a mission.

    Parameters
    ----------
    files : SlocumFiles
        Paths of the files.
    cache : Path or None
        Folder of the cache files of the binary files.
    reads : Reads
        Function that reads each file.

    Raises
    ------
    InputError
        No flight record could be read; the message is that of the first unreadable file. Or the depth is negative
        under water, or an angle in another unit than declared.
    """
    collected = _Collected()
    if files.flight or files.science:
        _read_binary(files, cache, reads, collected)
    for path in files.decoded:
        _read_netcdf(path, reads, collected)
    if not collected.flight:
        raise InputError(next(iter(collected.rejected.values()), _describe_science_only(files)))
    dropped: Counter[str] = Counter()
    dropped_science: Counter[str] = Counter()
    source = next(path for path in (*files.flight, *files.decoded) if path not in collected.rejected)
    flight = _without_hung(_in_order(collected.flight, FLIGHT_SENSORS, dropped, source), dropped)
    science = _in_order(collected.science, SCIENCE_SENSORS, dropped_science, source)
    dropped.update({f"science: {reason}": count for reason, count in dropped_science.items()})
    return Mission(
        vehicles=tuple(collected.vehicles),
        parts=tuple(collected.parts),
        flight=flight,
        science=science,
        rejected=collected.rejected,
        cut_short=tuple(collected.cut_short),
        dropped=dict(sorted(dropped.items())),
        set_back=tuple(stretch for rows in collected.flight for stretch in times_by_two_clocks(rows.time)),
    )


def _read_binary(files: SlocumFiles, cache: Path | None, reads: Reads, collected: _Collected) -> None:
    with (
        tempfile.TemporaryDirectory(prefix="gliderhpc-slocum-") as folder,
        closing(BinaryReader(Path(folder), cache)) as reader,
    ):
        for path in (*files.flight, *files.science):
            is_flight = path in files.flight
            clock, sensors = (FLIGHT_CLOCK, FLIGHT_SENSORS) if is_flight else (SCIENCE_CLOCK, SCIENCE_SENSORS)
            try:
                segment = reads(reader.read, path, len(collected.parts) if is_flight else _NO_PART, clock, sensors)
            except InputError as error:
                collected.rejected[path] = str(error)
                continue
            collected.vehicles.setdefault(segment.vehicle)
            if segment.cut_short:
                collected.cut_short.append(path)
            if is_flight:
                collected.flight.append(segment.rows)
                collected.parts.append(segment.name)
            else:
                collected.science.append(segment.rows)


def _read_netcdf(path: Path, reads: Reads, collected: _Collected) -> None:
    try:
        flight, science = reads(read_decoded, path, len(collected.parts), FLIGHT_SENSORS, SCIENCE_SENSORS)
    except InputError as error:
        collected.rejected[path] = str(error)
        return
    collected.science.append(_segments_in_order(science, path))
    if len(flight) or not len(science):
        collected.flight.append(_segments_in_order(flight, path))
        collected.parts.append(path.stem)


def _describe_science_only(files: SlocumFiles) -> str:
    names = ", ".join(map(str, files.decoded))
    return f"{names}: records of the science computer only; give the files of the flight computer too"


def _segments_in_order(rows: Rows, path: Path) -> Rows:
    """Put the segments of a file that joins them in another order, such as that of their names, in time order.

    Rows that the file repeats, as where its parts overlap, are taken once.
    """
    order = order_of_rows(rows.time, list(rows.columns.values()))
    for text in order.describe():
        log.warning("%s: %s", path, text)
    step = clock_set_back(rows.time[~in_excursion(rows.time, brief=True)])
    if step is not None and not order.describe() and not times_by_two_clocks(rows.time):
        log.warning("%s: the clock was set back by %.0f s; the times before or after that are wrong", path, step)
    return rows.where(order.rows)


def _in_order(parts: list[Rows], sensors: Sequence[Sensor], dropped: Counter[str], source: Path) -> Rows:
    """Join the rows, sort them by time and remove junk, which includes single rows with a damaged time.

    Messages name `source`, the first file.
    """
    parts = [keep_rows(part, ~in_excursion(part.time, brief=True), NOT_INCREASING, dropped) for part in parts]
    rows = join_rows(parts, [sensor.name for sensor in sensors])
    rows = keep_rows(rows, ~np.isnat(rows.time), CLOCK_NOT_SET, dropped)
    order = np.argsort(rows.time, kind="stable")
    rows = rows.where(order)
    rows = keep_rows(rows, increasing(rows.time), NOT_INCREASING, dropped)
    for sensor in sensors:
        values = rows[sensor.name]
        if sensor.name == "m_heading":
            values[:], turns = remove_turns(values, f"{source}: m_heading")
            if turns:
                log.warning("%s: m_heading %s", source, turns)
        if sensor.name == "m_depth":
            refuse_negative_depth(values, str(source), sensor.name)
        junk = outside(values, (sensor.low, sensor.high))
        if junk.any():
            if sensor.required == "attitude":
                describe_impossible(values, junk, f"{source}: {sensor.name}", (sensor.low, sensor.high))
            dropped[f"{sensor.name} out of range"] += int(np.count_nonzero(junk))
            values[junk] = np.nan
    return rows


def _without_hung(rows: Rows, dropped: Counter[str]) -> Rows:
    """Replace the measurements of delayed cycles, whose time is unknown, by NaN."""
    lasted = np.asarray(np.diff(rows.time) / SECOND, dtype=np.float64)
    hung = np.flatnonzero(lasted > HANGING_CYCLE * _usual_cycles(lasted))
    for name in _MEASURED:
        rows[name][hung] = np.nan
    if len(hung):
        dropped[HUNG] += len(hung)
    return rows


def _usual_cycles(lasted: FloatArray) -> FloatArray:
    """Return the usual length (s) at each cycle: the mission's median, or the neighbours' if the rate has changed."""
    if not len(lasted):
        return lasted
    usual = float(np.median(lasted))
    around = scipy.ndimage.median_filter(lasted, 2 * NEIGHBOURING_CYCLES + 1, mode="mirror")
    changed = (around > CHANGED_RATE * usual) | (around < usual / CHANGED_RATE)
    return np.where(changed, around, usual)
