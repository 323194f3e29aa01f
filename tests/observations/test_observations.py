"""Observation format: round trip of records, and one clear line for every invalid input."""

import gzip
import pickle
import time as clock
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.observation_files import SAMPLES, START, edited, first_sample, mission, write

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations import open_observations
from gliderhpc.observations.times import decode_times
from gliderhpc.observations.writer import seconds_since


def test_round_trip_in_si_units(tmp_path):
    with open_observations(write(tmp_path)) as observations:
        assert observations.profile_numbers == [1, 2, 3]
        assert observations.faults == {}
        assert observations.warnings == ()
        assert (observations.platform_name, observations.mission) == ("petrel-l", "test")
        assert observations.start_time(2) == START + np.timedelta64(1000, "s")
        assert observations.duration(2) == pytest.approx(SAMPLES - 1)
        assert observations.sample_count(2) == SAMPLES
        record = observations.profile(2)
    assert record.epoch == START + np.timedelta64(1000, "s")
    np.testing.assert_allclose(record.time, np.arange(SAMPLES), atol=1e-6)
    np.testing.assert_allclose(record.roll, np.radians(5.0))
    np.testing.assert_allclose(record.battery_rotation, np.radians(30.0))
    np.testing.assert_allclose(record.ballast_volume, np.where(record.time < SAMPLES / 2, -250e-6, 250e-6))
    np.testing.assert_allclose(record.battery_position, 0.01)
    np.testing.assert_array_equal(record.rudder, 0.0)
    np.testing.assert_allclose(record.heading, np.radians(np.mod(350.0 + (1000.0 + record.time) / 10.0, 360.0)))


def test_profiles_of_a_file_in_memory_are_those_of_the_file(tmp_path):
    depth = mission()["depth"]
    depth[SAMPLES + 5] = -999.0
    path = write(tmp_path, depth=depth)
    with open_observations(path) as in_file, open_observations(path, in_memory=True) as in_memory:
        for number in in_file.profile_numbers:
            assert in_memory.profile_digest(number) == in_file.profile_digest(number)
            assert in_memory.fix_digest(number) == in_file.fix_digest(number)
        for name in ("time", "depth", "pitch", "ballast_volume"):
            np.testing.assert_array_equal(getattr(in_memory.profile(2), name), getattr(in_file.profile(2), name))


def test_fixes_belong_to_the_surface_intervals_around_a_profile(tmp_path):
    with open_observations(write(tmp_path)) as observations:
        record = observations.profile(2)
    assert [fix.time for fix in record.surface_fixes_before] == [
        START + np.timedelta64(800, "s"),
        START + np.timedelta64(980, "s"),
    ]
    assert record.entry_fix is record.surface_fixes_before[-1]
    assert record.exit_fix is record.surface_fixes_after[0]
    assert record.exit_fix.time == START + np.timedelta64(1800, "s")
    assert record.exit_fix.latitude == pytest.approx(mission()["fix_latitude"][4], abs=1e-9)
    assert record.notes == ()


def test_a_fix_long_before_the_dive_is_not_its_entry(tmp_path):
    old = mission()["fix_time"]
    old[:2] -= np.timedelta64(3600, "s")
    with open_observations(write(tmp_path, fix_time=old)) as observations:
        record = observations.profile(1)
    assert record.entry_fix is None
    assert record.exit_fix is not None
    assert record.notes == ("no GPS fix before the profile within 30 minutes",)


def test_same_input_gives_the_same_bytes_and_follows_cf(tmp_path):
    first = write(tmp_path).read_bytes()
    clock.sleep(1.1)
    assert write(tmp_path).read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["mission.nc"]
    with xr.open_dataset(tmp_path / "mission.nc") as dataset:
        assert dataset.attrs["Conventions"] == "CF-1.11"
        assert dataset["pitch"].attrs["units"] == "degree"
        assert dataset["pitch"].attrs["standard_name"] == "platform_pitch_fore_up"
        assert dataset["ballast_volume"].attrs["units"] == "cm3"
        assert dataset["depth"].attrs["positive"] == "down"


def test_digest_follows_the_bytes(tmp_path):
    path = write(tmp_path)
    with open_observations(path) as observations:
        before = observations.digest()
    write(tmp_path, roll=mission()["roll"] + 1.0)
    with open_observations(path) as observations:
        assert len(before) == 64
        assert observations.digest() != before


