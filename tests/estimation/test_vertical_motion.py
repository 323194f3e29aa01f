"""Vertical motion of the water: its detection in the record, and its part in the smoothed estimate and information."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile, smooth_profile
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.forcing import vertical_motion_slopes, with_sample_errors
from gliderhpc.estimation.smoother.information import smoothed_hull_information
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.vertical_motion import (
    CORRELATION_TIME,
    DepthRates,
    correlation,
    depth_rates,
    displacement_basis,
    is_probable,
    motion_deviation,
    motion_prior,
)
from gliderhpc.flight.glider import Glider
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.simulator.scenario import load_scenario

pytestmark = pytest.mark.compiled

HULL, SLOW = read_platform("petrel-l"), read_platform("slocum")
SETTINGS = EstimationSettings(step=0.25)
MOVING = {"vertical": {"rms": 0.01}}


def still(settings=SETTINGS, deviation=0.0):
    return settings.model_copy(update={"smoother": settings.smoother.model_copy(update={"vertical_motion": deviation})})


def flown(scenario="calm", changes=None, seed=3, depth=200.0, hull=HULL):
    record, truth = simulate_profile(hull, load_scenario(scenario).replaced({"depth": depth, **(changes or {})}), seed)
    return prepare_profile(Glider(hull), on_steps(record, SETTINGS, hull)), truth


@pytest.fixture(scope="module")
def calm():
    return flown()


def displaced(profile, displacement):
    """The same profile in water that has moved downwards by the displacement (m)."""
    measurements = profile.series.measurements.copy()
    measurements[:, 3] += displacement
    return replace(profile, series=replace(profile.series, measurements=measurements))


# The record


def test_depth_rate_of_a_glider_in_still_water_does_not_vary_more_than_its_model(calm):
    assert depth_rates(calm[0]).variation()[0] < 0.001
    assert motion_deviation(calm[0]) == 0.0


@pytest.mark.parametrize("scenario", ["paper", "fouling", "demo"])
def test_shear_gusts_and_fouling_are_not_vertical_motion(scenario):
    assert motion_deviation(flown(scenario)[0]) == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_slow_forces_vary_the_depth_rate_but_are_not_taken_for_motion(seed):
    profile, _ = flown("impulses", seed=seed)
    smoothed = run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS)
    found = smoothed_hull_information(profile, smoothed, smoothed.last_pass, SETTINGS)
    assert motion_deviation(profile) > 0.003
    assert found.vertical_motion == 0.0
    assert found.record is None
    without = smoothed_hull_information(profile, smoothed, smoothed.last_pass, still())
    np.testing.assert_allclose(found.information, without.information, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.states, without.states, rtol=1e-9, atol=1e-12)


def test_evidence_of_the_motion_is_that_of_a_normal_distribution():
    """A record that is linear in three errors, the last of which is the motion's."""
    rng = np.random.default_rng(6)
    by_errors, others = rng.standard_normal((20, 3)), np.diag([0.5, 2.0])
    for size, probable in ((0.0, False), (3.0, True)):
        record = by_errors @ np.array([0.3, -0.5, size]) + rng.standard_normal(20)
        score, matrix = by_errors.T @ record, by_errors.T @ by_errors
        wide = np.eye(20) + by_errors @ np.diag([0.5, 2.0, 1.0]) @ by_errors.T
        narrow = np.eye(20) + by_errors[:, :2] @ others @ by_errors[:, :2].T
        gained = multivariate_normal(cov=wide).logpdf(record) - multivariate_normal(cov=narrow).logpdf(record)
        assert is_probable(score, matrix, others, 0.0) == (gained > 0.0) == probable
        assert is_probable(score, matrix, others, 1e-6 - gained)
        assert not is_probable(score, matrix, others, -1e-6 - gained)


def test_deviation_of_a_known_motion(calm):
    """Displacements drawn from the prior; averages over a minute and the knots' interpolation take a fifth of it."""
    profile, deviation = calm[0], 0.012
    basis = deviation * displacement_basis(profile.series.time)
    draws = np.random.default_rng(2).standard_normal((12, basis.shape[1]))
    found = [motion_deviation(displaced(profile, basis @ draw)) for draw in draws]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.8 * deviation, rel=0.2)


def legs(noise=0.0, count=12):
    """Depth rates of a dive and a climb to 200 m without error."""
    depth = np.concatenate([np.linspace(10.0, 200.0, count), np.linspace(200.0, 10.0, count)])
    rate = np.repeat([0.2, -0.2], count)
    return DepthRates(np.linspace(0.0, 2000.0, 2 * count), depth, rate, rate, np.full(2 * count, noise))


