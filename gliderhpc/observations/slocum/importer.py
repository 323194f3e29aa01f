"""The import itself: files in, observation file and summary out."""

from collections.abc import Sequence
from pathlib import Path

import gsw
import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.columns import Columns
from gliderhpc.observations.fixes import MAXIMUM_DRIFT
from gliderhpc.observations.imported import (
    ImportSummary,
    check_place,
    ctd_samples,
    imported_profile,
    median_interval,
    say_reasons,
)
from gliderhpc.observations.nearest import onto_nearest
from gliderhpc.observations.profiles import SURFACE_MARGIN, detect_profiles
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import Rows
from gliderhpc.observations.slocum.decoded import is_decoded
from gliderhpc.observations.slocum.files import find_files, is_binary
from gliderhpc.observations.slocum.reading import HANGING_CYCLE, Mission, read_mission
from gliderhpc.observations.slocum.sensors import BALLAST_SENSORS
from gliderhpc.observations.slocum.surface import find_fixes, surface_level, true_heading
from gliderhpc.observations.validation import profile_spans
from gliderhpc.observations.writer import Attribute, write_observations

RECORD_BREAK = 900.0
"""A longer pause below the surface (s) breaks a record in two: a segment's file is missing there."""

MINIMUM_SURFACE_TIME = 180.0
"""A shorter visit to the surface (s) is the turning point of a yo: filling the air bladder and calling take minutes."""

_SECOND = np.timedelta64(1, "s")


def import_slocum(
    sources: Sequence[Path],
    out: Path,
    *,
    cache: Path | None = None,
    declination: float | None = None,
    battery_scale: float = 1.0,
    battery_zero: float = 0.0,
    overwrite: bool = False,
) -> ImportSummary:
    """Turn a Slocum mission's records into an observation file.

    Parameters
    ----------
    sources : sequence of Path
        Binary files (``*.dbd`` and ``*.ebd``, ``*.sbd`` and ``*.tbd``, ``*.mbd`` and ``*.nbd``, and their compressed
        forms), netCDF files of native sensors, or folders of them, of one glider.
    out : Path
        The netCDF file to write.
    cache : Path, optional
        Folder of the cache files of the binary files; by default beside them, or in their folder's ``cac``.
    declination : float, optional
        Magnetic declination (degree, east positive); by default what the glider's GPS receiver reports.
    battery_scale : float
        Battery travel by what the vehicle reports of it, metre by metre.
    battery_zero : float
        Reported position at which ``battery_position`` is zero (m).
    overwrite : bool
        Replace a file that is there.

    Returns
    -------
    ImportSummary
        Profiles, fixes, what was done and what was left out.

    Raises
    ------
    InputError
        The sources are not one glider's records, no flight record can be read or holds a usable row, the declination
        is not known, or `out` may not be replaced or cannot be written. A file that cannot be read beside others that
        can is no error: the summary names it.
    """
    sources, out = [Path(source) for source in sources], Path(out)
    check_place(out, sources, lambda path: is_binary(path) or is_decoded(path), overwrite=overwrite)
    mission = read_mission(find_files(sources, out), cache)
    _check_mission(mission, sources[0])
    rows = mission.flight
    heading, heading_note = true_heading(rows, declination)
    ballast = _ballast_sensor(rows)
    variables = _converted(rows, heading, ballast, battery_scale, battery_zero)
    fixes = find_fixes(rows)
    spans = _number_profiles(rows, variables)
    lost = _lost_profiles(mission, spans)
    spans = {number: span for number, span in spans.items() if number not in lost}
    variables["profile"][np.isin(variables["profile"], list(lost))] = 0
    for begin, end in mission.set_back:
        fixes = fixes.where((fixes.time < begin) | (fixes.time > end))
    interval = median_interval(rows.time, list(spans.values()))
    variables |= _ctd(mission.science, rows.time, interval)
    variables |= {"fix_time": fixes.time, "fix_latitude": fixes.latitude, "fix_longitude": fixes.longitude}
    notes = {
        "heading_comment": heading_note,
        "battery_position_comment": f"battery_position = {battery_scale:g} * (m_battpos - {battery_zero:g} m), "
        "m_battpos converted to m from the unit that the file declares",
        "battery_rotation_comment": "zero: this vehicle does not turn its battery about x",
        "ballast_volume_comment": f"{ballast} in cm3",
        "rudder_comment": _say_rudder("rudder" in variables),
    }
    rejected = {path.name: reason for path, reason in mission.rejected.items()}
    rejected |= {f"profile {number}": reason for number, reason in lost.items()}
    attributes: dict[str, Attribute] = {
        "platform": "slocum",
        "platform_id": _vehicle(mission),
        "mission": _label(mission),
        "source": f"Teledyne Slocum records: {len(mission.parts)} flight records, {_label(mission)}",
        "battery_position_scale": battery_scale,
        "battery_position_zero": battery_zero,
        **notes,
        **_say_processing("practical_salinity" in variables),
        "files_rejected": say_reasons(rejected),
        "junk_dropped": say_reasons(mission.dropped),
    }
    write_observations(variables, out, attributes=attributes, overwrite=overwrite)
    return ImportSummary(
        path=out,
        vehicle=_vehicle(mission),
        mission=_label(mission),
        pieces="segments",
        profiles=tuple(
            imported_profile(number, _parts(mission, start, stop), start, stop, variables)
            for number, (start, stop) in spans.items()
        ),
        without_profile={},
        rejected=rejected,
        remarks=(*notes.values(), *_say_files(mission)),
        sample_interval=interval,
        fixes=len(fixes.time),
        fixes_dropped=fixes.outliers,
        rows=len(rows),
        ctd_samples=ctd_samples(variables),
        rows_dropped=mission.dropped,
    )