def test_zarr_reads_as_netcdf_does(tmp_path):
    path = write(tmp_path)
    with xr.open_dataset(path) as dataset:
        for variable in dataset.variables.values():
            variable.encoding.clear()
        dataset.to_zarr(tmp_path / "mission.zarr", consolidated=False)
    with open_observations(path) as netcdf, open_observations(tmp_path / "mission.zarr") as zarr:
        a, b = netcdf.profile(3), zarr.profile(3)
        assert len(zarr.digest()) == 64
    np.testing.assert_array_equal(a.heading, b.heading)
    np.testing.assert_array_equal(a.time, b.time)
    assert a.entry_fix.time == b.entry_fix.time


def test_a_worker_opens_with_the_planners_survey(tmp_path):
    path = write(tmp_path)
    with open_observations(path) as planner:
        survey = pickle.loads(pickle.dumps(planner.survey.only([3])))
        expected = planner.profile(3)
    with open_observations(path, survey=survey) as worker:
        assert worker.profile_numbers == [3]
        np.testing.assert_array_equal(worker.profile(3).depth, expected.depth)


def test_profiles_are_detected_where_they_are_not_numbered(tmp_path):
    with open_observations(write(tmp_path, profile=None)) as observations:
        assert observations.profile_numbers == [1, 2, 3]
        record = observations.profile(2)
    assert record.depth.min() > 1.0
    assert record.depth.max() == pytest.approx(50.0, abs=0.1)


@pytest.mark.parametrize("unit", ["degrees", "deg"])
def test_other_spellings_of_a_unit_are_accepted(tmp_path, unit):
    def respell(dataset):
        dataset["heading"].attrs["units"] = unit
        dataset["ballast_volume"].attrs["units"] = "cm^3"
        dataset["depth"].attrs["units"] = "meters"

    with open_observations(edited(tmp_path, respell)) as observations:
        assert observations.faults == {}


def test_heading_may_be_signed(tmp_path):
    signed = (mission()["heading"] + 180.0) % 360.0 - 180.0
    with open_observations(write(tmp_path, heading=signed)) as observations:
        assert observations.faults == {}


# One clear line for every bad input ----------------------------------------------------------------------------------


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        open_observations(path)
    text = str(refused.value)
    assert "\n" not in text
    assert path.name in text
    return text


def test_no_such_file(tmp_path):
    assert "no such file" in refusal(tmp_path / "absent.nc")


def test_not_a_netcdf_file(tmp_path):
    path = tmp_path / "notes.nc"
    path.write_text("time,depth\n1,2\n")
    assert "is not a netCDF file that can be read" in refusal(path)


def test_not_a_zarr_group(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    assert "is not a Zarr group that can be read" in refusal(folder)


@pytest.mark.parametrize("name", ["time", "pitch", "battery_position"])
def test_missing_variable(tmp_path, name):
    text = refusal(edited(tmp_path, lambda dataset: dataset.drop_vars(name)))
    assert f"required variable {name} is missing; it must contain" in text


def test_variables_that_have_another_name(tmp_path):
    names = {"pitch": "GLIDER_PITCH", "depth": "DEPTH"}
    text = refusal(edited(tmp_path, lambda dataset: dataset.rename(names)))
    assert "required variable pitch is missing, and so are depth" in text
    assert "it has pitch as GLIDER_PITCH, depth as DEPTH" in text


def test_missing_variables_of_raw_files_only_are_named_first(tmp_path):
    text = refusal(edited(tmp_path, lambda dataset: dataset.drop_vars(["roll", "battery_position", "ballast_volume"])))
    assert "required variable ballast_volume is missing, and so are battery_position, roll" in text
    assert "import the glider's own files" in text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (gzip.compress(b"CDF", mtime=0), "is gzip-compressed; unpack it first (gunzip)"),
        (b"<!DOCTYPE html>", "is a web page or XML, not the file itself"),
        (b"", "is empty"),
    ],
)
def test_a_file_that_is_something_else(tmp_path, content, words):
    path = tmp_path / "mission.nc.gz"
    path.write_bytes(content)
    assert words in refusal(path)


def test_depth_in_decibars(tmp_path):
    text = refusal(edited(tmp_path, lambda dataset: dataset["depth"].attrs.update(units="dbar")))
    assert "depth is in 'dbar'; convert it to 'm' (a variable in decibars is a pressure, not a depth)" in text


