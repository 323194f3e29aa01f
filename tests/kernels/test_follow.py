"""Run that follows a path: an exact trajectory under the disturbance that it returns, and close to the path."""

import numpy as np
from support.sizes import scaled
from support.smoothing import GLIDE, PETREL, H, controls
from support.specimens import random_disturbances

from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.follow import follow

STEPS = scaled(60, 16)


def test_a_run_that_follows_a_path_is_a_trajectory_near_it():
    """Its states agree with an independent run under its disturbances; the path's jumps decay."""
    rng = np.random.default_rng(3)
    start = GLIDE.state
    given = 0.05 * random_disturbances(rng, STEPS)
    path = PETREL.simulate(start, controls(STEPS), given, H)[:, SENSED].copy()
    path[STEPS // 2 :, 2] += np.radians(0.5)
    states, disturbances = path.copy(), given.copy()
    follow(PETREL.hull, PETREL.bodies(controls(STEPS)), disturbances, H, 2.0, 2.0, states)
    run = PETREL.simulate(start, controls(STEPS), disturbances, H)[:, SENSED]
    np.testing.assert_allclose(states, run, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(disturbances[: STEPS // 2], given[: STEPS // 2], atol=1e-10)
    apart = np.abs(states[:, 2] - path[:, 2])
    assert apart[STEPS // 2] > 0.9 * np.radians(0.5)
    assert apart[-1] < 0.9 * np.radians(0.5)


def test_turns_and_glides_are_steered_at_different_rates():
    """A jump of the target's heading hardly decays where turns are steered slowly, and one of its pitch decays."""
    start = GLIDE.state
    path = PETREL.simulate(start, controls(STEPS), np.zeros((STEPS, 6)), H)[:, SENSED].copy()
    path[1:, 1:3] += np.radians(0.5)
    apart = {}
    for rates in ((0.01, 2.0), (2.0, 0.01)):
        states = path.copy()
        follow(PETREL.hull, PETREL.bodies(controls(STEPS)), np.zeros((STEPS, 6)), H, *rates, states)
        apart[rates] = np.abs(states[-1, 1:3] - path[-1, 1:3])
    assert apart[0.01, 2.0][0] < 0.9 * apart[2.0, 0.01][0]
    assert apart[2.0, 0.01][1] < 0.9 * apart[0.01, 2.0][1]
