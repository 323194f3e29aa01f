"""Measured velocity relative to the water, from a Doppler profiler or a velocimeter on the glider, as data.

No estimate needs it. Where a record has it, it determines lift and drag, and with them the speed, without the hull.
It is held against the depth rate first: a sensor with the wrong sign, axis or scale must not spoil the estimate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

USUAL_STD = 0.02
"""Standard deviation of a sample (m/s) where the record gives none."""
FASTEST = 3.0
"""Magnitude of a velocity (m/s) beyond which a sample is treated as missing."""

_STEEP = np.radians(8.0)
"""Least pitch of a glide."""
_LEAST_DEPTH = 5.0
"""Depth above which waves move the glider, m."""
_FEWEST = 20
"""Least number of samples on dive, and on climb, from which a velocity is judged."""
_DISAGREEMENT = (0.01, 0.08)
"""Largest difference between the depth rate and that of the measured velocity: in m/s, and relative to the rate."""
_SIDESLIP = 0.3
"""Largest median of the lateral velocity, relative to that of the forward velocity."""
_NORMAL = 1.4826
"""Ratio of a normal distribution's standard deviation to the median of its absolute deviations."""


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


def assess_velocity(
    values: Array, std: Array, angles: Array, depth: Array, rate: Array, steady: NDArray[np.bool_], attack: ArrayLike
) -> RelativeVelocity:
    """Judge the samples of a velocity relative to the water by the rest of the record.

    Parameters
    ----------
    values, std : (n+1, 3), (n+1, 3)
        Samples (m/s) and their standard deviation as the record gives it; NaN where missing.
    angles, depth, rate : (n+1, 2), (n+1,), (n+1,)
        Roll and pitch (rad), depth (m) and its rate (m/s).
    steady : (n+1,) mask
        Points outside the vibration set.
    attack : (n+1,)
        Steady angle of attack of the hull (rad), used only where the normal velocity is not measured.

    Notes
    -----
    A velocity ``(u, v, w)`` changes the depth at the rate ``-u sin(theta) + v sin(phi) cos(theta) + w cos(phi)
    cos(theta)``. The vertical velocity of the water adds the same to dive and climb; half the difference of their
    median residuals is therefore the sensor's. Where the samples scatter more than their standard deviation, their
    scatter takes its place.
    """
    values = np.where(np.abs(values) <= FASTEST, values, np.nan)
    variance = np.square(np.where(std > 0.0, std, USUAL_STD))
    glide = steady & (np.abs(angles[:, 1]) > _STEEP) & (depth > _LEAST_DEPTH)
    refusal = _forward_refusal(values, angles, rate, glide, np.asarray(attack))
    if refusal:
        return RelativeVelocity(np.full_like(values, np.nan), variance, refusal)
    refusal = _lateral_refusal(values[glide])
    if refusal:
        values[:, 1] = np.nan
    for channel in range(3):
        known = np.flatnonzero(np.isfinite(values[:, channel]))
        if len(known) > _FEWEST:
            scatter = _NORMAL * float(np.median(np.abs(np.diff(values[known, channel])))) / np.sqrt(2.0)
            variance[:, channel] = np.maximum(variance[:, channel], scatter**2)
    return RelativeVelocity(values, variance, refusal)


def _forward_refusal(values: Array, angles: Array, rate: Array, glide: NDArray[np.bool_], attack: Array) -> str:
    """Reason why the forward and normal velocity contradict the depth rate; empty if they do not."""
    roll, pitch = angles.T
    forward, lateral, normal = values.T
    normal = np.where(np.isfinite(normal), normal, forward * np.tan(attack))
    expected = (
        -forward * np.sin(pitch)
        + np.nan_to_num(lateral) * np.sin(roll) * np.cos(pitch)
        + normal * np.cos(roll) * np.cos(pitch)
    )
    residual = np.where(glide, rate - expected, np.nan)
    parts = [residual[(rate > 0.0) & np.isfinite(residual)], residual[(rate < 0.0) & np.isfinite(residual)]]
    if min(len(part) for part in parts) < _FEWEST:
        return ""
    dive, climb = (float(np.median(part)) for part in parts)
    typical = float(np.median(np.abs(rate[glide])))
    if 0.5 * abs(dive - climb) <= _DISAGREEMENT[0] + _DISAGREEMENT[1] * typical:
        return ""
    return (
        f"the relative velocity is not used: it contradicts the depth rate by {dive:+.3f} m/s on the dive and "
        f"{climb:+.3f} m/s on the climb; u is forward, v starboard, w downward in the body frame, in m/s"
    )


def _lateral_refusal(values: Array) -> str:
    """Reason why the lateral velocity is not plausible; empty if it is."""
    known = np.isfinite(values[:, :2]).all(axis=1)
    if known.sum() < _FEWEST:
        return ""
    forward, lateral = np.median(values[known, :2], axis=0)
    if abs(lateral) <= _SIDESLIP * abs(forward):
        return ""
    return (
        f"the lateral relative velocity is not used: its median is {lateral:.3f} m/s, with a forward velocity of "
        f"{forward:.3f} m/s"
    )
