"""The glider's own motion: glide-angle relation (eq. 15; Zhou et al.), first guesses of the state, displacements.

Displacements through the water are computed for each step, from the model or from the glide angle, with the vibration
intervals bridged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from gliderhpc.flight.glider import SENSED
from gliderhpc.flight.steady_glide import best_angle_of_attack, imbalance, imbalance_slope, zero_lift_angle
from gliderhpc.observations.dive_phases import floating_points, stationary_points
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_ITERATIONS = 30
_CONVERGED = 1e-12


def angle_of_attack(platform: Platform, pitch: ArrayLike) -> Array:
    """Steady angle of attack (rad) at a pitch (rad); NaN where the path would be flatter than the minimum glide angle.

    Notes
    -----
    With glide angle ``xi = theta - alpha`` the steady balance ``D = -L tan(xi)`` is quadratic in alpha. Its small root
    is eq. 15, with ``K_D0 + K_L0 tan(xi)`` in place of ``K_D0`` where the hull has lift at zero angle of attack. Its
    sign gives lift against the glide, on dive and climb alike. Since ``xi`` depends on alpha, and iteration of eq. 15
    misses the flattest paths, the balance is solved by Newton's method in the distance x from zero lift. The start is
    the minimum drag-to-lift ratio; between there and zero lift the small root is the only one. ``K_M0`` trims the hull
    and does not enter the force balance.
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
"""Time (s) over which slopes are computed, or three sample intervals if longer."""
SPEED_LIMITS = (0.05, 1.0)
"""Limits (m/s) of the speed in a guess."""
_MIN_PITCH = np.radians(5.0)


