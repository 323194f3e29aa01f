"""Import of the basestation's per-dive Seaglider netCDF files (``p*.nc``) into the observation format."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations.checks.profile_checks import check_heading_unit
from gliderhpc.observations.checks.validation import profile_spans
from gliderhpc.observations.files.foreign import ForeignFile, files_of
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.fixes import MAXIMUM_DRIFT
from gliderhpc.observations.importing.dive_files import (
    FileRecords,
    contradicting_dives,
    join_files,
    number_samples,
    reference_speeds,
)
from gliderhpc.observations.importing.rows import Columns
from gliderhpc.observations.importing.workflow import ImportSummary, MissionRecords, import_mission
from gliderhpc.observations.instruments.seaglider_dive import (
    BALLAST,
    CONTROLS,
    PITCH,
    ROLL,
    Centres,
    Dive,
    has_column,
    read_centres,
    read_dive,
)
from gliderhpc.wording import counted, most_frequent_reason

_NAME = re.compile(r"p(?P<vehicle>\d{3})(?P<dive>\d{4})(?:_\d{8})?\.nc", re.IGNORECASE)


def is_seaglider_file(path: Path) -> bool:
    """Return whether a file is named like a per-dive file of the basestation."""
    return _NAME.fullmatch(path.name) is not None


_RAW_NAME = re.compile(r"p\d{7}\.(?:log|eng|asc|dat|cap)", re.IGNORECASE)


def refuse_raw_files(sources: Iterable[Path]) -> None:
    """Refuse the text files of a Seaglider's dives, from which the basestation makes the per-dive netCDF files.

    Raises
    ------
    InputError
        A source is such a file, or a folder that contains one.
    """
    for source in sources:
        raw = next((path for path in (source, *sorted(source.glob("*"))) if _RAW_NAME.fullmatch(path.name)), None)
        if raw is not None:
            raise InputError(
                f"{raw}: is a text file of a Seaglider's dive; give the basestation's netCDF file of each dive "
                "(pGGGDDDD.nc)"
            )


def find_files(sources: Sequence[Path]) -> tuple[int, dict[int, Path]]:
    """Collect the per-dive files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them.

    Returns
    -------
    vehicle : int
        Number of the glider.
    dives : dict of int to Path
        The file of every dive, by ascending number.

    Raises
    ------
    InputError
        A source does not exist or is not a per-dive file, there is no per-dive file, a dive occurs twice, or the files
        belong to more than one glider.
    """
    dives: dict[int, Path] = {}
    owners: dict[int, Path] = {}
    for path in files_of(sources, is_seaglider_file):
        match = _NAME.fullmatch(path.name)
        if match is None:
            raise InputError(f"{path}: is not named like a Seaglider's per-dive file (pGGGDDDD.nc)")
        owners.setdefault(int(match["vehicle"]), path)
        dive = int(match["dive"])
        if dive in dives:
            raise InputError(f"{path}: dive {dive} is already given as {dives[dive]}; give every dive once")
        dives[dive] = path
    if not dives:
        raise InputError(f"{', '.join(map(str, sources))}: no pGGGDDDD.nc found; give the folder of per-dive files")
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another glider than {first}; import one glider at a time")
    return next(iter(owners)), dict(sorted(dives.items()))


def import_seaglider(
    sources: Sequence[Path],
    out: Path,
    *,
    declination: float | None = None,
    overwrite: bool = False,
    reads: Reads = read_directly,
) -> ImportSummary:
    """Turn a Seaglider's per-dive files into an observation file.

    Every dive is one profile and keeps its number. The basestation's own solution (current, speed through the water,
    coefficients) is stored in the reference quantities.

    Parameters
    ----------
    sources : sequence of Path
        ``pGGGDDDD.nc`` files of one glider, or folders of them.
    out : Path
        The netCDF file to write.
    declination : float, optional
        Declination to add to the heading (degree, east positive), instead of the one in the files.
    overwrite : bool
        Replace an existing file.
    reads : Reads
        Function that reads each file; by default every file is read directly.

    Returns
    -------
    ImportSummary
        Profiles, fixes, and the omitted dives with the reasons.

    Raises
    ------
    InputError
        The sources are not one glider's dives, none of them can be used, or `out` exists and may not be replaced, or
        cannot be written.
    """
    read = partial(_read_mission, declination=declination, reads=reads)
    return import_mission(read, is_seaglider_file, sources, out, overwrite=overwrite)


def _read_mission(sources: Sequence[Path], declination: float | None, reads: Reads) -> MissionRecords:
    """Read every readable dive; positions refer to the centres in the first file that has them."""
    glider, files = find_files(sources)
    centres = _reference_centres(files.values(), reads)
    found, without, rejected = _read_dives(files, centres, reads)
    declination_remarks = _complete_declinations(found, declination)
    for number, why in contradicting_dives([dive.records for dive in found.values()]).items():
        rejected[f"dive {number}"] = f"{files[number]}: {why} (time)"
        del found[number]
    if not found:
        reason = most_frequent_reason(f"{dive}: {why}" for dive, why in (rejected | without).items())
        raise InputError(f"{sources[0]}: no dive can be used; {reason}")
    dives = list(found.values())
    joined = join_files([dive.records for dive in dives])
    spans, _ = profile_spans(joined.variables["profile"].astype(np.int64))
    doubt = _check_heading(dives, str(sources[0]))
    vehicle = f"SG{glider:03d}"
    return MissionRecords(
        platform="seaglider",
        vehicle=vehicle,
        mission=dives[0].mission or vehicle,
        source=f"Seaglider per-dive netCDF of the basestation, dives {min(found)}-{max(found)}",
        pieces="dives",
        variables=joined.variables,
        spans=spans,
        parts={number: (number,) for number in spans},
        fixes=joined.fixes,
        comments=_describe_processing(dives, centres, declination),
        rejected=rejected,
        without_profile=without,
        rows_dropped=joined.rows_dropped,
        rejected_attribute="dives_rejected",
        remarks=(
            *([doubt] if doubt else []),
            *declination_remarks,
            *_describe_left_out(found),
            *(remark for number, dive in found.items() for remark in _missing_fixes(number, dive)),
        ),
        clock_steps=joined.clock_steps,
    )


def _read_dives(
    files: Mapping[int, Path], centres: Centres, reads: Reads
) -> tuple[dict[int, "_DiveFile"], dict[str, str], dict[str, str]]:
    """Read every dive; also return why some have no profile, and why some files cannot be used."""
    found: dict[int, _DiveFile] = {}
    without: dict[str, str] = {}
    rejected: dict[str, str] = {}
    for number, path in files.items():
        try:
            found[number] = reads(_read_file, path, number, centres)
        except ProfileError as error:
            without[f"dive {number}"] = str(error)
        except InputError as error:
            rejected[f"dive {number}"] = str(error)
    return found, without, rejected


@dataclass(frozen=True, eq=False)
class _DiveFile:
    """One dive, with the basestation's solution and mission title."""

    dive: Dive
    records: FileRecords
    layout: str
    mission: str

    def with_dive(self, dive: Dive) -> "_DiveFile":
        """Return the file with a dive in another declination."""
        samples = self.records.samples | {"heading": dive.variables["heading"]}
        solution = self.records.solution | {"reference_declination": np.array([dive.declination])}
        return replace(self, dive=dive, records=replace(self.records, samples=samples, solution=solution))