def _check_mission(mission: Mission, source: Path) -> None:
    if len(mission.vehicles) > 1:
        first, second = mission.vehicles[:2]
        raise InputError(f"the sources hold records of {first} and of {second}; import one glider at a time")
    if len(mission.flight) == 0:
        raise InputError(f"{source}: not one usable flight record ({say_reasons(mission.dropped)})")


def _ballast_sensor(rows: Rows) -> str:
    """Name of the sensor of the buoyancy engine: the shallow or the deep one, whichever moves.

    Raises
    ------
    InputError
        Neither was recorded.
    """
    recorded = [name for name in BALLAST_SENSORS if np.isfinite(rows[name]).any()]
    if not recorded:
        raise InputError(
            f"{' and '.join(BALLAST_SENSORS)} are not there or hold no value; without the ballast the flight cannot be "
            "modelled: give records that have one of them"
        )
    return max(recorded, key=lambda name: float(np.nanmax(rows[name]) - np.nanmin(rows[name])))


def _converted(rows: Rows, heading: FloatArray, ballast: str, battery_scale: float, battery_zero: float) -> Columns:
    """Attitude, depth and controls in the units and signs of the observation format."""
    variables: Columns = {
        "time": rows.time,
        "depth": rows["m_depth"],
        "roll": rows["m_roll"],
        "pitch": rows["m_pitch"],
        "heading": heading,
        "battery_position": battery_scale * (rows["m_battpos"] - battery_zero),
        "battery_rotation": np.zeros(len(rows)),
        "ballast_volume": rows[ballast],
    }
    if np.isfinite(rows["m_fin"]).any():
        variables["rudder"] = rows["m_fin"]
    return variables


def _number_profiles(rows: Rows, variables: Columns) -> dict[int, tuple[int, int]]:
    """Add the variable `profile`; where each profile lies."""
    seconds = (rows.time - rows.time[0]) / _SECOND
    numbers = detect_profiles(
        seconds,
        rows["m_depth"],
        surface_level=surface_level(rows),
        minimum_surface_time=MINIMUM_SURFACE_TIME,
        record_break=RECORD_BREAK,
    )
    variables["profile"] = numbers
    return profile_spans(numbers)[0]


def _lost_profiles(mission: Mission, spans: dict[int, tuple[int, int]]) -> dict[int, str]:
    """Profiles with samples at times that two clocks gave, and why they are left out."""
    lost: dict[int, str] = {}
    time = mission.flight.time
    for begin, end in mission.set_back:
        for number, (start, stop) in spans.items():
            if time[start] <= end and time[stop - 1] >= begin:
                lost[number] = (
                    f"the clock was set back by {(end - begin) / _SECOND:.0f} s at {end.astype('datetime64[s]')}: rows "
                    "from before and after it cannot be separated"
                )
    return lost


def _ctd(rows: Rows, time: TimeArray, interval: float) -> Columns:
    """CTD samples on the nearest flight record within half a sampling interval."""
    if len(rows) == 0 or not np.isfinite(interval):
        return {}
    temperature, pressure, conductivity = (rows[f"sci_water_{name}"] for name in ("temp", "pressure", "cond"))
    sampled = {
        "temperature": temperature,
        "pressure": pressure,
        "practical_salinity": np.asarray(gsw.SP_from_C(conductivity, temperature, pressure), dtype=np.float64),
    }
    reach = np.timedelta64(round(0.5e9 * interval), "ns")
    return {
        name: onto_nearest(time, rows.time, values, reach)
        for name, values in sampled.items()
        if np.isfinite(values).any()
    }


def _parts(mission: Mission, start: int, stop: int) -> tuple[str, ...]:
    return tuple(mission.parts[part] for part in np.unique(mission.flight.part[start:stop]))


def _vehicle(mission: Mission) -> str:
    return next(iter(mission.vehicles), "")


def _label(mission: Mission) -> str:
    """Name of the mission: its first and its last part."""
    return " to ".join(dict.fromkeys((mission.parts[0], mission.parts[-1])))


def _say_files(mission: Mission) -> tuple[str, ...]:
    count = f"{len(mission.parts)} flight records"
    return (count, *(f"{path}: ends before its closing mark; what is before the cut is imported" for path in
                     mission.cut_short))  # fmt: skip


def _say_rudder(recorded: bool) -> str:
    if recorded:
        return "m_fin, positive where it turns the vehicle to starboard"
    return "none: m_fin is not in the records, so the rudder counts as amidships"


def _say_processing(salinity: bool) -> dict[str, str]:
    return {
        "profile_comment": f"from {SURFACE_MARGIN:g} m below the depth that the sensor read at the nearest surfacing's "
        f"fixes to there; a visit to the surface of less than {MINIMUM_SURFACE_TIME:g} s does not end a profile, "
        f"a pause of the record of more than {RECORD_BREAK:g} s does",
        "measurement_comment": "depth and attitude of a cycle that lasted more than "
        f"{HANGING_CYCLE:g} times the median are left out",
        "fix_comment": "records with a new position that the receiver calls valid; those that no drift below "
        f"{MAXIMUM_DRIFT:g} m/s leads to are left out",
        "ctd_comment": "on the nearest flight record within half a sampling interval; "
        + ("practical salinity by PSS-78 from conductivity (gsw)" if salinity else "no conductivity, so no salinity"),
    }
