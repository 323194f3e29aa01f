"""Smoother's model of record and noise: repeated rounded values, lagging actuators, and intensity of a dive's noise."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.smoothing import DEVIATION, PETREL, controls, fly

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile, repetitions
from gliderhpc.estimation.priors import ROUGH_WATER, SLOW_RECORD, candidate_priors, default_prior, smoother_prior
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings, SmootherSettings, smoother_passes
from gliderhpc.estimation.smoother import iterate, problem
from gliderhpc.estimation.smoother.estimate import filter_fallback
from gliderhpc.estimation.smoother.iterate import iterate_passes, run_smoother
from gliderhpc.estimation.smoother.noise import WEIGHT, NoiseScale, actuation_noise, standardised_noise
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.kernels.smoother_allocation import allocate_backward
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import DisturbancePrior, read_platform
from gliderhpc.simulator import load_scenario, simulate_profile


def test_a_run_of_equal_values_is_counted():
    np.testing.assert_array_equal(repetitions(np.array([1.0, 1.0, 2.0, 2.0, 2.0, np.nan, np.nan, 1.0])),
                                  [2, 2, 3, 3, 3, 1, 1, 1])  # fmt: skip


def test_actuators_at_rest_add_no_noise():
    bodies = PETREL.bodies(controls(50))
    assert not actuation_noise(bodies, np.zeros((50, 2)), np.full(50, 1.0), 0.1).any()


def test_a_moving_battery_s_noise_is_its_lag_s_moment_squared():
    """For a move at speed v and pitch 0, the moment is in error by m g v lag (eq. 9) at both ends of the move."""
    lag, step, speed, n = 1.0, 0.1, 1e-3, 200
    moving = np.tile(controls(1)[0], (n, 1))
    moving[:, 0] += speed * np.clip(np.arange(n) * step - 5.0, 0.0, 8.0)
    noise = actuation_noise(PETREL.bodies(moving), np.zeros((n, 2)), np.full(n, lag), step)
    moment = 9.81 * PETREL.platform.mass.battery * speed * lag
    begun = noise[:100].sum(axis=0)
    assert begun[4] == pytest.approx(moment**2, rel=0.02)
    assert noise.sum(axis=0)[4] == pytest.approx(2.0 * moment**2, rel=0.02)
    assert not noise[:, :3].any()
    # The moment about z requires roll; that about x does not depend on the battery's position along x.
    assert noise.sum(axis=0)[[3, 5]] == pytest.approx(0.0, abs=1e-20)


def test_noise_factors_are_the_ratio_of_squared_to_resolved_noise():
    n = 30
    prior = np.full((n, 6), 2.0)
    scale = NoiseScale(prior, np.zeros((n, 6)), np.ones(n, dtype=bool), (0, 5))
    linear = allocate_backward(1, n)
    linear.noise_resolved[:] = 0.5
    linear.noise_mean[:] = np.sqrt(3.0 * 2.0 * 0.5)
    updated = scale.updated(prior, linear)
    resolved = 0.5 * n
    np.testing.assert_allclose(updated[:, [0, 5]], 2.0 * (3.0 * resolved + WEIGHT) / (resolved + WEIGHT))
    np.testing.assert_array_equal(updated[:, 1:5], 2.0)


def test_standardised_noise_is_over_its_own_deviation():
    """Harvey and Koopman (1992): smoothed noise has the variance of the noise less its posterior variance."""
    linear = allocate_backward(3, 3)
    linear.noise_mean[:] = [[3.0] * 6, [0.5] * 6, [0.0] * 6]
    linear.noise_resolved[:] = [[0.25] * 6, [1.0] * 6, [0.0] * 6]
    found = standardised_noise(linear, np.full((3, 6), 4.0))
    np.testing.assert_allclose(found[:2], [[3.0] * 6, [0.25] * 6])
    assert np.isnan(found[2]).all()


@pytest.mark.compiled
def test_the_noise_factor_of_a_dive_corrects_a_prior_that_is_too_strong():
    """With a prior nine times too strong in yaw, the factor is close to a ninth, and the interval is narrower."""
    flown = fly(41, 6000)
    truth = flown.problem.noise.copy()
    widths = {}
    for adaptive in (False, True):
        noise = truth.copy()
        noise[:, 5] *= 9.0
        dive = flown.problem._replace(noise=noise, variance=flown.problem.variance.copy())
        scale = NoiseScale(noise.copy(), np.zeros_like(noise), np.ones(len(noise), dtype=bool), tuple(range(6)))
        smoothed = iterate_passes(
            PETREL.hull, dive, flown.guess, SmootherSettings(), noise_models=[scale] if adaptive else []
        )
        widths[adaptive] = smoothed.disturbances_std[300:, 5].mean()
    assert 0.08 < smoothed.noise_factor[5] < 0.25
    assert widths[True] < 0.7 * widths[False]
    assert widths[True] < DEVIATION[5]


@pytest.mark.compiled
def test_a_segment_of_the_dive_gives_its_noise(monkeypatch):
    """A quarter of the dive gives a ninth, like the whole dive; one without an estimate gives no factor."""
    flown = fly(41, 6000)
    noise = flown.problem.noise.copy()
    noise[:, 5] *= 9.0
    dive = flown.problem._replace(noise=noise.copy(), variance=flown.problem.variance.copy())
    scale = NoiseScale(noise.copy(), np.zeros_like(noise), np.ones(len(noise), dtype=bool), tuple(range(6)))
    given = PETREL.hull, dive, flown.guess, scale, SmootherSettings(), np.inf
    factors = scale.factors(iterate.noise_from_segment(*given))
    assert 0.05 < factors[5] < 0.4
    np.testing.assert_array_equal(dive.noise, noise)
    monkeypatch.setattr(iterate, "iterate_passes", lambda *a, **k: filter_fallback(_filtered(flown)))
    np.testing.assert_array_equal(iterate.noise_from_segment(*given), noise)


@pytest.mark.compiled
def test_new_noise_and_the_whole_move_take_one_sweep(monkeypatch):
    """The estimate is the same bit for bit as with a sweep for each; only the number of sweeps differs."""
    flown, found, sweeps = fly(41, 6000), [], []
    forward = problem.Sweeps.forward
    monkeypatch.setattr(problem.Sweeps, "forward", lambda *args: (sweeps.append(len(found)), forward(*args))[1])
    for at_once in (True, False):
        if not at_once:
            monkeypatch.setattr(iterate._Iteration, "_move_with_noise", lambda *args: False)
        noise = flown.problem.noise.copy()
        noise[:, 5] *= 9.0
        dive = flown.problem._replace(noise=noise, variance=flown.problem.variance.copy())
        scale = NoiseScale(noise.copy(), np.zeros_like(noise), np.ones(len(noise), dtype=bool), tuple(range(6)))
        smoothed = iterate_passes(PETREL.hull, dive, flown.guess, SmootherSettings(), noise_models=[scale])
        found.append((smoothed, dive.noise.copy()))
    (once, noise), (twice, usual) = found
    np.testing.assert_array_equal(once.states, twice.states)
    np.testing.assert_array_equal(once.disturbances_std, twice.disturbances_std)
    np.testing.assert_array_equal(noise, usual)
    assert once.passes == twice.passes
    assert sweeps.count(0) < sweeps.count(1)


@pytest.mark.compiled
def test_noise_that_overshoots_settles_soon():
    """Each renewal leaves 0.7 of its distance (in logarithms) on the other side; made whole, it would take nine."""
    flown = fly(41, 2000)
    dive = flown.problem._replace(noise=flown.problem.noise.copy(), variance=flown.problem.variance.copy())
    settled, used = 5.0 * dive.noise, []

    class Overshooting:
        def updated(self, noise, linear):
            used.append(noise.copy())
            return settled * (settled / noise) ** 0.7

    smoothed = iterate_passes(PETREL.hull, dive, flown.guess, SmootherSettings(), noise_models=[Overshooting()])
    assert smoothed.outcome is Outcome.CONVERGED
    assert len({noise[0, 0] for noise in used}) <= 7
    np.testing.assert_allclose(dive.noise, settled, rtol=0.1)


def _filtered(flown):
    return SimpleNamespace(states=flown.guess.states, disturbances=flown.guess.disturbances)


def test_slow_sensors_on_an_uncalibrated_hull_are_smoothed_once():
    slow, quick = read_platform("seaexplorer"), read_platform("petrel-l")
    own = slow.model_copy(update={"prior": DisturbancePrior(deviation=(0.1,) * 6, correlation_time=(60.0,) * 6)})
    usual = SmootherSettings()
    assert [smoother_passes(p, usual) for p in (slow, quick, own)] == [1, 20, 20]
    assert smoother_passes(slow, SmootherSettings(max_passes=7)) == 7
    assert [smoother_prior(p, default_prior(p)) for p in (slow, quick, own)] == [
        SLOW_RECORD,
        default_prior(quick),
        own.prior,
    ]
    assert smoother_prior(quick, ROUGH_WATER) == ROUGH_WATER


def test_slow_records_of_a_hull_with_fast_sensors_are_treated_as_those_of_slow_sensors():
    """Decimated records; a hull's own prior was fitted to its records, and remains."""
    quick, slow = read_platform("petrel-l"), read_platform("seaexplorer")
    own = quick.model_copy(update={"prior": DisturbancePrior(deviation=(0.1,) * 6, correlation_time=(60.0,) * 6)})
    assert [smoother_passes(p, SmootherSettings(), interval=8.0) for p in (quick, own)] == [1, 20]
    assert [default_prior(p, interval=8.0) for p in (quick, own)] == [default_prior(slow), own.prior]
    assert candidate_priors(quick, interval=8.0) == candidate_priors(slow)
    assert smoother_prior(quick, default_prior(quick), interval=8.0) == SLOW_RECORD
    assert default_prior(quick, interval=1.0) == default_prior(quick)


