"""Measurements of a profile as filter and smoother take them.

Corrections of the records that a user asks for, the vibration set, and which samples count with what variance.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from gliderhpc.estimation.settings import EstimationSettings, RecordSettings
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

HARMONICS = ("sin", "cos", "sin 2", "cos 2")
"""Harmonics of the heading read, in the order of `RecordSettings.heading_deviation`."""


def harmonics(heading: ArrayLike) -> Array:
    """Return sine and cosine ``(n, 4)`` of headings ``(n,)`` (rad) and of twice them, in the order of `HARMONICS`."""
    psi = np.asarray(heading, dtype=np.float64)
    return np.column_stack([np.sin(psi), np.cos(psi), np.sin(2.0 * psi), np.cos(2.0 * psi)])


def corrected(record: ProfileRecord, settings: RecordSettings) -> ProfileRecord:
    """Give a record without the errors that the settings name; the record itself where they name none."""
    if settings == RecordSettings():
        return record
    error = np.radians(settings.heading_offset + harmonics(record.heading) @ np.array(settings.heading_deviation))
    return replace(
        record,
        pitch=settings.pitch_scale * (record.pitch - np.radians(settings.pitch_offset)),
        heading=np.mod(record.heading - error, 2.0 * np.pi),
        depth=_earlier(record.time, record.depth, settings.depth_lag),
    )


def _earlier(time: Array, values: Array, lag: float) -> Array:
    """Give at each time what was recorded a lag later; NaN where the sample nearest to then is missing, or none is."""
    known = np.isfinite(values)
    if lag == 0.0 or not known.any():
        return values
    moved = np.interp(time + lag, time[known], values[known])
    there = np.interp(time + lag, time, known.astype(np.float64)) >= 0.5
    inside = (time + lag >= time[0]) & (time + lag <= time[-1])
    return np.where(there & inside, moved, np.nan)


def vibration_set(platform: Platform, series: ProfileSeries) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of the samples within the platform's guard of an actuator moving faster than its threshold.

    Battery translation, battery rotation and ballast are held against `Platform.vibration` (m/s, degree/s, cm3/s).
    """
    limits = platform.vibration
    thresholds = np.array([limits.battery_position_rate, limits.battery_rotation_rate_rad, limits.ballast_rate_m3])
    rates = np.abs(np.diff(series.controls[:, :3], axis=0)) / series.step
    moving = np.zeros(len(series.time), dtype=np.uint8)
    fast = (rates > thresholds).any(axis=1)
    moving[1:-1][fast] = 1
    reach = 2 * round(limits.guard / series.step) + 1
    return np.asarray(scipy.ndimage.maximum_filter1d(moving, size=reach, mode="constant"), dtype=bool)


def _rows(seconds: float, step: float) -> int:
    return max(1, round(seconds / step))


def sample_variance(platform: Platform) -> Array:
    """Variance ``(4,)`` of one sample: quantum squared over 12, depth noise squared (rad2, m2)."""
    attitude = platform.sensors.attitude_resolution_rad**2 / 12.0
    return np.array([attitude, attitude, attitude, platform.sensors.depth_noise**2])


def measurement_variance(platform: Platform, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Variance ``(4,)`` of one fed sample (rad2, m2): that of a sample of the record.

    A slow record is fed interpolated, at shorter intervals; its variance grows in proportion, so that no information is
    made up (docs/theory/model.md).
    """
    variance = sample_variance(platform)
    if series.sample_interval > settings.filter.slow_feed:
        variance *= series.sample_interval / settings.filter.feed_interval
    return variance


def _feed_interval(series: ProfileSeries, settings: EstimationSettings) -> float:
    slow = series.sample_interval > settings.filter.slow_feed
    return settings.filter.feed_interval if slow else series.sample_interval


def fed_samples(series: ProfileSeries, settings: EstimationSettings) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of the rows that the filter is fed: the samples, or every second of a slow record.

    Every feed weighs alike. So where a slow record is sampled several times as often as usual, it is fed as many times
    as often, as far as the steps allow.
    """
    if series.sample_interval <= settings.filter.slow_feed:
        return recorded_samples(series)
    every = _rows(settings.filter.feed_interval, series.step)
    feeds = np.minimum(_times_as_often(series), every)
    turns = np.arange(len(feeds)) * feeds
    return np.asarray(turns // every > (turns - feeds) // every) & _measured(series)


def _times_as_often(series: ProfileSeries) -> NDArray[np.int64]:
    """Sampling rate at each row ``(n+1,)`` relative to the usual one, a whole number, at least one."""
    rows = np.arange(len(series.measurements))
    if len(series.sample_index) < 2:
        return np.ones(len(rows), dtype=np.int64)
    intervals = np.diff(series.sample_index) * series.step
    within = np.clip(np.searchsorted(series.sample_index, rows, side="right") - 1, 0, len(intervals) - 1)
    return np.maximum(1, np.rint(series.sample_interval / intervals[within])).astype(np.int64)


def recorded_samples(series: ProfileSeries) -> NDArray[np.bool_]:
    """Rows ``(n+1,)`` that are samples of the record, none interpolated."""
    recorded = np.zeros(len(series.measurements), dtype=bool)
    recorded[series.sample_index] = True
    return recorded & _measured(series)


def _measured(series: ProfileSeries) -> NDArray[np.bool_]:
    return np.asarray((series.weights > 0.0) & np.isfinite(series.measurements).any(axis=1))


_SAME = 1e-9
"""Values this close (rad) are the same."""


def repetitions(values: Array) -> NDArray[np.int64]:
    """Length ``(m,)`` of the run of equal values around each of ``values (m,)``; a NaN is a run of its own."""
    new = ~(np.abs(np.diff(values)) <= _SAME)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1]).astype(np.int64)
    counts = np.diff(np.append(starts, len(values)))
    return np.repeat(counts, counts)
