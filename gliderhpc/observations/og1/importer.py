"""The import itself: files in, observation file and summary out."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
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
from gliderhpc.observations.og1.record import Record, is_og1_file, read_record
from gliderhpc.observations.rows import NOT_INCREASING, Columns, in_time_order, join_columns
from gliderhpc.observations.sources import files_of
from gliderhpc.observations.validation import profile_spans

_PLATFORMS = ("seaglider", "slocum", "seaexplorer")


@dataclass(frozen=True, eq=False)
class _Found:
    """One file as it goes into the observation file."""

    path: Path
    record: Record
    model: str
    vehicle: str
    mission: str


def import_og1(
    sources: Sequence[Path], out: Path, *, declination: float | None = None, overwrite: bool = False
) -> ImportSummary:
    """Turn OceanGliders OG1 trajectory files into an observation file.

    The files must hold attitude and the ballast's volume. A battery that they do not hold is taken to stay at zero,
    which the file and the summary say.

    Parameters
    ----------
    sources : sequence of Path
        OG1 files of one glider, or folders of them.
    out : Path
        The netCDF file to write.
    declination : float, optional
        Added to the heading (degree) in place of what the files say.
    overwrite : bool
        Replace a file that is there.

    Returns
    -------
    ImportSummary
        Profiles, fixes, and the files and dives that were left out and why.

    Raises
    ------
    InputError
        None of the sources can be used, they belong to more than one glider, or `out` exists and may not be
        replaced, or cannot be written.
    """
    sources, out = [Path(source) for source in sources], Path(out)
    check_place(out, sources, is_og1_file, overwrite=overwrite)
    rejected: dict[str, str] = {}
    found: list[_Found] = []
    for path in files_of(sources, _is_netcdf):
        try:
            with ForeignFile(path) as file:
                found.append(_find(file, declination))
        except InputError as error:
            rejected[path.name] = str(error)
    if not found:
        raise InputError(next(iter(rejected.values()), f"{sources[0]}: holds no netCDF file"))
    found.sort(key=lambda item: item.record.samples["time"][0])
    vehicle = _only_vehicle(found)
    numbers = _profile_numbers(found)
    variables, backwards, steps = _join(found, numbers)
    fixes = merge_fixes([item.record.fixes for item in found])
    profile, time = variables["profile"].astype(np.int64), variables["time"].astype("datetime64[ns]")
    variables["profile"], fixes, lost, remarks = without_doubtful(steps, profile, time, fixes)
    rejected |= {f"dive {number}": why for number, why in lost.items()}
    rejected |= {f"dive {number}": why for item in found for number, why in item.record.lost.items()}
    dropped = backwards + sum(item.record.rows_dropped for item in found)
    rows_dropped = {NOT_INCREASING: dropped} if dropped else {}
    without = {f"dive {n}": why for item in found for n, why in item.record.without_dive.items()}
    attributes = {
        "platform": _platform(found[0].model),
        "platform_id": vehicle,
        "mission": found[0].mission,
        "source": f"OceanGliders OG1 netCDF, {', '.join(item.path.name for item in found)}",
        **_describe_processing(found),
        "dives_without_profile": describe_reasons(without),
        "files_rejected": describe_reasons(rejected),
        "rows_dropped": describe_reasons(rows_dropped),
    }
    spans, _ = profile_spans(variables["profile"].astype(np.int64))
    dives = {new: dive.number for item, part in zip(found, numbers, strict=True)
             for new, dive in zip(part, item.record.dives, strict=True)}  # fmt: skip
    return write_import(
        out, variables, fixes, attributes,
        overwrite=overwrite, vehicle=vehicle, mission=found[0].mission, pieces="dives",
        spans=spans, parts={number: (dives[number],) for number in spans},
        sample_interval=median_interval(variables["time"].astype("datetime64[ns]"), list(spans.values())),
        without_profile=without, rejected=rejected,
        remarks=(*remarks, *(remark for item in found for remark in (*_remarks(item), *item.record.remarks))),
        rows_dropped=rows_dropped,
    )  # fmt: skip


def _is_netcdf(path: Path) -> bool:
    return path.name.endswith(".nc")


def _find(file: ForeignFile, declination: float | None) -> _Found:
    vehicle = file.text("PLATFORM_SERIAL_NUMBER") or file.attribute("id") or file.path.stem
    return _Found(
        path=file.path,
        record=read_record(file, declination),
        model=file.text("PLATFORM_MODEL") or file.attribute("platform"),
        vehicle=vehicle.upper(),
        mission=file.text("TRAJECTORY") or file.attribute("id") or file.path.stem,
    )


def _only_vehicle(found: list[_Found]) -> str:
    other = next((item for item in found if item.vehicle != found[0].vehicle), None)
    if other is not None:
        raise InputError(f"{other.path}: belongs to another glider than {found[0].path}; import one glider at a time")
    return found[0].vehicle


def _platform(model: str) -> str:
    """Give the hull shipped for a model of glider, or the model's own name."""
    return next((name for name in _PLATFORMS if name in model.lower()), model)


