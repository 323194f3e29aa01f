"""Samples of the payload's CTD, of any make, on the navigation rows.

Column names of a payload file begin with the sensor: ``GPCTD_TEMPERATURE``, ``LEGATO_CONDUCTIVITY``. Every sensor with
a temperature and a conductivity or salinity is a CTD. The files do not give the unit of conductivity: a GPCTD writes
S/m, a Legato mS/cm.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import gsw
import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.importing.rows import Rows
from gliderhpc.observations.importing.workflow import CtdSamples
from gliderhpc.observations.instruments.seaexplorer_files import SeaExplorerFiles, read_columns, read_rows
from gliderhpc.observations.nearest import onto_nearest
from gliderhpc.observations.records import FloatArray, TimeArray

CLOCK = "PLD_REALTIMECLOCK"

SUFFIXES = {
    "temperature": ("TEMPERATURE", "TEMP"),
    "conductivity": ("CONDUCTIVITY", "COND"),
    "practical_salinity": ("SALINITY", "PSAL", "SAL"),
    "pressure": ("PRESSURE", "PRES"),
}
"""Endings of the column names, after the sensor's name and an underscore."""

_RANGES = {"temperature": (-5.0, 45.0), "conductivity": (-1.0, 100.0), "pressure": (-20.0, 2000.0)}
"""Open ranges of plausible values: degC, S/m or mS/cm, dbar."""

TO_MS_PER_CM = {"S/m": 10.0, "mS/cm": 1.0}
USUAL_UNIT = {"GPCTD": "S/m", "LEGATO": "mS/cm"}

SEA, FRESH = (1.0, 42.0), (0.02, 1.0)
"""Plausible ranges of the median practical salinity in the sea and in a lake; lower values mean a cell in the air."""

AGREEMENT = 0.2
"""Maximum median relative difference between the salinity computed from conductivity and the one in the file."""

IMMERSED = 2.0
"""Pressure (dbar) up to which a conductivity cell may be in the air."""

_NORMAL_LATITUDE = 45.0


@dataclass(frozen=True, eq=False)
class _Cast:
    """Samples of one CTD from one kind of file, in time order; without a pressure column, pressure is from depth."""

    time: TimeArray
    cycle: npt.NDArray[np.int64]
    temperature: FloatArray
    pressure: FloatArray
    conductivity: FloatArray
    given_salinity: FloatArray


def find_ctds(fields: Iterable[str]) -> dict[str, dict[str, str]]:
    """Columns of every CTD in a payload file.

    Parameters
    ----------
    fields : iterable of str
        Names of the file's columns.

    Returns
    -------
    dict of str to dict of str to str
        Columns by quantity of `SUFFIXES`, for each CTD by the sensor's name in capitals.
    """
    found: dict[str, dict[str, str]] = {}
    for quantity, suffixes in SUFFIXES.items():
        for suffix in reversed(suffixes):
            for field in fields:
                name = field.upper()
                if name == suffix or name.endswith(f"_{suffix}"):
                    found.setdefault(name.removesuffix(suffix).rstrip("_"), {})[quantity] = field
    return {
        sensor: columns
        for sensor, columns in found.items()
        if "temperature" in columns and ("conductivity" in columns or "practical_salinity" in columns)
    }


def read_water(
    files: SeaExplorerFiles,
    dropped: Counter[str],
    time: TimeArray,
    depth: FloatArray,
    interval: float,
    reads: Reads = read_directly,
) -> CtdSamples:
    """Read the mission's CTD and put its samples on the navigation rows; the remarks name the cycles without CTD data.

    If there are several CTDs, the one with the most samples is used. Of the full and the sub-sampled record, the one
    with more samples has priority; the other fills the rows that remain empty.

    Parameters
    ----------
    files : SeaExplorerFiles
        The mission's files.
    dropped : Counter
        Counter to which the number of dropped payload rows is added, by reason.
    time, depth : (n,) array
        Time (UTC) and depth (m) of the navigation rows, in time order, n >= 1.
    interval : float
        Sample interval of the navigation rows (s); a sample is moved by at most half an interval.
    reads : Reads
        Function that reads each file.
    """
    layouts, faults = _layouts(files, reads)
    casts: dict[str, list[_Cast]] = {}
    for (sensor, columns), by_rate in layouts.items():
        casts.setdefault(sensor, []).extend(
            _cast(_read_payload(paths, columns, dropped, faults, reads), columns, time, depth) for paths in by_rate
        )
    sensors = sorted(casts, key=lambda sensor: -sum(_sample_count(cast) for cast in casts[sensor]))
    if not sensors:
        return CtdSamples({}, "none", _remarks(files, (), faults))
    sensor, others = sensors[0], sensors[1:]
    chosen = sorted(casts[sensor], key=_sample_count, reverse=True)
    unit, basis = conductivity_unit(sensor, *_joined(chosen))
    variables, sampled = _on_rows(chosen, unit, time, interval)
    remarks = [*_remarks(files, sampled, faults)]
    if others:
        remarks.append(f"CTD {sensor or 'without a name'} is used; it has more samples than {', '.join(others)}")
    if unit is None and any(np.isfinite(cast.conductivity).any() for cast in chosen):
        remarks.append(f"CTD {sensor}: its conductivity gives no plausible salinity, neither in S/m nor in mS/cm")
    return CtdSamples(dict(variables), _comment(sensor, unit, basis), tuple(remarks))


