"""Phases of a dive that depth alone shows: stationary stretches, and ends of the record under water.

A glider that parks, lies on the bottom or is held by ice does not glide. A record that ends under water lacks part of
the path to the surface. Both make a current wrong unless they are considered.
"""

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy.ndimage

from gliderhpc.observations.nearest import nearest_rows
from gliderhpc.observations.profiles import MIN_DEPTH as MIN_DIVE
from gliderhpc.observations.profiles import SURFACE_DEPTH, SURFACE_MARGIN, stretches
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.series import ProfileSeries

Mask = npt.NDArray[np.bool_]

MIN_STATIONARY = 300.0
"""Minimum duration of a stationary stretch, s; the turn of a dive with a slow pump takes less."""
MAX_RANGE, WINDOW = 2.0, 120.0
"""Largest range of depths (m) in a window (s) of a stationary stretch; the flattest glides cover three times as
much in that time."""
MIN_DEPTH = 5.0
"""Depth below which a glider may be stationary, m; at smaller depths it floats."""
_BIN, _BRIDGED = 30.0, 90.0
"""Length (s) of the bins in which the range is computed, and largest time (s) from a bin's centre to a sample."""

SHALLOW, DEEP = 12.0, 0.05
"""Depth at the end of a record above which it is reported, m and relative to the greatest depth: some vehicles rise the
last ten metres without gliding, and these are not part of the dive."""
LATE_FIX = 1200.0
"""Time (s) after the surfacing by which a fix is expected; if it comes later, the glider may have dived again."""
_FINAL_PERIOD = 90.0
"""Time (s) at the end of a record that shows whether the glider rises or sinks."""
_MIN_GLIDE_PITCH = np.radians(10.0)
"""Minimum pitch (rad) in the steepness of a glide."""


def is_stationary(time: FloatArray, depth: FloatArray) -> Mask:
    """Mask ``(n,)`` of the samples in stretches of at least five minutes at nearly one depth, under water.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s), increasing, and depth (m), NaN where missing. Time without samples does not count.
    """
    found = np.zeros(len(time), dtype=bool)
    for first, last in _stationary_times(time, depth):
        found |= (time >= first) & (time <= last)
    return found


def stationary_points(series: ProfileSeries) -> Mask:
    """Mask ``(n + 1,)`` of the stationary points of a series; none in gaps of the record, which are interpolated.

    Rests that were left out of the series are stationary, too.
    """
    stationary = is_stationary(series.time, np.where(series.weights > 0.0, series.measurements[:, 3], np.nan))
    for begin, stop in series.rests:
        stationary[begin:stop] = True
    return stationary


MIN_AFLOAT, MAX_UNRECORDED = 60.0, 1800.0
"""Minimum time (s) at the surface between two dives of one profile, and maximum pause of the record there: in a longer
one the glider may have dived."""


def floating_points(series: ProfileSeries) -> Mask:
    """Mask ``(n + 1,)`` of the points at which the glider floats at the surface between two dives of the profile.

    Pauses of the record that begin and end at the surface count, up to `MAX_UNRECORDED`.
    """
    floating = np.zeros(len(series.time), dtype=bool)
    for begin, stop in _surfacings(series.time, series.measurements[:, 3]):
        pauses = [(last - first) * series.step for first, last in stretches(series.weights[begin:stop] == 0.0)]
        if max(pauses, default=0.0) <= MAX_UNRECORDED:
            floating[begin:stop] = True
    return floating


def _surfacings(time: FloatArray, depth: FloatArray) -> list[tuple[int, int]]:
    """First sample, and sample after the last, of the times at the surface between two dives; all depths are known."""
    return [
        (begin, stop)
        for begin, stop in stretches(np.asarray(depth < SURFACE_DEPTH))
        if time[stop - 1] - time[begin] >= MIN_AFLOAT
        and depth[:begin].max(initial=0.0) > MIN_DIVE
        and depth[stop:].max(initial=0.0) > MIN_DIVE
    ]


def describe_surfacing(time: FloatArray, depth: FloatArray) -> list[str]:
    """Remark on the time at the surface between two dives of one profile; empty without any.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s) and depths (m), all known.
    """
    minutes = sum(time[stop - 1] - time[begin] for begin, stop in _surfacings(time, depth)) / 60.0
    if not minutes:
        return []
    return [f"{minutes:.0f} min at the surface between dives of the profile: give every dive a number of its own"]


MIN_REST, REST_RANGE = 60.0, 0.3
"""Duration (s) of a rest at one depth where the model does not follow a record, and its largest range of depths (m): on
the bottom or under ice the depth does not vary."""
_SAMPLES_OF_REST = 3
"""Minimum duration of a rest in sample intervals: a turn, too, may be between two samples of the same depth."""


