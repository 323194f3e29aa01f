"""Measured velocity relative to the water, from a Doppler profiler or a velocimeter on the glider.

No estimate needs it. Where a record has it, it determines lift, drag and speed. It is compared with the depth rate
first: a sensor with the wrong sign, axis or scale must not corrupt the estimate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.distributions import MAD_TO_STD
from gliderhpc.estimation.self_motion import angle_of_attack, depth_rate
from gliderhpc.observations.format import MAX_VELOCITY
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

USUAL_STD = 0.02
"""Standard deviation of a sample (m/s) where the record gives none."""

MIN_GLIDE_PITCH = np.radians(8.0)
"""Minimum magnitude of the pitch in a glide, rad."""
MIN_DEPTH = 5.0
"""Depth above which waves move the glider, m; samples above it are not used."""
MIN_SAMPLES = 20
"""Minimum number of samples of a dive or a climb for a check of the velocity."""
_DISAGREEMENT = (0.01, 0.08)
"""Largest difference between the depth rate and that of the measured velocity: in m/s, and relative to the rate."""
_ONE_LEG_DISAGREEMENT = (0.05, 0.08)
"""The same for samples of dives or climbs alone, where the water's vertical velocity is part of the difference."""
_SIDESLIP = 0.3
"""Largest median of the lateral velocity, relative to that of the forward velocity."""


@dataclass(frozen=True, eq=False)
class RelativeVelocity:
    """Samples of the velocity relative to the water at the points of a profile.

    Attributes
    ----------
    values, variance : (n+1, 3), (n+1, 3)
        Velocity in the body frame (m/s), NaN where there is no sample or it is refused, and its variance (m2/s2).
    refusal : str
        Reason why samples are refused; empty if none are.
    """

    values: Array
    variance: Array
    refusal: str = ""

    @property
    def is_empty(self) -> bool:
        """Return whether no sample is left."""
        return not np.isfinite(self.values).any()


def measured_velocity(platform: Platform, series: ProfileSeries, steady: Mask) -> RelativeVelocity | None:
    """Judge a profile's measured velocity by the rest of its record (`assess_velocity`); None if it has none.

    Parameters
    ----------
    platform : Platform
        Hull, whose angle of attack is used where the normal velocity is not measured.
    series : ProfileSeries
        Record at its ``n + 1`` points.
    steady : (n+1,) mask
        Points outside the vibration set.
    """
    if series.velocity is None or series.velocity_std is None:
        return None
    angles, depth = series.measurements[:, :2], series.measurements[:, 3]
    attack = np.nan_to_num(angle_of_attack(platform, angles[:, 1]))
    usable = steady & (series.weights > 0.0)
    return assess_velocity(
        series.velocity,
        series.velocity_std,
        angles=angles,
        depth=depth,
        rate=depth_rate(series),
        usable=usable,
        attack=attack,
    )


