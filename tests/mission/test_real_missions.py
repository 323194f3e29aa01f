"""Dives of real, uncalibrated gliders, from files to currents: samples every 20 s or 4 s, recorded controls."""

import numpy as np
import pytest
import xarray as xr
from support.missions import program

from gliderhpc.vocabulary import QUALITY

pytestmark = pytest.mark.compiled


def estimated(folder, names, work, profiles, *arguments):
    """Import some of a mission's files and estimate some of its profiles."""
    sources = [folder / name for name in names]
    observations, store = work / "mission.nc", work / "mission.zarr"
    imported = program("import", "seaexplorer", *sources, observations)
    assert imported.status == 0, imported.err
    answer = program(
        "run-mission", observations, "--platform", "seaexplorer", "--store", store, "--workers", 0,
        "--profiles", profiles, *arguments,
    )  # fmt: skip
    assert answer.status == 0, answer.err
    return xr.open_datatree(store, engine="zarr")


def steady_records(tree, number):
    """Return the records outside the vibration set and after the first two minutes."""
    n = int(np.isfinite(tree["state"].ds["u"].sel(profile=number).values).sum())
    every = round(tree.attrs["output_interval"] / tree.attrs["step"])
    flags = np.nan_to_num(tree["series"].ds["quality"].sel(profile=number).values[::every][:n]).astype(int)
    steady = flags & QUALITY.meanings["vibration"] == 0
    steady[:120] = False
    return np.flatnonzero(steady)


@pytest.fixture(scope="module")
def deep_dive(shared_data, tmp_path_factory):
    """Return cycle 38 of mission 12, a dive to 700 m; its neighbours are included for the fixes."""
    names = [f"sea035.12.gli.sub.{cycle}" for cycle in (37, 38, 39)]
    folder = shared_data / "seaexplorer-sea035-M012"
    work = tmp_path_factory.mktemp("M012")
    with estimated(folder, names, work, 38, "--set", "platform.buoyancy.neutral_volume=-215") as tree:
        yield tree


@pytest.mark.long
def test_a_deep_dive_is_inverted(deep_dive):
    row = deep_dive.to_dataset().sel(profile=38).load()
    assert row["status"] == "done"
    assert row["max_depth"] > 690.0
    assert row["converged_fraction"] >= 0.9
    assert row["window_count"] > 80
    assert row["reset_count"] == 0
    rejected = sum(int(row[f"{kind}_count"]) for kind in ("gated", "inflated", "reset"))
    assert rejected < 0.05 * float(row["duration"])
    assert "implausible" not in str(row["message"].values)


def test_windows_of_a_slow_record_are_six_samples_long(deep_dive):
    windows = deep_dive["windows"].ds.sel(profile=38).load()
    lengths = (windows["stop"] - windows["start"]).values * deep_dive.attrs["step"]
    lengths = lengths[np.isfinite(lengths)]
    whole = np.isclose(lengths[:-1], 120.0, atol=1.0)
    solved_again = np.isclose(lengths[:-1], 60.0, atol=1.0) | np.isclose(lengths[:-1], 30.0, atol=1.0)
    assert (whole | solved_again).all()
    assert whole.mean() > 0.85


def test_speeds_and_angles_are_a_gliders(deep_dive):
    state = deep_dive["state"].ds.sel(profile=38).load()
    steady = steady_records(deep_dive, 38)
    assert len(steady) > 5000
    u, v, w = (state[name].values[steady] for name in "uvw")
    speed, alpha = np.sqrt(u * u + v * v + w * w), np.degrees(np.arctan2(w, u))
    assert 0.2 < np.median(speed) < 0.5
    assert np.median(np.abs(alpha)) < 10.0
    assert (np.abs(alpha) < 15.0).mean() > 0.95


@pytest.mark.parametrize(("name", "most"), [("roll", 0.5), ("pitch", 0.5), ("heading", 0.5), ("depth", 0.5)])
def test_the_record_is_followed(deep_dive, name, most):
    """Residuals in degrees and metres have the size of the sensors' resolution."""
    state, observed = (deep_dive[group].ds[name].sel(profile=38).values for group in ("state", "observed"))
    steady = steady_records(deep_dive, 38)
    error = (state - observed)[steady]
    error = np.mod(error + 180.0, 360.0) - 180.0 if name == "heading" else error
    assert np.sqrt(np.nanmean(error**2)) < most


def test_its_current_has_a_plausible_size(deep_dive):
    row = deep_dive.to_dataset().sel(profile=38).load()
    assert 0.01 < np.hypot(row["dac_north"], row["dac_east"]) < 0.6
    apart = np.hypot(row["dac_north"] - row["dac_north_glide_angle"], row["dac_east"] - row["dac_east_glide_angle"])
    assert apart < 0.1, "the conventional estimate is close to it"
    assert row["glide_angle_masked_fraction"] < 0.2


@pytest.mark.long
def test_shallow_dives_of_another_mission(shared_data, tmp_path):
    """Estimate two of mission 10's dives to 180 m with the shipped hull, without any calibration."""
    names = [f"SEA035.10.gli.sub.{cycle:03d}" for cycle in range(45, 50)]
    with estimated(shared_data / "seaexplorer-sea035-M010", names, tmp_path, "46,48") as tree:
        table = tree.to_dataset().load()
    assert list(table["profile"].values) == [46, 48]
    assert (table["status"] == "done").all()
    assert (table["converged_fraction"] > 0.8).all()
    assert (np.hypot(table["dac_north"], table["dac_east"]) < 0.6).all()


@pytest.mark.long
def test_dives_of_a_slocum_compared_with_its_own_estimate(shared_data, tmp_path):
    """Two of modena's profiles with the shipped hull are compared with the drift from the vehicle's dead reckoning."""
    folder = shared_data / "slocum-modena-2015"
    observations, store = tmp_path / "mission.nc", tmp_path / "mission.zarr"
    assert program("import", "slocum", folder, observations).status == 0
    answer = program(
        "run-mission", observations, "--platform", "slocum", "--store", store, "--workers", 0, "--profiles", "15,110",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    with xr.open_datatree(store, engine="zarr") as tree:
        table = tree.to_dataset().load()
    with xr.open_dataset(folder / "modena-2015-native-days0-20.nc") as native:
        own = native[["m_present_time", "m_final_water_vx", "m_final_water_vy"]].load()
    stated = np.flatnonzero(np.isfinite(own["m_final_water_vx"].values))
    assert (table["status"] == "done").all()
    assert (table["converged_fraction"] > 0.9).all()
    for number in (15, 110):
        row = table.sel(profile=number)
        end = row["start_time"].values + np.timedelta64(round(float(row["duration"])), "s")
        after = stated[own["m_present_time"].values[stated] >= end][0]
        north, east = (float(own[f"m_final_water_v{axis}"].values[after]) for axis in "yx")
        assert np.hypot(row["dac_north"] - north, row["dac_east"] - east) < 0.06
