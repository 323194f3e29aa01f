"""Iterated smoother: exact MAP of a dive, gaps and true north, correct intervals, and comparison with the windows."""

import numpy as np
import pytest
from support.missions import glide_series, replaced
from support.smoothing import DEVIATION, GLIDE, MEASURED, PETREL, TIME, H, fly, with_measured

from gliderhpc.estimation.filter import filter_with_priors
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings
from gliderhpc.estimation.smoother.iterate import iterate_passes, run_smoother
from gliderhpc.estimation.smoother.noise import HeavyTails
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import window
from gliderhpc.kernels.smoother_allocation import allocate_backward
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import read_platform
from gliderhpc.simulator.disturbance import RandomProcess
from gliderhpc.simulator.sections import GaussMarkov
from gliderhpc.twins.cases import TwinCase, world
from gliderhpc.twins.estimators.methods import ADJOINT, PAPER, SMOOTHER
from gliderhpc.twins.estimators.runs import estimator_rows

pytestmark = pytest.mark.compiled

SETTINGS = EstimationSettings()
USUAL = SmootherSettings()
TIGHT = SmootherSettings(tolerance=1e-8, estimate="mode")


def smooth(flown, settings=USUAL, **options):
    return iterate_passes(PETREL.hull, flown, options.pop("start"), settings, **options)


def map_gradient(dive, state0, disturbances):
    """Return the gradient of the MAP cost along its own trajectory, by normalised initial state and noise.

    The part of the measurements is from the project's adjoint, one channel after the other; a channel whose
    measurements equal the model adds nothing.
    """
    n = len(dive.bodies)
    by_b, by_start = np.zeros((n, 6)), (state0[SENSED] - dive.mean[:10]) / dive.deviation[:10] ** 2
    states, tape, gradient = np.empty((n + 1, 10)), np.empty((n, window.TAPE)), np.empty((n, 6))
    at_start, cost = np.empty(10), np.empty(1)
    trajectory = PETREL.simulate(state0, np.tile(GLIDE.control, (n, 1)), disturbances, H)
    for channel in range(4):
        known = np.isfinite(dive.measured[:, channel])
        measured = trajectory[:, MEASURED].copy()
        measured[known, channel] = dive.measured[known, channel]
        weights = np.where(known, 0.5 / (H * dive.variance[:, channel]), 0.0)
        window.cost_and_gradient(
            PETREL.hull, dive.bodies, state0[SENSED][None], disturbances, measured, weights, H, states, tape,
            gradient, at_start, cost,
        )  # fmt: skip
        by_b += gradient
        by_start = by_start + at_start
        if known[0]:
            residual = trajectory[0, MEASURED[channel]] - dive.measured[0, channel]
            by_start[channel] += np.arctan2(np.sin(residual), np.cos(residual)) / dive.variance[0, channel]
    noise = disturbances[1:] - dive.decay * disturbances[:-1]
    by_noise, costate = np.zeros((n, 6)), np.zeros(6)
    for k in range(n - 1, -1, -1):
        costate = by_b[k] + dive.decay * costate
        if k > 0:
            by_noise[k] = np.sqrt(dive.noise[k - 1]) * (costate + noise[k - 1] / dive.noise[k - 1])
    by_noise[0] = dive.deviation[10:] * (costate + disturbances[0] / dive.deviation[10:] ** 2)
    return np.concatenate([by_start * dive.deviation[:10], by_noise.ravel()])


@pytest.fixture(scope="module")
def flown():
    """Return five minutes of a dive through north, with a gap, missing channels and a stretch of more noise."""
    flown = fly(11, 3000, turn=0.05)
    measured = flown.problem.measured.copy()
    measured[1000:1400] = np.nan
    measured[500, 2] = np.nan
    measured[2000:2100, 3] = np.nan
    measured[:, 2] = np.mod(measured[:, 2], 2.0 * np.pi)
    dive = with_measured(flown.problem, measured)
    dive.noise[2500:2600] *= 30.0
    return dive, flown


# The exact MAP


def test_the_map_cost_is_stationary(flown):
    """Gauss-Newton ends at a zero of the adjoint's gradient: every entry is 1e-6 of its size at the prior mean."""
    dive, truth = flown
    start = truth.glide
    smoothed = smooth(dive, TIGHT, start=start)
    assert smoothed.outcome is Outcome.CONVERGED
    at_start = map_gradient(dive, start.states[0], start.disturbances[:-1])
    at_end = map_gradient(dive, smoothed.states[0], smoothed.disturbances)
    assert np.abs(at_end).max() < 1e-6 * np.abs(at_start).max()


