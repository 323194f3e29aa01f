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

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.dive_files import number_samples
from gliderhpc.observations.fixes import MAXIMUM_DRIFT, Fixes, decimal_degrees, drop_outliers
from gliderhpc.observations.importing import ImportSummary, MissionRecords, describe_reasons, import_mission
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import ClockStep, Columns, Rows
from gliderhpc.observations.seaexplorer_ctd import read_water
from gliderhpc.observations.seaexplorer_files import find_files, is_seaexplorer_file, read_rows
from gliderhpc.observations.stored_reads import Reads, read_directly

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
        The sources are not the records of one mission or hold no usable row, or `out` may not be replaced or cannot
        be written.
    """
    read = partial(
        _read_mission, scale=linear_scale, zero=linear_zero, include_surfacing=include_surfacing, reads=reads
    )
    return import_mission(read, is_seaexplorer_file, sources, out, overwrite=overwrite)


def _read_mission(
    sources: Sequence[Path], scale: float, zero: float, include_surfacing: bool, reads: Reads
) -> MissionRecords:
    """Read the navigation of every readable cycle; the payload is read later, when the profiles are known."""
    files = find_files(sources)
    dropped: Counter[str] = Counter()
    unreadable: dict[int, str] = {}
    steps: list[ClockStep] = []
    rows = read_rows(files.navigation, "Timestamp", _NAVIGATION, dropped, unreadable, steps=steps, reads=reads)
    if len(rows) == 0:
        nothing = f"{sources[0]}: no usable navigation row ({describe_reasons(dropped)})"
        raise InputError(next(iter(unreadable.values()), nothing))
    legs, without = find_legs(rows, include_surfacing=include_surfacing)
    spans = {leg.number: (leg.start, leg.stop) for leg in legs}
    cycles = list(files.navigation)
    return MissionRecords(
        platform="seaexplorer",
        vehicle=files.vehicle,
        mission=f"{files.vehicle}-M{files.mission}",
        source=f"ALSEAMAR SeaExplorer gli and pld1 text files, cycles {cycles[0]}-{cycles[-1]}",
        pieces="cycles",
        variables=convert(rows, scale, zero) | {"profile": number_samples(spans, len(rows))},
        spans=spans,
        parts={leg.number: leg.cycles for leg in legs},
        fixes=find_fixes(rows),
        comments=_describe_processing(scale, zero, include_surfacing),
        rejected={f"cycle {cycle}": why for cycle, why in unreadable.items()},
        without_profile={f"cycle {cycle}": why for cycle, why in without.items()},
        rows_dropped=dropped,
        rejected_attribute="cycles_rejected",
        clock_steps=steps,
        water=partial(read_water, files, dropped, reads=reads),
    )


def convert(rows: Rows, linear_scale: float, linear_zero: float) -> Columns:
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
    """
    return {
        "time": rows.time,
        "depth": rows["Depth"],
        "roll": rows["Roll"],
        "pitch": rows["Pitch"],
        "heading": np.mod(rows["Heading"] + rows["Declination"], 360.0),
        "battery_position": linear_scale * (rows["LinPos"] - linear_zero),
        "battery_rotation": rows["AngPos"],
        "ballast_volume": rows["BallastPos"],
    }


def _describe_processing(linear_scale: float, linear_zero: float, include_surfacing: bool) -> dict[str, str | float]:
    ending = "the end of the surfacing manoeuvre (NavState 115)" if include_surfacing else "the surfacing manoeuvre"
    return {
        "battery_position_scale": linear_scale,
        "battery_position_zero": linear_zero,
        "battery_position_comment": "battery_position = battery_position_scale [m] * (LinPos - battery_position_zero)",
        "battery_rotation_comment": "AngPos taken as degrees, positive with starboard down",
        "ballast_volume_comment": "BallastPos taken as cm3",
        "heading_comment": "magnetic heading plus the declination in the same row of the file",
        "profile_comment": f"from the first row below the surface to {ending}; numbered by the cycle in which it "
        "begins",
        "fix_comment": "rows of NavState 116 with a new position; one logged before a pause gets the time of "
        f"its end; those that no drift below {MAXIMUM_DRIFT:g} m/s connects with a neighbouring fix are left out",
    }


DIVING = 100
INFLECTING_DOWN = 110
SURFACING = 115
TRANSMITTING = 116
CLIMBING = 117
INFLECTING_UP = 118

_GLIDING = (DIVING, INFLECTING_DOWN, CLIMBING, INFLECTING_UP)


def is_gliding(state: FloatArray, *, include_surfacing: bool = False) -> npt.NDArray[np.bool_]:
    """Mask of the rows in which the glider is gliding below the surface, or leaving it.

    In the surfacing manoeuvre the battery moves fully forward at about 9 m, the nose drops to -70 degrees and the
    glider rises tail first. The model of the paper does not describe this motion, so it is left out unless requested.
    """
    return np.isin(state, (*_GLIDING, SURFACING) if include_surfacing else _GLIDING)


