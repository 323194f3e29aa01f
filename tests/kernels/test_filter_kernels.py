"""Filter kernels (eqs. 19-27): transition matrix, prediction, update, and the run along records in lanes."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import reference
from support.sizes import COMPILED, scaled
from support.specimens import lopsided_platform, random_controls, random_disturbances, random_state, relative_error

from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.kernels import filter as kernel
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.filter_memory import ENDED, IDLE, Records, Sweep, allocate, load_profile
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.kalman import carry_covariance, predict_covariance, update
from gliderhpc.kernels.tangent import advance, pull_back
from gliderhpc.platform import read_platform

LOPSIDED = Glider(lopsided_platform())
HULL = np.array(LOPSIDED.hull)
PETREL = Glider(read_platform("petrel-l"))
H = 0.1
SENSED = reference.SENSED
CARRIED = [*SENSED, 12, 13, 14, 15, 16, 17]
PATH = [*CARRIED, 3, 4]
"""Indices of the filter's sensed states, disturbances, X and Y among the eighteen."""
DEVIATION = np.array([0.01, 0.01, 0.01, 0.2, 0.1, 0.02, 0.03, 0.02, 0.02, 0.02, 0.3, 0.3, 0.3, 0.1, 0.1, 0.5])
VARIANCE = np.array([5e-4, 5e-4, 5e-4, 0.03]) ** 2
DECAY = np.exp(-H / np.array([600.0, 60.0, 600.0, 60.0, 600.0, 20.0]))
NOISE = DEVIATION[10:] ** 2 * (1.0 - DECAY**2)


def random_covariance(rng):
    """Draw a dense positive definite covariance with the filter's standard deviations."""
    mixed = rng.normal(size=(16, 30))
    covariance = mixed @ mixed.T / 30.0 * np.outer(DEVIATION, DEVIATION)
    return 0.5 * (covariance + covariance.T)


def random_case(seed):
    """Draw mass properties (1, 11), control and augmented state (18)."""
    rng = np.random.default_rng(seed)
    control = random_controls(rng, 1)[0]
    x = np.concatenate([random_state(rng), random_disturbances(rng, 1)[0]])
    return LOPSIDED.bodies(control[None]), control, x


def flown_path(bodies, x, durations, decay=DECAY):
    """Return the rows of the path (m+1, 18) in the kernel's order, and the stages' Jacobians."""
    m = len(durations)
    path, partials = np.full((m + 1, 18), np.nan), np.full((m, 4, ENTRIES), np.nan)
    path[0] = x[PATH]
    for k in range(m):
        advance(HULL, bodies, durations, decay, path, partials, k)
    return path, partials


def tangent_of(bodies, x, h=H):
    """Return the new state and the transition matrix (10, 16) of one step."""
    durations = np.array([h])
    path, partials = flown_path(bodies, x, durations)
    transition = np.eye(10, 16)
    pull_back(HULL, durations, DECAY, partials, transition, 0)
    return path[1], transition


def full_transition(transition, decay):
    """Return Phi of eq. 24: the step's tangent above, the disturbances' decay below."""
    return np.vstack([transition, np.hstack([np.zeros((6, 10)), np.diag(decay)])])


def scratch():
    """Allocate memory for the covariance's prediction, filled with values that must not be read."""
    return Sweep(*(np.full(shape, np.nan) for shape in ((10, 16), (6,), (16, 16), (10, 16))))


# Transition matrix


