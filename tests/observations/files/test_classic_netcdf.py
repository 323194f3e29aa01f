"""Truncated classic netCDF files, which the library reads as zeros, are refused."""

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import observation_files
from support.missions import program

from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.classic_netcdf import missing_bytes
from gliderhpc.observations.files.foreign import ForeignFile

FORMATS = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")


def write(path, form, records):
    """A file with attributes, a scalar, strings, values of unusual size, and record variables by number of records."""
    with netCDF4.Dataset(path, "w", format=form) as file:
        file.createDimension("row", 7)
        file.createDimension("letter", 3)
        file.createDimension("record", None)
        file.setncatts({"title": "odd", "numbers": np.arange(5, dtype="i2")})
        file.createVariable("single", "f8", ())[...] = 3.0
        variable = file.createVariable("text", "S1", ("row", "letter"))
        variable.units = "none"
        variable[:] = np.full((7, 3), b"a")
        file.createVariable("short", "i2", ("row",))[:] = np.arange(7)
        for name, count in records.items():
            file.createVariable(name, "i2", ("record", "letter"))[:count] = np.ones((count, 3))
    return path


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("records", [{}, {"a": 0}, {"a": 5}, {"a": 5, "b": 5}], ids=["none", "empty", "one", "two"])
def test_a_whole_file_lacks_nothing_and_a_cut_one_what_was_cut(tmp_path, form, records):
    path = write(tmp_path / "a.nc", form, records)
    whole = path.read_bytes()
    assert missing_bytes(path) == 0
    path.write_bytes(whole[:-8])
    # The end of the last value may be padded by up to 3 bytes.
    assert 5 <= missing_bytes(path) <= 8
    path.write_bytes(whole[:40])
    assert missing_bytes(path) == 0


def test_other_files_lack_nothing(tmp_path):
    for content in (b"", b"CDF", b"CDF\x09", b"\x89HDF\r\n", b"text"):
        (tmp_path / "a.nc").write_bytes(content)
        assert missing_bytes(tmp_path / "a.nc") == 0


@pytest.mark.parametrize("version", [1, 2, 5])
def test_a_damaged_header_is_left_to_the_library(tmp_path, version):
    rng = np.random.default_rng(version)
    path = write(tmp_path / "a.nc", FORMATS[(1, 2, 5).index(version)], {"a": 5, "b": 5})
    whole = path.read_bytes()
    for _ in range(300):
        content = bytearray(whole)
        for place in rng.integers(4, 400, 6):
            content[place] = rng.choice([0, 1, 127, 255])
        path.write_bytes(content)
        assert missing_bytes(path) >= 0


def test_every_reader_refuses_a_cut_file_in_one_line(tmp_path):
    with xr.open_dataset(observation_files.write(tmp_path), decode_times=False) as dataset:
        records = dataset.load()
    path = tmp_path / "a.nc"
    records.to_netcdf(path, format="NETCDF3_64BIT", encoding={name: {} for name in records.variables})
    with open_observations(path) as whole:
        assert whole.faults == {}
    path.write_bytes(path.read_bytes()[:-4000])
    words = r"a.nc: is truncated, its last \d+ bytes are missing; copy it again"
    with pytest.raises(InputError, match=words):
        open_observations(path)
    with pytest.raises(InputError, match=words):
        ForeignFile(path)
    answer = program("currents", path, tmp_path / "out.nc")
    assert (answer.status, "is truncated" in answer.line) == (2, True)
    answer = program("import", "slocum", path, tmp_path / "out.nc")
    assert (answer.status, "is truncated" in answer.line) == (2, True)
