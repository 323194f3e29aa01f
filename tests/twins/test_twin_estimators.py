"""Parts of the comparison of estimators: scores, summaries and advice."""

from dataclasses import replace

import numpy as np
import pytest
from support.estimator_rows import row, rows_of

from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import read_platform
from gliderhpc.twins.cases import TwinCase, drawn_from, with_impulses, world
from gliderhpc.twins.estimators.experiment import Purpose, describe_recommendation, describe_tally, recommend
from gliderhpc.twins.estimators.methods import ESTIMATORS, SMOOTHER, EstimatorResult, TwinCache
from gliderhpc.twins.estimators.runs import (
    EstimatorsSize,
    estimator_rows,
    in_events,
    paired,
    prior_case,
    result_scores,
    standard_cases,
    summarise,
)
from gliderhpc.twins.inversion import invert_twin
from gliderhpc.twins.scoring import INTERVALS, coverage, mahalanobis
from gliderhpc.vocabulary import CHANNELS

HULL = read_platform("petrel-l")
SIZE = EstimatorsSize(depth=40.0, intervals=(4.0,), seeds=1, case_seeds=1)
PURPOSE = Purpose("something", "impulsive", "rmse_B_cr", "N m")
ONES = np.ones(6)


# Scores


@pytest.mark.parametrize(("label", "share"), [("68", 0.68), ("95", 0.95)])
def test_coverage_of_normal_errors_is_the_nominal_one(label, share):
    error = np.random.default_rng(1).standard_normal(200_000)
    assert coverage(3.0 * error, np.full(error.shape, 3.0), INTERVALS[label]) == pytest.approx(share, abs=0.005)
    assert np.isnan(coverage(error[:0], error[:0], INTERVALS[label]))


def test_a_length_in_standard_deviations():
    assert mahalanobis(np.array([3.0, 8.0]), np.diag([9.0, 16.0])) == pytest.approx(np.sqrt(5.0))


def test_twins_drawn_from_the_prior_have_no_other_disturbance():
    prior = default_prior(HULL)
    drawn = drawn_from(prior)
    assert drawn.gauss_markov.deviation == prior.deviation
    assert drawn.gauss_markov.correlation_time == prior.correlation_time
    assert drawn.impulse_interval is None
    assert not any(drawn.slow_rms)


@pytest.fixture(scope="module")
def twin():
    case = TwinCase(HULL, with_impulses(world(60.0), 1.5, 2.0, 60.0), 5, EstimationSettings())
    return invert_twin(case)


def result_with(twin, error, deviation):
    """Estimate with a constant error in every channel and a given standard deviation."""
    moved = twin.states[-1, 3:5] - twin.states[0, 3:5] + np.array([3.0, 4.0])
    return EstimatorResult(
        twin.truth + error, moved, 1.0, deviations=np.full_like(twin.truth, deviation),
        displacement_covariance=25.0 * np.eye(2),
    )  # fmt: skip


@pytest.mark.compiled
def test_a_constant_error_is_bias_and_nothing_else(twin):
    scores = result_scores(twin, result_with(twin, 0.5, 0.4), 2.0 * ONES)
    for name in CHANNELS:
        assert scores[f"rmse_{name}"] == pytest.approx(0.5)
        assert scores[f"bias_{name}"] == pytest.approx(0.5)
        assert scores[f"width_{name}"] == pytest.approx(0.4)
        assert (scores[f"coverage_68_{name}"], scores[f"coverage_95_{name}"]) == (0.0, 1.0)
    assert scores["overall"] == pytest.approx(0.25)
    assert scores["displacement_error"] == pytest.approx(5.0)
    assert scores["displacement_deviations"] == pytest.approx(1.0)
    assert scores["impulses"] >= 3
    assert scores["impulse_gain"] == pytest.approx(1.0, abs=0.01)
    assert scores["impulse_delay_size"] < 0.1


@pytest.mark.compiled
def test_estimates_without_deviations_have_no_coverage(twin):
    scores = result_scores(twin, replace(result_with(twin, 0.5, 0.4), deviations=None), ONES)
    assert not any(name.startswith(("coverage", "width")) for name in scores)


@pytest.mark.compiled
def test_scores_are_separate_inside_and_outside_the_events(twin):
    inside = in_events(twin)
    error = np.where(inside, 1.0, 0.1)[:, None] * np.ones(6)
    scores = result_scores(twin, result_with(twin, error, 0.1), ONES)
    assert 0.0 < inside.mean() < 0.9
    assert scores["rmse_inside"] == pytest.approx(1.0)
    assert scores["rmse_outside"] == pytest.approx(0.1)
    assert (scores["coverage_95_inside"], scores["coverage_95_outside"]) == (0.0, 1.0)


