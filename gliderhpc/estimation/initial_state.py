"""A first guess of the flight state at every sample, from the record and the steady glide."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from gliderhpc.estimation.glide_angle import angle_of_attack
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

SMOOTHING = 10.0
"""Seconds (or three sample intervals, if longer) over which slopes are taken."""
SPEED_LIMITS = (0.05, 1.0)
"""Speeds (m/s) that a guess is kept within."""
_LEAST_PITCH = np.radians(5.0)


def flight_guesses(platform: Platform, series: ProfileSeries) -> Array:
    """State guesses ``(n+1, 12)``: measured attitude and depth, glide speed, rates from the slopes; X = Y = 0."""
    phi, theta, psi, depth = series.measurements.T
    slopes = slopes_of(series)
    states = np.zeros((len(series.time), 12))
    states[:, 0], states[:, 1], states[:, 2], states[:, 5] = phi, theta, psi, depth
    alpha = np.nan_to_num(angle_of_attack(platform, theta))
    xi = theta - alpha
    steepness = np.maximum(np.abs(np.sin(xi)), np.sin(_LEAST_PITCH))
    speed = np.clip(np.abs(slopes[:, 3]) / steepness, *SPEED_LIMITS)
    states[:, 6] = speed * np.cos(alpha)
    states[:, 8] = speed * np.sin(alpha)
    states[:, 9] = slopes[:, 0] - slopes[:, 2] * np.sin(theta)
    states[:, 10] = slopes[:, 1] * np.cos(phi) + slopes[:, 2] * np.sin(phi) * np.cos(theta)
    states[:, 11] = -slopes[:, 1] * np.sin(phi) + slopes[:, 2] * np.cos(phi) * np.cos(theta)
    return states


def slopes_of(series: ProfileSeries) -> Array:
    """Slopes ``(n+1, 4)`` of roll, pitch, heading (rad/s) and depth (m/s), over `SMOOTHING` or three intervals."""
    return smoothed_slope(series.measurements, series.step, max(SMOOTHING, 3.0 * series.sample_interval))


def smoothed_slope(values: Array, step: float, smoothing: float) -> Array:
    """Slope a second of the straight line fitted to `smoothing` seconds about each sample; columns apart."""
    width = min(round(smoothing / step), len(values) - 1) // 2 * 2 + 1
    if width < 3:
        return np.asarray(np.gradient(values, step, axis=0))
    return np.asarray(savgol_filter(values, width, polyorder=1, deriv=1, delta=step, axis=0, mode="interp"))
