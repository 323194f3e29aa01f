"""Compass errors from the currents of legs (restricted likelihood), compared with dense algebra."""

import re

import numpy as np
import pytest
import scipy

from gliderhpc.estimation.resample import harmonics
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.record_checks import CheckSettings, CheckVerdict
from gliderhpc.record_checks.compass import (
    CONSTANT,
    DEVIATION,
    MODELS,
    Leg,
    LegSystem,
    compass_findings,
)
from gliderhpc.record_checks.turns import TurnInformation

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
    """Harville (1974): equal up to terms that do not depend on the covariance."""
    drawn = legs(3, np.random.default_rng(1).uniform(0.0, 360.0, 14))
    system = LegSystem(drawn, NO_TURNS, CHECKS)
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
    system, count = LegSystem(drawn, turns, CHECKS), directions.shape[1]
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
    fit = LegSystem(drawn, NO_TURNS, CHECKS).fitted(MODELS[0])
    values, covariance = dense_fit(drawn, NO_TURNS, 5, 1e5, 0.0)
    np.testing.assert_allclose(fit.values, values, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-6, atol=1e-12)


def test_wald_s_statistic_of_the_harmonics():
    drawn = legs(9, np.arange(0.0, 720.0, 24.0), (0.0, 8.0, 0.0, 0.0, 0.0))
    system = LegSystem(drawn, NO_TURNS, CHECKS)
    for directions, rank in zip(MODELS, (4, 2, 0), strict=True):
        fit = system.fitted(directions)
        inner, seen = fit.covariance[1 : rank + 1, 1 : rank + 1], fit.values[1 : rank + 1]
        statistic, found = fit.test(np.arange(1, 5))
        assert found == rank
        assert statistic == pytest.approx(seen @ np.linalg.solve(inner, seen) if rank else 0.0, rel=1e-6)


# Findings


def test_six_legs_are_needed():
    five, six = (compass_findings(legs(1, np.arange(0.0, 360.0, 360.0 / n)), NO_TURNS, CHECKS) for n in (5, 6))
    for finding in five:
        assert finding.verdict is CheckVerdict.UNDETERMINED
        assert finding.remark == (
            "5 profiles with a fix on either side in which this hull can glide as the records show, but at least 6 are "
            "needed"
        )
    assert not any("fix on either side" in finding.remark for finding in six)
    assert [finding.quantity for finding in five] == [CONSTANT, DEVIATION]


ALL_HEADINGS = np.arange(0.0, 720.0, 24.0)
THREE_HEADINGS = np.resize([0.0, 120.0, 240.0], 30)
OPPOSITE = np.resize([30.0, 210.0], 30)


@pytest.mark.parametrize(
    ("headings", "directions", "basis"),
    [
        (ALL_HEADINGS, MODELS[0], "30 legs; separated from both harmonics"),
        (THREE_HEADINGS, MODELS[1], "30 legs; includes the second harmonic"),
        (OPPOSITE, MODELS[2], "30 legs; includes both harmonics"),
    ],
    ids=["all headings", "three headings", "two opposite"],
)
def test_the_constant_counts_by_student_s_t(headings, directions, basis):
    """Size and error of the fit whose directions the headings separate; legs less directions less one of freedom."""
    drawn = legs(4, headings, (6.0, 0.0, 0.0, 0.0, 0.0))
    fit = LegSystem(drawn, NO_TURNS, CHECKS).fitted(directions)
    found = compass_findings(drawn, NO_TURNS, CHECKS)[0]
    error = np.degrees(np.sqrt(fit.covariance[0, 0]))
    assert found.remark == basis
    assert found.size == pytest.approx(np.degrees(fit.values[0]))
    assert found.error == pytest.approx(error)
    limit = error * scipy.stats.t.isf(0.005, 30 - directions.shape[1] - 1)
    assert found.threshold == pytest.approx(max(limit, CHECKS.least_deviation))
    fine = compass_findings(drawn, NO_TURNS, CheckSettings(least_deviation=0.0))[0]
    assert fine.threshold == pytest.approx(limit)
    assert found.suggestion == f"`records.heading_offset={np.degrees(fit.values[0]):.1f}`"
    coarse = compass_findings(drawn, NO_TURNS, CheckSettings(least_deviation=50.0))
    assert [one.threshold for one in coarse][:1] == [50.0]
    assert coarse[0].verdict is not CheckVerdict.FOUND


