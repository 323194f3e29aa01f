"""Study ``drift``: its statistics compared with independent and known results, and a mission with fouling."""

import shutil

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.stats import kendalltau, theilslopes
from support.archives import put_table_rows, put_whole
from support.missions import BRIEF, estimate, program
from support.shown import check_figure_follows, check_shown_as_left, shown_after

from benchmarks import drift as benchmark
from benchmarks import drift_series
from gliderhpc.archive.mission import describe, open_for_reading, open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import read_platform
from gliderhpc.report.page.content import Remarks
from gliderhpc.report.page.operator_summary import operator_section
from gliderhpc.report.studies.drift import drift_sentences
from gliderhpc.report.studies.drift_tables import comparisons, table_5, table_5_text
from gliderhpc.simulator import simulate_mission
from gliderhpc.simulator.hull import true_hull
from gliderhpc.store_schema import check_archive
from gliderhpc.store_schema.columns import FORWARD_ERROR_COLUMN, median_column
from gliderhpc.store_schema.schema import group_called
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.drift.change_points import find_changes
from gliderhpc.studies.library.drift.change_rows import change_rows, read_changes, stored_changes
from gliderhpc.studies.library.drift.change_search import Size, spikes
from gliderhpc.studies.library.drift.change_text import change_lines, describe_change
from gliderhpc.studies.library.drift.changes import MOMENTS, Change, Changes
from gliderhpc.studies.library.drift.coefficients import (
    OWN,
    SegmentMedians,
    coefficient_slopes,
    drawn_hulls,
    segment_series,
    segments_by_phase,
)
from gliderhpc.studies.library.drift.departures import NOISE_MODELS, OWN_SLOPE, WindowSearch
from gliderhpc.studies.library.drift.drag import CAUSES, combine_errors, find_onset, shared_drag
from gliderhpc.studies.library.drift.medians import (
    MIN_RECORDS,
    PRIMARY,
    UNITS,
    ChangeSettings,
    DriftSettings,
    counted_estimates,
    depth_band,
    medians_of,
)
from gliderhpc.studies.library.drift.series import (
    LATERAL,
    LONGITUDINAL,
    choose_epochs,
    epoch_of_profiles,
    noise_floor,
    series_trend,
)
from gliderhpc.studies.library.drift.verdict import find_drift, verdict_lines
from gliderhpc.studies.library.trends import (
    block_length,
    blocks_of,
    epoch_draws,
    find_trend,
    holm,
    interval,
    kendall_scores,
    mann_kendall,
    moving_blocks,
    robust_test,
    slope_draws,
    theil_sen,
)
from gliderhpc.studies.registry import missing_input
from gliderhpc.studies.request import Request
from gliderhpc.vocabulary import PHASES

HULL = read_platform("petrel-l")
SETTINGS = DriftSettings(resamples=200)
DAYS = np.linspace(2.0, 65.0, 33)
EPOCH = epoch_of_profiles(choose_epochs(range(33), None, 3))


# Statistics


def test_mann_kendall_agrees_with_kendalls_tau():
    values = np.random.default_rng(0).standard_normal(40)
    tau, p = mann_kendall(values)
    other = kendalltau(np.arange(40.0), values, method="asymptotic")
    assert tau == pytest.approx(other.statistic, rel=1e-12)
    # Mann and Kendall's has the correction for continuity that scipy's leaves out.
    assert p == pytest.approx(other.pvalue, rel=0.05)
    assert p > other.pvalue


def test_theil_sen_agrees_with_scipy_and_a_worked_example():
    rng = np.random.default_rng(1)
    time, values = np.sort(rng.uniform(0.0, 60.0, 30)), rng.standard_normal(30)
    assert theil_sen(time, values) == pytest.approx(theilslopes(values, time).slope, rel=1e-12)
    # Gilbert (1987), chapter 16: several values at a time, 24 pairs at different times.
    time = np.array([1.0, 1.0, 1.0, 2.0, 3.0, 3.0, 4.0, 5.0])
    values = np.array([10.0, 22.0, 21.0, 30.0, 22.0, 30.0, 40.0, 40.0])
    assert theil_sen(time, values) == 5.5


def test_scores_of_many_series_are_those_of_each():
    series = np.round(np.random.default_rng(2).standard_normal((4, 12)), 0)
    pairs = 12 * 11 / 2
    np.testing.assert_allclose(kendall_scores(series), [mann_kendall(one)[0] * pairs for one in series], atol=1e-9)