def assess_velocity(
    values: Array, std: Array, *, angles: Array, depth: Array, rate: Array, usable: Mask, attack: ArrayLike
) -> RelativeVelocity:
    """Judge the samples of a velocity relative to the water by the rest of the record.

    Parameters
    ----------
    values, std : (n+1, 3), (n+1, 3)
        Samples (m/s) and their standard deviation as the record gives it; NaN where missing. Where the deviation is
        not a positive number, it is `USUAL_STD`.
    angles, depth, rate : (n+1, 2), (n+1,), (n+1,)
        Roll and pitch (rad), depth (m) and its rate (m/s).
    usable : (n+1,) mask
        Points outside the vibration set and the gaps of the record.
    attack : (n+1,)
        Steady angle of attack of the hull (rad), used only where the normal velocity is not measured.

    Returns
    -------
    RelativeVelocity
        The samples that are used, with their variances, and the reason why others are not.

    Notes
    -----
    A velocity ``(u, v, w)`` changes the depth at the rate ``-u sin(theta) + v sin(phi) cos(theta) + w cos(phi)
    cos(theta)``. The vertical velocity of the water adds the same to dive and climb; half the difference of their
    median residuals is therefore the sensor's. Where the samples scatter more than their standard deviation, their
    scatter takes its place.
    """
    deep = np.isfinite(depth) & (depth > MIN_DEPTH)
    usable_values = (np.abs(values) <= MAX_VELOCITY) & ~np.isinf(std) & deep[:, None]
    values = np.where(usable_values, values, np.nan)
    variance = np.square(np.where((std > 0.0) & np.isfinite(std), std, USUAL_STD))
    glide = usable & deep & (np.abs(angles[:, 1]) > MIN_GLIDE_PITCH)
    refusal = _refusal_by_depth_rate(values, angles, rate, glide, np.asarray(attack))
    if refusal:
        return RelativeVelocity(np.full_like(values, np.nan), variance, refusal)
    refusal = _lateral_refusal(values[glide])
    if refusal:
        values[:, 1] = np.nan
    for channel in range(3):
        known = np.flatnonzero(np.isfinite(values[:, channel]))
        if len(known) > MIN_SAMPLES:
            scatter = MAD_TO_STD * float(np.median(np.abs(np.diff(values[known, channel])))) / np.sqrt(2.0)
            variance[:, channel] = np.maximum(variance[:, channel], scatter**2)
    return RelativeVelocity(values, variance, refusal)


def _refusal_by_depth_rate(values: Array, angles: Array, rate: Array, glide: Mask, attack: Array) -> str:
    """Reason why the velocity cannot be used, given the depth rate; empty if it can, or if there are no samples."""
    if not np.isfinite(values).any():
        return ""
    roll, pitch = angles.T
    forward, lateral, normal = values.T
    normal = np.where(np.isfinite(normal), normal, forward * np.tan(attack))
    expected = (
        -forward * np.sin(pitch)
        + np.nan_to_num(lateral) * np.sin(roll) * np.cos(pitch)
        + normal * np.cos(roll) * np.cos(pitch)
    )
    residual = np.where(glide, rate - expected, np.nan)
    legs = [residual[leg & np.isfinite(residual)] for leg in (rate > 0.0, rate < 0.0)]
    medians = [float(np.median(leg)) for leg in legs if len(leg) >= MIN_SAMPLES]
    if not medians:
        return (
            f"the relative velocity is not used: it has fewer than {MIN_SAMPLES} samples of u in steady glide below "
            f"{MIN_DEPTH:g} m, too few to compare with the depth rate"
        )
    typical = float(np.median(np.abs(rate[glide])))
    has_both_legs = len(medians) == len(legs)
    difference = 0.5 * abs(medians[0] - medians[1]) if has_both_legs else abs(medians[0])
    absolute, relative = _DISAGREEMENT if has_both_legs else _ONE_LEG_DISAGREEMENT
    if difference <= absolute + relative * typical:
        return ""
    residuals = " and ".join(
        f"{float(np.median(leg)):+.3f} m/s on the {name}"
        for leg, name in zip(legs, ("dive", "climb"), strict=True)
        if len(leg) >= MIN_SAMPLES
    )
    return (
        f"the relative velocity is not used: it contradicts the depth rate by {residuals}; u is forward, v starboard, "
        "w downward in the body frame, in m/s"
    )


def _lateral_refusal(values: Array) -> str:
    """Reason why the lateral velocity is not plausible; empty if it is."""
    known = np.isfinite(values[:, :2]).all(axis=1)
    if known.sum() < MIN_SAMPLES:
        return ""
    forward, lateral = np.median(values[known, :2], axis=0)
    if abs(lateral) <= _SIDESLIP * abs(forward):
        return ""
    return (
        f"the lateral relative velocity is not used: its median is {lateral:.3f} m/s, with a forward velocity of "
        f"{forward:.3f} m/s"
    )