def conductivity_unit(
    sensor: str,
    conductivity: FloatArray,
    temperature: FloatArray,
    pressure: FloatArray,
    salinity: FloatArray,
) -> tuple[str | None, str]:
    """Unit of a CTD's conductivity, and the basis of its determination.

    If the file contains a salinity that agrees with one of the units, that unit is taken. Otherwise the usual unit of
    the sensor is taken if it gives a salinity plausible in the sea, then the other unit; then both are tried in the
    same order for fresh water. For an unknown sensor the unit with the higher plausible salinity is taken, because the
    open ocean is more likely than brackish water.

    Parameters
    ----------
    sensor : str
        Name of the sensor in capitals.
    conductivity, temperature, pressure, salinity : (n,) array
        Samples: conductivity in the unknown unit, temperature (degC), pressure (dbar), and practical salinity from the
        file, NaN where missing.

    Returns
    -------
    unit : str or None
        ``S/m`` or ``mS/cm``; None if neither is plausible, or nothing was measured.
    basis : str
        Basis of the determination, as a phrase for the file's attributes.
    """
    known = np.isfinite(conductivity) & np.isfinite(temperature) & np.isfinite(pressure)
    immersed = known & (pressure > IMMERSED)
    rows = immersed if immersed.any() else known
    if not rows.any():
        return None, "not measured"
    computed = {unit: _salinity(conductivity[rows], temperature[rows], pressure[rows], unit) for unit in TO_MS_PER_CM}
    matching = _matching_unit(computed, salinity[rows])
    if matching is not None:
        return matching, "from the salinity in the file"
    usual = next((unit for name, unit in USUAL_UNIT.items() if name in sensor), None)
    medians = {unit: _median(values) for unit, values in computed.items()}
    for low, high in (SEA, FRESH):
        plausible = {unit: median for unit, median in medians.items() if low <= median <= high}
        if usual in plausible:
            return usual, "usual for this sensor"
        if plausible:
            return max(plausible, key=lambda unit: plausible[unit]), "from the resulting salinity"
    return None, "implausible"


def _matching_unit(computed: Mapping[str, FloatArray], given: FloatArray) -> str | None:
    """Unit whose salinity agrees with the salinity in the file; None if there is none."""
    wet = np.isfinite(given) & (given > SEA[0]) & (given < SEA[1])
    if not wet.any():
        return None
    misfit = {unit: _median(np.abs(values[wet] / given[wet] - 1.0)) for unit, values in computed.items()}
    best = min(misfit, key=lambda unit: misfit[unit])
    return best if misfit[best] <= AGREEMENT else None


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("inf")


def _salinity(conductivity: FloatArray, temperature: FloatArray, pressure: FloatArray, unit: str) -> FloatArray:
    return np.asarray(gsw.SP_from_C(TO_MS_PER_CM[unit] * conductivity, temperature, pressure), dtype=np.float64)


Columns = tuple[tuple[str, str], ...]
"""Quantities of a CTD, each with the name of its column."""
Layout = tuple[str, Columns]
"""A CTD and its columns."""


def _layouts(files: SeaExplorerFiles, reads: Reads) -> tuple[dict[Layout, list[dict[int, Path]]], dict[int, list[str]]]:
    """Payload files by layout (a list of the preferred files and of the others, by cycle), and faults by cycle."""
    layouts: dict[Layout, list[dict[int, Path]]] = {}
    faults: dict[int, list[str]] = {}
    for cycle, paths in files.payload.items():
        for rank, path in enumerate(paths):
            try:
                ctds = find_ctds(reads(read_columns, path))
            except InputError as error:
                faults.setdefault(cycle, []).append(str(error))
                continue
            for sensor, columns in ctds.items():
                by_rate = layouts.setdefault((sensor, tuple(sorted(columns.items()))), [{}, {}])
                by_rate[rank][cycle] = path
    return layouts, faults


def _read_payload(
    paths: Mapping[int, Path],
    columns: Columns,
    dropped: Counter[str],
    faults: dict[int, list[str]],
    reads: Reads,
) -> Rows:
    """Read one CTD's columns from the files of one kind; count the dropped rows, and add the faults of the files."""
    everything = (-np.inf, np.inf)
    ranges = {name: _RANGES.get(quantity, everything) for quantity, name in columns}
    found = read_rows(paths, CLOCK, ranges, label="payload: ", reads=reads)
    dropped.update(found.dropped)
    for cycle, why in found.rejected.items():
        faults.setdefault(cycle, []).append(why)
    return found.rows


