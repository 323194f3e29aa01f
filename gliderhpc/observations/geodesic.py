"""Displacements on the WGS84 ellipsoid."""

import math

from geographiclib.geodesic import Geodesic

from gliderhpc.observations.records import FloatArray

Position = tuple[float, float]
"""Latitude and longitude, degree."""


def moved(position: Position, displacement: FloatArray) -> Position:
    """Move along a geodesic of WGS84 by a displacement ``[north, east]`` in m."""
    north, east = displacement.tolist()
    end = Geodesic.WGS84.Direct(*position, math.degrees(math.atan2(east, north)), math.hypot(north, east))
    return float(end["lat2"]), float(end["lon2"])