def test_missing_unit(tmp_path):
    text = refusal(edited(tmp_path, lambda dataset: dataset["roll"].attrs.pop("units") and None))
    assert "roll has no units attribute; it must be 'degree'" in text


def test_wrong_dimension(tmp_path):
    text = refusal(edited(tmp_path, lambda dataset: dataset.assign(roll=dataset["roll"].expand_dims("x"))))
    assert "roll has dimensions (x, time); it must have the one dimension time" in text


@pytest.mark.parametrize("units", ["m", "seconds since yesterday"])
def test_time_without_a_cf_unit(tmp_path, units):
    text = refusal(edited(tmp_path, lambda dataset: dataset["time"].attrs.update(units=units)))
    assert "time" in text
    assert "unit" in text


def test_profile_that_is_no_whole_number(tmp_path):
    numbers = mission()["profile"].astype(float)
    numbers[77] = 1.5

    def fraction(dataset):
        return dataset.assign(profile=("time", numbers))

    assert "profile is 1.5 at sample 77; it must be a whole number" in refusal(edited(tmp_path, fraction))


def test_no_profile_at_all(tmp_path):
    assert "has no profile" in refusal(write(tmp_path, profile=np.zeros(3 * (SAMPLES + 10), int)))


def test_a_clock_set_back_at_the_surface(tmp_path):
    time = mission()["time"]
    sample = first_sample(2) - 5
    time[sample:] -= np.timedelta64(3600, "s")
    path = write(tmp_path, time=time)
    assert refusal(path) == (
        f"{path}: the clock was set back by 3599 s at sample {sample} (2024-05-01T11:16:35 after 2024-05-01T12:16:34); "
        "correct the times from there on or leave these samples out, and sort the samples by time only if just their "
        "order is wrong"
    )


def test_a_clock_set_back_within_a_profile_is_named_by_that_profile(tmp_path):
    """The samples that follow the profile are those out of order, but the step is within the profile."""
    time = mission()["time"]
    sample = first_sample(2) + 100
    time[sample:] -= np.timedelta64(3600, "s")
    text = refusal(write(tmp_path, time=time))
    assert f"mission.nc: profile 2: the clock was set back by 3599 s at sample {sample} (" in text


def test_a_clock_set_back_before_a_profile_is_named_by_the_one_before(tmp_path):
    time = mission()["time"]
    inside = mission()["profile"] > 0
    time[first_sample(2) :] -= np.timedelta64(3600, "s")
    contents = {name: values[inside] for name, values in mission().items() if len(values) == len(time)}
    path = write(tmp_path, **contents | {"time": time[inside]})
    assert f"profile 1: the clock was set back by 2999 s at sample {SAMPLES} (" in refusal(path)


def test_a_small_backward_step_across_profiles(tmp_path):
    time = mission()["time"]
    sample = first_sample(2) - 5
    time[sample:] -= np.timedelta64(30, "s")
    text = refusal(write(tmp_path, time=time))
    assert f"time runs backwards at sample {sample} (2024-05-01T12:16:05 after 2024-05-01T12:16:34)" in text
    assert "sort the samples by time and remove the repeated ones" in text


def test_repeated_time_in_a_file_without_numbers(tmp_path):
    time = mission()["time"]
    time[50] = time[49]
    assert "time is repeated at sample 50" in refusal(write(tmp_path, time=time, profile=None))


# Faults of some profiles leave the others alone ----------------------------------------------------------------------


def fault(path: Path, number: int = 2, others: tuple[int, ...] = (1, 3)) -> str:
    with open_observations(path) as observations:
        assert list(observations.faults) == [number]
        text = observations.faults[number]
        with pytest.raises(ProfileError, match=f"profile {number}"):
            observations.profile(number)
        for other in others:
            assert len(observations.profile(other).time) == SAMPLES
    assert "\n" not in text
    return text


def test_time_running_backwards_within_a_profile(tmp_path):
    time = mission()["time"]
    sample = first_sample(2) + 7
    time[sample] -= np.timedelta64(3, "s")
    text = fault(write(tmp_path, time=time))
    assert text.startswith(f"profile 2: time runs backwards at sample {sample} (")