@pytest.mark.compiled
@pytest.mark.parametrize(("every", "most"), [(5, 0.03), (8, 0.015)])
def test_gusts_that_a_decimated_record_does_not_resolve_do_not_bias_the_speed(every, most):
    """With the prior for fast records, the true hull's speed was wrong by 0.19 and 0.1 m/s."""
    hull, settings = read_platform("petrel-l"), EstimationSettings(step=0.25)
    scenario = load_scenario("paper").replaced({"depth": 120.0, "depth_spread": 0.0})
    record, truth = simulate_profile(hull, scenario, 2)
    rows = np.arange(0, len(record.time), every)
    columns = [one.name for one in fields(record) if np.shape(getattr(record, one.name)) == record.time.shape]
    decimated = replace(record, **{name: getattr(record, name)[rows] for name in columns})
    profile = prepare_profile(Glider(hull), on_steps(decimated, settings, hull))
    smoothed = run_smoother(profile, run_filter(profile, settings), settings)
    time = profile.series.time
    steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1])
    error = (smoothed.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6]))[steady]
    assert np.sqrt(np.mean(error**2)) < most


@pytest.mark.compiled
def test_gusts_in_a_slow_record_are_not_taken_for_a_constant_sideslip():
    """With a side force that was constant over the dive, the true hull's sideslip was wrong by 0.009 m/s throughout."""
    hull, settings = read_platform("slocum"), EstimationSettings(step=0.25)
    scenario = load_scenario("paper").replaced({"depth": 120.0, "depth_spread": 0.0})
    record, truth = simulate_profile(hull, scenario, 3)
    profile = prepare_profile(Glider(hull), on_steps(record, settings, hull))
    smoothed = run_smoother(profile, run_filter(profile, settings), settings)
    time = profile.series.time
    steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1])
    error = (smoothed.states[:, 7] - np.interp(time, truth.time, truth.states[:, 7]))[steady]
    assert abs(error.mean()) < 0.003
    assert np.sqrt(np.mean(error**2)) < 0.004


