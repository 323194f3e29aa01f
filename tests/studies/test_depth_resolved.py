"""Study ``currents``: equation 41, its filters, bins, draws and ellipses, and the study over an archive."""

import csv
import json
import shutil

import numpy as np
import pytest
import xarray as xr
from support.archives import put_profile, put_table_rows
from support.missions import program
from support.shown import check_figure_follows, check_shown_as_left, drawn, shown_after

from gliderhpc.archive.mission import open_mission
from gliderhpc.estimation.current_errors import CurrentErrors, Drift, current_uncertainty
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import yaw_bracket
from gliderhpc.kernels.points import viscous_yaw_moments
from gliderhpc.platform import Platform, read_platform
from gliderhpc.store_schema import read_attributes, set_attributes
from gliderhpc.studies.library.reference_currents import bin_count, bins_of
from gliderhpc.studies.library.retrieval import (
    bracket_terms,
    half_width,
    scale_draws,
    smooth_stretches,
    solve_lateral_flow,
    without_baseline,
)
from gliderhpc.studies.library.scores import COVERAGE, sigma_distance

PETREL = Glider(read_platform("petrel-l"))


@pytest.fixture
def motion():
    """Velocities (m/s) and rates (rad/s) of a glide at random."""
    rng = np.random.default_rng(5)
    low, high = [0.25, -0.03, -0.04, -0.02, -0.02, -0.02], [0.45, 0.03, 0.04, 0.02, 0.02, 0.02]
    return rng.uniform(low, high, (200, 6))


STILL = np.zeros(200)


def straight_flight(motion):
    """Without sideslip or rates, and with a quarter of the heave: angles of attack up to 2 degrees."""
    straight = motion.copy()
    straight[:, [1, 3, 4, 5]] = 0.0
    straight[:, 2] *= 0.25
    return straight


@pytest.mark.compiled
def test_the_viscous_yaw_moment_is_what_the_model_feels(motion):
    """Eqs. 12 and 14: the yaw part of M_v, from the model's own rates with and without the coefficients."""
    moments = np.empty(200)
    viscous_yaw_moments(PETREL.hull, motion, STILL, moments)
    v = PETREL.platform.viscous
    u, s, w, p, _, r = motion.T
    alpha, speed2 = np.arctan2(w, u), u**2 + s**2 + w**2
    beta = np.arcsin(s / np.sqrt(speed2))
    damped = speed2 + v.rate_damping_floor**2
    roll, pitch = (
        speed2 * v.K_MR * beta + damped * v.K_p * p,
        speed2 * (v.K_M0 + v.K_M * alpha) + damped * v.K_q * motion[:, 4],
    )
    yaw = speed2 * v.K_MY * beta + damped * v.K_r * r
    expected = np.sin(alpha) * (np.cos(beta) * roll - np.sin(beta) * pitch) + np.cos(alpha) * yaw
    np.testing.assert_allclose(moments, expected, rtol=1e-10, atol=1e-14)


def left_side(motion, current):
    """Left side of eq. 41 (N m), rudder amidships: the change of the yaw moment by a current across the hull."""
    moved, moments = motion.copy(), np.empty((2, len(motion)))
    moved[:, 1] -= current
    for flow, into in zip((moved, motion), moments, strict=True):
        viscous_yaw_moments(PETREL.hull, flow, STILL, into)
    surge, sway, _ = PETREL.platform.added_mass
    return moments[0] - moments[1] - (surge - sway) * motion[:, 0] * current


@pytest.mark.compiled
def test_a_root_solves_equation_41_and_has_the_sign_of_its_first_order(motion):
    moment = np.random.default_rng(6).normal(0.0, 0.05, 200)
    solved = solve_lateral_flow(PETREL, motion, STILL, moment, 1.0)
    assert not solved.rootless.any()
    np.testing.assert_allclose(left_side(motion, solved.current), moment, atol=1e-6)
    # At no sideslip, no rates and a small angle of attack the bracket is exact to first order.
    straight = straight_flight(motion)
    exact = solve_lateral_flow(PETREL, straight, STILL, np.full(200, 1e-5), 1.0)
    alpha = np.arctan2(straight[:, 2], straight[:, 0])
    bracket = np.array([yaw_bracket(PETREL.platform, angle) for angle in alpha])
    np.testing.assert_allclose(exact.current, -1e-5 / (bracket * straight[:, 0]), rtol=0.05)
    np.testing.assert_allclose(exact.gain, bracket * straight[:, 0], rtol=1e-12)


