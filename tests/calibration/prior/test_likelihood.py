"""Likelihood of a prior from the innovations: compared with a dense Gaussian, and the cost of rejected data."""

import dataclasses
import logging

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm
from support.missions import glide_series, replaced

from gliderhpc.calibration.prior import likelihood as likelihood_module
from gliderhpc.calibration.prior.likelihood import (
    PriorEvaluation,
    PriorLikelihood,
    _cut,
    _undisturbed,
    tuning_profiles,
)
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation import filter as filter_module
from gliderhpc.estimation.filter import filter_with_priors
from gliderhpc.estimation.innovations import log_density
from gliderhpc.estimation.preparation import PreparedProfile, controls_of
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.self_motion import flight_guesses
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.platform import DisturbancePrior, read_platform, with_overrides

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
GLIDER = Glider(PETREL)
SETTINGS = EstimationSettings()
STEP = SETTINGS.step
GLIDE = steady_glide(GLIDER, 0.4, -np.radians(23.0), 100.0)
USUAL = default_prior(PETREL)
STEADIER = DisturbancePrior(
    deviation=(0.1, 0.05, 0.1, 0.02, 0.05, 0.2), correlation_time=(600.0, 60.0, 600.0, 60.0, 600.0, 20.0)
)


def glide_record(steps, sample_interval=1.0):
    buoyancy = PETREL.buoyancy
    volume = buoyancy.neutral_volume_m3 - GLIDE.net_mass / buoyancy.water_density
    controls = np.tile([GLIDE.battery_position, 0.0, volume, 0.0], (steps, 1))
    return glide_series(PETREL, GLIDE.state, controls, sample_interval=sample_interval)[0]


def request(series, platform=PETREL, vibrating=None, initial_error=None):
    glider = Glider(platform)
    vibrating = np.zeros(len(series.time), dtype=bool) if vibrating is None else vibrating
    return PreparedProfile(glider, series, glider.bodies(controls_of(platform, series)), vibrating, initial_error)


def noisy(series, seed=0):
    """Give a record with the sensors' errors."""
    deviation = [*[PETREL.sensors.attitude_resolution_rad / np.sqrt(12.0)] * 3, PETREL.sensors.depth_noise]
    noise = np.random.default_rng(seed).standard_normal(series.measurements.shape) * deviation
    return replaced(series, measurements=series.measurements + noise)


def log_likelihood(*requests, prior=USUAL, settings=SETTINGS, recovery=0.0):
    return PriorLikelihood(requests, settings, recovery=recovery).evaluate([prior])[0].log_likelihood


# Against a dense Gaussian

TINY = 1e-6
"""All deviations are scaled by this: then the model is linear about the glide, to as many digits."""


def dense_covariance(platform, series, prior, initial_deviation, variance):
    """Covariance of all samples, from how each depends on the initial state and on every step's disturbance."""
    n, rows = len(series.controls), series.sample_index
    controls = controls_of(platform, series)

    def measured(state, disturbances):
        return GLIDER.simulate(state, controls, disturbances, STEP)[rows][:, [0, 1, 2, 5]].ravel()

    def slope(state_move, disturbance_move):
        up, down = (measured(GLIDE.state + s * state_move, s * disturbance_move) for s in (1e-4, -1e-4))
        return (up - down) / 2e-4

    still, calm = np.zeros(12), np.zeros((n, 6))
    by_state = np.stack([slope(np.eye(12)[i], calm) for i in SENSED], axis=1)
    total = (by_state * initial_deviation**2) @ by_state.T + np.diag(np.tile(variance, len(rows)))
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * STEP
    for channel in range(6):
        moves = np.zeros((n, n, 6))
        moves[np.arange(n), np.arange(n), channel] = 1.0
        by_step = np.stack([slope(still, move) for move in moves], axis=1)
        process = prior.deviation[channel] ** 2 * np.exp(-lag / prior.correlation_time[channel])
        total += by_step @ process @ by_step.T
    return total


