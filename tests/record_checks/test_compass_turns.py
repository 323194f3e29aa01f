"""Compass errors from turns: selected stretches, and their information compared with leave-one-out least squares."""

import numpy as np
import pytest
import scipy
from support.missions import glide_series, replaced

from gliderhpc.estimation.resample import harmonics
from gliderhpc.platform import read_platform
from gliderhpc.record_checks.turns import (
    TurnStretches,
    _hartlap_factor,
    _slopes,
    _without_prior,
    turn_information,
    turn_stretches,
)

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
    ("changes", "excluded"),
    [({"moved": 205}, [(203, 209)]), ({"weightless": ((200, 210), (400, 500))}, [(200, 210), (400, 500)])],
    ids=["battery moves", "no weight"],
)
def test_turn_stretches_exclude_vibration_and_samples_without_weight(changes, excluded):
    begin = turn_stretches(PETREL, turning(**changes)).heading / 0.01 - 10.0
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
def test_errors_of_the_turn_estimate_agree_with_its_covariance(profiles):
    """Over 60 draws, squared error over stated variance, for four harmonics together: one each, within a half."""
    distances = []
    for seed in range(60):
        found = turn_information(banked_turns(DEVIATION, 1e-3, profiles=profiles, seed=seed), np.radians(20.0))
        error = np.linalg.solve(found.information[1:, 1:], found.vector[1:]) - DEVIATION
        distances.append(error @ found.information[1:, 1:] @ error / 4.0)
    assert 2.0 / 3.0 < np.mean(distances) < 1.5


def test_only_turning_stretches_are_counted():
    parts = banked_turns(np.zeros(4), 1e-6)
    fast = sum(int(np.sum(np.abs(part.rate) > np.radians(0.3))) for part in parts)
    assert 40 < fast < 320
    assert turn_information(parts, np.radians(20.0)).count == fast


def test_turns_of_too_few_profiles_say_nothing():
    assert turn_information([], np.radians(20.0)).count == 0
    assert turn_information(banked_turns(DEVIATION, 1e-6, profiles=7), np.radians(20.0)).count == 0
    assert turn_information(banked_turns(DEVIATION, 1e-6, profiles=8), np.radians(20.0)).count > 0


def test_the_prior_of_the_compass_is_not_counted_as_information_of_the_turns():
    """A belief that is a tenth as good as the turns draws the estimate towards zero, and is taken out again."""
    parts = banked_turns(DEVIATION, 1e-3, profiles=24)
    wide, narrow = (turn_information(parts, np.radians(size)) for size in (20.0, 1.0))
    estimates = [np.linalg.solve(found.information[1:, 1:], found.vector[1:]) for found in (wide, narrow)]
    np.testing.assert_allclose(estimates[1], estimates[0], atol=np.radians(0.15))


@pytest.mark.parametrize("profiles", [14, 30])
def test_the_inverse_of_a_covariance_by_few_profiles_is_information_in_part(profiles):
    """Hartlap (2007): the mean of many such inverses, each times its part, is the inverse of the truth."""
    draws = np.random.default_rng(7).standard_normal((20000, profiles, 4))
    apart = draws - draws.mean(axis=1, keepdims=True)
    inverses = np.linalg.inv(np.swapaxes(apart, 1, 2) @ apart / (profiles - 1))
    np.testing.assert_allclose(_hartlap_factor(profiles) * inverses.mean(axis=0), np.eye(4), atol=0.02)


def test_the_prior_is_subtracted_in_directions_that_the_turns_determine():
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(4, 4)))[0]
    known, plausible = np.array([900.0, 400.0, 9.0, 1.0]), 0.5
    found = _without_prior(np.linalg.inv(turned * known @ turned.T), plausible)
    np.testing.assert_allclose(found, turned * np.array([896.0, 396.0, 5.0, 0.0]) @ turned.T, atol=1e-9)


