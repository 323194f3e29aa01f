"""OceanGliders OG1 trajectory files into the observation format."""

import gzip

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.missions import program

from gliderhpc.errors import InputError
from gliderhpc.estimation.glide_currents import on_points
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.foreign import HELPFUL_ORDER, ForeignFile
from gliderhpc.observations.format import read_reference
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.og1_variables import find_declination
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum


def imported(tmp_path, *, declination=None, dives=(1, 2), **changes):
    """Summary and samples of a file of two dives with some variables changed."""
    path = made.write_og1(tmp_path / "sg099_delayed.nc", dives, **changes)
    summary = import_og1([path], tmp_path / "out.nc", declination=declination)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        return summary, dataset.load()


def test_dives_fixes_and_controls(tmp_path):
    summary, found = imported(tmp_path)
    assert [(p.number, p.parts, p.samples) for p in summary.complete] == [(n, (n,), 2 * made.HALF) for n in (1, 2)]
    assert (summary.vehicle, summary.fixes, summary.remarks, summary.without_profile) == ("SG099", 6, (), {})
    # Rows that only hold a fix are no samples.
    assert summary.rows == 2 * 2 * (made.AFLOAT + made.HALF)
    assert found.attrs["platform"] == "seaglider"
    assert found.attrs["controls_absent"] == "none"
    diving = (found["profile"].values > 0) & (found["pitch"].values < 0.0)
    assert found["battery_position"].values[diving] == pytest.approx(0.012)
    assert found["battery_rotation"].values == pytest.approx(40.0)
    assert found["ballast_volume"].values[diving] == pytest.approx(-100.0)
    assert np.isnan(found["temperature"].values).sum() == 2, "samples flagged bad are missing"
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}
        assert len(observations.profile(2).surface_fixes_before) == 2


def test_a_dive_slower_than_any_glide_is_not_called_complete(tmp_path):
    """The summary names the fault that the reader of the file finds."""
    summary, _ = imported(tmp_path, TIME=made.clock(1)[0] + 4e4 * np.arange(2 * (2 * (made.AFLOAT + made.HALF) + 3)))
    with open_observations(tmp_path / "out.nc") as observations:
        assert {p.number: p.fault for p in summary.profiles if p.fault} == observations.faults != {}


def test_the_declination_comes_from_the_files_own_dead_reckoning(tmp_path):
    _, found = imported(tmp_path)
    assert found["heading"].values == pytest.approx(350.0 + made.DECLINATION - 360.0)
    assert "15.50 degrees added (the file's dead reckoning" in found.attrs["heading_comment"]


def test_a_declination_given_goes_before_it(tmp_path):
    _, found = imported(tmp_path, declination=-2.0)
    assert found["heading"].values == pytest.approx(348.0)


def test_a_heading_that_is_not_called_magnetic_is_true(tmp_path):
    summary, found = imported(tmp_path, magnetic=False)
    assert found["heading"].values == pytest.approx(350.0)
    assert summary.remarks == ()


