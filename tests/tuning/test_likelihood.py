"""Likelihood of a prior by the innovations: the likelihood against a dense Gaussian's, and what rejected data cost."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support.missions import glide_series, replaced

from gliderhpc.estimation import filter as filter_module
from gliderhpc.estimation.filter import filter_with_priors
from gliderhpc.estimation.preparation import PreparedProfile, controls_of
from gliderhpc.estimation.self_motion import flight_guesses
from gliderhpc.estimation.settings import EstimationSettings, default_prior
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.platform import DisturbancePrior, read_platform, with_overrides
from gliderhpc.tuning import likelihood as likelihood_module
from gliderhpc.tuning.likelihood import PriorLikelihood, log_density, whiteness

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
    return PriorLikelihood(requests, settings, recovery=recovery).judge([prior])[0].log_likelihood


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


def test_it_is_the_density_of_all_samples_together(monkeypatch):
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
    judgement = PriorLikelihood([request(record)], SETTINGS).judge([USUAL])[0]
    expected = -0.5 * (SETTINGS.filter.gate**2 + np.log(2.0 * np.pi * judgement.variances[100, 1]))
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
    known = np.isfinite(likelihood.judge([USUAL])[0].innovations).all(axis=1)
    rows = record.sample_index
    np.testing.assert_array_equal(known, (rows < 500) | (rows > 599 + 200))


def test_an_interpolated_record_counts_as_often_as_it_was_sampled(record):
    slow = replaced(record, sample_interval=20.0, sample_index=record.sample_index[::20])
    likelihood = PriorLikelihood([request(slow)], SETTINGS)
    judgement = likelihood.judge([USUAL])[0]
    total = np.nansum(log_density(judgement.innovations, judgement.variances, SETTINGS.filter.gate))
    assert judgement.log_likelihood == pytest.approx(total / 20.0)
    np.testing.assert_allclose(likelihood.weights, 1.0 / 20.0)


def test_side_by_side_is_alone(record):
    """Two profiles with ten priors: each judgement as it comes out alone, and as the platform's own filter run."""
    requests = [request(record), request(noisy(glide_record(1200), 1))]
    priors = [
        USUAL.model_copy(update={"deviation": tuple(factor * value for value in USUAL.deviation)})
        for factor in np.geomspace(0.1, 3.0, 10)
    ]
    together = PriorLikelihood(requests, SETTINGS).judge(priors)
    for prior, judgement in zip(priors, together, strict=True):
        parts = [filter_with_priors([one], [prior], SETTINGS)[0].innovations for one in requests]
        np.testing.assert_array_equal(judgement.innovations, np.concatenate(parts))
    alone = [log_likelihood(one, prior=priors[3]) for one in requests]
    assert together[3].log_likelihood == pytest.approx(sum(alone), rel=1e-14)


def test_information_of_a_scale_is_the_textbook_s():
    """Innovations whose variance is a parameter's exponential: half a unit of information each."""
    record = noisy(glide_record(300))
    likelihood = PriorLikelihood([request(record)], SETTINGS)
    middle = likelihood.judge([USUAL])[0]
    by = 1e-3
    above, below = (dataclasses.replace(middle, variances=middle.variances * np.exp(sign * by)) for sign in (1.0, -1.0))
    information = likelihood.information(middle, [above], [below], by)
    np.testing.assert_allclose(information, [[0.5 * np.isfinite(middle.innovations).sum()]])


# Whiteness


def test_white_noise_passes():
    parts = np.split(np.random.default_rng(1).standard_normal(6000), 3)
    found = whiteness(parts, 20)
    assert found.count == 6000
    assert abs(found.mean) < 0.04
    assert found.variance == pytest.approx(1.0, abs=0.06)
    assert np.abs(found.autocorrelation).max() < 0.05
    assert found.portmanteau < 1.9
    assert found.p > 0.01


def test_the_portmanteau_keeps_its_level():
    """Of 400 white records a twentieth comes out below 5 %."""
    rng = np.random.default_rng(2)
    small = [whiteness([rng.standard_normal(300)], 10).p < 0.05 for _ in range(400)]
    assert 0.025 < np.mean(small) < 0.085


def test_coloured_noise_does_not():
    rng = np.random.default_rng(3)
    values = np.zeros(4000)
    for k in range(1, 4000):
        values[k] = 0.5 * values[k - 1] + rng.standard_normal()
    found = whiteness([values], 10)
    np.testing.assert_allclose(found.autocorrelation[:3], [0.5, 0.25, 0.125], atol=0.06)
    assert found.p < 1e-12
    assert found.portmanteau > 50.0


def test_pairs_across_a_missing_one_or_a_profile_s_end_do_not_count():
    apart = np.full(200, np.nan)
    apart[::2] = np.tile([1.0, 1.0, -1.0, -1.0], 25)
    found = whiteness([apart[:100], apart[100:]], 4)
    np.testing.assert_array_equal(found.autocorrelation[[0, 2]], 0.0)
    assert found.autocorrelation[3] < -0.9


def test_too_few_innovations_say_nothing():
    assert np.isnan(whiteness([np.ones(5)], 10).p)
