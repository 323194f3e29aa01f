"""Slocum records into the observation format."""

import importlib
import shutil
import struct
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner
from support.missions import program
from support.slocum_files import (
    AFLOAT,
    DIVE,
    INTERVAL,
    STANDARD_TEMPERATURE,
    START,
    UNITS,
    binary,
    flight,
    joined,
    science,
    write_binary,
    write_netcdf,
)

import gliderhpc
from gliderhpc.cli.records import import_
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.foreign import HELPFUL_ORDER
from gliderhpc.observations.instruments.slocum import import_slocum

CUT_SHORT = "ends before its closing mark; the complete records before the cut are imported"


FOREIGN, CUT_HEADER = "is not a binary Slocum file", "is truncated within its header; copy it again"


def imported(tmp_path, flown, sampled=None, *, units=None, **options):
    """Import one netCDF file: the summary, and the dataset that it wrote."""
    source = write_netcdf(tmp_path / "glider.nc", flown, sampled, units=units)
    summary = import_slocum([source], tmp_path / "out.nc", overwrite=True, **options)
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        return summary, dataset.load()


def two_segments():
    return joined([flight(0), flight(1)])


# Native sensors as netCDF


def test_profiles_run_from_leaving_the_surface_to_the_next_surfacing(tmp_path):
    summary, dataset = imported(tmp_path, two_segments())
    assert [profile.number for profile in summary.complete] == [1, 2]
    assert summary.sample_interval == INTERVAL
    assert summary.rejected == {}
    assert summary.rows_dropped == {}
    assert [round(profile.max_depth) for profile in summary.profiles] == [60, 60]
    own = np.flatnonzero(dataset["profile"].values == 1)
    assert dataset["depth"].values[own].min() > 1.5 + 2.0
    assert AFLOAT < own[0] < AFLOAT + 10
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}
        record = observations.profile(2)
    # Fixes of the surface interval that two segments share, and those after the last one.
    assert len(record.surface_fixes_before) == 2 * AFLOAT
    assert len(record.surface_fixes_after) == AFLOAT


def test_units_and_signs(tmp_path):
    _, dataset = imported(tmp_path, flight(), science())
    diving = AFLOAT + 50
    sample = dataset.isel(time=diving)
    assert sample["time"].values == np.datetime64("2015-06-25") + np.timedelta64(round(INTERVAL * diving), "s")
    assert sample["pitch"] == pytest.approx(np.degrees(-0.4))
    assert sample["roll"] == pytest.approx(np.degrees(-0.1))
    assert sample["heading"] == pytest.approx(np.degrees(1.0) + 2.0), "a mag_var of -2 is a declination of 2 east"
    assert sample["battery_position"] == pytest.approx(1.25 * 0.0254)
    assert sample["battery_rotation"] == 0.0
    assert sample["ballast_volume"] == -230.0
    assert sample["rudder"] == pytest.approx(np.degrees(0.05))
    assert sample["temperature"] == STANDARD_TEMPERATURE
    assert sample["practical_salinity"] == pytest.approx(35.0, abs=1e-4), "PSS-78 of its defining conductivity"
    assert np.isnan(dataset["temperature"].values[AFLOAT + 10])
    assert dataset["fix_latitude"].values[0] == pytest.approx(27.5)
    assert dataset["fix_longitude"].values[0] == pytest.approx(-90.5)


def test_the_attributes_state_what_was_done(tmp_path):
    summary, dataset = imported(tmp_path, flight(), science(), battery_scale=0.9, battery_zero=0.01)
    attributes = dataset.attrs
    np.testing.assert_allclose(dataset["battery_position"].values[AFLOAT], 0.9 * (1.25 * 0.0254 - 0.01))
    assert attributes["platform"] == "slocum"
    assert (attributes["battery_position_scale"], attributes["battery_position_zero"]) == (0.9, 0.01)
    assert "zero: this vehicle does not turn its battery" in attributes["battery_rotation_comment"]
    assert "less m_gps_mag_var" in attributes["heading_comment"]
    assert "2.00 to 2.00 degree east" in attributes["heading_comment"]
    assert attributes["ballast_volume_comment"] == "m_ballast_pumped in cm3"
    assert "to starboard" in attributes["rudder_comment"]
    assert "PSS-78" in attributes["ctd_comment"]
    assert [remark.split()[0] for remark in summary.remarks] == [
        "heading", "battery_position", "battery_rotation", "ballast_volume", "rudder", "1",
    ]  # fmt: skip
    for name in ("heading", "battery_rotation", "ballast_volume", "rudder"):
        assert f"{name} is {attributes[f'{name}_comment']}" in summary.remarks


