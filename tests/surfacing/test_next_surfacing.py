"""Prediction of the next surfacing: contribution of the surface drifts to the current."""

import numpy as np
import pytest
import xarray as xr

from benchmarks.next_surfacing import ERRORS, EVERY_DIVE, PLANNED, SURFACE, misses, mission, with_turns
from gliderhpc.distributions import chi_square_quantile
from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.records import Fix
from gliderhpc.surfacing.dive_plan import DivePlan, read_plan
from gliderhpc.surfacing.message import NextSurfacing
from gliderhpc.surfacing.next_displacement import planned_scatter
from gliderhpc.surfacing.next_surfacing import ellipse_scale, predict_from, surface_offset

WIND = np.array([0.25, -0.15])


def dives(wind: np.ndarray, count: int = 12) -> xr.Dataset:
    """Dives of a synthetic mission, with a constant velocity added to every drift at the surface."""
    table = mission(5, count).table
    for name, value in zip(("north", "east"), wind, strict=True):
        table[f"exit_surface_{name}"] = table[f"exit_surface_{name}"] + SURFACE * value
    carried = SURFACE * np.arange(count)[:, None] * wind
    places = [
        moved(place, way)
        for *place, way in zip(table["exit_latitude"].values, table["exit_longitude"].values, carried, strict=True)
    ]
    table["exit_latitude"].values[:], table["exit_longitude"].values[:] = np.transpose(places)
    return table


