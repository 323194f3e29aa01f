"""What the comparison of estimators is made of: scores, summaries, targets and advice."""

from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.estimation.settings import EstimationSettings, default_prior
from gliderhpc.platform import read_platform
from gliderhpc.twins.estimators.advice import Purpose, recommend, recommendation_sentence, tally_sentence
from gliderhpc.twins.estimators.arms import ARMS, SMOOTHER, Answer, Bench
from gliderhpc.twins.estimators.cases import EstimatorsSize, prior_case, usual_cases
from gliderhpc.twins.estimators.page import verdict_line
from gliderhpc.twins.estimators.scoring import answer_scores, estimator_rows, in_events
from gliderhpc.twins.estimators.summary import paired, summarise
from gliderhpc.twins.estimators.targets import Target, targets
from gliderhpc.twins.inversion import TwinCase, invert_twin
from gliderhpc.twins.smoothing import INTERVALS, coverage, mahalanobis
from gliderhpc.twins.worlds import drawn_from, with_impulses, world
from gliderhpc.vocabulary import CHANNELS

HULL = read_platform("petrel-l")
SIZE = EstimatorsSize(depth=40.0, intervals=(4.0,), seeds=1, case_seeds=1)
PURPOSE = Purpose("something", "impulsive", "rmse_B_cr", "N m")
ONES = np.ones(6)


def row(arm, seed, kind="impulsive", **scores):
    """A row with every score at one."""
    names = (
        *(f"{score}_{name}" for name in CHANNELS for score in ("rmse", "truth", "bias_dive", "bias_climb")),
        "converged",
    )  # fmt: skip
    return {"kind": kind, "arm": arm, "seed": seed, "outcome": "CONVERGED", **dict.fromkeys(names, 1.0), **scores}


def rows_of(values, score="rmse_B_cr"):
    """Rows of the impulsive twins; `values` gives a score a twin, by estimator."""
    others = {arm.name: [9.0] * 4 for arm in ARMS} | values
    return [row(arm, seed, **{score: value}) for arm, scores in others.items() for seed, value in enumerate(scores)]


# Scores


@pytest.mark.parametrize(("label", "share"), [("68", 0.68), ("95", 0.95)])
def test_intervals_hold_what_their_name_says(label, share):
    error = np.random.default_rng(1).standard_normal(200_000)
    assert coverage(3.0 * error, np.full(error.shape, 3.0), INTERVALS[label]) == pytest.approx(share, abs=0.005)
    assert np.isnan(coverage(error[:0], error[:0], INTERVALS[label]))


def test_a_length_in_standard_deviations():
    assert mahalanobis(np.array([3.0, 8.0]), np.diag([9.0, 16.0])) == pytest.approx(np.sqrt(5.0))


def test_drawn_from_the_prior_means_nothing_else():
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


def answer_with(twin, error, deviation):
    """Answer off by a constant in every channel, and as sure as is said."""
    moved = twin.states[-1, 3:5] - twin.states[0, 3:5] + np.array([3.0, 4.0])
    return Answer(
        twin.truth + error, moved, 1.0, deviations=np.full_like(twin.truth, deviation),
        displacement_covariance=25.0 * np.eye(2),
    )  # fmt: skip


@pytest.mark.compiled
def test_a_constant_error_is_bias_and_nothing_else(twin):
    scores = answer_scores(twin, answer_with(twin, 0.5, 0.4), 2.0 * ONES)
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
def test_no_interval_no_coverage(twin):
    scores = answer_scores(twin, replace(answer_with(twin, 0.5, 0.4), deviations=None), ONES)
    assert not any(name.startswith(("coverage", "width")) for name in scores)


@pytest.mark.compiled
def test_inside_and_outside_the_events(twin):
    inside = in_events(twin)
    error = np.where(inside, 1.0, 0.1)[:, None] * np.ones(6)
    scores = answer_scores(twin, answer_with(twin, error, 0.1), ONES)
    assert 0.0 < inside.mean() < 0.9
    assert scores["rmse_inside"] == pytest.approx(1.0)
    assert scores["rmse_outside"] == pytest.approx(0.1)
    assert (scores["coverage_95_inside"], scores["coverage_95_outside"]) == (0.0, 1.0)