def test_units_are_those_that_the_file_declares(tmp_path):
    """The same mission in other units is the same mission."""
    _, expected = imported(tmp_path, flight(), science())
    flown, sampled = flight(), science()
    for name in ("m_pitch", "m_roll", "m_heading", "m_fin", "m_gps_mag_var"):
        flown[name] = np.degrees(flown[name])
    flown["m_battpos"] = flown["m_battpos"] * 2.54
    degrees = {"m_gps_lat": 27.0, "m_gps_lon": -90.0}
    for name, whole in degrees.items():
        flown[name] = whole + (flown[name] - 100.0 * whole) / 60.0
    sampled["sci_water_cond"] = sampled["sci_water_cond"] * 10.0
    sampled["sci_water_pressure"] = sampled["sci_water_pressure"] * 10.0
    units = {
        "m_pitch": "degrees", "m_roll": "deg", "m_heading": "Degree", "m_fin": "degree", "m_gps_mag_var": "degree",
        "m_battpos": "cm", "m_gps_lat": "degrees_north", "m_gps_lon": "degrees_east", "sci_water_cond": "mS/cm",
        "sci_water_pressure": "dbar", "sci_water_temp": "Celsius", "m_present_time": "seconds since 1970-01-01",
        "sci_m_present_time": "s",
    }  # fmt: skip
    _, dataset = imported(tmp_path, flown, sampled, units=units)
    assert set(dataset.variables) == set(expected.variables)
    for name in expected.data_vars:
        if name != "fix_time":
            np.testing.assert_allclose(dataset[name].values, expected[name].values, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(dataset["time"].values, expected["time"].values)


def test_science_may_share_the_flight_computers_clock(tmp_path):
    flown = flight()
    flown["sci_water_temp"] = np.full(len(flown["m_depth"]), 12.0)
    _, dataset = imported(tmp_path, flown)
    np.testing.assert_array_equal(dataset["temperature"].values, 12.0)
    assert "practical_salinity" not in dataset
    assert "no usable conductivity" in dataset.attrs["ctd_comment"]


def test_the_engine_that_moves_is_the_ballast(tmp_path):
    """A deep glider has both sensors, but only that of the oil has values."""
    flown = flight()
    flown["m_de_oil_vol"] = flown["m_ballast_pumped"] + 20.0
    flown["m_ballast_pumped"] = np.zeros_like(flown["m_de_oil_vol"])
    _, dataset = imported(tmp_path, flown)
    assert dataset["ballast_volume"].values[AFLOAT + 5] == -210.0
    assert dataset.attrs["ballast_volume_comment"] == "m_de_oil_vol in cm3"


def test_a_record_without_a_rudder_says_so(tmp_path):
    flown = flight()
    del flown["m_fin"]
    _, dataset = imported(tmp_path, flown)
    assert "rudder" not in dataset
    assert "amidships" in dataset.attrs["rudder_comment"]
    with open_observations(tmp_path / "out.nc") as observations:
        np.testing.assert_array_equal(observations.profile(1).rudder, 0.0)


def test_the_declination_may_be_given(tmp_path):
    flown = flight()
    del flown["m_gps_mag_var"]
    _, dataset = imported(tmp_path, flown, declination=-60.0)
    np.testing.assert_allclose(dataset["heading"].values, np.degrees(1.0) - 60.0 + 360.0)
    assert "plus the given declination, -60 degree" in dataset.attrs["heading_comment"]
    with pytest.raises(InputError, match=r"m_gps_mag_var is missing.* `declination`") as refused:
        imported(tmp_path, flown)
    assert "\n" not in str(refused.value)


# Profiles


def test_dives_are_counted_from_the_depth_measured_at_the_surface(tmp_path):
    """The pressure sensor is not zeroed: on one mission it reads 0 and 4 m at the surface."""
    segments = [flight(0, levels=(0.0, 4.0)), flight(1, levels=(4.0, 4.0)), flight(2, levels=(4.0, 0.0))]
    summary, dataset = imported(tmp_path, joined(segments))
    assert [profile.number for profile in summary.complete] == [1, 2, 3]
    assert dataset["depth"].values[dataset["profile"].values == 2].min() > 4.0 + 2.0


def test_a_short_visit_to_the_surface_is_a_turn(tmp_path):
    """Two dives with 60 s at the surface between them are one profile, with 300 s two."""
    for seconds, expected in ((60.0, 1), (300.0, 2)):
        flown = flight()
        turn = {name: values[:AFLOAT][: round(seconds / INTERVAL)] for name, values in flown.items()}
        parts = [flown, turn, {name: values[AFLOAT:] for name, values in flown.items()}]
        parts[0] = {name: values[:-AFLOAT] for name, values in parts[0].items()}
        whole = joined(parts)
        whole["m_present_time"] = START + INTERVAL * np.arange(len(whole["m_depth"]))
        summary, _ = imported(tmp_path, whole)
        assert len(summary.profiles) == expected


def test_a_missing_segment_breaks_a_profile(tmp_path):
    """From the bottom of one dive to that of the next nothing was recorded: two records, not one."""
    first = {name: values[: AFLOAT + DIVE] for name, values in flight(0).items()}
    second = {name: values[AFLOAT + DIVE :] for name, values in flight(3).items()}
    summary, _ = imported(tmp_path, joined([first, second]))
    assert [profile.fault for profile in summary.profiles] == [None, None]


def test_a_profile_that_cannot_be_used_says_why(tmp_path):
    flown = two_segments()
    flown["m_battpos"][: 2 * (AFLOAT + DIVE)] = np.nan
    summary, _ = imported(tmp_path, flown)
    assert [profile.number for profile in summary.complete] == [2]
    assert summary.profiles[0].fault.startswith("profile 1: battery_position is missing (NaN)")
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {1: summary.profiles[0].fault}


def test_without_a_fix_profiles_are_found_by_depth(tmp_path):
    flown = two_segments()
    for name in ("m_gps_lat", "m_gps_lon", "m_gps_status"):
        flown[name][:] = np.nan
    summary, _ = imported(tmp_path, flown)
    assert (len(summary.complete), summary.fixes) == (2, 0)


# Junk


def test_junk_is_left_out_and_counted(tmp_path):
    flown = flight()
    flown["m_present_time"][3] = 0.0
    flown["m_present_time"][7] = flown["m_present_time"][6]
    flown["m_gps_lat"][10] = 69_696_969.0
    flown["m_battpos"][AFLOAT + 3] = 400.0
    summary, dataset = imported(tmp_path, flown)
    assert summary.rows_dropped == {
        "clock not set": 1,
        "m_battpos out of range": 1,
        "m_gps_lat out of range": 1,
        "time not increasing": 1,
    }
    assert dataset.attrs["junk_dropped"] == "; ".join(f"{name}: 1" for name in summary.rows_dropped)
    assert summary.fixes == 2 * AFLOAT - 3
    assert len(summary.complete) == 1


def test_measurements_of_a_cycle_that_hung_are_left_out(tmp_path):
    """Its depth was read at the cycle's end, seconds after the time that it bears."""
    flown = flight()
    hung = AFLOAT + DIVE + 50
    flown["m_present_time"][hung + 1 :] += 10.0
    summary, dataset = imported(tmp_path, flown)
    assert summary.rows_dropped == {"measurements of a delayed cycle of the computer": 1}
    for name in ("depth", "roll", "pitch", "heading"):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(dataset[name].values)), [hung])
    assert np.isfinite(dataset["rudder"].values[hung])


