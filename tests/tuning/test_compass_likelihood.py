"""A compass's errors by the currents of legs (restricted likelihood) and by turns, against dense algebra."""

import numpy as np
import pytest
import scipy
from support.missions import glide_series, replaced

from gliderhpc.estimation.preparation import harmonics
from gliderhpc.platform import read_platform
from gliderhpc.tuning.record_checks import CheckSettings, CheckVerdict
from gliderhpc.tuning.record_checks.compass import (
    MODELS,
    Leg,
    TurnInformation,
    TurnStretches,
    _slopes,
    _System,
    compass_findings,
    turn_information,
    turn_stretches,
)

CHECKS = CheckSettings()
NO_TURNS = TurnInformation(np.zeros((5, 5)), np.zeros(5), 0)
LIKELIHOODS = [(1e3, 0.0), (1e4, 0.5), (1e5, 3.0), (1e6, 20.0)]
"""Memory of the current (s), and variance of its lasting part over that of its white part."""


def legs(seed, headings, errors=(0.0,) * 5):
    """Legs at some headings (degree) through a current drawn for each, their compass off by errors (5,) (degree)."""
    rng = np.random.default_rng(seed)
    found = []
    for number, heading in enumerate(np.radians(headings)):
        motion = 0.3 * np.array([np.cos(heading), np.sin(heading)])
        by_error = -np.outer([-motion[1], motion[0]], np.append(1.0, harmonics([heading])[0]))
        current = rng.normal(0.0, 0.02, 2) + by_error @ np.radians(errors)
        found.append(Leg(1e4 * number, current, by_error, -motion))
    return found


def restricted_likelihood(legs, memory, ratio):
    """-2 log of the density of the contrasts that neither mean, speed nor errors enter, at the best variance."""
    time = np.array([leg.time for leg in legs])
    current = np.concatenate([[leg.current[axis] for leg in legs] for axis in (0, 1)])
    errors = np.concatenate([[leg.by_error[axis] for leg in legs] for axis in (0, 1)])
    speed = np.concatenate([[leg.by_speed[axis] for leg in legs] for axis in (0, 1)])
    design = np.column_stack([errors, np.kron(np.eye(2), np.ones((len(legs), 1))), speed])
    contrasts = scipy.linalg.null_space(design.T)
    kernel = np.eye(len(legs)) + ratio * np.exp(-np.abs(time[:, None] - time[None, :]) / memory)
    covariance = contrasts.T @ np.kron(np.eye(2), kernel) @ contrasts
    seen = contrasts.T @ current
    variance = seen @ np.linalg.solve(covariance, seen) / len(seen)
    return len(seen) * np.log(variance) + np.linalg.slogdet(covariance)[1]


def test_the_likelihood_is_that_of_the_contrasts():
    """Harville (1974): equal up to what does not depend on the covariance."""
    drawn = legs(3, np.random.default_rng(1).uniform(0.0, 360.0, 14))
    system = _System(drawn, NO_TURNS, CHECKS)
    design = np.column_stack([system._by_error, system._nuisance])
    prior, vector = np.eye(design.shape[1]), np.zeros(design.shape[1])
    ours = [system._posterior(design, prior, vector, memory, ratio)[0] for memory, ratio in LIKELIHOODS]
    dense = [restricted_likelihood(drawn, memory, ratio) for memory, ratio in LIKELIHOODS]
    np.testing.assert_allclose(np.diff(ours), np.diff(dense), rtol=1e-6)


@pytest.mark.parametrize(
    ("headings", "remark"),
    [
        (np.arange(0.0, 720.0, 24.0), "both harmonics; 30 legs, 0 stretches of turns"),
        (
            np.resize([0.0, 120.0, 240.0], 30),
            "first harmonic; the second cannot be separated from it; 30 legs, 0 stretches of turns",
        ),
    ],
    ids=["all headings", "three headings"],
)
def test_a_deviation_names_the_harmonics_that_the_headings_separate(headings, remark):
    finding = compass_findings(legs(2, headings, (0.0, 25.0, -25.0, 0.0, 0.0)), NO_TURNS, CHECKS)[1]
    assert finding.verdict is CheckVerdict.FOUND
    assert finding.remark == remark


def dense_fit(legs, turns, open_errors, memory, ratio):
    """Mean and covariance of the errors that are open, by Bayes' rule on whitened rows."""
    time = np.array([leg.time for leg in legs])
    current = np.concatenate([[leg.current[axis] for leg in legs] for axis in (0, 1)])
    errors = np.concatenate([[leg.by_error[axis, :open_errors] for leg in legs] for axis in (0, 1)])
    speed = np.concatenate([[leg.by_speed[axis] for leg in legs] for axis in (0, 1)])
    kernel = np.eye(len(legs)) + ratio * np.exp(-np.abs(time[:, None] - time[None, :]) / memory)
    design = np.column_stack([errors, np.kron(np.eye(2), np.ones((len(legs), 1))), speed])
    root = np.linalg.inv(np.linalg.cholesky(np.kron(np.eye(2), kernel)))
    left = root @ current - root @ design @ np.linalg.lstsq(root @ design, root @ current, rcond=None)[0]
    variance = left @ left / (len(current) - design.shape[1])
    rows, seen = root @ design / np.sqrt(variance), root @ current / np.sqrt(variance)
    known = np.zeros((open_errors + 1, design.shape[1]))
    known[:open_errors, :open_errors] = np.eye(open_errors) / np.radians(CHECKS.plausible_deviation)
    known[open_errors, -1] = 1.0 / 0.3
    information = rows.T @ rows + known.T @ known
    score = rows.T @ seen
    information[:open_errors, :open_errors] += turns.information[:open_errors, :open_errors]
    score[:open_errors] += turns.vector[:open_errors]
    covariance = np.linalg.inv(information)[:open_errors, :open_errors]
    return (np.linalg.inv(information) @ score)[:open_errors], covariance


