"""Arithmetic of the comparison of speeds and vertical velocities with established methods, and the peers."""

import math

import numpy as np
import pytest
from support.missions import changed_observations

from benchmarks.established_methods import STRAIGHT, Mission, page, read_mission, same_numbers_rows, source_rows
from benchmarks.glider_flight import fitted, with_our_weight

pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def mission(brief, brief_store):
    return read_mission(brief_store, brief)


def samples(mission, number):
    """Times of one profile's samples."""
    one = next(one for one in mission.profiles if one.data.number == number)
    return one.data.epoch + (1e9 * one.data.record_time[one.found.record]).astype("timedelta64[ns]"), one


def with_reference(mission, path, off=0.0):
    """The records with a solution of their source: our own speeds, off by so much."""
    times, speeds, rates = [], [], []
    for number in (1, 2, 3):
        time, one = samples(mission, number)
        known = np.isfinite(one.found.model)
        times.append(time[known])
        speeds.append(one.found.speed[known] + off)
        rates.append(-one.found.model[known])
    table = mission.table

    def added(content):
        since = (np.concatenate(times) - np.datetime64(0, "s")) / np.timedelta64(1, "s")
        content["reference_time"] = ("reference_sample", since, {"units": "seconds since 1970-01-01"})
        content["reference_speed"] = ("reference_sample", np.concatenate(speeds), {"units": "m s-1"})
        content["reference_vertical_speed"] = ("reference_sample", np.concatenate(rates), {"units": "m s-1"})
        content["reference_profile"] = ("reference_profile", table.profile.values)
        for along in ("north", "east"):
            current = table[f"dac_{along}"].values + 0.03
            content[f"reference_current_{along}"] = ("reference_profile", current, {"units": "m s-1"})

    return changed_observations(mission.observations, path, added)


def test_a_solution_that_is_ours_differs_by_nothing(mission, tmp_path):
    path = with_reference(mission, tmp_path / "same.nc", off=0.01)
    rows = dict(source_rows(Mission(mission.platform, mission.profiles, path, mission.table)))
    assert rows["still-water speed minus its speed: mean and RMS, m/s"] == "-0.010, 0.010"
    counted = int(rows["samples with both"])
    assert counted > 300
    mean, error = map(float, rows["vertical velocity of the water, ours minus its: mean and RMS, cm/s"].split(", "))
    assert abs(mean) < 0.2
    assert error < 0.4, "the source's rate is filtered once more"
    key = "depth-averaged current, adjoint's minus its: RMS to the north, to the east, m/s; dives"
    assert rows[key] == "0.030, 0.030; 3"


def test_a_file_without_a_solution_has_no_rows(mission):
    assert source_rows(mission) == []


def test_gliderflight_agrees_in_straight_and_level_flight(mission):
    pytest.importorskip("gliderflight", reason="extra bench")
    one = mission.profiles[0]
    theirs = with_our_weight(mission.platform, one.found)
    attitude = one.found.attitude
    straight = one.known & (np.abs(attitude.turn_rate) < STRAIGHT) & (np.abs(attitude.roll) < math.radians(5.0))
    assert straight.sum() > 50
    np.testing.assert_allclose(theirs.speed[straight], one.found.speed[straight], atol=1e-3)


def test_gliderflight_fitted_by_itself_finds_the_hull(mission):
    """In water of the platform's own density it should find no spurious net mass."""
    pytest.importorskip("gliderflight", reason="extra bench")
    density = mission.platform.buoyancy.water_density
    water = [np.full(len(one.known), density) for one in mission.profiles]
    established, values = fitted(mission.platform, [(one.data, one.found) for one in mission.profiles], water)
    expected = density * mission.platform.buoyancy.neutral_volume_m3
    assert values["mg"] - mission.platform.mass.total == pytest.approx(expected, abs=0.05)
    for one, theirs in zip(mission.profiles, established, strict=True):
        assert np.nanmean(np.abs(theirs.speed - one.found.speed)[one.known]) < 0.05


def test_the_page_omits_solutions_that_the_records_do_not_have(mission, tmp_path):
    pytest.importorskip("gliderflight", reason="extra bench")

    def measured(content):
        n = content.sizes["time"]
        content["temperature"] = ("time", np.full(n, 10.0), {"units": "degC"})
        content["practical_salinity"] = ("time", np.full(n, 35.0), {"units": "1"})

    path = changed_observations(mission.observations, tmp_path / "ctd.nc", measured)
    assert same_numbers_rows(mission)[0][1].startswith("3; ")
    text = page({"twin": Mission(mission.platform, mission.profiles, path, mission.table)})
    assert "| fitted: net mass at the mean density" in text
    assert "The solution that came with the records" not in text
