"""Noise of the sensors: as the platform file states it, or as the record shows it where it is clearly larger.

References
----------
J. von Neumann, R. H. Kent, H. R. Bellinson, B. I. Hart (1941), The mean square successive difference, Annals of
Mathematical Statistics 12, 153-162.
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import recorded_samples, stated_variance, vibration_set
from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations.format import MEASURED
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_ORDER = 3
"""Order of the differences: the motion of a glider is a polynomial of second degree over four samples."""
_MIN_DIFFERENCES = 30
"""Minimum number of differences for an estimate of the noise."""
_NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
_NOT_MEASURED = np.array([*np.radians([3.0, 3.0, 3.0]), 3.0])
"""Noise level (rad, m) at and above which a channel counts as not measured: the filter then refuses the record."""
_EQUAL_VALUES = 1e-9
"""Largest difference of values (rad, m) that are considered equal."""
_SHARE_BELOW_QUANTUM = 0.05
"""Share of the distances that may be smaller than the quantum, after corrections of the record."""
_MIN_DISTANCES = 10
"""Minimum number of distances for an estimate of the quantum; a few values between two levels are not the steps of a
sensor."""
_MAX_DISTINCT_SHARE = 0.5
"""Largest ratio of the number of distinct values to that of samples in a rounded record."""
_EQUAL_INTERVALS = 0.1
"""Largest relative difference of intervals that are considered equal."""
_MIN_NOISE_RATIO = 1.5
"""Ratio of the standard deviation found to the stated one above which the former is used. On twins whose sensors are as
stated it is at most 1.1 for pitch, heading and depth."""


def sample_variance(platform: Platform, series: ProfileSeries) -> Array:
    """Variance ``(4,)`` of one sample of roll, pitch, heading (rad2) and depth (m2).

    It is that of the platform's sensors (`stated_variance`), or the record's own (`noise_of_record`,
    `rounding_of_record`) where its deviation is more than 1.5 times as large. With too small a variance, the noise
    appears as motion: on twins with 0.1 degree of noise on a compass that resolves 0.1 degree, the error of the speed
    would be 0.02 m/s, and with 0.2 degree the filter would refuse the record.
    """
    stated = stated_variance(platform)
    observed = np.maximum(noise_of_record(platform, series), rounding_of_record(series))
    return np.where((observed > _MIN_NOISE_RATIO**2 * stated) & (observed < _NOT_MEASURED**2), observed, stated)


def noise_of_record(platform: Platform, series: ProfileSeries) -> Array:
    """Variance ``(4,)`` of the white noise in a record; zero where it cannot be distinguished from motion.

    Notes
    -----
    Third differences of white noise of variance ``s^2`` have the variance ``20 s^2``, and those of a smooth motion
    nearly none. Their median outside the vibration set is not that of rare bursts of motion or of false samples. Gusts
    from the side roll a glider from sample to sample, so the noise of the roll is taken to be at most that of pitch and
    heading, which the same instrument measures. Records slower than 2 s do not separate noise and motion.
    """
    if series.sample_interval > SLOW_SENSORS_PRIOR:
        return np.zeros(4)
    differences = sample_differences(series, ~vibration_set(platform, series), _ORDER)
    if len(differences) < _MIN_DIFFERENCES:
        return np.zeros(4)
    variance = (np.median(np.abs(differences), axis=0) / _NORMAL_MEDIAN) ** 2 / comb(2 * _ORDER, _ORDER)
    variance[0] = min(variance[0], max(variance[1], variance[2]))
    return np.asarray(variance)


def sample_differences(series: ProfileSeries, used: NDArray[np.bool_], order: int) -> Array:
    """Differences ``(m, 4)`` of an order between successive samples, on rows used, where their intervals are equal."""
    rows = np.flatnonzero(recorded_samples(series) & used)
    if len(rows) <= order:
        return np.empty((0, 4))
    intervals = np.diff(rows)
    usual = np.abs(intervals / np.median(intervals) - 1.0) <= _EQUAL_INTERVALS
    even = np.convolve(usual, np.ones(order), "valid") > order - 0.5
    return np.asarray(np.diff(series.measurements[rows], order, axis=0)[even])


def rounding_of_record(series: ProfileSeries) -> Array:
    """Variance ``(4,)`` of the rounding in a record, from the quantum of each measurement (`_quantum`)."""
    return np.array([_quantum(values) ** 2 / 12.0 for values in series.measurements[recorded_samples(series)].T])


def _quantum(values: Array) -> float:
    """Smallest distance of distinct values, with few exceptions; zero if most values occur once and are not rounded."""
    distinct = np.unique(values[np.isfinite(values)])
    gaps = np.diff(distinct)
    gaps = gaps[gaps > _EQUAL_VALUES]
    if len(gaps) < _MIN_DISTANCES or len(gaps) + 1 > _MAX_DISTINCT_SHARE * len(values):
        return 0.0
    return float(np.quantile(gaps, _SHARE_BELOW_QUANTUM))


def measurement_variance(platform: Platform, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Variance ``(4,)`` of one fed sample (rad2, m2): that of a sample of the record.

    A slow record is interpolated and fed at shorter intervals. Its variance is larger in proportion, which leaves the
    total information unchanged (docs/theory/estimate.md).
    """
    variance = sample_variance(platform, series)
    if series.sample_interval > settings.filter.slow_feed:
        variance *= series.sample_interval / settings.filter.feed_interval
    return variance


def noisier_than_stated(platform: Platform, series: ProfileSeries) -> dict[str, float]:
    """Standard deviation (degree, m) of the measurements whose noise is the record's own, not that stated."""
    used, stated = sample_variance(platform, series), stated_variance(platform)
    deviations = np.sqrt(used) * np.array([*np.degrees(np.ones(3)), 1.0])
    return {
        name: float(value) for name, value, noisier in zip(MEASURED, deviations, used > stated, strict=True) if noisier
    }
