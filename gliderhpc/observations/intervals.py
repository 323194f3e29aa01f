"""Intervals between samples, and the gaps among them.

The sampling rate of a real glider changes with depth. A median over samples would be dominated by the most densely
sampled part of the record, however short it is. Intervals are therefore weighted by their duration.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

NEIGHBOURS = 10
"""Number of intervals on either side from which the local interval is taken."""

_QUANTILE = 0.85
"""Quantile of the neighbours: the fourth longest of twenty."""

MIN_GAP, GAP = 10.0, 3.5
"""Minimum length of a gap, in seconds and in local intervals; a gap exceeds both."""

_BLOCK = 65_536
"""Number of intervals whose neighbours are processed together."""

_RESOLUTION = 6
"""Decimals to which intervals (s) are rounded (microseconds), which gives a uniform record a single interval."""


def usual_interval(intervals: npt.ArrayLike, share: float = 0.5) -> float:
    """Time-weighted median of the intervals, or another quantile.

    The fraction `share` of the total time passes in intervals no longer than the result.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s), without gaps.
    share : float
        Quantile, between 0 and 1.

    Returns
    -------
    float
        Quantile (s); NaN without any interval. For a uniform record the median equals the median over samples.
    """
    known = np.sort(np.round(np.asarray(intervals, dtype=np.float64), _RESOLUTION))
    if not len(known):
        return float("nan")
    passed = np.cumsum(known)
    return float(known[np.searchsorted(passed, share * passed[-1])])


def local_intervals(intervals: npt.ArrayLike) -> FloatArray:
    """Local sampling interval: the fourth longest of each interval's twenty neighbours.

    The interval itself is excluded. Near the ends of the record, with fewer neighbours, the same quantile is used. At a
    change of the sampling rate the result is the slower rate, because half of the neighbours have it. In bursts of up
    to five samples the result is the pause between the bursts. Up to three gaps close together have no effect.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s).

    Returns
    -------
    (m,) array
        Local intervals (s); a single interval is its own neighbour.
    """
    known = np.asarray(intervals, dtype=np.float64)
    if len(known) < 2:
        return known.copy()
    padded = np.pad(known, NEIGHBOURS, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    # The neighbours take twenty times the memory of the record, so they are processed in blocks.
    return np.concatenate([_local_interval(around[start : start + _BLOCK]) for start in range(0, len(known), _BLOCK)])


def _local_interval(around: FloatArray) -> FloatArray:
    """Local interval of each interval, from the intervals with their neighbours ``(m, 21)``."""
    neighbours = np.sort(np.delete(around, NEIGHBOURS, axis=1), axis=1)
    count = np.isfinite(neighbours).sum(axis=1)
    place = np.ceil(_QUANTILE * count).astype(np.int64) - 1
    return np.take_along_axis(neighbours, place[:, None], axis=1)[:, 0]


def longest_bridged(local: npt.ArrayLike) -> FloatArray:
    """Longest time between samples (s) that is not a gap, from the local intervals of the record (s)."""
    return np.maximum(MIN_GAP, GAP * np.asarray(local, dtype=np.float64))


def without_gaps(intervals: npt.ArrayLike) -> FloatArray:
    """Select the intervals (s) that are not gaps."""
    known = np.asarray(intervals, dtype=np.float64)
    return known[known <= longest_bridged(local_intervals(known))]