def _reference_centres(files: Iterable[Path], reads: Reads) -> Centres:
    """Return each control's centre in the first file that has it; NaN if none has."""
    centres = dict.fromkeys(CONTROLS, float("nan"))
    for path in files:
        try:
            own = reads(_centres_of, path)
        except InputError:  # Reported when the file is read.
            continue
        centres |= {control: own[control] for control, known in centres.items() if not np.isfinite(known)}
        if all(map(np.isfinite, centres.values())):
            break
    return centres


def _centres_of(path: Path) -> Centres:
    with ForeignFile(path) as file:
        return read_centres(file)


def _read_file(path: Path, number: int, centres: Centres) -> _DiveFile:
    if number == 0:
        raise ProfileError("is not imported: a Seaglider numbers its self-test 0, and its dives from 1")
    with ForeignFile(path) as file:
        dive = read_dive(file, centres)
        numbers = number_samples({number: (dive.start, dive.stop)}, len(dive.variables["time"]))
        solution = read_solution(file, number, dive.declination)
        return _DiveFile(
            dive=dive,
            records=FileRecords(dive.variables | {"profile": numbers}, solution, dive.fixes, dive.rows_dropped),
            layout=_describe_layout(file),
            mission=file.text("sg_cal_mission_title").strip(),
        )