def test_trend_leaves_gaps_out():
    values = 0.02 * DAYS + np.random.default_rng(3).normal(0.0, 0.1, 33)
    holed = values.copy()
    holed[[4, 17]] = np.nan
    known = np.isfinite(holed)
    found = series_trend(DAYS, holed, EPOCH, 300, 0)
    without = series_trend(DAYS[known], values[known], EPOCH[known], 300, 0)
    assert found.trend == without.trend
    assert found.trend.slope == find_trend(DAYS, holed).slope
    assert found.trend.count == 31
    assert found.drift == pytest.approx(found.trend.slope * 63.0)


def test_series_of_ties_and_of_too_few_values_show_nothing():
    level = series_trend(DAYS, np.ones(33), EPOCH, 300, 0)
    assert (level.trend.tau, level.trend.p, level.robust.p) == (0.0, 1.0, 1.0)
    assert not level.is_significant
    few = series_trend(DAYS[:3], np.arange(3.0), EPOCH[:3], 300, 0)
    assert np.isnan(few.trend.slope)
    assert not few.is_significant
    stepped = series_trend(DAYS, np.repeat([0.0, 1.0, 2.0], 11), EPOCH, 300, 0)
    assert stepped.trend.tau == pytest.approx(363.0 / 528.0)
    assert stepped.robust.p < 0.05


def test_holm_on_a_worked_example():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.02, float("nan"), 0.9])[0] == pytest.approx(0.04)


def test_robust_test_keeps_its_level_where_the_plain_one_does_not():
    plain, robust = drift_series.false_rates(33, 0.7, series=200, resamples=200)
    assert robust <= 0.07
    assert plain > 0.25


def test_robust_test_sees_a_plain_trend():
    rng = np.random.default_rng(4)
    time = np.linspace(0.0, 65.0, 66)
    found = robust_test(time, rng.normal(0.0, 0.2, 66) - 0.02 * time, 500, rng)
    assert found.score < 0.0
    assert found.p < 0.05 / 12


def test_blocks_grow_with_the_correlation():
    rng = np.random.default_rng(5)
    time = np.arange(120.0)
    alone, together = (block_length(time, drift_series.autoregressive(120, rho, rng)) for rho in (0.0, 0.7))
    assert alone < together <= 24
    drawn = moving_blocks(time, 5, 50, rng)
    steps = np.diff(drawn, axis=1)
    assert drawn.shape == (50, 120)
    assert (steps == 1.0).mean() > 0.75


def test_intervals_are_of_whole_epochs():
    draws = epoch_draws(np.array([0, 0, 1, 1, 1]), 20, np.random.default_rng(6))
    assert {tuple(np.unique(one)) for one in draws} <= {(0, 1), (2, 3, 4), (0, 1, 2, 3, 4)}
    np.testing.assert_array_equal(blocks_of(np.repeat(np.arange(12), 3), 4), np.repeat(np.arange(6), 6))
    np.testing.assert_array_equal(blocks_of(np.array([0, 0, 0, 1, 1]), 1), np.arange(5))
    slopes = slope_draws(np.array([1.0, 1.0]), np.array([0.0, 1.0]), [np.array([0, 1])])
    assert np.isnan(slopes).all()
    assert np.isnan(interval(slopes)).all()


def test_interval_of_the_slope_covers_it():
    inside = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        values = -0.01 * DAYS + np.repeat(rng.normal(0.0, 0.05, 11), 3) + rng.normal(0.0, 0.05, 33)
        found = series_trend(DAYS, values, EPOCH, 300, seed)
        inside.append(found.trend.low <= -0.01 <= found.trend.high)
    assert np.mean(inside) >= 0.85


# Epochs, band, medians


def test_epochs_are_spread_over_the_mission():
    chosen = choose_epochs(range(1, 566), 11, 3)
    assert len(chosen) == 11
    assert chosen[0] == (1, 2, 3)
    assert chosen[-1] == (563, 564, 565)
    assert choose_epochs([1, 2, 4, 5, 6], 11, 3) == [(1, 2, 4), (5, 6)]
    assert len(choose_epochs(range(40), None, 3)) == 14


def test_noise_floor_is_the_scatter_within_epochs():
    assert noise_floor(np.array([1.0, 3.0, 11.0, 13.0, np.nan]), np.array([0, 0, 1, 1, 1])) == pytest.approx(2.0**0.5)
    assert np.isnan(noise_floor(np.array([1.0, 2.0]), np.array([0, 1])))


