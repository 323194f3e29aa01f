"""Samples of one clock on the times of another."""

import numpy as np

from gliderhpc.observations.records import FloatArray, TimeArray


def onto_nearest(
    time: TimeArray, sampled: TimeArray, values: FloatArray, within: np.timedelta64 | TimeArray
) -> FloatArray:
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
    within : numpy.timedelta64, or (m,) array of them
        How far a sample may be moved, or each of them.

    Returns
    -------
    (n,) array
    """
    right = np.clip(np.searchsorted(time, sampled), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(sampled - time[left]) <= np.abs(time[right] - sampled), left, right)
    distance = np.abs(sampled - time[nearest])
    # Farthest first, so that of two samples on one place the nearer is the one that stays.
    order = np.argsort(-distance, kind="stable")
    order = order[(distance <= within)[order] & np.isfinite(values[order])]
    placed = np.full(len(time), np.nan)
    for index in order.tolist():
        placed[nearest[index]] = values[index]
    return placed
