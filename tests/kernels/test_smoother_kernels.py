"""One pass of the smoother, compared with an independent dense least-squares solution."""

import numpy as np
import pytest
from support.dense_least_squares import ORDER, DenseLeastSquares, dense_transition
from support.smoothing import GLIDE, PETREL, SAMPLED, SEGMENTS, H, fly, with_measured, with_velocity
from support.specimens import random_controls, random_disturbances, random_state

from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory, segment_rows
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.dynamics import horizontal_velocity
from gliderhpc.kernels.elementwise import with_sizes
from gliderhpc.kernels.jacobian import track_partials
from gliderhpc.kernels.smoother_allocation import allocate_block, allocate_segments, allocate_tape
from gliderhpc.kernels.smoother_memory import BLOCK, LOG_DETERMINANT
from gliderhpc.kernels.smoother_segments import linearise_segments, scatter_after

STEPS = 4 * BLOCK + 10


@pytest.fixture(scope="module", params=SEGMENTS)
def case(request):
    """Return the largest number of steps of a segment, and whether the velocity relative to the water is measured."""
    return request.param


@pytest.fixture(scope="module")
def longest(case):
    return case[0]


@pytest.fixture(scope="module")
def problem(case):
    """Return a dive whose path does not follow from its disturbances, with gaps in channels and heading near north."""
    flown = fly(3, STEPS, turn=0.02)
    measured = flown.problem.measured.copy()
    measured[20:50] = np.nan
    measured[60, 2] = np.nan
    measured[70, [0, 3]] = np.nan
    measured[:, 2] = np.mod(measured[:, 2], 2.0 * np.pi)
    dive = with_measured(flown.problem, measured)
    if case[1]:
        measured, variance = with_velocity(flown, measured)
        dive = with_measured(dive._replace(variance=variance), measured)
    dive.noise[30:40] *= 30.0
    rng = np.random.default_rng(4)
    path = flown.glide
    states = path.states + 1e-3 * rng.standard_normal(path.states.shape)
    disturbances = path.disturbances + 0.01 * rng.standard_normal(path.disturbances.shape)
    # X and Y follow the path, and start at zero.
    states[:, 3:5] = 0.0
    return dive, Trajectory(states, disturbances)


@pytest.fixture(scope="module")
def sweeps(problem, longest):
    dive, _ = problem
    return Sweeps(PETREL.hull, dive, tuple(range(0, STEPS + 1, 9)), longest=longest)


@pytest.fixture(scope="module")
def smoothed(problem, sweeps):
    """Return the results of both sweeps; in the path, the rows inside segments are the model's run from here on."""
    _, path = problem
    iterate = sweeps.forward(path)
    return iterate, sweeps.backward(path), range(0, STEPS + 1, 9)


@pytest.fixture(scope="module")
def dense(problem, smoothed):
    dive, path = problem
    return DenseLeastSquares(dive, path, GLIDE.control)


def test_a_run_along_the_path_costs_what_the_sweep_says(problem, smoothed, sweeps):
    """Equal but for rounding, for a path whose inner rows are the model's run already; so is the path afterwards."""
    dive, path = problem
    iterate, *_ = smoothed
    again = Trajectory(path.states.copy(), path.disturbances.copy())
    run = sweeps.run(again)
    np.testing.assert_allclose(run.costs, iterate.costs, rtol=1e-14)
    np.testing.assert_allclose(run.defects, iterate.defects, rtol=1e-14)
    np.testing.assert_array_equal(again.states, path.states)
    assert run.costs.min() > 0.0
    np.testing.assert_allclose(iterate.with_noise(dive, dive.noise).costs, iterate.costs, rtol=1e-12)
    np.testing.assert_allclose(
        iterate.with_noise(dive, 2.0 * dive.noise).costs, iterate.costs * [1.0, 1.0, 0.5], rtol=1e-12
    )


def test_segments_are_short_and_have_no_sample_inside(problem, sweeps, longest):
    dive, _ = problem
    lengths = np.diff(sweeps.rows)
    assert (sweeps.rows[0], sweeps.rows[-1]) == (0, STEPS)
    assert lengths.min() >= 1
    assert lengths.max() == longest
    assert set(np.flatnonzero(dive.fed)) <= set(sweeps.rows)


def test_the_mean_is_the_dense_solution_s(smoothed, sweeps, dense):
    _, linear, _ = smoothed
    for correction, k in zip(linear.correction, sweeps.rows, strict=True):
        expected, deviation = dense.mean(k), np.sqrt(np.diag(dense.covariance(k)))
        np.testing.assert_allclose(correction / deviation[:16], expected[:16] / deviation[:16], atol=1e-9)


def test_disturbances_inside_segments_move_as_in_the_dense_solution(problem, smoothed, sweeps, dense):
    """Their move follows from the smoothed noise; half of the correction moves them half as far."""
    _, path = problem
    for fraction in (1.0, 0.5):
        moved = sweeps.moved(path, smoothed[1], fraction)
        for k in range(STEPS + 1):
            expected, deviation = dense.mean(k)[10:16], np.sqrt(np.diag(dense.covariance(k)))[10:16]
            move = (moved.disturbances - path.disturbances)[k]
            np.testing.assert_allclose(move / deviation, fraction * expected / deviation, atol=1e-9)