def test_band_adapts_to_shallow_missions_and_says_so():
    assert depth_band(np.full(9, 700.0), None).remark == ""
    shallow = depth_band(np.full(9, 100.0), None)
    assert (shallow.low, shallow.high) == pytest.approx((30.0, 95.0))
    assert "instead of 150 to 500 m" in shallow.remark
    assert depth_band(np.full(9, 100.0), (40.0, 60.0)).remark == ""


def test_a_force_against_the_motion_is_a_drag():
    velocity = np.tile([0.3, 0.0, 0.04], (40, 1))
    speed = np.linalg.norm(velocity, axis=1)
    forces = np.zeros((40, 6))
    forces[:, :3] = -1.5 * speed[:, None] * velocity
    assert medians_of(forces, velocity)["K_D0"] == pytest.approx(1.5)


def test_settings_are_checked():
    for assignments in ({"depth_band": "[90, 40]"}, {"coefficients.settling": "500"}, {"epochs": "2"}):
        with pytest.raises(InputError, match=r"^(settings: a depth_band|`coefficients`: a segment|`epochs`: )"):
            build_settings_of(DriftSettings, {}, assignments)
    assert build_settings_of(DriftSettings, {}, {"epochs": "null"}).epochs is None


# What is made of the medians


def medians(drag=0.0, weight=0.0, uneven=0.0, scatter=0.05, seed=0):
    """Table of a mission whose shared drag (kg/m), weight (N) and climb's own drag change to these by its end."""
    rng = np.random.default_rng(seed)
    part = (DAYS - DAYS[0]) / (DAYS[-1] - DAYS[0])
    table = {"profile": np.arange(33), "elapsed_days": DAYS, "epoch": EPOCH}
    for phase, effect in (("dive", -2.5), ("climb", 2.5)):
        table |= {f"weight_effect_{phase}": effect, f"heave_effect_{phase}": 0.3, f"speed_{phase}": 0.4}
        for estimate_name in ("prior", "adjoint", "smoothed"):
            own = (drag + weight * effect + uneven * (phase == "climb")) * part + rng.normal(0.0, scatter, 33)
            for name in (*LONGITUDINAL, *LATERAL):
                table[median_column(name, phase, estimate_name)] = rng.normal(0.0, 0.01, 33)
            table[median_column("B_cu", phase, estimate_name)] = -0.16 * own
            table[median_column("K_D0", phase, estimate_name)] = own
    return pd.DataFrame(table)


@pytest.mark.parametrize(
    ("planted", "cause"),
    [
        ({}, "none"),
        ({"drag": 2.0}, "drag"),
        ({"drag": -2.0}, "less drag"),
        ({"weight": 0.4}, "weight"),
        ({"drag": 2.0, "weight": 0.4}, "drag and more"),
        ({"drag": 1.0, "uneven": 2.0}, "drag and more"),
    ],
)
def test_planted_drag_and_weight_give_the_expected_cause(planted, cause):
    found = find_drift(medians(**planted), HULL, SETTINGS)
    assert found.verdict.cause == cause
    text = " ".join(verdict_lines(found.verdict, found.trends, 0.5))
    assert CAUSES[cause] in text
    # Nothing is dated or extrapolated where no growth is shown.
    rows = [row.quantity for row in comparisons(found.trends, found.verdict, (), None, 0.5)]
    assert any("risen by 50 %" in row for row in rows) == cause.startswith("drag")
    assert any("day from which" in row for row in rows) == cause.startswith("drag")
    assert ("do not prove a cause" in text) == (cause != "none")
    wanted = planted.get("drag", 0.0) + 0.5 * planted.get("uneven", 0.0)
    low, high = found.verdict.interval
    assert low <= wanted <= high
    assert found.verdict.change == pytest.approx(wanted, abs=0.15)
    for drag in found.drags:
        assert drag.phase_difference.drift == pytest.approx(
            planted.get("weight", 0.0) + planted.get("uneven", 0.0) / 5.0, abs=0.06
        )


def test_estimates_that_disagree_are_ambiguous():
    table = medians(drag=2.0)
    for phase in ("dive", "climb"):
        table[median_column("K_D0", phase, "smoothed")] = np.random.default_rng(8).normal(0.0, 0.05, 33)
    verdict = find_drift(table, HULL, SETTINGS).verdict
    assert verdict.cause == "ambiguous"
    assert "do not agree" in verdict.meaning


