"""Open-loop residual: how far flight under an identified disturbance strays from the record (Table 2, lower block)."""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.flight.glider import Glider

Array = NDArray[np.float64]

SEGMENT = 600.0
"""Length of the segment, s."""


def steady_segment(estimate: ProfileEstimate, length: float = SEGMENT, after: float = 60.0) -> tuple[int, int] | None:
    """First stretch ``(begin, end)`` in samples of that length (s) free of vibration and gaps, or None.

    The first seconds of the record, `after` of them, are left out: the filter has yet to settle.
    """
    series = estimate.series
    steps = round(length / series.step)
    usable = ~estimate.shaken & (series.weights > 0.0)
    usable[: round(after / series.step)] = False
    return first_stretch(usable, steps)


def first_stretch(usable: NDArray[np.bool_], steps: int) -> tuple[int, int] | None:
    """First stretch ``(begin, begin + steps)`` of a mask whose samples are all usable, both ends included, or None."""
    run = np.cumsum(np.concatenate([[0], usable]))
    begins = np.flatnonzero(run[steps + 1 :] - run[: -steps - 1] == steps + 1)
    return (int(begins[0]), int(begins[0]) + steps) if len(begins) else None


def open_loop_rmse(
    glider: Glider, estimate: ProfileEstimate, disturbances: Array, state0: Array, begin: int, end: int
) -> Array:
    """RMSE ``(4,)`` in roll, pitch, heading (rad) and depth (m) of one forward run under a disturbance, no feedback.

    Parameters
    ----------
    disturbances : (n, 6)
        Whole profile, N and N m.
    state0 : (12,)
        State at sample `begin`.
    begin, end : int
        Samples of the segment.
    """
    series = estimate.series
    controls = controls_of(glider.platform, series)[begin:end]
    flown = glider.simulate(state0, controls, disturbances[begin:end], series.step)[1:]
    residual = flown[:, [0, 1, 2, 5]] - series.measurements[begin + 1 : end + 1]
    residual[:, 2] = np.arctan2(np.sin(residual[:, 2]), np.cos(residual[:, 2]))
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))
