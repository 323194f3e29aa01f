"""`gliderhpc.currents` on records with flagged values, clocks set back, a failed compass, or another layout."""

import re

import numpy as np
import pytest
import xarray as xr
from support.glides import Glide, mission
from support.missions import changed_observations

from gliderhpc import load_platform
from gliderhpc.api.currents import currents, navigation_of
from gliderhpc.api.records import import_records
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.record_screening import check_sensors
from gliderhpc.observations import open_observations
from gliderhpc.observations.checks.heading_values import frozen_profiles
from gliderhpc.observations.profiles import equal_runs
from gliderhpc.simulator import Scenario, load_scenario, simulate_mission

GLIDE = Glide()
FILE = "pyglider-l0/dfo-eva035-20190718.nc"


def _known(found: xr.Dataset) -> list[int]:
    return found["profile"].values[np.isfinite(found["dac_north"].values)].tolist()


def _largest_change(found: xr.Dataset, reference: xr.Dataset) -> float:
    parts = (found[name].values - reference[name].values for name in ("dac_north", "dac_east"))
    return float(np.nanmax(np.hypot(*parts)))


def _messages(found: xr.Dataset) -> list[str]:
    return [str(message) for message in found["message"].values]


# Quality flags


def test_fixes_flagged_bad_are_not_used():
    """The second surfacing is off by 10 km, which gave currents wrong by metres per second."""
    records = mission(GLIDE)
    records["fix_latitude"][2:4] += 0.1
    flags = np.ones(records.sizes["fix"], dtype=np.int8)
    flags[2:4] = 4
    found = currents(records.assign(fix_latitude_QC=("fix", flags)))
    # Dives 1 and 2 have only their mean, from the fix before the first to that after the second.
    means = [int(number) for number, text in zip(found["profile"], _messages(found), strict=True) if "the mean" in text]
    assert means == [1, 2]
    np.testing.assert_allclose(found["dac_north"], GLIDE.current[0], atol=5e-3)
    assert "values flagged bad or missing are not used: 2 of fix_latitude (fix_latitude_QC)" in found.attrs["comment"]
    good = currents(mission(GLIDE).assign(fix_latitude_QC=("fix", np.zeros(len(flags), dtype=np.int8))))
    assert _known(good) == [1, 2, 3]
    assert good.attrs["comment"] == "none"


@pytest.mark.parametrize(("name", "off"), [("depth", 50.0), ("heading", 90.0), ("pitch", 20.0)])
def test_samples_flagged_bad_are_missing(name, off):
    records = mission(GLIDE)
    clean = currents(records)
    bad = slice(300, 340)
    flags = np.ones(records.sizes["time"], dtype=np.int8)
    flags[bad] = 3
    records[name][bad] += off
    records[name].attrs["ancillary_variables"] = "checked"
    records["checked"] = ("time", flags, {"standard_name": "status_flag"})
    found = currents(records)
    assert _largest_change(found, clean) < 5e-3
    assert f"40 of {name} (checked)" in found.attrs["comment"]


def test_samples_whose_time_is_flagged_are_left_out():
    records = mission(GLIDE)
    flags = np.ones(records.sizes["time"], dtype=np.int8)
    flags[300:310] = 4
    found = currents(records.assign(time_qc=("time", flags)))
    assert "10 samples without a valid time" in found.attrs["comment"]
    np.testing.assert_allclose(found["dac_north"], GLIDE.current[0], atol=5e-3)


# Clocks


def _with_times(path, first: int, stop: int, seconds: float) -> xr.Dataset:
    with xr.open_dataset(path, decode_times=False) as dataset:
        time = dataset["time"].values.astype(float)
        time[first:stop] += seconds
        return dataset.load().assign_coords(time=("time", time, dataset["time"].attrs))


@pytest.mark.parametrize(
    ("first", "stop", "seconds"), [(2000, 2200, 3600.0), (2000, 2200, -3600.0), (2500, 5521, -7200.0)]
)
def test_profiles_with_times_by_two_clocks_have_no_current(shared_data, first, stop, seconds):
    reference = currents(shared_data / FILE, declination=15.0)
    found = currents(_with_times(shared_data / FILE, first, stop, seconds), declination=15.0)
    assert len(_known(found)) == len(_known(reference)) - 2
    assert _largest_change(found, reference) < 1e-6
    assert "the clock was set back by" in found.attrs["comment"]
    assert f"(sample {stop if seconds > 0.0 else first})" in found.attrs["comment"]
    lost = set(reference["profile"].values.tolist()) - set(_known(found))
    assert all("the clock was set back by" in str(found["message"].sel(profile=number).values) for number in lost)


