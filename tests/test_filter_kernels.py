"""The filter's kernels (eqs. 19-27): transition matrix, prediction, update, and the run along a record."""

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from sizes import scaled
from specimens import body_of, lopsided_platform, random_controls, random_disturbances, random_state, relative_error

from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.kernels import filter as kernel
from gliderhpc.kernels.kalman import predict, predict_covariance, update
from gliderhpc.kernels.tangent import step_tangent
from gliderhpc.platform import read_platform

LOPSIDED = Glider(lopsided_platform())
PETREL = Glider(read_platform("petrel-l"))
H = 0.1
MEASURED = reference.MEASURED
DEVIATION = np.array([0.01, 0.01, 0.01, 0.0, 0.0, 0.2, 0.1, 0.02, 0.03, 0.02, 0.02, 0.02, 0.3, 0.3, 0.3, 0.1, 0.1, 0.5])
VARIANCE = np.array([5e-4, 5e-4, 5e-4, 0.03]) ** 2
DECAY = np.exp(-H / np.array([600.0, 60.0, 600.0, 60.0, 600.0, 20.0]))
NOISE = DEVIATION[12:] ** 2 * (1.0 - DECAY**2)


def random_covariance(rng):
    """Draw a dense positive definite covariance whose standard deviations are the filter's."""
    mixed = rng.normal(size=(18, 30))
    covariance = mixed @ mixed.T / 30.0
    spread = np.where(DEVIATION > 0.0, DEVIATION, 1.0)
    covariance *= np.outer(spread, spread)
    return 0.5 * (covariance + covariance.T)


def random_case(seed):
    """Mass properties, control, augmented state (18)."""
    rng = np.random.default_rng(seed)
    control = random_controls(rng, 1)[0]
    x = np.concatenate([random_state(rng), random_disturbances(rng, 1)[0]])
    return body_of(LOPSIDED.bodies(control[None])), control, x


def tangent_of(body, x, h=H):
    """Call the kernel for the new state (12) and the transition matrix (12, 18)."""
    transition = np.full((12, 18), np.nan)
    new = step_tangent(LOPSIDED.hull, body, tuple(x[:12]), tuple(x[12:]), h, transition, np.full((3, 18, 18), np.nan))
    return np.array(new), transition


def full_transition(transition, decay):
    """Phi of eq. 24: the step's tangent above, the disturbances' decay below."""
    return np.vstack([transition, np.hstack([np.zeros((6, 12)), np.diag(decay)])])


# Transition matrix