# Cases


def test_every_kind_of_twin_differs_from_the_calm_one_in_its_own_way():
    cases = usual_cases(HULL, SIZE, 3)
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


@pytest.mark.compiled
def test_a_refused_record_is_a_row_a_piece_that_says_why():
    case = usual_cases(HULL, SIZE, 1)["calm"]
    refused = estimator_rows(replace(case, changes=replace(case.changes, dropout=1.0)))
    assert [one["arm"] for one in refused] == [arm.name for arm in ARMS]
    assert all("never measured together" in one["refused"] for one in refused)


@pytest.mark.compiled
def test_a_twin_is_inverted_once_for_all_that_start_from_the_filter():
    bench = Bench(usual_cases(HULL, SIZE, 1)["calm"])
    assert bench.usual is bench.usual
    assert SMOOTHER.answer(bench).disturbances.shape == bench.usual.truth.shape


# Summary, targets, advice


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


def test_only_twins_that_all_answered_are_paired():
    found = rows_of({"smoother": [1.0, 2.0, 3.0, 4.0]})
    del found[-1]["rmse_B_cr"]
    assert len(paired(found, "impulsive", "rmse_B_cr")) == 3


def test_the_best_is_named_with_those_not_told_apart():
    found = recommend(rows_of({"smoother": [1.0, 1.0, 1.0, 1.0], "adjoint": [0.9, 0.9, 3.0, 3.0]}), PURPOSE)
    assert found["best"] == "smoother"
    assert found["as_good"] == ["adjoint"]
    sentence = recommendation_sentence(found)
    assert sentence.startswith(
        "For something: smoother (1.00 N m; not told apart from it: adjoint from prior 1.95; then"
    )
    assert tally_sentence([found]).split(": ")[1].startswith("smoother for 1, adjoint from prior for 1, filter for 0")


def test_a_hair_s_breadth_decides_nothing():
    found = recommend(rows_of({"smoother": [1.0] * 4, "adjoint": [1.04] * 4, "paper": [1.06] * 4}), PURPOSE)
    assert found["as_good"] == ["adjoint"]


def test_no_advice_without_a_twin():
    found = recommend([], PURPOSE)
    assert found["best"] is None
    assert "no twin" in recommendation_sentence(found)


def test_targets_are_met_or_not():
    found = rows_of({"smoother": [1.0] * 4, "paper": [1.9] * 4, "adjoint": [2.0] * 4})
    by_name = {target.quantity: target for target in targets(found, summarise(found)) if target.kind == "impulsive"}
    missed, met = (
        by_name["B_cr RMSE over that of adjoint, preset paper"],
        by_name["B_cr RMSE over that of adjoint from prior"],
    )
    assert missed.value == pytest.approx(1.0 / 1.9)
    assert not missed.met
    assert "so in 0 of 4 twins" in missed.remark
    assert met.met
    assert "so in 4 of 4 twins" in met.remark
    line = verdict_line([{"kind": target.kind, "met": target.met} for target in by_name.values()])
    assert "of 9 on the twins *impulsive*" in line


def test_a_channel_without_truth_is_told():
    found = [row(arm.name, 1, truth_B_cr=0.0) for arm in ARMS]
    names = [target.quantity for target in targets(found, summarise(found))]
    assert "B_cr RMSE over that of adjoint from prior (truth zero)" in names


def test_only_channels_with_signal_are_asked_for_coverage():
    widths = {f"width_{name}": 2.0 for name in CHANNELS} | {"width_B_cr": 0.5}
    shares = {f"coverage_{label}_{name}": 0.7 for name in CHANNELS for label in INTERVALS}
    found = [row("smoother", 1, kind="drawn from the prior", **widths, **shares)]
    asked = {target.quantity: target for target in targets(found, summarise(found)) if "coverage" in target.quantity}
    assert [name.split()[0] for name in asked] == ["B_cr", "B_cr"]
    assert asked["B_cr coverage of 68 % intervals"].met
    assert not asked["B_cr coverage of 95 % intervals"].met


def test_no_figure_is_not_met():
    assert not Target("calm", "x", float("nan"), 0.0, 1.0, "").met
