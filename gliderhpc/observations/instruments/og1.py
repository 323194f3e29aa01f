"""Import of OceanGliders OG1 netCDF files into the observation format."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import check_heading_unit
from gliderhpc.observations.checks.validation import profile_spans
from gliderhpc.observations.files.foreign import ForeignFile, files_of
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.fixes import MAXIMUM_DRIFT
from gliderhpc.observations.importing.clock_steps import ClockStep, find_clock_steps, screen_clock_steps
from gliderhpc.observations.importing.dive_files import (
    FileRecords,
    check_samples,
    contradicting_dives,
    join_files,
    number_samples,
    without_dives,
)
from gliderhpc.observations.importing.rows import Columns, increasing
from gliderhpc.observations.importing.time_order import RowOrder, order_of_rows
from gliderhpc.observations.importing.workflow import ImportSummary, MissionRecords, import_mission
from gliderhpc.observations.instruments.og1_dives import (
    Dives,
    IntArray,
    dive_numbers,
    drop_contradicting,
    find_dives,
    is_counted,
    keeps_count,
)
from gliderhpc.observations.instruments.og1_fills import reject_fills
from gliderhpc.observations.instruments.og1_joining import Record, chosen_samples, floats, is_flight, join_overlapping
from gliderhpc.observations.instruments.og1_variables import (
    ATTITUDE,
    TIME,
    Declination,
    check_complete,
    describe_clock,
    describe_fixes,
    describe_limits,
    find_declination,
    read_controls,
    read_currents,
    read_depth,
    read_flight_model,
    read_gps,
    read_seawater,
    read_speeds,
    reject_flagged,
)

_PLATFORMS = ("seaglider", "slocum", "seaexplorer")


def is_og1_file(path: Path) -> bool:
    """Return whether a path is a readable OG1 file."""
    if not path.is_file():
        return False
    try:
        with ForeignFile(path) as file:
            return "TIME" in file and "N_MEASUREMENTS" in file.dimensions
    except InputError:
        return False


def import_og1(
    sources: Sequence[Path],
    out: Path,
    *,
    declination: float | None = None,
    overwrite: bool = False,
    reads: Reads = read_directly,
) -> ImportSummary:
    """Turn OceanGliders OG1 trajectory files into an observation file.

    The files must hold attitude and ballast volume. If they do not hold the battery's position or rotation, it is
    assumed to be zero; the written file and the summary note this.

    Parameters
    ----------
    sources : sequence of Path
        OG1 files of one glider, or folders of them.
    out : Path
        The netCDF file to write.
    declination : float, optional
        Declination to add to the heading (degree), instead of the one in the files.
    overwrite : bool
        Replace an existing file.
    reads : Reads
        Function that reads each file; by default every file is read directly.

    Returns
    -------
    ImportSummary
        Profiles, fixes, and the omitted files and dives with the reasons.

    Raises
    ------
    InputError
        None of the sources can be used, they belong to more than one glider, or `out` exists and may not be
        replaced, or cannot be written.
    """
    read = partial(_read_mission, declination=declination, reads=reads)
    return import_mission(read, is_og1_file, sources, out, overwrite=overwrite)


def _read_mission(sources: Sequence[Path], declination: float | None, reads: Reads) -> MissionRecords:
    """Read every readable file and join the files to a mission."""
    found, rejected = _read_records(sources, declination, reads)
    vehicle = _only_vehicle(found)
    names = ", ".join(record.path.name for record in found)
    found = join_overlapping(found)
    numbers = _profile_numbers(found)
    files = [_numbered(record, part) for record, part in zip(found, numbers, strict=True)]
    dives = [(dive, record.path) for record in found for dive in record.dives]
    of_number = dict(zip([number for part in numbers for number in part], dives, strict=True))
    lost = {number: f"{of_number[number][1]}: {why} (TIME)" for number, why in contradicting_dives(files).items()}
    files = without_dives(files, lost)
    if not files:
        raise InputError(next(iter(lost.values())))
    joined = join_files(files)
    spans, _ = profile_spans(joined.variables["profile"].astype(np.int64))
    return MissionRecords(
        platform=_platform(found[0].model),
        vehicle=vehicle,
        mission=found[0].mission,
        source=f"OceanGliders OG1 netCDF, {names}",
        pieces="dives",
        variables=joined.variables,
        spans=spans,
        parts={number: (of_number[number][0],) for number in spans},
        fixes=joined.fixes,
        comments=_describe_processing(found),
        rejected=rejected
        | {f"dive {n}": why for record in found for n, why in record.lost.items()}
        | {f"dive {n}": why for n, why in lost.items()},
        without_profile={_name(record, n): why for record in found for n, why in record.without_dive.items()},
        rows_dropped=joined.rows_dropped,
        remarks=tuple(remark for record in found for remark in (*_remarks(record), *record.remarks)),
        clock_steps=joined.clock_steps,
    )


def _read_records(
    sources: Sequence[Path], declination: float | None, reads: Reads
) -> tuple[list[Record], dict[str, str]]:
    """Read every readable file, in order of time; also return why the others cannot be used, by name.

    Raises
    ------
    InputError
        None of the files can be used.
    """
    rejected: dict[str, str] = {}
    found: list[Record] = []
    for path in files_of(sources, _is_netcdf):
        try:
            found.append(reads(_read_file, path, declination))
        except InputError as error:
            rejected[path.name] = str(error)
    if not found:
        raise InputError(next(iter(rejected.values()), f"{sources[0]}: contains no netCDF file"))
    return sorted(found, key=lambda record: record.samples["time"][0]), rejected


def _name(record: Record, number: int) -> str:
    """Name of a dive by its number in the file, which may be another one in the mission."""
    return f"{record.path.name}, its dive {number}" if record.renumbered else f"dive {number}"


def _read_file(path: Path, declination: float | None) -> Record:
    with ForeignFile(path) as file:
        return read_record(file, declination)


def _is_netcdf(path: Path) -> bool:
    return path.suffix.lower() == ".nc"


def _only_vehicle(found: list[Record]) -> str:
    other = next((item for item in found if item.vehicle != found[0].vehicle), None)
    if other is not None:
        raise InputError(f"{other.path}: belongs to another glider than {found[0].path}; import one glider at a time")
    return found[0].vehicle


def _platform(model: str) -> str:
    """Return the name of the shipped hull for a glider model, or the name of the model if there is none."""
    return next((name for name in _PLATFORMS if name in model.lower()), model)


def _profile_numbers(found: list[Record]) -> list[list[int]]:
    """Number the dives as the files do if those numbers increase throughout; otherwise consecutively from 1."""
    own = [[*record.dives] for record in found]
    joined = [number for part in own for number in part]
    if joined == sorted(set(joined)) and not any(record.renumbered for record in found):
        return own
    ends = np.cumsum([len(part) for part in own]).tolist()
    return [list(range(end - len(part) + 1, end + 1)) for end, part in zip(ends, own, strict=True)]


def _numbered(record: Record, numbers: Sequence[int]) -> FileRecords:
    """Number the dives of a file as profiles."""
    spans = dict(zip(numbers, record.dives.values(), strict=True))
    profile = number_samples(spans, len(record.samples["time"]))
    solution: Columns = {
        "reference_profile": np.array(numbers, dtype=np.int64),
        "reference_declination": np.full(len(numbers), record.declination.angle),
        **record.solution,
    }
    return FileRecords(record.samples | {"profile": profile}, solution, record.fixes, record.rows_dropped)


def _remarks(record: Record) -> tuple[str, ...]:
    name = record.path.name
    remarks = [
        f"{name}: has no {what}: taken as zero, so its effect becomes part of the disturbance" for what in record.absent
    ]
    if not record.declination.known:
        remarks.append(
            f"{name}: heading left magnetic, because the file has no declination: give `declination`, or the currents "
            "will be rotated by it"
        )
    return tuple(remarks)


def _describe_processing(found: list[Record]) -> dict[str, str]:
    absent = ", ".join(dict.fromkeys(what for record in found for what in record.absent)) or "none"
    headings = dict.fromkeys(
        f"{record.declination.angle:.2f} degrees added ({record.declination.source})" for record in found
    )
    return {
        "heading_comment": "; ".join(headings),
        "battery_position_comment": "minus PITCH_CTL, which increases aft; in cm unless the file declares a unit",
        "battery_rotation_comment": "ROLL_CTL, in degrees unless the file declares a unit; positive with starboard "
        "down",
        "ballast_volume_comment": "VBD_CC, in cm3 unless the file declares a unit; positive is buoyant",
        "controls_absent": f"{absent} (zero)" if absent != "none" else absent,
        "profile_comment": "the file's dives, or dives detected from depth; from the first to the last sample below "
        "3 m",
        "fix_comment": "the file's GPS positions without repetitions; those that no drift below "
        f"{MAXIMUM_DRIFT:g} m/s connects with a neighbouring fix are left out",
        "quality_comment": "times, depth, attitude, controls and fixes flagged bad or missing are left out",
        "ctd_comment": "temperature, salinity and pressure of the rows with attitude, without those flagged bad or "
        "missing",
        "reference_comment": "the producer's own current and speed through the water, for comparison; no estimate uses "
        "them",
    }


def read_record(file: ForeignFile, declination: float | None) -> Record:
    """Read one file.

    Parameters
    ----------
    file : ForeignFile
        An OG1 file.
    declination : float, optional
        Declination to add to its heading (degree), if the user gives one.

    Raises
    ------
    InputError
        The file lacks time, depth, attitude or ballast volume, or is truncated.
    """
    vehicle = file.text("PLATFORM_SERIAL_NUMBER") or file.attribute("id") or file.path.stem
    check_complete(file)
    rejected = (*reject_flagged(file), *reject_fills(file))
    read = _read_samples(file, declination)
    samples = read.columns
    # A depth of the wrong sign, which the limits may exclude, has been refused.
    limited = describe_limits(file)
    doubt = _check_heading(file)
    clock = describe_clock(file, samples["time"].astype("datetime64[ns]"))
    order = _order(file, samples)
    flight = _flight(file, order, {name: values[order.rows] for name, values in samples.items()})
    found, time = flight.found, flight.samples["time"].astype("datetime64[ns]")
    profile = number_samples(found.spans, len(time))
    certain = screen_clock_steps(flight.steps, profile, time, read_gps(file))
    fixes, lost = certain.fixes, certain.left_out
    dives = {number: span for number, span in found.spans.items() if number not in lost}
    own_remarks = [f"{file.path.name}: {each}" for each in (*order.describe(), doubt, found.remark) if each]
    return Record(
        path=file.path,
        model=file.text("PLATFORM_MODEL") or file.attribute("platform"),
        vehicle=vehicle.upper(),
        mission=file.text("TRAJECTORY") or file.attribute("id") or file.path.stem,
        samples=flight.samples,
        counter=flight.counter,
        counted=is_counted(file),
        dives=dives,
        solution=read_currents(file, order.rows[flight.rows], list(dives.values()))
        | read_flight_model(file, len(dives))
        | read_speeds(file),
        fixes=fixes,
        declination=read.declination,
        absent=read.absent,
        renumbered=bool(found.remark),
        without_dive=found.without,
        lost=lost | {number: f"{file.path}: {why} (TIME)" for number, why in flight.contradicting.items()},
        rows_dropped=flight.rows_dropped,
        remarks=(
            *rejected,
            *limited,
            *clock,
            *read.remarks,
            *own_remarks,
            *describe_fixes(file, fixes),
            *certain.remarks,
        ),
    )


@dataclass(frozen=True, eq=False)
class _Flight:
    """Flight of a file: its ``n`` samples with attitude in order of time, and the dives found in them.

    Attributes
    ----------
    rows : (n,) array
        Rows of the samples, in the order of the rows.
    samples : Columns
        The samples.
    counter : (n,) array
        The file's own dive number at each sample.
    found : Dives
        Dives, by number.
    contradicting : dict of int to str
        Dives left out because their times contradict others, with the reason.
    steps : list of ClockStep
        Steps of the clock.
    rows_dropped : int
        Number of rows with attitude that are not in order of time.
    """

    rows: IntArray
    samples: Columns
    counter: IntArray
    found: Dives
    contradicting: dict[int, str]
    steps: list[ClockStep]
    rows_dropped: int


def _flight(file: ForeignFile, order: RowOrder, samples: Columns) -> _Flight:
    """Select the flight from the ordered rows of a file, and find its dives.

    Raises
    ------
    InputError
        No sample has both time and attitude.
    """
    depth = floats(samples["depth"])
    numbers = dive_numbers(file, order.rows, samples["time"].astype("datetime64[ns]"), depth)
    rows = np.flatnonzero(is_flight(samples))
    time = samples["time"][rows].astype("datetime64[ns]")
    in_order = increasing(time)
    steps = find_clock_steps(time, in_order, depth[rows])
    ordered = rows[in_order]
    if len(ordered) == 0:
        raise InputError(f"{file.path}: has no sample with both time and attitude")
    chosen = chosen_samples(samples, ordered)
    own, contradicting = drop_contradicting(numbers[rows], time, depth[rows], in_order)
    found = find_dives(own[in_order], time[in_order], depth[ordered], is_whole=not contradicting)
    dropped = int(np.count_nonzero(~in_order))
    return _Flight(ordered, chosen, own[in_order], found, contradicting, steps, dropped)


def _order(file: ForeignFile, samples: Columns) -> RowOrder:
    """Order of a file's rows in time; that of the file if the dives were counted in it."""
    values = [floats(values) for name, values in samples.items() if name != "time"]
    order = order_of_rows(samples["time"].astype("datetime64[ns]"), values)
    return order if keeps_count(file, order.rows) else RowOrder(np.arange(len(samples["time"])))