@pytest.mark.parametrize(("start", "cause"), [("prior", "drag"), ("smoothed", "ambiguous")])
def test_the_filter_counts_where_the_adjoint_is_no_second_estimate(start, cause):
    """Windows that start from the smoothed path agree with it, so that the filter's medians are asked too."""
    table = medians(drag=2.0)
    for phase in ("dive", "climb"):
        table[median_column("K_D0", phase, "prior")] = np.random.default_rng(8).normal(0.0, 0.05, 33)
    assert find_drift(table, HULL, SETTINGS, counted=counted_estimates(start)).verdict.cause == cause


def test_drift_is_confined_to_the_longitudinal_plane():
    found = find_drift(medians(drag=2.0), HULL, SETTINGS)
    adjoint = next(own for own in found.trends if own.estimate == "adjoint")
    assert set(adjoint.drifting) == {("B_cu", "dive"), ("B_cu", "climb")}
    assert adjoint.tier(("B_cu", "climb")) == "primary"
    rows = table_5(found.trends)
    assert len(rows) == 36
    assert "| adjoint | B_cu (N) | dive | 33 | " in table_5_text(rows)


def test_weight_leaves_the_shared_drag_as_it_is():
    dive, climb = np.array([1.0]), np.array([1.0])
    heavy = shared_drag(dive - 2.0 * 0.7, climb + 3.0 * 0.7, (-2.0, 3.0))
    np.testing.assert_allclose(heavy, 1.0)


def test_days_until_the_drag_has_grown():
    drag = find_drift(medians(drag=2.0, scatter=0.01), HULL, SETTINGS).drags[1]
    day, (early, late) = drag.days_until(0.5)
    assert day == pytest.approx(0.5 * HULL.viscous.K_D0 * 63.0 / 2.0, rel=0.03)
    assert early < day < late < np.inf
    never = find_drift(medians(), HULL, SETTINGS).drags[1].days_until(0.5)
    assert never[1][1] == np.inf


def test_interval_adds_what_is_not_resolved():
    assert combine_errors(1.0, (0.9, 1.1), (0.0, 0.0), 0.0) == pytest.approx((0.9, 1.1))
    assert combine_errors(1.0, (1.0, 1.0), (-0.3, 0.2), 0.4) == pytest.approx((0.5, 1.0 + np.hypot(0.2, 0.4)))
    assert combine_errors(0.0, (0.0, 0.0), (-0.3, 0.2), 0.0) == pytest.approx((-0.3, 0.2)), (
        "also of a hull that does not drift"
    )


def test_onset_is_found():
    values = np.maximum(0.0, DAYS - 30.0) + np.random.default_rng(9).normal(0.0, 1.0, 33)
    onset = find_onset(DAYS, values, EPOCH, 300, 0)
    assert onset.low <= 30.0 <= onset.high
    assert not onset.from_the_start
    assert find_onset(DAYS, DAYS, EPOCH, 300, 0).from_the_start
    assert np.isnan(find_onset(DAYS[:2], DAYS[:2], EPOCH[:2], 300, 0).day)


def test_drawn_coefficients_widen_the_interval_and_the_forward_model_check_is_reported():
    table = medians(drag=2.0)
    table[FORWARD_ERROR_COLUMN] = 0.05 + 0.0005 * DAYS
    rng, drag = np.random.default_rng(10), list(UNITS).index("K_D0")
    segments = []
    for number, day in enumerate(DAYS):
        found = np.zeros((len(OWN) + 30, 2, len(UNITS)))
        found[:, :, drag] = (
            2.0 / 63.0 * (day - DAYS[0]) * np.concatenate([[1.0] * 3, np.linspace(0.7, 1.3, 30)])[:, None]
        )
        segments.append(SegmentMedians(number, found + rng.normal(0.0, 1e-3, found.shape), 2))
    drawn, alone = (find_drift(table, HULL, SETTINGS, own) for own in (coefficient_slopes(table, segments), ()))
    wide, narrow = (found.verdict.interval for found in (drawn, alone))
    assert wide[1] - wide[0] > narrow[1] - narrow[0] + 0.1
    own = next(one for one in drawn.slopes if (one.quantity, one.phase) == ("K_D0", "dive"))
    assert own.same_sign == 1.0
    assert own.nominal == pytest.approx(2.0 / 63.0, rel=0.02)
    assert drawn.check is not None
    assert drawn.check.with_day.rho == pytest.approx(1.0)
    assert alone.slopes == []


# Change points

CHANGE_SETTINGS = ChangeSettings(resamples=100)


def changed(length, planted=None, correlation=0.4, seed=0):
    """Drawn medians with a change of K_D0 by phase, and the change points found in them."""
    table = drift_series.drawn_medians(length, correlation, np.random.default_rng(seed), planted)
    return table, find_changes(table, HULL.viscous.K_D0, CHANGE_SETTINGS, 0)


