"""GPS fixes among the navigation rows.

Every row repeats a position; below the surface it is that of the last fix. A fix is a row of the transmitting state
whose position differs from that of the row before, so that the stale positions at the beginning of a surface interval,
and between two fixes, do not count.

While a call by satellite blocks the logger, the row that was due before the call gets its time at the call's beginning
but its position at the call's end: on missions 10 and 12 of SEA035 the position of such a row lies 0.9 to 1.0 of the
way to the next one, however long the call. It is therefore given the time of the next row.

The first position after a surfacing can lie kilometres off. A fix from which no drift leads to its neighbours is
left out.
"""

from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.seaexplorer.rows import Rows
from gliderhpc.observations.seaexplorer.states import TRANSMITTING

LOGGING_PAUSE = np.timedelta64(30, "s")
"""Rows of the transmitting state come every 20 s; a longer step is a blocked logger."""


MAXIMUM_DRIFT = 2.0
"""Gliders do not drift faster at the surface (m/s); one that is towed or on deck does."""

POSITION_ERROR = 20.0
"""Two fixes differ by as much for no reason (m)."""

SAME_SURFACING = np.timedelta64(900, "s")
"""Fixes further apart than this are not held against each other."""

_METRES_A_DEGREE = 111_195.0


@dataclass(frozen=True, eq=False)
class Fixes:
    """GPS fixes at the surface.

    Attributes
    ----------
    time : (m,) array
        When each was taken (UTC), strictly increasing.
    latitude, longitude : (m,) arrays
        Degrees.
    outliers : int
        Number of fixes left out, because no drift leads from them to their neighbours.
    """

    time: TimeArray
    latitude: FloatArray
    longitude: FloatArray
    outliers: int = 0


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
    return _drop_outliers(Fixes(time[last], latitude[refreshed][last], longitude[refreshed][last]))


def _drop_outliers(fixes: Fixes) -> Fixes:
    """Leave out the fixes that none of the two neighbours on either side can be reached from."""
    keep = np.array([_is_plausible(fixes, index) for index in range(len(fixes.time))], dtype=bool)
    outliers = int(np.count_nonzero(~keep))
    return Fixes(fixes.time[keep], fixes.latitude[keep], fixes.longitude[keep], outliers)


def _is_plausible(fixes: Fixes, index: int) -> bool:
    others = np.array([i for i in range(index - 2, index + 3) if i != index and 0 <= i < len(fixes.time)], dtype=int)
    apart = np.abs(fixes.time[others] - fixes.time[index])
    others, apart = others[apart <= SAME_SURFACING], apart[apart <= SAME_SURFACING]
    if len(others) == 0:
        return True
    north = fixes.latitude[others] - fixes.latitude[index]
    east = (fixes.longitude[others] - fixes.longitude[index]) * np.cos(np.radians(fixes.latitude[index]))
    reach = MAXIMUM_DRIFT * (apart / np.timedelta64(1, "s")) + POSITION_ERROR
    return bool(np.any(_METRES_A_DEGREE * np.hypot(north, east) <= reach))


def decimal_degrees(value: FloatArray) -> FloatArray:
    """Degrees from degrees and minutes written as DDMM.mmm, sign and all."""
    degrees = np.trunc(value / 100.0)
    return degrees + (value - 100.0 * degrees) / 60.0


def _time_of_position(time: TimeArray) -> TimeArray:
    taken = time.copy()
    paused = np.flatnonzero(np.diff(time) > LOGGING_PAUSE)
    taken[paused] = time[paused + 1]
    return taken