def test_the_likelihood_is_the_joint_density_of_all_samples(monkeypatch):
    """Prediction-error decomposition: with a linear model, the log density of the whole record to six digits."""
    initial = filter_module.INITIAL_DEVIATION * TINY
    monkeypatch.setattr(filter_module, "INITIAL_DEVIATION", initial)
    monkeypatch.setattr(likelihood_module, "INITIAL_DEVIATION", initial)
    fine = with_overrides(
        PETREL, {"sensors.attitude_resolution": str(0.1 * TINY), "sensors.depth_noise": str(0.03 * TINY)}
    )
    series = glide_record(60)
    variance = filter_module.measurement_variance(fine, series, SETTINGS)
    answers, expected = [], []
    for seed, prior in enumerate((USUAL, STEADIER)):
        tiny = prior.model_copy(update={"deviation": tuple(TINY * value for value in prior.deviation)})
        covariance = dense_covariance(fine, series, tiny, initial, variance)
        error = np.linalg.cholesky(covariance) @ np.random.default_rng(seed).standard_normal(len(covariance))
        measurements = series.measurements.copy()
        measurements[series.sample_index] += error.reshape(-1, 4)
        record = replaced(series, measurements=measurements)
        guess_error = GLIDE.state - flight_guesses(fine, record)[0]
        answers.append(log_likelihood(request(record, fine, initial_error=guess_error), prior=tiny))
        expected.append(multivariate_normal.logpdf(error, cov=covariance))
    np.testing.assert_allclose(answers, expected, rtol=1e-5)
    assert abs(expected[0] - expected[1]) > 1.0


# What counts, and how much


@pytest.fixture(scope="module")
def record():
    return noisy(glide_record(1500))


def with_outlier(record, sample, size):
    measurements = record.measurements.copy()
    measurements[record.sample_index[sample], 1] += size
    return replaced(record, measurements=measurements)


def test_a_rejected_sample_costs_what_one_at_the_gate_costs(record):
    """However wrong; nothing is gained by its being rejected."""
    clean = log_likelihood(request(record))
    without = record.measurements.copy()
    without[record.sample_index[100], 1] = np.nan
    missing = log_likelihood(request(replaced(record, measurements=without)))
    once, worse = (log_likelihood(request(with_outlier(record, 100, size))) for size in (0.5, 1.0))
    assert once == pytest.approx(worse, abs=1e-9)
    evaluation = PriorLikelihood([request(record)], SETTINGS).evaluate([USUAL])[0]
    expected = -0.5 * (SETTINGS.filter.gate**2 + np.log(2.0 * np.pi * evaluation.variances[100, 1]))
    assert once - missing == pytest.approx(expected, abs=1e-6)
    assert once < clean - 60.0


def test_a_restart_costs_four_samples_at_the_gate(record):
    jumped = record.measurements.copy()
    jumped[700:, 3] += 60.0
    follows = request(replaced(record, measurements=jumped))
    (estimate,) = filter_with_priors([follows], [USUAL], SETTINGS)
    assert estimate.reset >= 1
    samples = np.nansum(log_density(estimate.innovations, estimate.innovation_variances, SETTINGS.filter.gate))
    deviation = [*[PETREL.sensors.attitude_resolution_rad / np.sqrt(12.0)] * 3, PETREL.sensors.depth_noise]
    variance = filter_module.INITIAL_DEVIATION[:4] ** 2 + np.square(deviation)
    charge = -0.5 * np.sum(SETTINGS.filter.gate**2 + np.log(2.0 * np.pi * variance))
    assert log_likelihood(follows) == pytest.approx(samples + estimate.reset * charge, rel=1e-12)


def test_the_vibration_set_and_what_follows_it_do_not_count(record):
    vibrating = np.zeros(len(record.time), dtype=bool)
    vibrating[500:600] = True
    likelihood = PriorLikelihood([request(record, vibrating=vibrating)], SETTINGS, recovery=20.0)
    known = np.isfinite(likelihood.evaluate([USUAL])[0].innovations).all(axis=1)
    rows = record.sample_index
    np.testing.assert_array_equal(known, (rows < 500) | (rows > 599 + 200))


def test_an_interpolated_record_counts_as_often_as_it_was_sampled(record):
    slow = replaced(record, sample_interval=20.0, sample_index=record.sample_index[::20])
    likelihood = PriorLikelihood([request(slow)], SETTINGS)
    evaluation = likelihood.evaluate([USUAL])[0]
    total = np.nansum(log_density(evaluation.innovations, evaluation.variances, SETTINGS.filter.gate))
    assert evaluation.log_likelihood == pytest.approx(total / 20.0)
    np.testing.assert_allclose(likelihood.weights, 1.0 / 20.0)


