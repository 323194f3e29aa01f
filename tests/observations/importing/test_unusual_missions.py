"""Unusual but plausible missions: counters, clocks, controls and empty files."""

import gzip
import logging

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support import seaglider_files as made
from support.glides import Glide, mission
from support.missions import program
from support.seaexplorer_files import write_mission
from support.slocum_files import flight, write_netcdf

from gliderhpc.api.currents import currents
from gliderhpc.api.records import kind_of
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.tables import read_table
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.slocum import import_slocum

ROWS = 2 * len(made.og1_rows(1)["TIME"])


@pytest.mark.parametrize(("number", "what"), [(1.0, "is always 1"), (7.0, "is always 7"), (np.nan, "has no value")])
def test_a_dive_counter_that_does_not_count_is_not_used(tmp_path, number, what):
    """Two dives had been one profile, or none."""
    path = made.write_og1(tmp_path / "a.nc", divenum=np.full(ROWS, number))
    summary = import_og1([path], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1, 2]
    assert summary.remarks == (f"a.nc: its dive counter {what}: the dives are detected from depth",)


def test_the_counter_of_a_single_dive_is_used(tmp_path):
    summary = import_og1([made.write_og1(tmp_path / "a.nc", (7,))], tmp_path / "out.nc")
    assert ([profile.number for profile in summary.complete], summary.remarks) == ([7], ())


@pytest.mark.parametrize(("name", "what"), [("PITCH_CTL", "battery_position"), ("ROLL_CTL", "battery_rotation")])
def test_a_battery_control_without_any_value_is_absent(tmp_path, name, what):
    summary = import_og1([made.write_og1(tmp_path / "a.nc", **{name: np.full(ROWS, np.nan)})], tmp_path / "out.nc")
    assert len(summary.complete) == 2
    assert summary.remarks[0].startswith(f"a.nc: has no {what}: taken as zero")