def test_a_change_of_the_sampling_rate_is_no_delay(tmp_path):
    """Every fourth cycle is recorded in the second half; one cycle in each half is delayed."""
    flown = joined([flight(segment) for segment in range(6)])
    half = len(flown["m_depth"]) // 2
    stored = np.r_[:half, half : 2 * half : 4]
    flown = {name: values[stored] for name, values in flown.items()}
    delayed = [AFLOAT + DIVE + 50, half + 60]
    flown["m_present_time"][delayed[0] + 1 :] += 10.0
    flown["m_present_time"][delayed[1] + 1 :] += 40.0
    summary, dataset = imported(tmp_path, flown)
    assert len(summary.complete) == 6
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(dataset["depth"].values)), delayed)


def test_a_row_of_delayed_cycles_is_no_change_of_the_rate(tmp_path):
    """The compass of modena once delayed 19 cycles in a row; the depth of these is wrong by metres."""
    flown = flight()
    first = AFLOAT + DIVE + 20
    flown["m_present_time"][first + 1 : first + 20] += 11.0 * np.arange(1, 20)
    flown["m_present_time"][first + 20 :] += 209.0
    _, dataset = imported(tmp_path, flown)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(dataset["depth"].values)), np.arange(first, first + 19))


def test_invalid_and_implausible_fixes_are_left_out(tmp_path):
    flown = flight()
    flown["m_gps_status"][5] = 1.0
    flown["m_gps_lat"][20] += 5.0
    summary, dataset = imported(tmp_path, flown)
    assert summary.fixes == len(dataset["fix_time"]) == 2 * AFLOAT - 2
    assert summary.fixes_dropped == 1
    assert dataset["fix_latitude"].values.max() < 27.6