def test_the_states_are_the_trajectory_of_the_disturbances(flown):
    dive, truth = flown
    smoothed = smooth(dive, TIGHT, start=truth.guess)
    n = len(smoothed.disturbances)
    flight = PETREL.simulate(smoothed.states[0], np.tile(GLIDE.control, (n, 1)), smoothed.disturbances, H)
    np.testing.assert_allclose(smoothed.states, flight, atol=1e-7)


def test_few_passes_from_far_away(flown):
    """The first path is an undisturbed glide, which is farther away than the filter's estimate."""
    dive, truth = flown
    smoothed = smooth(dive, start=truth.guess)
    assert smoothed.outcome is Outcome.CONVERGED
    assert smoothed.passes <= 8


# Gaps and north


def test_intervals_are_wider_in_a_gap(flown):
    dive, truth = flown
    smoothed = smooth(dive, start=truth.guess)
    inside, outside = smoothed.states_std[1200], smoothed.states_std[700]
    assert (inside[[0, 1, 2, 5]] > 2.0 * outside[[0, 1, 2, 5]]).all()
    assert smoothed.disturbances_std[1200, 5] > 1.5 * smoothed.disturbances_std[700, 5]
    error = (smoothed.states - truth.states)[1000:1400] / smoothed.states_std[1000:1400]
    assert np.abs(error[:, SENSED]).max() < 4.5
    assert smoothed.used == np.isfinite(dive.measured).sum()


def test_full_turns_of_the_heading_do_not_change_the_smoothed_estimate(flown):
    dive, truth = flown
    turned = dive.measured.copy()
    turned[1500:, 2] += 2.0 * np.pi
    turned[:700, 2] -= 4.0 * np.pi
    plain = smooth(dive, start=truth.guess)
    again = smooth(with_measured(dive, turned), start=truth.guess)
    np.testing.assert_allclose(again.disturbances, plain.disturbances, atol=1e-9)


def test_a_masked_sample_is_as_if_it_had_never_been(flown):
    dive, truth = flown
    corrupted = dive.measured.copy()
    corrupted[600] = np.nan
    without = smooth(with_measured(dive, corrupted), start=truth.guess)
    corrupted[600] = 1e3
    masked = with_measured(dive, corrupted)
    masked.fed[600] = False
    np.testing.assert_array_equal(smooth(masked, start=truth.guess).disturbances, without.disturbances)


def test_variances_are_sound(flown):
    """They are within the prior's before noise is added, and positive; those of the track start at zero."""
    dive, truth = flown
    smoothed = smooth(dive, TIGHT, start=truth.guess)
    assert (smoothed.disturbances_std[:2500] <= DEVIATION * (1.0 + 1e-9)).all()
    assert (smoothed.states_std[:, SENSED] > 0.0).all()
    np.testing.assert_array_equal(smoothed.states_std[0, 3:5], 0.0)
    np.testing.assert_allclose(smoothed.states_std[-1, 3:5] ** 2, np.diag(smoothed.displacement_covariance), rtol=1e-12)
    np.testing.assert_array_equal(smoothed.displacement_covariance, smoothed.displacement_covariance.T)
    assert np.linalg.eigvalsh(smoothed.displacement_covariance).min() > 0.0


# Intervals


def test_intervals_cover_the_truth_at_their_nominal_rate():
    """For twins drawn from the prior, with half the smoother's step: 68 % and 95 % intervals in every channel."""
    errors, widths, displacement = [], [], []
    for seed in range(32):
        flown = fly(100 + seed, 5000)
        smoothed = smooth(flown.problem, start=flown.guess)
        assert smoothed.outcome is Outcome.CONVERGED
        errors.append((smoothed.disturbances - flown.disturbances)[300:] / smoothed.disturbances_std[300:])
        widths.append(smoothed.disturbances_std[300:].mean(axis=0) / DEVIATION)
        wrong = smoothed.states[-1, 3:5] - flown.states[-1, 3:5]
        displacement.append(wrong @ np.linalg.solve(smoothed.displacement_covariance, wrong))
    error = np.abs(np.vstack(errors))
    within, mostly = (error < 0.9945).mean(axis=0), (error < 1.96).mean(axis=0)
    assert ((within > 0.62) & (within < 0.74)).all(), within
    assert ((mostly > 0.92) & (mostly < 0.97)).all(), mostly
    # The intervals are not simply wide: the strongly observed channels are far more certain than the prior.
    assert (np.mean(widths, axis=0)[[4, 5]] < 0.5).all()
    # Two components each, so a chi-square of 64: within its 0.1 % tails.
    assert 34.0 < np.sum(displacement) < 105.0


