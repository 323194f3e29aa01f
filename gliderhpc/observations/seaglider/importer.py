"""The import itself: files in, observation file and summary out."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations.clock_steps import ClockStep, without_doubtful
from gliderhpc.observations.columns import Columns, in_time_order, join_columns
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, merge_fixes
from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.imported import (
    ImportSummary,
    check_place,
    ctd_samples,
    imported_profile,
    median_interval,
    say_reasons,
)
from gliderhpc.observations.rows import NOT_INCREASING
from gliderhpc.observations.seaglider.controls import BALLAST, CONTROLS, PITCH, ROLL, Centres, has_column, read_centres
from gliderhpc.observations.seaglider.dive import Dive, read_dive
from gliderhpc.observations.seaglider.files import MissionFiles, find_files, is_seaglider_file
from gliderhpc.observations.seaglider.solution import read_solution
from gliderhpc.observations.validation import profile_spans
from gliderhpc.observations.writer import write_observations


@dataclass(frozen=True, eq=False)
class _Found:
    """One dive as it goes into the file, with the basestation's solution and what is to be said of it."""

    number: int
    dive: Dive
    solution: Columns
    layout: str
    mission: str
    remarks: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Mission:
    """The dives found, those that are no profile, those that could not be used, and the centres of the positions."""

    dives: list[_Found]
    without: dict[str, str]
    rejected: dict[str, str]
    centres: Centres


def import_seaglider(sources: Sequence[Path], out: Path, *, overwrite: bool = False) -> ImportSummary:
    """Turn a Seaglider's per-dive files into an observation file.

    Every dive is one profile and keeps its number. The basestation's own solution (current, speed through the water,
    coefficients) goes into the reference quantities.

    Parameters
    ----------
    sources : sequence of Path
        ``pGGGDDDD.nc`` files of one glider, or folders of them.
    out : Path
        The netCDF file to write.
    overwrite : bool
        Replace a file that is there.

    Returns
    -------
    ImportSummary
        Profiles, fixes, and the dives that were left out and why.

    Raises
    ------
    InputError
        The sources are not one glider's dives, none of them can be used, or `out` exists and may not be replaced, or
        cannot be written.
    """
    sources, out = [Path(source) for source in sources], Path(out)
    check_place(out, sources, is_seaglider_file, overwrite=overwrite)
    files = find_files(sources)
    mission = _read_mission(files)
    found = mission.dives
    if not found:
        reasons = say_reasons(mission.rejected | mission.without)
        raise InputError(f"{sources[0]}: not one dive can be used; {reasons}")
    vehicle = f"SG{files.vehicle:03d}"
    name = found[0].mission or vehicle
    variables, backwards, steps = _join(found)
    fixes = merge_fixes([item.dive.fixes for item in found])
    numbers, time = variables["profile"].astype(np.int64), variables["time"].astype("datetime64[ns]")
    variables["profile"], fixes, lost, remarks = without_doubtful(steps, numbers, time, fixes)
    mission.rejected.update({f"dive {number}": why for number, why in lost.items()})
    variables |= {"fix_time": fixes.time, "fix_latitude": fixes.latitude, "fix_longitude": fixes.longitude}
    dropped = backwards + sum(item.dive.rows_dropped for item in found)
    rows_dropped = {NOT_INCREASING: dropped} if dropped else {}
    attributes = {
        "platform": "seaglider",
        "platform_id": vehicle,
        "mission": name,
        "source": f"Seaglider per-dive netCDF of the basestation, dives {found[0].number}-{found[-1].number}",
        **_say_processing(found, mission.centres),
        "dives_without_profile": say_reasons(mission.without),
        "dives_rejected": say_reasons(mission.rejected),
        "rows_dropped": say_reasons(rows_dropped),
    }
    write_observations(variables, out, attributes=attributes, overwrite=overwrite)
    spans, _ = profile_spans(variables["profile"].astype(np.int64))
    return ImportSummary(
        path=out,
        vehicle=vehicle,
        mission=name,
        pieces="dives",
        profiles=tuple(imported_profile(number, (number,), *span, variables) for number, span in spans.items()),
        without_profile=mission.without,
        rejected=mission.rejected,
        remarks=(*remarks, *(remark for item in found for remark in item.remarks)),
        sample_interval=median_interval(variables["time"].astype("datetime64[ns]"), list(spans.values())),
        fixes=len(fixes.time),
        fixes_dropped=fixes.outliers,
        rows=len(variables["time"]),
        ctd_samples=ctd_samples(variables),
        rows_dropped=rows_dropped,
    )


