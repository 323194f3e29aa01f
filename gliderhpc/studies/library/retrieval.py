"""Depth-resolved current of one profile: eq. 41 along the dive, smoothed, and turned to north and east (section 5.4).

The hull follows the water in sideslip within seconds. The yaw moment therefore responds to the rate of change of the
current across the hull along the path, rather than to the current itself (docs/theory/currents.md). The result is the
shear-sensitive part of the current.

At each sample, the root of eq. 41 is bracketed, starting from an interval around zero whose width follows from the
first-order solution, and found by Chandrupatla's method (scipy). To first order

    v_c = -B / [(K_MY + K_MR sin(alpha) + M_f1 - M_f2) u]

(docs/theory/currents.md). A draw of the four coefficients in the bracket therefore scales the solution by the ratio of
the brackets, and needs no other inversion or solution. Where the viscous and the Munk moment nearly cancel, the bracket
is a small difference of large numbers. The condition number is the sum of the terms' magnitudes over the magnitude of
their sum; it is the factor by which an error of the coefficients is amplified.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.archive.profile import ProfileData
from gliderhpc.estimation.settings import Settings
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import munk_moment
from gliderhpc.kernels.points import viscous_yaw_moments
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import states_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BRACKET_MARGIN = 1.5
"""Half width of the initial search interval, relative to the first-order solution."""
_MIN_BRACKET = 1e-6
"""Minimum half width of the initial search interval, m/s."""
_ROOT_TOLERANCE = 1e-9
"""Tolerance of a root, m/s."""

_YAW = 5

_TIME_TOLERANCE = 1e-5
"""Tolerance for differences between the times of samples and records, s."""


@dataclass(frozen=True, eq=False)
class LateralFlow:
    """Solution of eq. 41.

    Attributes
    ----------
    current : (n,)
        Current v_c along the body's y axis, m/s, positive to starboard; NaN without a root.
    gain : (n,)
        Ratio of the yaw moment to -v_c, to first order, N s: the bracket times u.
    condition : (n,)
        Sum of the magnitudes of the bracket's terms over the magnitude of their sum.
    rootless : (n,) mask
        Samples whose equation has no root within the limit.
    """

    current: Array
    gain: Array
    condition: Array
    rootless: Mask


def bracket_terms(platform: Platform, angle_of_attack: Array) -> Array:
    """Terms ``(4, n)`` of the bracket, kg: ``K_MY``, ``K_MR sin(alpha)``, ``M_f1`` and ``-M_f2``."""
    viscous, added = platform.viscous, platform.added_mass
    sine = np.sin(angle_of_attack)
    constant = np.array([viscous.K_MY, 0.0, added[0], -added[1]])
    return np.asarray(constant[:, None] + np.outer([0.0, viscous.K_MR, 0.0, 0.0], sine))


def solve_lateral_flow(glider: Glider, motion: Array, rudder: Array, moment: Array, limit: float) -> LateralFlow:
    """Solve eq. 41 for the current across the hull.

    Parameters
    ----------
    glider : Glider
        The hull.
    motion : (n, 6)
        Velocities u, v, w (m/s) and rates p, q, r (rad/s) through the water.
    rudder : (n,)
        Rudder angle, rad.
    moment : (n,)
        Filtered B_cr, N m; samples that are not finite are not solved.
    limit : float
        Largest |v_c| of a root, m/s.
    """
    terms = bracket_terms(glider.platform, np.arctan2(motion[:, 2], motion[:, 0]))
    bracket = terms.sum(axis=0)
    with np.errstate(divide="ignore"):
        condition = np.abs(terms).sum(axis=0) / np.abs(bracket)
    posed = np.isfinite(moment) & np.isfinite(motion).all(axis=1)
    current = np.full(len(moment), np.nan)
    gain = bracket * motion[:, 0]
    if posed.any():
        current[posed] = _roots(glider, motion[posed], rudder[posed], moment[posed], gain[posed], limit)
    return LateralFlow(current, gain, condition, posed & ~np.isfinite(current))


def _roots(glider: Glider, motion: Array, rudder: Array, moment: Array, gain: Array, limit: float) -> Array:
    from scipy.optimize import elementwise

    # The moment without a current is the same at every iteration.
    wanted = moment + _yaw_moments(glider, motion, rudder)

    def left_over(current: Array, row: Array) -> Array:
        rows = row.astype(np.int64)
        return _in_current(glider, motion[rows], rudder[rows], current) - wanted[rows]

    rows = np.arange(len(moment), dtype=np.float64)
    with np.errstate(divide="ignore"):
        reach = np.clip(_BRACKET_MARGIN * np.abs(moment / gain), _MIN_BRACKET, 0.5 * limit)
    bounds = elementwise.bracket_root(left_over, -reach, reach, xmin=-limit, xmax=limit, args=(rows,))
    roots = np.full(len(moment), np.nan)
    bracketed = bounds.success
    if bracketed.any():
        low, high = bounds.bracket
        solution = elementwise.find_root(
            left_over, (low[bracketed], high[bracketed]), args=(rows[bracketed],), tolerances={"xatol": _ROOT_TOLERANCE}
        )
        roots[bracketed] = np.where(solution.success, solution.x, np.nan)
    return roots


def _in_current(glider: Glider, motion: Array, rudder: Array, current: Array) -> Array:
    """Viscous yaw moment in a lateral current, minus the Munk moment of that current."""
    moved = motion.copy()
    moved[:, 1] -= current
    return _yaw_moments(glider, moved, rudder) - munk_moment(glider.platform) * motion[:, 0] * current


def _yaw_moments(glider: Glider, motion: Array, rudder: Array) -> Array:
    moments = np.empty(len(motion))
    viscous_yaw_moments(glider.hull, np.ascontiguousarray(motion), np.ascontiguousarray(rudder), moments)
    return moments


def scale_draws(platform: Platform, angle_of_attack: Array, error: float, draws: int, seed: int) -> Array:
    """Factors ``(m, draws)`` of the lateral current for draws of the coefficients.

    Parameters
    ----------
    platform : Platform
        The hull.
    angle_of_attack : (m,)
        Angle of attack, rad.
    error : float
        Relative error within which K_MY, K_MR, M_f1 and M_f2 are drawn uniformly and independently.
    draws, seed : int
        Number of draws, and seed of the random numbers.
    """
    factors = np.random.default_rng(seed).uniform(1.0 - error, 1.0 + error, (draws, 4))
    terms = bracket_terms(platform, angle_of_attack)
    return np.asarray(terms.sum(axis=0)[:, None] / (terms.T @ factors.T))


def half_width(draws: Array, axis: int) -> Array:
    """Half the range of the central 68 % along an axis, which for normal draws is the standard deviation.

    Draws are unbounded where the bracket nearly vanishes, so their standard deviation would not exist.
    """
    low, high = np.quantile(draws, [0.16, 0.84], axis=axis)
    return np.asarray(0.5 * (high - low))


class DepthResolvedSettings(Settings):
    """Settings of the retrieval by eq. 41, its filters and its errors (section 5.4, docs/theory/currents.md)."""

    baseline: float = Field(60.0, gt=0, description="length of the moving average removed from the yaw moment, s")
    smoothing: float = Field(15.0, gt=0, description="length of the Savitzky-Golay window, s")
    order: int = Field(3, ge=1, description="order of its polynomial")
    limit: float = Field(1.0, gt=0, description="largest lateral current that counts as a root, m/s")
    largest_condition: float = Field(10.0, gt=1, description="samples with a larger condition number are masked")
    coefficient_error: float = Field(0.15, ge=0, lt=1, description="relative error of the moment coefficients")
    largest_doubt: float = Field(
        0.05, gt=0, lt=1, description="largest share of coefficient draws with the opposite sign of the yaw moment"
    )
    draws: int = Field(300, ge=2, description="number of draws of the moment coefficients")
    seed: int = Field(0, ge=0, description="seed of these draws")
    bin: float = Field(10.0, ge=0.1, description="depth of a bin, m")
    actuation_error: float | None = Field(
        None, ge=0, description="relative error of the displacement bridged while actuators move; default as the run's"
    )


def without_baseline(values: Array, samples: int) -> Array:
    """Subtract the centred moving average over `samples` from values ``(n,)``; missing ones stay missing, weight zero.

    At both ends of the record the window is truncated, and the average is over fewer samples.
    """
    known = np.isfinite(values)
    window = max(1, samples)
    total = scipy.ndimage.uniform_filter1d(np.where(known, values, 0.0), window, mode="constant")
    weight = scipy.ndimage.uniform_filter1d(known.astype(np.float64), window, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, values - total / weight, np.nan)


def smoothing_samples(samples: int, order: int) -> int:
    """Odd length of the requested Savitzky-Golay window in samples, large enough for its order."""
    return max(samples | 1, (order + 1) | 1)


def smooth_stretches(values: Array, samples: int, order: int) -> Array:
    """Smooth each unbroken stretch of values ``(n,)`` (Savitzky-Golay); NaN in stretches shorter than the window."""
    window = smoothing_samples(samples, order)
    out = np.full_like(values, np.nan)
    for first, stop in stretches(np.isfinite(values)):
        if stop - first >= window:
            out[first:stop] = scipy.signal.savgol_filter(values[first:stop], window, order)
    return out


@dataclass(frozen=True, eq=False)
class Retrieval:
    """Solution of eq. 41 on the ``m`` records.

    Attributes
    ----------
    moment : (m,)
        Yaw moment without its baseline, N m, mean over the record.
    lateral : (m,)
        Current across the hull, m/s, positive to starboard; NaN where it is masked.
    horizontal : (m, 2)
        Same current, turned to north and east by the measured attitude.
    across : (m, 2)
        North and east components of the hull's y axis.
    angle_of_attack, gain, condition : (m,)
        Angle of attack, rad; gain, N s, and condition number, 1 (see `LateralFlow`).
    rootless, ill_conditioned, interrupted : int
        Samples without a root, with a condition number beyond the limit, and in stretches too short to smooth.
    """

    moment: Array
    lateral: Array
    horizontal: Array
    across: Array
    angle_of_attack: Array
    gain: Array
    condition: Array
    rootless: int
    ill_conditioned: int
    interrupted: int


@dataclass(frozen=True, eq=False)
class SampledFlow:
    """Current across the hull on the ``n`` samples, before the means over records.

    Attributes
    ----------
    moment : (n,)
        Yaw moment without its baseline, N m.
    lateral : (n,)
        Smoothed current across the hull, m/s, positive to starboard; NaN where it is masked.
    gain, condition : (n,)
        Gain, N s, and condition number, 1 (see `LateralFlow`).
    rootless, ill_conditioned, interrupted : int
        Numbers of samples as in `Retrieval`.
    """

    moment: Array
    lateral: Array
    gain: Array
    condition: Array
    rootless: int
    ill_conditioned: int
    interrupted: int


def sampled_flow(
    glider: Glider, motion: Array, rudder: Array, yaw_moment: Array, step: float, settings: DepthResolvedSettings
) -> SampledFlow:
    """Subtract the baseline, solve eq. 41 and smooth the solution.

    Parameters
    ----------
    glider : Glider
        Hull that the disturbance was estimated with.
    motion : (n, 6)
        Velocities u, v, w (m/s) and rates p, q, r (rad/s) through the water.
    rudder : (n,)
        Rudder angle, rad.
    yaw_moment : (n,)
        Yaw moment B_cr, N m; NaN where it must not be used.
    step : float
        Time between samples, s.
    settings : DepthResolvedSettings
        Windows and limits.
    """
    moment = without_baseline(yaw_moment, round(settings.baseline / step))
    solved = solve_lateral_flow(glider, motion, rudder, moment, settings.limit)
    well = solved.condition <= settings.largest_condition
    sound = np.where(well, solved.current, np.nan)
    smooth = smooth_stretches(sound, round(settings.smoothing / step), settings.order)
    return SampledFlow(
        moment=moment,
        lateral=smooth,
        gain=solved.gain,
        condition=solved.condition,
        rootless=int(solved.rootless.sum()),
        ill_conditioned=int((np.isfinite(moment) & ~well).sum()),
        interrupted=int((np.isfinite(sound) & ~np.isfinite(smooth)).sum()),
    )


def retrieve(data: ProfileData, glider: Glider, settings: DepthResolvedSettings) -> Retrieval:
    """Retrieve the current across the hull of one profile.

    Parameters
    ----------
    data : ProfileData
        The profile.
    glider : Glider
        Hull that the profile was estimated with.
    settings : DepthResolvedSettings
        Windows and limits.
    """
    states = states_of(data)
    motion = np.column_stack([np.interp(data.time, data.record_time, column) for column in states[:, 6:].T])
    rudder = np.interp(data.time, data.record_time, np.radians(data.controls[:, 3]))
    yaw_moment = np.where(data.steady & data.converged, data.disturbances[:, _YAW], np.nan)
    flow = sampled_flow(glider, motion, rudder, yaw_moment, data.step, settings)
    lateral = _on_records(data, flow.lateral)
    across = starboard(np.radians(data.measured[:, :3]))
    return Retrieval(
        moment=_on_records(data, flow.moment),
        lateral=lateral,
        horizontal=lateral[:, None] * across,
        across=across,
        angle_of_attack=np.arctan2(states[:, 8], states[:, 6]),
        gain=_on_records(data, flow.gain),
        condition=_on_records(data, flow.condition),
        rootless=flow.rootless,
        ill_conditioned=flow.ill_conditioned,
        interrupted=flow.interrupted,
    )


def _on_records(data: ProfileData, values: Array) -> Array:
    """Mean ``(m,)`` over the samples ``(n,)`` of each record; NaN if none is known."""
    where = np.searchsorted(data.record_time, data.time + _TIME_TOLERANCE, side="right") - 1
    known = np.isfinite(values)
    size = len(data.record_time)
    total = np.bincount(where[known], values[known], minlength=size)
    count = np.bincount(where[known], minlength=size)
    return np.asarray(np.divide(total, count, out=np.full(size, np.nan), where=count > 0))


def starboard(attitude: Array) -> Array:
    """North and east components ``(m, 2)`` of the body's y axis at ``attitude (m, 3)`` (rad), from R_eb (eq. 4)."""
    roll, pitch, heading = attitude.T
    roll_pitch = np.sin(roll) * np.sin(pitch)
    return np.column_stack(
        [
            roll_pitch * np.cos(heading) - np.cos(roll) * np.sin(heading),
            roll_pitch * np.sin(heading) + np.cos(roll) * np.cos(heading),
        ]
    )