def test_the_variances_are_the_dense_solution_s(smoothed, sweeps, dense):
    _, linear, _ = smoothed
    for i, k in enumerate(sweeps.rows):
        expected = np.diag(dense.covariance(k))
        actual = np.concatenate([linear.state_variance[i], linear.disturbance_variance[i], linear.track_variance[i]])
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
    residual = dive.measured - path.states[:, SAMPLED[: dive.measured.shape[1]]]
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
def test_transition_and_noise_of_a_segment_are_those_of_its_steps(seed):
    """Products of the steps' transitions carry states and noise to the end, for random states, including X and Y."""
    rng = np.random.default_rng(seed)
    state, controls, b = random_state(rng), random_controls(rng, 3), random_disturbances(rng, 4)
    decay, noise = np.array([0.9, 0.8, 0.95, 0.7, 0.99, 0.6]), rng.uniform(0.1, 1.0, (3, 6))
    flown = PETREL.simulate(state, controls, b[:-1], H)
    path = Trajectory(flown.copy(), b)
    path.states[1:] += 0.01
    dive = fly(1, 3).problem._replace(bodies=PETREL.bodies(controls), decay=decay, noise=noise)
    segments, block = allocate_segments(segment_rows(dive, longest=3), [3]), allocate_block()
    linearise_segments(
        PETREL.hull, dive, path.states, path.disturbances, segments, 0, 0, block, 0, np.zeros(LOG_DETERMINANT + 1)
    )
    tape = allocate_tape(dive.fed[segments.rows], segments.represented_steps)
    scatter_after(segments, 0, tape)
    Phi, added, after = np.eye(18), np.zeros((18, 18)), np.eye(18)
    offset = np.zeros(18)
    for k in range(3):
        one, _ = dense_transition(controls[k], flown[k], b[k], decay)
        one = one[np.ix_(ORDER, ORDER)]
        after = one @ after if k else after
        Phi, added, offset = one @ Phi, one @ added @ one.T, one @ offset
        added[10:16, 10:16] += np.diag(noise[k])
        offset[10:16] += decay * b[k] - b[k + 1]
    offset[:10] += (flown[3] - path.states[3])[SENSED]
    scale = {"rtol": 1e-10, "atol": 1e-12 * np.abs(Phi).max()}
    np.testing.assert_allclose(block.tangent[0].T, Phi[:16, :16], **scale)
    np.testing.assert_allclose(block.track_tangent[0], Phi[16:, :16], **scale)
    np.testing.assert_allclose(tape.after[0], after[:16, :16], **scale)
    np.testing.assert_allclose(segments.noise[0], added[:16, :16], **scale)
    np.testing.assert_allclose(segments.noise_cross[0], added[16:, :16], **scale)
    np.testing.assert_allclose(segments.noise_track[0], added[16:, 16:], **scale)
    np.testing.assert_allclose(segments.offset[0], offset[:16], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(path.states[1:3, SENSED], flown[1:3, SENSED], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(path.states[:, 3:5] - path.states[0, 3:5], flown[:, 3:5] - flown[0, 3:5], atol=1e-12)


def test_the_track_s_derivatives_are_those_of_its_rates():
    rng = np.random.default_rng(5)
    y = random_state(rng)[SENSED]
    steps = 1e-6 * np.eye(10)
    central = np.array([
        np.subtract(horizontal_velocity(tuple(y + d)), horizontal_velocity(tuple(y - d))) / 2e-6 for d in steps
    ])  # fmt: skip
    found = np.zeros((10, 2))
    found[[0, 1, 2, 4, 5, 6]] = np.transpose(track_partials(tuple(y)))
    for north, east in ((1.0, 0.0), (0.0, 1.0), (0.4, -2.0)):
        np.testing.assert_allclose(found @ [north, east], central @ [north, east], atol=1e-8)


def test_an_outlier_s_variance_is_widened_to_the_gate_once(problem, longest):
    """The inflated variance puts the innovation at the gate; without a gate no variance is inflated."""
    base, shared = problem
    # A sweep over other segments changes the rows inside them.
    path = Trajectory(shared.states.copy(), shared.disturbances.copy())
    measured = base.measured.copy()
    measured[10, 1] += 0.5
    dive = with_measured(base, measured)
    sweeps = Sweeps(PETREL.hull, dive, longest=longest)
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


def test_the_declared_sizes_are_those_of_the_memory(problem, sweeps):
    """Kernels rely on them, and only code without the compiler checks them."""
    dive, _ = problem
    assert with_sizes(dive) is dive
    for memory in (sweeps._segments, sweeps._block, sweeps._tape, sweeps._backward):
        assert with_sizes(memory) is memory
