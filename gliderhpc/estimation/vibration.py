"""The vibration set: samples whose record the actuators shake (T_shake of section 4.3)."""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform


def vibration_set(platform: Platform, series: ProfileSeries) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of the samples within the platform's guard of an actuator moving faster than its threshold.

    Battery translation, battery rotation and ballast are held against `Platform.vibration` (m/s, degree/s, cm3/s).
    """
    limits = platform.vibration
    thresholds = np.array([limits.battery_position_rate, limits.battery_rotation_rate_rad, limits.ballast_rate_m3])
    rates = np.abs(np.diff(series.controls[:, :3], axis=0)) / series.step
    moving = np.zeros(len(series.time), dtype=np.uint8)
    fast = (rates > thresholds).any(axis=1)
    moving[1:-1][fast] = 1
    reach = 2 * round(limits.guard / series.step) + 1
    return np.asarray(scipy.ndimage.maximum_filter1d(moving, size=reach, mode="constant"), dtype=bool)