def test_errors_that_are_linear_in_depth_are_not_motion():
    flown_legs = legs()
    diving = flown_legs.still > 0.0
    wrong = np.where(diving, 0.02 + 1e-4 * flown_legs.depth, -0.01 - 5e-5 * flown_legs.depth)
    found = replace(flown_legs, measured=flown_legs.measured + wrong)
    assert found.variation()[0] == pytest.approx(0.0, abs=1e-12)


def test_noise_of_the_depth_is_not_motion():
    flown_legs = legs(noise=0.004, count=2000)
    noise = 0.004 * np.random.default_rng(4).standard_normal(4000)
    assert replace(flown_legs, measured=flown_legs.measured + noise).variation()[0] < 0.001


def test_share_of_the_motion_that_remains_about_straight_lines():
    """Mean over draws of the prior, which the share states without any draw."""
    flown_legs, rng = legs(), np.random.default_rng(7)
    root = np.linalg.cholesky(correlation(flown_legs.time))
    draws = [replace(flown_legs, measured=flown_legs.measured + root @ rng.standard_normal(24)) for _ in range(4000)]
    found = np.array([each.variation()[0] for each in draws])
    assert np.sqrt(np.mean(found**2)) == pytest.approx(flown_legs.variation()[1], rel=0.02)


def test_profile_without_steady_glides_shows_no_motion(calm):
    profile, _ = calm
    assert motion_deviation(replace(profile, vibrating=np.ones_like(profile.vibrating))) == 0.0


# The errors


def test_displacement_is_the_integral_of_a_correlated_velocity():
    time = np.arange(0.0, 1500.5, 0.5)
    basis = displacement_basis(time)
    velocity = np.gradient(basis, time, axis=0)
    knots = np.round(np.linspace(0, len(time) - 1, basis.shape[1])).astype(int)[1:-1]
    covariance = velocity[knots] @ velocity[knots].T
    apart = np.abs(time[knots][:, None] - time[knots])
    np.testing.assert_allclose(covariance, np.exp(-apart / CORRELATION_TIME), atol=5e-3)
    np.testing.assert_array_equal(basis[0], 0.0)


@pytest.mark.parametrize(("seconds", "knots"), [(60.0, 2), (1500.0, 11), (30_000.0, 23)])
def test_number_of_knots_grows_with_the_dive_up_to_a_limit(seconds, knots):
    assert displacement_basis(np.arange(0.0, seconds + 1.0)).shape[1] == knots


def test_depth_alone_is_differentiated():
    displacement = np.array([[0.0, 1.0], [2.0, 3.0]])
    slopes = vertical_motion_slopes(displacement, 7)
    np.testing.assert_array_equal(slopes[:, 3], -displacement)
    assert not np.delete(slopes, 3, axis=1).any()


# The estimate


@pytest.fixture(scope="module")
def smoothed_calm(calm):
    profile, _ = calm
    return profile, run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS)


def test_sensitivity_to_the_motion_is_the_change_of_the_smoothed_estimate(calm):
    """The smoother with fixed noise, of a depth that is displaced by one error with the value one."""
    profile, number = calm[0], 4
    fixed = SETTINGS.model_copy(update={"smoother": SETTINGS.smoother.model_copy(update={"adaptive": False})})
    displacement = 0.01 * displacement_basis(profile.series.time)[:, number]
    smoothed, moved = (
        run_smoother(each, run_filter(each, fixed), fixed) for each in (profile, displaced(profile, displacement))
    )
    found = smoothed_hull_information(profile, smoothed, smoothed.last_pass, still(fixed, 0.01))
    rows = slice(None, None, SETTINGS.steps_per_record)
    change = (moved.states - smoothed.states)[rows]
    change[:, 5] -= displacement[rows]
    # The estimate for the displaced record moves back by the sensitivity.
    back = -found.record.sensitivity.states[:, :, number]
    steady = ~profile.vibrating[rows]
    for state in (5, 6, 8):
        assert np.std((change - back)[steady, state]) < 0.1 * np.std(change[steady, state])


def test_without_motion_nothing_changes(smoothed_calm):
    profile, smoothed = smoothed_calm
    found = smoothed_hull_information(profile, smoothed, smoothed.last_pass, SETTINGS)
    assert found.record is None
    assert found.vertical_motion == 0.0


