"""Noise of the fast disturbances as it comes and goes within a dive.

The smoother takes one scale of the noise for a whole dive. What the water does to the yaw comes in bursts with quiet
between, and a filter that takes the dive's mean for the noise of a quiet stretch follows its own sensors' errors there:
its innovations are no longer white, and what they seem to say of the hull's damping is wrong (docs/smoother.md).
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_memory import Dive

Array = NDArray[np.float64]

FAST = 120.0
"""Disturbances with a shorter correlation time (s) have a local scale."""
WINDOW = 5.0
"""Sample intervals over which the local scale is taken."""
_PRIOR_WEIGHT = 2.0
"""Resolved values that the scale so far is worth."""
_ROUNDS = 2
_RANGE = (1e-3, 1e3)
"""Bounds of a round's change of a variance."""


def with_local_noise(hull: Hull, dive: Dive, trajectory: Trajectory, sample_interval: float) -> Dive:
    """Return a dive's problem with the noise of its fast disturbances scaled locally.

    Parameters
    ----------
    hull, dive, trajectory : Hull, Dive, Trajectory
        The problem, and the smoothed trajectory.
    sample_interval : float
        s.

    Notes
    -----
    The factor of a stretch is that of `gliderhpc.estimation.smoother.noise.NoiseScale`: the squares of the smoothed
    noise over their variances, in sum, over the number of values that the record resolves.
    """
    channels = np.flatnonzero(dive.step / -np.log(dive.decay) < FAST)
    if not channels.size:
        return dive
    local = dive._replace(
        noise=dive.noise.copy(), mean_shift=np.zeros_like(dive.mean_shift), damping=np.full(6, np.inf)
    )
    width = max(1, round(WINDOW * sample_interval / dive.step))
    sweeps, copied = Sweeps(hull, local), Trajectory(trajectory.states.copy(), trajectory.disturbances)
    for _ in range(_ROUNDS):
        sweeps.forward(copied)
        linear = sweeps.backward(copied)
        spent = _sums(linear.noise_mean[:, channels] ** 2 / local.noise[:, channels], width)
        resolved = _sums(linear.noise_resolved[:, channels], width)
        local.noise[:, channels] *= np.clip((spent + _PRIOR_WEIGHT) / (resolved + _PRIOR_WEIGHT), *_RANGE)
    return local


def _sums(values: Array, width: int) -> Array:
    """Sums over a window about each row."""
    return np.asarray(width * scipy.ndimage.uniform_filter1d(values, width, axis=0, mode="nearest"))
