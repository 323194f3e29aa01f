"""Values outside the limits that a file declares (valid_min, valid_max, valid_range) are missing, by CF."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support import seaglider_files as made
from support.glides import Glide, mission
from support.slocum_files import flight, write_netcdf

from gliderhpc.api.currents import currents
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.foreign import ForeignFile
from gliderhpc.observations.in_memory import opened_records
from gliderhpc.observations.in_memory import read_records as open_records
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaglider import import_seaglider
from gliderhpc.observations.instruments.slocum import import_slocum

SAMPLE = observation_files.first_sample(2) + 50


def limited_file(folder, value=60.0, **limits):
    def edit(dataset):
        dataset["depth"][SAMPLE] = value
        dataset["depth"].attrs |= limits

    return observation_files.edited(folder, edit)


@pytest.mark.parametrize("limits", [{"valid_max": 55.0}, {"valid_range": [-5.0, 55.0]}, {"valid_min": -5.0}])
def test_values_of_an_observation_file_outside_its_limits_are_missing_with_a_remark(tmp_path, limits):
    path = limited_file(tmp_path, -7.0 if "valid_min" in limits else 60.0, **limits)
    with open_observations(path) as observations:
        (remark,) = observations.warnings
        depth = observations.profile(2).depth
    assert f"in 1 of 1230 samples, the first {-7 if 'valid_min' in limits else 60} at sample {SAMPLE}; these" in remark
    assert remark.startswith("depth is outside the limits that the file declares, ")
    assert np.flatnonzero(np.isnan(depth)).tolist() == [50]
    records = open_records(path)
    assert np.isnan(records["depth"].values[SAMPLE])
    with opened_records(records.assign_attrs(mission="changed")) as observations:
        assert np.isnan(observations.profile(2).depth[50])


def test_limits_that_exclude_most_values_are_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"edited.nc: depth is outside the limits .*, 0 to 10, in .*; correct valid_min"
    ):
        open_observations(limited_file(tmp_path, valid_range=[0.0, 10.0]))


def test_limits_that_cannot_be_used_change_nothing(tmp_path):
    for limits in ({"valid_max": "55"}, {"valid_range": [55.0]}, {"valid_range": [1.0, 1.0]}):
        with open_observations(limited_file(tmp_path, **limits)) as observations:
            assert observations.warnings == ()


@pytest.mark.parametrize(("limit", "kind"), [(5500, np.int16), (55.0, np.float64)])
def test_limits_of_packed_values_are_packed_if_they_are_integers(tmp_path, limit, kind):
    with xr.open_dataset(limited_file(tmp_path, valid_max=kind(limit)), decode_times=False) as stored:
        dataset = stored.load()
    packing = {"dtype": "i2", "scale_factor": 0.01, "add_offset": 0.0, "_FillValue": -32768}
    dataset.to_netcdf(tmp_path / "packed.nc", encoding={"depth": packing})
    records = open_records(tmp_path / "packed.nc")
    assert np.flatnonzero(np.isnan(records["depth"].values)).tolist() == [SAMPLE]
    with ForeignFile(tmp_path / "packed.nc") as file:
        assert np.flatnonzero(np.isnan(file.numbers("depth"))).tolist() == [SAMPLE]


def test_currents_count_the_values_outside_the_limits():
    records, expected = mission(Glide()), currents(mission(Glide()))
    records["heading"][5:9] = 300.0
    records["heading"].attrs["valid_max"] = 250.0
    found = currents(records)
    assert "heading is outside the limits that the file declares, at most 250, in 4 of " in found.attrs["comment"]
    np.testing.assert_allclose(found["dac_east"], expected["dac_east"], atol=1e-9)
    records["heading"].attrs["valid_max"] = 10.0
    with pytest.raises(InputError, match="heading is outside the limits"):
        currents(records)


def test_importers_count_the_values_outside_the_limits(tmp_path, caplog):
    path = made.write_og1(tmp_path / "og1.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["PITCH"][60:63] = 70.0
        file["PITCH"].setncatts({"valid_min": -60.0, "valid_max": 60.0})
    (remark,) = import_og1([path], tmp_path / "out.nc").remarks
    assert "og1.nc: PITCH is outside the limits that the file declares, -60 to 60, in 3 of " in remark
    dive = made.write_dive(tmp_path / "sg", 1, columns=True)
    with netCDF4.Dataset(dive, "a") as file:
        file["eng_pitchAng"][30] = 70.0
        file["eng_pitchAng"].valid_max = 60.0
    summary = import_seaglider([dive.parent], tmp_path / "sg.nc")
    assert any("eng_pitchAng is outside the limits that the file declares" in remark for remark in summary.remarks)
    slocum = write_netcdf(tmp_path / "slocum.nc", flight())
    with netCDF4.Dataset(slocum, "a") as file:
        file["m_pitch"].valid_max = 1e-3 + np.sort(file["m_pitch"][:].compressed())[-3]
        file["m_pitch"][30] = 1.2
    import_slocum([slocum], tmp_path / "slocum-out.nc")
    assert "m_pitch is outside the limits that the file declares" in caplog.text