def test_an_episode_of_climbs_that_decays_is_found():
    course = drift_series.planted_course(40, 20, 10, 0.75, remaining=0.3)
    table, changes = changed(40, {"climb": course})
    (one,) = changes.found
    assert (one.kind, one.phases, one.estimates) == ("episode", ("climb",), ("adjoint", "smoothed"))
    assert abs(one.first - 21) <= 1
    assert abs(one.last - 30) <= 1
    assert one.back == one.last + 1
    size = one.size("K_D0", "climb")
    assert size.low <= size.value <= size.high
    assert size.value == pytest.approx(0.75 * HULL.viscous.K_D0, rel=0.2)
    assert one.size("B_cu", "climb").value == pytest.approx(-0.1 * size.value, rel=0.05)
    text = describe_change(one, HULL.viscous.K_D0)
    assert text.startswith(f"an episode: profiles {one.first} to {one.last} (day ")
    assert (
        f"climbs: equivalent drag {100.0 * size.value / HULL.viscous.K_D0:+.0f} % at its maximum (95 % interval "
        in text
    )
    assert f"back to the former level from profile {one.back}, day " in text
    assert "begins abruptly, decays" in text
    assert not changes.outside(table["profile"].to_numpy())[24]


def test_an_episode_that_fades_fast_and_is_gone_at_once_is_one():
    """As on a real Slocum: half of it disappears within three profiles, and the rest remains to the end."""
    course = np.zeros(55)
    course[27:41] = 0.75 * np.array([1, 0.97, 0.87, 0.54, 0.61, 0.5, 0.58, 0.46, 0.44, 0.47, 0.43, 0.36, 0.42, 0.4])
    (one,) = changed(55, {"climb": course}, seed=3)[1].found
    assert (one.kind, one.form, one.phases, one.first, one.last) == ("episode", "decays", ("climb",), 28, 41)
    assert one.size("K_D0", "climb").value == pytest.approx(0.75 * HULL.viscous.K_D0, rel=0.2)


@pytest.mark.long
def test_the_trace_of_a_climb_episode_in_the_dives_is_not_a_second_episode():
    """A third of the change remains with opposite sign some dives later, as in estimates: one episode, on climbs."""
    course = drift_series.planted_course(40, 12, 10, 0.9, remaining=0.3)
    for seed in range(3):
        (one,) = changed(40, {"climb": course, "dive": -0.3 * np.roll(course, 3)}, seed=seed)[1].found
        assert (one.kind, one.phases) == ("episode", ("climb",))
        assert abs(one.first - 13) + abs(one.last - 22) <= 2


def test_a_short_episode_of_dives_is_found():
    _, changes = changed(33, {"dive": drift_series.planted_course(33, 15, 3, 0.4, remaining=1.0)})
    (one,) = changes.found
    assert (one.kind, one.phases, one.first, one.last) == ("episode", ("dive",), 16, 18)


@pytest.mark.xfail(strict=True, reason="two changes of like size mask each other: windows are searched one at a time")
def test_two_episodes_are_found_one_after_the_other():
    course = drift_series.planted_course(45, 10, 5, 0.6, 1.0) + drift_series.planted_course(45, 28, 8, 0.6, 1.0)
    _, changes = changed(45, {"dive": course, "climb": course}, seed=5)
    assert [(one.kind, one.first, one.last) for one in changes.found] == [("episode", 11, 15), ("episode", 29, 36)]


def test_a_change_that_stays_is_no_episode():
    step = np.where(np.arange(40) >= 22, 0.5, 0.0)
    (one,) = changed(40, {"dive": step, "climb": step})[1].found
    assert (one.kind, one.phases, one.first, one.back) == ("step", ("dive", "climb"), 23, None)
    assert "from profile 23 on" in describe_change(one, HULL.viscous.K_D0)


def test_growth_and_single_profiles_are_no_change_points():
    growth = np.linspace(0.0, 0.5, 40)
    assert changed(40, {"dive": growth, "climb": growth})[1].found == ()
    outlier = np.where(np.arange(40) == 17, 1.0, 0.0)
    assert changed(40, {"dive": outlier, "climb": outlier})[1].found == ()
    assert np.flatnonzero(spikes(10.0 * outlier + np.arange(40) % 3)).tolist() == [17]
    few = changed(9)[1]
    assert few.found == ()
    assert change_lines(few, 1.0) == (
        "no step, ramp or episode of drag or axial force is reported: too few profiles, a quick study, or none that is "
        "large enough",
    )


