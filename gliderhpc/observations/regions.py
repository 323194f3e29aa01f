"""Longitudes and regions, also across the date line."""

from typing import TypeVar

import numpy as np

from gliderhpc.observations.records import FloatArray

Degrees = TypeVar("Degrees", float, FloatArray)


def wrapped_longitude(longitude: Degrees, centre: float = 0.0) -> Degrees:
    """Longitude (degree) within half a turn of a centre: from ``centre - 180`` up to, not including, ``centre + 180``.

    Longitudes on both sides of the date line are continuous relative to a centre near it.
    """
    return (longitude - centre + 180.0) % 360.0 - 180.0 + centre


def longitude_range(longitude: FloatArray) -> tuple[float, float] | None:
    """Return the western and the eastern end (degree) of the shortest arc with all longitudes.

    The western end is the greater number if the arc crosses the date line, as in the ACDD conventions. NaN is skipped;
    the result is None if no longitude is known.
    """
    known = np.sort(wrapped_longitude(longitude[np.isfinite(longitude)].astype(np.float64)))
    if len(known) == 0:
        return None
    gaps = np.diff(known, append=known[0] + 360.0)
    widest = int(np.argmax(gaps))
    west, east = float(known[(widest + 1) % len(known)]), float(known[widest])
    return west, 180.0 if east == -180.0 and west > 0.0 else east


def bounding_polygon(latitude: tuple[float, float], longitude: tuple[float, float]) -> str:
    """Return a region as text (WKT), from its southern and northern, and its western and eastern end (degree).

    A region across the date line, whose western end is the greater number, has one polygon on either side.
    """
    west, east = longitude
    if west <= east:
        return f"POLYGON {_rectangle(latitude, west, east)}"
    return f"MULTIPOLYGON ({_rectangle(latitude, west, 180.0)}, {_rectangle(latitude, -180.0, east)})"


def _rectangle(latitude: tuple[float, float], west: float, east: float) -> str:
    south, north = latitude
    corners = ((south, west), (south, east), (north, east), (north, west), (south, west))
    return f"(({', '.join(f'{a:.5f} {b:.5f}' for a, b in corners)}))"
