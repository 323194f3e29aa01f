"""Samples on other rows: measurements of several computers, each moved to the nearest time of another."""

from typing import Any

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

_RARE_SHARE = 0.1
"""Share of the samples of one measurement below which rows with all measurements are rare."""


def rarely_together(*measured: npt.NDArray[np.bool_]) -> bool:
    """Return whether measurements, given by the masks ``(n,)`` of their rows, are hardly ever in one row.

    This is so where several computers sample them, and their files were joined by time.
    """
    together = np.count_nonzero(np.logical_and.reduce(measured))
    return bool(together < _RARE_SHARE * min(map(np.count_nonzero, measured)))


def nearest_rows(time: npt.NDArray[Any], wanted: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
    """Find the index of the increasing times ``(n,)``, n >= 1, nearest to each wanted time ``(m,)``.

    Of two times at equal distance the earlier is taken.
    """
    right = np.clip(np.searchsorted(time, wanted), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(np.abs(wanted - time[left]) <= np.abs(time[right] - wanted), left, right)


def onto_nearest(time: npt.NDArray[Any], sampled: npt.NDArray[Any], values: FloatArray, within: Any) -> FloatArray:
    """Put each sample on the nearest of other times; times without a sample within reach are NaN.

    Nothing is interpolated, because an interpolated value is not a measurement.

    Parameters
    ----------
    time : (n,) array
        Times to put the samples on, increasing, n >= 1.
    sampled : (m,) array
        Times of the samples, of the same type.
    values : (m,) array
        Values of the samples.
    within : numpy.timedelta64 or float, or (m,) array of them
        Greatest time by which a sample is moved, for all samples or for each.

    Returns
    -------
    (n,) array
    """
    nearest = nearest_rows(time, sampled)
    distance = np.abs(sampled - time[nearest])
    # Farthest first: if two samples fall on one time, the nearer one overwrites the other.
    order = np.argsort(-distance, kind="stable")
    order = order[(distance <= within)[order] & np.isfinite(values[order])]
    placed = np.full(len(time), np.nan)
    for index in order.tolist():
        placed[nearest[index]] = values[index]
    return placed
