"""Import of SeaExplorer text files (``*.gli.sub.*``, ``*.pld1.raw.*``, ``*.pld1.sub.*``) into the observation format.

The vehicle begins a new file (cycle) on every ascent at a set depth, about 10 m, so the end of each climb is at the
beginning of the next file. A file does not always contain a surfacing, because the glider may yo below the surface. A
profile takes the number of the file in which it left the surface.

Every row contains a position; below the surface it is that of the last fix. A fix is a row of the transmitting state
whose position differs from that of the preceding row. This excludes the stale positions at the beginning of a surface
interval and between two fixes. While a satellite call blocks the logger, the row due before the call gets its time at
the beginning of the call, and its position at the end of the call. On missions 10 and 12 of SEA035 the position of such
a row lies 0.9 to 1.0 of the way to the next one, independent of the length of the call. The row is therefore given the
time of the next row.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import check_heading_unit
from gliderhpc.observations.checks.sign_checks import refuse_negative_depth
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, Fixes, decimal_degrees, drop_outliers
from gliderhpc.observations.importing.dive_files import number_samples
from gliderhpc.observations.importing.position_form import NEAR_ZERO, are_not_minutes, may_be_decimal
from gliderhpc.observations.importing.rows import Columns, Rows
from gliderhpc.observations.importing.workflow import ImportSummary, MissionRecords, describe_reasons, import_mission
from gliderhpc.observations.instruments.seaexplorer_ctd import read_water
from gliderhpc.observations.instruments.seaexplorer_files import (
    SeaExplorerFiles,
    find_files,
    is_seaexplorer_file,
    read_rows,
)
from gliderhpc.observations.instruments.seaexplorer_legs import TRANSMITTING, find_legs
from gliderhpc.observations.records import TimeArray

_NAVIGATION = {
    "NavState": (0.0, 1000.0),
    "Heading": (-1e-9, 360.0 + 1e-9),
    "Declination": (-180.0, 180.0),
    "Pitch": (-90.0, 90.0),
    "Roll": (-180.0 - 1e-9, 180.0 + 1e-9),
    "Depth": (-10.0, 2000.0),
    "Lat": (-9000.1, 9000.1),
    "Lon": (-18000.1, 18000.1),
    "BallastPos": (-2000.0, 2000.0),
    "LinPos": (-1000.0, 1000.0),
    "AngPos": (-180.0, 180.0),
}
"""Columns of a navigation file and the open ranges of their plausible values."""


def import_seaexplorer(
    sources: Sequence[Path],
    out: Path,
    *,
    linear_scale: float = 0.5e-3,
    linear_zero: float = 60.0,
    include_surfacing: bool = False,
    declination: float | None = None,
    overwrite: bool = False,
    reads: Reads = read_directly,
) -> ImportSummary:
    """Turn a SeaExplorer mission's text files into an observation file.

    Parameters
    ----------
    sources : sequence of Path
        ``*.gli.sub.*`` files with ``*.pld1.raw.*`` (delayed mode) or ``*.pld1.sub.*`` (real time), plain or gzipped,
        or folders of them, of one mission.
    out : Path
        The netCDF file to write.
    linear_scale : float
        Battery travel per unit of ``LinPos`` (m). The manufacturer does not document the unit.
    linear_zero : float
        ``LinPos`` at which ``battery_position`` is zero.
    include_surfacing : bool
        Treat the surfacing manoeuvre (``NavState`` 115) as part of a profile.
    declination : float, optional
        Declination (degree, east positive) to add to the magnetic heading, instead of the one in the files.
    overwrite : bool
        Replace an existing file.
    reads : Reads
        Function that reads each file; by default every file is read directly.

    Returns
    -------
    ImportSummary
        Profiles, fixes and dropped data, with remarks on cycles without CTD data.

    Raises
    ------
    InputError
        The sources are not the records of one mission or contain no usable row, or `out` may not be replaced or cannot
        be written.
    """
    read = partial(
        _read_mission,
        battery=(linear_scale, linear_zero),
        include_surfacing=include_surfacing,
        declination=declination,
        reads=reads,
    )
    return import_mission(read, is_seaexplorer_file, sources, out, overwrite=overwrite)


def _read_mission(
    sources: Sequence[Path],
    battery: tuple[float, float],
    include_surfacing: bool,
    declination: float | None,
    reads: Reads,
) -> MissionRecords:
    """Read the navigation of every readable cycle; the payload is read later, when the profiles are known."""
    files = find_files(sources)
    # Without the declination in the rows, as in some exports, a given one is enough.
    needed = {name: limits for name, limits in _NAVIGATION.items() if declination is None or name != "Declination"}
    found = read_rows(files.navigation, "Timestamp", needed, with_steps=True, reads=reads)
    rows, dropped, unreadable = found.rows, found.dropped, found.rejected
    legs, without = find_legs(rows, include_surfacing=include_surfacing)
    if not legs:
        _check_depth_sign(files, sources[0], reads)
    if len(rows) == 0:
        nothing = f"{sources[0]}: no usable navigation row ({describe_reasons(dropped)})"
        raise InputError(next(iter(unreadable.values()), nothing))
    spans = {leg.number: (leg.start, leg.stop) for leg in legs}
    heading_note, heading_remarks = _describe_heading(rows, declination)
    doubts = [
        _check_positions(rows, sources[0]),
        check_heading_unit(rows["Heading"], spans, str(sources[0]), "Heading"),
    ]
    cycles = list(files.navigation)
    return MissionRecords(
        platform="seaexplorer",
        vehicle=files.vehicle,
        mission=f"{files.vehicle}-M{files.mission}",
        source=f"ALSEAMAR SeaExplorer gli and pld1 text files, cycles {cycles[0]}-{cycles[-1]}",
        pieces="cycles",
        variables=convert(rows, *battery, declination) | {"profile": number_samples(spans, len(rows))},
        spans=spans,
        parts={leg.number: leg.cycles for leg in legs},
        fixes=find_fixes(rows),
        comments=_describe_processing(*battery, include_surfacing, heading_note),
        rejected={f"cycle {cycle}": why for cycle, why in unreadable.items()},
        without_profile={f"cycle {cycle}": why for cycle, why in without.items() if cycle not in spans},
        rows_dropped=dropped,
        rejected_attribute="cycles_rejected",
        remarks=(
            *filter(None, doubts),
            *heading_remarks,
            *(f"cycle {cycle}: {why}" for cycle, why in without.items() if cycle in spans),
        ),
        clock_steps=found.steps,
        water=partial(read_water, files, dropped, reads=reads),
    )


def _check_depth_sign(files: SeaExplorerFiles, source: Path, reads: Reads) -> None:
    """Refuse depths that are negative under water; read again, since their rows are dropped as out of range.

    Raises
    ------
    InputError
        The depths are positive up.
    """
    any_sign = {"Depth": (-_NAVIGATION["Depth"][1], _NAVIGATION["Depth"][1])}
    rows = read_rows(files.navigation, "Timestamp", any_sign, reads=reads).rows
    refuse_negative_depth(rows["Depth"], str(source), "Depth")


def _check_positions(rows: Rows, source: Path) -> str | None:
    """Refuse positions in decimal degrees; return a remark if they may be in decimal degrees, None if they are not.

    Raises
    ------
    InputError
        The positions are not DDMM.mmm; the message gives the remedy.
    """
    if not may_be_decimal(rows["Lat"], rows["Lon"]):
        return None
    found = f"Lat and Lon, read as DDMM.mmm, lie {NEAR_ZERO}"
    if are_not_minutes(rows["Lat"], rows["Lon"]):
        raise InputError(f"{source}: {found}, so they are decimal degrees; write them as DDMM.mmm")
    return f"{found}: if they are decimal degrees, write them as DDMM.mmm"


def _describe_heading(rows: Rows, declination: float | None) -> tuple[str, tuple[str, ...]]:
    """Describe the correction of the magnetic heading; also return remarks on it."""
    if declination is not None:
        return f"magnetic heading plus the given declination, {declination:g} degree", ()
    known = rows["Declination"][np.isfinite(rows["Declination"])]
    if len(known) and not known.any():
        left = "Declination is 0 in every row"
        return f"magnetic heading: {left}, so none is added", (
            f"{left}, so the heading is left magnetic: give `declination`, or the currents will be rotated by it",
        )
    return "magnetic heading plus the declination in the same row of the file", ()


def convert(rows: Rows, linear_scale: float, linear_zero: float, declination: float | None = None) -> Columns:
    """Attitude, depth and controls in the units and signs of the observation format.

    A positive ``AngPos`` corresponds to starboard down (0.4 degree of roll per degree on SEA035, correlation 0.9),
    which is the sign of the model's gamma. ``LinPos`` increases forward.

    Parameters
    ----------
    rows : Rows
        Navigation rows.
    linear_scale : float
        Battery travel per unit of ``LinPos`` (m).
    linear_zero : float
        ``LinPos`` at which the battery is at its nominal position.
    declination : float, optional
        Declination (degree, east positive) instead of that in the rows.
    """
    east = rows["Declination"] if declination is None else declination
    return {
        "time": rows.time,
        "depth": rows["Depth"],
        "roll": rows["Roll"],
        "pitch": rows["Pitch"],
        "heading": np.mod(rows["Heading"] + east, 360.0),
        "battery_position": linear_scale * (rows["LinPos"] - linear_zero),
        "battery_rotation": rows["AngPos"],
        "ballast_volume": rows["BallastPos"],
    }


def _describe_processing(
    linear_scale: float, linear_zero: float, include_surfacing: bool, heading: str
) -> dict[str, str | float]:
    ending = "the end of the surfacing manoeuvre (NavState 115)" if include_surfacing else "the surfacing manoeuvre"
    return {
        "battery_position_scale": linear_scale,
        "battery_position_zero": linear_zero,
        "battery_position_comment": "battery_position = battery_position_scale [m] * (LinPos - battery_position_zero)",
        "battery_rotation_comment": "AngPos taken as degrees, positive with starboard down",
        "ballast_volume_comment": "BallastPos taken as cm3",
        "heading_comment": heading,
        "profile_comment": f"from the first row below the surface to {ending}; numbered by the cycle in which it "
        "begins",
        "fix_comment": "rows of NavState 116 with a new position; one logged before a pause gets the time of "
        f"its end; those that no drift below {MAXIMUM_DRIFT:g} m/s connects with a neighbouring fix are left out",
    }


LOGGING_PAUSE = np.timedelta64(30, "s")
"""Time step above which the logger was blocked; rows of the transmitting state come every 20 s."""


def find_fixes(rows: Rows) -> Fixes:
    """Find the GPS fixes of a mission.

    Parameters
    ----------
    rows : Rows
        Navigation rows in time order, with NavState, Lat and Lon (DDMM.mmm).

    Returns
    -------
    Fixes
        GPS fixes in time order.
    """
    latitude, longitude = decimal_degrees(rows["Lat"]), decimal_degrees(rows["Lon"])
    refreshed = np.zeros(len(rows), dtype=bool)
    refreshed[1:] = (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)
    refreshed &= rows["NavState"] == TRANSMITTING
    # Before its first fix the vehicle reports 0 N, 0 E.
    refreshed &= np.isfinite(latitude) & np.isfinite(longitude) & ((latitude != 0.0) | (longitude != 0.0))
    time = _time_of_position(rows.time)[refreshed]
    # The row after a pause usually has its own fix at the same time; that fix is used.
    last = np.append(time[1:] > time[:-1], True) if len(time) else np.zeros(0, dtype=bool)
    return drop_outliers(Fixes(time[last], latitude[refreshed][last], longitude[refreshed][last]))


def _time_of_position(time: TimeArray) -> TimeArray:
    taken = time.copy()
    paused = np.flatnonzero(np.diff(time) > LOGGING_PAUSE)
    taken[paused] = time[paused + 1]
    return taken