# Files that cannot be used


def changed(change):
    """Columns after a change."""
    flown = flight()
    change(flown)
    return flown


@pytest.mark.parametrize(
    ("flown", "units", "words"),
    [
        (changed(lambda f: f.pop("m_pitch")), {}, r"glider\.nc: has no m_pitch \(attitude\); decode the mission again"),
        (changed(lambda f: f.pop("m_present_time")), {}, r"glider\.nc: has no m_present_time"),
        (changed(lambda f: (f.pop("m_ballast_pumped"), f.pop("m_de_oil_vol"))), {}, "without the ballast"),
        (flight(), {"m_battpos": None}, r"glider\.nc: m_battpos declares no unit; set its units .* one of m,"),
        (flight(), {"m_pitch": "m"}, r"glider\.nc: m_pitch is in 'm', which is not a unit of angle"),
        (flight(), {"m_present_time": "days"}, r"glider\.nc: m_present_time is in 'days'"),
        (changed(lambda f: f["m_present_time"].fill(0.0)), {}, r"glider\.nc: no usable .* \(clock not set: 450\)"),
    ],
    ids=["attitude", "clock", "ballast", "no unit", "wrong unit", "unit of time", "no time"],
)  # fmt: skip
def test_a_fault_is_reported_in_one_line(tmp_path, flown, units, words):
    with pytest.raises(InputError, match=words) as refused:
        imported(tmp_path, flown, units=units)
    assert "\n" not in str(refused.value)


def test_a_file_in_the_observation_format_needs_no_import(tmp_path):
    path = tmp_path / "mission.nc"
    xr.Dataset({name: ("time", np.zeros(5)) for name in HELPFUL_ORDER}).to_netcdf(path)
    with pytest.raises(InputError, match=r"mission\.nc: is already in the observation format"):
        import_slocum([path], tmp_path / "out.nc")


def test_a_bad_file_is_left_out_alone(tmp_path):
    """A file cut short and one without attitude next to a good one: the rest is imported, the exit status is 1."""
    good = write_netcdf(tmp_path / "good.nc", flight(0))
    lame = write_netcdf(tmp_path / "lame.nc", changed(lambda f: f.pop("m_roll")))
    short = tmp_path / "short.nc"
    short.write_bytes(good.read_bytes()[:3000])
    out = tmp_path / "out" / "mission.nc"
    out.parent.mkdir()
    summary = import_slocum([tmp_path], out)
    assert set(summary.rejected) == {lame.name, short.name}
    assert "has no m_roll (attitude)" in summary.rejected[lame.name]
    assert "is truncated or damaged; copy it again" in summary.rejected[short.name]
    assert len(summary.complete) == 1
    answer = program("import", "slocum", tmp_path, out, "--overwrite")
    assert answer.status == 1
    assert f"{lame.name}: left out: {lame}: has no m_roll (attitude)" in answer.out
    assert answer.out.rstrip().endswith("2 segments or files left out")


def test_bad_sources_are_refused(tmp_path):
    stray, empty = tmp_path / "stray.txt", tmp_path / "empty"
    stray.write_text("")
    empty.mkdir()
    source = write_netcdf(tmp_path / "glider.nc", flight())
    for sources, words in (
        ([tmp_path / "absent"], "no such file or folder"),
        ([stray], "is neither a Slocum record"),
        ([empty], "no flight record found"),
    ):
        with pytest.raises(InputError, match=words):
            import_slocum(sources, tmp_path / "out.nc")
    before = source.read_bytes()
    with pytest.raises(InputError, match="the last argument must be the netCDF file"):
        import_slocum([source], source)
    with pytest.raises(InputError, match="the last argument must be the netCDF file"):
        import_slocum([source], tmp_path / "glider.dbd")
    assert source.read_bytes() == before


def test_the_same_input_gives_the_same_bytes(tmp_path):
    source = write_netcdf(tmp_path / "glider.nc", flight(), science())
    for name in ("a.nc", "b.nc"):
        import_slocum([source], tmp_path / name)
    assert (tmp_path / "a.nc").read_bytes() == (tmp_path / "b.nc").read_bytes()


