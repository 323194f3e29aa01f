"""Vertical speeds that no glider has: a wrong unit of time or of depth, which either alone does not betray."""

from collections.abc import Mapping

import numpy as np

from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.validation import Span

SLOWEST_GLIDE = 0.01
"""Vertical speed (m/s) that every glide exceeds somewhere: the slowest sink at 0.03."""

FASTEST_GLIDE = 2.0
"""Mean vertical speed (m/s) of a whole profile that no glider reaches: the fastest dive at 0.5."""

_LEAST_RANGE = 5.0
"""Range of depth (m) below which a profile says nothing of its pace."""

_PART = 0.25
"""Part of the range that is passed in one glide."""


def check_pace(
    time: TimeArray, depth: FloatArray, spans: Mapping[int, Span], faults: Mapping[int, str]
) -> dict[int, str]:
    """Faults of profiles, but for those that have one: too slow or too fast up and down for any glider.

    Parameters
    ----------
    time : (n,) array
        UTC.
    depth : (n,) array
        In m, NaN where missing.
    spans : mapping of int to Span
        Where the profiles lie.
    faults : mapping of int to str
        By profile number, those found before.
    """
    found = (
        (number, _fault_of_pace(number, time[start:stop], depth[start:stop]))
        for number, (start, stop) in spans.items()
        if number not in faults
    )
    return {number: fault for number, fault in found if fault is not None}


def _fault_of_pace(number: int, time: TimeArray, depth: FloatArray) -> str | None:
    known = np.isfinite(depth)
    seconds, depth = (time[known] - time[0]) / np.timedelta64(1, "s"), depth[known]
    extent = float(np.ptp(depth))
    if extent < _LEAST_RANGE:
        return None
    mean = 2.0 * extent / float(seconds[-1] - seconds[0])
    if mean > FASTEST_GLIDE:
        return (
            f"profile {number}: dives {extent:.0f} m and comes back at {mean:.3g} m/s up and down, faster than any "
            "glider; are the units of time and depth right?"
        )
    # In intervals in which the slowest glide passes that part, any faster one passes it in one, or most of it in two.
    bins = np.floor(seconds * (SLOWEST_GLIDE / (_PART * extent)))
    begins = np.flatnonzero(np.diff(bins, prepend=-1.0))
    passed = np.maximum.reduceat(depth, begins) - np.minimum.reduceat(depth, begins)
    if len(begins) > 1 and passed.max() < _PART * extent:
        return (
            f"profile {number}: nowhere moves faster than {SLOWEST_GLIDE:g} m/s up or down between the surface and "
            f"{depth.max():.0f} m, slower than any glide; are the units of time and depth right?"
        )
    return None