def test_samples_in_another_order_are_sorted_with_a_remark():
    records = mission(Glide(dives=2))
    half = records.sizes["time"] // 2
    pieces = records.isel(time=np.roll(np.arange(records.sizes["time"]), half))
    found = currents(pieces)
    xr.testing.assert_allclose(found["dac_north"], currents(records)["dac_north"])
    assert "1 sample is earlier than the one before in the file" in found.attrs["comment"]
    assert "are sorted by time" in found.attrs["comment"]


def test_a_clock_set_back_in_one_of_several_files(tmp_path):
    records = mission(GLIDE)
    time = records["time"].values.copy()
    time[900:1000] += np.timedelta64(3600, "s")
    records.assign_coords(time=time).isel(time=slice(0, 2000)).to_netcdf(tmp_path / "a.nc")
    records.isel(time=slice(2000, None)).to_netcdf(tmp_path / "b.nc")
    found = currents([tmp_path / "a.nc", tmp_path / "b.nc"])
    assert "the clock was set back by 3596 s" in found.attrs["comment"]
    doubted = ["the clock was set back" in message for message in _messages(found)]
    assert any(doubted)
    for known, doubt, north in zip(np.isfinite(found["dac_north"].values), doubted, found["dac_north"], strict=True):
        assert known != doubt
        assert doubt or abs(float(north) - GLIDE.current[0]) < 5e-3


def test_times_that_their_type_does_not_resolve_are_refused(tmp_path):
    records = mission(Glide(dives=1))
    seconds = (records["time"].values - np.datetime64(0, "s")) / np.timedelta64(1, "s")
    attributes = {"units": "seconds since 1970-01-01"}
    coarse = records.assign_coords(time=("time", seconds.astype(np.float32), attributes))
    with pytest.raises(InputError, match=r"time is stored as float32, which resolves .* to 128 s only"):
        currents(coarse)
    days = {"units": f"seconds since {records['time'].values[0].astype('datetime64[D]')}"}
    fine = records.assign_coords(time=("time", (seconds % 86_400.0).astype(np.float32), days))
    np.testing.assert_allclose(currents(fine)["dac_north"], GLIDE.current[0], atol=5e-3)


def test_a_dive_with_too_few_samples_is_named():
    shallow = mission(Glide(dives=1, depth=30.0))
    later = mission(GLIDE)
    after = shallow["time"].values[-1] - later["time"].values[0] + np.timedelta64(3600, "s")
    later = later.assign_coords(time=later["time"] + after, fix_time=later["fix_time"] + after)
    joined = xr.concat([shallow.drop_dims("fix"), later.drop_dims("fix")], "time").merge(later[["fix_latitude"]])
    joined = joined.assign(fix_longitude=later["fix_longitude"]).isel(time=slice(None, None, 15))
    found = currents(joined)
    assert found.sizes["profile"] == 3
    assert "1 dive with fewer than 10 samples of depth, pitch and heading is left out" in found.attrs["comment"]


# Heading


def test_profiles_with_a_frozen_compass_have_no_current(shared_data):
    reference = currents(shared_data / FILE, declination=15.0)
    with xr.open_dataset(shared_data / FILE, decode_times=False) as dataset:
        records = dataset.load()
    records["heading"].values[1500:2500] = records["heading"].values[1500]
    found = currents(records, declination=15.0)
    assert sorted(set(reference["profile"].values.tolist()) - set(_known(found))) == [6, 7, 8, 9]
    assert _largest_change(found, reference) < 1e-6
    assert "heading is constant over" in str(found["message"].sel(profile=7).values)


