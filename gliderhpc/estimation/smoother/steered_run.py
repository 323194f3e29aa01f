"""Path about which the model is linearised for the information on the hull: a run of the model, without noise or gusts.

The score of the hull's errors is unbiased if the innovations and their derivatives do not contain the same noise. A
filter is not optimal if the disturbances are not distributed as it assumes: in calm water it follows the noise of its
sensors, in gusts it lags behind, and slow forces leave innovations of one sign for minutes. Its innovations then depend
on past noise, and so does the path at which the derivatives are taken; the product of the two biases the hull. A surge
force that varies over ten to forty minutes, for example, would reduce the estimated drag by a fifth.

The run has the mean surge force, heave force and pitch moment of each dive and climb, and is otherwise steered slowly
along the smoothed path. It follows the glider, but hardly any noise or gusts. Its derivatives come mainly from the
motion of the actuators, which serves as an instrumental variable: their product with the innovations has little bias,
whatever the noise. Slow records are smoothed about such a run too (`gliderhpc.estimation.smoother.iterate`).

The difference between the yaw rates of path and run also shows whether yaw moments act in bursts (`find_gusts`).
"""

from collections.abc import Callable
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR
from gliderhpc.estimation.sensor_noise import sample_differences, sample_variance
from gliderhpc.estimation.smoother.problem import RollingGusts, Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.follow import follow

Array = NDArray[np.float64]

_TURNING_RATE, _GLIDING_RATE = 0.01, 0.001
"""Decay rates of the run's distance from the path, 1/s: in sway, roll and yaw, and in surge, heave and pitch."""

_TRACKING_RATE = 0.3
"""Decay rate in sway, roll and yaw of a run that has the filter's forces there, 1/s."""

_MEAN = 120.0
"""Length of the moving mean of the path's lateral disturbances that act on the run, s."""

_PITCH, _DEPTH = 1, 5
"""Indices of pitch and depth among the states of eq. 16."""
_GLIDING, _TURNING, _FORCES = [1, 3, 4, 6, 8], [0, 2, 5, 7, 9], [0, 2, 4]
"""Indices of pitch, depth, u, w and q and of roll, heading, v, p and r among the sensed states, and of surge, heave and
pitch among the disturbances."""
_SPEED, _RATES = 4, slice(7, 10)
"""Indices of u, and of p, q and r, among the sensed states."""

_MAX_RATE_DIFFERENCE = 3.0
"""Largest difference of turning rates, in units of the angles' resolution per sample interval. On twins it was at most
0.7 in shear and gusts and about 2 in weak yaw impulses, where the run is better, and about 4 in strong impulses, where
the filter's path is."""

_MAX_SPEED_DIFFERENCE = 0.25
"""Largest difference of the speeds, relative to the speed, for a run that represents the profile."""

_MIN_ROLL_SCATTER = 1.25
"""Typical second difference of the roll's samples, relative to that of noise, that shows gusts. On twins of eight hulls
it was at most 1.16 in calm water, internal waves and yaw impulses, at least 1.22 in gusts of 5 mm/s, and at least 1.4
in gusts of 7 mm/s."""

_MIN_BURST_RATIO = 1.6
"""Ratio of the root mean square difference of yaw rates to the typical one that shows impulses between quiet stretches.
On twins in gusts it was at most 1.5 without and at least 1.8 with impulses."""

_STRETCH_LENGTH = 20.0
"""Length of the stretches over which differences are averaged; their median is the typical difference, s."""

_MIN_DEPTH = 5.0
"""Depth above which waves roll the glider, m."""


def information_path(profile: PreparedProfile, smoothed: Trajectory, filtered: Callable[[], Trajectory]) -> Trajectory:
    """Return the path about which the information on the hull is computed.

    Parameters
    ----------
    profile : PreparedProfile
        The profile on its ``n`` steps.
    smoothed : Trajectory
        Smoothed path.
    filtered : callable
        Function that returns the path of a filter; called only where it is needed.

    Returns
    -------
    Trajectory
        A run of the model, steered along the smoothed path. If the water turns the glider so much that this run does
        not represent the profile, only surge, heave and pitch are those of a run, and sway, roll and yaw are the
        filter's. If no run represents the profile, as on a wrong hull, the filter's path.

    Notes
    -----
    In a slow record the smoothed rates between samples are not known well enough to judge a run by them: with the prior
    of slow sensors the pitch swings by half a degree. There any run that keeps the speed is used.
    """
    run = run_along(profile, smoothed)
    if run is not None and (profile.is_slow or _follows_rates(profile, smoothed, run)):
        return run
    path = filtered()
    gliding, forces = _steered_states(profile, smoothed, turning=path)
    if not (_distances(profile, smoothed, gliding)[1] <= _MAX_RATE_DIFFERENCE and _keeps_speed(smoothed, gliding)):
        return path
    states, disturbances = path.states[:, SENSED], path.disturbances[:-1].copy()
    states[:, _GLIDING], disturbances[:, _FORCES] = gliding[:, _GLIDING], forces[:, _FORCES]
    return _trajectory(path, states, disturbances)


def run_along(profile: PreparedProfile, smoothed: Trajectory) -> Trajectory | None:
    """Return a run of the model that is steered slowly along a smoothed path, or None if none keeps the path's speed.

    The run contains hardly any noise of the record. It has the path's mean surge force, heave force and pitch moment of
    each dive and each climb, and moving means of the other disturbances.
    """
    run, disturbances = _steered_states(profile, smoothed)
    return _trajectory(smoothed, run, disturbances) if _keeps_speed(smoothed, run) else None