def test_a_clock_set_back_for_a_while_within_a_profile(tmp_path):
    time = mission()["time"]
    sample = first_sample(2) + 100
    time[sample : sample + 50] -= np.timedelta64(3600, "s")
    text = fault(write(tmp_path, time=time))
    assert text.startswith(f"profile 2: the clock was set back by 3599 s at sample {sample} (")


@pytest.mark.parametrize(("first", "count"), [(7, 1), (7, 10), (0, 10), (SAMPLES - 10, 10)])
def test_times_missing_within_a_profile_cost_their_samples(tmp_path, first, count):
    """They had cost the whole profile."""
    sample = first_sample(2) + first

    def drop(dataset):
        times = dataset["time"].values.copy()
        times[sample : sample + count] = np.nan
        return dataset.assign_coords(time=("time", times, dataset["time"].attrs))

    with open_observations(edited(tmp_path, drop)) as observations:
        assert observations.faults == {}
        counted = "1 sample" if count == 1 else f"{count} samples"
        warning = f"time is missing in {counted}, the first at sample {sample}: left out"
        assert [text for text in observations.warnings if "time is" in text] == [warning]
        record, whole = observations.profile(2), mission()
        assert np.all(np.diff(record.time) > 0.0)
        known = np.isfinite(record.depth)
        rows = np.setdiff1d(np.arange(first_sample(2), first_sample(2) + SAMPLES), np.arange(sample, sample + count))
        np.testing.assert_array_equal(record.instants[known], whole["time"][rows])
        np.testing.assert_allclose(record.depth[known], whole["depth"][rows])
        inside = first > 0 and first + count < SAMPLES
        left_out = "1 sample without a time is" if count == 1 else f"{count} samples without a time are"
        assert any(f"{left_out} left out, the first at sample {sample}" in note for note in record.notes) == inside
        for other in (1, 3):
            assert len(observations.profile(other).time) == SAMPLES
        # A worker reads only the slice of the profile.
        with open_observations(observations.path, survey=observations.survey.only([2])) as again:
            np.testing.assert_array_equal(again.profile(2).instants, record.instants)
            assert again.profile_digest(2) == observations.profile_digest(2)


def test_a_file_most_of_whose_times_are_missing_is_refused(tmp_path):
    def drop(dataset):
        times = np.where(np.arange(dataset.sizes["time"]) % 3 == 0, dataset["time"].values, np.nan)
        return dataset.assign_coords(time=("time", times, dataset["time"].attrs))

    with pytest.raises(InputError, match="time is missing at sample"):
        open_observations(edited(tmp_path, drop))


@pytest.mark.parametrize(("name", "what"), [("time", "sample"), ("fix_time", "fix")])
def test_times_outside_their_declared_limits_are_missing(tmp_path, name, what):
    """They had been used without a remark."""

    def limit(dataset):
        values = dataset[name].values
        place = first_sample(2) + 7 if name == "time" else 3
        dataset[name].attrs["valid_min"] = float(values[0])
        values = values.copy()
        values[place] = values[0] - 86_400.0
        return dataset.assign({name: (dataset[name].dims, values, dataset[name].attrs)})

    with open_observations(edited(tmp_path, limit)) as observations:
        assert observations.faults == {}
        place = first_sample(2) + 7 if name == "time" else 3
        assert f"{name} is outside the limits that the file declares, at least" in observations.warnings[0]
        assert f"at {what} {place}; these are treated as missing" in observations.warnings[0]


def test_limits_that_exclude_most_times_are_refused(tmp_path):
    def limit(dataset):
        dataset["time"].attrs["valid_max"] = 1.0

    with pytest.raises(InputError, match=r"time is outside the limits .* correct valid_min, valid_max or valid_range"):
        open_observations(edited(tmp_path, limit))


def test_heading_out_of_range(tmp_path):
    heading = mission()["heading"]
    sample = first_sample(2) + 13
    heading[sample:] = 720.0
    heading[first_sample(3) :] = 10.0
    text = fault(write(tmp_path, heading=heading))
    assert f"heading is 720 degree at sample {sample}, outside -180 to 360" in text
    assert "mark it missing (NaN)" in text


@pytest.mark.parametrize("value", [90.0, -95.0])
def test_pitch_out_of_range(tmp_path, value):
    pitch = mission()["pitch"]
    pitch[first_sample(2)] = value
    text = fault(write(tmp_path, pitch=pitch))
    assert f"pitch is {value:g} degree at sample {first_sample(2)}, outside the open range -90 to 90" in text