def find_rests(series: ProfileSeries) -> list[tuple[int, int]]:
    """Find the rests at one depth under water: first row, and row after the last, of each.

    The range of depths is at most `REST_RANGE` over `MIN_REST`, as on the bottom, or `MAX_RANGE` over `WINDOW`, as of a
    glider that hovers. Turns that fulfil this are no rests: whether a glider rests is decided where the model does not
    follow its record.
    """
    resting = np.zeros(len(series.time), dtype=bool)
    for duration, depth_range in ((MIN_REST, REST_RANGE), (WINDOW, MAX_RANGE)):
        for begin, stop in _level_stretches(series, duration, depth_range):
            resting[begin:stop] = True
    return stretches(resting)


def _level_stretches(series: ProfileSeries, duration: float, depth_range: float) -> list[tuple[int, int]]:
    """Find the stretches under water with at most a range of depths (m) within a duration (s)."""
    depth, known = series.measurements[:, 3], (series.weights > 0.0) & np.isfinite(series.measurements[:, 3])
    before = round(0.5 * max(duration, _SAMPLES_OF_REST * series.sample_interval) / series.step)
    length = 2 * before + 1
    high = scipy.ndimage.maximum_filter1d(np.where(known, depth, np.inf), length, mode="constant", cval=np.inf)
    low = scipy.ndimage.minimum_filter1d(np.where(known, depth, -np.inf), length, mode="constant", cval=-np.inf)
    centres = stretches(np.asarray((high - low <= depth_range) & (low > MIN_DEPTH)))
    return [(begin - before, stop + before) for begin, stop in centres]


def describe_rest(series: ProfileSeries) -> str:
    """Describe the longest rest at one depth under water; empty if there is none of a minute or more."""
    rests = _level_stretches(series, MIN_REST, REST_RANGE)
    if not rests:
        return ""
    begin, end = max(rests, key=lambda rest: rest[1] - rest[0])
    return (
        f"the glider was at one depth, {series.measurements[begin, 3]:.0f} m, for "
        f"{(end - begin - 1) * series.step:.0f} s, as on the bottom, where it does not glide; end the profile before, "
        "and begin another one after that"
    )


