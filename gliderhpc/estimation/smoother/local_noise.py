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

from gliderhpc.estimation.smoother.estimate import LastPass
from gliderhpc.estimation.smoother.noise import spent_and_resolved
from gliderhpc.kernels.smoother_memory import Dive

Array = NDArray[np.float64]

FAST = 120.0
"""Disturbances with a shorter correlation time (s) have a local scale."""
WINDOW = 5.0
"""Sample intervals over which the local scale is taken."""
_DIVE_WEIGHT = 1.0
"""Resolved values that the smoother's scale is worth in a whole dive that may have been quieter."""
_LEAST_DISPERSION = 1e-3
"""Relative variance of the local scale below which there is none."""
_FEWEST = 1e-9
"""Resolved values of a record that resolves none."""
_RANGE = (1e-3, 1e3)
"""Bounds of the local scale."""


def with_local_noise(last: LastPass, sample_interval: float, steady: NDArray[np.bool_]) -> Dive:
    """Return a smoothed dive's problem with the noise of its fast disturbances scaled locally.

    Parameters
    ----------
    last : LastPass
        Of the smoother.
    sample_interval : float
        s.
    steady : (n,) mask
        Steps outside the vibration set, by which it is judged how much the noise varies.

    Notes
    -----
    The factor of a stretch is that of `gliderhpc.estimation.smoother.noise.NoiseScale`: the squares of the smoothed
    noise over their variances, in sum, over the number of values that the record resolves. The dive's own scale counts
    as so many more resolved values, the less its stretches differ (`dispersion`).
    """
    dive = last.dive
    channels = np.flatnonzero(dive.step / -np.log(dive.decay) < FAST)
    width = max(1, round(WINDOW * sample_interval / dive.step))
    noise, resolved = dive.noise.copy(), last.noise_resolved[:, channels]
    spent = last.noise_mean[:, channels] ** 2 / noise[:, channels]
    weight = 2.0 / np.maximum(dispersion(spent[steady], resolved[steady], width), _LEAST_DISPERSION)
    factor = (_sums(spent, width) + weight) / (_sums(resolved, width) + weight)
    noise[:, channels] *= np.clip(factor, *_RANGE)
    return dive._replace(noise=noise)


def dispersion(spent: Array, resolved: Array, width: int) -> Array:
    """Relative variance ``(c,)`` of the noise's scale between stretches, by moments; zero where one scale explains all.

    Parameters
    ----------
    spent, resolved : (n, c), (n, c)
        Squares of the smoothed noise over their variances, and the part that the record resolves, of every step.
    width : int
        Steps of a stretch.

    Notes
    -----
    Of a stretch that resolves ``r`` values of noise of scale ``s`` the squares sum up to ``s r``, with a variance of at
    most ``2 s^2 r``. Where ``s`` itself has the relative variance ``v``, the sums' variance is larger by
    ``s^2 v (r^2 + 2 r)``. With a prior of this variance (inverse gamma), a scale is known beforehand as well as from
    ``2 / v`` resolved values.
    """
    if not len(spent):
        return np.zeros(spent.shape[1])
    starts = np.arange(0, len(spent), width)
    sums, values = (np.add.reduceat(x, starts, axis=0) for x in (spent, resolved))
    scale = sums.sum(axis=0) / np.maximum(values.sum(axis=0), _FEWEST)
    excess = np.sum((sums - scale * values) ** 2, axis=0) - 2.0 * scale**2 * values.sum(axis=0)
    return np.asarray(np.maximum(excess, 0.0) / np.maximum(scale**2 * np.sum(values * (values + 2.0), axis=0), _FEWEST))


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
    spent, resolved = spent_and_resolved(last, dive.noise, steady)
    whole = (spent + _DIVE_WEIGHT) / (resolved + _DIVE_WEIGHT)
    quieter = local.noise * np.minimum(1.0, whole) * np.minimum(1.0, local.noise / dive.noise)
    measured = np.where(vibrating[:, None], np.nan, local.measured)
    return dive, local._replace(noise=quieter), local._replace(measured=measured)


def _sums(values: Array, width: int) -> Array:
    """Sums over a window about each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
