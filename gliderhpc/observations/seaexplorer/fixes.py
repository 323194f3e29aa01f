"""GPS fixes among the navigation rows.

Every row repeats a position; below the surface it is that of the last fix. A fix is a row of the transmitting state
whose position differs from that of the row before, so that the stale positions at the beginning of a surface interval,
and between two fixes, do not count.

While a call by satellite blocks the logger, the row that was due before the call gets its time at the call's beginning
but its position at the call's end: on missions 10 and 12 of SEA035 the position of such a row lies 0.9 to 1.0 of the
way to the next one, however long the call. It is therefore given the time of the next row.
"""

import numpy as np

from gliderhpc.observations.fixes import Fixes, decimal_degrees, drop_outliers
from gliderhpc.observations.records import TimeArray
from gliderhpc.observations.rows import Rows
from gliderhpc.observations.seaexplorer.states import TRANSMITTING

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
