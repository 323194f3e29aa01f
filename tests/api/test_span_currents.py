"""Mean currents over several dives between two fixes, of glides made without the package."""

import numpy as np
import pytest
import xarray as xr
from support.glides import Glide, mission
from support.observation_files import edited

import gliderhpc as gh
from gliderhpc.observations import open_observations


def _without_fixes(records: xr.Dataset, *surfacings: int) -> xr.Dataset:
    """Leave out the two fixes of some surfacings; surfacing 0 is before the first dive."""
    return records.isel(fix=[fix for fix in range(records.sizes["fix"]) if fix // 2 not in surfacings])


def test_dives_without_a_fix_between_them_have_the_mean_current_from_fix_to_fix():
    glide = Glide(dives=6)
    whole = gh.currents(mission(glide))
    found = gh.currents(_without_fixes(mission(glide), 1, 2, 5))
    np.testing.assert_allclose(found["dac_north"], glide.current[0], atol=4e-3)
    np.testing.assert_allclose(found["dac_east"], glide.current[1], atol=4e-3)
    for dives in ([1, 2, 3], [5, 6]):
        rows = found.sel(profile=dives)
        assert (rows["entry_time"] == whole["entry_time"].sel(profile=dives[0])).all()
        assert (rows["exit_time"] == whole["exit_time"].sel(profile=dives[-1])).all()
        for name in ("dac_north", "dac_east", "dac_north_std", "dac_covariance", "entry_latitude"):
            assert np.ptp(rows[name].values) == 0.0
        text = f"the current is the mean from fix to fix over profiles {dives[0]}:{dives[-1]}"
        assert all(str(message).endswith(text) for message in rows["message"].values)
    np.testing.assert_allclose(found["dac_north"].sel(profile=4), whole["dac_north"].sel(profile=4))
    assert str(found["message"].sel(profile=4).values) == ""


def test_the_track_of_several_dives_leads_from_fix_to_fix():
    whole = gh.currents(mission(Glide()))
    found = gh.currents(_without_fixes(mission(Glide()), 1, 2))
    for name in ("latitude", "longitude"):
        np.testing.assert_allclose(found[name], whole[name], atol=5e-4)


def test_the_ellipse_of_several_dives_contains_what_it_says():
    # Pitch and drag are in error by one value in all dives, which their mean does not reduce.
    inside = []
    rng = np.random.default_rng(5)
    for seed in range(30):
        glide = Glide(
            dives=3, depth=200.0, interval=10.0, fix_error=5.0, seed=seed, drag=float(np.exp(0.35 * rng.normal())),
            pitch_offset=float(0.7 * rng.normal()), heading_offset=float(3.0 * rng.normal()),
        )  # fmt: skip
        row = gh.currents(_without_fixes(mission(glide), 1, 2)).isel(profile=0)
        error = np.array([row["dac_north"] - glide.current[0], row["dac_east"] - glide.current[1]])
        off = float(row["dac_covariance"])
        covariance = np.array([[row["dac_north_std"] ** 2, off], [off, row["dac_east_std"] ** 2]])
        inside.append(error @ np.linalg.solve(covariance, error) < 2.0 * np.log(1.0 / 0.32))
    # The water drifts in these glides as at the surface, so that the ellipse may be wider than the errors.
    assert np.mean(inside) > 0.6


def test_the_drift_between_the_dives_is_an_error_of_the_mean():
    records = _without_fixes(mission(Glide()), 1, 2)
    deviation = gh.currents(records)["dac_north_std"].values[0]
    alone = gh.currents(mission(Glide()))["dac_north_std"].values
    # Eight minutes at the surface in about 200 minutes: 0.2 m/s there are 0.008 m/s of the mean.
    assert 0.006 < deviation < np.max(alone) + 0.01


def test_one_number_for_several_dives_gives_the_same_mean():
    """The time at the surface had the speed of the glide."""
    records = _without_fixes(mission(Glide()), 1, 2)
    expected = gh.currents(records)
    joined = records.assign(
        profile=("time", np.ones(records.sizes["time"], dtype=np.int32)),
        pitch=records["pitch"].where(records["depth"] > 0.5, 0.0),
    )
    joined = joined.isel(time=np.flatnonzero((joined["depth"] > 0.5) | (np.arange(joined.sizes["time"]) % 300 == 0)))
    found = gh.currents(joined)
    assert found.sizes["profile"] == 1
    for name in ("dac_north", "dac_east"):
        np.testing.assert_allclose(found[name].values[0], expected[name].values[0], atol=4e-3)
    text = "at the surface between dives of the profile: give every dive a number of its own"
    assert text in str(found["message"].values[0])


def test_a_dive_that_cannot_be_used_leaves_no_mean():
    records = _without_fixes(mission(Glide()), 1, 2)
    at = records["time"].values
    whole = gh.currents(mission(Glide()))
    second = (at > whole["entry_time"].values[1]) & (at < whole["exit_time"].values[1])
    broken = records.assign(heading=("time", np.where(second, np.nan, records["heading"]), {"units": "degree"}))
    found = gh.currents(broken)
    assert list(found["profile"].values) == [1, 3]
    assert np.isnan(found["dac_north"]).all()
    assert "no mean current from fix to fix over the profiles 1,3: " in str(found["message"].values[0])


def test_a_pause_that_may_contain_a_dive_leaves_no_mean():
    whole = mission(Glide(dives=2))
    records, between = _without_fixes(whole, 1), whole["fix_time"].values[2]
    late = records["time"].values > between
    shift = np.timedelta64(3600, "s")
    moved = records.assign_coords(time=("time", records["time"].values + late * shift))
    moved = moved.assign_coords(fix_time=("fix", records["fix_time"].values + np.array([0, 0, 1, 1]) * shift))
    found = gh.currents(moved)
    assert np.isnan(found["dac_north"]).all()
    assert "minutes between profiles 1 and 2, in which there may be another dive" in str(found["message"].values[0])


def test_the_map_draws_them():
    assert gh.plot_currents(gh.currents(_without_fixes(mission(Glide()), 1, 2))).axes


def test_a_file_with_such_dives_is_pointed_to_the_command(tmp_path):
    # Of the seven fixes of three surfacings those between the dives are left out.
    with open_observations(edited(tmp_path, lambda dataset: dataset.isel(fix=[0, 1, 6]))) as observations:
        assert any(
            "no GPS fix between the dives of profiles 1:3: they are inverted, but have no current" in warning
            and "`gliderhpc currents`" in warning
            for warning in observations.warnings
        )


@pytest.mark.parametrize("fixes", [[0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 3]])
def test_a_file_with_fixes_around_every_dive_or_at_one_end_is_not(tmp_path, fixes):
    with open_observations(edited(tmp_path, lambda dataset: dataset.isel(fix=fixes))) as observations:
        assert not any("between the dives" in warning for warning in observations.warnings)