@pytest.mark.parametrize(
    "folder", ["pyglider-l0/dfo-eva035-20190718.nc", "seaexplorer-sea035-M012", "seaglider-sg561-lofoten-2016"]
)
def test_a_compass_with_steps_of_a_degree_is_not_taken_for_a_frozen_one(shared_data, folder):
    navigation = navigation_of(shared_data / folder)
    seconds = (navigation.time - navigation.time[0]) / np.timedelta64(1, "s")
    coarse = np.radians(np.round(np.degrees(navigation.heading)))
    assert navigation.faults == {}
    assert frozen_profiles(seconds, coarse, navigation.pitch, navigation.roll, navigation.profile) == {}


@pytest.mark.compiled
def test_a_frozen_compass_of_a_fast_record_is_found(tmp_path):
    """At 1 Hz a pitch rounded to 0.1 degree changes in few of the samples, but often; the dive had had a current."""
    path = tmp_path / "fast.nc"
    simulate_mission(load_platform("petrel-l"), path, scenario=Scenario().replaced({"profiles": 2}), seed=4)

    def freeze(content):
        content["heading"].values[content["profile"].values == 2] = 100.0
        return content

    changed_observations(path, tmp_path / "frozen.nc", freeze)
    found = currents(tmp_path / "frozen.nc")
    assert np.isfinite(found["dac_north"].values).tolist() == [True, False]
    assert "heading is constant over" in str(found["message"].values[1])
    with open_observations(tmp_path / "frozen.nc") as observations:
        check_sensors(observations.profile(1))
        with pytest.raises(ProfileError, match="heading is constant over"):
            check_sensors(observations.profile(2))


@pytest.mark.compiled
def test_a_simulated_glide_without_noise_keeps_its_heading_and_is_not_called_frozen(tmp_path):
    path = tmp_path / "calm.nc"
    scenario = load_scenario("stratified").replaced({"profiles": 2, "depth": 300.0})
    simulate_mission(load_platform("petrel-l"), path, scenario=scenario, seed=5)
    with open_observations(path) as observations:
        records = [observations.profile(number) for number in observations.profile_numbers]
    assert max(stop - start for record in records for start, stop in equal_runs(record.heading, 20)) > 2000
    for record in records:
        check_sensors(record)


@pytest.mark.parametrize("roll", [np.nan, 0.0, 0.02])
def test_a_frozen_compass_is_found_without_a_measured_roll(roll):
    """A roll that is the same everywhere was filled in, and is not that of a simulated glide without noise."""
    time = np.arange(4000.0)
    pitch = np.radians(np.round(-20.0 + np.random.default_rng(1).normal(0.0, 0.2, 4000), 1))
    heading, number = np.where(time < 2000.0, 1.0, 0.5 + time / 1e4), np.where(time < 2000.0, 1, 2)
    assert list(frozen_profiles(time, heading, pitch, np.full(4000, roll), number)) == [1]


def test_impossible_headings_are_missing_and_counted():
    """An undeclared fill value of 65535 hundredths had been taken as 295.35 degrees."""
    records = mission(GLIDE)
    clean = currents(records)
    records["heading"][::20] = 655.35
    found = currents(records)
    assert _largest_change(found, clean) < 2e-3
    count = len(records["heading"][::20])
    assert (
        f"heading is outside -181 to 361 degree in {count} of {records.sizes['time']} samples"
        in (found.attrs["comment"])
    )
    assert "the first 655.35 at sample 0" in found.attrs["comment"]


# Layout


def test_dimensions_of_length_one_are_dropped_and_others_named():
    records = mission(GLIDE)
    clean = currents(records)
    found = currents(records.assign({name: records[name].expand_dims("trajectory") for name in ("pitch", "depth")}))
    xr.testing.assert_equal(found["dac_north"], clean["dac_north"])
    twice = records.assign(pitch=records["pitch"].expand_dims(trajectory=2))
    with pytest.raises(InputError, match=r"has no pitch.*pitch \(trajectory = 2, time = \d+\)"):
        currents(twice)


# Records that pause, dives that are joined, and arguments of another kind


