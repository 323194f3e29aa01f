"""Noise of the fast disturbances as it comes and goes within a dive.

The smoother takes one scale of the noise for a whole dive. What the water does to the yaw comes in bursts with quiet
between, and a filter that takes the dive's mean for the noise of a quiet stretch follows its own sensors' errors there:
its innovations are no longer white, and what they seem to say of the hull's damping is wrong (docs/smoother.md).
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.iterate import LastPass
from gliderhpc.kernels.smoother_memory import Dive

Array = NDArray[np.float64]

FAST = 120.0
"""Disturbances with a shorter correlation time (s) have a local scale."""
WINDOW = 5.0
"""Sample intervals over which the local scale is taken."""
_PRIOR_WEIGHT = 0.3
"""Resolved values that the dive's own scale is worth."""
_RANGE = (1e-3, 1e3)
"""Bounds of the local scale."""


def with_local_noise(last: LastPass, sample_interval: float) -> Dive:
    """Return a smoothed dive's problem with the noise of its fast disturbances scaled locally.

    Parameters
    ----------
    last : LastPass
        Of the smoother.
    sample_interval : float
        s.

    Notes
    -----
    The factor of a stretch is that of `gliderhpc.estimation.smoother.noise.NoiseScale`: the squares of the smoothed
    noise over their variances, in sum, over the number of values that the record resolves.
    """
    dive = last.dive
    channels = np.flatnonzero(dive.step / -np.log(dive.decay) < FAST)
    width = max(1, round(WINDOW * sample_interval / dive.step))
    noise = dive.noise.copy()
    spent = _sums(last.noise_mean[:, channels] ** 2 / noise[:, channels], width)
    resolved = _sums(last.noise_resolved[:, channels], width)
    noise[:, channels] *= np.clip((spent + _PRIOR_WEIGHT) / (resolved + _PRIOR_WEIGHT), *_RANGE)
    return dive._replace(noise=noise)


def _sums(values: Array, width: int) -> Array:
    """Sums over a window about each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