def test_pitch_all_missing(tmp_path):
    pitch = mission()["pitch"]
    pitch[first_sample(2) : first_sample(2) + SAMPLES] = np.nan
    text = fault(write(tmp_path, pitch=pitch))
    assert "profile 2: pitch is missing (NaN) in all 400 samples" in text


def test_too_few_values_of_a_measurement(tmp_path):
    roll = mission()["roll"]
    roll[first_sample(2) + 12 : first_sample(2) + SAMPLES] = np.nan
    assert "roll has only 12 samples that are not NaN, but 30 are needed" in fault(write(tmp_path, roll=roll))


def test_profile_of_twenty_samples(tmp_path):
    numbers = mission()["profile"]
    numbers[first_sample(2) + 20 : first_sample(2) + SAMPLES] = 0
    text = fault(write(tmp_path, profile=numbers))
    assert text == "profile 2: only 20 samples, but at least 30 are needed"


def test_profile_that_is_too_short(tmp_path):
    numbers = mission()["profile"]
    numbers[first_sample(2) + 100 : first_sample(2) + SAMPLES] = 0
    assert "profile 2: lasts only 99 s, but at least 120 s are needed" in fault(write(tmp_path, profile=numbers))


def test_profile_in_two_pieces(tmp_path):
    numbers = mission()["profile"]
    numbers[first_sample(2) + 200] = 0
    text = fault(write(tmp_path, profile=numbers))
    assert f"not contiguous: number 2 reappears at sample {first_sample(2) + 201}" in text


def test_all_profiles_faulty_still_opens(tmp_path):
    with open_observations(write(tmp_path, heading=np.full(3 * (SAMPLES + 10), 720.0))) as observations:
        assert list(observations.faults) == observations.profile_numbers == [1, 2, 3]


def test_unknown_profile(tmp_path):
    with open_observations(write(tmp_path)) as observations, pytest.raises(ProfileError, match="has no profile 9"):
        observations.profile(9)


def test_no_fixes_is_one_warning(tmp_path):
    path = write(tmp_path, fix_time=None, fix_latitude=None, fix_longitude=None)
    with open_observations(path) as observations:
        assert len(observations.warnings) == 1
        assert "no usable GPS fix" in observations.warnings[0]
        assert "currents will be NaN" in observations.warnings[0]
        record = observations.profile(1)
    assert record.entry_fix is None
    assert record.exit_fix is None
    assert record.notes == ("no GPS fix before or after the profile within 30 minutes",)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("fix_latitude", 114.0, "fix_latitude is 114 degree at fix 0"),
        ("fix_time", np.datetime64("NaT"), "time or position is missing in all"),
    ],
)
def test_fixes_that_are_all_unusable_are_named_with_the_first(tmp_path, name, value, said):
    """Swapped coordinates, or a receiver whose count of weeks has rolled over."""
    with open_observations(write(tmp_path, **{name: np.full_like(mission()[name], value)})) as observations:
        (warning,) = observations.warnings
    assert said in warning
    assert "no usable GPS fix" in warning


def test_a_heading_that_may_be_in_radians_is_a_warning(tmp_path):
    steady = np.full_like(mission()["heading"], 3.1)
    with open_observations(write(tmp_path, heading=steady)) as observations:
        (warning,) = observations.warnings
    assert "radians" in warning


def test_fixes_within_a_profile_that_does_not_end_at_the_surface_are_named(tmp_path):
    inside = START + np.timedelta64(2, "s") + np.arange(len(mission()["fix_time"])) * np.timedelta64(1, "s")
    still = {name: np.full_like(mission()[name], mission()[name][0]) for name in ("fix_latitude", "fix_longitude")}
    with open_observations(write(tmp_path, fix_time=inside, **still)) as observations:
        notes = observations.profile(1).notes
    assert notes[0] == "GPS fix at 2024-05-01T12:00:02 within the profile: a profile must end at the surface"


def test_fix_out_of_range_is_left_out_with_a_warning(tmp_path):
    latitude = mission()["fix_latitude"]
    latitude[3] = 95.0
    with open_observations(write(tmp_path, fix_latitude=latitude)) as observations:
        assert observations.warnings == (
            "fix_latitude is 95 degree at fix 3, outside -90 to 90: such fixes (1) are left out",
        )
        assert len(observations.profile(2).surface_fixes_before) == 1


