"""Profiles among the navigation rows, from leaving the surface to the next surfacing, and the fixes there.

The vehicle begins a new file (cycle) on every ascent at a set depth, about 10 m, so the end of each climb stands at the
beginning of the next file; and a file need not hold a surfacing, where the glider yos below the surface. A profile
takes the number of the file in which it left the surface.

Every row repeats a position; below the surface it is that of the last fix. A fix is a row of the transmitting state
whose position differs from that of the row before, so that the stale positions at the beginning of a surface interval,
and between two fixes, do not count. While a call by satellite blocks the logger, the row that was due before the call
gets its time at the call's beginning but its position at the call's end: on missions 10 and 12 of SEA035 the position
of such a row lies 0.9 to 1.0 of the way to the next one, however long the call. It is therefore given the time of the
next row.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.fixes import Fixes, decimal_degrees, drop_outliers
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import Rows

DIVING = 100
INFLECTING_DOWN = 110
SURFACING = 115
TRANSMITTING = 116
CLIMBING = 117
INFLECTING_UP = 118

_GLIDING = (DIVING, INFLECTING_DOWN, CLIMBING, INFLECTING_UP)


def is_gliding(state: FloatArray, *, include_surfacing: bool = False) -> npt.NDArray[np.bool_]:
    """Mask of the rows at which the glider is under way below the surface, or leaving it.

    In the surfacing manoeuvre the battery runs fully forward at about 9 m, the nose drops to -70 degrees and the glider
    rises tail first: no gliding flight that the model of the paper could follow, so it is left out unless asked for.
    """
    return np.isin(state, (*_GLIDING, SURFACING) if include_surfacing else _GLIDING)


SUBMERGED = 1.0
"""A hull this far below the level at which it floats is under water (m)."""

MINIMUM_DIVE = 10.0
"""A leg that dives less than this below its beginning is no profile (m)."""

LONGEST_MISSION = 20_000
"""Cycles: more are no mission, but a number that was mistyped."""

RECORD_BREAK = np.timedelta64(900, "s")
"""A longer pause below the surface breaks a record in two."""


@dataclass(frozen=True)
class Leg:
    """One stretch of rows below the surface.

    Attributes
    ----------
    number : int
        Number of the profile: the cycle in which it begins to dive.
    cycles : tuple of int
        The cycles whose files hold its rows' dives.
    start, stop : int
        Its first row and the one after its last.
    """

    number: int
    cycles: tuple[int, ...]
    start: int
    stop: int


def find_legs(rows: Rows, *, include_surfacing: bool = False) -> tuple[list[Leg], dict[int, str]]:
    """Find the profiles of a mission, and why the other cycles hold none.

    Parameters
    ----------
    rows : Rows
        Navigation rows in time order, with NavState and Depth.
    include_surfacing : bool
        Count the surfacing manoeuvre as part of the profile.

    Returns
    -------
    legs : list of Leg
        In time order.
    without : dict of int to str
        Cycles in which no profile begins or continues, and why.
    """
    legs: list[Leg] = []
    refused: dict[int, str] = {}
    for start, stop in _stretches(rows, is_gliding(rows["NavState"], include_surfacing=include_surfacing)):
        leg = _trim(rows, start, stop)
        dive = _dive(rows["Depth"][leg.start : leg.stop])
        if dive < MINIMUM_DIVE:
            # Less than a metre is a glider afloat whose state says otherwise, or the end of the climb before.
            if dive >= SUBMERGED and np.any(rows["NavState"][start:stop] != CLIMBING):
                refused[leg.number] = f"too shallow: dives {dive:.0f} m, at least {MINIMUM_DIVE:g} m are needed"
        elif legs and legs[-1].number == leg.number:
            refused[leg.number] = "dives twice between surfacings within one file: the first dive is taken"
        else:
            legs.append(leg)
    return legs, _cycles_without(rows, legs, refused)


def _stretches(rows: Rows, gliding: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Find the runs of gliding rows that neither a missing file nor a long pause breaks."""
    broken = (np.diff(rows.part) > 1) | (np.diff(rows.time) > RECORD_BREAK)
    turns = np.flatnonzero(broken | (gliding[1:] != gliding[:-1])) + 1
    edges = [0, *turns.tolist(), len(rows)]
    return [(a, b) for a, b in pairwise(edges) if b > a and gliding[a]]


def _trim(rows: Rows, start: int, stop: int) -> Leg:
    """Cut off the rows at the surface, where the hull still floats on its oil."""
    level = _floating_depth(rows, start) + SUBMERGED
    under = np.flatnonzero(rows["Depth"][start:stop] > level)
    if len(under):
        start, stop = start + int(under[0]), start + int(under[-1]) + 1
    # The climbing row or two that a file inherits from the dive before say nothing about the number.
    sinking = np.flatnonzero(rows["NavState"][start:stop] != CLIMBING)
    diving = rows.part[start:stop][sinking] if len(sinking) else rows.part[start:stop]
    cycles = tuple(np.unique(diving).tolist())
    return Leg(int(diving[0]), cycles, start, stop)


def _floating_depth(rows: Rows, start: int) -> float:
    """Depth that the sensor in the nose reads at the surface: here about 1 m level and 3 m tail up."""
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
    # A name with one digit too many would make a million of missing files.
    for cycle in range(first, last + 1) if last - first < LONGEST_MISSION else sorted(present):
        if cycle in refused:
            without[cycle] = refused[cycle]
        elif cycle not in present:
            without[cycle] = "its navigation file is missing"
        elif cycle not in taken:
            without[cycle] = "only a surface record"
    return without


LOGGING_PAUSE = np.timedelta64(30, "s")
"""Rows of the transmitting state come every 20 s; a longer step is a blocked logger."""


def find_fixes(rows: Rows) -> Fixes:
    """Find the GPS fixes of a mission.

    Parameters
    ----------
    rows : Rows
        Navigation rows in time order, with NavState, Lat and Lon (DDMM.mmm).

    Returns
    -------
    Fixes
        In time order.
    """
    latitude, longitude = decimal_degrees(rows["Lat"]), decimal_degrees(rows["Lon"])
    refreshed = np.zeros(len(rows), dtype=bool)
    refreshed[1:] = (np.diff(latitude) != 0.0) | (np.diff(longitude) != 0.0)
    refreshed &= rows["NavState"] == TRANSMITTING
    # Before its first fix the vehicle reports 0 N, 0 E.
    refreshed &= np.isfinite(latitude) & np.isfinite(longitude) & ((latitude != 0.0) | (longitude != 0.0))
    time = _time_of_position(rows.time)[refreshed]
    # The row after a pause has a fix of its own as a rule, at the same time: that one stays.
    last = np.append(time[1:] > time[:-1], True) if len(time) else np.zeros(0, dtype=bool)
    return drop_outliers(Fixes(time[last], latitude[refreshed][last], longitude[refreshed][last]))


def _time_of_position(time: TimeArray) -> TimeArray:
    taken = time.copy()
    paused = np.flatnonzero(np.diff(time) > LOGGING_PAUSE)
    taken[paused] = time[paused + 1]
    return taken
