"""Glide-angle relation (eq. 15; Zhou et al.), and first guesses of the flight state by it."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from gliderhpc.flight.steady_glide import best_angle_of_attack, imbalance, imbalance_slope, zero_lift_angle
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_ITERATIONS = 30
_CONVERGED = 1e-12


def angle_of_attack(platform: Platform, pitch: ArrayLike) -> Array:
    """Steady angle of attack (rad) at a pitch (rad); NaN where the path would be flatter than the least glide angle.

    Notes
    -----
    With glide angle ``xi = theta - alpha`` the steady balance ``D = -L tan(xi)`` is quadratic in alpha; its small root
    is eq. 15, with ``K_D0 + K_L0 tan(xi)`` for ``K_D0`` where the hull lifts at zero angle of attack. Its sign gives
    lift against the glide, on dive and climb alike. Since ``xi`` depends on alpha, and iterating eq. 15 misses the
    flattest paths, the balance is solved by Newton's method in the distance x from zero lift, starting at the least
    drag over lift: between there and zero lift the small root is the only one. ``K_M0`` trims the hull and does not
    enter the force balance.
    """
    theta = np.asarray(pitch, dtype=np.float64)
    dive = theta < 0.0
    lift_sign = np.where(dive, 1.0, -1.0)
    without_lift = zero_lift_angle(platform)
    best = np.where(dive, *(best_angle_of_attack(platform, heavy=heavy) for heavy in (True, False)))
    reach = lift_sign * (best - without_lift)
    reachable = imbalance(platform, theta, best) <= 0.0
    x = np.where(reachable, reach, np.nan)
    for _ in range(_ITERATIONS):
        alpha = without_lift + lift_sign * x
        rate = lift_sign * imbalance_slope(platform, theta, alpha)
        new = np.clip(x - imbalance(platform, theta, alpha) / rate, 0.0, reach)
        change = np.max(np.abs(new - x), where=reachable, initial=0.0)
        x = new
        if change < _CONVERGED:
            break
    return without_lift + lift_sign * x


def horizontal_speed(platform: Platform, pitch: ArrayLike, depth_rate: ArrayLike) -> Array:
    """Horizontal speed through the water (m/s) ``|v_z / tan(xi)|`` from pitch (rad) and depth rate v_z (m/s)."""
    theta = np.asarray(pitch, dtype=np.float64)
    xi = theta - angle_of_attack(platform, theta)
    return np.abs(np.asarray(depth_rate, dtype=np.float64) / np.tan(xi))


SMOOTHING = 10.0
"""Seconds (or three sample intervals, if longer) over which slopes are taken."""
SPEED_LIMITS = (0.05, 1.0)
"""Speeds (m/s) that limit a guess."""
_MIN_PITCH = np.radians(5.0)


def flight_guesses(platform: Platform, series: ProfileSeries, every: int = 1) -> Array:
    """State guesses ``(g, 12)`` at rows 0, every, 2 every ...

    Measured attitude and depth, glide speed, rates from the slopes; X = Y = 0.
    """
    measurements = series.measurements[::every]
    phi, theta, psi, depth = measurements.T
    slopes = slopes_of(series, every)
    states = np.zeros((len(measurements), 12))
    states[:, 0], states[:, 1], states[:, 2], states[:, 5] = phi, theta, psi, depth
    alpha = np.nan_to_num(angle_of_attack(platform, theta))
    xi = theta - alpha
    steepness = np.maximum(np.abs(np.sin(xi)), np.sin(_MIN_PITCH))
    speed = np.clip(np.abs(slopes[:, 3]) / steepness, *SPEED_LIMITS)
    sin_phi, cos_phi, turn = np.sin(phi), np.cos(phi), slopes[:, 2] * np.cos(theta)
    states[:, 6] = speed * np.cos(alpha)
    states[:, 8] = speed * np.sin(alpha)
    states[:, 9] = slopes[:, 0] - slopes[:, 2] * np.sin(theta)
    states[:, 10] = slopes[:, 1] * cos_phi + turn * sin_phi
    states[:, 11] = -slopes[:, 1] * sin_phi + turn * cos_phi
    return states


def slopes_of(series: ProfileSeries, every: int = 1) -> Array:
    """Slopes ``(g, 4)`` of roll, pitch, heading (rad/s) and depth (m/s), over `SMOOTHING` or three intervals.

    At rows 0, every, 2 every ...
    """
    return smoothed_slope(series.measurements, series.step, _smoothing(series), every)


def depth_rate(series: ProfileSeries) -> Array:
    """Slope ``(n+1,)`` of depth alone, m/s, as in `slopes_of`."""
    return smoothed_slope(series.measurements[:, 3:], series.step, _smoothing(series))[:, 0]


def _smoothing(series: ProfileSeries) -> float:
    return max(SMOOTHING, 3.0 * series.sample_interval)


def smoothed_slope(values: Array, step: float, smoothing: float, every: int = 1) -> Array:
    """Slope a second of the straight line fitted to `smoothing` seconds about each sample; columns apart.

    Near the ends it is that of the first or last full length. Samples 0, every, 2 every ... are treated.
    """
    width = min(round(smoothing / step), len(values) - 1) // 2 * 2 + 1
    if width < 3:
        return np.asarray(np.gradient(values, step, axis=0))[::every]
    reach = width // 2
    lever = np.arange(-reach, reach + 1) / (step * np.sum(np.arange(-reach, reach + 1) ** 2))
    stretches = sliding_window_view(values, width, axis=0)
    rows = np.arange(0, len(values), every)
    inside = (rows >= reach) & (rows < len(values) - reach)
    slopes: Array = np.where(rows[:, None] < reach, stretches[0] @ lever, stretches[-1] @ lever)
    slopes[inside] = stretches[-reach % every :: every] @ lever
    return slopes
