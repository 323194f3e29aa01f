"""A run of the model that is steered slowly along a path: what the glider would do without noise and without gusts.

It is the path of linearisation for a dive's information on its hull. The score of the hull's errors is unbiased if the
innovations and their derivatives do not contain the same noise. A filter whose disturbances are not distributed like
the water's is not optimal: in calm water it follows the noise of its sensors, and in gusts it lags behind. Its
innovations then depend on past noise, and so does the path at which the derivatives are taken; their product biases the
hull. The run follows the glider, but hardly any noise or gusts faster than about a hundred seconds. Its derivatives
come mainly from the motion of the actuators, like an instrumental variable: their product with the innovations has
little bias, whatever the noise.

The rates at which path and run turn apart also tell whether gusts roll the glider.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import SLOW_SENSORS_PRIOR
from gliderhpc.estimation.smoother.problem import Gusts, Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.follow import follow

Array = NDArray[np.float64]

_STEERING_RATE = 0.01
"""Decay rate of the run's distance from the path, 1/s."""

_MEAN = 120.0
"""Length of the moving mean of the path's disturbances that act on the run, s."""

_DEPTH = 5
"""Index of the depth among the states of eq. 16."""
_RATES = slice(7, 10)
"""Indices of p, q and r among the sensed states."""

_MOST = 3.0
"""Largest difference of turning rates, in units of the angles' resolution per sample interval. On twins it was at most
0.7 in shear and gusts and about 2 in weak yaw impulses, where the run is better, and about 4 in strong impulses, where
the filter's path is."""

_GUSTY = 0.6
"""Typical difference of roll rates, in the same units, that shows gusts. About the filter's path it was at most 0.5 on
twins in calm water and in yaw impulses, and 0.75 to 2.4 in gusts."""

_BURSTS = 1.6
"""Ratio of the root mean square difference of yaw rates to the typical one that shows impulses between quiet stretches.
On twins in gusts it was at most 1.5 without and at least 1.8 with impulses."""

_STRETCH = 20.0
"""Length of the stretches whose median difference is the typical one, s."""

_MIN_DEPTH = 5.0
"""Depth above which waves roll the glider, m."""


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
        lacks, and the derivatives at the run would be those of another dive. Roll does not count, since gusts
        roll the glider more than they turn it.
    """
    run, disturbances = _run_along(profile, smoothed)
    with np.errstate(over="ignore", invalid="ignore"):
        apart = np.sqrt(_squared_differences(profile, smoothed, run).mean(axis=0))
    if not (apart[1:] <= _MOST).all():
        return None
    states = smoothed.states.copy()
    states[:, SENSED] = run
    return Trajectory(states, np.vstack([disturbances, disturbances[-1]]))


def find_gusts(profile: PreparedProfile, filtered: Trajectory) -> Gusts | None:
    """Return the gusts that roll the glider: its roll rate differs from the run's, typically more than its yaw rate.

    Parameters
    ----------
    profile, filtered : PreparedProfile, Trajectory
        The profile on its ``n`` steps, and the filter's path.

    Returns
    -------
    Gusts or None
        None for slow records, which do not resolve this motion. Samples near the surface and in the vibration set do
        not count.

    Notes
    -----
    On twins a yaw moment turns the glider twice as fast as it rolls it, and gusts from the side roll it twice as fast
    as they turn it. Yaw impulses last for seconds. The median over short stretches shows the gusts between them.
    """
    sensors = profile.glider.platform.sensors
    used = ~profile.vibrating & (filtered.states[:, _DEPTH] > _MIN_DEPTH)
    width = round(_STRETCH / profile.series.step)
    if max(profile.series.sample_interval, sensors.sample_interval) > SLOW_SENSORS_PRIOR or used.sum() < width:
        return None
    run, _ = _run_along(profile, filtered)
    squares = _squared_differences(profile, filtered, run)[used]
    stretches = squares[: len(squares) // width * width].reshape(-1, width, 3).mean(axis=1)
    roll, _, yaw = np.sqrt(np.median(stretches, axis=0))
    if not (roll > _GUSTY and roll > yaw):
        return None
    return Gusts(with_bursts=bool(np.sqrt(squares[:, 2].mean()) > _BURSTS * yaw))


def _run_along(profile: PreparedProfile, path: Trajectory) -> tuple[Array, Array]:
    """Sensed states ``(n+1, 10)`` and disturbances ``(n, 6)`` of the run steered along a path."""
    step, steps = profile.series.step, len(profile.bodies)
    width = max(1, round(_MEAN / step))
    mean = scipy.ndimage.uniform_filter1d(path.disturbances[:steps], width, axis=0, mode="nearest")
    disturbances, run = np.ascontiguousarray(mean), np.ascontiguousarray(path.states[:, SENSED])
    follow(profile.glider.hull, profile.bodies, disturbances, step, _STEERING_RATE, run)
    return run, disturbances


def _squared_differences(profile: PreparedProfile, path: Trajectory, run: Array) -> Array:
    """Squared differences ``(n+1, 3)`` of the rates p, q and r, in units of the angles' resolution per sample interval.

    A run that flies off has rates whose squares overflow; NaN fails every comparison, as intended.
    """
    resolution = np.radians(profile.glider.platform.sensors.attitude_resolution)
    with np.errstate(over="ignore", invalid="ignore"):
        apart = (run - path.states[:, SENSED])[:, _RATES] * profile.series.sample_interval / resolution
        return np.asarray(apart**2)
