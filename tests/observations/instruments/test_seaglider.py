"""Seaglider per-dive files of both layouts into the observation format."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.missions import program

from gliderhpc.api.records import kind_of
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.headings import North, north_of
from gliderhpc.observations.format import read_reference
from gliderhpc.observations.instruments.seaglider import import_seaglider

LAYOUTS = pytest.mark.parametrize("columns", [True, False], ids=["columns", "phases"])


def write_mission(folder, *, columns, **changes):
    """Dives 1 to 3 of SG099; the changes are those of dive 2."""
    for dive in (1, 2, 3):
        made.write_dive(folder, dive, columns=columns, **(changes if dive == 2 else {}))
    return folder


def samples(path, number):
    """The file's samples of one profile."""
    with xr.open_dataset(path) as dataset:
        return dataset.load().sel(time=dataset["profile"] == number)


def seconds_into(dataset, dive):
    """Seconds since a dive's first sample in its file."""
    return (dataset["time"].values - np.datetime64(0, "s")) / np.timedelta64(1, "s") - made.clock(dive)[0]


@LAYOUTS
def test_a_dive_is_a_profile_below_the_surface(tmp_path, columns):
    summary = import_seaglider([write_mission(tmp_path / "m", columns=columns)], tmp_path / "out.nc")
    assert (summary.vehicle, summary.mission, summary.pieces) == ("SG099", "SG099", "dives")
    assert [(p.number, p.parts, p.samples) for p in summary.complete] == [(n, (n,), 2 * made.HALF) for n in (1, 2, 3)]
    assert summary.without_profile == {}
    assert summary.remarks == ()
    assert summary.sample_interval == 10.0
    assert summary.fixes == 9
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}
        assert observations.platform_name == "seaglider"
        record = observations.profile(2)
    assert record.depth[[0, -1]] == pytest.approx([5.0, 5.0])
    assert len(record.surface_fixes_before) == 2


@LAYOUTS
def test_units_signs_and_declination(tmp_path, columns):
    import_seaglider([write_mission(tmp_path / "m", columns=columns)], tmp_path / "out.nc")
    found = samples(tmp_path / "out.nc", 2)
    time = seconds_into(found, 2)
    gliding = (time > made.STEP * (made.AFLOAT + 10)) & (time < made.STEP * (made.AFLOAT + made.HALF - 1))
    climbing = time > made.STEP * (made.AFLOAT + made.HALF + 12)
    assert found["heading"].values == pytest.approx(5.5)
    # Forward is towards low counts: 300 of them are 1.2 cm.
    assert found["battery_position"].values[gliding] == pytest.approx(0.012)
    assert found["battery_position"].values[climbing] == pytest.approx(-0.012)
    assert found["ballast_volume"].values[gliding] == pytest.approx(-100.0)
    assert found["ballast_volume"].values[climbing] == pytest.approx(125.0)
    assert found["battery_rotation"].values.max() == pytest.approx(80.0)
    assert found["roll"].values == pytest.approx(0.1 * found["pitch"].values)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert "15.5 to 15.5" in dataset.attrs["heading_comment"]
        assert ("eng_pitchCtl" in dataset.attrs["control_columns"]) == columns
        assert ("gc_pitch_ad" in dataset.attrs["control_columns"]) != columns
        assert dataset.attrs["battery_position_zero_count"] == made.C_PITCH