def _follows_rates(profile: PreparedProfile, path: Trajectory, run: Trajectory) -> bool:
    """Return whether the rates of pitch and yaw of a run are about those of the path."""
    return bool((_distances(profile, path, run.states[:, SENSED])[1:] <= _MAX_RATE_DIFFERENCE).all())


def find_gusts(profile: PreparedProfile, filtered: Trajectory) -> RollingGusts | None:
    """Return the gusts that roll the glider: its roll changes from sample to sample by more than the sensor's noise.

    Parameters
    ----------
    profile, filtered : PreparedProfile, Trajectory
        The profile on its ``n`` steps, and the filter's path.

    Returns
    -------
    RollingGusts or None
        None for slow records, which do not resolve this motion. Samples near the surface and in the vibration set do
        not count.

    Notes
    -----
    On twins, gusts of 5 mm/s are enough to make the speed of the true hull wrong by several of its deviations. The
    difference of the path's roll rate from the run's does not show them, because the filter smooths it; the samples do.
    Yaw impulses, which roll the glider too, last for seconds, and the median over short stretches excludes them.
    """
    sensors = profile.glider.platform.sensors
    used = ~profile.vibrating & (filtered.states[:, _DEPTH] > _MIN_DEPTH)
    width = round(_STRETCH_LENGTH / profile.series.step)
    if max(profile.series.sample_interval, sensors.sample_interval) > SLOW_SENSORS_PRIOR or used.sum() < width:
        return None
    if roll_scatter(profile, used) <= _MIN_ROLL_SCATTER:
        return None
    run, _ = _steered_states(profile, filtered)
    squares = _squared_differences(profile, filtered, run)[used]
    stretches = squares[: len(squares) // width * width, 2].reshape(-1, width).mean(axis=1)
    typical = np.sqrt(np.median(stretches))
    return RollingGusts(with_bursts=bool(np.sqrt(squares[:, 2].mean()) > _MIN_BURST_RATIO * typical))


def roll_scatter(profile: PreparedProfile, used: NDArray[np.bool_]) -> float:
    """Typical second difference between samples of the roll on rows used, relative to that of the sensor's noise."""
    series = profile.series
    differences = sample_differences(series, used, 2)[:, 0]
    length = max(1, round(_STRETCH_LENGTH / series.sample_interval))
    if len(differences) < length:
        return 0.0
    stretches = differences[: len(differences) // length * length].reshape(-1, length)
    noise = comb(4, 2) * sample_variance(profile.glider.platform, series)[0]
    return float(np.sqrt(np.median((stretches**2).mean(axis=1)) / noise))


def _steered_states(
    profile: PreparedProfile, path: Trajectory, turning: Trajectory | None = None
) -> tuple[Array, Array]:
    """Sensed states ``(n+1, 10)`` and disturbances ``(n, 6)`` of a run along a path, or turning along another one."""
    step, steps = profile.series.step, len(profile.bodies)
    run = path.states[:, SENSED].copy()
    if turning is None:
        rate, width = _TURNING_RATE, max(1, round(_MEAN / step))
        disturbances = scipy.ndimage.uniform_filter1d(path.disturbances[:steps], width, axis=0, mode="nearest")
    else:
        rate, disturbances = _TRACKING_RATE, turning.disturbances[:steps].copy()
        run[:, _TURNING] = turning.states[:, SENSED][:, _TURNING]
    nose_up, forces = path.states[:steps, _PITCH] > 0.0, path.disturbances[:steps, _FORCES]
    for phase in (nose_up, ~nose_up):
        if phase.any():
            forces[phase] = forces[phase].mean(axis=0)
    disturbances[:, _FORCES] = forces
    follow(profile.glider.hull, profile.bodies, disturbances, step, rate, _GLIDING_RATE, run)
    return run, disturbances


def _trajectory(path: Trajectory, run: Array, disturbances: Array) -> Trajectory:
    """Trajectory of sensed states ``(n+1, 10)`` and disturbances ``(n, 6)``, with the track of a path."""
    states = path.states.copy()
    states[:, SENSED] = run
    return Trajectory(states, np.vstack([disturbances, disturbances[-1]]))


def _keeps_speed(path: Trajectory, run: Array) -> bool:
    """Return whether the run is about as fast as the path; False if any of its states diverges."""
    if not np.isfinite(run).all():
        return False
    speed = path.states[:, SENSED][:, _SPEED]
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.mean((run[:, _SPEED] - speed) ** 2) <= _MAX_SPEED_DIFFERENCE**2 * np.mean(speed**2))


def _distances(profile: PreparedProfile, path: Trajectory, run: Array) -> Array:
    """Root mean square differences ``(3,)`` of the rates p, q and r, in the units of `_squared_differences`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(_squared_differences(profile, path, run).mean(axis=0)))


def _squared_differences(profile: PreparedProfile, path: Trajectory, run: Array) -> Array:
    """Squared differences ``(n+1, 3)`` of the rates p, q and r, in units of the angles' resolution per sample interval.

    The squares overflow if the run diverges; NaN fails every comparison, as intended.
    """
    resolution = np.radians(profile.glider.platform.sensors.attitude_resolution)
    with np.errstate(over="ignore", invalid="ignore"):
        difference = (run - path.states[:, SENSED])[:, _RATES] * profile.series.sample_interval / resolution
        return np.asarray(difference**2)