@pytest.mark.long
def test_correlated_missions_show_changes_no_more_often_than_stated():
    assert drift_series.false_changes(33, 0.7, series=12, resamples=100) <= 1 / 12


def test_gaps_are_left_out_of_the_search():
    course = drift_series.planted_course(40, 20, 10, 0.75, remaining=1.0)
    table = drift_series.drawn_medians(40, 0.2, np.random.default_rng(3), {"climb": course})
    table.loc[[3, 24, 25], [name for name in table if "climb" in name]] = np.nan
    (one,) = find_changes(table, HULL.viscous.K_D0, CHANGE_SETTINGS, 0).found
    assert (one.first, one.last) == (21, 30)


def test_search_by_sums_is_generalised_least_squares():
    rng = np.random.default_rng(1)
    days = np.cumsum(rng.uniform(0.5, 1.5, 20))
    search, values = WindowSearch(days, np.arange(20)), rng.standard_normal(20)
    found = search.strongest(values)
    losses = []
    for model in NOISE_MODELS:
        covariance = model.covariance(np.arange(20))
        line = np.column_stack([np.ones(20), search.time])
        constant = np.linalg.slogdet(covariance)[1]
        constant += np.linalg.slogdet(line.T @ np.linalg.solve(covariance, line))[1]

        def loss(columns, covariance=covariance, constant=constant):
            weighted = np.linalg.solve(covariance, columns)
            fitted = np.linalg.solve(columns.T @ weighted, weighted.T @ values)
            rest = values - columns @ fitted
            return constant + 18 * np.log(rest @ np.linalg.solve(covariance, rest))

        best = np.inf
        for first, stop in search.windows:
            inside = ((np.arange(20) >= first) & (np.arange(20) < stop)).astype(float)
            best = min(best, loss(np.column_stack([line, inside])) + np.log(20))
            if stop - first >= OWN_SLOPE:
                best = min(best, loss(np.column_stack([line, inside, inside * search.time])) + 2 * np.log(20))
        losses.append((loss(line), best))
    line, window = np.min(losses, axis=0)
    assert found.gain == pytest.approx(line - window, rel=1e-9)
    assert search.gains(values[:, None])[0] == pytest.approx(found.gain, rel=1e-9)


def test_trends_are_those_outside_an_episode():
    # What the drag does in an episode near the end would else be a growth of what dive and climb share.
    table = medians(scatter=0.05)
    course = drift_series.planted_course(33, 18, 12, 3.0)
    for name in [name for name in table if "K_D0" in name]:
        table[name] += course
    changes = find_changes(table, HULL.viscous.K_D0, CHANGE_SETTINGS, 0)
    assert [(one.kind, one.first, one.last) for one in changes.found] == [("episode", 18, 29)]
    found = find_drift(table, HULL, SETTINGS, changes=changes)
    assert found.verdict.cause == "none"
    lines = verdict_lines(found.verdict, found.trends, 0.5)
    assert lines[0].startswith(
        "verdict: an episode of the drag (profiles 18 to 29, dives and climbs); in addition, no drift"
    )
    assert not any("on day" in line or "grows since" in line for line in lines)


def test_no_day_is_extrapolated_where_the_drag_does_not_grow_along_a_line():
    table = medians(scatter=0.05)
    part = (DAYS - DAYS[0]) / (DAYS[-1] - DAYS[0])
    for name in [name for name in table if "K_D0" in name]:
        table[name] += 4.0 * part**1.6
    found = find_drift(table, HULL, SETTINGS)
    assert found.verdict.drags[1].cause == "drag"
    assert not found.straight
    assert found.verdict.as_json(0.5)["days_until"] is None
    text = " ".join(verdict_lines(found.verdict, found.trends, 0.5))
    assert "does not grow linearly" in text
    assert find_drift(medians(drag=2.0, scatter=0.05), HULL, SETTINGS).straight


def test_change_points_are_read_back_as_they_were_left():
    _, changes = changed(40, {"climb": drift_series.planted_course(40, 20, 10, 0.75)})
    left = stored_changes(changes)
    group = group_called("drift")
    assert all(group[name].dims == ("change",) and group[name].units for name in left)
    stored = xr.Dataset({name: ("change", values) for name, values in left.items()}, attrs={"p_of_next_change": 0.5})
    back = read_changes(xr.DataTree.from_dict({"drift": stored}))
    reference = HULL.viscous.K_D0
    assert change_rows(back, reference) == change_rows(changes, reference)
    assert stored_changes(Changes()) == {}