def _cast(rows: Rows, columns: Columns, time: TimeArray, depth: FloatArray) -> _Cast:
    """Arrange the rows of one CTD by quantity; the navigation rows give the pressure that a CTD lacks."""
    measured = {quantity: rows[name] for quantity, name in columns}
    absent = np.full(len(rows), np.nan)
    return _Cast(
        rows.time,
        rows.part,
        measured["temperature"],
        measured["pressure"] if "pressure" in measured else _pressure_from_depth(rows, time, depth),
        measured.get("conductivity", absent),
        measured.get("practical_salinity", absent),
    )


def _pressure_from_depth(rows: Rows, time: TimeArray, depth: FloatArray) -> FloatArray:
    known = np.isfinite(depth)
    if not known.any() or len(rows) == 0:
        return np.full(len(rows), np.nan)
    at_samples = np.interp(rows.time.astype(np.int64), time[known].astype(np.int64), depth[known])
    return np.asarray(gsw.p_from_z(-at_samples, _NORMAL_LATITUDE), dtype=np.float64)


def _sample_count(cast: _Cast) -> int:
    salty = np.isfinite(cast.conductivity) | np.isfinite(cast.given_salinity)
    return int(np.count_nonzero(np.isfinite(cast.temperature) & salty))


def _joined(casts: list[_Cast]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    names = ("conductivity", "temperature", "pressure", "given_salinity")
    conductivity, temperature, pressure, salinity = (
        np.concatenate([getattr(cast, name) for cast in casts]) for name in names
    )
    return conductivity, temperature, pressure, salinity


def _on_rows(
    casts: list[_Cast], unit: str | None, time: TimeArray, interval: float
) -> tuple[dict[str, FloatArray], set[int]]:
    """Samples on the nearest row within half an interval, with priority for the first cast; and the sampled cycles."""
    names = ("temperature", "pressure", "practical_salinity")
    variables = {name: np.full(len(time), np.nan) for name in names}
    sampled: set[int] = set()
    if not np.isfinite(interval):
        return variables, sampled
    reach = np.timedelta64(round(0.5e9 * interval), "ns")
    for cast in casts:
        measured = {
            "temperature": cast.temperature,
            "pressure": cast.pressure,
            "practical_salinity": _practical_salinity(cast, unit),
        }
        placed = {name: onto_nearest(time, cast.time, values, reach) for name, values in measured.items()}
        empty = ~np.isfinite(variables["temperature"])
        for name in names:
            variables[name][empty] = placed[name][empty]
        sampled |= set(np.unique(cast.cycle[np.isfinite(cast.temperature)]).tolist())
    return variables, sampled


def _practical_salinity(cast: _Cast, unit: str | None) -> FloatArray:
    """Practical salinity (PSS-78) from conductivity, or the salinity in the file where there is no conductivity."""
    if unit is None:
        return cast.given_salinity
    computed = _salinity(cast.conductivity, cast.temperature, cast.pressure, unit)
    return np.where(np.isfinite(cast.conductivity), computed, cast.given_salinity)


def _comment(sensor: str, unit: str | None, basis: str) -> str:
    salinity = "practical salinity as in the file"
    if unit is not None:
        salinity = f"practical salinity by PSS-78 from conductivity in {unit} (gsw; unit {basis})"
    return (
        f"{sensor or 'CTD'}: temperature, pressure and {salinity}, on the nearest navigation row within half a "
        "sampling interval, from pld1.raw or pld1.sub, whichever has more samples, with its gaps filled from the other"
    )


def _remarks(files: SeaExplorerFiles, sampled: Iterable[int], faults: Mapping[int, list[str]]) -> tuple[str, ...]:
    """Remarks on faulty payload files, and on the cycles without CTD data by reason."""
    there = set(sampled)
    without = {cycle: _reason(files, cycle) for cycle in files.navigation if cycle not in there}
    spoilt = [f"cycle {cycle}: {why}" for cycle, reasons in faults.items() for why in dict.fromkeys(reasons)]
    grouped = {reason: [c for c in without if without[c] == reason] for reason in dict.fromkeys(without.values())}
    return (*spoilt, *(f"{_name_cycles(cycles)}: {reason}, so no CTD data" for reason, cycles in grouped.items()))


def _reason(files: SeaExplorerFiles, cycle: int) -> str:
    return "no sample of a CTD in the payload file" if cycle in files.payload else "no payload file"


def _name_cycles(cycles: list[int]) -> str:
    """List cycles as text; runs of consecutive cycles are given by their ends."""
    runs = [
        [cycle for _, cycle in run] for _, run in groupby(enumerate(sorted(cycles)), key=lambda pair: pair[1] - pair[0])
    ]
    named = ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
    return f"{'cycle' if len(cycles) == 1 else 'cycles'} {named}"
