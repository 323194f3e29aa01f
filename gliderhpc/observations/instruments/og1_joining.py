"""Content of OG1 files: rows that are samples of the flight, and joining of files that overlap or divide a dive.

A file that is delivered again, or one for each transmission, may repeat the end of another one, or begin within a dive.
Its dives are complete only together with those of the other file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.importing.excursions import SUBMERGED
from gliderhpc.observations.importing.rows import Columns, join_columns
from gliderhpc.observations.importing.time_order import SEGMENT_BREAK, order_of_rows
from gliderhpc.observations.instruments.og1_dives import IntArray, detect_dives, find_dives
from gliderhpc.observations.instruments.og1_variables import SEAWATER, SPEED, Declination, medians_over
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.nearest import onto_nearest, rarely_together
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import SECOND
from gliderhpc.wording import counted

_COMPARED = ("depth", "roll", "pitch", "ballast_volume")
"""Variables by which samples of two files are the same; headings have each file's own declination."""

_DECIMALS = 3
"""Decimals that are compared, since a file may store the same samples in single precision."""


@dataclass(frozen=True, eq=False)
class Record:
    """Content of one file.

    Attributes
    ----------
    path : Path
        The file.
    model, vehicle, mission : str
        Names of the glider's model, of the glider, and of its mission.
    samples : dict of str to (n,) array
        Samples in the units of the observation format, including time and the controls.
    counter : (n,) int array
        Dive number of every sample, -1 where there is none.
    counted : bool
        Whether these numbers are the file's own; otherwise they are detected from depth.
    dives : dict of int to Span
        Sample range of each dive by its number in the file.
    solution : dict of str to array
        Reference quantities along the dives and along ``reference_time``.
    fixes : Fixes
        GPS fixes in the order of the file.
    declination : Declination
        Declination added to the heading.
    absent : tuple of str
        Controls that are missing from the file; they are zero.
    renumbered : bool
        Whether the dives have other numbers than in the file.
    without_dive, lost : dict of int to str
        Reasons by number of the dives that give no profile, and of the dives in which the clock was set.
    rows_dropped : int
        Number of dropped samples, whose time was missing or did not increase.
    remarks : tuple of str
        Remarks for the user, one line each.
    """

    path: Path
    model: str
    vehicle: str
    mission: str
    samples: Columns
    counter: IntArray
    counted: bool
    dives: dict[int, Span]
    solution: Columns
    fixes: Fixes
    declination: Declination
    absent: tuple[str, ...]
    renumbered: bool
    without_dive: dict[int, str]
    lost: dict[int, str]
    rows_dropped: int
    remarks: tuple[str, ...]


def join_overlapping(records: Sequence[Record]) -> list[Record]:
    """Join the records that repeat samples of one another, or that divide a dive between them.

    Records that overlap with different samples remain as they are; the checks of the clock find them.

    Parameters
    ----------
    records : sequence of Record
        Content of the files, in the order of their first samples.
    """
    joined: list[Record] = []
    for record in records:
        whole = _joined(joined[-1], record) if joined else None
        if whole is None:
            joined.append(record)
        else:
            joined[-1] = whole
    return joined


def _joined(first: Record, second: Record) -> Record | None:
    """Join two records; None if they have no sample in common and divide no dive, or contradict each other."""
    overlap = bool(second.samples["time"][0] <= first.samples["time"][-1])
    if not overlap and not _divide_a_dive(first, second):
        return None
    samples = join_columns([first.samples, second.samples])
    time = samples["time"].astype("datetime64[ns]")
    order = order_of_rows(time, [np.round(floats(samples[name]), _DECIMALS) for name in _COMPARED])
    rows, time = order.rows, time[order.rows]
    by_depth = not _agree(first, second)
    if not (np.diff(time) > np.timedelta64(0, "ns")).all() or (overlap and not order.repeated):
        return None
    if by_depth and (first.lost or second.lost):
        # The numbers of the dives that are left out would be those of other dives.
        return None
    samples = {name: values[rows] for name, values in samples.items()}
    depth = floats(samples["depth"])
    counter = detect_dives(time, depth) if by_depth else np.concatenate([first.counter, second.counter])[rows]
    found = find_dives(counter, time, depth, is_whole=not (first.lost or second.lost))
    lost = first.lost | second.lost
    dives = {number: span for number, span in found.spans.items() if number not in lost}
    return replace(
        first,
        samples=samples,
        counter=counter,
        counted=first.counted and second.counted and not by_depth,
        dives=dives,
        solution=_join_solutions(first, second, rows, list(dives.values())),
        fixes=_join_fixes(first.fixes, second.fixes),
        absent=tuple(dict.fromkeys((*first.absent, *second.absent))),
        renumbered=bool(found.remark) or by_depth,
        without_dive=found.without,
        lost=lost,
        rows_dropped=first.rows_dropped + second.rows_dropped,
        remarks=(*first.remarks, *second.remarks, _describe(first, second, order.repeated)),
    )