def _check_heading(dives: Sequence[_DiveFile], source: str) -> str | None:
    """Check the unit of the magnetic heading of all dives (`check_heading_unit`)."""
    magnetic = [
        np.mod(dive.magnetic_heading[dive.start : dive.stop] + 180.0, 360.0) for dive in (item.dive for item in dives)
    ]
    joined = np.concatenate(magnetic) - 180.0
    return check_heading_unit(joined, {0: (0, len(joined))}, source, "eng_head")


def _complete_declinations(found: dict[int, _DiveFile], given: float | None) -> tuple[str, ...]:
    """Give dives without a declination that of the dive before, else after them; return remarks on these dives.

    The declination of a mission changes slowly. Without any, the headings remain magnetic. A declination that the user
    gives replaces those of all dives.
    """
    if given is not None:
        found |= {number: item.with_dive(item.dive.turned(given)) for number, item in found.items()}
        return ()
    known = {number: item.dive.declination for number, item in found.items() if np.isfinite(item.dive.declination)}
    lacking = [number for number in found if number not in known]
    if lacking and not known:
        return (
            f"{_dives(lacking)}: heading left magnetic, because no file has a declination (magnetic_variation): give "
            "`declination`, or the currents will be rotated by it",
        )
    for number in lacking:
        source = max((other for other in known if other < number), default=min(known))
        dive = found[number].dive.turned(known[source])
        found[number] = found[number].with_dive(dive)
    if not lacking:
        return ()
    return (
        f"{_dives(lacking)}: no declination (magnetic_variation) in the file, so that of the last dive before with "
        "one, else of the first after, is added to the magnetic heading",
    )


def _describe_left_out(found: Mapping[int, _DiveFile]) -> tuple[str, ...]:
    """Remarks on omitted variables of the water and on undeclared fill values, each with the dives concerned."""
    texts = dict.fromkeys(text for item in found.values() for text in item.dive.remarks)
    omitted = tuple(
        f"{_dives([number for number, item in found.items() if text in item.dive.remarks])}: {text}" for text in texts
    )
    fills = {number: item.dive.fills for number, item in found.items()}
    names = dict.fromkeys(name for counts in fills.values() for name in counts)
    return omitted + tuple(
        _describe_fills(name, {number: counts[name] for number, counts in fills.items() if name in counts})
        for name in names
    )


def _describe_fills(name: str, counts: Mapping[int, int]) -> str:
    """Remark on the undeclared fill values of a variable, given by their number in each dive that has any."""
    samples = counted(sum(counts.values()), "sample")
    return (
        f"{_dives(list(counts))}: {name} is impossible, or a usual fill value, in {samples}; these are treated as "
        "missing: declare its fill value (_FillValue)"
    )


def _dives(numbers: Sequence[int]) -> str:
    return f"dive {numbers[0]}" if len(numbers) == 1 else f"{len(numbers)} dives from {numbers[0]} to {numbers[-1]}"


def _missing_fixes(number: int, found: _DiveFile) -> tuple[str, ...]:
    """Return a remark for each end of the dive without a fix in its own file."""
    dive = found.dive
    time = dive.variables["time"]
    before = np.any(dive.fixes.time <= time[dive.start])
    after = np.any(dive.fixes.time >= time[dive.stop - 1])
    missing = [text for text, there in (("before it (GPS2)", before), ("after it (GPSE)", after)) if not there]
    return tuple(f"dive {number}: no usable GPS fix {text} in its file" for text in missing)


def _describe_layout(file: ForeignFile) -> str:
    columns = [control.column for control in CONTROLS if has_column(file, control)]
    tables = [f"{control.table}_ad" for control in CONTROLS if not has_column(file, control)]
    return ", ".join(columns + tables)