def _profile_numbers(found: list[_Found]) -> list[list[int]]:
    """Keep the files' own numbers of their dives, or count through where two files count from the same number on."""
    own = [[dive.number for dive in item.record.dives] for item in found]
    joined = [number for part in own for number in part]
    if joined == sorted(set(joined)):
        return own
    ends = np.cumsum([len(part) for part in own]).tolist()
    return [list(range(end - len(part) + 1, end + 1)) for end, part in zip(ends, own, strict=True)]


def _join(found: list[_Found], numbers: list[list[int]]) -> tuple[Columns, int, list[ClockStep]]:
    """Samples and solutions of all files, how many samples lay before the end of the file before, and clock steps."""
    pairs = list(zip(found, numbers, strict=True))
    parts = [item.record.samples | {"profile": _marked(item.record, part)} for item, part in pairs]
    joined, dropped, steps = in_time_order(join_columns(parts))
    joined["reference_profile"] = np.array([number for part in numbers for number in part], dtype=np.int64)
    joined["reference_declination"] = np.concatenate(
        [np.full(len(part), item.record.declination.angle) for item, part in pairs]
    )
    for group in ("current", "speed"):
        solved = [getattr(item.record, group) for item in found]
        joined |= {name: np.concatenate([part[name] for part in solved]) for name in solved[0]}
    return joined, dropped, steps


def _marked(record: Record, numbers: list[int]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    marks = np.zeros(len(record.samples["time"]), dtype=np.int64)
    for number, dive in zip(numbers, record.dives, strict=True):
        marks[dive.start : dive.stop] = number
    return marks


def _remarks(item: _Found) -> tuple[str, ...]:
    name, record = item.path.name, item.record
    remarks = [f"{name}: has no {what}: taken as zero, which leaves its effect to the disturbance" for what in
               record.absent]  # fmt: skip
    if not record.declination.known:
        remarks.append(
            f"{name}: heading left magnetic, its declination is not in the file: give --declination, or the currents "
            "will be turned by it"
        )
    return tuple(remarks)


def _describe_processing(found: list[_Found]) -> dict[str, str]:
    absent = ", ".join(dict.fromkeys(what for item in found for what in item.record.absent)) or "none"
    headings = dict.fromkeys(
        f"{item.record.declination.angle:.2f} degrees added ({item.record.declination.source})" for item in found
    )
    return {
        "heading_comment": "; ".join(headings),
        "battery_position_comment": "minus PITCH_CTL, which grows aft and is in cm where the file does not say",
        "battery_rotation_comment": "ROLL_CTL, in degrees where the file does not say, positive with starboard down",
        "ballast_volume_comment": "VBD_CC, in cm3 where the file does not say, positive buoyant",
        "controls_absent": f"{absent} (zero)" if absent != "none" else absent,
        "profile_comment": "the file's dives, or those judged from depth, between the depths of 3 m",
        "fix_comment": "the file's GPS positions without repetitions; those that no drift below "
        f"{MAXIMUM_DRIFT:g} m/s leads to are left out",
        "ctd_comment": "temperature, salinity and pressure of the rows with attitude, without those flagged 3, 4 or 9",
        "reference_comment": "the producer's own current and speed through the water, for comparison; no estimate uses "
        "them",
    }
