"""GPS fixes as the importers hand them on, and displacements on the WGS84 ellipsoid.

The first position after a surfacing can lie kilometres off. A fix from which no drift leads to its neighbours is
left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from geographiclib.geodesic import Geodesic

from gliderhpc.observations.records import FloatArray, TimeArray

Position = tuple[float, float]
"""Latitude and longitude, degree."""


def moved(position: Position, displacement: FloatArray) -> Position:
    """Move along a geodesic of WGS84 by a displacement ``[north, east]`` in m."""
    north, east = displacement.tolist()
    end = Geodesic.WGS84.Direct(*position, math.degrees(math.atan2(east, north)), math.hypot(north, east))
    return float(end["lat2"]), float(end["lon2"])


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

    def where(self, keep: npt.NDArray[np.bool_]) -> "Fixes":
        """Keep some of the fixes."""
        return Fixes(self.time[keep], self.latitude[keep], self.longitude[keep], self.outliers)


def merge_fixes(parts: Sequence[Fixes]) -> Fixes:
    """Put the fixes of several records in time order, without repetitions and outliers.

    The last fix of one dive's record is as a rule the first of the next one's.
    """
    time, place = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
    latitude = np.concatenate([part.latitude for part in parts])[place]
    longitude = np.concatenate([part.longitude for part in parts])[place]
    return drop_outliers(Fixes(time, latitude, longitude))


def drop_outliers(fixes: Fixes) -> Fixes:
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