class _Samples(NamedTuple):
    """All rows of a file, the declination added to its heading, absent controls, and remarks on its seawater."""

    columns: Columns
    declination: Declination
    absent: tuple[str, ...]
    remarks: tuple[str, ...]


def _read_samples(file: ForeignFile, declination: float | None) -> _Samples:
    """Read all rows of a file."""
    names = {what: term.require(file, what) for what, term in ATTITUDE.items()}
    turned = find_declination(file, names["heading"], declination)
    samples: Columns = {
        "time": file.times(TIME.require(file, "time")),
        "depth": read_depth(file),
        **{what: file.converted(name, "degree") for what, name in names.items()},
    }
    samples["heading"] = np.mod(samples["heading"].astype(np.float64) + turned.angle, 360.0)
    controls, absent = read_controls(file, len(samples["time"]))
    seawater, unusable = read_seawater(file)
    samples |= controls | seawater
    check_samples(samples, str(file.path), "does not lie along TIME; give an OG1 trajectory file")
    return _Samples(samples, turned, absent, unusable)


def _check_heading(file: ForeignFile) -> str | None:
    """Check the unit of a file's heading, before a declination is added (`check_heading_unit`)."""
    name = ATTITUDE["heading"].require(file, "heading")
    heading = file.converted(name, "degree")
    return check_heading_unit(heading, {0: (0, len(heading))}, str(file.path), name)