def test_the_random_process_is_the_prior_s():
    """It has the stationary deviation and the correlation time of the prior for any step."""
    settings = GaussMarkov(deviation=tuple(DEVIATION), correlation_time=tuple(TIME))
    for step in (0.05, 0.5):
        drawn = RandomProcess(settings, 3).sampled(round(20_000 / step), step)
        np.testing.assert_allclose(drawn.std(axis=0), DEVIATION, rtol=0.12)
        lag = round(10.0 / step)
        correlation = [np.corrcoef(x[:-lag], x[lag:])[0, 1] for x in drawn.T]
        np.testing.assert_allclose(correlation, np.exp(-10.0 / TIME), atol=0.06)


# Next to the windows


@pytest.fixture(scope="module")
def rows():
    """Return the scores of usual twins (slow disturbances and impulses), by estimator."""
    hull, scenario = read_platform("petrel-l"), world(60.0)
    found = [
        row
        for seed in (1, 2)
        for row in estimator_rows(TwinCase(hull, scenario, seed, SETTINGS), (SMOOTHER, ADJOINT, PAPER))
    ]
    return {arm: [row for row in found if row["arm"] == arm.name] for arm in (SMOOTHER, ADJOINT, PAPER)}


@pytest.mark.parametrize(
    ("channel", "arm", "share"),
    [
        ("B_cr", PAPER, 0.5), ("B_cu", PAPER, 0.25), ("B_cq", PAPER, 0.25), ("B_cr", ADJOINT, 0.6),
        *((name, ADJOINT, 1.0) for name in ("B_cu", "B_cw", "B_cq")),
    ],
    ids=lambda value: getattr(value, "name", value),
)  # fmt: skip
def test_the_smoother_beats_the_windows(rows, channel, arm, share):
    ours, theirs = (np.median([row[f"rmse_{channel}"] for row in rows[one]]) for one in (SMOOTHER, arm))
    assert ours <= share * theirs


def test_a_twin_s_row_says_how_it_went(rows):
    for row in rows[SMOOTHER]:
        assert row["outcome"] == "CONVERGED"
        assert row["rounds"] <= 8
        assert row["displacement_deviations"] < 5.0


# A profile


def record():
    platform = PETREL.platform
    volume = platform.buoyancy.neutral_volume_m3 - GLIDE.net_mass / platform.buoyancy.water_density
    raw = np.tile([GLIDE.battery_position, 0.0, volume, 0.0], (2000, 1))
    return glide_series(platform, GLIDE.state, raw)[0]


def smoothed_profile(series, settings=SETTINGS):
    profile = prepare_profile(PETREL, series)
    (estimate,) = filter_with_priors([profile], [default_prior(PETREL.platform)], settings)
    return estimate, run_smoother(profile, estimate, settings)


def test_samples_gated_by_the_filter_have_no_weight_in_the_smoother():
    series = record()
    corrupted = series.measurements.copy()
    corrupted[1000, 1] += np.radians(20.0)
    estimate, smoothed = smoothed_profile(replaced(series, measurements=corrupted))
    assert estimate.gated == 1
    assert smoothed.used == 4 * (estimate.fed - 1)
    weights = series.weights.copy()
    weights[1000] = 0.0
    _, without = smoothed_profile(replaced(series, weights=weights))
    np.testing.assert_allclose(smoothed.disturbances, without.disturbances, atol=1e-6)


def test_outliers_in_the_vibration_set_have_their_variance_widened():
    series = record()
    controls, corrupted = series.controls.copy(), series.measurements.copy()
    controls[999:1002, 0] += [1e-4, 2e-4, 1e-4]
    corrupted[1000, 1] += np.radians(20.0)
    estimate, smoothed = smoothed_profile(replaced(series, controls=controls, measurements=corrupted))
    assert estimate.gated == 0
    assert smoothed.widened >= 1
    assert smoothed.used == 4 * estimate.fed