def test_an_episode_of_a_scenario_acts_on_its_profiles_alone():
    scenario = BRIEF.replaced({"episode": {"first": 3, "last": 5, "climb_drag": 0.6, "remaining": 0.5}})
    hulls = [true_hull(HULL, scenario, 1, number) for number in range(1, 7)]
    reference = HULL.viscous.K_D0
    assert [one.climb.viscous.K_D0 / reference for one in hulls] == pytest.approx([1.0, 1.0, 1.6, 1.45, 1.3, 1.0])
    assert {one.dive.viscous.K_D0 for one in hulls} == {reference}
    with pytest.raises(InputError, match="before its first"):
        BRIEF.replaced({"episode": {"first": 5, "last": 3}})


# A mission

FOULED = BRIEF.replaced(
    {
        "profiles": 9, "depth": 45.0, "current": {"speed": [0.0, 0.1]},
        "disturbances": {"slow_rms": [0, 0, 0, 0, 0, 0], "impulse_interval": None},
        "fouling": {"profiles": 9, "drag": 0.8, "climb_share": 1.0},
    }
)  # fmt: skip


@pytest.fixture(scope="module")
def fouled(tmp_path_factory):
    """Archive of nine brief profiles over which the drag grows by 0.7 of itself."""
    folder = tmp_path_factory.mktemp("fouled")
    observations = simulate_mission(HULL, folder / "fouled.nc", scenario=FOULED, seed=2).path
    store = folder / "fouled.zarr"
    estimate(observations, store, "recommended")
    return store


SHORT = ("--set", "drift.coefficients.length=100", "--set", "drift.coefficients.settling=40")


@pytest.fixture(scope="module")
def answer(fouled):
    """The program's findings on it, with a few draws."""
    return program("analyze", fouled, "drift", "--workers", 0, *SHORT, "--set", "drift.coefficients.draws=4")


@pytest.mark.long
@pytest.mark.compiled
def test_a_mission_that_fouls(fouled, answer):
    assert answer.status == 0, answer.err
    assert "compatible with fouling" in answer.out
    assert check_archive(fouled) == []
    with xr.open_datatree(fouled, engine="zarr") as tree:
        group = tree["drift"].ds.load()
    truth = 0.8 * HULL.viscous.K_D0 * 8 / 9
    verdict = group.attrs["verdict"]
    low, high = verdict["K_D0_change_interval"]
    assert low <= truth <= high
    assert verdict["K_D0_change"] == pytest.approx(truth, rel=0.15)
    assert (group["count_dive"] >= MIN_RECORDS).all()
    np.testing.assert_array_equal(group["epoch"], np.repeat([0, 1, 2], 3))
    folder = fouled.with_name("fouled-studies") / "drift"
    assert {path.name for path in folder.iterdir()} >= {
        "figure_9.png",
        "drag.png",
        "table_5.md",
        "table_6.md",
        "drift.json",
    }
    shifts = {
        row["phase"]: (row["shift_pitch_up"], row["shift_pitch_down"])
        for row in group.attrs["table_6"]
        if row["component"] == "B_cu"
    }
    assert shifts["dive"][0] > 0.0 > shifts["dive"][1]
    assert shifts["climb"][0] < 0.0 < shifts["climb"][1]


@pytest.mark.compiled
def test_the_study_is_shown_from_the_archive_alone(fouled, answer, tmp_path):
    before = check_shown_as_left(fouled, "drift", fouled.with_name("fouled-studies") / "drift", tmp_path / "out")
    with open_mission(fouled) as archive:
        slopes = archive["drift"].to_dataset()["slope"].values.copy()

    def change(copy):
        put_table_rows(copy, {8: {"B_cu_climb_adjoint": 3.0}}, "drift")
        put_whole(copy, "drift", {"slope": 2.0 * slopes})

    after = shown_after(fouled, "drift", tmp_path, change)
    assert after.tables["medians"][8]["B_cu_climb_adjoint"] == 3.0
    name = ("adjoint", "B_cu", "climb")
    was, now = (
        next(row for row in one.tables["table_5"] if (row["estimate"], row["component"], row["phase"]) == name)
        for one in (before, after)
    )
    assert now["floor"] > was["floor"]
    assert after.tables["table_6"][0]["slope_segments"] == 2.0 * before.tables["table_6"][0]["slope_segments"]
    check_figure_follows(before, after, "figure_9")


