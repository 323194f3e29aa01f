"""A window in each lane: cost and gradient are those of the scalar kernel, independent of the other lanes."""

from dataclasses import replace

import numpy as np
import pytest
from support.posed_windows import SCALE, window_data
from support.sizes import scaled

from gliderhpc.estimation.engines import WindowProblem
from gliderhpc.estimation.windows import WindowData
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.lane_memory import allocate, load_window, read_window
from gliderhpc.kernels.parameters import Body

LONGEST = scaled(300, 12)
RUDDER = Body._fields.index("rudder")
HULLS = ("petrel-l", "seawing", "seaglider", "petrel-l")


def several_windows() -> list[tuple[WindowData, np.ndarray]]:
    """Return a window per lane, with different length, hull, rudder, weights and disturbance; the first is longest."""
    rng = np.random.default_rng(0)
    posed = []
    for lane in range(LANES):
        steps = LONGEST if lane == 0 else int(rng.integers(1, LONGEST + 1))
        truth = rng.normal(size=(steps, 6)) * SCALE
        data = window_data(steps, disturbance=truth, seed=lane, hull=HULLS[lane % len(HULLS)])
        weights = np.where(rng.uniform(size=steps + 1) < 0.2, 0.0, rng.uniform(0.5, 1.0, steps + 1))
        start = rng.normal(size=(steps, 6)) * SCALE
        bodies = data.bodies.copy()
        bodies[:, RUDDER] = rng.uniform(-0.3, 0.3, steps)
        hull = data.hull._replace(K_delta=rng.uniform(0.0, 20.0))
        posed.append((replace(data, weights=weights, bodies=bodies, hull=hull), start))
    return posed


def evaluate(posed, steps, implementation):
    """Evaluate all windows together, in memory for a number of steps; return the memory."""
    p, descent, progress = allocate(steps, 1)
    for lane, (data, disturbance) in enumerate(posed):
        load_window(
            p, descent, progress, lane, data.hull, data.bodies, data.state0, data.measurements, data.weights,
            data.step, data.scale, disturbance, 1.0, 1,
        )  # fmt: skip
    implementation.evaluate(p)
    return p


def evaluated(posed, implementation, steps=LONGEST):
    """Return cost, gradient, states and disturbances of each window, all evaluated together."""
    problem, results = evaluate(posed, steps, implementation), []
    for lane, (data, _) in enumerate(posed):
        n = len(data.bodies)
        disturbances, states = np.empty((n, 6)), np.empty((n + 1, 10))
        read_window(problem, lane, disturbances, states)
        results.append((problem.cost[0, lane], problem.gradient[:n, :, lane].copy(), states, disturbances))
    return results


def test_cost_and_gradient_are_the_scalar_kernels(implementation):
    """They agree to 1e-13, for windows of different lengths together; shorter ones end with steps of zero length."""
    posed = several_windows()
    for (cost, gradient, states, disturbances), (data, given) in zip(
        evaluated(posed, implementation), posed, strict=True
    ):
        problem = WindowProblem(data)
        expected, by_x = problem.evaluate((given / data.scale).ravel())
        by_b = by_x.reshape(-1, 6) / data.scale
        assert cost == pytest.approx(expected, rel=1e-13)
        np.testing.assert_allclose(gradient, by_b, rtol=0.0, atol=1e-13 * np.abs(by_b).max())
        np.testing.assert_allclose(states, problem.states, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(disturbances, given, rtol=1e-15)


def test_a_window_does_not_know_its_lane_nor_its_neighbours(implementation):
    """Its bits are the same in every lane, alone or with others, with or without steps of zero length at its end."""
    posed = several_windows()
    expected = evaluated(posed, implementation)
    for shift in range(1, LANES):
        turned = evaluated(posed[shift:] + posed[:shift], implementation)
        for ours, theirs in zip(turned, expected[shift:] + expected[:shift], strict=True):
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_array_equal(a, b)
    for one, theirs in zip(posed, expected, strict=True):
        for steps in (len(one[0].bodies), LONGEST + 5):
            (alone,) = evaluated([one], implementation, steps)
            for a, b in zip(alone, theirs, strict=True):
                np.testing.assert_array_equal(a, b)


def test_steps_beyond_the_end_of_a_window_have_no_gradient(implementation):
    """Gradients of steps of zero length are zero; these steps cannot change an unknown."""
    p = evaluate([(window_data(5), np.full((5, 6), 0.01))], LONGEST, implementation)
    assert np.abs(p.gradient[:5, :, 0]).min() > 0.0
    np.testing.assert_array_equal(p.gradient[5:, :, 0], 0.0)
    np.testing.assert_array_equal(p.states[6:, :, 0], np.broadcast_to(p.states[5, :, 0], (LONGEST - 5, 10)))


@pytest.mark.parametrize("where", ["measurements", "bodies", "state0"])
def test_nan_stays_in_its_lane(where, implementation):
    posed = several_windows()
    expected = evaluated(posed, implementation)
    data, start = posed[1]
    corrupted = getattr(data, where).copy()
    corrupted[-1] = np.nan
    posed[1] = replace(data, **{where: corrupted}), start
    with np.errstate(invalid="ignore"):
        results = evaluated(posed, implementation)
    assert np.isnan(results[1][0])
    for lane in (0, *range(2, LANES)):
        for a, b in zip(results[lane], expected[lane], strict=True):
            np.testing.assert_array_equal(a, b)