@pytest.mark.parametrize("seed", range(5))
def test_step_is_the_simulation_s(seed):
    body, control, x = random_case(seed)
    flown = LOPSIDED.simulate(x[:12], control[None], x[12:][None], H)
    np.testing.assert_allclose(tangent_of(body, x)[0], flown[1], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_transition_is_the_derivative_of_the_step(seed):
    """Eq. 24's Phi against the complex step of the second implementation's Runge-Kutta step."""
    body, control, x = random_case(seed)
    expected = reference.jacobian(lambda z: reference.rk4_step(LOPSIDED.platform, z[:12], control, z[12:], H), x)
    assert relative_error(tangent_of(body, x)[1], expected) < 1e-13


@pytest.mark.parametrize("seed", range(3))
def test_transition_against_central_differences(seed):
    """The kernel's own step, differenced: second order, so an error of about the increment squared."""
    body, _, x = random_case(seed)
    _, transition = tangent_of(body, x)
    increment = 1e-5
    differences = np.column_stack(
        [
            (tangent_of(body, x + increment * e)[0] - tangent_of(body, x - increment * e)[0]) / (2.0 * increment)
            for e in np.eye(18)
        ]
    )
    assert relative_error(differences, transition) < 1e-7


def test_transition_is_more_than_its_first_order():
    """``I + h A`` is not the tangent of a Runge-Kutta step: at the default step the roll mode alone sees to that."""
    body, control, x = random_case(0)
    _, transition = tangent_of(body, x)
    first_order = np.eye(12) + H * LOPSIDED.jacobian(x[:12], control)
    assert np.abs(transition[:, :12] - first_order).max() > 0.01


# Prediction


@pytest.mark.parametrize("seed", range(3))
def test_covariance_is_carried_as_in_the_textbook(seed):
    """Eq. 24 with dense matrices: ``Phi P Phi' + Q``; the result is symmetric to the bit."""
    rng = np.random.default_rng(seed)
    body, _, x = random_case(seed)
    _, transition = tangent_of(body, x)
    P = random_covariance(rng)
    Phi = full_transition(transition, DECAY)
    expected = Phi @ P @ Phi.T + np.diag(np.concatenate([np.zeros(12), NOISE]))
    predict_covariance(transition, DECAY, NOISE, P, np.full((3, 18, 18), np.nan))
    assert relative_error(P, expected) < 1e-13
    np.testing.assert_array_equal(P, P.T)


def test_prediction_moves_state_and_disturbances():
    """Eq. 23: the state by one step, the disturbances by their decay, both with the covariance of eq. 24."""
    rng = np.random.default_rng(5)
    body, _, x = random_case(5)
    P = random_covariance(rng)
    new, transition = tangent_of(body, x)
    expected_P = P.copy()
    predict_covariance(transition, DECAY, NOISE, expected_P, np.empty((3, 18, 18)))
    advanced = x.copy()
    predict(LOPSIDED.hull, body, advanced, H, DECAY, NOISE, P, np.empty((12, 18)), np.empty((3, 18, 18)))
    np.testing.assert_array_equal(advanced, np.concatenate([new, DECAY * x[12:]]))
    np.testing.assert_array_equal(P, expected_P)


def test_random_walk_is_the_limit_of_no_decay():
    """Eq. 19: with decay 1 the disturbances keep their values and their variances only grow."""
    body, _, x = random_case(6)
    P = np.diag(DEVIATION**2)
    advanced = x.copy()
    predict(LOPSIDED.hull, body, advanced, H, np.ones(6), NOISE, P, np.empty((12, 18)), np.empty((3, 18, 18)))
    np.testing.assert_array_equal(advanced[12:], x[12:])
    np.testing.assert_allclose(np.diag(P)[12:], DEVIATION[12:] ** 2 + NOISE, rtol=1e-15)


# Update


@pytest.mark.parametrize("index", MEASURED)
def test_update_is_the_textbook_s(index):
    """Eqs. 25-27 with dense matrices for one scalar measurement, and the Joseph form besides."""
    rng = np.random.default_rng(index)
    x, P = rng.normal(size=18), random_covariance(rng)
    innovation, variance = 0.02, 1e-4
    row = np.eye(18)[index][None]
    K = P @ row.T / (row @ P @ row.T + variance)
    left = np.eye(18) - K @ row
    expected_x = x + K[:, 0] * innovation
    joseph = left @ P @ left.T + variance * K @ K.T
    assert relative_error(joseph, left @ P) < 1e-12
    update(x, P, index, innovation, variance, np.empty((18, 2)))
    np.testing.assert_allclose(x, expected_x, rtol=1e-14, atol=1e-15)
    assert relative_error(P, joseph) < 1e-13
    np.testing.assert_array_equal(P, P.T)


@given(seed=st.integers(0, 10_000), exponent=st.floats(-16.0, 2.0))
@settings(deadline=None, max_examples=scaled(100, 20))
def test_covariance_stays_positive_definite(seed, exponent):
    """Thirty updates by sensors from almost perfect to almost useless, predictions between them."""
    rng = np.random.default_rng(seed)
    P, gain, work = random_covariance(rng), np.empty((18, 2)), np.empty((3, 18, 18))
    x = np.zeros(18)
    transition = np.hstack([np.eye(12), np.zeros((12, 6))]) + 0.05 * rng.normal(size=(12, 18))
    for _ in range(30):
        update(x, P, int(rng.choice(MEASURED)), rng.normal(), 10.0**exponent, gain)
        if rng.uniform() < 0.2:
            predict_covariance(transition, DECAY, NOISE, P, work)
        np.testing.assert_array_equal(P, P.T)
    scale = np.sqrt(np.diag(P))
    assert np.all(scale > 0.0)
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


# The run


GLIDE = steady_glide(PETREL, 0.35, math.radians(-25.0))
PUSH = np.array([0.2, 0.0, -0.1, 0.0, 0.05, 0.3])
STEPS = 100
EVERY = 5


class Record:
    """A steady dive under a constant disturbance, measured every half second, and what the filter makes of it."""

    def __init__(self):
        self.bodies = PETREL.bodies(np.tile(GLIDE.control, (STEPS, 1)))
        self.truth = PETREL.simulate(GLIDE.state, np.tile(GLIDE.control, (STEPS, 1)), np.tile(PUSH, (STEPS, 1)), H)
        noise = np.random.default_rng(11).normal(size=(STEPS + 1, 4)) * np.sqrt(VARIANCE)
        self.measured = np.full((STEPS + 1, 4), np.nan)
        self.measured[::EVERY] = (self.truth[:, MEASURED] + noise)[::EVERY]
        self.x0 = np.concatenate([GLIDE.state, np.zeros(6)])
        self.x0[[1, 6, 8]] += [0.005, 0.05, -0.01]
        self.guesses = np.tile(GLIDE.state, (STEPS + 1, 1))
        self.guesses[:, 5] = self.truth[:, 5]
        self.guesses[:, 3:5] = -999.0

    def filtered(self, measured=None, x0=None, shaken=None, gate=12.0, patience=10, noise=NOISE, factor=1.0):
        """States, disturbances and events (n+1)."""
        states, disturbances = np.full((STEPS + 1, 12), np.nan), np.full((STEPS + 1, 6), np.nan)
        events = np.full(STEPS + 1, 255, dtype=np.uint8)
        kernel.run_filter(
            PETREL.hull, self.bodies, self.x0 if x0 is None else x0, DEVIATION, H, DECAY, noise, factor,
            self.measured if measured is None else measured, VARIANCE, self.guesses,
            np.zeros(STEPS + 1, dtype=bool) if shaken is None else shaken, gate, patience,
            states, disturbances, events,
        )  # fmt: skip
        return states, disturbances, events

    def with_outlier(self, row, channel, size):
        """Copy the measurements with one of them wrong."""
        measured = self.measured.copy()
        measured[row, channel] += size
        return measured

    def without(self, row, channel):
        """Copy the measurements with one of them missing."""
        measured = self.measured.copy()
        measured[row, channel] = np.nan
        return measured


@pytest.fixture(scope="module")
def record():
    return Record()


@pytest.fixture(scope="module")
def estimate(record):
    """Run the filter plainly, once."""
    return record.filtered()


def textbook_filter(record):
    """Eqs. 23-27 with dense matrices, Phi by the complex step and all four channels at once."""
    x, P = record.x0.copy(), np.diag(DEVIATION**2)
    Q = np.diag(np.concatenate([np.zeros(12), NOISE]))
    observe = np.eye(18)[MEASURED]
    estimates = []
    for k in range(STEPS + 1):
        if k > 0:

            def advance(z):
                return reference.rk4_step(PETREL.platform, z[:12], GLIDE.control, z[12:], H)

            Phi = full_transition(reference.jacobian(advance, x), DECAY)
            x, P = np.concatenate([advance(x), DECAY * x[12:]]), Phi @ P @ Phi.T + Q
        if np.isfinite(record.measured[k]).all():
            K = P @ observe.T @ np.linalg.inv(observe @ P @ observe.T + np.diag(VARIANCE))
            x, P = x + K @ (record.measured[k] - observe @ x), (np.eye(18) - K @ observe) @ P
        estimates.append(x)
    return np.array(estimates)


def test_run_is_the_textbook_s(record, estimate):
    """Channel after channel with the Joseph form, or all at once: the same estimate."""
    states, disturbances, events = estimate
    expected = textbook_filter(record)
    np.testing.assert_allclose(states, expected[:, :12], rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(disturbances, expected[:, 12:], rtol=1e-10, atol=1e-11)
    assert not events.any()


def test_estimate_approaches_the_truth(record, estimate):
    """Ten seconds of data: attitude and depth to the sensors' noise, speed better than at the start."""
    states, _, _ = estimate
    error = np.abs(states[-1] - record.truth[-1])
    assert error[:3].max() < 3.0 * 5e-4
    assert error[5] < 0.09
    assert error[6] < 0.05
    assert states[-1, 3] != 0.0


def test_without_measurements_the_filter_is_the_model(record):
    """NaN is skipped; what remains is the simulation from the initial estimate."""
    states, disturbances, events = record.filtered(measured=np.full((STEPS + 1, 4), np.nan))
    expected = PETREL.simulate(record.x0[:12], np.tile(GLIDE.control, (STEPS, 1)), np.zeros((STEPS, 6)), H)
    np.testing.assert_allclose(states, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(disturbances, 0.0)
    assert not events.any()


@pytest.mark.parametrize("channel", range(4))
def test_an_outlier_counts_as_missing(record, channel):
    """Gated: the estimate is that of a record without the sample, and the sample is counted once."""
    row = 10 * EVERY
    states, disturbances, events = record.filtered(measured=record.with_outlier(row, channel, 2.0))
    expected_states, expected_disturbances, none = record.filtered(measured=record.without(row, channel))
    np.testing.assert_array_equal(states, expected_states)
    np.testing.assert_array_equal(disturbances, expected_disturbances)
    assert events[row] == kernel.GATED
    assert np.count_nonzero(events) == 1
    assert not none.any()


def test_in_vibration_an_outlier_is_widened_not_dropped(record, estimate):
    """Inside the vibration set the variance is raised until the innovation stands at the gate.

    The correction is then ``gate**2 P / innovation``: the worse the outlier, the less it moves the estimate.
    """
    row = 10 * EVERY
    shaken = np.zeros(STEPS + 1, dtype=bool)
    shaken[row] = True
    dropped, _, _ = record.filtered(measured=record.without(row, 1))
    moved = []
    for size in (0.3, 0.6):
        states, _, events = record.filtered(measured=record.with_outlier(row, 1, size), shaken=shaken)
        assert events[row] == kernel.INFLATED
        assert np.count_nonzero(events) == 1
        np.testing.assert_array_equal(states[:row], estimate[0][:row])
        moved.append(states[row, 1] - dropped[row, 1])
    assert 0.0 < moved[1] < moved[0] < 0.01
    assert moved[0] / moved[1] == pytest.approx(2.0, abs=0.02)


def test_more_noise_is_added_in_vibration(record):
    """The factor acts on the steps that start inside the vibration set, and on them alone."""
    shaken = np.ones(STEPS + 1, dtype=bool)
    states, disturbances, _ = record.filtered(shaken=shaken, factor=4.0)
    expected_states, expected_disturbances, _ = record.filtered(noise=4.0 * NOISE)
    np.testing.assert_array_equal(states, expected_states)
    np.testing.assert_array_equal(disturbances, expected_disturbances)
    calm, _, _ = record.filtered(factor=4.0)
    assert np.abs(calm - states).max() > 1e-6


@pytest.mark.parametrize("turns", [-2, 1])
def test_heading_innovation_is_wrapped(record, estimate, turns):
    measured = record.measured.copy()
    measured[:, 2] += 2.0 * math.pi * turns
    states, _, events = record.filtered(measured=measured)
    np.testing.assert_allclose(states, estimate[0], rtol=1e-10, atol=1e-10)
    assert not events.any()


def test_one_channel_alone_is_used(record, estimate):
    """A sample without a heading still corrects the rest."""
    measured = record.measured.copy()
    measured[:, 2] = np.nan
    states, _, events = record.filtered(measured=measured)
    assert not events.any()
    assert abs(states[-1, 1] - record.truth[-1, 1]) < 3.0 * 5e-4
    assert not np.array_equal(states, estimate[0])


def test_disagreement_that_lasts_restarts_the_filter(record):
    """More than `patience` rejected samples in a row: back to guess and initial disturbances, the track kept."""
    measured = record.measured.copy()
    measured[10 * EVERY :, 1] += 0.5
    states, disturbances, events = record.filtered(measured=measured, patience=3)
    wrong = np.arange(10, 14) * EVERY
    np.testing.assert_array_equal(events[wrong], [kernel.GATED] * 3 + [kernel.GATED | kernel.RESET])
    restart = wrong[-1]
    np.testing.assert_array_equal(np.delete(states[restart], [3, 4]), np.delete(record.guesses[restart], [3, 4]))
    np.testing.assert_array_equal(disturbances[restart], 0.0)
    assert states[restart, 3] > states[restart - 1, 3] > 0.0
    assert events[restart + EVERY] & kernel.GATED


def test_agreement_in_between_is_patience_regained(record):
    """Rejections count in a row: one good sample among them and nothing restarts."""
    measured = record.measured.copy()
    measured[10 * EVERY :, 1] += 2.0
    measured[::EVERY][[12, 15, 18]] = record.measured[::EVERY][[12, 15, 18]]
    _, _, events = record.filtered(measured=measured, patience=2)
    assert np.count_nonzero(events & kernel.GATED) == 8
    assert not (events & kernel.RESET).any()


@pytest.mark.parametrize(
    ("index", "value"),
    [(0, math.nan), (6, 3.1), (7, -3.1), (8, 3.1), (1, 1.5), (1, -1.5)],
    ids=["not a number", "too fast", "abeam", "astern of the plane", "nose up", "nose down"],
)
def test_an_estimate_outside_the_model_is_restarted(record, index, value):
    """Divergence is noticed at once, counted, and costs the sample, not the run."""
    x0 = record.x0.copy()
    x0[index] = value
    states, _, events = record.filtered(x0=x0)
    assert events[0] == kernel.RESET
    np.testing.assert_array_equal(np.delete(states[0], [3, 4]), np.delete(record.guesses[0], [3, 4]))
    np.testing.assert_array_equal(states[0, 3:5], 0.0)
    assert np.isfinite(states).all()
    assert not events[1:].any()


@pytest.mark.parametrize(("index", "value"), [(1, 1.47), (1, -1.47), (6, 2.9)])
def test_an_unusual_estimate_is_left_to_the_measurements(record, index, value):
    """Pitch below 85 degrees and speed below 3 m/s are inside the model; a record that disagrees is gated first."""
    x0 = record.x0.copy()
    x0[index] = value
    _, _, events = record.filtered(x0=x0)
    assert not events[0] & kernel.RESET


def test_a_track_that_is_lost_starts_from_the_guess(record):
    x0 = record.x0.copy()
    x0[3] = math.nan
    states, _, events = record.filtered(x0=x0)
    assert events[0] == kernel.RESET
    np.testing.assert_array_equal(states[0], record.guesses[0])