@pytest.mark.compiled
def test_samples_without_a_root_or_a_moment_are_nan_and_counted(motion):
    moment = np.full(200, 1e-3)
    moment[:10], moment[10:15] = np.nan, 1e3
    solved = solve_lateral_flow(PETREL, motion, STILL, moment, 0.5)
    assert np.isnan(solved.current[:15]).all()
    assert np.isfinite(solved.current[15:]).all()
    np.testing.assert_array_equal(np.flatnonzero(solved.rootless), np.arange(10, 15))


def test_the_condition_number_magnifies_an_error_of_a_coefficient():
    alpha = np.array([0.05])
    terms = bracket_terms(PETREL.platform, alpha)
    condition = np.abs(terms).sum() / abs(terms.sum())
    signs = np.sign(terms[:, 0]) * np.sign(terms.sum())
    moved = ((1.0 + 1e-6 * signs) @ terms)[0]
    assert moved / terms.sum() - 1.0 == pytest.approx(1e-6 * condition, rel=1e-6)


def test_the_baseline_is_a_moving_average_of_what_is_known():
    time = np.arange(600.0)
    values = 3.0 + np.where(time == 300.0, 1.0, 0.0)
    values[100:140] = np.nan
    left = without_baseline(values, 61)
    assert np.isnan(left[100:140]).all()
    assert left[300] == pytest.approx(1.0 - 1.0 / 61.0)
    np.testing.assert_allclose(np.delete(left, np.r_[100:140, 270:331]), 0.0, atol=1e-12)


def test_smoothing_keeps_polynomials_and_bridges_no_gap():
    time = np.linspace(-1.0, 1.0, 400)
    values = 1.0 - 2.0 * time + 0.5 * time**3
    values[200:205] = np.nan
    values[395:] = np.nan
    values[380:382] = np.nan
    smooth = smooth_stretches(values, 30, 3)
    lost = np.isnan(smooth)
    assert lost[200:205].all()
    assert lost[380:].all()
    np.testing.assert_allclose(smooth[~lost], (1.0 - 2.0 * time + 0.5 * time**3)[~lost], atol=1e-12)
    assert not lost[:200].any()


def test_bins_average_what_lies_in_them():
    depth, values = np.array([0.5, 9.9, 10.0, 35.0, np.nan]), np.array([[1.0], [3.0], [7.0], [9.0], [1e9]])
    bins = bins_of(depth, np.array([True, True, True, False, True]), 10.0, bin_count(35.0, 10.0))
    np.testing.assert_array_equal(bins.count, [2, 1, 0, 0])
    np.testing.assert_array_equal(bins.mean(values)[:, 0], [2.0, 7.0, np.nan, np.nan])
    np.testing.assert_array_equal(bins.spread(values)[:2, 0], [1.0, 0.0])
    below = bins_of(np.array([5.0, 15.0, 25.0]), np.ones(3, dtype=bool), 10.0, 2)
    np.testing.assert_array_equal(below.count, [1, 1])