def test_rows_of_a_clock_that_was_not_set_are_named(tmp_path):
    """A dive had been lost without a word."""
    time = np.concatenate([made.og1_rows(dive)["TIME"] for dive in (1, 2)])
    time[ROWS // 2 :] = 315_532_800.0 + 10.0 * np.arange(ROWS // 2)
    summary = import_og1([made.write_og1(tmp_path / "a.nc", TIME=time)], tmp_path / "out.nc")
    assert [profile.number for profile in summary.complete] == [1]
    assert summary.remarks[0] == (
        f"a.nc: TIME is not between 2000 and 2099 in {ROWS // 2} rows, the first at row {ROWS // 2}; these are left "
        "out: correct the clock or the unit of time"
    )


def test_a_file_without_rows_says_so(tmp_path):
    path = made.write_og1(tmp_path / "a.nc")
    with xr.open_dataset(path, decode_times=False) as dataset:
        dataset.load().isel(N_MEASUREMENTS=[]).to_netcdf(tmp_path / "empty.nc", unlimited_dims=["N_MEASUREMENTS"])
    with pytest.raises(InputError, match=r"empty.nc: has no rows \(TIME is empty\)"):
        import_og1([tmp_path / "empty.nc"], tmp_path / "out.nc")
    slocum = write_netcdf(tmp_path / "slocum.nc", {name: values[:0] for name, values in flight().items()})
    with pytest.raises(InputError, match=r"slocum.nc: no usable flight record \(it has no rows\)"):
        import_slocum([slocum], tmp_path / "out.nc")


def test_an_empty_file_of_a_seaexplorer_is_called_so(tmp_path):
    folder = write_mission(tmp_path / "m")
    empty = folder / "sea099.3.gli.sub.6"
    empty.write_text("")
    summary = import_seaexplorer([folder], tmp_path / "out.nc")
    assert summary.rejected == {"cycle 6": f"{empty}: is empty; copy it again"}


def test_a_single_row_has_no_interval(tmp_path):
    path = write_netcdf(tmp_path / "a.nc", {name: values[:1] for name, values in flight().items()})
    answer = program("import", "slocum", path, tmp_path / "out.nc")
    assert answer.status == 1
    assert "1 row, 0 with CTD; dropped: none" in answer.out


def test_a_slocum_s_clock_that_was_set_back_by_days_is_named(tmp_path, caplog):
    flown = flight()
    flown["m_present_time"][225:] -= 100 * 86_400.0
    with caplog.at_level(logging.WARNING):
        import_slocum([write_netcdf(tmp_path / "a.nc", flown)], tmp_path / "out.nc")
    assert "a.nc: the clock was set back by 8639996 s; the times before or after that are wrong" in caplog.text


def test_a_slocum_s_pitch_in_another_unit_than_declared_is_refused(tmp_path):
    """It had been called missing."""
    flown = flight()
    flown["m_pitch"] = np.degrees(flown["m_pitch"]) + np.sin(np.arange(len(flown["m_pitch"])))
    words = r"a.nc: m_pitch is outside -89.9 to 89.9 degree in .* of 450 samples, .*; convert it, or set its units to"
    with pytest.raises(InputError, match=words):
        import_slocum([write_netcdf(tmp_path / "a.nc", flown)], tmp_path / "out.nc")


def test_a_compressed_file_of_any_kind_is_called_so(tmp_path):
    path = tmp_path / "a.nc.gz"
    path.write_bytes(gzip.compress(made.write_og1(tmp_path / "a.nc").read_bytes()))
    with pytest.raises(InputError, match=r"a.nc.gz: is gzip-compressed; unpack it first \(gunzip\)"):
        kind_of([path])


def test_a_depth_in_decibars_is_called_a_pressure(tmp_path):
    path = made.write_og1(tmp_path / "a.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["DEPTH"].units = "dbar"
    with pytest.raises(InputError, match=r"DEPTH is in 'dbar', .*; it is a pressure, not a depth: name it so"):
        import_og1([path], tmp_path / "out.nc")


def test_a_pitch_without_any_value_is_named():
    records = mission(Glide())
    with pytest.raises(InputError, match="dataset: pitch has no value that is possible for a glider"):
        currents(records.assign(pitch=records["pitch"].where(False)))


def test_a_single_impossible_depth_is_counted_as_one():
    records = mission(Glide())
    depth = records["depth"].values.copy()
    depth[10] = 900.0
    found = currents(records.assign(depth=("time", depth, records["depth"].attrs)))
    assert "1 depth that no glider can have reached from those before and after it is left" in found.attrs["comment"]


def test_times_without_a_unit_are_named():
    records = mission(Glide())
    seconds = (records["time"].values - records["time"].values[0]) / np.timedelta64(1, "s")
    with pytest.raises(InputError, match="time has no units, so it is taken as seconds since 1970-01-01: declare its"):
        currents(records.drop_vars("time").assign(time=("time", seconds)))


def test_a_negative_depth_of_an_observation_file_is_called_so(tmp_path):
    path = observation_files.edited(tmp_path, lambda records: records.assign(depth=-records["depth"].assign_attrs()))
    with xr.open_dataset(path, decode_times=False) as stored:
        stored.load()["depth"].attrs["units"] = "m"
        stored.to_netcdf(tmp_path / "up.nc")
    with open_observations(tmp_path / "up.nc") as found:
        fault = "profile 1: depth is negative under water (-10.1394 m at sample 36); make it positive down"
        assert found.faults[1] == fault


TABLE = "time,depth\nUTC,m\n2024-05-01T00:00:00Z,1.0\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty; copy it again"),
        (gzip.compress(TABLE.encode(), mtime=0), r"is gzip-compressed; unpack it first \(gunzip\)"),
        (TABLE.replace("m", "°").encode("latin-1"), "is not UTF-8 text; convert its encoding"),
        (f"# by a program\n{TABLE}".encode(), "begins with a comment; remove it"),
        (b"time;depth\nUTC;m\n2024-05-01T00:00:00Z;1,0\n", "its columns are separated by semicolons; write it with"),
        (f"{TABLE}2024-05-01T00:00:01Z,1.0,3,4\n".encode(), "line 4 has 4 columns instead of 2; correct it"),
        (f"{TABLE}2024-05-01T00:00:01Z,{'x' * 500}\n".encode(), r"depth in row 2 of the values is 'x+\.\.\.x+', which"),
    ],
)
def test_a_table_that_is_none_is_called_what_it_is(tmp_path, content, words):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_table(tmp_path / "a.csv")


def test_usual_words_for_missing_values_of_a_table_are_read(tmp_path):
    rows = "2024-05-01T00:00:01Z,NA\nNA,null\n2024-05-01T00:00:03Z,n/a\n"
    (tmp_path / "a.csv").write_text(TABLE + rows)
    found = read_table(tmp_path / "a.csv")
    np.testing.assert_array_equal(found["depth"], [1.0, np.nan, np.nan, np.nan])
    assert np.isnat(found["time"].values).tolist() == [False, False, True, False]


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "is empty; copy"), (gzip.compress(b"dbd", mtime=0), "is gzip-compressed")]
)
def test_a_binary_file_of_a_slocum_that_is_none_is_called_what_it_is(tmp_path, content, words):
    pytest.importorskip("dbdreader")
    (tmp_path / "a.dbd").write_bytes(content)
    with pytest.raises(InputError, match=words):
        import_slocum([tmp_path / "a.dbd"], tmp_path / "out.nc")
