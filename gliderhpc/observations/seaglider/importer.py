"""Import of Seaglider per-dive files: observation file and summary out."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations.clock_steps import ClockStep, without_doubtful
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, merge_fixes
from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.imported import (
    ImportSummary,
    check_place,
    describe_reasons,
    median_interval,
    write_import,
)
from gliderhpc.observations.rows import NOT_INCREASING, Columns, in_time_order, join_columns
from gliderhpc.observations.seaglider.controls import BALLAST, CONTROLS, PITCH, ROLL, Centres, has_column, read_centres
from gliderhpc.observations.seaglider.dive import Dive, read_dive, read_solution
from gliderhpc.observations.sources import files_of
from gliderhpc.observations.validation import profile_spans

_NAME = re.compile(r"p(?P<vehicle>\d{3})(?P<dive>\d{4})(?:_\d{8})?\.nc", re.IGNORECASE)


@dataclass(frozen=True)
class MissionFiles:
    """The files of one Seaglider's mission.

    Attributes
    ----------
    vehicle : int
        Number of the glider.
    dives : dict of int to Path
        The file of every dive, by ascending dive.
    """

    vehicle: int
    dives: dict[int, Path]


def is_seaglider_file(path: Path) -> bool:
    """Return whether a file is named as the basestation names its per-dive files."""
    return _NAME.fullmatch(path.name) is not None


def find_files(sources: Sequence[Path]) -> MissionFiles:
    """Collect the per-dive files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them.

    Raises
    ------
    InputError
        A source does not exist or is no per-dive file, there is none, a dive comes twice, or the files belong to more
        than one glider.
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
            raise InputError(f"{path}: dive {dive} is already there as {dives[dive]}; give every dive once")
        dives[dive] = path
    if not dives:
        raise InputError(f"{', '.join(map(str, sources))}: no pGGGDDDD.nc there; give the folder of per-dive files")
    if len(owners) > 1:
        first, second = list(owners.values())[:2]
        raise InputError(f"{second}: belongs to another glider than {first}; import one glider at a time")
    return MissionFiles(next(iter(owners)), dict(sorted(dives.items())))


@dataclass(frozen=True, eq=False)
class _Found:
    """One dive as it goes into the file, with the basestation's solution and remarks."""

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
        reasons = describe_reasons(mission.rejected | mission.without)
        raise InputError(f"{sources[0]}: not one dive can be used; {reasons}")
    vehicle = f"SG{files.vehicle:03d}"
    name = found[0].mission or vehicle
    variables, backwards, steps = _join(found)
    fixes = merge_fixes([item.dive.fixes for item in found])
    numbers, time = variables["profile"].astype(np.int64), variables["time"].astype("datetime64[ns]")
    variables["profile"], fixes, lost, remarks = without_doubtful(steps, numbers, time, fixes)
    mission.rejected.update({f"dive {number}": why for number, why in lost.items()})
    dropped = backwards + sum(item.dive.rows_dropped for item in found)
    rows_dropped = {NOT_INCREASING: dropped} if dropped else {}
    attributes = {
        "platform": "seaglider",
        "platform_id": vehicle,
        "mission": name,
        "source": f"Seaglider per-dive netCDF of the basestation, dives {found[0].number}-{found[-1].number}",
        **_describe_processing(found, mission.centres),
        "dives_without_profile": describe_reasons(mission.without),
        "dives_rejected": describe_reasons(mission.rejected),
        "rows_dropped": describe_reasons(rows_dropped),
    }
    spans, _ = profile_spans(variables["profile"].astype(np.int64))
    return write_import(
        out, variables, fixes, attributes,
        overwrite=overwrite, vehicle=vehicle, mission=name, pieces="dives",
        spans=spans, parts={number: (number,) for number in spans},
        sample_interval=median_interval(variables["time"].astype("datetime64[ns]"), list(spans.values())),
        without_profile=mission.without, rejected=mission.rejected,
        remarks=(*remarks, *(remark for item in found for remark in item.remarks)), rows_dropped=rows_dropped,
    )  # fmt: skip


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
        layout=_describe_layout(file),
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


def _describe_layout(file: ForeignFile) -> str:
    columns = [control.column for control in CONTROLS if has_column(file, control)]
    tables = [f"{control.table}_ad" for control in CONTROLS if not has_column(file, control)]
    return ", ".join(columns + tables)


def _describe_processing(found: list[_Found], centres: Centres) -> dict[str, str | float]:
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
