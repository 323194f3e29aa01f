"""One pass of the smoother, compared with an independent dense least-squares solution."""

import numpy as np
import pytest
from support.dense_least_squares import ORDER, DenseLeastSquares, dense_transition
from support.sizes import scaled
from support.smoothing import GLIDE, MEASURED, PETREL, H, fly, with_measured
from support.specimens import random_controls, random_disturbances, random_state

from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.dynamics import horizontal_velocity, horizontal_velocity_vjp
from gliderhpc.kernels.smoother_memory import BLOCK, allocate_block
from gliderhpc.kernels.smoother_tangent import linearised_step

STEPS = scaled(2 * BLOCK + 22, BLOCK + 6)


@pytest.fixture(scope="module")
def problem():
    """Return a dive whose path does not follow from its disturbances, with gaps in channels and heading near north."""
    flown = fly(3, STEPS, turn=0.02)
    measured = flown.dive.measured.copy()
    measured[20:50] = np.nan
    measured[60, 2] = np.nan
    measured[70, [0, 3]] = np.nan
    measured[:, 2] = np.mod(measured[:, 2], 2.0 * np.pi)
    dive = with_measured(flown.dive, measured)
    dive.noise[30:40] *= 30.0
    rng = np.random.default_rng(4)
    path = flown.glide
    states = path.states + 1e-3 * rng.standard_normal(path.states.shape)
    disturbances = path.disturbances + 0.01 * rng.standard_normal(path.disturbances.shape)
    # X and Y follow the path, and start at zero.
    states[:, 3:5] = 0.0
    return dive, Trajectory(states, disturbances)


@pytest.fixture(scope="module")
def smoothed(problem):
    dive, path = problem
    rows = tuple(range(0, STEPS + 1, 9))
    sweeps = Sweeps(PETREL.hull, dive, rows)
    iterate = sweeps.forward(path)
    return iterate, sweeps.backward(path), rows


@pytest.fixture(scope="module")
def dense(problem, smoothed):
    dive, path = problem
    return DenseLeastSquares(dive, path, GLIDE.control)


def test_the_mean_is_the_dense_solution_s(smoothed, dense):
    _, linear, _ = smoothed
    for k in range(STEPS + 1):
        expected, deviation = dense.mean(k), np.sqrt(np.diag(dense.covariance(k)))
        np.testing.assert_allclose(linear.correction[k] / deviation[:16], expected[:16] / deviation[:16], atol=1e-9)


def test_the_variances_are_the_dense_solution_s(smoothed, dense):
    _, linear, _ = smoothed
    for k in range(STEPS + 1):
        expected = np.diag(dense.covariance(k))
        actual = np.concatenate([linear.state_variance[k], linear.disturbance_variance[k], linear.track_variance[k]])
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-30)