@pytest.mark.parametrize("seed", range(5))
def test_step_is_the_simulation_s(seed, implementation):
    bodies, control, x = random_case(seed)
    flown = LOPSIDED.simulate(x[:12], control[None], x[12:][None], H)[1]
    new, _ = implementation.tangent(HULL, bodies, x[PATH], DECAY, H)
    np.testing.assert_allclose(new[:10], flown[SENSED], rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(new[10:16], DECAY * x[12:], rtol=1e-15)
    np.testing.assert_allclose(new[16:], flown[3:5], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_transition_is_the_derivative_of_the_step(seed, implementation):
    """Phi of eq. 24 equals the complex step of the second implementation's Runge-Kutta step."""
    bodies, control, x = random_case(seed)
    expected = reference.jacobian(lambda z: reference.rk4_step(LOPSIDED.platform, z[:12], control, z[12:], H), x)
    _, transition = implementation.tangent(HULL, bodies, x[PATH], DECAY, H)
    assert relative_error(transition, expected[np.ix_(SENSED, CARRIED)]) < 1e-13
    assert not expected[np.ix_(SENSED, [3, 4])].any()


@pytest.mark.parametrize("seed", range(3))
def test_transition_against_central_differences(seed):
    """Central differences of the kernel's own step have an error of about the increment squared."""
    bodies, _, x = random_case(seed)
    _, transition = tangent_of(bodies, x)
    increment = 1e-5
    differences = np.column_stack(
        [
            (tangent_of(bodies, x + increment * e)[0] - tangent_of(bodies, x - increment * e)[0]) / (2.0 * increment)
            for e in np.eye(18)[CARRIED]
        ]
    )
    assert relative_error(differences[:10], transition) < 1e-7


def test_transition_is_more_than_its_first_order():
    """``I + h A`` is not the tangent of a Runge-Kutta step: at the default step, the roll mode alone differs."""
    bodies, control, x = random_case(0)
    _, transition = tangent_of(bodies, x)
    first_order = np.eye(12) + H * LOPSIDED.jacobian(x[:12], control)
    assert np.abs(transition[:, :10] - first_order[np.ix_(SENSED, SENSED)]).max() > 0.01


def test_a_step_of_no_length_moves_nothing(implementation):
    """In every implementation the state is unchanged bit for bit; in a tangent, only the heading's column changes."""
    bodies, _, x = random_case(1)
    new, transition = implementation.tangent(HULL, bodies, x[PATH], DECAY, 0.0)
    np.testing.assert_array_equal(new, x[PATH])
    np.testing.assert_array_equal(transition, np.eye(10, 16))


def test_a_step_of_no_length_changes_nothing():
    """It leaves every bit unchanged; lanes with a shorter block than their neighbours depend on this."""
    bodies, _, x = random_case(1)
    durations = np.array([0.0])
    path, partials = flown_path(bodies, x, durations)
    np.testing.assert_array_equal(path[1], path[0])
    before = np.random.default_rng(1).normal(size=(10, 16))
    before[:, 2] = 0.0
    transition = before.copy()
    pull_back(HULL, durations, DECAY, partials, transition, 0)
    np.testing.assert_array_equal(transition, before)


# Prediction


def predicted(bodies, x, P, durations, factors, decay=DECAY):
    """Return the covariance after a block of steps."""
    _, partials = flown_path(bodies, x, durations, decay)
    P = P.copy()
    predict_covariance(HULL, durations, decay, NOISE, factors, partials, len(durations), scratch(), P)
    return P


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_covariance_is_carried_as_in_the_textbook(steps):
    """The covariance equals eq. 24 with dense matrices at every step, ``Phi P Phi' + Q``, and is exactly symmetric."""
    rng = np.random.default_rng(steps)
    _, _, x = random_case(steps)
    bodies, factors = LOPSIDED.bodies(random_controls(rng, max(steps, 1))), rng.uniform(0.5, 30.0, steps)
    P = random_covariance(rng)
    path, _ = flown_path(bodies, x, np.full(steps, H))
    expected = P
    for k in range(steps):
        at = np.empty(18)
        at[PATH] = path[k]
        Phi = full_transition(tangent_of(bodies[k : k + 1], at)[1], DECAY)
        expected = Phi @ expected @ Phi.T + factors[k] * np.diag(np.concatenate([np.zeros(10), NOISE]))
    actual = predicted(bodies, x, P, np.full(steps, H), factors)
    assert relative_error(actual, expected) < 1e-13
    np.testing.assert_array_equal(actual, actual.T)


def test_steps_of_no_length_leave_the_covariance_alone():
    """A block that ends with such steps gives the same result as the block without them, bit for bit."""
    rng = np.random.default_rng(4)
    _, _, x = random_case(4)
    bodies, P = LOPSIDED.bodies(random_controls(rng, 5)), random_covariance(rng)
    short = predicted(bodies, x, P, np.full(3, H), np.ones(3))
    padded = predicted(bodies, x, P, np.array([H, H, H, 0.0, 0.0]), np.array([1.0, 1.0, 1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(padded, short)


def test_random_walk_is_the_limit_of_no_decay():
    """With decay 1 the disturbances keep their values and their variances only grow (eq. 19)."""
    bodies, _, x = random_case(6)
    path, _ = flown_path(bodies, x, np.array([H]), np.ones(6))
    np.testing.assert_array_equal(path[1, 10:16], x[12:])
    P = predicted(bodies, x, np.diag(DEVIATION**2), np.array([H]), np.ones(1), np.ones(6))
    np.testing.assert_allclose(np.diag(P)[10:], DEVIATION[10:] ** 2 + NOISE, rtol=1e-15)


# Update


@pytest.mark.parametrize("index", range(4))
def test_update_is_the_textbook_s(index):
    """The update equals eqs. 25-27 with dense matrices for one scalar measurement, and the Joseph form."""
    rng = np.random.default_rng(index)
    x, P = rng.normal(size=16), random_covariance(rng)
    innovation, variance = 0.02, 1e-4
    row = np.eye(16)[index][None]
    K = P @ row.T / (row @ P @ row.T + variance)
    left = np.eye(16) - K @ row
    expected_x = x + K[:, 0] * innovation
    joseph = left @ P @ left.T + variance * K @ K.T
    assert relative_error(joseph, left @ P) < 1e-12
    unused_x, unused_P = x.copy(), P.copy()
    update(unused_x, unused_P, index, innovation, variance, 0.0, np.empty((16, 2)))
    np.testing.assert_array_equal(unused_x, x)
    np.testing.assert_array_equal(unused_P, P)
    update(x, P, index, innovation, variance, 1.0, np.empty((16, 2)))
    np.testing.assert_allclose(x, expected_x, rtol=1e-14, atol=1e-15)
    assert relative_error(P, joseph) < 1e-13
    np.testing.assert_array_equal(P, P.T)


@given(seed=st.integers(0, 10_000), exponent=st.floats(-16.0, 2.0))
@settings(deadline=None, max_examples=scaled(100, 10))
def test_covariance_stays_positive_definite(seed, exponent):
    """Apply thirty updates with sensors from almost perfect to almost useless, with predictions between them."""
    rng = np.random.default_rng(seed)
    P, gain, half = random_covariance(rng), np.empty((16, 2)), np.empty((10, 16))
    x, added = np.zeros(16), np.diag(np.concatenate([np.zeros(10), NOISE]))
    transition = np.eye(10, 16) + 0.05 * rng.normal(size=(10, 16))
    for _ in range(30):
        update(x, P, int(rng.integers(4)), rng.normal(), 10.0**exponent, 1.0, gain)
        if rng.uniform() < 0.2:
            carry_covariance(transition, DECAY, added, P, half)
        np.testing.assert_array_equal(P, P.T)
    scale = np.sqrt(np.diag(P))
    assert np.all(scale > 0.0)
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > 0.0


# The run


GLIDE = steady_glide(PETREL, 0.35, math.radians(-25.0))
PUSH = np.array([0.2, 0.0, -0.1, 0.0, 0.05, 0.3])
STEPS = 60
EVERY = 3


class Case:
    """Record of ``n`` steps, with the settings of the filter."""

    def __init__(self, bodies, measured, fed, x0, vibrating=None, gate=12.0, patience=10, noise=NOISE, allowed=999):
        rows = len(measured)
        vibrating = np.zeros(rows, dtype=bool) if vibrating is None else vibrating
        guesses = np.tile(GLIDE.state[6:], (rows, 1))
        estimates = np.full((rows, 12), np.nan), np.full((rows, 6), np.nan), np.zeros(rows, dtype=np.uint8)
        fed = fed & np.isfinite(measured).any(axis=1)
        innovations = np.full((fed.sum(), 2, 4), np.nan)
        self.arrays = bodies, measured, fed, vibrating, guesses, *estimates, innovations
        self.x0, self.gate, self.patience, self.noise, self.allowed = x0, gate, patience, noise, allowed

    @property
    def estimate(self):
        """States, disturbances and events (n+1)."""
        return self.arrays[5:8]

    @property
    def innovations(self):
        """Innovations of the fed samples, and their variances (m, 2, 4)."""
        return self.arrays[8]


NOBODY = np.empty((0, 11)), np.full((1, 4), np.nan), np.zeros(1, dtype=bool), np.zeros(1, dtype=bool)
EMPTY = (
    *NOBODY, np.zeros((1, 6)), np.empty((1, 12)), np.empty((1, 6)), np.zeros(1, dtype=np.uint8), np.empty((0, 2, 4)),
)  # fmt: skip


def filter_in_lanes(cases, factor=1.0):
    """Run the filter on the cases, by lane, to the end of each; all other lanes are idle."""
    memory, progress = allocate()
    for lane, case in cases.items():
        load_profile(
            memory, progress, lane, np.array(PETREL.hull), DECAY, case.noise, VARIANCE, case.x0[PATH], DEVIATION,
            len(case.arrays[0]), case.patience, case.allowed,
        )  # fmt: skip
    records = Records(*zip(*(cases[lane].arrays if lane in cases else EMPTY for lane in range(LANES)), strict=True))
    (gate,) = {case.gate for case in cases.values()}
    for _ in cases:
        kernel.run_until_done(records, memory, progress, H, gate, factor, 1)
        progress.status[progress.status == ENDED] = IDLE
        if not progress.status.any():
            break
    return progress


class Record:
    """Steady dive under a constant disturbance, measured every 0.3 s, and the filter's results."""

    def __init__(self):
        self.bodies = PETREL.bodies(np.tile(GLIDE.control, (STEPS, 1)))
        self.truth = PETREL.simulate(GLIDE.state, np.tile(GLIDE.control, (STEPS, 1)), np.tile(PUSH, (STEPS, 1)), H)
        noise = np.random.default_rng(11).normal(size=(STEPS + 1, 4)) * np.sqrt(VARIANCE)
        self.measured = self.truth[:, reference.MEASURED] + noise
        self.fed = np.arange(STEPS + 1) % EVERY == 0
        self.x0 = np.concatenate([GLIDE.state, np.zeros(6)])
        self.x0[[1, 6, 8]] += [0.005, 0.05, -0.01]

    def case(self, measured=None, x0=None, fed=None, **options):
        """Return the case of the record, or of a modified one."""
        return Case(
            self.bodies, self.measured if measured is None else measured, self.fed if fed is None else fed,
            self.x0 if x0 is None else x0, **options,
        )  # fmt: skip

    def filtered(self, factor=1.0, **options):
        """States, disturbances and events (n+1)."""
        case = self.case(**options)
        filter_in_lanes({0: case}, factor)
        return case.estimate

    def restarted(self, row):
        """Return the sensed states and the disturbances after a restart at a row."""
        return np.concatenate([self.measured[row], GLIDE.state[6:], np.zeros(6)])

    def with_outlier(self, row, channel, size):
        """Copy the measurements, with one of them wrong."""
        measured = self.measured.copy()
        measured[row, channel] += size
        return measured

    def without(self, row, channel):
        """Copy the measurements, with one of them missing."""
        measured = self.measured.copy()
        measured[row, channel] = np.nan
        return measured


@pytest.fixture(scope="module")
def record():
    return Record()


@pytest.fixture(scope="module")
def estimate(record):
    """Run the filter once with default settings."""
    return record.filtered()


@pytest.fixture(scope="module")
def innovations(record):
    """Innovations of each sample and their variances, (samples, 2, 4)."""
    case = record.case()
    filter_in_lanes({0: case})
    return case.innovations


def textbook_filter(record):
    """Filter by eqs. 23-27 with dense matrices, Phi from complex steps, all channels at once, and without X and Y."""
    x, P = record.x0.copy(), np.diag(DEVIATION**2)
    Q = np.diag(np.concatenate([np.zeros(10), NOISE]))
    observe = np.eye(16)[:4]
    estimates, densities = [], []
    for k in range(STEPS + 1):
        if k > 0:

            def flown(z):
                return reference.rk4_step(PETREL.platform, z[:12], GLIDE.control, z[12:], H)

            Phi = full_transition(reference.jacobian(flown, x)[np.ix_(SENSED, CARRIED)], DECAY)
            x, P = np.concatenate([flown(x), DECAY * x[12:]]), Phi @ P @ Phi.T + Q
        if record.fed[k]:
            S = observe @ P @ observe.T + np.diag(VARIANCE)
            K = P @ observe.T @ np.linalg.inv(S)
            innovation = record.measured[k] - x[reference.MEASURED]
            densities.append(
                -0.5 * (innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(2.0 * np.pi * S)[1])
            )
            x[CARRIED] += K @ innovation
            P = (np.eye(16) - K @ observe) @ P
        estimates.append(x.copy())
    return np.array(estimates), np.array(densities)


def test_run_is_the_textbook_s(record, estimate):
    """The Joseph form for one channel after the other gives the estimate of eqs. 18 and 21-27 for all at once."""
    states, disturbances, events = estimate
    expected, _ = textbook_filter(record)
    np.testing.assert_allclose(states, expected[:, :12], rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(disturbances, expected[:, 12:], rtol=1e-10, atol=1e-11)
    assert not events.any()


def test_innovations_have_the_textbook_s_density(record, innovations):
    """The log-densities of successive channels add up to the joint log-density of a sample's four channels."""
    e, S = innovations.transpose(1, 0, 2)
    _, expected = textbook_filter(record)
    np.testing.assert_allclose(-0.5 * (e**2 / S + np.log(2.0 * np.pi * S)).sum(axis=1), expected, rtol=1e-9)


@pytest.mark.parametrize("channel", range(scaled(4, 1)))
def test_innovation_of_a_missing_channel_is_missing_and_of_a_gated_one_is_stored(record, innovations, channel):
    row = 10 * EVERY
    missing, outlier = (
        record.case(measured=measured)
        for measured in (record.without(row, channel), record.with_outlier(row, channel, 2.0))
    )
    filter_in_lanes({0: missing, 1: outlier})
    np.testing.assert_array_equal(np.argwhere(np.isnan(missing.innovations[:, 0])), [[10, channel]])
    assert outlier.innovations[10, 0, channel] == pytest.approx(innovations[10, 0, channel] + 2.0)
    assert outlier.innovations[10, 1, channel] == innovations[10, 1, channel]


def test_estimate_approaches_the_truth(record, estimate):
    """After six seconds, attitude and depth are accurate to the sensors' noise, and the speed has improved."""
    states, _, _ = estimate
    error = np.abs(states[-1] - record.truth[-1])
    assert error[:3].max() < 3.0 * 5e-4
    assert error[5] < 0.09
    assert error[6] < 0.05
    assert states[-1, 3] != 0.0


def test_without_measurements_the_filter_is_the_model(record):
    """Without fed samples, the result is the simulation from the initial estimate."""
    states, disturbances, events = record.filtered(fed=np.zeros(STEPS + 1, dtype=bool))
    expected = PETREL.simulate(record.x0[:12], np.tile(GLIDE.control, (STEPS, 1)), np.zeros((STEPS, 6)), H)
    np.testing.assert_allclose(states, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(disturbances, 0.0)
    assert not events.any()


@pytest.mark.parametrize("channel", range(scaled(4, 1)))
def test_an_outlier_counts_as_missing(record, channel):
    """It is gated: the estimate is that of a record without the sample, and one event is recorded."""
    row = 10 * EVERY
    states, disturbances, events = record.filtered(measured=record.with_outlier(row, channel, 2.0))
    expected_states, expected_disturbances, none = record.filtered(measured=record.without(row, channel))
    np.testing.assert_array_equal(states, expected_states)
    np.testing.assert_array_equal(disturbances, expected_disturbances)
    assert events[row] == kernel.GATED
    assert np.count_nonzero(events) == 1
    assert not none.any()


def test_an_outlier_in_vibration_is_down_weighted_rather_than_rejected(record, estimate):
    """Inside the vibration set the variance is inflated until the innovation lies at the gate.

    The correction is then ``gate**2 P / innovation``: a larger outlier changes the estimate less.
    """
    row = 10 * EVERY
    vibrating = np.zeros(STEPS + 1, dtype=bool)
    vibrating[row] = True
    dropped, _, _ = record.filtered(measured=record.without(row, 1))
    moved = []
    for size in (0.3, 0.6):
        states, _, events = record.filtered(measured=record.with_outlier(row, 1, size), vibrating=vibrating)
        assert events[row] == kernel.INFLATED
        assert np.count_nonzero(events) == 1
        np.testing.assert_array_equal(states[:row], estimate[0][:row])
        moved.append(states[row, 1] - dropped[row, 1])
    assert 0.0 < moved[1] < moved[0] < 0.01
    assert moved[0] / moved[1] == pytest.approx(2.0, abs=0.02)


def test_more_noise_is_added_in_vibration(record):
    """The factor acts only on the steps that start inside the vibration set."""
    vibrating = np.ones(STEPS + 1, dtype=bool)
    states, disturbances, _ = record.filtered(vibrating=vibrating, factor=4.0)
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
    """A sample without a heading still corrects the other states."""
    measured = record.measured.copy()
    measured[:, 2] = np.nan
    states, _, events = record.filtered(measured=measured)
    assert not events.any()
    assert abs(states[-1, 1] - record.truth[-1, 1]) < 3.0 * 5e-4
    assert not np.array_equal(states, estimate[0])


def test_disagreement_that_lasts_restarts_the_filter(record):
    """More than `patience` successive rejections reset to guess and initial disturbances, with an unchanged track."""
    measured = record.measured.copy()
    measured[10 * EVERY :, 1] += 0.5
    states, disturbances, events = record.filtered(measured=measured, patience=3)
    wrong = np.arange(10, 14) * EVERY
    np.testing.assert_array_equal(events[wrong], [kernel.GATED] * 3 + [kernel.GATED | kernel.RESET])
    restart = wrong[-1]
    np.testing.assert_array_equal(states[restart, reference.MEASURED], measured[restart])
    np.testing.assert_array_equal(states[restart, 6:], GLIDE.state[6:])
    np.testing.assert_array_equal(disturbances[restart], 0.0)
    assert states[restart, 3] > states[restart - 1, 3] > 0.0
    assert not events[restart + EVERY]


def test_agreement_in_between_is_patience_regained(record):
    """Only successive rejections cause a restart; one good sample among them prevents it."""
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
    """Divergence is detected immediately and recorded; it affects only the sample, and the run continues."""
    x0 = record.x0.copy()
    x0[index] = value
    states, _, events = record.filtered(x0=x0)
    assert events[0] == kernel.RESET
    np.testing.assert_array_equal(states[0, SENSED], record.restarted(0)[:10])
    np.testing.assert_array_equal(states[0, 3:5], 0.0)
    assert np.isfinite(states).all()
    assert not events[1:].any()


@pytest.mark.parametrize(("index", "value"), [(1, 1.47), (1, -1.47), (6, 2.9)])
def test_an_unusual_estimate_is_left_to_the_measurements(record, index, value):
    """Pitch below 85 degrees and speed below 3 m/s are inside the model's domain; a contradicting record is gated."""
    x0 = record.x0.copy()
    x0[index] = value
    _, _, events = record.filtered(x0=x0)
    assert not events[0] & kernel.RESET


def test_a_track_that_is_lost_is_restarted(record):
    x0 = record.x0.copy()
    x0[3] = math.nan
    states, _, events = record.filtered(x0=x0)
    assert events[0] == kernel.RESET
    np.testing.assert_array_equal(states[0, SENSED], record.restarted(0)[:10])
    np.testing.assert_array_equal(states[0, 3:5], 0.0)


def test_an_estimate_that_leaves_the_model_between_samples_is_restarted_there(record):
    """The rest is that of a run that begins at the restart, independent of the earlier part of the block."""
    bodies, at = record.bodies.copy(), 2 * EVERY + 2
    bodies[at - 1, 9] = math.nan
    case = Case(bodies, record.measured, record.fed, record.x0)
    filter_in_lanes({0: case})
    states, disturbances, events = case.estimate
    assert events[at] == kernel.RESET
    np.testing.assert_array_equal(np.delete(events, at), 0)
    np.testing.assert_array_equal(states[at, SENSED], record.restarted(at)[:10])
    x0 = np.concatenate([states[at], np.zeros(6)])
    fed = record.fed[at:]
    later = Case(record.bodies[at:], record.measured[at:], fed, x0)
    filter_in_lanes({0: later})
    np.testing.assert_array_equal(states[at:, SENSED], later.estimate[0][:, SENSED])
    np.testing.assert_array_equal(disturbances[at:], later.estimate[1])


def test_a_run_with_too_much_trouble_is_given_up(record):
    """It ends at the sample with which the allowed number of troubles is exceeded; nothing is written after it."""
    measured = record.measured.copy()
    measured[10 * EVERY :, 1] += 2.0
    case, whole = record.case(measured=measured, allowed=2), record.case(measured=measured)
    filter_in_lanes({0: case})
    filter_in_lanes({0: whole})
    last = 12 * EVERY
    assert np.count_nonzero(case.estimate[2]) == 3
    np.testing.assert_array_equal(case.estimate[0][: last + 1], whole.estimate[0][: last + 1])
    assert np.isnan(case.estimate[0][last + 1 :]).all()


# Lanes


def variety(record):
    """Return cases that differ in length, in their fed samples, in their start and in their faults."""
    rng = np.random.default_rng(3)
    corrupted = record.with_outlier(4 * EVERY, 1, 2.0)
    corrupted[8 * EVERY :, 3] += 40.0
    lost = record.bodies.copy()
    lost[20, 9] = math.nan
    short = slice(0, 32)
    return [
        record.case(),
        record.case(fed=np.arange(STEPS + 1) % 7 == 3),
        Case(record.bodies[short], record.measured[:33], record.fed[:33], record.x0),
        record.case(measured=corrupted, patience=2, vibrating=np.arange(STEPS + 1) < 30),
        Case(lost, record.measured, rng.uniform(size=STEPS + 1) < 0.2, record.x0),
        record.case(fed=np.zeros(STEPS + 1, dtype=bool)),
        record.case(measured=corrupted, allowed=1),
        record.case(x0=np.where(np.arange(18) == 5, record.x0 + 3.0, record.x0)),
    ]


def assert_same(case, other):
    for mine, theirs in zip(case.estimate, other.estimate, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.skipif(not COMPILED, reason="eight runs, and uncompiled lanes are plain arrays")
def test_results_do_not_depend_on_the_lane_or_its_neighbours(record):
    """The result is the same bit for bit, in any lane, alone or with cases of other lengths and fed samples."""
    alone, together = variety(record), variety(record)
    for case in alone:
        filter_in_lanes({0: case})
    for first in range(0, len(together), LANES):
        group = together[first : first + LANES]
        filter_in_lanes({LANES - 1 - i: case for i, case in enumerate(group)})
    for case, other in zip(alone, together, strict=True):
        assert_same(case, other)
    assert np.isfinite(alone[1].estimate[0]).all()


def test_a_lane_that_is_lost_for_good_leaves_its_neighbours_alone(record):
    """Every step, sample and constant of one lane is NaN."""
    alone, paired = record.case(), record.case()
    lost = record.case(measured=np.full_like(record.measured, math.nan), noise=np.full(6, math.nan))
    lost.arrays = np.full_like(record.bodies, math.nan), *lost.arrays[1:]
    filter_in_lanes({0: alone})
    filter_in_lanes({0: lost, 1: paired})
    assert_same(alone, paired)
    assert (lost.estimate[2] & kernel.RESET).sum() > STEPS // 2