# The writer ----------------------------------------------------------------------------------------------------------


def test_writer_refuses_what_is_not_of_the_format(tmp_path):
    with pytest.raises(ValueError, match=r"^absent: roll$"):
        write(tmp_path, roll=None)
    with pytest.raises(ValueError, match=r"^absent: roll; not in the observation format: rol$"):
        write(tmp_path, roll=None, rol=mission()["roll"])
    with pytest.raises(ValueError, match="not in the observation format: yaw"):
        write(tmp_path, yaw=mission()["roll"])


def test_writer_needs_the_folder(tmp_path):
    with pytest.raises(InputError, match="does not exist; create it first"):
        write(tmp_path / "absent")


@pytest.mark.parametrize("days", [0, 2, 30])
def test_times_that_are_read_and_written_again_remain_the_same(days):
    """Readers truncate to whole nanoseconds; without a correction, one time in forty is a nanosecond off."""
    steps = np.random.default_rng(days).integers(1, 10**10, 20_000)
    times = np.datetime64("2024-04-12", "ns") + np.timedelta64(days, "D") + np.cumsum(steps).astype("m8[ns]")
    times[7] = np.datetime64("NaT")
    unit = "seconds since 2024-04-12"
    again = decode_times(seconds_since(times, unit), unit, "", "a file").time
    np.testing.assert_array_equal(again, times)


def test_variables_in_a_group_are_named(tmp_path):
    """Several programs write groups; all variables had been called missing."""
    with xr.open_dataset(write(tmp_path), decode_times=False) as records:
        records.load().to_netcdf(tmp_path / "grouped.nc", group="obs")
    assert "has no variable outside its groups (obs); write them to a file without groups" in refusal(
        tmp_path / "grouped.nc"
    )


@pytest.mark.parametrize(
    ("units", "remedy"),
    [("days since -4713-11-24 12:00:00", "subtract 2440587.5"), ("days since 0000-01-01", "subtract 719529")],
)
def test_day_counts_of_other_programs_have_a_remedy(tmp_path, units, remedy):
    def edit(dataset):
        dataset["time"].attrs["units"] = units

    assert f"{remedy}, and write 'days since 1970-01-01'" in refusal(edited(tmp_path, edit))


def test_fixes_under_other_names_are_named(tmp_path):
    """The warning had only been that there was no fix."""
    path = edited(tmp_path, lambda dataset: dataset.rename(fix_latitude="lat", fix_longitude="LONGITUDE"))
    with open_observations(path) as observations:
        (warning,) = observations.warnings
    assert "it lacks fix_latitude, fix_longitude, but has lat, LONGITUDE: rename the positions" in warning


def test_a_file_without_samples_is_named(tmp_path):
    assert "has no samples: time has length 0" in refusal(edited(tmp_path, lambda dataset: dataset.isel(time=slice(0))))


def test_groups_that_are_not_read_are_named_where_variables_are_missing(tmp_path):
    path = tmp_path / "mixed.nc"
    with xr.open_dataset(write(tmp_path), decode_times=False) as dataset:
        dataset[["time", "depth"]].to_netcdf(path)
        dataset.drop_vars("depth").to_netcdf(path, group="more", mode="a")
    assert "its groups (more) are not read: write their variables outside of groups" in refusal(path)


def test_links_to_nothing_and_addresses_are_named(tmp_path):
    loop = tmp_path / "loop.nc"
    loop.symlink_to(loop)
    assert "is a symbolic link to a file or folder that does not exist, or to itself" in refusal(loop)
    assert "is an address; give the path alone" in refusal(Path("file:/data/m.nc"))


def test_a_pressure_in_another_unit_is_named(tmp_path):
    """It had been left out of the density without a remark."""

    def edit(dataset):
        return dataset.assign(pressure=("time", 1e4 * dataset["depth"].values, {"units": "dbar"}))

    with open_observations(edited(tmp_path, edit)) as observations:
        (warning,) = observations.warnings
    assert warning.startswith(
        "profile 1: the depth is 0.000101 times that from pressure (dbar): check the units of both"
    )
    assert warning.endswith(" (and in 2 more)")