def _describe_heading(dives: list[_DiveFile], given: float | None) -> str:
    if given is not None:
        return f"magnetic heading plus the given declination, {given:g} degree"
    known = [item.dive.declination for item in dives if np.isfinite(item.dive.declination)]
    if not known:
        return "heading left magnetic: no file has a declination"
    return f"magnetic heading plus the file's declination, {min(known):g} to {max(known):g} degrees"


def _describe_processing(dives: list[_DiveFile], centres: Centres, given: float | None) -> dict[str, str | float]:
    layouts = "; ".join(dict.fromkeys(item.layout for item in dives))
    return {
        "control_columns": layouts,
        "battery_position_comment": "minus the file's position (cm, increasing aft) over 100",
        "battery_position_zero_count": centres[PITCH],
        "battery_rotation_comment": "the file's position in degrees, positive with starboard down; one centre, that "
        "of the dive, for dive and climb",
        "battery_rotation_zero_count": centres[ROLL],
        "ballast_volume_comment": "the file's oil volume (cm3); positive is buoyant",
        "ballast_volume_zero_count": centres[BALLAST],
        "control_comment": "positions are referred to the first dive's centres (counts of the position sensors); "
        "between the runs of the motors in the gc tables they are interpolated",
        "heading_comment": _describe_heading(dives, given),
        "profile_comment": "from the first sample below log_D_FLARE to the last one below log_D_SURF",
        "fix_comment": "GPS1, GPS2 and GPSE of every file, without repetitions and without those flagged bad; those "
        f"that no drift below {MAXIMUM_DRIFT:g} m/s connects with a neighbouring fix are left out",
        "ctd_comment": "the basestation's corrected temperature and salinity at the nearest sample within half an "
        "interval",
        "reference_comment": "the basestation's own solution, for comparison; no estimate uses it",
    }


_SCALARS = {
    "reference_current_north": ("depth_avg_curr_north", "m s-1"),
    "reference_current_east": ("depth_avg_curr_east", "m s-1"),
    "reference_current_error": ("depth_avg_curr_error", "m s-1"),
    "reference_flight_north": ("flight_avg_speed_north", "m s-1"),
    "reference_flight_east": ("flight_avg_speed_east", "m s-1"),
    "reference_mass": ("sg_cal_mass", "kg"),
}
_CONSTANTS = {
    "reference_lift": "sg_cal_hd_a",
    "reference_drag": "sg_cal_hd_b",
    "reference_induced_drag": "sg_cal_hd_c",
    "reference_drag_exponent": "sg_cal_hd_s",
    # In cm3, regardless of the units declared in the file.
    "reference_maximum_volume": "sg_cal_volmax",
    "reference_volume_bias": "sg_cal_vbdbias",
    "reference_compressibility": "sg_cal_abs_compress",
    "reference_thermal_expansion": "sg_cal_therm_expan",
    "reference_density": "sg_cal_rho0",
}
_SPEEDS = {
    "reference_speed": "speed",
    "reference_horizontal_speed": "horz_speed",
    "reference_vertical_speed": "vert_speed",
    "reference_slope_speed": "speed_gsm",
}


def read_solution(file: ForeignFile, number: int, declination: float) -> Columns:
    """Reference quantities of one dive, NaN where the file has none.

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    number : int
        Number of the dive.
    declination : float
        Declination added to its magnetic heading (degree).
    """
    found: Columns = {
        "reference_profile": np.array([number]),
        "reference_declination": np.array([declination]),
    }
    for name, (source, unit) in _SCALARS.items():
        values = file.converted(source, unit)[:1] if source in file else np.zeros(0)
        found[name] = values if len(values) else np.array([np.nan])
    found |= {name: np.array([file.number(source)]) for name, source in _CONSTANTS.items()}
    return found | _speeds(file)


def _speeds(file: ForeignFile) -> Columns:
    """Speeds of the flight model, at the times with a speed."""
    if "ctd_time" not in file or "speed" not in file:
        empty: Columns = {name: np.zeros(0) for name in _SPEEDS}
        return empty | {"reference_time": np.zeros(0, "datetime64[ns]")}
    return reference_speeds(file, "ctd_time", {name: file.first([source]) for name, source in _SPEEDS.items()})
