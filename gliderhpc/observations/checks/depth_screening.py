"""Dropouts, spikes and noise of a depth, which would each add to the magnitude of the vertical speed."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.records import FloatArray

Mask = npt.NDArray[np.bool_]

PAIRS = 5
"""Number of neighbours on either side from which a depth is predicted."""

FLOOR, SPEED, SCATTER = 5.0, 0.5, 10.0
"""Minimum deviation of an impossible depth: the sum of a constant (m), of a vertical speed (m/s) times the time to the
third neighbour, and of a factor times the scatter of the record. Gliders sink and rise at 0.3 m/s at most, also while
they turn."""

_PASSES = 30
"""Maximum number of passes; each finds the worst sample of every run of impossible depths."""

_BLOCK = 262_144
"""Number of samples that are processed together."""


def impossible_depths(time: FloatArray, depth: FloatArray) -> Mask:
    """Mask ``(n,)`` of the depths far from those before and after.

    A depth is predicted as the median of five lines between a sample before and one after it. The worst sample of every
    neighbourhood is left out first, and the others are predicted again without it. Runs of more than about five such
    samples, such as a sensor that fails for minutes, are not found.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s), increasing, and depth (m), NaN where missing.
    """
    impossible = np.zeros(len(depth), dtype=bool)
    rows = np.flatnonzero(np.isfinite(depth))
    if len(rows) <= 2 * PAIRS:
        return impossible
    places = np.arange(len(rows))
    scatter = float("nan")
    for _ in range(_PASSES):
        deviation, reach = _deviations(time[rows], depth[rows], places)
        scatter = float(np.median(np.abs(deviation))) if np.isnan(scatter) else scatter
        excess = np.abs(deviation) - (FLOOR + SPEED * reach + SCATTER * scatter)
        worst = _local_maxima(places, excess)
        if not worst.any():
            break
        found = places[worst]
        impossible[rows[found]] = True
        near = np.unique(np.clip(found[:, None] + np.arange(-2 * PAIRS, 2 * PAIRS + 1), 0, len(rows) - 1))
        near = near[~impossible[rows[near]]]
        left = np.flatnonzero(~impossible[rows])
        places, rows = np.searchsorted(left, near), rows[left]
        if len(rows) <= 2 * PAIRS:
            break
    return impossible


def _deviations(time: FloatArray, depth: FloatArray, places: npt.NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Deviations ``(m,)`` from the prediction (m) at some places, and times to the third neighbour (s).

    A depth near an end of the record is predicted from fewer pairs; the first and the last are not checked.
    """
    deviation, reach = np.zeros(len(places)), np.zeros(len(places))
    for start in range(0, len(places), _BLOCK):
        part = slice(start, start + _BLOCK)
        at = places[part]
        deviation[part] = depth[at] - _predicted(time, depth, at)
        reach[part] = 0.5 * (time[np.minimum(at + 3, len(time) - 1)] - time[np.maximum(at - 3, 0)])
    return deviation, reach


def _predicted(time: FloatArray, depth: FloatArray, at: npt.NDArray[np.int64]) -> FloatArray:
    """Medians of the lines through the neighbours; the depth itself where it has a neighbour on one side only."""
    steps = np.arange(1, PAIRS + 1)[:, None]
    inside = (at - steps >= 0) & (at + steps < len(depth))
    before, after = np.where(inside, at - steps, at), np.where(inside, at + steps, at)
    span = np.where(inside, time[after] - time[before], 1.0)
    lines = depth[before] + (time[at] - time[before]) / span * (depth[after] - depth[before])
    predicted = np.median(lines, axis=0)
    for place in np.flatnonzero(~inside.all(axis=0) & inside.any(axis=0)).tolist():
        predicted[place] = np.median(lines[inside[:, place], place])
    return np.asarray(predicted)


def _local_maxima(places: npt.NDArray[np.int64], excess: FloatArray) -> Mask:
    """Mask of the positive values that no value within `PAIRS` places exceeds."""
    worst = excess > 0.0
    positive = np.flatnonzero(worst)
    at, values = places[positive], excess[positive]
    greatest = np.ones(len(positive), dtype=bool)
    for step in range(1, min(PAIRS, len(positive) - 1) + 1):
        close = at[step:] - at[:-step] <= PAIRS
        greatest[step:] &= ~(close & (values[:-step] > values[step:]))
        greatest[:-step] &= ~(close & (values[step:] > values[:-step]))
    worst[positive] = greatest
    return worst


RATE_ERROR = 0.02
"""Standard deviation of a vertical speed (m/s) at which a noisy depth is smoothed."""

MIN_SMOOTHING = 15.0, 4.5
"""Times in seconds and in sample intervals that a smoothing must exceed; the vertical speed is the slope over ten
seconds, or three intervals, in any case."""


def noise_window(time: FloatArray, depth: FloatArray) -> float:
    """Time (s) over which a noisy depth needs to be smoothed; 0 if it need not be.

    Without this, the noise adds to the magnitude of the vertical speed, and so to the speed through the water.

    Parameters
    ----------
    time, depth : (n,) arrays
        Times (s), increasing, and depth (m) of one profile, NaN where missing.

    Notes
    -----
    The slope of a straight line over a time T has the variance ``12 sigma**2 dt / T**3`` with the noise sigma and the
    sample interval dt; the noise is taken as 1.4 times the median deviation from the samples before and after.
    """
    known = np.flatnonzero(np.isfinite(depth))
    if len(known) <= 2 * PAIRS:
        return 0.0
    time, depth = time[known], depth[known]
    sigma = 1.4 * float(np.median(np.abs(_deviations(time, depth, np.arange(len(time)))[0])))
    interval = usual_interval(without_gaps(np.diff(time)))
    window = float(np.cbrt(12.0 * interval * (sigma / RATE_ERROR) ** 2))
    return window if window > MIN_SMOOTHING[0] and window > MIN_SMOOTHING[1] * interval else 0.0


def smoothed_depth(time: FloatArray, depth: FloatArray, window: float) -> FloatArray:
    """Depth ``(n,)`` by straight lines through the samples within a time `window` (s) about each; NaN where missing."""
    known = np.flatnonzero(np.isfinite(depth))
    at, values = time[known] - time[known][0], depth[known]
    first = np.searchsorted(at, at - 0.5 * window, "left")
    last = np.searchsorted(at, at + 0.5 * window, "right")

    def mean(column: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(column)])
        return np.asarray((total[last] - total[first]) / (last - first))

    centre, level = mean(at), mean(values)
    spread = mean(at * at) - centre**2
    slope = np.divide(mean(at * values) - centre * level, spread, out=np.zeros(len(at)), where=spread > 1e-6)
    smoothed = depth.copy()
    smoothed[known] = level + slope * (at - centre)
    return smoothed
