"""The glider's horizontal displacement through the water, step by step, with the vibration intervals bridged."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.glide_angle import depth_rate, horizontal_speed
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

BRIDGE = 30.0
"""Seconds on either side whose mean velocity carries over an interval that is not believed."""


@dataclass(frozen=True, eq=False)
class SelfMotion:
    """Displacement through the water a step.

    Attributes
    ----------
    steps : (n, 2)
        North and east, m a step, with the intervals that are not believed bridged.
    bridged : float
        Length (m) of the displacement that was put into those intervals.
    masked_fraction : float
        Share of the steps outside the vibration set that had no solution of their own.
    """

    steps: Array
    bridged: float
    masked_fraction: float = 0.0

    @property
    def total(self) -> Array:
        """Displacement ``(2,)`` over the profile, m."""
        return np.asarray(self.steps.sum(axis=0))


def model_motion(states: Array, vibrating: NDArray[np.bool_], step: float) -> SelfMotion:
    """Displacement of the reference trajectory ``states (n+1, 12)``, vibration intervals bridged.

    Inside the vibration set the modelled motion is not believed; its time counts and its displacement is that of the
    glide on either side.
    """
    steps = np.diff(states[:, 3:5], axis=0)
    bridged = bridge(steps, vibrating[:-1], round(BRIDGE / step))
    return SelfMotion(bridged, float(np.linalg.norm(bridged[vibrating[:-1]].sum(axis=0))))


def glide_angle_motion(platform: Platform, series: ProfileSeries, vibrating: NDArray[np.bool_]) -> SelfMotion:
    """Displacement by the glide-angle method (eq. 15): pitch and depth rate give the speed, the compass the course.

    Samples below the hull's least glide angle have no solution: they are bridged like the vibration set, and counted.
    """
    _, theta, psi, _ = series.measurements[:-1].T
    speed = horizontal_speed(platform, theta, depth_rate(series)[:-1])
    unsolved = ~np.isfinite(speed)
    steps = series.step * np.column_stack([speed * np.cos(psi), speed * np.sin(psi)])
    steady = ~vibrating[:-1]
    unbelieved = unsolved | vibrating[:-1]
    bridged = bridge(np.where(unbelieved[:, None], 0.0, steps), unbelieved, round(BRIDGE / series.step))
    masked = float(unsolved[steady].mean()) if steady.any() else 1.0
    return SelfMotion(bridged, float(np.linalg.norm(bridged[unbelieved].sum(axis=0))), masked)


def bridge(steps: Array, unbelieved: NDArray[np.bool_], reach: int) -> Array:
    """Replace the steps of each unbelieved interval by a straight line between the mean steps on either side.

    The means are over the nearest `reach` believed steps that touch the interval; at an end of the record the one side
    stands for both. Without a believed step anywhere the steps are left alone.
    """
    out = steps.copy()
    believed = ~unbelieved
    if not believed.any():
        return out
    for begin, end in stretches(unbelieved):
        before = _mean(steps[max(0, begin - reach) : begin], believed[max(0, begin - reach) : begin])
        after = _mean(steps[end : end + reach], believed[end : end + reach])
        first = after if before is None else before
        last = before if after is None else after
        if first is None or last is None:
            first = last = np.asarray(steps[believed].mean(axis=0))
        weight = ((np.arange(begin, end) - begin + 0.5) / (end - begin))[:, None]
        out[begin:end] = (1.0 - weight) * first + weight * last
    return out


def _mean(steps: Array, believed: NDArray[np.bool_]) -> Array | None:
    return np.asarray(steps[believed].mean(axis=0)) if believed.any() else None