def test_a_heading_that_is_corrected_for_the_declination_is_true(tmp_path):
    path = made.write_og1(tmp_path / "sg099_delayed.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["HEADING"].comment = "true heading, corrected for magnetic variation"
        file.createVariable("MAGNETIC_VARIATION", "f8", ())[...] = made.DECLINATION
    import_og1([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert found["heading"].values == pytest.approx(350.0)
    import_og1([path], tmp_path / "given.nc", declination=10.0)
    with xr.open_dataset(tmp_path / "given.nc") as found:
        assert found["heading"].values == pytest.approx(350.0)
        assert "the given declination, 10 degree, is not used" in found.attrs["heading_comment"]


@pytest.mark.parametrize("wild", [True, False], ids=["contradictory", "absent"])
def test_a_magnetic_heading_without_declination_is_reported(tmp_path, wild):
    count = 2 * (2 * (made.AFLOAT + made.HALF) + 3)
    north = np.random.default_rng(1).normal(size=count) * 5.0 if wild else None
    summary, found = imported(tmp_path, NORTH_DISPLACEMENT=north)
    assert found["heading"].values == pytest.approx(350.0)
    assert len(summary.remarks) == 1
    assert "give `declination`" in summary.remarks[0]


def declination_of(path, turned, step=50.0, **variables):
    """Declination of a file whose heading differs from its dead reckoning's course by `turned` (degree)."""
    course = np.radians(20.0)
    content = {
        "HEADING": ("n", 20.0 - np.asarray(turned, float), {"units": "degree", "comment": "magnetic"}),
        "NORTH_DISPLACEMENT": ("n", np.full(len(turned), step * np.cos(course)), {"units": "m"}),
        "EAST_DISPLACEMENT": ("n", np.full(len(turned), step * np.sin(course)), {"units": "m"}),
    }
    xr.Dataset({**content, **variables}).to_netcdf(path)
    with ForeignFile(path) as file:
        return find_declination(file, "HEADING", None)


def test_the_declination_is_the_median_of_the_turns(tmp_path):
    assert declination_of(tmp_path / "a.nc", [10.0, 10.3, 10.4]).angle == pytest.approx(10.3)
    assert declination_of(tmp_path / "b.nc", [179.6, -179.6, 180.0]).angle == pytest.approx(180.0)


def test_a_twentieth_of_wild_courses_is_no_contradiction_but_a_spread_is(tmp_path):
    assert declination_of(tmp_path / "few.nc", [10.0] * 95 + [90.0] * 5).known
    assert declination_of(tmp_path / "near.nc", [10.0] * 3 + [9.05] * 5 + [10.95] * 5).known
    assert not declination_of(tmp_path / "far.nc", [10.0] * 3 + [8.95] * 5 + [11.05] * 5).known


@pytest.mark.parametrize(("step", "known"), [(0.99, False), (1.05, True)])
def test_a_course_of_less_than_a_metre_says_nothing(tmp_path, step, known):
    assert declination_of(tmp_path / "short.nc", [10.0, 10.0], step).known is known


def test_the_files_own_declination_goes_before_its_track(tmp_path):
    own = ("n", [4.0, np.nan, 5.0], {"units": "degree"})
    found = declination_of(tmp_path / "own.nc", [10.0] * 3, MAGNETIC_VARIATION=own)
    assert (found.angle, found.source, found.known) == (4.5, "the file's MAGNETIC_VARIATION", True)


@pytest.mark.parametrize(("variable", "control"), [("PITCH_CTL", "battery_position"), ("ROLL_CTL", "battery_rotation")])
def test_a_control_that_is_absent_is_zero_and_reported(tmp_path, variable, control):
    summary, found = imported(tmp_path, **{variable: None})
    assert (found[control].values == 0.0).all()
    assert found.attrs["controls_absent"] == f"{control} (zero)"
    assert f"has no {control}: taken as zero" in summary.remarks[0]


def test_profiles_are_judged_from_depth_where_the_dives_are_not_numbered(tmp_path):
    summary, _ = imported(tmp_path, divenum=None)
    assert [profile.number for profile in summary.complete] == [1, 2]


ROWS = 2 * (made.AFLOAT + made.HALF) + 3
"""Rows of one dive of the synthetic file."""


def test_a_temperature_in_an_unknown_unit_is_left_out_with_a_remark(tmp_path):
    path = made.write_og1(tmp_path / "sg099_delayed.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["TEMP"].units = "counts"
    summary = import_og1([path], tmp_path / "out.nc")
    assert any("TEMP is in 'counts'" in remark and "left out" in remark for remark in summary.remarks)
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert "temperature" not in found


def test_a_temperature_with_every_value_flagged_is_left_out(tmp_path):
    """It had been a temperature without any value, without a remark."""
    summary, found = imported(tmp_path, TEMP_QC=np.full(2 * ROWS, 4.0))
    (remark,) = summary.remarks
    assert remark.startswith("sg099_delayed.nc: every value of TEMP is flagged bad or missing, so it is left out; ")
    assert "temperature" not in found
    assert (summary.ctd_samples, len(summary.complete)) == (0, 2)


def test_flags_of_a_temperature_that_were_never_set_are_not_used(tmp_path):
    """As for the flight variables: every value is flagged missing, although it is present."""
    summary, found = imported(tmp_path, TEMP_QC=np.full(2 * ROWS, 9.0))
    assert summary.remarks == ()
    assert summary.ctd_samples == 2 * (ROWS - 3)
    assert np.isfinite(found["temperature"].values).any()


def test_flags_of_the_water_have_the_meanings_of_the_file(tmp_path):
    """QARTOD's 3 is suspect, not bad."""
    path = made.write_og1(tmp_path / "sg099.nc", TEMP_QC=np.where(np.arange(2 * ROWS) == 60, 3.0, 1.0))
    with netCDF4.Dataset(path, "a") as file:
        meanings = "pass not_evaluated suspect fail missing"
        file["TEMP_QC"].setncatts({"flag_values": [1.0, 2.0, 3.0, 4.0, 9.0], "flag_meanings": meanings})
    assert import_og1([path], tmp_path / "out.nc").ctd_samples == 2 * (ROWS - 3)


def test_flags_of_the_water_may_be_characters(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc", TEMP_QC=None)
    with netCDF4.Dataset(path, "a") as file:
        flags = file.createVariable("TEMP_QC", "S1", ("N_MEASUREMENTS",))
        flags[:] = np.where(np.arange(2 * ROWS) == 60, b"4", b"1")
    import_og1([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert int(np.isnan(found["temperature"].values).sum()) == 1


def test_depth_and_attitude_may_be_in_different_rows(tmp_path):
    """As where the files of two computers were joined by time."""
    parts = [made.og1_rows(dive) for dive in (1, 2)]
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    flown, even = np.isfinite(rows["PITCH"]), np.arange(len(rows["PITCH"])) % 2 == 0
    turns = {name: np.where(even, rows[name], np.nan) for name in ("ROLL", "PITCH", "HEADING")}
    turns["DEPTH"] = np.where(flown & even, np.nan, rows["DEPTH"])
    summary, _ = imported(tmp_path, **turns)
    assert [profile.number for profile in summary.complete] == [1, 2]
    with open_observations(tmp_path / "out.nc") as observations:
        series = on_points(observations.profile(1))
    assert series.sample_interval == 2.0 * np.median(np.diff(made.clock(1)))


@pytest.mark.parametrize(
    ("counter", "what"),
    [((0, 1, 2), "begins with 0"), ((4, 5, 4), "restarts or decreases"), ((2, 1, 7), "restarts or decreases")],
)
def test_dives_of_a_counter_from_zero_or_with_a_new_beginning_are_counted_from_one(tmp_path, counter, what):
    summary, found = imported(tmp_path, dives=(1, 2, 3), divenum=np.repeat(np.float64(counter), ROWS))
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert [profile.samples for profile in summary.complete] == [2 * made.HALF] * 3
    assert "its dive counter " + what in summary.remarks[0]
    assert found["reference_profile"].values.tolist() == [1, 2, 3]


def test_a_counter_that_is_always_zero_is_not_used(tmp_path):
    summary, _ = imported(tmp_path, dives=(1, 2, 3), divenum=np.zeros(3 * ROWS))
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert "its dive counter is always 0: the dives are detected from depth" in summary.remarks[0]


def test_dive_number_zero_over_several_dives_is_not_a_dive(tmp_path):
    summary, _ = imported(tmp_path, dives=(1, 2, 3, 4), divenum=np.repeat([1.0, 0.0, 0.0, 2.0], ROWS))
    assert [profile.number for profile in summary.complete] == [1, 2]
    assert summary.remarks == ()


def test_reasons_name_the_dive_of_the_file_where_dives_have_other_numbers(tmp_path):
    depth = np.concatenate([made.og1_depths(maximum) for maximum in (100.0, 6.0, 100.0)])
    summary, _ = imported(tmp_path, dives=(1, 2, 3), divenum=np.repeat([4.0, 9.0, 2.0], ROWS), DEPTH=depth)
    assert [profile.number for profile in summary.complete] == [1, 2]
    assert list(summary.without_profile) == ["sg099_delayed.nc, its dive 9"]


def test_rows_with_dive_number_zero_do_not_split_a_dive(tmp_path):
    numbers = np.repeat([1.0, 2.0], ROWS)
    numbers[ROWS // 2 - 4 : ROWS // 2 + 4] = 0.0
    numbers[ROWS - 2 : ROWS + 2] = 0.0
    numbers[ROWS + ROWS // 3 : ROWS + ROWS // 3 + 2] = 98.0, 99.0
    numbers[2 * ROWS // 3] = np.nan
    summary, _ = imported(tmp_path, divenum=numbers)
    assert [(profile.number, profile.samples) for profile in summary.complete] == [(n, 2 * made.HALF) for n in (1, 2)]
    assert summary.remarks == ()


def test_the_producers_solution_is_carried_along(tmp_path):
    imported(tmp_path)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_current_east"].values == pytest.approx([-0.1, -0.1])
    assert reference["reference_speed"].values == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("corrupt", "words"),
    [
        (
            {"PITCH": None},
            r"has no pitch \(PITCH or GLIDER_PITCH.*it has ballast volume \(VBD_CC\), roll \(ROLL\)",
        ),
        ({"HEADING": np.full(2 * (made.AFLOAT + made.HALF) + 3, np.nan)}, "has no sample of heading"),
        ({"VBD_CC": None}, "has no ballast volume.*there is nothing to invert"),
        ({"DEPTH": None}, "has no depth"),
        ({"TIME": np.full(2 * (made.AFLOAT + made.HALF) + 3, np.nan)}, "has no sample with both time and attitude"),
        (None, "is truncated or damaged; copy it again"),
    ],
)
def test_a_bad_file_takes_one_line_and_the_rest_is_imported(tmp_path, corrupt, words):
    folder = tmp_path / "m"
    folder.mkdir()
    made.write_og1(folder / "a.nc", (1,))
    bad = made.write_og1(folder / "b.nc", (2,), **(corrupt or {}))
    if corrupt is None:
        bad.write_bytes(bad.read_bytes()[:3000])
    made.write_og1(folder / "c.nc", (3,))
    summary = import_og1([folder], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 3]
    assert list(summary.rejected) == ["b.nc"]
    assert "\n" not in summary.rejected["b.nc"]
    with pytest.raises(InputError, match=words):
        import_og1([bad], tmp_path / "none.nc")
    assert not (tmp_path / "none.nc").exists()


def test_attitude_by_other_names(tmp_path):
    """Slocum's GLIDER_PITCH, lower case, and the standard names before CF 1.8 (`*_angle`)."""
    path = made.write_og1(tmp_path / "plain.nc")
    import_og1([path], tmp_path / "plain-out.nc")
    with xr.open_dataset(path, decode_times=False) as dataset:
        renamed = dataset.load().rename(PITCH="GLIDER_PITCH", ROLL="roll", HEADING="azimuth", DEPTH="depth")
    renamed["azimuth"].attrs["standard_name"] = "platform_orientation"
    renamed.to_netcdf(tmp_path / "renamed.nc")
    import_og1([tmp_path / "renamed.nc"], tmp_path / "renamed-out.nc")
    with (
        xr.open_dataset(tmp_path / "plain-out.nc") as plain,
        xr.open_dataset(tmp_path / "renamed-out.nc") as other,
    ):
        for name in ("pitch", "roll", "depth"):
            np.testing.assert_array_equal(plain[name], other[name])


def foreign(folder, **variables):
    """Write a foreign file of some variables."""
    path = folder / "foreign.nc"
    xr.Dataset({name: ("N_MEASUREMENTS", values) for name, values in variables.items()}).to_netcdf(path)
    return path


TEN = np.arange(10.0)


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        (
            {"TIME": TEN, "GLIDER_PITCH": TEN, "DEPTH": TEN},
            r"has no ballast volume \(VBD_CC\); without the ballast.*import the glider's own files instead.*"
            r"it also lacks roll, heading; it has pitch \(GLIDER_PITCH\), depth \(DEPTH\), time \(TIME\)",
        ),
        ({"time": TEN, "pitch": TEN}, r"has no ballast volume.*it has pitch \(pitch\), time \(time\)"),
        (
            {"m_present_time": TEN, "m_pitch": TEN},
            "contains the sensors of a Slocum, which `gliderhpc import slocum` reads",
        ),
        ({"eng_pitchAng": TEN, "log_gps_lat": TEN}, "a Seaglider's dive, which `gliderhpc import seaglider` reads"),
        (dict.fromkeys(HELPFUL_ORDER, TEN), "is already in the observation format"),
    ],
)
def test_a_foreign_file_lacks_first_what_helps(tmp_path, variables, words):
    with pytest.raises(InputError, match=words):
        import_og1([foreign(tmp_path, **variables)], tmp_path / "out.nc")


@pytest.mark.parametrize("reader", [import_og1, import_seaglider, import_slocum])
@pytest.mark.parametrize("whole", [True, False], ids=["folder", "file"])
def test_a_compressed_netcdf_is_called_so(tmp_path, reader, whole):
    folder = tmp_path / "m"
    folder.mkdir()
    (folder / "p0990001.nc.gz").write_bytes(gzip.compress(b"CDF"))
    source = folder if whole else folder / "p0990001.nc.gz"
    with pytest.raises(InputError, match=r"p0990001.nc.gz: is gzip-compressed; unpack it first \(gunzip\)"):
        reader([source], tmp_path / "out.nc")


def test_files_that_count_from_the_same_number_are_counted_through(tmp_path):
    made.write_og1(tmp_path / "b.nc", (4,))
    first = made.write_og1(tmp_path / "a.nc", (3,), divenum=np.full(2 * (made.AFLOAT + made.HALF) + 3, 4.0))
    summary = import_og1([tmp_path / "b.nc", first], tmp_path / "out.nc")
    assert [(profile.number, profile.parts) for profile in summary.complete] == [(1, (4,)), (2, (4,))]


def test_an_og1_file_is_never_written_over(tmp_path):
    first, second = (made.write_og1(tmp_path / name, (1,)) for name in ("a.nc", "b.nc"))
    with pytest.raises(InputError, match="the last argument must be the netCDF file"):
        import_og1([first], second)


def test_command_prints_the_summary(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc", PITCH_CTL=None)
    answer = program("import", "og1", path, tmp_path / "out.nc")
    assert answer.status == 0
    assert "has no battery_position: taken as zero" in answer.out
    assert "2 profiles, 2 complete, written to" in answer.out


# A real mission -----------------------------------------------------------------------------------------------------


def test_sg033(shared_data, tmp_path):
    summary = import_og1([shared_data / "seaglider-sg033-og1-2010"], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == list(range(1, 20))
    assert (summary.without_profile, summary.remarks, summary.rows_dropped) == ({}, (), {})
    assert (summary.rows, summary.fixes, summary.fixes_dropped) == (10886, 43, 0)
    assert summary.sample_interval == pytest.approx(22.5, abs=0.1), "half of the time, not of the samples"
    assert max(profile.max_depth for profile in summary.profiles) == pytest.approx(1148.2, abs=0.1)
    reference = read_reference(tmp_path / "out.nc")
    assert reference["reference_declination"].values == pytest.approx(-12.7, abs=0.05)
    with open_observations(tmp_path / "out.nc") as observations:
        record = observations.profile(12)
    assert np.corrcoef(record.battery_rotation, record.roll)[0, 1] > 0.95


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("og1-examples/sea076_20230906T0852_R.nc", "lacks roll, pitch, heading; it has depth"),
        ("og1-examples/unit_345_20231112T000000_R.nc", "lacks heading, depth; it has roll (GLIDER_ROLL)"),
        ("ioos-ngdac/ru29_profile.nc", "lacks roll, pitch, heading; it has depth (depth)"),
        ("voto-nrt/voto_nrt.nc", "lacks roll, pitch, heading; it has depth (depth)"),
        ("pyglider-l0/dfo-eva035-20190718.nc", "it has roll (roll), pitch (pitch), heading (heading)"),
    ],
)
def test_foreign_files(shared_data, tmp_path, path, found):
    with pytest.raises(InputError, match=r"has no ballast volume.*import the glider's own files") as refused:
        import_og1([shared_data / path], tmp_path / "out.nc")
    assert found in str(refused.value)
    with pytest.raises(InputError, match=r"ballast_volume is missing, and so are .*import the glider's own files"):
        open_observations(shared_data / path)


def test_samples_and_fixes_flagged_bad_are_missing_with_a_remark(tmp_path):
    path = made.write_og1(tmp_path / "sg099_delayed.nc")
    with netCDF4.Dataset(path, "a") as file:
        fixes = np.flatnonzero(np.isfinite(np.ma.filled(file["LATITUDE_GPS"][:], np.nan)))
        for name, bad in (("LATITUDE_GPS", fixes[:1]), ("DEPTH", slice(60, 65)), ("HEADING", slice(70, 73))):
            flags = file.createVariable(f"{name}_QC", "i1", ("N_MEASUREMENTS",))
            flags[:] = 1
            flags[bad] = 4
    summary = import_og1([path], tmp_path / "out.nc")
    assert summary.fixes == 5
    assert "values flagged bad or missing are not used: 5 of DEPTH (DEPTH_QC)" in summary.remarks[0]
    assert "3 of HEADING (HEADING_QC), 1 of LATITUDE_GPS (LATITUDE_GPS_QC)" in summary.remarks[0]
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert int(np.isnan(found["depth"]).sum()) == 5
        assert int(np.isnan(found["heading"]).sum()) == 3


def test_impossible_headings_are_missing_with_a_remark(tmp_path):
    path = made.write_og1(tmp_path / "sg099_delayed.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["HEADING"][60:64] = 655.35
    summary = import_og1([path], tmp_path / "out.nc")
    assert "HEADING is outside -181 to 361 degree in 4 samples, the first 655.35 at sample 60" in summary.remarks[0]
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert int(np.isnan(found["heading"]).sum()) == 4