def flight_guesses(platform: Platform, series: ProfileSeries, every: int = 1) -> Array:
    """State guesses ``(g, 12)`` at rows 0, every, 2 every ...

    They consist of the measured attitude and depth, the glide speed, and rates from the slopes; X = Y = 0.
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


def first_guess(platform: Platform, series: ProfileSeries) -> Array:
    """Guess ``(10,)`` of the sensed states in row 0, as in `flight_guesses`."""
    return np.asarray(flight_guesses(platform, series, len(series.measurements))[0, SENSED])


def slopes_of(series: ProfileSeries, every: int = 1) -> Array:
    """Slopes ``(g, 4)`` of roll, pitch, heading (rad/s) and depth (m/s), over `SMOOTHING` or three intervals.

    They are computed at rows 0, every, 2 every ...
    """
    return smoothed_slope(series.measurements, series.step, smoothing_time(series), every)


def depth_rate(series: ProfileSeries) -> Array:
    """Slope ``(n+1,)`` of the depth, m/s, as in `slopes_of`."""
    return smoothed_slope(series.measurements[:, 3:], series.step, smoothing_time(series))[:, 0]


def smoothing_time(series: ProfileSeries) -> float:
    """Time over which slopes are computed, s: `SMOOTHING`, or three sample intervals if longer."""
    return max(SMOOTHING, 3.0 * series.sample_interval)


def smoothed_slope(values: Array, step: float, smoothing: float, every: int = 1) -> Array:
    """Slope, per second, of the straight line fitted to `smoothing` seconds about each sample, for each column.

    Near the ends it is the slope of the first or last full length. The result has samples 0, every, 2 every ...
    """
    width = min(round(smoothing / step), len(values) - 1) // 2 * 2 + 1
    if width < 3:
        return np.asarray(np.gradient(values, step, axis=0))[::every]
    reach = width // 2
    lever = np.arange(-reach, reach + 1) / (step * np.sum(np.arange(-reach, reach + 1) ** 2))
    windows = sliding_window_view(values, width, axis=0)
    rows = np.arange(0, len(values), every)
    inside = (rows >= reach) & (rows < len(values) - reach)
    slopes: Array = np.where(rows[:, None] < reach, windows[0] @ lever, windows[-1] @ lever)
    slopes[inside] = windows[-reach % every :: every] @ lever
    return slopes


BRIDGE = 30.0
"""Time (s) on either side whose mean velocity bridges an unusable interval."""


@dataclass(frozen=True, eq=False)
class SelfMotion:
    """Displacement through the water at each step.

    Attributes
    ----------
    steps : (n, 2)
        Displacement north and east, m per step, with the unusable intervals bridged.
    bridged : float
        Length (m) of the displacement that was interpolated over those intervals.
    stationary : float
        Time (s) in which the glider was stationary and has no displacement (`stationary_points`).
    floating : float
        Time (s) at the surface between two dives, in which the glider has no displacement (`floating_points`).
    masked_fraction : float
        Share of the steps outside the vibration set and stationary time without a solution of their own.
    """

    steps: Array
    bridged: float
    stationary: float = 0.0
    floating: float = 0.0
    masked_fraction: float = 0.0

    @property
    def total(self) -> Array:
        """Displacement ``(2,)`` over the profile, m."""
        return np.asarray(self.steps.sum(axis=0))


def model_motion(states: Array, vibrating: NDArray[np.bool_], step: float) -> SelfMotion:
    """Displacement of the reference trajectory ``states (n+1, 12)``, with vibration intervals bridged.

    Inside the vibration set the modelled motion is replaced by that of the glide on either side.
    """
    steps = np.diff(states[:, 3:5], axis=0)
    bridged = bridge(steps, vibrating[:-1], round(BRIDGE / step))
    return SelfMotion(bridged, float(np.linalg.norm(bridged[vibrating[:-1]].sum(axis=0))))


def glide_angle_motion(platform: Platform, series: ProfileSeries, vibrating: NDArray[np.bool_]) -> SelfMotion:
    """Displacement by the glide-angle method (eq. 15): pitch and depth rate give the speed, the compass the course.

    Samples flatter than the hull's minimum glide angle have no solution. They are bridged like the vibration set, and
    their share is recorded (`SelfMotion.masked_fraction`). A stationary glider has no motion of its own, nor has one
    that floats at the surface between two dives.
    """
    _, theta, psi, _ = series.measurements[:-1].T
    # A measured velocity would show by itself whether a glider at one depth moves, as with a thruster.
    stationary = stationary_points(series)[:-1] & (series.velocity is None)
    floating = floating_points(series)[:-1] & ~stationary
    speed = horizontal_speed(platform, theta, depth_rate(series)[:-1])
    unsolved = ~np.isfinite(speed)
    steps = series.step * np.column_stack([speed * np.cos(psi), speed * np.sin(psi)])
    still = stationary | floating
    steps[still] = 0.0
    steady = ~vibrating[:-1] & ~still
    unusable = (unsolved | vibrating[:-1]) & ~still
    bridged = bridge(np.where(unusable[:, None], 0.0, steps), unusable, round(BRIDGE / series.step))
    masked = float(unsolved[steady].mean()) if steady.any() else 1.0
    length = float(np.linalg.norm(bridged[unusable].sum(axis=0)))
    return SelfMotion(
        bridged, length, float(stationary.sum()) * series.step, float(floating.sum()) * series.step, masked
    )


def bridge(steps: Array, unusable: NDArray[np.bool_], reach: int) -> Array:
    """Replace the steps of each unusable interval by a straight line between the mean steps on either side.

    The means are over the usable ones of the nearest `reach` steps on each side. At an end of the record the mean of
    the other side is used for both. Without a usable step anywhere the steps are unchanged.
    """
    out = steps.copy()
    usable = ~unusable
    if not usable.any():
        return out
    for begin, end in stretches(unusable):
        before = _mean(steps[max(0, begin - reach) : begin], usable[max(0, begin - reach) : begin])
        after = _mean(steps[end : end + reach], usable[end : end + reach])
        first = after if before is None else before
        last = before if after is None else after
        if first is None or last is None:
            first = last = np.asarray(steps[usable].mean(axis=0))
        weight = ((np.arange(begin, end) - begin + 0.5) / (end - begin))[:, None]
        out[begin:end] = (1.0 - weight) * first + weight * last
    return out


def _mean(steps: Array, usable: NDArray[np.bool_]) -> Array | None:
    return np.asarray(steps[usable].mean(axis=0)) if usable.any() else None
