"""Undeclared fill values are missing values, never measurements."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support import seaglider_files as made
from support.glides import Glide, mission

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.in_memory import read_records
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.times import decode_times

FILLS = (99999.0, -999.0, -9999.0, 9.96921e36)
HOLE = slice(60, 64)
COLUMNS = {
    "PITCH": "pitch",
    "ROLL": "roll",
    "HEADING": "heading",
    "DEPTH": "depth",
    "VBD_CC": "ballast_volume",
    "PITCH_CTL": "battery_position",
    "TEMP": "temperature",
}


def imported(tmp_path, name, values, rows=HOLE):
    """Summary and samples of a file with some values of one variable replaced."""
    path = made.write_og1(tmp_path / "sg099_delayed.nc")
    with netCDF4.Dataset(path, "a") as file:
        file[name][rows] = values
    summary = import_og1([path], tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as dataset:
        return summary, dataset.load()


@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("name", COLUMNS)
def test_an_undeclared_fill_is_missing_with_a_remark(tmp_path, name, fill):
    summary, found = imported(tmp_path, name, fill)
    assert [profile.fault for profile in summary.profiles] == [None, None]
    (remark,) = summary.remarks
    assert remark.startswith(f"sg099_delayed.nc: {name} ")
    assert "in 4 samples" in remark
    assert "at sample 60; these are treated as missing: declare its fill value" in remark
    assert int(np.isnan(found[COLUMNS[name]].values).sum()) == 4 + 2 * (name == "TEMP")
    with open_observations(tmp_path / "out.nc") as observations:
        assert observations.faults == {}


@pytest.mark.parametrize("fill", FILLS)
def test_fills_in_the_rows_of_the_fixes_make_no_samples(tmp_path, fill):
    """If the file declares no fill value, every row without a sensor contains the library's."""
    rows = np.concatenate([made.og1_rows(dive)["PITCH"] for dive in (1, 2)])
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        for name in ("PITCH", "ROLL", "HEADING"):
            file[name][np.flatnonzero(np.isnan(rows))] = fill
    summary = import_og1([path], tmp_path / "out.nc")
    assert summary.rows == np.count_nonzero(np.isfinite(rows))
    assert [profile.fault for profile in summary.profiles] == [None, None]


@pytest.mark.parametrize("fill", [-999.0, 99999.0])
def test_fills_in_the_rows_without_a_fix_are_no_positions(tmp_path, fill):
    rows = np.concatenate([made.og1_rows(dive)["LATITUDE_GPS"] for dive in (1, 2)])
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        for name in ("LATITUDE_GPS", "LONGITUDE_GPS"):
            file[name][np.flatnonzero(np.isnan(rows))] = fill
    summary = import_og1([path], tmp_path / "out.nc")
    assert (summary.fixes, summary.fixes_dropped) == (6, 0)


SEAGLIDER_COLUMNS = {
    "eng_pitchAng": "pitch",
    "eng_rollAng": "roll",
    "depth": "depth",
    "eng_vbdCC": "ballast_volume",
    "temperature": "temperature",
}


@pytest.mark.parametrize("fill", [-999.0, 9.96921e36])
@pytest.mark.parametrize("name", SEAGLIDER_COLUMNS)
def test_undeclared_fills_of_a_seaglider_are_missing_and_counted(tmp_path, name, fill):
    """Recentred, a volume of -999 cm3 would be another plausible one."""
    for dive in (1, 2):
        path = made.write_dive(tmp_path / "m", dive, columns=True, centres=(2400.0, 2300.0, 3000.0 + 40.0 * dive))
        with netCDF4.Dataset(path, "a") as file:
            file[name][HOLE] = fill
    summary = import_seaglider([tmp_path / "m"], tmp_path / "out.nc")
    assert [profile.fault for profile in summary.profiles] == [None, None]
    assert summary.remarks == (
        f"2 dives from 1 to 2: {name} is impossible, or a usual fill value, in 8 samples; these are treated as "
        "missing: declare its fill value (_FillValue)",
    )
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert int(np.isnan(found[SEAGLIDER_COLUMNS[name]].values).sum()) == 8


