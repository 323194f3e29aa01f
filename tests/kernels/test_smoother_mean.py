"""Mean shift: from the most probable path to the mean, and its effect on dives with a skewed posterior."""

import numpy as np
import pytest
from support.dense_least_squares import ORDER, DenseLeastSquares
from support.smoothing import GLIDE, PETREL, H, fly

from gliderhpc.estimation.settings import SmootherSettings
from gliderhpc.estimation.smoother.iterate import consistency, iterate_passes
from gliderhpc.estimation.smoother.problem import Sweeps, Trajectory
from gliderhpc.kernels.smoother_allocation import allocate_backward
from gliderhpc.outcomes import Outcome

pytestmark = pytest.mark.compiled

STEPS = 40


@pytest.fixture(scope="module")
def flown():
    return fly(5, STEPS, every=4)


def trajectory(start, noise, dive):
    """Return the trajectory (eq. 20) of an initial state (16) and the noise of every step."""
    states, disturbances = np.zeros((STEPS + 1, 12)), np.zeros((STEPS + 1, 6))
    disturbances[0] = start[10:]
    for k in range(STEPS):
        disturbances[k + 1] = dive.decay * disturbances[k] + noise[k]
    state = np.zeros(12)
    state[ORDER[:10]] = start[:10]
    states = PETREL.simulate(state, np.tile(GLIDE.control, (STEPS, 1)), disturbances[:-1], H)
    return Trajectory(states, disturbances)


def half_log_determinant(path, dive):
    """Return half the log-determinant of the cost's Hessian with respect to whitened initial deviation and noise."""
    root = DenseLeastSquares(dive, path, GLIDE.control).root
    return -float(np.linalg.slogdet(root)[1])


@pytest.mark.long
def test_the_mean_shift_is_the_gradient_of_half_the_log_determinant(flown):
    """The sum of the mean shifts along a direction of initial state and noise is the change of the log-determinant."""
    dive, rng = flown.problem, np.random.default_rng(1)
    start, noise = dive.mean.copy(), np.zeros((STEPS, 6))
    start[10:] = [0.02, 0.01, -0.02, 0.01, 0.003, 0.1]
    path = trajectory(start, noise, dive)
    sweeps = Sweeps(PETREL.hull, dive, mean=True, longest=1)
    log_determinant = sweeps.forward(path).log_determinant
    assert log_determinant == pytest.approx(half_log_determinant(path, dive), rel=1e-6)
    mean_shift = sweeps.backward(path).mean_shift
    for _ in range(4):
        by_start, by_noise = (
            dive.deviation * rng.standard_normal(16),
            np.sqrt(dive.noise) * rng.standard_normal((STEPS, 6)),
        )
        step = 0.02
        ahead, behind = (
            trajectory(start + sign * step * by_start, noise + sign * step * by_noise, dive) for sign in (1.0, -1.0)
        )
        change = (half_log_determinant(ahead, dive) - half_log_determinant(behind, dive)) / (2.0 * step)
        moved = np.hstack([ahead.states, ahead.disturbances])[:, ORDER[:16]]
        moved -= np.hstack([behind.states, behind.disturbances])[:, ORDER[:16]]
        assert np.sum(mean_shift * moved) / (2.0 * step) == pytest.approx(change, rel=0.02, abs=2e-3)


def test_a_linear_term_moves_the_mean_as_a_dense_solution(flown):
    """The linear term of the cost moves the smoothed mean by minus the covariance times the term's gradient."""
    dive, path = flown.problem, flown.glide
    sweeps = Sweeps(PETREL.hull, dive, mean=True, longest=1)
    sweeps.forward(path)
    before = sweeps.backward(path).correction.copy()
    rng = np.random.default_rng(2)
    mean_shift = sweeps.mean_shift
    mean_shift[:] = 0.1 * rng.standard_normal(mean_shift.shape) / dive.deviation
    sweeps.forward(path)
    moved = sweeps.backward(path).correction - before
    dense = DenseLeastSquares(dive, path, GLIDE.control)
    half = dense.maps[:, ORDER[:16]] @ dense.root
    pull = np.einsum("kim,ki->m", half, mean_shift)
    expected = -half @ pull
    np.testing.assert_allclose(moved, expected, rtol=1e-7, atol=1e-9)


def test_the_last_step_has_no_mean_shift_behind_it(flown):
    sweeps = Sweeps(PETREL.hull, flown.problem, mean=True, longest=1)
    sweeps.forward(flown.glide)
    mean_shift = sweeps.backward(flown.glide).mean_shift
    assert np.isfinite(mean_shift).all()
    assert not mean_shift[-1].any()
    assert mean_shift[:-1].any(axis=0)[:10].any()


def test_the_mean_is_nearer_to_the_truth_than_the_mode():
    """With wide priors in surge and heave, normalised errors of the mode are biased, and those of the mean centred."""
    biases = {}
    for estimate in ("mode", "mean"):
        settings, errors = SmootherSettings(estimate=estimate), []
        for seed in range(8):
            flown = fly(300 + seed, 6000)
            smoothed = iterate_passes(PETREL.hull, flown.problem, flown.guess, settings)
            assert smoothed.outcome is Outcome.CONVERGED
            errors.append(np.mean(((smoothed.disturbances - flown.disturbances) / smoothed.disturbances_std)[300:, 0]))
        biases[estimate] = abs(np.mean(errors))
    assert biases["mean"] < 0.7 * biases["mode"]


def test_a_mean_shift_summed_up_over_segments_leads_to_the_same_mean(monkeypatch):
    """With one mean shift for fifteen steps, the estimate changes by a few hundredths of a deviation."""
    found = []
    for duration in (H, 5 * H):
        monkeypatch.setattr("gliderhpc.estimation.smoother.problem._SEGMENT_DURATION", duration)
        flown = fly(301, 3000)
        settings = SmootherSettings(estimate="mean", tolerance=1e-3)
        found.append(iterate_passes(PETREL.hull, flown.problem, flown.guess, settings))
    change = (found[1].disturbances - found[0].disturbances) / found[0].disturbances_std
    assert np.sqrt(np.mean(change**2, axis=0)).max() < 0.02
    assert np.abs(change).max() < 0.1
    np.testing.assert_allclose(found[1].disturbances_std[::10], found[0].disturbances_std[::10], rtol=0.01)


@pytest.mark.parametrize(("spent", "share"), [(0.3, 0.3), (1.0, 1.0), (4.0, 1.0)])
def test_room_counts_by_what_a_dive_confirms_of_its_noise(spent, share):
    """It is the ratio of the squares over variances to the resolved part, without raised noise (vibration set)."""
    noise, linear = np.full((40, 6), 0.5), allocate_backward(4, 40)
    linear.noise_resolved[:] = 0.2
    linear.noise_mean[:] = np.sqrt(spent * 0.2 * noise)
    noise[:10] *= 30.0
    linear.noise_mean[:10] = 1e3
    assert consistency(linear, noise, np.arange(40) >= 10) == pytest.approx(share)
