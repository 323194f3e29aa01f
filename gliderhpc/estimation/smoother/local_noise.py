"""Noise of the disturbances in a dive's information on its hull, and other assumptions of this noise.

The smoother uses one scale of the noise for a whole dive. Yaw moments from the water come in bursts, with quiet
stretches between them. A filter with the dive's mean noise in a quiet stretch follows the errors of its own sensors
there. Its innovations are no longer white, and their information on the hull's damping is wrong (docs/smoother.md).

No scale is exact, and its error biases the information on the hull in the same direction in every dive. The size of
this bias is estimated from other, equally plausible assumptions.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.estimate import LastPass
from gliderhpc.estimation.smoother.noise import spent_and_resolved
from gliderhpc.kernels.smoother_memory import Dive

Array = NDArray[np.float64]

FAST = 120.0
"""Correlation time (s) below which disturbances have a local scale."""
WINDOW = 5.0
"""Number of sample intervals over which the local scale is computed."""
_DIVE_WEIGHT = 1.0
"""Weight of the smoother's scale, in resolved values, in the scale of a whole dive that may have been quieter."""
_MIN_DISPERSION = 1e-3
"""Lower bound of the relative variance of the local scale."""
_MIN_RESOLVED = 1e-9
"""Lower bound of the number of resolved values, to prevent division by zero."""
_RANGE = (1e-3, 1e3)
"""Bounds of the local scale."""


def with_local_noise(last: LastPass, sample_interval: float, steady: NDArray[np.bool_]) -> Dive:
    """Return a smoothed dive's problem with the noise of its fast disturbances scaled locally.

    Parameters
    ----------
    last : LastPass
        Last pass of the smoother.
    sample_interval : float
        Sample interval of the record, s.
    steady : (n,) mask
        Steps outside the vibration set, from which the variation of the noise is estimated.

    Notes
    -----
    The factor of a stretch is that of `gliderhpc.estimation.smoother.noise.NoiseScale`: the sum of the squares of the
    smoothed noise over their variances, divided by the number of values that the record resolves. The dive's own scale
    has a weight in resolved values, which is larger the less the stretches differ (`dispersion`).
    """
    dive = last.dive
    channels = np.flatnonzero(dive.step / -np.log(dive.decay) < FAST)
    width = max(1, round(WINDOW * sample_interval / dive.step))
    noise, resolved = dive.noise.copy(), last.noise_resolved[:, channels]
    spent = last.noise_mean[:, channels] ** 2 / noise[:, channels]
    weight = 2.0 / np.maximum(dispersion(spent[steady], resolved[steady], width), _MIN_DISPERSION)
    factor = (_sums(spent, width) + weight) / (_sums(resolved, width) + weight)
    noise[:, channels] *= np.clip(factor, *_RANGE)
    return dive._replace(noise=noise)


def dispersion(spent: Array, resolved: Array, width: int) -> Array:
    """Relative variance ``(c,)`` of the noise's scale between stretches, by moments; zero if one scale explains all.

    Parameters
    ----------
    spent, resolved : (n, c), (n, c)
        Squares of the smoothed noise over their variances, and the part that the record resolves, at every step.
    width : int
        Number of steps of a stretch.

    Notes
    -----
    In a stretch that resolves ``r`` values of noise of scale ``s``, the expected sum of the squares is ``s r``, and its
    variance is at most ``2 s^2 r``. If ``s`` itself has the relative variance ``v``, the variance of the sum is larger
    by ``s^2 v (r^2 + 2 r)``. A prior of the scale with this variance (inverse gamma) has the weight of ``2 / v``
    resolved values.
    """
    if not len(spent):
        return np.zeros(spent.shape[1])
    starts = np.arange(0, len(spent), width)
    sums, values = (np.add.reduceat(x, starts, axis=0) for x in (spent, resolved))
    scale = sums.sum(axis=0) / np.maximum(values.sum(axis=0), _MIN_RESOLVED)
    excess = np.sum((sums - scale * values) ** 2, axis=0) - 2.0 * scale**2 * values.sum(axis=0)
    return np.asarray(
        np.maximum(excess, 0.0) / np.maximum(scale**2 * np.sum(values * (values + 2.0), axis=0), _MIN_RESOLVED)
    )


def other_assumptions(last: LastPass, local: Dive, vibrating: NDArray[np.bool_]) -> tuple[Dive, ...]:
    """Return a smoothed dive's problem under the assumptions of `gliderhpc.vocabulary.NOISE_ASSUMPTIONS`.

    Parameters
    ----------
    last : LastPass
        Last pass of the smoother, with one scale for the whole dive.
    local : Dive
        Problem returned by `with_local_noise`.
    vibrating : (n+1,) mask
        Mask of the vibration set.

    Notes
    -----
    The quieter noise is multiplied by the factor of each channel over the dive and, once more, by that of each stretch,
    where these are below one. The former is that of `gliderhpc.estimation.smoother.noise.NoiseScale` with hardly any
    weight of the smoother's scale.
    """
    dive, steady = last.dive, ~vibrating[:-1]
    spent, resolved = spent_and_resolved(last, dive.noise, steady)
    whole = (spent + _DIVE_WEIGHT) / (resolved + _DIVE_WEIGHT)
    quieter = local.noise * np.minimum(1.0, whole) * np.minimum(1.0, local.noise / dive.noise)
    measured = np.where(vibrating[:, None], np.nan, local.measured)
    return dive, local._replace(noise=quieter), local._replace(measured=measured)


def _sums(values: Array, width: int) -> Array:
    """Sums over a window centred on each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