def some_turns():
    root = np.random.default_rng(4).normal(0.0, 8.0, (4, 6))
    information = np.zeros((5, 5))
    information[1:, 1:] = root @ root.T
    return TurnInformation(information, information @ np.radians([0.0, 9.0, -6.0, 3.0, 2.0]), 60)


@pytest.mark.parametrize("turns", [NO_TURNS, some_turns()], ids=["no turns", "turns"])
@pytest.mark.parametrize("directions", MODELS, ids=["all", "first harmonic", "constant"])
def test_errors_are_those_of_bayes_rule_at_the_best_current(directions, turns):
    """Legs, turns and plausible sizes in one linear model; memory and ratio those of the greatest likelihood."""
    drawn = legs(5, np.random.default_rng(6).uniform(0.0, 360.0, 12), (3.0, 5.0, -4.0, 0.0, 2.0))
    system, count = _System(drawn, turns, CHECKS), directions.shape[1]
    fit = system.fitted(directions)
    memories, ratios = np.geomspace(3e3, 1e6, 9), [0.0, *np.geomspace(0.1, 100.0, 9)]
    blind = [Leg(leg.time, leg.current, leg.by_error @ directions, leg.by_speed) for leg in drawn]
    found = {(memory, ratio): restricted_likelihood(blind, memory, ratio) for memory in memories for ratio in ratios}
    expected, covariance = dense_fit(drawn, turns, count, *min(found, key=found.__getitem__))
    np.testing.assert_allclose(fit.values[:count], expected, rtol=1e-6)
    np.testing.assert_allclose(fit.covariance[:count, :count], covariance, rtol=1e-6)
    assert not fit.values[count:].any()
    assert not fit.covariance[count:].any()


def test_a_current_that_each_leg_has_alone_is_fitted_without_memory():
    """Currents that alternate have no lasting part; the legs then count alike."""
    drawn = legs(8, np.arange(0.0, 720.0, 24.0))
    for number, leg in enumerate(drawn):
        leg.current[:] = leg.by_error @ np.radians([2.0, 4.0, 0.0, 0.0, 0.0]) + 0.02 * (-1.0) ** number
    fit = _System(drawn, NO_TURNS, CHECKS).fitted(MODELS[0])
    values, covariance = dense_fit(drawn, NO_TURNS, 5, 1e5, 0.0)
    np.testing.assert_allclose(fit.values, values, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-6, atol=1e-12)


def test_wald_s_statistic_of_the_harmonics():
    drawn = legs(9, np.arange(0.0, 720.0, 24.0), (0.0, 8.0, 0.0, 0.0, 0.0))
    system = _System(drawn, NO_TURNS, CHECKS)
    for directions, rank in zip(MODELS, (4, 2, 0), strict=True):
        fit = system.fitted(directions)
        inner, seen = fit.covariance[1 : rank + 1, 1 : rank + 1], fit.values[1 : rank + 1]
        statistic, found = fit.test(np.arange(1, 5))
        assert found == rank
        assert statistic == pytest.approx(seen @ np.linalg.solve(inner, seen) if rank else 0.0, rel=1e-6)


# Turns

PETREL = read_platform("petrel-l")


def turning(interval=1.0, moved=None, weightless=()):
    """Ten minutes, 0.1 s a step, that turn evenly and bank ever more; the battery may move at a time (s)."""
    steps = 6000
    controls = np.tile([0.0, 0.0, PETREL.buoyancy.neutral_volume_m3, 0.0], (steps, 1))
    controls[:, 3] = 0.1 * np.arange(steps) / steps
    series, _ = glide_series(PETREL, np.zeros(12), controls[:1], sample_interval=interval)
    time = 0.1 * np.arange(steps + 1)
    if moved is not None:
        controls[10 * moved : 10 * moved + 20, 0] = np.linspace(0.0, 0.05, 20)
        controls[10 * moved + 20 :, 0] = 0.05
    depth = np.where(time < 300.0, time, 600.0 - time) * 0.1
    weights = np.ones(steps + 1)
    for begin, end in weightless:
        weights[10 * begin : 10 * end] = 0.0
    measurements = np.column_stack([1e-4 * time, 0.0 * time, 0.01 * time, depth])
    rows = np.arange(0, steps + 1, round(10 * interval))
    return replaced(series, time=time, controls=controls, weights=weights, sample_index=rows, measurements=measurements)