@pytest.mark.parametrize(("turning", "enough"), [(39, False), (40, True)])
def test_forty_stretches_must_turn(turning, enough):
    """Of 320 stretches, the given number turn at a hundred times the threshold rate, the rest at a tenth of it."""
    parts, place = banked_turns(DEVIATION, 0.0), np.arange(320)
    signs, limit = np.where(place % 2, 1.0, -1.0), np.radians(0.3)
    size = np.where(place < turning, 100.0 * limit, 0.1 * limit)
    rates = np.split(signs * size, len(parts))
    parts = [
        replaced(part, rate=rate, roll=np.where(part.climbing, -10.0, 12.5) * rate, rudder=0.0 * rate)
        for part, rate in zip(parts, rates, strict=True)
    ]
    found = turn_information(parts, np.radians(20.0))
    assert found.count == (turning if enough else 0)
    assert found.information.any() == found.vector.any() == enough


@pytest.mark.parametrize(("unexplained", "enough"), [(0.17, True), (0.23, False)])
def test_roll_and_rudder_must_explain_four_fifths_of_the_turning(unexplained, enough):
    parts = banked_turns(np.zeros(4), 0.0, profiles=24)
    explained = np.var(np.concatenate([part.rate for part in parts]))
    noise = np.sqrt(explained * unexplained / (1.0 - unexplained))
    noisy = banked_turns(np.zeros(4), noise, profiles=24)
    assert bool(turn_information(noisy, np.radians(20.0)).count) is enough


PER_STRETCH = ("profile", "heading", "roll", "rudder", "rate", "climbing")


@pytest.mark.parametrize("climbing", [False, True], ids=["dives", "climbs"])
def test_turns_of_dives_or_of_climbs_alone_are_enough(climbing):
    parts = [
        replaced(part, **{name: getattr(part, name)[part.climbing == climbing] for name in PER_STRETCH})
        for part in banked_turns(DEVIATION, 1e-6)
    ]
    found = turn_information(parts, np.radians(20.0))
    np.testing.assert_allclose(np.linalg.solve(found.information[1:, 1:], found.vector[1:]), DEVIATION, atol=5e-4)


def test_a_stretch_that_water_turned_does_not_count():
    """One in forty is off by ten times its noise; the biweight leaves it out."""
    parts = banked_turns(DEVIATION, 1e-5, profiles=12)
    for part in parts:
        part.rate[5] += 1e-4
    found = turn_information(parts, np.radians(20.0))
    clean = turn_information(banked_turns(DEVIATION, 1e-5, profiles=12), np.radians(20.0))
    estimates = [np.linalg.solve(one.information[1:, 1:], one.vector[1:]) for one in (found, clean)]
    np.testing.assert_allclose(*estimates, atol=2e-5)


def turns_by_profiles(parts, plausible):
    """Errors of the compass and their jackknife by ordinary least squares over all stretches, one profile left out."""
    profiles = len(parts)

    def estimate(chosen):
        heading, roll, rudder, rate = (
            np.concatenate([getattr(part, name) for part in chosen]) for name in ("heading", "roll", "rudder", "rate")
        )
        climbing = np.concatenate([part.climbing for part in chosen])
        columns = np.column_stack([np.ones(len(roll)), roll, rudder])
        line = np.hstack([columns * climbing[:, None], columns * ~climbing[:, None]])

        def residual(unknown):
            misfit = rate - (line @ unknown[:6]) * (1.0 + _slopes(heading) @ unknown[6:])
            return np.append(misfit / 1e-3, unknown[6:] / plausible)

        return scipy.optimize.least_squares(residual, np.zeros(10), x_scale=0.01).x[6:]

    without = np.array([estimate([*parts[:i], *parts[i + 1 :]]) for i in range(profiles)])
    apart = without - without.mean(axis=0)
    return estimate(parts), (profiles - 1) / profiles * apart.T @ apart


def test_information_of_turns_is_the_jackknife_s():
    """Estimates with each profile left out, by another minimiser and without weights; then Hartlap's part."""
    parts = banked_turns(DEVIATION, 1e-3, profiles=20, seed=2)
    estimate, covariance = turns_by_profiles(parts, np.radians(20.0))
    found = turn_information(parts, np.radians(20.0))
    expected = (20 - 6) / 19 * (np.linalg.inv(covariance) - np.eye(4) * np.radians(20.0) ** -2.0)
    ratio = np.linalg.eigvals(np.linalg.solve(expected, found.information[1:, 1:])).real
    assert 0.6 < ratio.min() <= ratio.max() < 1.6
    np.testing.assert_allclose(
        np.linalg.solve(found.information[1:, 1:], found.vector[1:]), estimate, atol=np.radians(0.15)
    )
