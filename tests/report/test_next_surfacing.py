"""Prediction of the next surfacing: what the drifts at the surface add to the current."""

import numpy as np
import pytest
import xarray as xr

from benchmarks.next_surfacing import ERRORS, SURFACE, mission
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.records import Fix
from gliderhpc.report.next_surfacing import ellipse_scale, predict_from, surface_offset

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
    assert surface_offset(rough, 0.05)[1] == pytest.approx(0.27, rel=0.3)


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
    assert ellipse_scale(distances[:10]) == pytest.approx(np.sqrt(spread), rel=0.5)
    assert ellipse_scale([]) == 1.0


def test_rare_changes_of_course_do_not_widen_the_ellipse_of_all_other_dives():
    """Nine dives of ten differ by little, the tenth by a lot, so that the mean square is no measure of the most."""
    rng = np.random.default_rng(4)
    distances = np.where(rng.uniform(size=20) < 0.1, 20.0, 0.3 * rng.chisquare(2, 20))
    assert ellipse_scale(distances) < 0.7
