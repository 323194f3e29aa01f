"""Short simulated dives for the smoother's tests, as MAP problems."""

from dataclasses import dataclass

import numpy as np
import pytest

from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.kernels.smoother_memory import SmootherProblem
from gliderhpc.platform import read_platform
from gliderhpc.simulator.disturbance import RandomProcess
from gliderhpc.simulator.sections import GaussMarkov
from support.sizes import COMPILED

PETREL = Glider(read_platform("petrel-l"))
H = 0.1
GLIDE = steady_glide(PETREL, 0.4, -np.radians(23.0), 100.0)
MEASURED = [0, 1, 2, 5]
SAMPLED = [*MEASURED, 6, 7, 8]
"""Places of the samples among eq. 16's states where the velocity relative to the water is measured too."""
DEVIATION = np.array([0.08, 0.05, 0.05, 0.025, 0.01, 0.25])
TIME = np.array([60.0, 30.0, 60.0, 30.0, 60.0, 20.0])
START_DEVIATION = np.array([0.01, 0.01, 0.01, 0.2, 0.05, 0.02, 0.03, 0.02, 0.02, 0.02])
NOISE = np.array([5e-4, 5e-4, 5e-4, 0.03])


SEGMENTS = [
    pytest.param(case, id=name)
    for name, case in {"steps": (1, False), "segments": (3, False), "velocity": (3, True)}.items()
    if COMPILED or name != "segments"
]
"""Largest number of steps of a segment, and whether the velocity is measured: parameters of a module's fixture.

Uncompiled, the case in the middle is left out; each of its two values is in another case."""


@dataclass(frozen=True)
class Flown:
    """A dive of ``n`` steps and its measurements.

    Attributes
    ----------
    problem : SmootherProblem
        The problem.
    states, disturbances : (n+1, 12), (n, 6)
        Truth.
    """

    problem: SmootherProblem
    states: np.ndarray
    disturbances: np.ndarray

    @property
    def glide(self):
        """Trajectory of the undisturbed glide from the prior's initial state."""
        n = len(self.disturbances)
        state = np.zeros(12)
        state[SENSED] = self.problem.mean[:10]
        return Trajectory(PETREL.simulate(state, controls(n), np.zeros((n, 6)), H), np.zeros((n + 1, 6)))

    @property
    def guess(self):
        """The glide's speeds and rates, attitude and depth as measured: no trajectory of the model."""
        path = self.glide
        every = np.arange(len(path.states))
        for index, column in zip(MEASURED, self.problem.measured.T, strict=True):
            known = np.isfinite(column)
            path.states[:, index] = np.interp(every, every[known], column[known])
        return path


def controls(n):
    return np.tile(GLIDE.control, (n, 1))


def fly(seed, n, every=10, turn=0.0):
    """Fly with disturbances drawn from the prior, at half the step, from a drawn start; heading begins at ``turn``."""
    rng = np.random.default_rng(seed)
    process = RandomProcess(GaussMarkov(deviation=tuple(DEVIATION), correlation_time=tuple(TIME)), seed)
    fine = process.sampled(2 * n, H / 2.0)
    mean = np.concatenate([GLIDE.state[SENSED], np.zeros(6)])
    mean[2] = turn
    start = np.zeros(12)
    start[SENSED] = mean[:10] + START_DEVIATION * rng.standard_normal(10)
    states = PETREL.simulate(start, controls(2 * n), fine, H / 2.0)[::2]
    measured = np.full((n + 1, 4), np.nan)
    measured[::every] = states[::every][:, MEASURED] + NOISE * rng.standard_normal((n // every + 1, 4))
    added = DEVIATION**2 * -np.expm1(-2.0 * H / TIME)
    problem = SmootherProblem(
        bodies=PETREL.bodies(controls(n)), step=H, fed=np.isfinite(measured).any(axis=1), measured=measured,
        variance=np.tile(NOISE**2, (n + 1, 1)), mean=mean, deviation=np.concatenate([START_DEVIATION, DEVIATION]),
        decay=np.exp(-H / TIME), noise=np.tile(added, (n, 1)), damping=np.full(6, np.inf),
    )  # fmt: skip
    return Flown(problem, states, 0.5 * (fine[::2] + fine[1::2]))


def with_measured(dive, measured):
    """Return a problem with other measurements and their variances."""
    fed = np.isfinite(measured).any(axis=1)
    return dive._replace(measured=measured, fed=fed, variance=dive.variance.copy(), noise=dive.noise.copy())


def with_velocity(flown, measured, seed=8):
    """Add samples of the velocity relative to the water, some of them missing, to ``measured (n+1, 4)``.

    They have a deviation of 0.02 m/s; the variances are returned too.
    """
    rng = np.random.default_rng(seed)
    velocity = flown.states[:, 6:9] + 0.02 * rng.standard_normal((len(measured), 3))
    velocity[~np.isfinite(measured).any(axis=1)] = np.nan
    velocity[10, 0] = np.nan
    variance = np.hstack([flown.problem.variance, np.full((len(measured), 3), 4e-4)])
    return np.hstack([measured, velocity]), variance