@pytest.mark.compiled
def test_turns_and_impulses_in_a_slow_record_do_not_leave_a_heave_force():
    """Smoothed about the filter's path alone, the true hull had a heave force of newtons after every turn."""
    hull, settings = read_platform("slocum"), EstimationSettings(step=0.25)
    scenario = load_scenario("impulses").replaced({"depth": 150.0, "steering": {"courses": (90.0,), "interval": 300.0}})
    once = settings.model_copy(update={"smoother": settings.smoother.model_copy(update={"max_passes": 1})})
    squares = {"usual": [], "once": []}
    for seed in (1, 2, 3):
        record, truth = simulate_profile(hull, scenario, seed)
        profile = prepare_profile(Glider(hull), on_steps(record, settings, hull))
        filtered = run_filter(profile, settings)
        time = profile.series.time[:-1]
        steady = ~profile.vibrating[:-1] & (time > 60.0) & (time < truth.time[-1])
        for way, chosen in {"usual": settings, "once": once}.items():
            smoothed = run_smoother(profile, filtered, chosen)
            assert smoothed.passes == {"usual": 2, "once": 1}[way]
            true = truth.disturbances[np.minimum((time / truth.step).astype(int), len(truth.disturbances) - 1), 2]
            squares[way].append(np.mean((smoothed.disturbances[:, 2] - true)[steady] ** 2))
    usual, about_the_filter = (np.sqrt(np.mean(squares[way])) for way in ("usual", "once"))
    assert usual < 0.35
    assert usual < 0.5 * about_the_filter


