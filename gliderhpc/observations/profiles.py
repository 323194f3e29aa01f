"""Profiles, and dive-climb cycles within a profile, detected from depth alone; a choice among profiles."""

import logging
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import ProfileError
from gliderhpc.observations.records import FloatArray


def stretches(mask: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First sample, and sample after the last, of every unbroken run of True in a mask ``(n,)``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def equal_runs(values: FloatArray, shortest: int) -> list[tuple[int, int]]:
    """First value, and value after the last, of every run of at least `shortest` equal values ``(n,)``, none NaN."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [len(values)]))
    long = np.flatnonzero(np.diff(edges) >= shortest)
    return list(zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True))


log = logging.getLogger(__name__)

IntArray = npt.NDArray[np.int64]

SURFACE_MARGIN = 2.0
"""Depth below its floating level down to which a glider counts as surfaced (m)."""

MIN_DEPTH = 10.0
"""Depth below the surface threshold that an excursion must reach to be a profile (m)."""

MAX_FLOATING_LEVEL = 5.0
"""Maximum depth reading of a floating glider without an offset (m)."""

MAX_OFFSET_LEVEL = 15.0
"""Maximum depth reading of a floating glider with an offset (m): the atmosphere makes 10 m."""

MIN_STAY, MIN_STAYS = 180.0, 2
"""Duration (s) and number of the stays that make a level other than 0 to 5 m the surface; a glider that turns under
water does so faster."""

MIN_SURFACE_TIME = 60.0
"""Minimum duration of a surfacing (s); a shorter visit above the threshold is the turning point of a yo."""


def detect_profiles(
    time: FloatArray,
    depth: FloatArray,
    *,
    surface_margin: float = SURFACE_MARGIN,
    minimum_depth: float = MIN_DEPTH,
    minimum_surface_time: float = MIN_SURFACE_TIME,
    surface_level: FloatArray | None = None,
    record_break: float = float("inf"),
) -> IntArray:
    """Find the profiles of a record, each from one surfacing to the next.

    Parameters
    ----------
    time : (n,) array
        Times (s), strictly increasing.
    depth : (n,) array
        Depth, positive down (m); NaN where missing.
    surface_margin : float
        Depth below the floating level down to which the glider counts as surfaced (m).
    minimum_depth : float
        Depth below the surface threshold that an excursion must reach to be a profile (m).
    minimum_surface_time : float
        Visits to the surface shorter than this (s) do not end a profile.
    surface_level : (n,) array, optional
        Depth reading of the sensor while the glider floats (m); by default it is estimated from the record.
    record_break : float
        Longest pause of the record within a profile (s); a longer one splits the profile in two.

    Returns
    -------
    (n,) int array
        Number of the profile of every sample: 1, 2, ... in time order, and 0 outside any profile.
    """
    numbers = np.zeros(len(depth), dtype=np.int64)
    filled = _fill(time, depth)
    if filled is None:
        return numbers
    level = floating_level(time, filled, surface_margin) if surface_level is None else surface_level
    below = filled - (level + surface_margin)
    runs = _split(stretches(below > 0.0), time, record_break)
    under_way = _merge_yos(runs, time, minimum_surface_time)
    dives = [(start, stop) for start, stop in under_way if below[start:stop].max() >= minimum_depth]
    for number, (start, stop) in enumerate(dives, start=1):
        numbers[start:stop] = number
    return numbers


def floating_level(time: FloatArray, depth: FloatArray, margin: float = SURFACE_MARGIN) -> float:
    """Depth reading of a floating glider (m), from the record alone.

    The pressure sensor is in the nose, which points down while the tail antenna transmits, so a floating glider reads
    between 0 and 3 m. The floating level is therefore taken as the 0.5 % quantile of the record's depths. A quantile
    above 5 m is the floating level only if the glider returns to it between dives and stays there, as it does where the
    depth includes the pressure of the atmosphere.
    """
    shallowest = float(np.quantile(depth, 0.005))
    if shallowest <= MAX_FLOATING_LEVEL:
        return max(shallowest, 0.0)
    stays, expected = (_count_stays(time, depth, level + margin) for level in (shallowest, MAX_FLOATING_LEVEL))
    if shallowest > MAX_OFFSET_LEVEL or stays < MIN_STAYS or stays <= expected:
        return MAX_FLOATING_LEVEL
    log.warning(
        "depth is rarely less than %.1f m, where the glider stays between dives: this level is taken as the surface; "
        "subtract it if it is an offset, such as the pressure of the atmosphere",
        shallowest,
    )
    return shallowest


def _count_stays(time: FloatArray, depth: FloatArray, threshold: float) -> int:
    """Count the visits above a threshold (m) that are too long for the turning point of a yo."""
    return sum(bool(time[stop - 1] - time[start] >= MIN_STAY) for start, stop in stretches(depth <= threshold))


def cycle_boundaries(depth: FloatArray, fraction: float = 0.05) -> IntArray:
    """Split a profile at the boundaries of its dive-climb cycles (paper section 4.4).

    A boundary is the sample at which the glider rises through ``fraction * max(depth)``, if another dive follows; the
    last ascent ends the profile instead. A dive must pass twice the threshold, because noise about the threshold would
    otherwise create cycles.

    Parameters
    ----------
    depth : (n,) array
        Depth of one profile, positive down (m); NaN is skipped.
    fraction : float
        Near-surface threshold as a share of the greatest depth.

    Returns
    -------
    (k + 1,) int array
        Sample indices: 0, the boundaries, and ``n - 1``. Cycle i runs from the i-th index to the next.
    """
    last = len(depth) - 1
    finite = np.flatnonzero(np.isfinite(depth))
    if len(finite) == 0:
        return np.array([0, last], dtype=np.int64)
    threshold = fraction * float(depth[finite].max())
    rises = _rises_before_dives(depth[finite], threshold)
    return np.array([0, *finite[rises], last], dtype=np.int64)


def _rises_before_dives(depth: FloatArray, threshold: float) -> list[int]:
    """Find the samples at which depth rises through the threshold before it passes twice the threshold again."""
    rises: list[int] = []
    candidate: int | None = None
    diving = False
    for index, value in enumerate(depth.tolist()):
        if value >= 2.0 * threshold:
            if candidate is not None:
                rises.append(candidate)
                candidate = None
            diving = True
        elif value < threshold and diving:
            candidate = index
            diving = False
    return rises


def _fill(time: FloatArray, depth: FloatArray) -> FloatArray | None:
    """Depth with its missing samples interpolated; None if all are missing."""
    finite = np.isfinite(depth)
    if not finite.any():
        return None
    return np.interp(time, time[finite], depth[finite])


def _split(runs: list[tuple[int, int]], time: FloatArray, record_break: float) -> list[tuple[int, int]]:
    """Split the runs in which the record pauses for too long."""
    pauses = np.flatnonzero(np.diff(time) > record_break) + 1
    pieces: list[tuple[int, int]] = []
    for start, stop in runs:
        inside = pauses[(pauses > start) & (pauses < stop)].tolist()
        pieces += pairwise([start, *inside, stop])
    return pieces


def _merge_yos(runs: list[tuple[int, int]], time: FloatArray, minimum_surface_time: float) -> list[tuple[int, int]]:
    """Join the runs that are separated only by a short visit to the surface."""
    merged: list[tuple[int, int]] = []
    for start, stop in runs:
        if merged and time[start] - time[merged[-1][1] - 1] < minimum_surface_time:
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return merged


SURFACE_DEPTH = 3.0
"""Depth (m) above which a glider is assumed to float, or to leave or reach the surface."""


def dive_span(
    depth: FloatArray, *, begin: float = SURFACE_DEPTH, end: float = SURFACE_DEPTH, minimum: float = MIN_DEPTH
) -> tuple[int, int]:
    """First sample of the dive and the sample after its last.

    Parameters
    ----------
    depth : (n,) array
        Depth over one dive and the surface intervals around it, positive down (m); NaN where missing.
    begin, end : float
        Depths (m) of beginning and end: the dive runs from the first sample below `begin` to the last below `end`.
    minimum : float
        Depth that the dive must reach (m).

    Raises
    ------
    ProfileError
        The dive is too shallow.
    """
    deepest = float(np.max(depth, where=np.isfinite(depth), initial=-np.inf))
    if not deepest >= minimum:
        if not np.isfinite(deepest):
            raise ProfileError("has no depth")
        raise ProfileError(f"too shallow: dives to {deepest:.0f} m, but at least {minimum:g} m are needed")
    first, last = np.flatnonzero(depth > begin), np.flatnonzero(depth > end)
    if not len(first) or not len(last):
        raise ProfileError(
            f"too shallow: dives to {deepest:.0f} m, but a dive begins below {begin:g} m and ends above {end:g} m"
        )
    return int(first[0]), int(last[-1]) + 1