@pytest.mark.compiled
@pytest.mark.usefixtures("answer")
def test_the_mission_page_begins_with_the_drift_that_the_study_found(fouled):
    with open_for_reading(fouled) as archive:
        sentences = drift_sentences(archive)
        section = operator_section(archive, describe(fouled))
    remarks = [line for block in section.blocks if isinstance(block, Remarks) for line in block.texts]
    assert any("compatible with fouling" in sentence for sentence in sentences)
    assert {f"study drift: {sentence}" for sentence in sentences} <= set(remarks)


@pytest.mark.compiled
@pytest.mark.usefixtures("answer")
def test_the_mission_page_names_steps_of_the_moments(fouled, monkeypatch):
    size = Size(0.4, 0.3, 0.5)
    sizes = {(name, phase, estimate): size for name in MOMENTS for phase in PHASES for estimate in PRIMARY}
    step = Change("step", "lasts", PHASES, PRIMARY, 8, 14, None, (1.0, 2.0), float("nan"), 0.002, 1.0, sizes)
    monkeypatch.setattr("gliderhpc.report.studies.drift.read_moment_changes", lambda _: Changes((step,), 0.002))
    with open_for_reading(fouled) as archive:
        sentences = drift_sentences(archive)
    assert any(sentence.startswith("a step: from profile 8 on") and "pitching moment" in sentence
               for sentence in sentences)  # fmt: skip


@pytest.mark.compiled
def test_segments_are_the_records(fouled):
    with open_mission(fouled) as archive:
        data, hull = read_profile_data(archive, 1), platform_of(archive)
    chosen = segments_by_phase(data, depth_band(np.array([45.0]), None), 30.0, 2)
    assert chosen["dive"]
    first, last = chosen["dive"][0]
    series = segment_series(data, hull, (first, last), 0.1)
    assert len(series.time) == 301
    np.testing.assert_allclose(np.degrees(series.measurements[::10, 1]), data.measured[first : last + 1, 1], atol=1e-9)
    np.testing.assert_allclose(series.measurements[::10, 3], data.measured[first : last + 1, 3], atol=1e-9)
    assert (series.weights == 1.0).all()


@pytest.mark.compiled
@pytest.mark.usefixtures("undrawn_studies")
def test_a_quick_drift_study_with_another_depth_band(fouled, tmp_path):
    store = shutil.copytree(fouled, tmp_path / fouled.name)
    quick = program("analyze", store, "drift", "--workers", 0, "--quick", "--estimate", "smoothed", *SHORT,
                    "--profiles", "1:6", "--set", "drift.coefficients.draws=0", "--out", tmp_path)  # fmt: skip
    assert quick.status == 0, quick.err
    assert "uses all estimates" in quick.out
    assert "no coefficients were drawn" in quick.out
    deep = program("analyze", store, "drift", "--workers", 0, "--set", "drift.depth_band=[300,400]",
                   "--profiles", "1:4", "--set", "drift.coefficients.draws=0", "--out", tmp_path)  # fmt: skip
    assert deep.status == 2
    assert "drift.depth_band" in deep.line


@pytest.mark.compiled
def test_drift_requires_four_finished_profiles(brief_store):
    request = Request(brief_store, lambda: local_executor(0))
    missing = missing_input("drift", request)
    assert missing is not None
    assert "4 finished profiles" in missing


def test_hulls_are_drawn_within_the_error_and_again_the_same():
    hulls = drawn_hulls(HULL, 0.15, 3, 7)
    assert hulls == drawn_hulls(HULL, 0.15, 3, 7)
    ratios = np.array([hull.viscous.K_D0 / HULL.viscous.K_D0 for hull in hulls])
    assert (np.abs(ratios - 1.0) <= 0.15).all()
    assert len(np.unique(ratios)) == 3


# The page's program


def test_parts_of_the_page_are_written(tmp_path):
    page = tmp_path / "drift.md"
    page.write_text(benchmark.PAGE.read_text("utf-8"), "utf-8")
    benchmark.write_part("rates", "none yet", page)
    assert "<!-- rates -->\nnone yet\n<!-- /rates -->" in page.read_text("utf-8")


def test_planted_drag_is_what_dive_and_climb_share():
    assert benchmark.planted_drag(benchmark.FOULED) == pytest.approx(0.7 * 0.3 * HULL.viscous.K_D0 * 32 / 33)
    assert benchmark.planted_drag(benchmark.OTHERS[-1]) == pytest.approx(0.3 * HULL.viscous.K_D0 * 32 / 33)
