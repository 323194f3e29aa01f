"""Offset of the pitch by the depth rates of steady dives against those of steady climbs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from gliderhpc.estimation.glide_angle import angle_of_attack
from gliderhpc.estimation.record_checks.finding import CheckSettings, Finding, judged, undetermined
from gliderhpc.estimation.record_checks.robust import biweights, left_out_covariance, solved
from gliderhpc.estimation.steady_segments import SteadySegments
from gliderhpc.platform import GRAVITY, Platform

Array = NDArray[np.float64]

CHECK, UNIT = "dive against climb", "degree"
PITCH, VOLUME = "offset of the pitch", "offset of the neutral volume"

LEAST_PROFILES = 3
_PASSES = 6
_SCALES = np.array([1e-2, 1e-5, 0.1, 0.1, 0.1, 0.1])
"""Of what is fitted: offset of the pitch (rad), of the neutral volume (m3), relative ones of K_D0, K_D, K_L, slope."""
_STEP = 1e-2
"""For derivatives, in those scales."""
_LEAST_SCALE = 1e-4
"""Scatter of the depth rate (m/s) below which no segment is an outlier."""
_SLOPE_ERROR = 0.5
"""Relative error of the gain in buoyancy with depth: compressibility and the density of the water together."""

SEPARATED = np.radians(0.5)
"""With a standard error below this (rad) the offset of the pitch is told apart from one of the neutral volume."""


@dataclass(frozen=True, eq=False)
class _Fit:
    """Offset of the pitch (rad) and of the neutral volume (m3), their covariance, and the number of profiles."""

    values: Array
    covariance: Array

    @property
    def errors(self) -> Array:
        return np.sqrt(np.diag(self.covariance))


def pitch_findings(platform: Platform, segments: SteadySegments | None, checks: CheckSettings) -> list[Finding]:
    """Estimate the offset of the pitch.

    Parameters
    ----------
    platform : Platform
        The hull.
    segments : SteadySegments, optional
        Steady flight of some profiles; None where there is none.
    checks : CheckSettings
        When an offset counts.

    Notes
    -----
    In steady flight ``V^2 = -W sin(theta - alpha) / (K_D0 + K_D alpha^2)`` with the net weight W and alpha by eq. 15,
    and the depth rate is ``-V sin(theta - alpha)``. Pitch read too high makes dives faster than they should be and
    climbs slower; so does a hull heavier than it is taken to be. The two differ only as the depth rate goes with the
    root of the buoyancy and with the cotangent of the path: a mission flown at one pitch and two buoyancies hardly
    tells them apart. Both are fitted together; where that leaves the pitch open by more than half a degree, the neutral
    volume is held and either explanation is named. Drag, lift and the gain in buoyancy with depth are fitted too, as
    prior knowledge with the relative errors of the settings. Segments are weighted by Tukey's biweight; errors are by
    leaving one profile out, and by the coefficients'.
    """
    if segments is None or len(np.unique(segments.profile)) < LEAST_PROFILES:
        return [undetermined(CHECK, PITCH, UNIT, f"fewer than {LEAST_PROFILES} profiles with steady flight")]
    diving = segments.depth_rate > 0.0
    if min(np.count_nonzero(diving), np.count_nonzero(~diving)) < LEAST_PROFILES:
        return [undetermined(CHECK, PITCH, UNIT, "steady dives, or steady climbs, are missing")]
    free = _fitted(platform, segments, checks, volume_known=False)
    quantile = float(student.ppf(1.0 - 0.5 * checks.level, len(np.unique(segments.profile)) - 1))
    if free is not None and free.errors[0] < SEPARATED:
        return _both(free, quantile, checks)
    held = _fitted(platform, segments, checks, volume_known=True)
    return [_either(held, free, quantile, checks)]


def _both(free: _Fit, quantile: float, checks: CheckSettings) -> list[Finding]:
    offset, error = np.degrees(free.values[0]), np.degrees(free.errors[0])
    threshold = max(quantile * error, checks.least_pitch)
    pitch = Finding(
        CHECK, PITCH, UNIT, offset, error, threshold, judged(offset, threshold),
        f"--set records.pitch_offset={offset:.2f}", "neutral volume fitted with it",
    )  # fmt: skip
    volume, error = 1e6 * free.values[1], 1e6 * free.errors[1]
    # What an offset of the pitch of the least size would be taken for is the size below which a volume says nothing.
    threshold = quantile * error
    return [
        pitch,
        Finding(
            CHECK, VOLUME, "cm3", volume, error, threshold, judged(volume, threshold), "calibrate the hull",
            "belongs to the hull, not to the records",
        ),
    ]  # fmt: skip


def _either(held: _Fit | None, free: _Fit | None, quantile: float, checks: CheckSettings) -> Finding:
    if held is None:
        return undetermined(CHECK, PITCH, UNIT, "the hull's balance does not fit these glides; calibrate the hull")
    offset, error = np.degrees(held.values[0]), np.degrees(held.errors[0])
    threshold = max(quantile * error, checks.least_pitch)
    apart = "not told apart" if free is None else f"known to {np.degrees(free.errors[0]):.1f} degree if both are open"
    return Finding(
        CHECK, PITCH, UNIT, offset, error, threshold, judged(offset, threshold),
        f"--set records.pitch_offset={offset:.2f}, or calibrate the neutral volume: these glides cannot tell which",
        f"neutral volume taken as known; {apart}",
    )  # fmt: skip


def _fitted(platform: Platform, segments: SteadySegments, checks: CheckSettings, *, volume_known: bool) -> _Fit | None:
    """Gauss-Newton fit in units of `_SCALES`; None where too few segments have a steady glide near their pitch."""
    relative = checks.coefficient_error
    spread = np.array([np.inf, np.inf, relative, relative, relative, _SLOPE_ERROR]) / _SCALES
    open_ = np.flatnonzero((spread > 0.0) & ~(volume_known & (np.arange(len(_SCALES)) == 1)))
    prior = spread[open_] ** -2.0
    values = np.zeros(len(_SCALES))
    for _ in range(_PASSES):
        residuals = segments.depth_rate - _depth_rate(platform, segments, values)
        jacobian = _jacobian(platform, segments, values)[:, open_]
        known = np.isfinite(residuals) & np.isfinite(jacobian).all(axis=1)
        if np.count_nonzero(known) < 0.5 * len(known):
            return None
        design, left = jacobian[known], residuals[known]
        weights = biweights(left, _LEAST_SCALE)
        normal = design.T @ (weights[:, None] * design) + np.diag(prior)
        values[open_] += solved(normal, design.T @ (weights * left) - prior * values[open_])
    covariance = left_out_covariance(design, weights, left, segments.profile[known], prior)
    deviations = np.zeros((len(_SCALES), len(_SCALES)))
    deviations[np.ix_(open_, open_)] = covariance
    scale = np.outer(_SCALES, _SCALES)
    return _Fit((values * _SCALES)[:2], (deviations * scale)[:2, :2])


def _jacobian(platform: Platform, segments: SteadySegments, values: Array) -> Array:
    columns = []
    for place in range(len(_SCALES)):
        moved = np.zeros(len(_SCALES))
        moved[place] = _STEP
        above, below = (_depth_rate(platform, segments, values + sign * moved) for sign in (1.0, -1.0))
        columns.append((above - below) / (2.0 * _STEP))
    return np.column_stack(columns)


def _depth_rate(platform: Platform, segments: SteadySegments, values: Array) -> Array:
    """Steady depth rate (m/s) at the pitch read less its offset; NaN without a steady glide."""
    offset, volume, drag, induced, lift, slope = values * _SCALES
    viscous = platform.viscous
    hull = platform.model_copy(update={
        "viscous": viscous.model_copy(update={
            "K_D0": viscous.K_D0 * (1.0 + drag), "K_D": viscous.K_D * (1.0 + induced), "K_L": viscous.K_L * (1.0 + lift)
        })
    })  # fmt: skip
    buoyancy = platform.buoyancy
    displaced = segments.actuators[:, 2] - buoyancy.neutral_volume_m3 - volume
    weight = -GRAVITY * buoyancy.water_density * displaced - (1.0 + slope) * buoyancy.depth_slope * segments.depth
    pitch = segments.pitch - offset
    alpha = angle_of_attack(hull, pitch)
    path = pitch - alpha
    squared = -weight * np.sin(path) / (hull.viscous.K_D0 + hull.viscous.K_D * alpha**2)
    return np.asarray(-np.sqrt(np.where(squared > 0.0, squared, np.nan)) * np.sin(path))