@pytest.fixture(scope="module")
def dives_in_moving_water():
    return [flown("calm", MOVING, seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def slow_dives_in_moving_water():
    return [flown("calm", MOVING, seed, hull=SLOW) for seed in (1, 2, 3)]


def test_slow_records_do_not_decide_between_motion_and_forces(dives_in_moving_water, slow_dives_in_moving_water):
    """Their evidence is not used: wherever the depth rate varies, motion and forces are both among the unknowns."""
    (fast, _), (slow, _) = dives_in_moving_water[0], slow_dives_in_moving_water[0]
    assert motion_prior(fast).log_odds < np.inf
    assert motion_prior(slow).log_odds == np.inf
    for profile, _ in slow_dives_in_moving_water:
        _, hull = smooth_profile(profile, run_filter(profile, SETTINGS), SETTINGS)
        assert hull.information.vertical_motion == motion_deviation(profile) > 0.0


@pytest.mark.parametrize(("dives", "most"), [("dives_in_moving_water", 0.9), ("slow_dives_in_moving_water", 0.95)])
def test_intervals_of_the_speed_hold_in_water_that_moves_vertically(dives, most, request):
    inside, squares = {"auto": [], "still": []}, {"auto": [], "still": []}
    for profile, truth in request.getfixturevalue(dives):
        filtered = run_filter(profile, SETTINGS)
        for way, settings in {"auto": SETTINGS, "still": still()}.items():
            estimate, _ = smooth_profile(profile, filtered, settings)
            rows = slice(None, None, SETTINGS.steps_per_record)
            time, steady = profile.series.time[rows], ~profile.vibrating[rows]
            error = (estimate.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6]))[steady]
            inside[way].append(np.mean(np.abs(error) <= estimate.states_std[steady, 6]))
            squares[way].append(np.mean(error**2))
    assert np.mean(inside["still"]) < 0.55
    assert 0.55 < np.mean(inside["auto"]) < most
    assert np.sqrt(np.mean(squares["auto"])) < 0.85 * np.sqrt(np.mean(squares["still"]))


def test_smoothed_depth_is_that_of_the_glider(dives_in_moving_water):
    profile, _ = dives_in_moving_water[0]
    estimate, hull = smooth_profile(profile, run_filter(profile, SETTINGS), SETTINGS)
    measured = profile.series.measurements[:: SETTINGS.steps_per_record, 3]
    assert hull.information.vertical_motion > 0.0
    assert np.abs(estimate.states[:, 5] - measured).max() < 0.5


def test_motion_does_not_pass_for_a_hull_with_little_drag(dives_in_moving_water):
    errors = {"auto": [], "still": []}
    for profile, _ in dives_in_moving_water:
        smoothed = run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS)
        for way, settings in {"auto": SETTINGS, "still": still()}.items():
            found = smoothed_hull_information(profile, smoothed, smoothed.last_pass, settings)
            posterior = np.linalg.inv(np.eye(len(found.score)) + found.information)
            drag = found.names.index("viscous.K_D0")
            errors[way].append((posterior @ found.score)[drag] / np.sqrt(posterior[drag, drag]))
    assert abs(np.mean(errors["auto"])) < max(0.7 * abs(np.mean(errors["still"])), 1.0)


def test_profile_states_the_motion_that_its_estimate_allows_for(dives_in_moving_water, calm):
    moving, _ = dives_in_moving_water[0]
    (line,) = [each for each in remarks(HULL, estimate_profile(moving, SETTINGS, with_hull=True)) if "vertical" in each]
    assert "cm/s (RMS)" in line
    assert not any("vertical" in each for each in remarks(HULL, estimate_profile(calm[0], SETTINGS, with_hull=True)))


def test_with_sample_errors_adds_parameters_after_all_others(smoothed_calm):
    from gliderhpc.estimation.smoother.forcing import hull_forcing
    from gliderhpc.flight.hull_parameters import hull_parameters

    profile, smoothed = smoothed_calm
    forcing = hull_forcing(
        profile, smoothed.last_pass.problem, SETTINGS.records, hull_parameters(HULL), smoothed.states[:, [0, 1, 2, 5]]
    )
    fed, channels, reading = forcing.samples.shape
    slopes = np.arange(fed * channels * 2, dtype=float).reshape(fed, channels, 2)
    found = with_sample_errors(forcing, slopes)
    np.testing.assert_array_equal(found.samples[..., reading:], slopes)
    np.testing.assert_array_equal(found.samples[..., :reading], forcing.samples)
    np.testing.assert_array_equal(found.reading[reading:], len(forcing.start) + np.arange(2))
    assert not found.start[len(forcing.start) :].any()