def test_a_depth_in_centimetres_may_be_9999(tmp_path):
    path = made.write_og1(tmp_path / "sg099.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["DEPTH"][:] = 100.0 * file["DEPTH"][:]
        file["DEPTH"][66] = 9999.0
        file["DEPTH"].units = "cm"
    summary = import_og1([path], tmp_path / "out.nc")
    assert (len(summary.complete), summary.remarks) == (2, ())


def test_many_different_impossible_values_are_in_another_unit(tmp_path):
    """Tenths of a degree: no heading is right, and no other angle is taken out."""
    count = 2 * (2 * (made.AFLOAT + made.HALF) + 3)
    tenths = np.linspace(0.0, 3599.0, count)
    with pytest.raises(InputError, match=r"HEADING is outside -181 to 361 degree in .*; convert it, or set its units"):
        imported(tmp_path, "HEADING", tenths, slice(None))
    summary, _ = imported(tmp_path, "ROLL", tenths, slice(None))
    assert all("roll is" in profile.fault for profile in summary.profiles)


def test_a_heading_that_is_a_fill_throughout_is_missing(tmp_path):
    with pytest.raises(InputError, match="has no sample of heading"):
        imported(tmp_path, "HEADING", 655.35, slice(None))


def test_a_roll_that_is_impossible_throughout_is_named_with_its_value(tmp_path):
    summary, _ = imported(tmp_path, "ROLL", 655.35, slice(None))
    assert all("roll is 655.35 degree" in profile.fault for profile in summary.profiles)


@pytest.mark.parametrize(("name", "fill"), [("depth", 9999.0), ("ballast_volume", -999.0), ("ballast_volume", 9999.0)])
def test_an_undeclared_fill_within_the_plausible_range_is_missing_in_an_observation_file(tmp_path, name, fill):
    def edit(dataset):
        dataset[name][500:530] = fill

    path = observation_files.edited(tmp_path, edit)
    with open_observations(path) as observations:
        assert observations.faults == {}
        (remark,) = observations.warnings
        assert int(np.isnan(getattr(observations.profile(2), name)).sum()) == 30
    assert remark == (
        f"{name} has a usual fill value in 30 samples, the first {fill:g} at sample 500; these are treated as missing: "
        "declare its fill value"
    )
    assert int(np.isnan(read_records(path)[name].values).sum()) == 30


def test_a_negative_fill_is_no_time_since_a_recent_day(tmp_path):
    """Half an hour before the reference is a plausible time, so the clock seemed to have been set back."""

    def edit(dataset):
        assert (dataset["time"] >= 0.0).all()
        dataset = dataset.reset_index("time") if "time" in dataset.indexes else dataset
        time = dataset["time"].values.copy()
        time[500] = -999.0
        return dataset.assign_coords(time=("time", time, dataset["time"].attrs))

    with open_observations(observation_files.edited(tmp_path, edit)) as observations:
        assert observations.faults == {}
        (remark,) = observations.warnings
    assert remark.startswith("time is not between 2000 and 2099 in 1 sample, the first at sample 500: left out")


def test_negative_times_that_run_through_a_fill_value_remain():
    times = decode_times(np.arange(-1001.0, -990.0), "seconds since 2024-05-01", "", "time")
    assert not times.implausible.any()


def test_a_fill_value_is_no_depth_of_a_current():
    records, expected = mission(Glide()), currents(mission(Glide()))
    records["depth"][300:340] = 9999.0
    found = currents(records)
    assert "depth has a usual fill value in 40 samples, the first 9999 at sample 300" in found.attrs["comment"]
    np.testing.assert_allclose(found["dac_east"], expected["dac_east"], atol=0.01)
    np.testing.assert_allclose(found["max_depth"], expected["max_depth"])
