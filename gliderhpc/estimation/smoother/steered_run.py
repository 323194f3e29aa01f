"""Path of linearisation without the noise of the sensors, for a dive's information on its hull.

The score of the hull's errors is unbiased if the innovations and their derivatives do not contain the same noise. A
filter whose disturbances are not distributed like the water's is not optimal: in calm water it follows the noise of its
sensors, and in gusts it lags behind. Its innovations then depend on past noise, and so does the path at which the
derivatives are taken; their product biases the hull. A run of the model that is steered slowly along the smoothed path
follows the glider, but hardly any noise or gusts faster than about a hundred seconds. Its derivatives come mainly from
the motion of the actuators, like an instrumental variable: their product with the innovations has little bias, whatever
the noise.
"""

import numpy as np
import scipy

from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.follow import follow

_STEERING_RATE = 0.01
"""Decay rate of the run's distance from the smoothed path, 1/s."""

_MEAN = 120.0
"""Length of the moving mean of the smoothed disturbances that act on the run, s."""

_TURNING = slice(8, 10)
"""Indices of q and r among the sensed states; not of p, since gusts roll the glider without turning it."""

_MOST = 3.0
"""Largest difference of turning rates, in units of the angles' resolution per sample interval. On twins it was at most
0.7 in shear and gusts and about 2 in weak yaw impulses, where the run is better, and about 4 in strong impulses, where
the filter's path is."""


def steered_run(profile: PreparedProfile, smoothed: Trajectory) -> Trajectory | None:
    """Return the run steered along the smoothed path, or None in water that turns the glider much.

    Parameters
    ----------
    profile : PreparedProfile
        The profile on its ``n`` steps.
    smoothed : Trajectory
        Smoothed path.

    Returns
    -------
    Trajectory or None
        The run. None if its rates of pitch or yaw differ from the smoothed ones, root mean square, by more than
        three units of the angles' resolution per sample interval: then the disturbances drive motion that the run
        lacks, and the derivatives at the run would be those of another dive.
    """
    step, steps = profile.series.step, len(profile.bodies)
    width = max(1, round(_MEAN / step))
    mean = scipy.ndimage.uniform_filter1d(smoothed.disturbances[:steps], width, axis=0, mode="nearest")
    disturbances, run = np.ascontiguousarray(mean), np.ascontiguousarray(smoothed.states[:, SENSED])
    follow(profile.glider.hull, profile.bodies, disturbances, step, _STEERING_RATE, run)
    # A run that flies off has rates without a square; NaN fails the comparison, as intended.
    with np.errstate(over="ignore", invalid="ignore"):
        apart = np.sqrt(np.mean((run - smoothed.states[:, SENSED])[:, _TURNING] ** 2, axis=0))
    if not (apart <= _MOST * _resolved_rate(profile)).all():
        return None
    states = smoothed.states.copy()
    states[:, SENSED] = run
    return Trajectory(states, np.vstack([disturbances, disturbances[-1]]))


def _resolved_rate(profile: PreparedProfile) -> float:
    """Turning rate that changes an angle by its resolution between two samples, rad/s."""
    resolution = np.radians(profile.glider.platform.sensors.attitude_resolution)
    return float(resolution / profile.series.sample_interval)