@pytest.mark.compiled
def test_draws_scale_the_solution_as_solving_again_does(motion):
    """To first order: compared with equation 41 with the drawn coefficients themselves."""
    straight = straight_flight(motion)
    moment = np.full(200, 2e-4)
    scales = scale_draws(PETREL.platform, np.arctan2(straight[:, 2], straight[:, 0]), 0.05, 4, seed=11)
    nominal = solve_lateral_flow(PETREL, straight, STILL, moment, 1.0).current
    factors = np.random.default_rng(11).uniform(0.95, 1.05, (4, 4))
    for draw, (yaw, roll, surge, sway) in enumerate(factors):
        content = PETREL.platform.model_dump()
        content["viscous"]["K_MY"] *= yaw
        content["viscous"]["K_MR"] *= roll
        added = content["added_mass"]
        content["added_mass"] = (added[0] * surge, added[1] * sway, added[2])
        again = solve_lateral_flow(Glider(Platform.model_validate(content)), straight, STILL, moment, 1.0).current
        np.testing.assert_allclose(nominal * scales[:, draw], again, rtol=0.02)


def test_half_the_central_range_is_the_deviation_of_normal_draws():
    draws = np.random.default_rng(1).normal(0.0, 2.0, (3, 200_000))
    np.testing.assert_allclose(half_width(draws, axis=1), 2.0 * 0.9945, rtol=0.02)


def test_an_ellipse_holds_what_it_says_of_errors_drawn_from_its_terms():
    drift = Drift(np.array([0.2, -0.1]), np.array([3000.0, 500.0]), 9000.0, 50.0, 200.0, np.zeros((2, 2)))
    terms = current_uncertainty(drift, CurrentErrors())
    rng = np.random.default_rng(3)
    speed = np.hypot(0.2, 0.1)
    along, track = np.array([0.2, -0.1]) / speed, np.array([3000.0, 500.0]) / np.hypot(3000.0, 500.0)
    across = np.array([-track[1], track[0]])
    through_water = np.hypot(3000.0, 500.0) / 9000.0
    errors = (
        rng.normal(0.0, 0.055, (20_000, 1)) * track
        + rng.normal(0.0, 0.26 * speed, (20_000, 1)) * along
        + rng.normal(0.0, np.radians(8.0) * through_water, (20_000, 1)) * across
        + rng.normal(0.0, np.hypot(terms.fixes, terms.actuation), (20_000, 2))
    )
    distance = np.array([sigma_distance(error, terms.covariance) for error in errors])
    for sigma, share in COVERAGE.items():
        assert np.mean(distance <= sigma) == pytest.approx(share, abs=0.015)
    major, minor = terms.axes
    assert major**2 * minor**2 == pytest.approx(np.linalg.det(terms.covariance))
    axis = np.array([np.cos(np.radians(terms.orientation)), np.sin(np.radians(terms.orientation))])
    assert axis @ terms.covariance @ axis == pytest.approx(major**2)


@pytest.fixture(scope="module")
def store(brief_store, tmp_path_factory):
    """Archive of the brief mission, to write to: the other tests compare theirs byte by byte."""
    return shutil.copytree(brief_store, tmp_path_factory.mktemp("store") / "brief.zarr")