SUBMERGED = 1.0
"""Depth below the floating level at which the hull is under water (m)."""

MIN_DIVE = 10.0
"""Depth below its beginning that a leg must reach to be a profile (m)."""

MAX_CYCLES = 20_000
"""Maximum number of cycles of a mission; a larger range of cycle numbers is due to a mistyped number."""

RECORD_BREAK = np.timedelta64(900, "s")
"""Longest pause of the record within a leg; a longer one splits the leg in two."""


@dataclass(frozen=True)
class Leg:
    """One stretch of rows below the surface.

    Attributes
    ----------
    number : int
        Number of the profile: the cycle in which it begins to dive.
    cycles : tuple of int
        Cycles of its rows, without those that hold only climbing rows.
    start, stop : int
        Its first row and the row after its last.
    """

    number: int
    cycles: tuple[int, ...]
    start: int
    stop: int


def find_legs(rows: Rows, *, include_surfacing: bool = False) -> tuple[list[Leg], dict[int, str]]:
    """Find the profiles of a mission, and the reasons why the other cycles hold none.

    Parameters
    ----------
    rows : Rows
        Navigation rows in time order, with NavState and Depth.
    include_surfacing : bool
        Treat the surfacing manoeuvre as part of the profile.

    Returns
    -------
    legs : list of Leg
        Profiles in time order.
    without : dict of int to str
        Reasons by number of the cycle in which no profile begins or continues.
    """
    legs: list[Leg] = []
    refused: dict[int, str] = {}
    for start, stop in _stretches(rows, is_gliding(rows["NavState"], include_surfacing=include_surfacing)):
        leg = _trim(rows, start, stop)
        dive = _dive(rows["Depth"][leg.start : leg.stop])
        if dive < MIN_DIVE:
            # A dive of less than a metre is a floating glider with a wrong state, or the end of the previous climb.
            if dive >= SUBMERGED and np.any(rows["NavState"][start:stop] != CLIMBING):
                refused[leg.number] = f"too shallow: dives {dive:.0f} m, but at least {MIN_DIVE:g} m are needed"
        elif legs and legs[-1].number == leg.number:
            refused[leg.number] = "dives twice between surfacings within one file: only the first dive is used"
        else:
            legs.append(leg)
    return legs, _cycles_without(rows, legs, refused)


def _stretches(rows: Rows, gliding: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Find the runs of gliding rows, broken at missing files and long pauses."""
    broken = (np.diff(rows.part) > 1) | (np.diff(rows.time) > RECORD_BREAK)
    turns = np.flatnonzero(broken | (gliding[1:] != gliding[:-1])) + 1
    edges = [0, *turns.tolist(), len(rows)]
    return [(a, b) for a, b in pairwise(edges) if b > a and gliding[a]]


def _trim(rows: Rows, start: int, stop: int) -> Leg:
    """Cut off the rows at the surface, where the glider still floats."""
    level = _floating_depth(rows, start) + SUBMERGED
    under = np.flatnonzero(rows["Depth"][start:stop] > level)
    if len(under):
        start, stop = start + int(under[0]), start + int(under[-1]) + 1
    # A file may begin with one or two climbing rows of the previous dive, which do not determine the number.
    sinking = np.flatnonzero(rows["NavState"][start:stop] != CLIMBING)
    diving = rows.part[start:stop][sinking] if len(sinking) else rows.part[start:stop]
    cycles = tuple(np.unique(diving).tolist())
    return Leg(int(diving[0]), cycles, start, stop)


def _floating_depth(rows: Rows, start: int) -> float:
    """Depth reading of the sensor in the nose at the surface (m): about 1 m if level and 3 m if tail up."""
    surface = np.flatnonzero(rows["NavState"][:start] == TRANSMITTING)[-10:]
    if len(surface) == 0:
        surface = np.flatnonzero(rows["NavState"] == TRANSMITTING)
    return float(np.median(rows["Depth"][surface])) if len(surface) else 0.0


def _dive(depth: FloatArray) -> float:
    """Greatest depth of a leg below its beginning (m)."""
    return float(np.nanmax(depth) - depth[0]) if len(depth) else 0.0


def _cycles_without(rows: Rows, legs: list[Leg], refused: dict[int, str]) -> dict[int, str]:
    taken = {cycle for leg in legs for cycle in leg.cycles}
    present = set(np.unique(rows.part).tolist())
    without: dict[int, str] = {}
    first, last = min(present, default=0), max(present, default=-1)
    # A file name with one digit too many would lead to a million missing files.
    for cycle in range(first, last + 1) if last - first < MAX_CYCLES else sorted(present):
        if cycle in refused:
            without[cycle] = refused[cycle]
        elif cycle not in present:
            without[cycle] = "its navigation file is missing"
        elif cycle not in taken:
            without[cycle] = "only a surface record"
    return without


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
