"""From the vehicle's own units to those of the observation format."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.seaexplorer.rows import Rows


def convert(rows: Rows, linear_scale: float, linear_zero: float) -> dict[str, npt.NDArray[np.generic]]:
    """Attitude, depth and controls in the units and signs of the observation format.

    A positive ``AngPos`` goes with starboard down (0.4 degree of roll a degree on SEA035, correlation 0.9): the sign of
    the model's gamma. ``LinPos`` grows forward.

    Parameters
    ----------
    rows : Rows
        Navigation rows.
    linear_scale : float
        Metres of battery travel a unit of ``LinPos``.
    linear_zero : float
        ``LinPos`` at which the battery sits at its nominal position.
    """
    return {
        "time": rows.time,
        "depth": rows["Depth"],
        "roll": rows["Roll"],
        "pitch": rows["Pitch"],
        "heading": np.mod(rows["Heading"] + rows["Declination"], 360.0),
        "battery_position": linear_scale * (rows["LinPos"] - linear_zero),
        "battery_rotation": rows["AngPos"],
        "ballast_volume": rows["BallastPos"],
    }


def onto_nearest(time: TimeArray, sampled: TimeArray, values: FloatArray, within: np.timedelta64) -> FloatArray:
    """Put each sample on the nearest of other times, NaN where there is none within reach.

    Nothing is interpolated: a sample that was not measured is no datum.

    Parameters
    ----------
    time : (n,) array
        Where the samples should go, increasing, n >= 1.
    sampled : (m,) array
        When they were taken.
    values : (m,) array
        The samples.
    within : numpy.timedelta64
        How far a sample may be moved.
    """
    placed = np.full(len(time), np.nan)
    right = np.clip(np.searchsorted(time, sampled), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(sampled - time[left]) <= np.abs(time[right] - sampled), left, right)
    distance = np.abs(sampled - time[nearest])
    # Farthest first, so that of two samples on one place the nearer is the one that stays.
    for index in np.argsort(-distance, kind="stable"):
        if distance[index] <= within and np.isfinite(values[index]):
            placed[nearest[index]] = values[index]
    return placed
