"""What takes the slow part out of a disturbance, which is the model's error and not the water's (model.md 8)."""

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CUTOFF = 0.05
"""Of the high-pass, Hz: slower is the model's bias."""

ORDER = 4


def bridged(signal: Array, usable: Mask) -> Array:
    """Replace what is not usable by straight lines between what is; without any usable sample, by zero."""
    if not usable.any():
        return np.zeros_like(signal)
    index = np.arange(len(signal))
    return np.interp(index, index[usable], signal[usable])


def high_passed(signal: Array, step: float, cutoff: float = CUTOFF) -> Array:
    """High-pass a signal ``(n,)``, samples `step` s apart: Butterworth, run both ways, so that nothing is shifted."""
    sections = scipy.signal.butter(ORDER, cutoff, "highpass", fs=1.0 / step, output="sos")
    return np.asarray(
        scipy.signal.sosfiltfilt(sections, signal, padlen=min(len(signal) - 1, round(1.0 / (cutoff * step))))
    )
