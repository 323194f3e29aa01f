"""What is taken out of the yaw moment before eq. 41, and how its solution is smoothed; neither bridges a gap."""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.observations.stretches import stretches

Array = NDArray[np.float64]


def without_baseline(values: Array, samples: int) -> Array:
    """Take the centred moving average over `samples` out of values ``(n,)``; missing ones stay missing and count none.

    At either end of the record the window is cut, so the average there is that of fewer samples.
    """
    known = np.isfinite(values)
    window = max(1, samples)
    total = scipy.ndimage.uniform_filter1d(np.where(known, values, 0.0), window, mode="constant")
    weight = scipy.ndimage.uniform_filter1d(known.astype(np.float64), window, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, values - total / weight, np.nan)


def smoothing_samples(samples: int, order: int) -> int:
    """Odd length of the Savitzky-Golay window that is asked for in samples, long enough for its order."""
    return max(samples | 1, (order + 1) | 1)


def smoothed(values: Array, samples: int, order: int) -> Array:
    """Smooth each unbroken stretch of values ``(n,)`` (Savitzky-Golay); a stretch shorter than the window is lost."""
    window = smoothing_samples(samples, order)
    out = np.full_like(values, np.nan)
    for first, stop in stretches(np.isfinite(values)):
        if stop - first >= window:
            out[first:stop] = scipy.signal.savgol_filter(values[first:stop], window, order)
    return out