def test_a_dive_that_cannot_be_smoothed_leaves_the_filter_s_estimate(monkeypatch):
    """If it stops before convergence, the result is the filter's estimate, without uncertainty."""
    monkeypatch.setattr("gliderhpc.estimation.smoother.iterate._ACCEPTED_MOVE", 0.0)
    flown = fly(31, 2000)
    series = replaced(
        record(), measurements=np.column_stack([np.interp(np.arange(2001), np.arange(0, 2001, 10), x[::10])
                                                for x in flown.problem.measured.T])
    )  # fmt: skip
    settings = EstimationSettings(smoother=SmootherSettings(max_passes=2))
    estimate, smoothed = smoothed_profile(series, settings)
    assert smoothed.outcome is Outcome.DIVERGED
    assert not smoothed.outcome.usable
    np.testing.assert_array_equal(smoothed.disturbances, estimate.disturbances[:-1])
    np.testing.assert_array_equal(smoothed.states, estimate.states)
    assert np.isnan(smoothed.disturbances_std).all()
    assert np.isnan(smoothed.displacement_covariance).all()


def test_a_stationary_glider_is_smoothed_by_the_most_probable_path(monkeypatch):
    """About rest the mean's shift of the path diverges: two hours at rest gave 0.6 m/s."""
    by_mode = EstimationSettings(smoother=SmootherSettings(estimate="mode"))
    _, expected = smoothed_profile(record(), by_mode)
    _, mean = smoothed_profile(record(), EstimationSettings())
    monkeypatch.setattr("gliderhpc.estimation.smoother.iterate.stationary_points", lambda series: np.ones(1, bool))
    _, stationary = smoothed_profile(record(), EstimationSettings())
    np.testing.assert_array_equal(stationary.states, expected.states)
    assert not np.array_equal(mean.states, expected.states)


# Heavy tails


def pulses(n):
    """Return a yaw moment of 1 N m for three seconds, every forty seconds."""
    wave = np.zeros((n, 6))
    for begin in range(200, n - 100, 400):
        wave[begin : begin + 30, 5] = 1.0
    return wave


def test_heavy_tails_do_not_smear_pulses():
    """For sudden pulses and a quiet prior, height and quiet intervals are more accurate; pulses are less certain."""
    n = 4000
    flown, wave = fly(21, n), pulses(n)
    rng = np.random.default_rng(5)
    states = PETREL.simulate(flown.guess.states[0], np.tile(GLIDE.control, (n, 1)), wave, H)
    samples = states[:, MEASURED] + 5e-4 * rng.standard_normal((n + 1, 4))
    measured = np.where(flown.problem.fed[:, None], samples, np.nan)
    scores = {}
    for name, freedom in (("normal", None), ("heavy", 3.0)):
        dive = with_measured(flown.problem, measured)
        dive.noise[:, 5] *= 0.01
        tails = None if freedom is None else HeavyTails(dive.noise.copy(), freedom, (5,), 10)
        smoothed = smooth(dive, start=flown.guess, noise_models=[] if tails is None else [tails])
        error = (smoothed.disturbances - wave)[:, 5]
        inside = wave[:, 5] > 0.0
        scores[name] = np.sqrt([np.mean(error[inside] ** 2), np.mean(error[~inside] ** 2)])
    assert (scores["heavy"] < 0.8 * scores["normal"]).all(), scores


def test_weights_are_those_of_student_s_t():
    """A resolved square of R variances gives the weight (nu + R) / (nu + 1); other channels keep theirs."""
    nominal = np.full((20, 6), 0.5)
    tails = HeavyTails(nominal, 4.0, (5,), 10)
    linear = allocate_backward(1, 20)
    # Nine unresolved degrees of freedom at the prior's variance, and one resolved with R = 31 in the second interval.
    linear.noise_mean[10:, 5] = np.sqrt(0.5 * 30.0 / 10.0)
    weights = tails.updated(nominal.copy(), linear)
    np.testing.assert_allclose(weights[:10, 5], 0.5)
    np.testing.assert_allclose(weights[10:, 5], 0.5 * 35.0 / 5.0)
    np.testing.assert_array_equal(weights[:, :5], nominal[:, :5])
