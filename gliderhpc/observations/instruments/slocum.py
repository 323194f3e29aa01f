"""Import of Teledyne Slocum records (``*.dbd`` and ``*.ebd``, or netCDF of native sensors) into the observation format.

The pressure sensor of a Slocum drifts and is not zeroed at the surface: on the same mission it reads between 0 and 4 m
while positions are received. A position proves a surfacing, and the depth reading at that time is the level from which
dives are measured.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import gsw
import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import check_heading_unit
from gliderhpc.observations.checks.validation import Span, profile_spans
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, SAME_SURFACING, Fixes, drop_outliers
from gliderhpc.observations.importing.rows import Columns, Rows
from gliderhpc.observations.importing.workflow import (
    CtdSamples,
    ImportSummary,
    MissionRecords,
    describe_reasons,
    import_mission,
)
from gliderhpc.observations.instruments.slocum_files import BALLAST_SENSORS, find_files, is_binary, is_decoded
from gliderhpc.observations.instruments.slocum_records import HANGING_CYCLE, Mission, read_mission
from gliderhpc.observations.nearest import onto_nearest
from gliderhpc.observations.profiles import SURFACE_MARGIN, detect_profiles
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.surface_intervals import MAX_GPS_DEPTH
from gliderhpc.observations.times import SECOND
from gliderhpc.wording import counted

RECORD_BREAK = 900.0
"""Longest pause of the record within a profile (s); a longer one is due to a missing file and splits the profile."""

MIN_SURFACE_TIME = 180.0
"""Minimum duration of a surfacing (s): filling the air bladder and calling take minutes. A shorter visit to the surface
is the turning point of a yo."""

MIN_SEA_CONDUCTIVITY = 0.5
"""Conductivity (mS/cm) that the sea exceeds, but neither a wet sensor in the air nor most lakes."""


def import_slocum(
    sources: Sequence[Path],
    out: Path,
    *,
    cache: Path | None = None,
    declination: float | None = None,
    battery_scale: float = 1.0,
    battery_zero: float = 0.0,
    overwrite: bool = False,
    reads: Reads = read_directly,
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
        Folder of the cache files; by default the folder of the binary files, or its folders ``cac`` and ``cache``.
    declination : float, optional
        Magnetic declination (degree, east positive); by default the one reported by the glider's GPS receiver.
    battery_scale : float
        Ratio of the battery travel to the travel reported by the vehicle (m/m).
    battery_zero : float
        Reported position at which ``battery_position`` is zero (m).
    overwrite : bool
        Replace an existing file.
    reads : Reads
        Function that reads each file; by default every file is read directly.

    Returns
    -------
    ImportSummary
        Profiles, fixes, remarks on the processing, and omitted files and profiles.

    Raises
    ------
    InputError
        The sources are not one glider's records, no flight record can be read or holds a usable row, the declination
        is unknown, or `out` may not be replaced or cannot be written. An unreadable file among readable ones is not an
        error; the summary names it.
    """
    read = partial(
        _read_records,
        out=Path(out),
        cache=cache,
        declination=declination,
        battery=(battery_scale, battery_zero),
        reads=reads,
    )
    return import_mission(read, _is_record, sources, out, overwrite=overwrite)


def _is_record(path: Path) -> bool:
    return is_binary(path) or is_decoded(path)