def test_evaluations_side_by_side_equal_single_ones(record):
    """Two profiles with ten priors: each evaluation equals a separate one and the platform's own filter run."""
    requests = [request(record), request(noisy(glide_record(1200), 1))]
    priors = [
        USUAL.model_copy(update={"deviation": tuple(factor * value for value in USUAL.deviation)})
        for factor in np.geomspace(0.1, 3.0, 10)
    ]
    together = PriorLikelihood(requests, SETTINGS).evaluate(priors)
    for prior, evaluation in zip(priors, together, strict=True):
        parts = [filter_with_priors([one], [prior], SETTINGS)[0].innovations for one in requests]
        np.testing.assert_array_equal(evaluation.innovations, np.concatenate(parts))
    alone = [log_likelihood(one, prior=priors[3]) for one in requests]
    assert together[3].log_likelihood == pytest.approx(sum(alone), rel=1e-14)


def test_information_of_a_scale_is_the_textbook_s():
    """Innovations whose variance is a parameter's exponential: half a unit of information each."""
    record = noisy(glide_record(300))
    likelihood = PriorLikelihood([request(record)], SETTINGS)
    middle = likelihood.evaluate([USUAL])[0]
    by = 1e-3
    above, below = (dataclasses.replace(middle, variances=middle.variances * np.exp(sign * by)) for sign in (1.0, -1.0))
    information = likelihood.information(middle, [above], [below], by)
    np.testing.assert_allclose(information, [[0.5 * np.isfinite(middle.innovations).sum()]])


# Information, against sums by loops


def test_the_density_of_an_innovation_is_a_gaussian_s_as_far_as_the_gate():
    innovations, variances = np.array([0.0, -1.0, 3.9, 4.0, 4.1, np.inf]), np.array([0.5, 2.0, 1.0, 1.0, 1.0, 3.0])
    held = np.array([0.0, -1.0, 3.9, 4.0, 4.0, 4.0 * np.sqrt(3.0)])
    np.testing.assert_allclose(log_density(innovations, variances, 4.0), norm.logpdf(held, scale=np.sqrt(variances)))


def test_information_is_the_sum_over_samples_inside_the_gate(record):
    """Slopes of innovations and of variances by two parameters; a sample beyond the gate in any of five counts not."""
    slow = replaced(record, sample_interval=20.0, sample_index=record.sample_index[::20])
    likelihood, by = PriorLikelihood([request(slow), request(record)], SETTINGS), 0.02
    rows, rng = sum(likelihood.lengths), np.random.default_rng(6)
    shape, gate = (rows, 4), SETTINGS.filter.gate
    variances = rng.uniform(0.5, 2.0, (5, *shape))
    innovations = rng.uniform(-0.9, 0.9, (5, *shape)) * gate * np.sqrt(variances)
    # Outside, in one evaluation each; between the gate and its square, where a wrong power would take them.
    for judged, row in enumerate(range(3, 8)):
        innovations[judged, row, judged % 4] = 1.05 * gate * np.sqrt(variances[judged, row, judged % 4])
    innovations[:, 20] = np.nan
    middle, *moved = (PriorEvaluation(0.0, e, s, ()) for e, s in zip(innovations, variances, strict=True))
    found = likelihood.information(middle, moved[:2], moved[2:], by)
    expected = np.zeros((2, 2))
    for row, sensor in np.ndindex(shape):
        e, s = innovations[:, row, sensor], variances[:, row, sensor]
        if np.all(np.abs(e) < gate * np.sqrt(s)):
            error = (e[1:3] - e[3:]) / (2.0 * by)
            relative = (np.log(s[1:3]) - np.log(s[3:])) / (2.0 * by)
            part = np.outer(error, error) / s[0] + 0.5 * np.outer(relative, relative)
            expected += likelihood.weights[row] * part
    np.testing.assert_allclose(found, expected)
    assert set(likelihood.weights) == {1.0 / 20.0, 1.0}


def test_no_parameter_has_an_empty_information(record):
    likelihood = PriorLikelihood([request(record)], SETTINGS)
    assert likelihood.information(likelihood.evaluate([USUAL])[0], [], [], 0.1).shape == (0, 0)