def _read_mission(files: MissionFiles) -> _Mission:
    """Read every dive that can be read; positions refer to the centres in the first file that opens."""
    found: list[_Found] = []
    without: dict[str, str] = {}
    rejected: dict[str, str] = {}
    centres: Centres = {}
    for number, path in files.dives.items():
        try:
            with ForeignFile(path) as file:
                centres = centres or read_centres(file)
                found.append(_find(file, number, centres))
        except ProfileError as error:
            without[f"dive {number}"] = str(error)
        except InputError as error:
            rejected[f"dive {number}"] = str(error)
    return _Mission(found, without, rejected, centres)


def _find(file: ForeignFile, number: int, centres: Centres) -> _Found:
    dive = read_dive(file, centres)
    return _Found(
        number=number,
        dive=dive,
        solution=read_solution(file, number, dive.declination),
        layout=_say_layout(file),
        mission=file.text("sg_cal_mission_title").strip(),
        remarks=_missing_fixes(number, dive),
    )


def _missing_fixes(number: int, dive: Dive) -> tuple[str, ...]:
    """Say which end of the dive has no fix in its own file."""
    time = dive.variables["time"]
    before = np.any(dive.fixes.time <= time[dive.start])
    after = np.any(dive.fixes.time >= time[dive.stop - 1])
    missing = [text for text, there in (("before it (GPS2)", before), ("after it (GPSE)", after)) if not there]
    return tuple(f"dive {number}: no usable GPS fix {text} in its file" for text in missing)


def _join(found: list[_Found]) -> tuple[Columns, int, list[ClockStep]]:
    """Samples and solutions of all dives, how many samples lay before the end of the dive before, and clock steps."""
    parts = [item.dive.variables | {"profile": _numbers(item)} for item in found]
    joined, dropped, steps = in_time_order(join_columns(parts))
    joined |= {name: np.concatenate([item.solution[name] for item in found]) for name in found[0].solution}
    return joined, dropped, steps


def _numbers(item: _Found) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    numbers = np.zeros(len(item.dive.variables["time"]), dtype=np.int64)
    numbers[item.dive.start : item.dive.stop] = item.number
    return numbers


def _say_layout(file: ForeignFile) -> str:
    columns = [control.column for control in CONTROLS if has_column(file, control)]
    tables = [f"{control.table}_ad" for control in CONTROLS if not has_column(file, control)]
    return ", ".join(columns + tables)


def _say_processing(found: list[_Found], centres: Centres) -> dict[str, str | float]:
    layouts = "; ".join(dict.fromkeys(item.layout for item in found))
    declinations = [item.dive.declination for item in found]
    return {
        "control_columns": layouts,
        "battery_position_comment": "minus the file's position (cm, growing aft) over 100",
        "battery_position_zero_count": centres[PITCH],
        "battery_rotation_comment": "the file's position in degrees, positive with starboard down; one centre, that "
        "of the dive, for dive and climb",
        "battery_rotation_zero_count": centres[ROLL],
        "ballast_volume_comment": "the file's oil volume (cm3), positive buoyant",
        "ballast_volume_zero_count": centres[BALLAST],
        "control_comment": "positions are referred to the first dive's centres (counts of the position sensors); "
        "between the runs of the motors in the gc tables they are interpolated",
        "heading_comment": f"magnetic heading plus the file's declination, {min(declinations):g} to "
        f"{max(declinations):g} degrees",
        "profile_comment": "from the first sample below log_D_FLARE to the last one below log_D_SURF",
        "fix_comment": "GPS1, GPS2 and GPSE of every file, without repetitions and without those flagged bad; those "
        f"that no drift below {MAXIMUM_DRIFT:g} m/s leads to are left out",
        "ctd_comment": "the basestation's corrected temperature and salinity on the nearest sample within half an "
        "interval",
        "reference_comment": "the basestation's own solution, for comparison; no estimate uses it",
    }