def test_command_prints_the_summary(tmp_path):
    source = write_netcdf(tmp_path / "glider.nc", two_segments(), science())
    result = CliRunner().invoke(import_, ["slocum", str(source), str(tmp_path / "out.nc")], catch_exceptions=False)
    assert result.exit_code == 0
    assert "900 rows every 4 s" in result.output
    assert "2 profiles, 2 complete, written to" in result.output
    assert "zero: this vehicle does not turn its battery" in result.output
    assert "gliderhpc import slocum from-glider/ mission.nc" in CliRunner().invoke(import_, ["slocum", "--help"]).output


# Binary files


@pytest.fixture
def dbdreader():
    """The optional package that reads them."""
    return pytest.importorskip("dbdreader")


@pytest.fixture
def card(tmp_path, dbdreader):
    """A folder of two segments: flight records whose list of sensors is in a cache file, science records with it."""
    folder = tmp_path / "card"
    folder.mkdir()
    for number in (0, 1):
        name = f"ammonite-2015-175-0-{number}"
        write_binary(folder / f"{name}.dbd", flight(number), name=name, factored=True)
        write_binary(folder / f"{name}.ebd", science(number), name=name, crc="5c1e0ce5")
    return folder


def write_raw_pyglider(folder, flown, sampled):
    """Write the raw files of pyglider: one for each computer, with the units in the attribute ``unit``."""
    folder.mkdir()
    for name, columns in (("dbd", flown), ("ebd", sampled)):
        data = {sensor: ("time", values, {"unit": UNITS[sensor]}) for sensor, values in columns.items()}
        xr.Dataset(data).to_netcdf(folder / f"glider-raw{name}.nc")
    return folder


def test_raw_files_of_pyglider_are_read(tmp_path):
    import_slocum([write_netcdf(tmp_path / "glider.nc", flight(), science())], tmp_path / "one.nc")
    # Its files of the flight computer also have the clock of the science computer, and the other way round.
    flown = flight() | {"sci_m_present_time": flight()["m_present_time"] - 1.0}
    sampled = science() | {"m_present_time": science()["sci_m_present_time"] - 1.0}
    source = write_raw_pyglider(tmp_path / "raw", flown, sampled)
    summary = import_slocum([source], tmp_path / "two.nc")
    assert summary.rejected == {}
    assert "1 flight record" in summary.remarks
    with xr.open_dataset(tmp_path / "one.nc") as one, xr.open_dataset(tmp_path / "two.nc") as two:
        xr.testing.assert_equal(one, two)


def test_records_of_the_science_computer_alone_are_refused(tmp_path):
    source = write_raw_pyglider(tmp_path / "raw", flight(), science())
    (source / "glider-rawdbd.nc").unlink()
    with pytest.raises(InputError, match="records of the science computer only; give the files of the flight computer"):
        import_slocum([source], tmp_path / "out.nc")


@pytest.mark.parametrize(("status", "found"), [(None, "no position"), (1.0, "no valid position at the surface")])
def test_a_mission_without_a_fix_is_imported_with_a_remark(tmp_path, status, found):
    flown = flight()
    if status is None:
        del flown["m_gps_lat"], flown["m_gps_lon"]
    else:
        flown["m_gps_status"] = np.full(len(flown["m_depth"]), status)
    summary = import_slocum([write_netcdf(tmp_path / "glider.nc", flown)], tmp_path / "out.nc")
    assert summary.fixes == 0
    (remark,) = [each for each in summary.remarks if "GPS" in each]
    assert remark.startswith(f"m_gps_lat and m_gps_lon are missing or have {found}, so there are no GPS fixes")


def test_binary_files_say_what_netcdf_says(card, tmp_path):
    """To single precision, in which the glider writes all but time and position; nothing is written next to them."""
    _, expected = imported(tmp_path, two_segments(), joined([science(0), science(1)]))
    held = sorted(path.name for path in card.iterdir())
    summary = import_slocum([card], tmp_path / "binary.nc")
    assert sorted(path.name for path in card.iterdir()) == held
    assert (summary.vehicle, summary.mission) == ("ammonite", "ammonite-2015-175-0-0 to ammonite-2015-175-0-1")
    assert [profile.parts for profile in summary.profiles] == [("ammonite-2015-175-0-0",), ("ammonite-2015-175-0-1",)]
    assert not [line for line in summary.remarks if CUT_SHORT in line]
    with xr.open_dataset(tmp_path / "binary.nc") as dataset:
        assert dataset.attrs["platform_id"] == "ammonite"
        assert dict(dataset.sizes) == dict(expected.sizes)
        for name in expected.data_vars:
            if name != "fix_time":
                np.testing.assert_allclose(dataset[name].values, expected[name].values, rtol=2e-6, atol=2e-6)
        assert (np.abs(dataset["time"].values - expected["time"].values) < np.timedelta64(1, "ms")).all()