def test_stretches_of_an_even_turn():
    """Each takes 20 s, its ends in both averages; dive and climb are distinguished by the depth between the ends."""
    found = turn_stretches(PETREL, turning())
    begin = 20.0 * np.arange(len(found.rate))
    assert len(begin) == 30
    np.testing.assert_allclose(found.rate, 0.01)
    np.testing.assert_allclose(found.heading, 0.01 * (begin + 10.0))
    np.testing.assert_allclose(found.roll, 1e-4 * (begin + 10.0))
    np.testing.assert_allclose(found.rudder, 0.1 * (begin + 9.95) / 600.0)
    np.testing.assert_array_equal(found.climbing, begin >= 300.0)
    np.testing.assert_array_equal(found.profile, 1)


def test_a_stretch_takes_three_samples_at_least():
    found = turn_stretches(PETREL, turning(interval=15.0))
    np.testing.assert_allclose(np.diff(found.heading), 0.45)


@pytest.mark.parametrize(
    ("spoilt", "excluded"),
    [({"moved": 205}, [(203, 209)]), ({"weightless": ((200, 210), (400, 500))}, [(200, 210), (400, 500)])],
    ids=["battery moves", "no weight"],
)
def test_stretches_keep_off_what_shakes_and_what_counts_for_nothing(spoilt, excluded):
    begin = turn_stretches(PETREL, turning(**spoilt)).heading / 0.01 - 10.0
    assert 20 < len(begin) < 30
    for start, end in excluded:
        assert not np.any((begin + 19.0 > start) & (begin + 1.0 < end))


def test_slopes_are_the_harmonics_derivatives():
    heading, move = np.linspace(0.0, 6.0, 13), 1e-5
    by_difference = (harmonics(heading + move) - harmonics(heading - move)) / (2.0 * move)
    np.testing.assert_allclose(_slopes(heading), by_difference, atol=1e-9)


def banked_turns(deviation, noise, profiles=8, seed=0, steady=0.002):
    """Turns that go with roll and rudder, otherwise on dive than on climb, read by a compass with a deviation (rad)."""
    rng, parts = np.random.default_rng(seed), []
    for number in range(profiles):
        heading, roll, rudder = rng.uniform(0.0, 2.0 * np.pi, 40), *rng.normal(0.0, 0.1, (2, 40))
        climbing = np.arange(40) >= 20
        rate = np.where(climbing, -0.1 * roll - steady, 0.08 * roll + steady) + 0.05 * rudder
        rate = rate * (1.0 + _slopes(heading) @ deviation) + rng.normal(0.0, noise, 40)
        parts.append(TurnStretches(np.full(40, number), heading, roll, rudder, rate, climbing))
    return parts


DEVIATION = np.radians([6.0, -4.0, 2.0, 1.0])


def test_turns_without_noise_give_the_deviation_itself():
    found = turn_information(banked_turns(DEVIATION, 1e-6), np.radians(20.0))
    estimate = np.linalg.solve(found.information[1:, 1:], found.vector[1:])
    np.testing.assert_allclose(estimate, DEVIATION, atol=2e-4)
    assert not found.information[0].any()
    assert not found.information[:, 0].any()


@pytest.mark.parametrize("profiles", [10, 24])
def test_turns_err_by_what_they_say(profiles):
    """Over 60 draws the error squared over what is stated, four harmonics together: one each, within a half."""
    distances = []
    for seed in range(60):
        found = turn_information(banked_turns(DEVIATION, 1e-3, profiles=profiles, seed=seed), np.radians(20.0))
        error = np.linalg.solve(found.information[1:, 1:], found.vector[1:]) - DEVIATION
        distances.append(error @ found.information[1:, 1:] @ error / 4.0)
    assert 2.0 / 3.0 < np.mean(distances) < 1.5


def test_the_count_is_of_stretches_that_turn():
    parts = banked_turns(np.zeros(4), 1e-6)
    fast = sum(int(np.sum(np.abs(part.rate) > np.radians(0.3))) for part in parts)
    assert 40 < fast < 320
    assert turn_information(parts, np.radians(20.0)).count == fast


def test_turns_of_too_few_profiles_say_nothing():
    assert turn_information([], np.radians(20.0)).count == 0
    assert turn_information(banked_turns(DEVIATION, 1e-6, profiles=7), np.radians(20.0)).count == 0
    assert turn_information(banked_turns(DEVIATION, 1e-6, profiles=8), np.radians(20.0)).count > 0


def test_what_is_believed_of_compasses_is_no_information_of_the_turns():
    """A belief that is a tenth as good as the turns draws the estimate towards zero, and is taken out again."""
    parts = banked_turns(DEVIATION, 1e-3, profiles=24)
    wide, narrow = (turn_information(parts, np.radians(size)) for size in (20.0, 1.0))
    estimates = [np.linalg.solve(found.information[1:, 1:], found.vector[1:]) for found in (wide, narrow)]
    np.testing.assert_allclose(estimates[1], estimates[0], atol=np.radians(0.15))