@pytest.mark.compiled
@pytest.mark.parametrize("end", ["error", "damped", "diverged"])
def test_a_second_pass_that_fails_leaves_the_first(monkeypatch, end):
    hull, settings = read_platform("slocum"), EstimationSettings(step=0.25)
    record, _ = simulate_profile(hull, load_scenario("calm").replaced({"depth": 60.0}), 1)
    profile = prepare_profile(Glider(hull), on_steps(record, settings, hull))
    made, usual = [], iterate._smoothed_from

    def failing_second(*args):
        made.append(usual(*args))
        if len(made) == 2 and end == "error":
            raise np.linalg.LinAlgError("singular")
        changes = {"damped": {"damped": 1}, "diverged": {"outcome": Outcome.DIVERGED}}
        return replace(made[-1], **changes.get(end, {})) if len(made) == 2 else made[-1]

    monkeypatch.setattr(iterate, "_smoothed_from", failing_second)
    smoothed = run_smoother(profile, run_filter(profile, settings), settings)
    assert len(made) == 2
    np.testing.assert_array_equal(smoothed.states, made[0].states)
    assert (smoothed.passes, smoothed.simplified, smoothed.failure) == (1, "", "")


@pytest.fixture(scope="module")
def wandering():
    """Return hull, record and truth of a slow Seaglider dive, sampled every 20 s, with a heading that wanders."""
    hull = read_platform("seaglider")
    hull = hull.model_copy(update={"sensors": hull.sensors.model_copy(update={"sample_interval": 20.0})})
    scenario = load_scenario("calm").replaced(
        {
            "name": "wandering", "profiles": 1, "depth": 150.0, "depth_spread": 0.0,
            "steering": {"courses": (0.0,), "initial_error": 90.0, "interval": 150.0, "dead_band": 3.0},
            "actuation": {"pitch": 20.0, "dive_net_mass": 0.1, "climb_net_mass": -0.1},
            "disturbances": {
                "slow_rms": (0.0,) * 6, "impulse_interval": None,
                "gauss_markov": {"deviation": (0.0,) * 5 + (0.3,), "correlation_time": (60.0,) * 6},
            },
        }
    )  # fmt: skip
    return hull, *simulate_profile(hull, scenario, 7, number=1)


@pytest.mark.compiled
@pytest.mark.parametrize("damping", [-250.0, -800.0, -100.0])
def test_a_wrong_yaw_damping_does_not_bias_the_speed(wandering, damping):
    """Glides hardly determine the yaw damping; with fixed values, the smoothed speed was up to 42 % too low."""
    hull, record, truth = wandering
    assumed, settings = Glider(with_values(hull, {"viscous.K_r": damping})), EstimationSettings()
    profile = prepare_profile(assumed, on_steps(record, settings))
    found = run_smoother(profile, run_filter(profile, settings), settings)
    assert found.states[:, 6].mean() == pytest.approx(truth.states[:, 6].mean(), rel=0.05)


@pytest.mark.compiled
def test_a_single_pass_is_shortened_until_the_path_is_flyable(monkeypatch):
    """Half the move is made if the whole gives no flyable path; the other half is added to the uncertainty."""
    flown = fly(42, 3000)
    only = SmootherSettings(max_passes=1)

    def smoothed():
        dive = flown.problem._replace(variance=flown.problem.variance.copy(), noise=flown.problem.noise.copy())
        return iterate_passes(PETREL.hull, dive, flown.glide, only)

    whole = smoothed()
    answers = iter([False, True])
    monkeypatch.setattr(problem, "flyable", lambda states: next(answers))
    half = smoothed()
    assert (whole.damped, half.damped) == (0, 1)
    assert half.outcome is Outcome.ITERATION_LIMIT
    start = flown.glide.disturbances[:-1]
    np.testing.assert_allclose(half.disturbances - start, 0.5 * (whole.disturbances - start), atol=1e-12)
    variance = whole.disturbances_std**2 + (0.5 * (whole.disturbances - start)) ** 2
    # Inside segments, deviations are interpolated.
    np.testing.assert_allclose(half.disturbances_std[::5] ** 2, variance[::5], rtol=1e-9)
    monkeypatch.setattr(problem, "flyable", lambda states: False)
    assert smoothed().outcome is Outcome.DIVERGED