def _stationary_times(time: FloatArray, depth: FloatArray) -> list[tuple[float, float]]:
    """First and last time (s) of the stationary stretches of a record."""
    known = np.isfinite(depth)
    if np.count_nonzero(known) < 2:
        return []
    time, depth = time[known], depth[known]
    bins, count = int((time[-1] - time[0]) // _BIN), round(WINDOW / _BIN)
    if bins * _BIN < MIN_STATIONARY:
        return []
    high, low = _extremes(time, depth, bins)
    around = np.lib.stride_tricks.sliding_window_view
    narrow = around(high, count).max(axis=1) - around(low, count).min(axis=1) <= MAX_RANGE
    deep = around(low, count).min(axis=1) > MIN_DEPTH
    ends = [(begin * _BIN, (end - 1) * _BIN + WINDOW) for begin, end in stretches(np.asarray(narrow & deep))]
    return [(time[0] + first, time[0] + last) for first, last in ends if last - first >= MIN_STATIONARY]


_SHARE_OF_ONE_VALUE = 0.8
"""Share of the samples of stationary stretches with the same depth at or above which the sensor may be stuck."""


def _is_one_value(time: FloatArray, depth: FloatArray, still: Sequence[tuple[float, float]]) -> bool:
    """Return whether most depths in each stretch are the same to the last digit; all depths are known."""
    parts = [depth[(time >= first) & (time <= last)] for first, last in still]
    return all(np.mean(part == np.median(part)) >= _SHARE_OF_ONE_VALUE for part in parts)


def _extremes(time: FloatArray, depth: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Greatest and least depth in each bin, including the depth at its centre; NaN where the record pauses."""
    centres = time[0] + _BIN * (np.arange(bins) + 0.5)
    at = np.interp(centres, time, depth)
    at[np.abs(time[nearest_rows(time, centres)] - centres) > _BRIDGED] = np.nan
    place = np.minimum(((time - time[0]) // _BIN).astype(np.int64), bins - 1)
    high, low = at.copy(), at.copy()
    np.maximum.at(high, place, depth)
    np.minimum.at(low, place, depth)
    return high, low


def unrecorded_variance(
    time: FloatArray, depth: FloatArray, pitch: FloatArray, lasts: tuple[float, float]
) -> tuple[float, float]:
    """Variances (m2, per component) of the path before and after a record, given the times (s) from and to the fixes.

    The other arguments are those of `distance_to_surface`.
    """
    before, after = lasts
    return (
        distance_to_surface(time, depth, pitch, before, "start") ** 2,
        distance_to_surface(time, depth, pitch, after, "end") ** 2,
    )


def distance_to_surface(
    time: FloatArray, depth: FloatArray, pitch: FloatArray, lasts: float, end: Literal["start", "end"]
) -> float:
    """Distance (m) that the glider may have flown between the start or the end of a record and the surface.

    Parameters
    ----------
    time, depth, pitch : (n,) arrays
        Times (s), depth (m) and pitch (rad) of the record; NaN where missing.
    lasts : float
        Time between that end of the record and the fix, s.
    end : str
        The start or the end of the record.

    Returns
    -------
    float
        Zero at the surface. On the way to the surface it follows from the depth and the steepness of the dive. Where a
        record that ends deep is still on the way down, or the fix is later than `LATE_FIX`, the glider may have flown
        all the time.
    """
    known = np.isfinite(depth)
    if np.count_nonzero(known) < 2 or not np.isfinite(pitch).any():
        return 0.0
    time, depth = time[known], depth[known]
    speed = _vertical_speed(time, depth)
    if end == "start":
        time, depth = time[-1] - time[::-1], depth[::-1]
    height = float(depth[-1]) - SURFACE_MARGIN
    if height <= 0.0 or lasts <= 0.0 or speed == 0.0:
        return 0.0
    way_up = height / speed
    may_fly_on = depth[-1] > _reported_depth(depth) and (not _rises(time, depth) or lasts > way_up + LATE_FIX)
    under_way = lasts if may_fly_on else min(way_up, lasts)
    return float(speed * under_way / np.tan(max(float(np.nanmedian(np.abs(pitch))), _MIN_GLIDE_PITCH)))


def _vertical_speed(time: FloatArray, depth: FloatArray) -> float:
    """Mean vertical speed (m/s) outside stationary stretches, from minute to minute because of the sensor's noise."""
    points = np.append(np.arange(time[0], time[-1], 2.0 * _BIN), time[-1])
    moved, lasts, middle = np.abs(np.diff(np.interp(points, time, depth))), np.diff(points), points[:-1] + _BIN
    flying = np.ones(len(moved), dtype=bool)
    for first, last in _stationary_times(time, depth):
        flying &= (middle < first) | (middle > last)
    return float(moved[flying].sum() / lasts[flying].sum()) if lasts[flying].sum() > 0.0 else 0.0


def _rises(time: FloatArray, depth: FloatArray) -> bool:
    """Return whether a record ends on the way to the surface."""
    before = np.searchsorted(time, time[-1] - _FINAL_PERIOD, side="right") - 1
    return bool(depth[np.clip(before, 0, len(depth) - 2)] > depth[-1])


def _reported_depth(depth: FloatArray) -> float:
    return max(SHALLOW, DEEP * float(np.nanmax(depth)))


def dive_notes(time: FloatArray, depth: FloatArray, attitude: FloatArray) -> Iterator[str]:
    """Describe the stationary stretches of a dive, and the ends of its record under water.

    Parameters
    ----------
    time, depth, attitude : (n,) arrays
        Times (s), depth, and a sum of the angles that are needed, NaN where missing. The record ends where one of them
        ends.
    """
    known = np.flatnonzero(np.isfinite(depth))
    oriented = np.flatnonzero(np.isfinite(attitude))
    if not len(known) or not len(oriented):
        return
    still = _stationary_times(time, depth)
    if still:
        minutes = sum(last - first for first, last in still) / 60.0
        levels = np.asarray(np.interp(np.mean(still, axis=1), time[known], depth[known]))
        cause = "parked, on the bottom, under ice or at a density step"
        if _is_one_value(time[known], depth[known], still):
            cause += "; or the pressure sensor is stuck, as the depth is the same to the last digit"
        yield f"stationary for {minutes:.0f} min {describe_levels(levels)} ({cause})"
    yield from _deep_ends(time, depth, known, oriented)


_SAME_LEVEL = 5.0
"""Difference in depth (m) up to which stretches are at one level."""


def describe_levels(levels: FloatArray) -> str:
    """Describe the depths ``(k,)`` of the stationary stretches of a dive, m: ``at 200 m, in 2 parts``."""
    low, high = float(levels.min()), float(levels.max())
    where = f"{np.median(levels):.0f} m" if high - low <= _SAME_LEVEL else f"{low:.0f} to {high:.0f} m"
    return f"at {where}" + (f", in {len(levels)} parts" if len(levels) > 1 else "")


def _deep_ends(
    time: FloatArray, depth: FloatArray, known: npt.NDArray[np.int64], oriented: npt.NDArray[np.int64]
) -> Iterator[str]:
    """Describe the ends under water of the record of depth (rows `known`) and of attitude (rows `oriented`)."""
    ends = (("begins", max(known[0], oriented[0]), known[0]), ("ends", min(known[-1], oriented[-1]), known[-1]))
    depths = [float(np.interp(time[row], time[known], depth[known])) for _, row, _ in ends]
    least = _reported_depth(depth)
    deep = [
        (f"{verb} at {at:.0f} m", row != row_of_depth)
        for (verb, row, row_of_depth), at in zip(ends, depths, strict=True)
        if at > least
    ]
    if deep:
        subject = "record of the attitude" if all(by_attitude for _, by_attitude in deep) else "record"
        where = " and ".join(text for text, _ in deep)
        yield f"the {subject} {where} depth, so the unrecorded distance adds to the current's error"