def test_whole_covariances_are_the_dense_solution_s(smoothed, dense):
    """They are symmetric, positive semidefinite, and equal to 1e-9 of the deviations, including X and Y."""
    _, linear, rows = smoothed
    for k, covariance in zip(rows, linear.covariances, strict=True):
        expected = dense.covariance(k)
        scale = np.where(np.diag(expected) > 0.0, np.sqrt(np.diag(expected)), 1.0)
        np.testing.assert_array_equal(covariance, covariance.T)
        np.testing.assert_allclose(covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-12


def test_the_displacement_s_covariance_is_the_dense_solution_s(smoothed, dense):
    np.testing.assert_allclose(smoothed[1].displacement, dense.covariance(STEPS)[16:, 16:], rtol=1e-9)


def test_the_expected_square_of_the_noise_is_the_dense_solution_s(problem, smoothed, dense):
    linear, noise = smoothed[1], problem[0].noise
    square = linear.noise_mean**2 + noise * (1.0 - linear.noise_resolved)
    np.testing.assert_allclose(square, dense.noise_square(problem[0]), rtol=1e-9)


def test_costs_and_defects_are_those_of_the_path(problem, smoothed):
    dive, path = problem
    iterate, _, _ = smoothed
    start = np.concatenate([path.states[0, SENSED], path.disturbances[0]])
    residual = dive.measured - path.states[:, MEASURED]
    residual[:, 2] = np.arctan2(np.sin(residual[:, 2]), np.cos(residual[:, 2]))
    noise = np.diff(path.disturbances, axis=0) + (1.0 - dive.decay) * path.disturbances[:-1]
    expected = [
        0.5 * np.sum(((start - dive.mean) / dive.deviation) ** 2),
        0.5 * np.nansum(residual**2 / dive.variance),
        0.5 * np.sum(noise**2 / dive.noise),
    ]
    np.testing.assert_allclose(iterate.costs, expected, rtol=1e-10)
    flown = [step_of(dive, path, k) for k in range(STEPS)]
    defects = np.abs(np.array(flown)[:, SENSED] - path.states[1:, SENSED]).sum(axis=0)
    np.testing.assert_allclose(iterate.defects, defects, rtol=1e-9)


def step_of(dive, path, k):
    return PETREL.simulate(path.states[k], GLIDE.control[None], path.disturbances[k][None], H)[1]


def test_the_track_follows_the_path(problem, smoothed):
    dive, path = problem
    moves = [step_of(dive, path, k)[3:5] - path.states[k, 3:5] for k in range(STEPS)]
    np.testing.assert_allclose(np.diff(path.states[:, 3:5], axis=0), moves, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_tangent_is_the_step_s(seed):
    """Phi is computed from lanes of unit costates, for random states, including X and Y."""
    rng = np.random.default_rng(seed)
    state, control, b = random_state(rng), random_controls(rng, 1)[0], random_disturbances(rng, 1)[0]
    decay = np.array([0.9, 0.8, 0.95, 0.7, 0.99, 0.6])
    states, disturbances = np.tile(state, (2, 1)), np.tile(b, (2, 1))
    block = allocate_block()
    dive = fly(1, 10).dive._replace(bodies=PETREL.bodies(control[None]), decay=decay)
    new, north, east = linearised_step(PETREL.hull, dive, states, disturbances, 0, block, 0)
    Phi, expected = dense_transition(control, state, b, decay)
    Phi = Phi[np.ix_(ORDER, ORDER)]
    np.testing.assert_allclose(block.tangent[0].T, Phi[:16, :16], rtol=1e-10, atol=1e-12 * np.abs(Phi).max())
    np.testing.assert_allclose(block.track_tangent[0], Phi[16:, :16], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(new, expected[SENSED], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose([north, east], expected[3:5] - state[3:5], rtol=1e-8)


def test_the_track_s_transpose_is_that_of_its_rates():
    rng = np.random.default_rng(5)
    y = random_state(rng)[SENSED]
    steps = 1e-6 * np.eye(10)
    central = np.array([
        np.subtract(horizontal_velocity(tuple(y + d)), horizontal_velocity(tuple(y - d))) / 2e-6 for d in steps
    ])  # fmt: skip
    for north, east in ((1.0, 0.0), (0.0, 1.0), (0.4, -2.0)):
        product = horizontal_velocity_vjp(tuple(y), north, east)
        np.testing.assert_allclose(product, central @ [north, east], atol=1e-8)


def test_an_outlier_s_variance_is_widened_to_the_gate_once(problem):
    """The inflated variance puts the innovation at the gate; without a gate no variance is inflated."""
    base, path = problem
    measured = base.measured.copy()
    measured[10, 1] += 0.5
    dive = with_measured(base, measured)
    sweeps = Sweeps(PETREL.hull, dive)
    sweeps.forward(path)
    np.testing.assert_array_equal(dive.variance, base.variance)
    sweeps.forward(path, 12.0)
    widened = dive.variance > base.variance
    assert widened[10, 1]
    # The outlier's innovation lies at the gate, which includes the variance of the prediction.
    assert (0.4 / 12.0) ** 2 < dive.variance[10, 1] < (0.5 / 12.0) ** 2
    assert widened.sum() <= 3
    once = dive.variance.copy()
    sweeps.forward(path)
    np.testing.assert_array_equal(dive.variance, once)