def predicted(table: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Predicted way from the last fix, and its covariance."""
    last = table.isel(profile=-1)
    here = Fix(last["exit_time"].values, float(last["exit_latitude"]), float(last["exit_longitude"]))
    found = predict_from(table, ERRORS.fix_error, ERRORS.surface_shear)
    there = Fix(found.time, found.latitude, found.longitude)
    return np.array(local_displacement(here, there)), found.covariance


def test_a_constant_wind_is_found_and_carries_the_glider_while_it_is_at_the_surface():
    still, windy = dives(np.zeros(2)), dives(WIND)
    (before, scatter), (after, same) = surface_offset(still, 0.05), surface_offset(windy, 0.05)
    np.testing.assert_allclose(after - before, WIND, rtol=0.05)
    assert same == pytest.approx(scatter)
    assert 0.03 < scatter < 0.15
    (way, covariance), (other, wide) = predicted(still), predicted(windy)
    np.testing.assert_allclose(other - way, SURFACE * (after - before), atol=30.0)
    np.testing.assert_allclose(wide, covariance, rtol=0.01)


def test_the_scatter_of_the_drifts_is_that_of_the_dives_so_far():
    rng = np.random.default_rng(1)
    rough = dives(np.zeros(2))
    for name in ("north", "east"):
        rough[f"exit_surface_{name}"] = rough[f"exit_surface_{name}"] + SURFACE * rng.normal(0.0, 0.3, 12)
    apart = np.column_stack([
        rough[f"exit_surface_{name}"] / rough["exit_surface_time"] - rough[f"dac_{name}_smoothed"]
        for name in ("north", "east")
    ])  # fmt: skip
    # The usual difference, 0.05 m/s, counts as three drifts more; the mean is drawn towards zero.
    squares = (11 * apart.var(axis=0, ddof=1).mean() + 3 * 0.05**2) / (11 + 3)
    offset, scatter = surface_offset(rough, 0.05)
    assert scatter == pytest.approx(np.sqrt(squares), rel=1e-9)
    assert scatter < 0.95 * np.sqrt(apart.var(axis=0, ddof=1).mean())
    np.testing.assert_allclose(offset, apart.mean(axis=0) / (1.0 + squares / (12 * 0.2**2)), rtol=1e-9)


def test_without_drifts_the_usual_difference_is_assumed():
    unknown = dives(WIND)
    unknown["exit_surface_time"][:] = np.nan
    offset, scatter = surface_offset(unknown, 0.05)
    np.testing.assert_array_equal(offset, 0.0)
    assert scatter == 0.05
    assert surface_offset(dives(WIND, 1), 0.05)[1] == pytest.approx(0.05)


@pytest.mark.parametrize("spread", [0.5, 1.0, 3.0])
def test_the_ellipse_is_scaled_to_contain_what_it_should_have_contained(spread):
    """Squared distances of a Gaussian whose covariance is `spread` times the stated one."""
    distances = spread * np.random.default_rng(2).chisquare(2, 4000)
    assert ellipse_scale(distances) == pytest.approx(spread, rel=0.1)
    # Ten predictions have half the weight: the square root of the ratio of the 68 % quantiles.
    ratio = np.quantile(distances[:10], 0.68) / (-2.0 * np.log(1.0 - 0.68))
    assert ellipse_scale(distances[:10]) == pytest.approx(ratio**0.5, rel=1e-9)
    assert ellipse_scale(distances[:30]) == pytest.approx(
        (np.quantile(distances[:30], 0.68) / (-2.0 * np.log(1.0 - 0.68))) ** 0.75, rel=1e-9
    )
    assert ellipse_scale([]) == 1.0


def test_rare_changes_of_course_do_not_widen_the_ellipse_of_all_other_dives():
    """Nine dives of ten differ by little, the tenth by a lot, so that the mean square is no measure of the most."""
    rng = np.random.default_rng(4)
    distances = np.where(rng.uniform(size=20) < 0.1, 20.0, 0.3 * rng.chisquare(2, 20))
    assert ellipse_scale(distances) < 0.7


# Planned dives


def test_a_plan_replaces_what_it_gives():
    expected = np.array([300.0, 400.0])
    np.testing.assert_allclose(DivePlan().displacement(expected, 1000.0), expected)
    np.testing.assert_allclose(DivePlan(duration=2000.0).displacement(expected, 1000.0), 2.0 * expected)
    np.testing.assert_allclose(DivePlan(heading=270.0).displacement(expected, 1000.0), [0.0, -500.0], atol=1e-9)
    np.testing.assert_allclose(DivePlan(speed=0.25, heading=0.0).displacement(expected, 1000.0), [250.0, 0.0])
    assert DivePlan(heading=-90.0, duration=5400.0, speed=0.3).text == "heading 270°, 90 min, 0.3 m/s"
    assert DivePlan().text == ""
    assert DivePlan(heading=359.8).text == "heading 000°"


def test_the_scatter_about_a_planned_heading_is_that_of_past_lengths_and_a_tenth_across():
    turns = np.radians([0.0, 90.0, 200.0, 310.0])
    lengths = np.array([1000.0, 1100.0, 900.0, 1000.0])
    flown = lengths[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
    found = planned_scatter(flown, np.array([0.0, 2000.0]))
    along = (np.sum(np.diff(lengths) ** 2) + 3 * 200.0**2) / (3 + 3)
    np.testing.assert_allclose(found, np.diag([200.0**2, along]), rtol=1e-12)


def test_a_planned_duration_and_heading_move_the_prediction_as_they_should():
    """Twice the duration goes twice as far through the water and later; a heading turns the displacement."""
    table = dives(np.zeros(2))
    last = table.isel(profile=-1)
    usual, longer, turned = (
        predict_from(table, ERRORS.fix_error, ERRORS.surface_shear, plan=plan)
        for plan in (None, DivePlan(duration=2.0 * float(last["duration"])), DivePlan(heading=10.0))
    )
    later = (longer.time - usual.time) / np.timedelta64(1, "s")
    assert later == pytest.approx(float(last["duration"]), abs=1.0)
    assert turned.time == usual.time
    before, after = (Fix(each.time, each.latitude, each.longitude) for each in (usual, turned))
    own = np.array([float(last[f"displacement_{way}"]) for way in ("north", "east")])
    ordered = np.hypot(*own) * np.array([np.cos(np.radians(10.0)), np.sin(np.radians(10.0))])
    # The expected displacement without a plan contains a small correction for the current.
    np.testing.assert_allclose(local_displacement(before, after), ordered - own, atol=0.05 * np.hypot(*own))


def test_a_known_turn_does_not_spoil_the_prediction():
    """After an ordered turn the surfacing is in the ellipse that knows the order, not in the one that does not."""
    flown = [mission(seed, 9, ordered=with_turns) for seed in range(40)]
    turned = [one for one in flown if np.ptp(one.table["heading"].values[7:9]) > 1.0]
    found = [misses(one, 8, planned=True) for one in turned]
    assert len(found) > 5
    knowing, unknowing = ([distance[name] for _, distance in found] for name in (PLANNED, "with tidal lines"))
    limit = chi_square_quantile(0.95, 2)
    assert np.mean(np.array(knowing) < limit) > 0.8
    assert np.mean(np.array(unknowing) < limit) < 0.6
    assert np.median([miss[PLANNED] for miss, _ in found]) < 0.4 * np.median([m["persistence"] for m, _ in found])


@pytest.mark.parametrize("name", EVERY_DIVE)
def test_the_ellipse_of_a_glider_that_turns_at_every_dive_contains_its_turns(name):
    """Without a plan, the ellipse contained a third of these surfacings while a prior of small changes narrowed it."""
    flown = [mission(seed, 7, ordered=EVERY_DIVE[name]) for seed in range(25)]
    found = [misses(one, after)[1]["with tidal lines"] for one in flown for after in (3, 4, 6)]
    assert np.mean(np.array(found) <= chi_square_quantile(0.68, 2)) > 0.5


@pytest.mark.parametrize("name", ["two courses in turn", "four courses in turn"])
def test_courses_steered_in_turn_are_predicted(name):
    """While a dive like the last one was expected, the median miss was persistence's, and all misses were alike."""
    flown = [mission(seed, 13, ordered=EVERY_DIVE[name]) for seed in range(20)]
    found = [misses(one, after) for one in flown for after in (6, 12)]
    nowcast, persistence = (
        np.median([miss[each] for miss, _ in found]) for each in ("with tidal lines", "persistence")
    )
    assert nowcast < 0.4 * persistence
    assert 0.5 < np.mean([each["with tidal lines"] <= chi_square_quantile(0.68, 2) for _, each in found]) < 0.9


def test_a_planned_heading_does_not_shorten_the_dive_of_a_glider_on_any_course():
    """The mean of displacements in all directions is short; the next dive is as long as the last one."""
    table = mission(3, 12, ordered=EVERY_DIVE["random courses"]).table
    found = [
        predict_from(table, ERRORS.fix_error, ERRORS.surface_shear, plan=DivePlan(heading=heading))
        for heading in (0.0, 180.0)
    ]
    north, south = (Fix(each.time, each.latitude, each.longitude) for each in found)
    last = table.isel(profile=-1)
    length = np.hypot(float(last["displacement_north"]), float(last["displacement_east"]))
    np.testing.assert_allclose(local_displacement(south, north), [2.0 * length, 0.0], atol=0.01 * length)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("heading: 400", "heading is 400: it must be at most 360"),
        ("hedding: 40", "unknown key 'hedding'"),
        ("heading: true", "heading is True"),
        ("speed: .nan", "speed is nan: it must be a finite number"),
        ("duration: 0", "duration is 0: it must be greater than 0"),
        ("- 1", "contains no plan"),
        ("", "contains no plan"),
    ],
)
def test_a_plan_that_cannot_be_used_is_refused_in_one_line(text, words, tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError) as refused:
        read_plan(path)
    assert words in str(refused.value)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)


def test_a_plan_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml"):
        read_plan(tmp_path / "none.yaml")


def test_a_message_of_an_earlier_version_has_no_plan():
    """A watch that is updated reads its earlier messages, and repeats no alert."""
    fields = dict.fromkeys(("latitude", "longitude", "current_north", "current_east", "deviation"), 0.0)
    ellipse = {"probability": 0.68, "major": 2.0, "minor": 1.0, "direction": 0.0}
    earlier = {
        "time": "2024-05-01",
        "dives": 3,
        "correlation_time": 1.0,
        "ellipse": ellipse,
        "current_ellipse": ellipse,
    }
    assert NextSurfacing.model_validate(fields | earlier).plan == ""
