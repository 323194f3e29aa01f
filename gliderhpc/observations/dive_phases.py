"""Phases of a dive that depth alone shows: stationary stretches, and ends of the record under water.

A glider that parks, lies on the bottom or is held by ice does not glide. A record that ends under water lacks a part of
the way to the surface. Both make a current wrong unless they are considered.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.profiles import SURFACE_MARGIN, stretches
from gliderhpc.observations.records import FloatArray, ProfileRecord

Mask = npt.NDArray[np.bool_]

MIN_STATIONARY = 300.0
"""Least duration of a stationary stretch, s; the turn of a dive with a slow pump takes less."""
MAX_DEPTH_RATE = 0.01
"""Depth rate below which a glider is stationary, m/s; the flattest glides have five times as much."""
_GRID, _REACH = 30.0, 2
"""Interval (s) of the points at which the depth rate is computed, and number of points on either side."""
_BRIDGED = 90.0
"""Largest time (s) between a point and the nearest sample."""

MIN_DEPTH = 5.0
"""Depth below which a glider may be stationary, m; above it, it floats."""
SHALLOW, DEEP = 12.0, 0.05
"""Depth at the end of a record from which on it is reported, m and relative to the greatest depth: some vehicles rise
the last ten metres without gliding, and these are not part of the dive."""
LATE_FIX = 1200.0
"""Time (s) after the surfacing by which a fix is expected; if it comes later, the glider may have dived again."""
_LATEST = 90.0
"""Time (s) at the end of a record in which it rises or sinks."""
_FLATTEST = np.radians(10.0)
"""Least pitch from which the steepness of a glide is taken."""


def is_stationary(time: FloatArray, depth: FloatArray) -> Mask:
    """Mask ``(n,)`` of the samples in stretches of at least five minutes without change of depth, under water.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s), increasing, and depth (m), NaN where missing. Stretches without samples do not count.
    """
    known = np.isfinite(depth)
    if np.count_nonzero(known) < 2 or time[-1] - time[0] < MIN_STATIONARY:
        return np.zeros(len(time), dtype=bool)
    sampled, sampled_depth = time[known], depth[known]
    points = np.arange(sampled[0], sampled[-1], _GRID)
    at = np.interp(points, sampled, sampled_depth)
    rate = np.full(len(points), np.inf)
    span = 2 * _REACH
    if len(points) > span:
        rate[_REACH:-_REACH] = np.abs(at[span:] - at[:-span]) / (span * _GRID)
    after = np.minimum(np.searchsorted(sampled, points), len(sampled) - 1)
    before = np.maximum(after - 1, 0)
    recorded = np.minimum(np.abs(sampled[after] - points), np.abs(points - sampled[before])) <= _BRIDGED
    still = (rate < MAX_DEPTH_RATE) & recorded & (at > MIN_DEPTH)
    found = np.zeros(len(time), dtype=bool)
    for begin, end in stretches(still):
        first, last = points[begin] - _REACH * _GRID, points[end - 1] + _REACH * _GRID
        if last - first >= MIN_STATIONARY:
            found |= (time >= first) & (time <= last)
    return found


def unrecorded_distance(record: ProfileRecord, lasts: float, end: Literal["start", "end"]) -> float:
    """Distance (m) that the glider may have flown between the record's start or end and the surface.

    Parameters
    ----------
    record : ProfileRecord
        Record with time (s), depth (m) and pitch (rad).
    lasts : float
        Time between the fix and that end of the record, s.
    end : str
        The start or the end of the record.

    Returns
    -------
    float
        Zero at the surface. On the way to the surface it follows from the depth and the steepness of the dive. On the
        way down, or if the fix is later than `LATE_FIX`, the glider may have flown all the time.
    """
    return distance_to_surface(record.time, record.depth, record.pitch, lasts, end)


def distance_to_surface(
    time: FloatArray, depth: FloatArray, pitch: FloatArray, lasts: float, end: Literal["start", "end"]
) -> float:
    """Compute `unrecorded_distance` from time (s), depth (m) and pitch (rad) of a record, ``(n,)``."""
    known = np.isfinite(depth)
    if np.count_nonzero(known) < 2 or not np.isfinite(pitch).any():
        return 0.0
    time, depth = time[known], depth[known]
    if end == "start":
        time, depth = time[-1] - time[::-1], depth[::-1]
    height = float(depth[-1]) - SURFACE_MARGIN
    travelled, elapsed = float(np.abs(np.diff(depth)).sum()), float(time[-1] - time[0])
    if height <= 0.0 or lasts <= 0.0 or travelled == 0.0:
        return 0.0
    steepness = np.tan(max(float(np.nanmedian(np.abs(pitch))), _FLATTEST))
    speed = travelled / elapsed
    way_up = height / speed
    approaches = bool(depth[np.searchsorted(time, time[-1] - _LATEST)] > depth[-1])
    under_way = min(way_up, lasts) if approaches and lasts < way_up + LATE_FIX else lasts
    return float(speed * under_way / steepness)


def dive_notes(time: FloatArray, depth: FloatArray) -> Iterator[str]:
    """Describe the stationary stretches of a dive, and the ends of its record under water.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s) and depth (m), NaN where missing.
    """
    known = np.isfinite(depth)
    if not known.any():
        return
    time, depth = time[known], depth[known]
    for begin, end in stretches(is_stationary(time, depth)):
        minutes, level = (time[end - 1] - time[begin]) / 60.0, np.median(depth[begin:end])
        yield f"stationary for {minutes:.0f} min at {level:.0f} m (parked, on the bottom or under ice)"
    least = max(SHALLOW, DEEP * float(depth.max()))
    ends = [f"{verb} at {at:.0f} m" for verb, at in (("begins", depth[0]), ("ends", depth[-1])) if at > least]
    if ends:
        yield f"the record {' and '.join(ends)} depth, and the unrecorded way is part of the current's error"