def _read_records(
    sources: Sequence[Path],
    out: Path,
    cache: Path | None,
    declination: float | None,
    battery: tuple[float, float],
    reads: Reads,
) -> MissionRecords:
    """Read a mission's files, and convert the sensors of the flight computer to variables of the observation format."""
    mission = read_mission(find_files(sources, out), cache, reads)
    _check_mission(mission, sources[0])
    rows = mission.flight
    heading, heading_note = true_heading(rows, declination)
    ballast = _ballast_sensor(rows)
    variables = _converted(rows, heading, ballast, *battery)
    profile = _profile_numbers(rows)
    spans, _ = profile_spans(profile)
    lost = _lost_profiles(mission, spans)
    spans = {number: span for number, span in spans.items() if number not in lost}
    variables["profile"] = np.where(np.isin(profile, list(lost)), 0, profile)
    comments = {"heading_comment": heading_note, **_describe_controls(ballast, *battery, rudder="rudder" in variables)}
    rejected = {path.name: reason for path, reason in mission.rejected.items()}
    count = counted(len(mission.parts), "flight record")
    fixes = _fixes_by_one_clock(mission)
    doubt = check_heading_unit(rows["m_heading"], spans, str(sources[0]), "m_heading")
    return MissionRecords(
        platform="slocum",
        vehicle=next(iter(mission.vehicles), ""),
        mission=_label(mission),
        source=f"Teledyne Slocum records: {count}, {_label(mission)}",
        pieces="segments",
        variables=variables,
        spans=spans,
        parts={number: _parts(mission, *span) for number, span in spans.items()},
        fixes=fixes,
        comments={
            "battery_position_scale": battery[0],
            "battery_position_zero": battery[1],
            **comments,
            **_PROCESSING,
        },
        rejected=rejected | {f"profile {number}": reason for number, reason in lost.items()},
        rows_dropped=Counter(mission.dropped),
        dropped_attribute="junk_dropped",
        remarks=(
            *([doubt] if doubt else []),
            *_remarks(comments),
            *_describe_fixes(rows, fixes),
            count,
            *_describe_cuts(mission),
        ),
        water=partial(_read_water, mission.science),
    )


def _remarks(comments: Mapping[str, str]) -> tuple[str, ...]:
    """Comments on variables as sentences: the name of the variable, and its origin."""
    names = {comment: key.removesuffix("_comment") for key, comment in comments.items()}
    return tuple(text if text.startswith(name) else f"{name} is {text}" for text, name in names.items())


def _check_mission(mission: Mission, source: Path) -> None:
    if len(mission.vehicles) > 1:
        first, second = mission.vehicles[:2]
        raise InputError(f"the sources contain records of {first} and of {second}; import one glider at a time")
    if len(mission.flight) == 0:
        reasons = describe_reasons(mission.dropped) if mission.dropped else "it has no rows"
        raise InputError(f"{source}: no usable flight record ({reasons})")