def compressed(content):
    """Compress a file as the glider does: blocks with their lengths."""
    block = importlib.import_module("lz4.block")
    pieces = [block.compress(content[i : i + 4096], store_size=False) for i in range(0, len(content), 4096)]
    return b"".join(struct.pack(">H", len(piece)) + piece for piece in pieces)


def test_compressed_files_are_the_same(card, tmp_path):
    import_slocum([card], tmp_path / "plain.nc")
    for path in sorted(card.iterdir()):
        suffix = ".ccc" if path.suffix == ".cac" else f"{path.suffix[:2]}cd"
        path.with_suffix(suffix).write_bytes(compressed(path.read_bytes()))
        path.unlink()
    import_slocum([card], tmp_path / "packed.nc")
    assert (tmp_path / "plain.nc").read_bytes() == (tmp_path / "packed.nc").read_bytes()
    last = sorted(card.glob("*.dcd"))[-1]
    last.write_bytes(last.read_bytes()[:-40])
    summary = import_slocum([card], tmp_path / "cut.nc")
    assert f"{last}: {CUT_SHORT}" in summary.remarks
    assert summary.rejected == {}


def test_the_fullest_record_of_a_segment_is_taken(card, tmp_path):
    sparse = {name: values[::10] for name, values in flight(0).items()}
    write_binary(card / "ammonite-2015-175-0-0.sbd", sparse, name="ammonite-2015-175-0-0", factored=True)
    summary = import_slocum([card], tmp_path / "out.nc")
    assert "2 flight records" in summary.remarks
    assert summary.sample_interval == INTERVAL


def test_another_segment_of_the_same_name_is_refused(card, tmp_path):
    """Short names of cards (01230000.dbd) repeat from deployment to deployment; the second file had been left out."""
    other = tmp_path / "other"
    shutil.copytree(card, other)
    (name, *_) = sorted(path.name for path in card.glob("*.dbd"))
    (other / name).write_bytes((card / name).read_bytes() + b"X")
    with pytest.raises(InputError, match=rf"{name}: has the name of .* and another content"):
        import_slocum([card, other], tmp_path / "out.nc")


def test_a_missing_cache_file_is_named(card, tmp_path):
    cache = card / "0badcafe.cac"
    elsewhere = tmp_path / "state"
    elsewhere.mkdir()
    cache.rename(elsewhere / "0BADCAFE.CAC")
    with pytest.raises(InputError, match=r"0-0.dbd: its cache file 0badcafe.cac is not in .* `cache`"):
        import_slocum([card], tmp_path / "out.nc")
    assert len(import_slocum([card], tmp_path / "out.nc", cache=elsewhere).complete) == 2
    assert set(gliderhpc.import_records(card, cache=str(elsewhere)).profile.values) >= {1, 2}
    with pytest.raises(InputError, match="no such folder; give `cache` the folder"):
        import_slocum([card], tmp_path / "out.nc", cache=tmp_path / "nowhere", overwrite=True)
    name = "ammonite-2015-175-0-2"
    write_binary(card / f"{name}.dbd", flight(2), name=name, crc="11111111")
    summary = import_slocum([card], tmp_path / "out.nc", overwrite=True)
    assert len(summary.rejected) == 2
    assert len(summary.complete) == 1, "the file that lists its own sensors"