@pytest.fixture(scope="module")
def studied(store, tmp_path_factory):
    out = tmp_path_factory.mktemp("currents")
    answer = program(
        "analyze", store, "currents", "--workers", 0, "--out", out, "--set", "currents.bin=5",
        "--set", "currents.largest_condition=50",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    return answer, out


@pytest.mark.compiled
def test_the_study_leaves_group_table_and_figure(store, studied):
    answer, out = studied
    assert "no --budget given" in answer.out
    tree = xr.open_datatree(store, engine="zarr")
    study, root = tree["currents"].to_dataset(), tree.to_dataset()
    np.testing.assert_array_equal(study["current_north"], root["dac_north"])
    for ours, theirs in (("current_north_std", "dac_north_std"), ("current_covariance", "dac_covariance")):
        np.testing.assert_allclose(study[ours], root[theirs], rtol=1e-6, atol=1e-9)
    assert (study["retrieved_fraction"] > 0.5).all()
    assert study.sizes["bin"] == int(float(root["max_depth"].max()) // 5) + 1
    for profile in study["profile"].values:
        one = study.sel(profile=profile).load()
        known = np.isfinite(one["lateral"])
        np.testing.assert_allclose(
            np.hypot(one["shear_north"], one["shear_east"])[known], np.abs(one["lateral"])[known], rtol=0.2
        )
        total = one["dive_count"] + one["climb_count"]
        np.testing.assert_array_equal(total, one["both_count"])
        assert int(one["both_count"].sum()) == int(known.sum())
    assert set(study["both_shear_north"].dims) == {"profile", "bin"}
    with (out / "currents.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["profile"]) for row in rows] == study["profile"].values.tolist()
    assert json.loads((out / "currents.json").read_text())["facts"]["settings"]["bin"] == 5.0
    assert (out / "figure_7_profile_1.png").stat().st_size > 10_000


@pytest.mark.compiled
def test_the_study_is_shown_from_the_archive_alone(store, studied, tmp_path):
    before = check_shown_as_left(store, "currents", studied[1], tmp_path / "out")

    def change(copy):
        put_table_rows(copy, {0: {"speed": 2.5}}, "currents")
        put_profile(copy, 0, "currents", {"both_shear_north": np.full(4, 0.3)})

    after = shown_after(store, "currents", tmp_path, change)
    assert [row["speed"] == 2.5 for row in after.tables["currents"]] == [True, False, False]
    check_figure_follows(before, after, "figure_7_profile_1")
    np.testing.assert_array_equal(*(drawn(one.figures["figure_7_profile_2"]) for one in (before, after)))


@pytest.mark.compiled
def test_an_empty_figure_states_why_nothing_was_retrieved(store, studied, tmp_path):
    """As of slow records; warnings are errors here."""

    def change(copy):
        with open_mission(copy) as tree:
            group = tree["currents"].to_dataset().sel(profile=1).load()
        empty = {
            str(name): np.full(values.shape, np.nan)
            for name, values in group.data_vars.items()
            if "shear_" in str(name) and values.ndim
        }  # fmt: skip
        put_profile(copy, 0, "currents", empty)
        put_table_rows(copy, {0: {"rootless": 0, "ill_conditioned": 12, "interrupted": 0}}, "currents")

    figure = shown_after(store, "currents", tmp_path, change).figures["figure_7_profile_1"]
    figure.savefig(tmp_path / "nothing.png", dpi=40)
    why = "no depth-resolved current; samples of the profile: 12 with a condition number beyond the limit"
    for axes in figure.axes[:2]:
        assert [" ".join(text.get_text().split()) for text in axes.texts] == [why]


@pytest.mark.compiled
def test_a_hull_with_an_uncertain_sign_of_the_yaw_moment_gets_no_depth_resolved_current(store, tmp_path):
    """K_MY nearly cancels Munk's moment: within 15 % of the coefficients the bracket has either sign."""
    own = shutil.copytree(store, tmp_path / "own.zarr")
    hull = read_attributes(own)["platform"]
    set_attributes(own, {"platform": hull | {"viscous": hull["viscous"] | {"K_MY": 73.0}}})
    answer = program("analyze", own, "currents", "--workers", 0, "--out", tmp_path / "out")
    assert answer.status == 0, answer.err
    assert "the opposite sign in" in answer.out
    study = xr.open_datatree(own, engine="zarr")["currents"].to_dataset()
    assert np.isfinite(study["current_north"]).all()
    assert not np.isfinite(study["lateral"]).any()


def test_wrong_words_get_one_line(store, tmp_path):
    unknown = program("analyze", store, "currents", "--workers", 0, "--set", "currents.bins=5")
    assert unknown.status == 2
    assert "bins" in unknown.line
    tiny = program("analyze", store, "currents", "--workers", 0, "--set", "currents.bin=1e-9")
    assert tiny.status == 2
    assert "bin" in tiny.line
    nameless = program("analyze", store, "currents", "--workers", 0, "--set", "bin=5")
    assert nameless.status == 2
    assert "STUDY.KEY=VALUE" in nameless.line
    budget = program("analyze", store, "currents", "--workers", 0, "--budget", tmp_path / "none.yaml")
    assert budget.status == 2
    assert "none.yaml" in budget.line