def _divide_a_dive(first: Record, second: Record) -> bool:
    """Return whether one record ends under water and the other begins there at once."""
    pause = (second.samples["time"][0] - first.samples["time"][-1]) / SECOND
    levels = [floats(first.samples["depth"])[-1], floats(second.samples["depth"])[0]]
    return bool(pause <= SEGMENT_BREAK and min(levels) > SUBMERGED)


def _agree(first: Record, second: Record) -> bool:
    """Return whether both files number their dives, and number those in common in the same way."""
    if not (first.counted and second.counted):
        return False
    _, one, other = np.intersect1d(first.samples["time"], second.samples["time"], return_indices=True)
    if not len(one):
        return bool(first.counter[-1] == second.counter[0])
    return bool((first.counter[one] == second.counter[other]).all())


def _join_solutions(first: Record, second: Record, rows: IntArray, dives: Sequence[Span]) -> Columns:
    """Join the reference quantities: those along the dives, and those along their own time."""
    along_time = ("reference_time", *SPEED)
    found: Columns = {}
    for name in first.solution:
        values = [record.solution[name] for record in (first, second)]
        if name not in along_time:
            found[name] = medians_over(
                np.concatenate([_of_samples(first, name), _of_samples(second, name)])[rows], dives
            )
        else:
            found[name] = np.concatenate(values)
    order = np.unique(found["reference_time"], return_index=True)[1]
    return found | {name: found[name][order] for name in along_time}


def _of_samples(record: Record, name: str) -> FloatArray:
    """Reference quantity of the dives at each of their samples, NaN outside."""
    values = np.full(len(record.samples["time"]), np.nan)
    for (start, stop), value in zip(record.dives.values(), floats(record.solution[name]), strict=True):
        values[start:stop] = value
    return values


def _join_fixes(first: Fixes, second: Fixes) -> Fixes:
    return Fixes(
        np.concatenate([first.time, second.time]),
        np.concatenate([first.latitude, second.latitude]),
        np.concatenate([first.longitude, second.longitude]),
    )


def _describe(first: Record, second: Record, repeated: int) -> str:
    if not repeated:
        return f"{second.path.name}: begins within a dive of {first.path.name}; the two files are joined"
    return f"{second.path.name}: {counted(repeated, 'sample')} also in {first.path.name}, each taken once"


# Rows that are samples of the flight, and the water's values on them


def is_flight(samples: Columns) -> npt.NDArray[np.bool_]:
    """Mask of the rows with attitude, and of those with depth if the two are hardly ever in one row.

    Other rows contain fixes, or sensors that are sampled at other times.
    """
    roll, pitch, heading, depth = (np.isfinite(floats(samples[name])) for name in ("roll", "pitch", "heading", "depth"))
    attitude = roll | pitch | heading
    return attitude | depth if rarely_together(roll, pitch, heading, depth) else attitude


def chosen_samples(samples: Columns, rows: npt.NDArray[np.int64]) -> Columns:
    """Select rows; temperature, salinity and pressure that are sampled in other rows are put on the nearest ones.

    Nothing is interpolated: a sample is moved by half the usual interval between the rows at most.
    """
    chosen = {name: values[rows] for name, values in samples.items()}
    every, time = (one["time"].astype("datetime64[ns]") for one in (samples, chosen))
    usual = usual_interval(without_gaps(np.diff(time) / SECOND))
    for name in [name for name in SEAWATER if name in samples and np.isfinite(usual)]:
        values = floats(samples[name])
        known = np.flatnonzero(np.isfinite(values) & ~np.isnat(every))
        if len(known) > 2 * np.count_nonzero(np.isfinite(values[rows])):
            reach = np.timedelta64(round(0.5e9 * usual), "ns")
            chosen[name] = onto_nearest(time, every[known], values[known], reach)
    return chosen


def floats(values: npt.NDArray[np.generic]) -> FloatArray:
    """Return values as float64."""
    return values.astype(np.float64)
