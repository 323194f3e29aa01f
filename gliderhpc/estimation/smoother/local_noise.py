"""Noise of the disturbances in a profile's information on its hull, and other assumptions of this noise.

The smoother uses one scale of the noise for a whole profile. Yaw moments from the water come in bursts, with quiet
stretches between them. A filter with the profile's mean noise in a quiet stretch follows the errors of its own sensors
there. Its innovations are no longer white, and their information on the hull's damping is wrong (docs/smoother.md).

No scale is exact, and an error of the scale biases the information on the hull in the same direction in every profile.
The size of this bias is estimated from other, equally plausible assumptions.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.estimate import LastPass
from gliderhpc.estimation.smoother.noise import noise_sums
from gliderhpc.kernels.smoother_memory import SmootherProblem

Array = NDArray[np.float64]

FAST = 120.0
"""Correlation time (s) below which disturbances have a local scale."""
WINDOW = 5.0
"""Number of sample intervals over which the local scale is computed."""
_PROFILE_WEIGHT = 1.0
"""Weight of the smoother's scale, in resolved values, in the scale assumed for a quieter profile."""
_MIN_DISPERSION = 1e-3
"""Lower bound of the relative variance of the local scale."""
_MIN_RESOLVED = 1e-9
"""Lower bound of the number of resolved values, to prevent division by zero."""
_RANGE = (1e-3, 1e3)
"""Bounds of the local scale."""


def with_local_noise(last: LastPass, sample_interval: float, steady: NDArray[np.bool_]) -> SmootherProblem:
    """Return a smoothed profile's problem with the noise of its fast disturbances scaled locally.

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
    smoothed noise over their variances, divided by the number of values that the record resolves. The profile's own
    scale has a weight in resolved values, which is larger the less the stretches differ (`dispersion`).
    """
    problem = last.problem
    channels = np.flatnonzero(problem.step / -np.log(problem.decay) < FAST)
    width = max(1, round(WINDOW * sample_interval / problem.step))
    noise, resolved = problem.noise.copy(), last.noise_resolved[:, channels]
    squares = last.noise_mean[:, channels] ** 2 / noise[:, channels]
    weight = 2.0 / np.maximum(dispersion(squares[steady], resolved[steady], width), _MIN_DISPERSION)
    factor = (_sums(squares, width) + weight) / (_sums(resolved, width) + weight)
    noise[:, channels] *= np.clip(factor, *_RANGE)
    return problem._replace(noise=noise)


def dispersion(squares: Array, resolved: Array, width: int) -> Array:
    """Relative variance ``(c,)`` of the noise's scale between stretches, by moments; zero if one scale explains all.

    Parameters
    ----------
    squares, resolved : (n, c), (n, c)
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
    if not len(squares):
        return np.zeros(squares.shape[1])
    starts = np.arange(0, len(squares), width)
    sums, values = (np.add.reduceat(x, starts, axis=0) for x in (squares, resolved))
    scale = sums.sum(axis=0) / np.maximum(values.sum(axis=0), _MIN_RESOLVED)
    excess = np.sum((sums - scale * values) ** 2, axis=0) - 2.0 * scale**2 * values.sum(axis=0)
    return np.asarray(
        np.maximum(excess, 0.0) / np.maximum(scale**2 * np.sum(values * (values + 2.0), axis=0), _MIN_RESOLVED)
    )


def other_assumptions(
    last: LastPass, local: SmootherProblem, vibrating: NDArray[np.bool_]
) -> tuple[SmootherProblem, ...]:
    """Return a smoothed profile's problem under the assumptions of `gliderhpc.vocabulary.NOISE_ASSUMPTIONS`.

    Parameters
    ----------
    last : LastPass
        Last pass of the smoother, with one scale for the whole profile.
    local : SmootherProblem
        Problem returned by `with_local_noise`.
    vibrating : (n+1,) mask
        Mask of the vibration set.

    Notes
    -----
    The quieter noise is multiplied by the factor of each channel over the profile and, once more, by that of each
    stretch, where these are below one. The former is that of `gliderhpc.estimation.smoother.noise.NoiseScale` with
    hardly any weight of the smoother's scale.
    """
    problem, steady = last.problem, ~vibrating[:-1]
    squares, resolved = noise_sums(last, problem.noise, steady)
    factor = (squares + _PROFILE_WEIGHT) / (resolved + _PROFILE_WEIGHT)
    quieter = local.noise * np.minimum(1.0, factor) * np.minimum(1.0, local.noise / problem.noise)
    measured = np.where(vibrating[:, None], np.nan, local.measured)
    return problem, local._replace(noise=quieter), local._replace(measured=measured)


def _sums(values: Array, width: int) -> Array:
    """Sums over a window centred on each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