def test_suggestions_include_the_corrections_already_made():
    drawn = legs(4, headings=np.arange(0.0, 360.0, 12.0), errors=(6.0, 5.0, 0.0, 4.0, 0.0))
    made = RecordSettings(heading_offset=10.0, heading_deviation=(1.0, -2.0, 0.0, 3.0))
    first, again = ([_numbers(one.suggestion) for one in compass_findings(drawn, NO_TURNS, CHECKS, records)]
                    for records in (None, made))  # fmt: skip
    assert again[0][0] == pytest.approx(first[0][0] + 10.0, abs=0.11)
    np.testing.assert_allclose(np.subtract(again[1], first[1]), made.heading_deviation, atol=0.11)


def _numbers(suggestion):
    return [float(x) for x in re.findall(r"-?\d+\.\d", suggestion.partition("]")[0])]


@pytest.mark.parametrize(
    ("headings", "directions", "rank"), [(ALL_HEADINGS, MODELS[0], 4), (THREE_HEADINGS, MODELS[1], 2)]
)
def test_the_deviation_counts_by_the_f_distribution(headings, directions, rank):
    """Its error is that of the amplitude in the estimated direction: amplitude over the root of Wald's statistic."""
    drawn, checks = legs(4, headings, (0.0, 15.0, -10.0, 0.0, 0.0)), CheckSettings(least_deviation=0.0)
    fit = LegSystem(drawn, NO_TURNS, checks).fitted(directions)
    found = compass_findings(drawn, NO_TURNS, checks)[1]
    amplitude = np.degrees(np.linalg.norm(fit.values[1:]))
    inner, seen = fit.covariance[1 : rank + 1, 1 : rank + 1], fit.values[1 : rank + 1]
    error = amplitude / np.sqrt(seen @ np.linalg.solve(inner, seen))
    assert found.size == pytest.approx(amplitude)
    assert found.error == pytest.approx(error, rel=1e-6)
    quantile = scipy.stats.f.isf(0.01, rank, 30 - directions.shape[1] - 1)
    assert found.threshold == pytest.approx(error * np.sqrt(rank * quantile), rel=1e-6)
    parts = ", ".join(f"{value:.1f}" for value in np.degrees(fit.values[1:]))
    assert f"[{parts}]" in found.suggestion
    assert compass_findings(drawn, NO_TURNS, CheckSettings(least_deviation=60.0))[1].threshold == 60.0


def test_opposite_legs_show_no_deviation():
    found = compass_findings(legs(4, OPPOSITE, (6.0, 0.0, 0.0, 0.0, 0.0)), NO_TURNS, CHECKS)[1]
    assert found.verdict is CheckVerdict.UNDETERMINED
    assert found.remark == "30 legs: too few headings, or currents that differ too much"


def test_currents_too_unlike_each_other_determine_nothing():
    drawn = legs(4, ALL_HEADINGS)
    for leg, extra in zip(drawn, np.random.default_rng(2).normal(0.0, 3.0, (30, 2)), strict=True):
        leg.current[:] += extra
    found = compass_findings(drawn, NO_TURNS, CHECKS)
    assert [one.verdict for one in found] == [CheckVerdict.UNDETERMINED] * 2
    assert {one.remark for one in found} == {"the currents differ too much from profile to profile"}


def test_turns_determine_harmonics_that_opposite_legs_do_not():
    """Two opposite legs and turns on all headings give every error; the remark counts the turns."""
    turns = some_turns()
    drawn = legs(4, OPPOSITE, (6.0, 9.0, -6.0, 3.0, 2.0))
    found = compass_findings(drawn, turns, CHECKS)
    assert found[1].remark == "both harmonics; 30 legs, 60 stretches of turns"
    assert found[0].remark == "30 legs; separated from both harmonics"


def test_a_direction_is_open_when_its_error_is_below_half_of_what_is_plausible():
    drawn = legs(4, THREE_HEADINGS)
    errors = np.degrees(np.sqrt(np.diag(LegSystem(drawn, NO_TURNS, CHECKS).fitted(MODELS[1]).covariance)))[:3]
    for plausible, is_open in ((2.2 * errors.max(), True), (1.6 * errors.max(), False)):
        checks = CheckSettings(plausible_deviation=plausible)
        fit = LegSystem(drawn, NO_TURNS, checks).fitted(MODELS[1])
        largest = np.degrees(np.sqrt(np.diag(fit.covariance)[:3].max()))
        assert bool(largest < 0.5 * plausible) is is_open
        found = compass_findings(drawn, NO_TURNS, checks)[0]
        assert ("includes the second harmonic" in found.remark) is is_open
