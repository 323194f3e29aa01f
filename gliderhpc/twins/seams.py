"""The seam artefact: what the boundaries between windows leave in the identified yaw moment.

Definition. Take the error of the yaw moment (identified minus true), bridge what is not steady glide by straight lines,
high-pass it (fourth-order Butterworth, 0.05 Hz, run both ways: the filter of the spectra). The *seam ratio* is its root
mean square within one second of a boundary over that everywhere else, steady glide on both sides. One means that nobody
can tell where the boundaries are. A boundary is where the solution that stands changes from one window's to the next's.

The error, not the signal: impulses fall where they like, and a chance one at a boundary would pass for a seam. Without
a truth the same ratio of the signal is what there is. The *jump ratio* beside it sets the step of the identified moment
across a boundary against its steps elsewhere (root mean squares): it sees a discontinuity alone, however small.
"""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.scores import rms
from gliderhpc.studies.library.turbulence.high_pass import bridged, high_passed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH = 1.0
"""Seconds on either side that belong to a boundary."""


def boundaries_of(source: NDArray[np.int64]) -> NDArray[np.int64]:
    """Steps ``(k,)`` at which another window's solution begins, from the window's number at every step ``(n,)``."""
    return np.flatnonzero(np.diff(source)) + 1


def seam_ratio(signal: Array, boundaries: NDArray[np.int64], usable: Mask, step: float) -> float:
    """Ratio of the high-passed signal's root mean square near the boundaries to that elsewhere.

    Parameters
    ----------
    signal : (n,) array
        Error of the yaw moment, or the moment itself, N m.
    boundaries : (k,) array
        Steps at which a window's solution begins.
    usable : (n,) mask
        Steady glide.
    step : float
        s.

    Returns
    -------
    float
        NaN where either side has no sample, or the signal is zero elsewhere.
    """
    values = high_passed(bridged(signal, usable), step)
    near = near_boundaries(boundaries, len(signal), step)
    elsewhere = rms(values[usable & ~near])
    return rms(values[usable & near]) / elsewhere if elsewhere > 0.0 else float("nan")


def jump_ratio(signal: Array, boundaries: NDArray[np.int64], usable: Mask) -> float:
    """Ratio of the root mean square step of a signal across the boundaries to that of its steps elsewhere."""
    steps = np.diff(signal)
    across = np.zeros(len(steps), dtype=np.bool_)
    across[boundaries - 1] = True
    inside = usable[1:] & usable[:-1]
    elsewhere = rms(steps[inside & ~across])
    return rms(steps[inside & across]) / elsewhere if elsewhere > 0.0 else float("nan")


def near_boundaries(boundaries: NDArray[np.int64], count: int, step: float) -> Mask:
    """Steps ``(count,)`` within `REACH` of a boundary."""
    reach = round(REACH / step)
    near = np.zeros(count, dtype=np.bool_)
    for boundary in boundaries:
        near[max(0, boundary - reach) : boundary + reach] = True
    return near