def test_the_motors_of_a_phase_run_one_after_the_other(tmp_path):
    """Battery 20 s, oil 30 s, battery round 4 s: halfway through its run each control is halfway."""
    import_seaglider([write_mission(tmp_path / "m", columns=False)], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        begin = made.clock(1)[0] + made.STEP * made.AFLOAT
        at = (dataset["time"].values - np.datetime64(0, "s")) / np.timedelta64(1, "s") - begin

        def control(name, seconds):
            return float(np.interp(seconds, at, dataset[name].values))

        counts = {name: np.array(pair) for name, pair in {"pitch": (430, 2100), "oil": (1000, 3400)}.items()}
        assert control("battery_position", 0.0) == pytest.approx(-0.01 * 0.004 * (430 - made.C_PITCH))
        assert control("battery_position", 10.0) == pytest.approx(-4e-5 * (counts["pitch"].mean() - made.C_PITCH))
        assert control("battery_position", 20.0) == pytest.approx(0.012)
        assert control("ballast_volume", 20.0) == pytest.approx(500.0)
        assert control("ballast_volume", 50.0) == pytest.approx(-100.0)
        assert control("battery_rotation", 50.0) == pytest.approx(0.0)
        assert control("battery_rotation", 60.0) == pytest.approx(80.0)


@LAYOUTS
def test_an_operators_new_centres_move_nothing(tmp_path, columns):
    """The counts are the same in every dive, so the battery and the oil are where they were."""
    folder = write_mission(tmp_path / "m", columns=columns, centres=(2350.0, 2200.0, 2900.0))
    import_seaglider([folder], tmp_path / "out.nc")
    first, second = (samples(tmp_path / "out.nc", number) for number in (1, 2))
    for name in ("battery_position", "battery_rotation", "ballast_volume"):
        np.testing.assert_allclose(second[name].values, first[name].values, atol=1e-9)


def test_centres_are_those_of_the_first_dive_that_has_them(tmp_path):
    """The first file lacks its log; dive 3 has other centres than dive 2, and the same counts."""
    folder = tmp_path / "m"
    absent = {f"log_C_{name}": None for name in ("PITCH", "VBD", "ROLL_DIVE")}
    made.write_dive(folder, 1, columns=True, **absent)
    made.write_dive(folder, 2, columns=True)
    made.write_dive(folder, 3, columns=True, centres=(2350.0, 2200.0, 2900.0))
    import_seaglider([folder], tmp_path / "out.nc")
    second, third = (samples(tmp_path / "out.nc", number) for number in (2, 3))
    for name in ("battery_position", "battery_rotation", "ballast_volume"):
        np.testing.assert_allclose(third[name].values, second[name].values, atol=1e-9)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert dataset.attrs["ballast_volume_zero_count"] == made.C_VBD


def test_counts_before_a_phase_are_those_after_the_last_where_they_are_not_logged(tmp_path):
    absent = {f"gc_{control}_ad_start": None for control in ("pitch", "vbd", "roll")}
    import_seaglider([write_mission(tmp_path / "m", columns=False, **absent)], tmp_path / "out.nc")
    first, second = (samples(tmp_path / "out.nc", number) for number in (1, 2))
    after = seconds_into(second, 2) > made.STEP * (made.AFLOAT + 10)
    for name in ("battery_position", "ballast_volume"):
        np.testing.assert_allclose(second[name].values[after], first[name].values[after])


def test_depth_in_centimetres_where_there_is_no_other(tmp_path):
    folder = tmp_path / "m"
    path = made.write_dive(folder, 1, columns=True, depth=None)
    with netCDF4.Dataset(path, "a") as file:
        made.put(file, "eng_depth", "sg_data_point", 100.0 * made.depths(100.0), "cm")
    summary = import_seaglider([path], tmp_path / "out.nc")
    assert summary.profiles[0].max_depth == pytest.approx(100.0)


def test_seawater_goes_to_the_nearest_sample(tmp_path):
    summary = import_seaglider([write_mission(tmp_path / "m", columns=True)], tmp_path / "out.nc")
    assert summary.ctd_samples == summary.rows
    found = samples(tmp_path / "out.nc", 1)
    assert found["temperature"].values == pytest.approx(8.0)
    assert found["practical_salinity"].values == pytest.approx(34.0)
    np.testing.assert_allclose(found["pressure"], 1.01 * found["depth"])


def test_the_basestations_solution_is_carried_along_and_ignored(tmp_path):
    import_seaglider([write_mission(tmp_path / "m", columns=True)], tmp_path / "out.nc")
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_profile"].values.tolist() == [1, 2, 3]
    assert reference["reference_current_north"].sel(reference_profile=2).item() == 0.05
    assert reference["reference_volume_bias"].values == pytest.approx(12.0)
    assert reference["reference_declination"].values == pytest.approx(made.DECLINATION)
    assert reference["reference_speed"].values == pytest.approx(0.25)
    assert reference["reference_slope_speed"].values == pytest.approx(0.24)
    assert np.isnan(reference["reference_flight_north"].values).all()
    assert reference["reference_time"].values[0] == made.START + np.timedelta64(2, "s")
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.profile_numbers == [1, 2, 3]


def test_a_fix_that_ends_one_dive_and_begins_the_next_counts_once(tmp_path):
    time, latitude, longitude = made.fixes(2)
    ends, north, east = (values[2] for values in made.fixes(1))
    changes = {"log_gps_time": np.array([ends, *time[1:]]), "log_gps_lat": np.array([north, *latitude[1:]]),
               "log_gps_lon": np.array([east, *longitude[1:]])}  # fmt: skip
    summary = import_seaglider([write_mission(tmp_path / "m", columns=True, **changes)], tmp_path / "out.nc")
    assert summary.fixes == 8


@pytest.mark.parametrize("cut", [True, False], ids=["shorter", "missing"])
def test_a_dive_without_gpse_is_imported_and_reported(tmp_path, cut):
    def without_last(values):
        return values[:2] if cut else np.array([*values[:2], np.nan])

    names = ("log_gps_time", "log_gps_lat", "log_gps_lon")
    changes = {name: without_last(values) for name, values in zip(names, made.fixes(2), strict=True)}
    summary = import_seaglider([write_mission(tmp_path / "m", columns=True, **changes)], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert summary.remarks == ("dive 2: no usable GPS fix after it (GPSE) in its file",)


def truncated(folder):
    path = folder / "p0990002.nc"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def changed(**changes):
    return lambda folder: made.write_dive(folder, 2, columns=False, **changes)


@pytest.mark.parametrize(
    ("corrupt", "words"),
    [
        (truncated, "is truncated or damaged; copy it again"),
        (changed(eng_pitchAng=None), "has no variable eng_pitchAng"),
        (changed(eng_rollAng=np.full(2 * (made.AFLOAT + made.HALF), np.nan)), "has no sample of roll"),
        (changed(gc_st_secs=None), "has neither eng_pitchCtl nor a table of guidance and control"),
        (changed(log_VBD_CNV=None), "lacks log_VBD_CNV or log_C_VBD, which convert counts to positions"),
        (changed(depth=None), "has no depth"),
    ],
)
def test_a_bad_dive_takes_one_line_and_the_rest_is_imported(tmp_path, corrupt, words):
    folder = write_mission(tmp_path / "m", columns=False)
    corrupt(folder)
    summary = import_seaglider([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert list(summary.rejected) == ["dive 2"]
    assert words in summary.rejected["dive 2"]
    assert "p0990002.nc" in summary.rejected["dive 2"]
    assert "\n" not in summary.rejected["dive 2"]
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        assert words in dataset.attrs["dives_rejected"]


def test_a_dive_without_declination_takes_that_of_the_dive_before(tmp_path):
    folder = tmp_path / "m"
    for dive, declination in ((1, None), (2, 15.0), (3, None), (4, 17.0)):
        made.write_dive(folder, dive, columns=True, magnetic_variation=declination)
    summary = import_seaglider([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 3, 4]
    assert summary.rejected == {}
    (remark,) = summary.remarks
    assert remark.startswith("2 dives from 1 to 3: no declination (magnetic_variation) in the file, so that of the ")
    for dive, heading in ((1, 5.0), (2, 5.0), (3, 5.0), (4, 7.0)):
        assert samples(tmp_path / "out.nc", dive)["heading"].values == pytest.approx(heading)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_declination"].values.tolist() == [15.0, 15.0, 15.0, 17.0]


@pytest.mark.parametrize("given", [None, np.nan], ids=["absent", "NaN"])
def test_a_mission_without_declination_remains_magnetic_and_says_so(tmp_path, given):
    for dive in (1, 2):
        made.write_dive(tmp_path / "m", dive, columns=True, magnetic_variation=given)
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert len(summary.complete) == 2
    (remark,) = summary.remarks
    assert "2 dives from 1 to 2: heading left magnetic, because no file has a declination" in remark
    assert "give `declination`, or the currents will be rotated by it" in remark
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert found["heading"].values == pytest.approx(350.0)
        assert north_of(found.attrs["heading_comment"]) is North.MAGNETIC
        assert np.isnan(found["reference_declination"].values).all()


def test_a_given_declination_replaces_those_of_the_files(tmp_path):
    for dive, declination in ((1, None), (2, 15.0)):
        made.write_dive(tmp_path / "m", dive, columns=True, magnetic_variation=declination)
    done = program("import", "seaglider", tmp_path / "m", tmp_path / "out.nc", "--declination", "20")
    assert done.status == 0
    assert "magnetic" not in done.out + done.err
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert found["heading"].values == pytest.approx(10.0)
        assert found.attrs["heading_comment"] == "magnetic heading plus the given declination, 20 degree"
        assert north_of(found.attrs["heading_comment"]) is North.TRUE
        assert found["reference_declination"].values.tolist() == [20.0, 20.0]
    currents = program("currents", tmp_path / "m", tmp_path / "currents.nc", "--declination", "20")
    assert currents.status == 0
    assert "not used" not in currents.out + currents.err


def test_a_declination_of_the_fixes_is_used_where_that_of_the_dive_is_missing(tmp_path):
    path = made.write_dive(tmp_path / "m", 1, columns=True, magnetic_variation=np.nan)
    with netCDF4.Dataset(path, "a") as file:
        made.put(file, "log_gps_magvar", "gps_info", [14.0, 15.0, 16.0])
    summary = import_seaglider([path], tmp_path / "out.nc")
    assert summary.remarks == ()
    assert samples(tmp_path / "out.nc", 1)["heading"].values == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("name", "unit", "column"),
    [
        ("salinity", "g/kg", "practical_salinity"),
        ("temperature", "kelvins", "temperature"),
        ("pressure", "counts", "pressure"),
    ],
)
def test_water_in_an_unknown_unit_is_left_out_and_the_dives_stay(tmp_path, name, unit, column):
    """Every dive was lost if salinity was Absolute Salinity (g/kg)."""
    folder = write_mission(tmp_path / "m", columns=True)
    for dive in (2, 3):
        with netCDF4.Dataset(folder / f"p099000{dive}.nc", "a") as file:
            file[name].units = unit
    summary = import_seaglider([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    (remark,) = summary.remarks
    assert remark.startswith(f"2 dives from 2 to 3: {name} is in '{unit}', which cannot be converted to ")
    assert remark.endswith("; it is left out")
    for dive, known in ((1, True), (2, False), (3, False)):
        assert np.isfinite(samples(tmp_path / "out.nc", dive)[column].values).any() == known


def test_positions_in_degrees_and_minutes_are_recognised(tmp_path):
    import_seaglider([write_mission(tmp_path / "m", columns=True)], tmp_path / "degrees.nc")
    for dive in (1, 2, 3):
        _, latitude, longitude = made.fixes(dive)
        minutes = [100.0 * np.trunc(value) + 60.0 * (value - np.trunc(value)) for value in (latitude, longitude)]
        made.write_dive(tmp_path / "n", dive, columns=True, log_gps_lat=minutes[0], log_gps_lon=minutes[1])
    summary = import_seaglider([tmp_path / "n"], tmp_path / "minutes.nc")
    assert summary.remarks == (
        "3 dives from 1 to 3: log_gps_lat and log_gps_lon lie off the globe as degrees, so they are read as DDMM.mmm",
    )
    assert (summary.fixes, summary.fixes_dropped) == (9, 0)
    with xr.open_dataset(tmp_path / "degrees.nc") as degrees, xr.open_dataset(tmp_path / "minutes.nc") as found:
        for name in ("fix_latitude", "fix_longitude"):
            np.testing.assert_allclose(found[name], degrees[name], atol=1e-9)


@pytest.mark.parametrize("name", ["p0990001.log", "p0990001.eng"])
def test_text_files_of_a_dive_are_refused_with_the_files_to_give(tmp_path, name):
    (tmp_path / name).write_text("version: 66.10\n")
    for source in (tmp_path, tmp_path / name):
        with pytest.raises(
            InputError, match=f"{name}: is a text file of a Seaglider's dive; give the basestation's ne"
        ):
            kind_of([source])


def test_the_self_test_is_no_profile(tmp_path):
    folder = write_mission(tmp_path / "m", columns=True)
    first = min(folder.iterdir())
    first.rename(first.with_name(first.name[:4] + "0000.nc"))
    summary = import_seaglider([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [2, 3]
    assert "its self-test 0" in summary.without_profile["dive 0"]


def test_a_shallow_dive_is_no_profile(tmp_path):
    summary = import_seaglider([write_mission(tmp_path / "m", columns=True, maximum=6.0)], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert summary.without_profile == {"dive 2": "too shallow: dives to 6 m, but at least 10 m are needed"}
    assert summary.rejected == {}


def test_samples_out_of_order_are_dropped_and_counted(tmp_path):
    time = made.clock(2)
    time[50] = time[48]
    summary = import_seaglider([write_mission(tmp_path / "m", columns=True, time=time)], tmp_path / "out.nc")
    assert summary.rows_dropped == {"time not increasing": 1}
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}


def test_bad_sources_are_refused_in_one_line(tmp_path):
    folder = write_mission(tmp_path / "m", columns=True)
    dive = folder / "p0990001.nc"
    other = tmp_path / "p1000004.nc"
    other.write_bytes(dive.read_bytes())
    stray = tmp_path / "stray.nc"
    stray.write_bytes(b"")
    broken = tmp_path / "p0990009.nc"
    broken.write_bytes(b"no netCDF")
    (tmp_path / "empty").mkdir()
    for sources, words in (
        ([tmp_path / "absent"], "no such file or folder"),
        ([stray], "is not named like a Seaglider's per-dive file"),
        ([tmp_path / "empty"], "no pGGGDDDD.nc found"),
        ([dive, other], "belongs to another glider"),
        ([folder, dive], "dive 1 is already given as"),
        ([broken], "no dive can be used"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            import_seaglider(sources, tmp_path / "out.nc")
        assert "\n" not in str(refused.value)
    assert not (tmp_path / "out.nc").exists()


def test_a_missing_output_argument_does_not_destroy_a_dive(tmp_path):
    folder = write_mission(tmp_path / "m", columns=True)
    with pytest.raises(InputError, match="the last argument must be the netCDF file"):
        import_seaglider([folder / "p0990001.nc"], folder / "p0990002.nc")


def test_command_prints_the_summary(tmp_path):
    folder = write_mission(tmp_path / "m", columns=False)
    truncated(folder)
    answer = program("import", "seaglider", folder, tmp_path / "out.nc")
    assert answer.status == 1
    assert "dive 2: left out:" in answer.out
    assert "2 profiles, 2 complete, written to" in answer.out


# Real missions -------------------------------------------------------------------------------------------------------


def test_sg249(shared_data, tmp_path):
    """Controls from the gc tables; twenty dives to 1000 m."""
    summary = import_seaglider([shared_data / "seaglider-sg249-nanoos-2024"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == list(range(10, 30))
    assert (summary.without_profile, summary.remarks, summary.rows_dropped) == ({}, (), {})
    assert summary.mission == "NANOOS Apr-2024"
    assert summary.rows == 27298
    assert (summary.fixes, summary.fixes_dropped) == (43, 0)
    assert summary.sample_interval == pytest.approx(30.0, abs=0.01), "half of the time, not of the samples"
    assert max(profile.max_depth for profile in summary.profiles) == pytest.approx(991.7, abs=1.0)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_current_north"].values[0] == pytest.approx(-0.0441, abs=1e-4)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(22)
    assert len(record.surface_fixes_before) == 2
    deep = record.depth > 100.0
    assert np.corrcoef(record.battery_rotation[deep], record.roll[deep])[0, 1] > 0.98
    # The nose goes down with the battery forward and the oil in.
    diving = record.pitch[deep] < 0.0
    assert np.median(record.battery_position[deep][diving]) > 0.01 > np.median(record.battery_position[deep][~diving])
    oil = record.ballast_volume[deep]
    assert np.median(oil[diving]) < -50e-6 < 50e-6 < np.median(oil[~diving])


def test_sg561(shared_data, tmp_path):
    """Controls in columns; two short dives sampled every 30 s."""
    summary = import_seaglider([shared_data / "seaglider-sg561-lofoten-2016"], tmp_path / "out.nc")
    assert [(profile.number, profile.samples) for profile in summary.complete] == [(2, 49), (3, 50)]
    assert summary.sample_interval == pytest.approx(30.0, abs=0.01)
    assert summary.fixes == 6
    found = samples(tmp_path / "out.nc", 3)
    # The log's centre of the ballast moved by 50 counts of -0.245296 cm3.
    raw = -145.951
    assert found["ballast_volume"].values[5] == pytest.approx(raw + 50.0 * 0.245296, abs=0.3)
    assert np.corrcoef(found["battery_rotation"], found["roll"])[0, 1] > 0.97
