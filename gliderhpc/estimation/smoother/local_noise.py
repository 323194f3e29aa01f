"""Noise of the disturbances as a dive's information on its hull takes it, and other assumptions of it.

The smoother takes one scale of the noise for a whole dive. What the water does to the yaw comes in bursts with quiet
between, and a filter that takes the dive's mean for the noise of a quiet stretch follows its own sensors' errors there:
its innovations are no longer white, and what they seem to say of the hull's damping is wrong (docs/smoother.md).

No scale is exact, and what is wrong with it moves what the dives say of the hull, in every dive to the same side. How
far, other assumptions that are as plausible show.
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
"""Resolved values that the dive's own scale is worth in a window."""
_DIVE_WEIGHT = 1.0
"""Resolved values that the smoother's scale is worth in a whole dive that may have been quieter."""
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


def other_assumptions(last: LastPass, local: Dive, vibrating: NDArray[np.bool_]) -> tuple[Dive, ...]:
    """Return a smoothed dive's problem under the assumptions of `gliderhpc.vocabulary.NOISE_ASSUMPTIONS`.

    Parameters
    ----------
    last : LastPass
        Of the smoother: one scale for the whole dive.
    local : Dive
        The problem as `with_local_noise` gives it.
    vibrating : (n+1,) mask
        The vibration set.

    Notes
    -----
    The quieter noise has the factor of each channel over the dive (that of
    `gliderhpc.estimation.smoother.noise.NoiseScale`, in which the scale that the smoother held on to counts hardly) and
    once more that of each stretch, where they are below one.
    """
    dive, steady = last.dive, ~vibrating[:-1]
    spent = np.sum(last.noise_mean[steady] ** 2 / dive.noise[steady], axis=0)
    resolved = np.sum(last.noise_resolved[steady], axis=0)
    whole = (spent + _DIVE_WEIGHT) / (resolved + _DIVE_WEIGHT)
    quieter = local.noise * np.minimum(1.0, whole) * np.minimum(1.0, local.noise / dive.noise)
    measured = np.where(vibrating[:, None], np.nan, local.measured)
    return dive, local._replace(noise=quieter), local._replace(measured=measured)


def _sums(values: Array, width: int) -> Array:
    """Sums over a window about each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