def test_a_long_gap_in_a_numbered_profile_and_fixes_inside_it_are_named(tmp_path):
    """A current over a gap of an hour, and one over two dives with a surfacing in between, had no remark."""
    records = mission(GLIDE)
    time, number = records["time"].values.copy(), np.repeat(1, records.sizes["time"])
    late = np.arange(len(time)) > len(time) // 6
    fixes = records["fix_time"].values.copy()
    gap = np.timedelta64(3600, "s")
    moved = fixes > time[late][0]
    found = currents(
        records.assign_coords(
            time=np.where(late, time + gap, time), fix_time=np.where(moved, fixes + gap, fixes)
        ).assign(profile=("time", number))
    )
    (message,) = _messages(found)
    assert "no depth or attitude for 60 minutes" in message
    assert "the displacement over this gap is only a guess" in message
    assert "between two dives of the profile: its current is a mean over these dives and the surfacing" in message


@pytest.mark.parametrize(
    ("arguments", "named", "words"),
    [
        (None, {}, "records: a NoneType cannot be used"),
        (mission(GLIDE).to_dataframe, {}, "cannot be used; give an xarray.Dataset, a file or files"),
        (mission(GLIDE), {"declination": "x"}, "declination='x': give a number of degrees"),
        (mission(GLIDE), {"declination": np.nan}, "declination=nan: give a number of degrees"),
        (mission(GLIDE), {"errors": 3}, "errors: give GlideErrors, not a int"),
    ],
    ids=["none", "function", "text", "nan", "errors"],
)
def test_arguments_of_another_kind_are_named(arguments, named, words):
    with pytest.raises(InputError, match=re.escape(words)):
        currents(arguments, **named)


@pytest.mark.parametrize("number", [np.float32(10.5), np.array(10.5), np.float64(10.5), 10.5])
def test_a_declination_is_a_number_of_any_kind(number):
    found, same = (currents(mission(Glide(dives=1)), declination=value) for value in (number, 10.5))
    np.testing.assert_array_equal(found["dac_north"], same["dac_north"])


def test_depth_and_attitude_in_different_rows_leave_no_gap():
    records = mission(GLIDE)
    row = np.arange(records.sizes["time"])
    apart = row % 300 != 0
    parts = {name: records[name].where(~apart | (row % 2 == 1)) for name in ("pitch", "heading")}
    found = currents(records.assign(depth=records["depth"].where(~apart | (row % 2 == 0)), **parts))
    assert not any("no depth or attitude" in message for message in _messages(found))


def test_a_table_of_another_library_is_not_taken_for_paths():
    with pytest.raises(InputError, match="records: a DataFrame cannot be used"):
        currents(mission(Glide(dives=1))[["depth", "pitch"]].to_dataframe())


def test_tables_and_mappings_are_refused_with_a_remedy():
    table = mission(Glide(dives=1))[["depth", "pitch"]].to_dataframe()
    with pytest.raises(InputError, match=r"`to_xarray\(\)` of the table with `time` as its index"):
        currents(table)
    with pytest.raises(InputError, match="records: a dict cannot be used"):
        currents({"depth": [1.0]})
    with pytest.raises(InputError, match="files: give the instrument's files or folders, not a DataFrame"):
        import_records(table)


def test_fixes_in_minutes_within_a_degree_of_null_are_recognised():
    """They were left out one by one, without the reason that they have in common."""
    records = mission(GLIDE)
    minutes = {
        name: 60.0 * (records[name] - float(records[name][0]) + 0.3).assign_attrs(units="degree")
        for name in ("fix_latitude", "fix_longitude")
    }
    minutes = {name: values.assign_attrs(units="degree") for name, values in minutes.items()}
    found = currents(records.assign(minutes))
    assert np.isnan(found["dac_north"]).all()
    assert "the fixes agree with each other if they are DDMM.mmm" in found.attrs["comment"]


@pytest.mark.parametrize(("name", "value"), [("heading", -1.0), ("pitch", 80.0)])
def test_isolated_false_samples_are_left_out_and_counted(name, value):
    records = mission(Glide(interval=1.0))
    records["heading"] += 0.3 * np.random.default_rng(1).standard_normal(records.sizes["time"])
    clean = currents(records)
    records[name][::50] = value
    found = currents(records)
    assert _largest_change(found, clean) < 0.004
    assert all("isolated false samples are left out" in message for message in _messages(found))


@pytest.mark.parametrize("declination", [1000.0, -180.5, float("nan")])
def test_a_declination_is_an_angle(declination):
    with pytest.raises(InputError, match="from -180 to 180"):
        currents(mission(GLIDE), declination=declination)