def _ballast_sensor(rows: Rows) -> str:
    """Name of the buoyancy engine's sensor: of the shallow and the deep one, the sensor with the larger range.

    Raises
    ------
    InputError
        Neither sensor was recorded.
    """
    recorded = [name for name in BALLAST_SENSORS if np.isfinite(rows[name]).any()]
    if not recorded:
        raise InputError(
            f"{' and '.join(BALLAST_SENSORS)} are missing or have no values; without the ballast the flight cannot be "
            "modelled: give records that contain one of them"
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


def _profile_numbers(rows: Rows) -> npt.NDArray[np.int64]:
    """Profile number of every row, 0 outside any profile."""
    return detect_profiles(
        (rows.time - rows.time[0]) / SECOND,
        rows["m_depth"],
        surface_level=surface_level(rows),
        minimum_surface_time=MIN_SURFACE_TIME,
        record_break=RECORD_BREAK,
    )


def _lost_profiles(mission: Mission, spans: Mapping[int, Span]) -> dict[int, str]:
    """Profiles with samples at times by two clocks, with the reason why they are left out."""
    lost: dict[int, str] = {}
    time = mission.flight.time
    for begin, end in mission.set_back:
        for number, (start, stop) in spans.items():
            if time[start] <= end and time[stop - 1] >= begin:
                lost[number] = (
                    f"the clock was set back by {(end - begin) / SECOND:.0f} s at {end.astype('datetime64[s]')}: rows "
                    "from before and after it cannot be separated"
                )
    return lost


def _fixes_by_one_clock(mission: Mission) -> Fixes:
    """Find the fixes of a mission, except those at times by two clocks."""
    fixes = find_fixes(mission.flight)
    for begin, end in mission.set_back:
        fixes = fixes.where((fixes.time < begin) | (fixes.time > end))
    return fixes


def _describe_fixes(rows: Rows, fixes: Fixes) -> tuple[str, ...]:
    """Remark on a mission without a GPS fix; none if it has one."""
    if len(fixes.time):
        return ()
    has_position = np.isfinite(rows["m_gps_lat"] + rows["m_gps_lon"]).any()
    found = "no valid position at the surface" if has_position else "no position"
    return (
        f"m_gps_lat and m_gps_lon are missing or have {found}, so there are no GPS fixes and no currents, and "
        "surfacings are found from depth alone; decode the mission again, with these sensors",
    )


def _read_water(rows: Rows, time: TimeArray, depth: FloatArray, interval: float) -> CtdSamples:
    """Put CTD samples on the nearest flight record within half a sampling interval."""
    variables: Columns = {}
    if len(rows) and np.isfinite(interval):
        temperature, pressure = rows["sci_water_temp"], rows["sci_water_pressure"]
        conductivity = _without_air(rows["sci_water_cond"])
        sampled = {
            "temperature": temperature,
            "pressure": pressure,
            "practical_salinity": np.asarray(gsw.SP_from_C(conductivity, temperature, pressure), dtype=np.float64),
        }
        reach = np.timedelta64(round(0.5e9 * interval), "ns")
        variables = {
            name: onto_nearest(time, rows.time, values, reach)
            for name, values in sampled.items()
            if np.isfinite(values).any()
        }
    salinity = (
        "practical salinity by PSS-78 from conductivity (gsw)"
        if "practical_salinity" in variables
        else "no usable conductivity, so no salinity"
    )
    return CtdSamples(variables, f"on the nearest flight record within half a sampling interval; {salinity}")


def _without_air(conductivity: FloatArray) -> FloatArray:
    """Conductivity (mS/cm) without that of a wet sensor in the air, unless the water is a lake's throughout."""
    in_water = conductivity >= MIN_SEA_CONDUCTIVITY
    return np.where(in_water, conductivity, np.nan) if in_water.any() else conductivity


def _parts(mission: Mission, start: int, stop: int) -> tuple[str, ...]:
    return tuple(mission.parts[part] for part in np.unique(mission.flight.part[start:stop]))


def _label(mission: Mission) -> str:
    """Name of the mission: its first and last parts."""
    return " to ".join(dict.fromkeys((mission.parts[0], mission.parts[-1])))


def _describe_cuts(mission: Mission) -> tuple[str, ...]:
    return tuple(
        f"{path}: ends before its closing mark; the complete records before the cut are imported"
        for path in mission.cut_short
    )


def _describe_controls(ballast: str, scale: float, zero: float, *, rudder: bool) -> dict[str, str]:
    return {
        "battery_position_comment": f"battery_position = {scale:g} * (m_battpos - {zero:g} m), "
        "m_battpos converted to m from the unit that the file declares",
        "battery_rotation_comment": "zero: this vehicle does not turn its battery about x",
        "ballast_volume_comment": f"{ballast} in cm3",
        "rudder_comment": "m_fin, positive where it turns the vehicle to starboard"
        if rudder
        else "none: m_fin is not in the records, so the rudder is taken as amidships",
    }


_PROCESSING = {
    "profile_comment": f"begins and ends {SURFACE_MARGIN:g} m below the depth that the sensor read at the fixes of the "
    f"nearest surfacing; a surfacing shorter than {MIN_SURFACE_TIME:g} s does not end a profile, "
    f"a pause of the record longer than {RECORD_BREAK:g} s does",
    "measurement_comment": "depth and attitude of a cycle that lasted more than "
    f"{HANGING_CYCLE:g} times the median are left out",
    "fix_comment": "records with a new position that the receiver reports as valid, not deeper than "
    f"{MAX_GPS_DEPTH:g} m; those that no drift below {MAXIMUM_DRIFT:g} m/s connects with a neighbour are left out",
}
"""Attributes on profiles, measurements and fixes."""


def find_fixes(rows: Rows) -> Fixes:
    """Find the GPS fixes of a mission: rows with a new position that the receiver reports as valid.

    Positions are valid if ``m_gps_status`` is 0 or not recorded, and the glider is not deeper than `MAX_GPS_DEPTH`:
    some files repeat the last position under water, or interpolate between two.
    """
    found = _has_fix(rows)
    fixes = drop_outliers(Fixes(rows.time[found], rows["m_gps_lat"][found], rows["m_gps_lon"][found]))
    return fixes.where(_is_new(fixes.latitude, fixes.longitude))


def surface_level(rows: Rows) -> FloatArray | None:
    """Depth reading of the sensor at the surface (m), ``(n,)``: its median over the fixes of the nearest surfacing.

    It is None if there is no fix with a depth.
    """
    at = np.flatnonzero(_has_fix(rows) & np.isfinite(rows["m_depth"]))
    at = at[_is_new(rows["m_gps_lat"][at], rows["m_gps_lon"][at])]
    if len(at) == 0:
        return None
    groups = np.split(at, np.flatnonzero(np.diff(rows.time[at]) > SAME_SURFACING) + 1)
    levels = np.array([np.median(rows["m_depth"][group]) for group in groups])
    first = np.array([rows.time[group[0]] for group in groups])
    last = np.array([rows.time[group[-1]] for group in groups])
    halfway = last[:-1] + (first[1:] - last[:-1]) / 2
    return np.asarray(levels[np.searchsorted(halfway, rows.time)])


def true_heading(rows: Rows, declination: float | None) -> tuple[FloatArray, str]:
    """Heading from true north (degree), ``(n,)``, and a description of the correction of the magnetic heading.

    ``m_gps_mag_var`` is the magnetic heading less the true heading; it is positive if the declination is west.

    Parameters
    ----------
    rows : Rows
        Rows of the flight computer.
    declination : float or None
        Declination (degree, east positive) instead of the reported one.

    Raises
    ------
    InputError
        No declination is given, and the receiver reported none.
    """
    if declination is not None:
        note = f"magnetic heading (m_heading) plus the given declination, {declination:g} degree"
        return np.mod(rows["m_heading"] + declination, 360.0), note
    variation = rows["m_gps_mag_var"]
    reported = np.isfinite(variation)
    if not reported.any():
        raise InputError(
            "m_gps_mag_var is missing, so the magnetic heading cannot be referred to true north; give the declination "
            "with `declination` (degree, east positive; 0 leaves the heading as it is)"
        )
    seconds = (rows.time - rows.time[0]) / SECOND
    east = -np.interp(seconds, seconds[reported], variation[reported])
    note = (
        "magnetic heading (m_heading) less m_gps_mag_var, interpolated between surfacings: a declination of "
        f"{east.min():.2f} to {east.max():.2f} degree east"
    )
    return np.mod(rows["m_heading"] + east, 360.0), note


def _has_fix(rows: Rows) -> npt.NDArray[np.bool_]:
    """Mask of the rows with a valid position at a depth at which it can be received."""
    depth = rows["m_depth"]
    # A position without a recorded state (NaN) is accepted.
    valid = np.isfinite(rows["m_gps_lat"]) & np.isfinite(rows["m_gps_lon"]) & ~(rows["m_gps_status"] > 0.0)
    known = np.flatnonzero(np.isfinite(depth))
    if not len(known):
        return valid
    return np.asarray(valid & (np.interp(np.arange(len(depth)), known, depth[known]) <= MAX_GPS_DEPTH))


def _is_new(latitude: FloatArray, longitude: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the positions that differ from the one before."""
    new = np.ones(len(latitude), np.bool_)
    new[1:] = (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)
    return new