def test_a_record_at_the_longest_interval_that_is_fed_as_sampled_counts_whole(record):
    slowest = round(SETTINGS.filter.slow_feed)
    thinned = replaced(record, sample_interval=float(slowest), sample_index=record.sample_index[::slowest])
    np.testing.assert_array_equal(PriorLikelihood([request(thinned)], SETTINGS).weights, 1.0)


def test_evaluations_of_profiles_are_joined_in_their_order(record):
    requests = [request(noisy(glide_record(steps), steps)) for steps in (300, 400)]
    likelihood = PriorLikelihood(requests, SETTINGS)
    judged = likelihood.evaluate([USUAL])[0]
    estimates = [filter_with_priors([one], [USUAL], SETTINGS)[0] for one in requests]
    assert likelihood.lengths == tuple(len(estimate.innovations) for estimate in estimates)
    assert judged.rejected_fraction == tuple(estimate.rejected_fraction for estimate in estimates)
    for name, theirs in (("innovations", "innovations"), ("variances", "innovation_variances")):
        both = np.concatenate([getattr(estimate, theirs) for estimate in estimates])
        known = np.isfinite(np.concatenate([estimate.innovations for estimate in estimates]))
        np.testing.assert_array_equal(getattr(judged, name), np.where(known, both, np.nan))


# Which records


@dataclasses.dataclass
class Records:
    """Open observations of a few profiles; a number without one raises."""

    series: dict
    path: str = "dives.nc"

    def profile(self, number):
        if number not in self.series:
            raise ProfileError(f"profile {number}: it is not there")
        return number


@pytest.fixture
def records(monkeypatch, record):
    """Profile 1, which flies; 2, without a sample outside the vibration set; 3, absent."""
    # The battery moves all the way.
    moving = record.controls.copy()
    moving[:, 0] = np.linspace(-0.05, 0.05, len(moving))
    series = {1: record, 2: replaced(record, controls=moving)}
    monkeypatch.setattr(likelihood_module, "on_steps", lambda number, settings, platform: series[number])
    return Records(series)


def test_records_that_cannot_be_used_are_left_out_with_a_warning(records, caplog):
    with caplog.at_level(logging.WARNING, "gliderhpc.tune"):
        found = tuning_profiles(records, PETREL, [3, 1, 2], 100.0, SETTINGS)
    assert [len(one.series.controls) for one in found] == [1000]
    assert [entry.getMessage() for entry in caplog.records] == [
        "profile 3 is left out: profile 3: it is not there",
        "profile 2 is left out: profile 2: no sample outside the vibration set is left to filter",
    ]


@pytest.mark.parametrize(("numbers", "reason"), [([], "it has no profile"), ([3], "profile 3: it is not there")])
def test_no_usable_record_is_refused_with_the_last_reason(records, numbers, reason):
    with pytest.raises(InputError, match=f"dives.nc: no profile to tune on can be used; {reason}"):
        tuning_profiles(records, PETREL, numbers, 100.0, SETTINGS)


@pytest.mark.parametrize(("longest", "steps"), [(40.0, 400), (0.01, 1), (1e6, 1500)])
def test_a_record_is_cut_after_the_longest_time(record, longest, steps):
    weights = np.ones(1501)
    weights[[10, 11, 399, 400, 401, 1400]] = 0.0
    seawater = np.arange(1500.0)
    series = _cut(replaced(record, weights=weights, seawater=seawater), longest)
    assert len(series.controls) == len(series.seawater) == steps
    assert len(series.time) == len(series.measurements) == len(series.weights) == steps + 1
    np.testing.assert_array_equal(series.seawater, seawater[:steps])
    np.testing.assert_array_equal(series.time, record.time[: steps + 1])
    np.testing.assert_array_equal(series.sample_index, [row for row in record.sample_index if row <= steps])
    assert series.gap_seconds == pytest.approx(0.1 * np.sum(weights[: steps + 1] == 0.0))


def test_rows_after_the_vibration_set_do_not_count_for_a_while(record):
    vibrating = np.zeros(1501, dtype=bool)
    vibrating[[0, 1, 700, 701, 702]] = True
    for recovery in (0.0, 0.1, 3.0, 1e3):
        reach = round(10 * recovery)
        expected = [not vibrating[max(row - reach, 0) : row + 1].any() for row in range(1501)]
        expected[0] = False
        found = _undisturbed(request(record, vibrating=vibrating), recovery)
        np.testing.assert_array_equal(found, expected)