# Cases


def test_every_kind_of_twin_differs_from_the_calm_one_in_its_own_way():
    cases = standard_cases(HULL, SIZE, 3)
    calm, impulsive, harsh = cases["calm"], cases["impulsive"], cases["harsh"]
    assert calm.scenario.disturbances.impulse_interval is None
    assert impulsive.scenario.disturbances.impulse_interval is not None
    assert harsh.scenario.gusts.kind != "none"
    assert cases["calm, 4 s"].changes.sample_interval == 4.0
    assert cases["calm, 4 s"].assumed.sensors.sample_interval == 4.0
    wrong = cases["coefficients within 15%"]
    assert wrong.scenario == impulsive.scenario
    assert wrong.hull == HULL
    assert wrong.assumed.viscous != HULL.viscous
    assert prior_case(HULL, 40.0, 3).scenario.sensors.attitude == "white"
    assert [name for name, case in cases.items() if not case.assumes_true_hull] == ["harsh", "coefficients within 15%"]


@pytest.mark.compiled
def test_intervals_include_the_errors_of_a_hull_that_is_not_the_true_one():
    case = standard_cases(HULL, SIZE, 1)["coefficients within 15%"]
    found = SMOOTHER.estimate(TwinCache(case))
    believed = SMOOTHER.estimate(TwinCache(replace(case, hull=case.assumed, assumed=None)))
    surge, pitch = (np.median(found.deviations[:, i]) / np.median(believed.deviations[:, i]) for i in (0, 4))
    assert surge > 3.0
    assert pitch > 3.0
    assert np.trace(found.displacement_covariance) > 2.0 * np.trace(believed.displacement_covariance)


@pytest.mark.compiled
def test_a_refused_record_gives_one_row_per_estimator_with_the_reason():
    case = standard_cases(HULL, SIZE, 1)["calm"]
    refused = estimator_rows(replace(case, changes=replace(case.changes, dropout=1.0)))
    assert [one["arm"] for one in refused] == [estimator.name for estimator in ESTIMATORS]
    assert all("never measured together" in one["refused"] for one in refused)


@pytest.mark.compiled
def test_a_twin_is_inverted_once_for_all_that_start_from_the_filter():
    twin = TwinCache(standard_cases(HULL, SIZE, 1)["calm"])
    assert twin.usual is twin.usual
    assert SMOOTHER.estimate(twin).disturbances.shape == twin.usual.truth.shape


# Summary, advice


def test_offsets_are_of_dives_and_climbs_alike():
    found = [row("smoother", seed, bias_dive_B_cu=0.3, bias_climb_B_cu=-0.4) for seed in (1, 2)]
    (line,) = summarise(found)
    assert line["offset_B_cu"] == pytest.approx(np.sqrt(0.125))
    assert line["outcomes"] == {"CONVERGED": 2}
    assert (line["twins"], line["refused"]) == (2, 0)


def test_coverage_is_averaged_and_errors_are_medians():
    found = [row("smoother", i, coverage_68_B_cr=c, rmse_B_cr=c) for i, c in enumerate((0.0, 0.1, 0.8))]
    (line,) = summarise(found)
    assert line["coverage_68_B_cr"] == pytest.approx(0.3)
    assert line["rmse_B_cr"] == pytest.approx(0.1)


def test_only_twins_with_every_estimate_are_paired():
    found = rows_of({"smoother": [1.0, 2.0, 3.0, 4.0]})
    del found[-1]["rmse_B_cr"]
    assert len(paired(found, "impulsive", "rmse_B_cr")) == 3


def test_the_best_is_named_with_those_not_distinguishable():
    found = recommend(rows_of({"smoother": [1.0, 1.0, 1.0, 1.0], "adjoint": [0.9, 0.9, 3.0, 3.0]}), PURPOSE)
    assert found["best"] == "smoother"
    assert found["as_good"] == ["adjoint"]
    sentence = describe_recommendation(found)
    assert sentence.startswith("For something: smoother (1.00 N m; not distinguishable: adjoint from prior 1.95; then")
    assert describe_tally([found]).split(": ")[1].startswith("smoother for 1, adjoint from prior for 1, filter for 0")


def test_estimators_within_five_percent_are_recommended_alike():
    found = recommend(rows_of({"smoother": [1.0] * 4, "adjoint": [1.04] * 4, "paper": [1.06] * 4}), PURPOSE)
    assert found["as_good"] == ["adjoint"]


def test_without_twins_no_estimator_is_recommended():
    found = recommend([], PURPOSE)
    assert found["best"] is None
    assert "no twin" in describe_recommendation(found)
