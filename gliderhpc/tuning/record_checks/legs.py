"""One profile as a leg: its current by the glide angle, and what an error of compass or speed makes of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.corrections import harmonics
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import depth_averaged_current
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion
from gliderhpc.estimation.vibration import vibration_set
from gliderhpc.observations import ProfileRecord, ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

LEAST_LENGTH = 1.0
"""Displacement through the water (m) below which a profile has no glide of its own, but rounding errors."""


@dataclass(frozen=True, eq=False)
class Leg:
    """What a profile says of the compass.

    Attributes
    ----------
    time : float
        Of its first sample, s since 1970.
    current : (2,)
        North and east by the glide-angle track, m/s.
    by_error : (2, 5)
        Its derivatives by an error of the heading: constant, and times `harmonics`, m/s a rad.
    by_speed : (2,)
        Its derivative by a relative error of the speed, m/s.
    """

    time: float
    current: Array
    by_error: Array
    by_speed: Array


def leg_of(platform: Platform, record: ProfileRecord, series: ProfileSeries, errors: CurrentErrors) -> Leg | None:
    """Make a profile a leg; None without a fix on either side, or without a glide of its own."""
    motion = glide_angle_motion(platform, series, vibration_set(platform, series))
    whole = np.array([0, len(series.time) - 1])
    still = SelfMotion(np.zeros_like(motion.steps), 0.0)
    carried, current = (depth_averaged_current(record, series, m, whole, errors) for m in (still, motion))
    length = float(np.linalg.norm(motion.total))
    if carried is None or current is None or not length > LEAST_LENGTH:
        return None
    elapsed = length / float(np.linalg.norm(carried.velocity - current.velocity))
    starboard = np.column_stack([-motion.steps[:, 1], motion.steps[:, 0]])
    heading = series.measurements[:-1, 2]
    basis = np.column_stack([np.ones(len(heading)), harmonics(heading)])
    return Leg(
        time=float((series.epoch - np.datetime64(0, "s")) / np.timedelta64(1, "s")),
        current=current.velocity,
        by_error=-starboard.T @ basis / elapsed,
        by_speed=-motion.total / elapsed,
    )