def test_a_file_cut_short_gives_what_it_holds(card, tmp_path):
    """The truncated record would be garbage; a truncated header would be read forever."""
    path = card / "ammonite-2015-175-0-1.dbd"
    whole = path.read_bytes()
    expected = import_slocum([card], tmp_path / "whole.nc")
    path.write_bytes(whole[: len(whole) * 3 // 4 + 5])
    summary = import_slocum([card], tmp_path / "out.nc")
    assert f"{path}: {CUT_SHORT}" in summary.remarks
    assert summary.rows < expected.rows
    assert summary.rows_dropped == {}
    with xr.open_dataset(tmp_path / "whole.nc") as dataset, xr.open_dataset(tmp_path / "out.nc") as cut:
        n = cut.sizes["time"]
        np.testing.assert_array_equal(cut["depth"].values, dataset["depth"].values[:n])
    answer = program("import", "slocum", card, tmp_path / "out.nc", "--overwrite")
    assert answer.status == 0
    assert f"{path}: ends before its closing mark" in answer.out
    for size, fault in ((0, "is empty; copy it again"), (8, FOREIGN), (100, CUT_HEADER), (300, CUT_HEADER)):
        path.write_bytes(whole[:size])
        (reason,) = import_slocum([card], tmp_path / "out.nc", overwrite=True).rejected.values()
        assert fault in reason, size


@pytest.mark.parametrize("size", [1, 200, 480, 600, 700])
def test_a_list_of_sensors_cut_short_is_no_list(card, tmp_path, size):
    path = card / "ammonite-2015-175-0-0.dbd"
    content = binary(flight(0), name="ammonite-2015-175-0-0", crc="22222222")
    assert content.index(b"s: T 12") > 700
    path.write_bytes(content[:size])
    summary = import_slocum([card], tmp_path / "out.nc")
    assert set(summary.rejected) == {path.name}
    assert len(summary.complete) == 1


def test_a_broken_cache_file_is_named(card, tmp_path):
    (card / "0badcafe.cac").write_text("s: T 0 0 8 m_present_time timestamp\nnothing\n")
    with pytest.raises(InputError, match=r"0badcafe.cac is truncated or not a list of sensors; copy it again"):
        import_slocum([card], tmp_path / "out.nc")


def test_a_sparse_record_without_attitude_is_named(tmp_path, dbdreader):
    name = "ammonite-2015-175-0-0"
    path = write_binary(tmp_path / f"{name}.sbd", changed(lambda f: f.pop("m_roll")), name=name)
    with pytest.raises(InputError, match=r"0-0.sbd: has no m_roll \(attitude\); give the full record"):
        import_slocum([path], tmp_path / "out.nc")


def test_two_gliders_are_not_mixed(card, tmp_path):
    name = "belemnite-2015-175-0-9"
    write_binary(card / f"{name}.dbd", flight(9), name=name, factored=True)
    with pytest.raises(InputError, match="records of ammonite and of belemnite; import one glider at a time"):
        import_slocum([card], tmp_path / "out.nc")


def test_another_encoding_is_refused(card, tmp_path):
    path = card / "ammonite-2015-175-0-0.dbd"
    path.write_bytes(path.read_bytes().replace(b"encoding_ver:    5", b"encoding_ver:    4"))
    (reason,) = import_slocum([card], tmp_path / "out.nc").rejected.values()
    assert "has encoding 4; only encoding 5 can be read" in reason


def test_without_the_package_one_line_says_how_to_get_it(tmp_path, monkeypatch):
    name = "ammonite-2015-175-0-0"
    path = write_binary(tmp_path / f"{name}.dbd", flight(), name=name)
    monkeypatch.setitem(sys.modules, "dbdreader", None)
    answer = program("import", "slocum", path, tmp_path / "out.nc")
    assert answer.status == 2
    assert "not installed (it is under the GPL)" in answer.line
    assert "pip install 'gliderhpc[slocum]'" in answer.line


def test_positions_that_are_repeated_under_water_are_no_fixes(tmp_path):
    """As `ffill` and synchronised exports write them."""
    flown = joined([flight(0), flight(1)])
    (tmp_path / "as it was").mkdir()
    expected, before = imported(tmp_path / "as it was", flown)
    for name in ("m_gps_lat", "m_gps_lon", "m_gps_status"):
        flown[name] = pd.Series(flown[name]).ffill().to_numpy()
    summary, after = imported(tmp_path, flown)
    assert summary.fixes == expected.fixes
    np.testing.assert_array_equal(after["fix_time"].values, before["fix_time"].values)
    np.testing.assert_array_equal(after["profile"].values, before["profile"].values)


def test_positions_interpolated_under_water_do_not_cut_dives(tmp_path):
    flown = joined([flight(0), flight(1)])
    (tmp_path / "as it was").mkdir()
    _, before = imported(tmp_path / "as it was", flown)
    for name in ("m_gps_lat", "m_gps_lon"):
        flown[name] = pd.Series(flown[name]).interpolate().to_numpy()
    _, after = imported(tmp_path, flown)
    np.testing.assert_array_equal(np.unique(after["profile"].values), np.unique(before["profile"].values))


def test_longitudes_may_be_counted_from_0_to_360(tmp_path):
    """As files of ocean models and some exports do."""
    flown = two_segments()
    (tmp_path / "as it was").mkdir()
    expected, before = imported(tmp_path / "as it was", flown)
    whole = np.trunc(flown["m_gps_lon"] / 100.0)
    flown["m_gps_lon"] = whole + (flown["m_gps_lon"] - 100.0 * whole) / 60.0 + 360.0
    summary, after = imported(tmp_path, flown, units={"m_gps_lon": "degrees_east"})
    assert summary.fixes == expected.fixes
    np.testing.assert_allclose(after["fix_longitude"].values, before["fix_longitude"].values + 360.0)


def test_a_lake_has_a_salinity_and_a_wet_sensor_in_the_air_has_none(tmp_path):
    sampled = science()
    sampled["sci_water_cond"][:20] = 0.03
    (tmp_path / "sea").mkdir()
    _, sea = imported(tmp_path / "sea", flight(), sampled)
    known = sea["practical_salinity"].values[np.isfinite(sea["practical_salinity"].values)]
    assert known.min() > 30.0
    lake = science()
    lake["sci_water_cond"] *= 0.0066
    _, found = imported(tmp_path, flight(), lake)
    assert 0.1 < float(found["practical_salinity"].median()) < 0.3


# A real mission ------------------------------------------------------------------------------------------------------


def test_modena(shared_data, tmp_path):
    """Decoded record of twenty days: all profiles, and plausible depth and controls."""
    summary = import_slocum([shared_data / "slocum-modena-2015"], tmp_path / "out.nc")
    assert (len(summary.profiles), len(summary.complete)) == (121, 119)
    assert {profile.number for profile in summary.profiles if profile.fault} == {1, 2}
    assert all("battery_position is missing" in profile.fault for profile in summary.profiles[:2])
    assert summary.sample_interval == pytest.approx(4.38, abs=0.01)
    assert (summary.fixes, summary.fixes_dropped) == (3665, 6)
    assert (summary.rows, summary.ctd_samples) == (353_321, 344_229)
    assert summary.rows_dropped == {
        "measurements of a delayed cycle of the computer": 863,
        "science: sci_water_cond out of range": 68,
    }
    assert summary.rejected == {}
    with open_observations(tmp_path / "out.nc") as observations:
        assert set(observations.faults) == {1, 2}
        records = [observations.profile(number) for number in (20, 60, 100)]
    for record in records:
        assert record.entry_fix is not None
        assert record.exit_fix is not None
        assert record.entry_fix.latitude == pytest.approx(27.4, abs=0.3)
        assert record.entry_fix.longitude == pytest.approx(-90.7, abs=0.3)
        measured = np.isfinite(record.depth) & np.isfinite(record.pitch)
        rate = np.gradient(record.depth[measured], record.time[measured])
        assert np.abs(rate).max() < 0.6
        assert np.corrcoef(rate, record.pitch[measured])[0, 1] < -0.9, "nose down goes down"
        assert np.corrcoef(record.ballast_volume, record.battery_position)[0, 1] < -0.9
        # The rudder leads: a positive one turns to starboard.
        turning = np.gradient(np.unwrap(record.heading[measured]), record.time[measured])
        assert np.corrcoef(record.rudder[measured], turning)[0, 1] > 0.3


def test_modena_raw(shared_data, tmp_path, dbdreader):
    """Two of its segments as the glider wrote them; the first is also in the decoded file."""
    summary = import_slocum([shared_data / "slocum-modena-2015" / "raw"], tmp_path / "raw.nc")
    assert summary.vehicle == "modena"
    assert [profile.parts for profile in summary.complete] == [("modena-2015-175-0-2",), ("modena-2015-191-0-40",)]
    assert (summary.rows, summary.fixes) == (6194, 47)
    assert not [line for line in summary.remarks if CUT_SHORT in line]
    import_slocum([shared_data / "slocum-modena-2015"], tmp_path / "decoded.nc")
    with xr.open_dataset(tmp_path / "raw.nc") as raw, xr.open_dataset(tmp_path / "decoded.nc") as decoded:
        first = raw.isel(time=raw["profile"].values == 1)
        same = decoded.sel(time=first["time"].values, method="nearest")
        assert (np.abs(same["time"].values - first["time"].values) < np.timedelta64(1, "ms")).all()
        for name in ("depth", "pitch", "heading", "ballast_volume", "rudder"):
            np.testing.assert_allclose(first[name].values, same[name].values, rtol=1e-5, atol=1e-5)
