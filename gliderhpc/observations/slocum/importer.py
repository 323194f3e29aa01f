"""Import of Slocum records: fixes and surface level found, observation file and summary out.

The pressure sensor of a Slocum drifts and is not zeroed at the surface: on the same mission it reads anything from 0 to
4 m while positions come in. A position is the proof of a surfacing; the depth then read is the level that dives are
counted from.
"""

from collections.abc import Sequence
from pathlib import Path

import gsw
import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, SAME_SURFACING, Fixes, drop_outliers
from gliderhpc.observations.imported import (
    ImportSummary,
    check_place,
    describe_reasons,
    median_interval,
    write_import,
)
from gliderhpc.observations.profiles import SURFACE_MARGIN, detect_profiles
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import Columns, Rows, onto_nearest
from gliderhpc.observations.slocum.files import find_files, is_binary, is_decoded
from gliderhpc.observations.slocum.reading import HANGING_CYCLE, Mission, read_mission
from gliderhpc.observations.slocum.sensors import BALLAST_SENSORS
from gliderhpc.observations.validation import profile_spans
from gliderhpc.observations.writer import Attribute

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
        Folder of the cache files of the binary files; by default next to them, or in their folder's ``cac``.
    declination : float, optional
        Magnetic declination (degree, east positive); by default what the glider's GPS receiver reports.
    battery_scale : float
        Battery travel over the travel that the vehicle reports, metre a metre.
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
        is not known, or `out` may not be replaced or cannot be written. A file that cannot be read among others that
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
    notes = {
        "heading_comment": heading_note,
        "battery_position_comment": f"battery_position = {battery_scale:g} * (m_battpos - {battery_zero:g} m), "
        "m_battpos converted to m from the unit that the file declares",
        "battery_rotation_comment": "zero: this vehicle does not turn its battery about x",
        "ballast_volume_comment": f"{ballast} in cm3",
        "rudder_comment": _describe_rudder("rudder" in variables),
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
        **_describe_processing("practical_salinity" in variables),
        "files_rejected": describe_reasons(rejected),
        "junk_dropped": describe_reasons(mission.dropped),
    }
    return write_import(
        out, variables, fixes, attributes,
        overwrite=overwrite, vehicle=_vehicle(mission), mission=_label(mission), pieces="segments",
        spans=spans, parts={number: _parts(mission, *span) for number, span in spans.items()},
        sample_interval=interval, without_profile={}, rejected=rejected,
        remarks=(*notes.values(), *_describe_files(mission)), rows_dropped=mission.dropped,
    )  # fmt: skip


def _check_mission(mission: Mission, source: Path) -> None:
    if len(mission.vehicles) > 1:
        first, second = mission.vehicles[:2]
        raise InputError(f"the sources hold records of {first} and of {second}; import one glider at a time")
    if len(mission.flight) == 0:
        raise InputError(f"{source}: not one usable flight record ({describe_reasons(mission.dropped)})")


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


def _describe_files(mission: Mission) -> tuple[str, ...]:
    count = f"{len(mission.parts)} flight records"
    return (count, *(f"{path}: ends before its closing mark; what is before the cut is imported" for path in
                     mission.cut_short))  # fmt: skip


def _describe_rudder(recorded: bool) -> str:
    if recorded:
        return "m_fin, positive where it turns the vehicle to starboard"
    return "none: m_fin is not in the records, so the rudder counts as amidships"


def _describe_processing(salinity: bool) -> dict[str, str]:
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


def find_fixes(rows: Rows) -> Fixes:
    """Find the GPS fixes of a mission: rows with a new position that the receiver calls valid (``m_gps_status`` 0)."""
    found = _has_fix(rows)
    return drop_outliers(Fixes(rows.time[found], rows["m_gps_lat"][found], rows["m_gps_lon"][found]))


def surface_level(rows: Rows) -> FloatArray | None:
    """Depth that the sensor reads afloat (m), ``(n,)``: its median over the fixes of the nearest surfacing.

    None where there is no fix with a depth.
    """
    at = np.flatnonzero(_has_fix(rows) & np.isfinite(rows["m_depth"]))
    if len(at) == 0:
        return None
    groups = np.split(at, np.flatnonzero(np.diff(rows.time[at]) > SAME_SURFACING) + 1)
    levels = np.array([np.median(rows["m_depth"][group]) for group in groups])
    first = np.array([rows.time[group[0]] for group in groups])
    last = np.array([rows.time[group[-1]] for group in groups])
    halfway = last[:-1] + (first[1:] - last[:-1]) / 2
    return np.asarray(levels[np.searchsorted(halfway, rows.time)])


def true_heading(rows: Rows, declination: float | None) -> tuple[FloatArray, str]:
    """Heading from true north (degree), ``(n,)``, and what was done to the magnetic one.

    ``m_gps_mag_var`` is the magnetic heading less the true one, positive where the declination is west.

    Parameters
    ----------
    rows : Rows
        Rows of the flight computer.
    declination : float or None
        Declination (degree, east positive) instead of what the receiver reports.

    Raises
    ------
    InputError
        No declination is given, and none was reported.
    """
    if declination is not None:
        note = f"magnetic heading (m_heading) plus the declination that was given, {declination:g} degree"
        return np.mod(rows["m_heading"] + declination, 360.0), note
    variation = rows["m_gps_mag_var"]
    reported = np.isfinite(variation)
    if not reported.any():
        raise InputError(
            "m_gps_mag_var is not there, so the magnetic heading cannot be turned to true north; give the declination "
            "with --declination (degree, east positive; 0 leaves the heading as it is)"
        )
    seconds = (rows.time - rows.time[0]) / np.timedelta64(1, "s")
    east = -np.interp(seconds, seconds[reported], variation[reported])
    note = (
        "magnetic heading (m_heading) less m_gps_mag_var, interpolated between surfacings: a declination of "
        f"{east.min():.2f} to {east.max():.2f} degree east"
    )
    return np.mod(rows["m_heading"] + east, 360.0), note


def _has_fix(rows: Rows) -> npt.NDArray[np.bool_]:
    # A state that is not recorded (NaN) is not held against a position.
    return np.isfinite(rows["m_gps_lat"]) & np.isfinite(rows["m_gps_lon"]) & ~(rows["m_gps_status"] > 0.0)
