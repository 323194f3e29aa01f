"""Intervals between samples: the usual one of a record by time, and the local one that gaps are judged by.

The sampling rate of a real glider changes with depth. Counted by samples, the median belongs to the stretch sampled
most often, however short it is, so intervals are weighed with the time that they last.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

NEIGHBOURS = 10
"""Intervals before, and as many after, that the local interval is taken from."""

_QUANTILE = 0.85
"""Quantile of the neighbours: the fourth longest of twenty."""

MIN_GAP, GAP = 10.0, 3.5
"""A gap is longer than so many seconds, and than so many local intervals."""

_BLOCK = 65_536
"""Intervals whose neighbours are looked at together."""

_RESOLUTION = 6
"""Decimals to which intervals (s) are compared: microseconds, so that a uniform record has one interval."""


def usual_interval(intervals: npt.ArrayLike, share: float = 0.5) -> float:
    """Median interval, or another quantile, by time: that share of the time passes in intervals no longer than it.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s), gaps left out.
    share : float
        Quantile, between 0 and 1.

    Returns
    -------
    float
        s; NaN without any interval. For a uniform record it is the median by samples.
    """
    known = np.sort(np.round(np.asarray(intervals, dtype=np.float64), _RESOLUTION))
    if not len(known):
        return float("nan")
    passed = np.cumsum(known)
    return float(known[np.searchsorted(passed, share * passed[-1])])


def local_intervals(intervals: npt.ArrayLike) -> FloatArray:
    """Fourth longest of each interval's twenty neighbours: how often the record is sampled there.

    The interval itself does not count, and where neighbours are fewer it is the like quantile. At a change of the rate
    the slower side decides, for half of the neighbours lie on it, and in bursts of up to five samples the pauses
    between them; up to three gaps close together do not.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s).

    Returns
    -------
    (m,) array
        s; an only interval is its own neighbour.
    """
    known = np.asarray(intervals, dtype=np.float64)
    if len(known) < 2:
        return known.copy()
    padded = np.pad(known, NEIGHBOURS, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    # Twenty neighbours of each interval are many times the record, so not all of them are held at a time.
    return np.concatenate([_local_interval(around[start : start + _BLOCK]) for start in range(0, len(known), _BLOCK)])


def _local_interval(around: FloatArray) -> FloatArray:
    """Local interval from each interval with its neighbours ``(m, 21)``."""
    neighbours = np.sort(np.delete(around, NEIGHBOURS, axis=1), axis=1)
    count = np.isfinite(neighbours).sum(axis=1)
    place = np.ceil(_QUANTILE * count).astype(np.int64) - 1
    return np.take_along_axis(neighbours, place[:, None], axis=1)[:, 0]


def longest_bridged(local: npt.ArrayLike) -> FloatArray:
    """Longest time between samples (s) that is no gap where the record has these local intervals (s)."""
    return np.maximum(MIN_GAP, GAP * np.asarray(local, dtype=np.float64))


def without_gaps(intervals: npt.ArrayLike) -> FloatArray:
    """Choose the intervals (s) that are no gaps."""
    known = np.asarray(intervals, dtype=np.float64)
    return known[known <= longest_bridged(local_intervals(known))]
