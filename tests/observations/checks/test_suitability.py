"""Files of other programs: recognised, read for currents, or refused in one line that names the missing variables."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support import seaglider_files as made
from support.glides import Glide, mission
from support.missions import program

import gliderhpc as gh
from gliderhpc.observations.checks.suitability import CURRENT_TERMS
from gliderhpc.observations.files.columns import FACTORS
from gliderhpc.observations.format import read_reference
from gliderhpc.observations.instruments.og1 import import_og1

GLIDE = Glide()


def _table(records: xr.Dataset, path: Path, *, units_in_heads: bool) -> Path:
    """Write samples with a position each as ERDDAP gives them as text."""
    at, samples = records["fix_time"].values.astype(float), records["time"].values.astype(float)
    columns = {
        "time": ("UTC", np.char.add(np.datetime_as_string(records["time"].values, unit="ms"), "Z")),
        "latitude": ("degrees_north", np.interp(samples, at, records["fix_latitude"].values)),
        "longitude": ("degrees_east", np.interp(samples, at, records["fix_longitude"].values)),
        **{name: (unit, records[name].values) for name, unit in
           (("depth", "m"), ("pitch", "degrees"), ("heading", "degrees"))},
    }  # fmt: skip
    heads = [f"{name} ({unit})" if units_in_heads else name for name, (unit, _) in columns.items()]
    rows = [heads] if units_in_heads else [heads, [unit for unit, _ in columns.values()]]
    rows += [[str(value) for value in row] for row in zip(*(values for _, values in columns.values()), strict=True)]
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


@pytest.mark.parametrize("units_in_heads", [True, False], ids=["csvp", "csv"])
def test_a_table_of_erddap_gives_the_current_of_its_netcdf(tmp_path, units_in_heads):
    records = mission(GLIDE)
    found = gh.currents(_table(records, tmp_path / "mission.csv", units_in_heads=units_in_heads))
    np.testing.assert_allclose(found["dac_north"], GLIDE.current[0], atol=0.02)
    np.testing.assert_allclose(found["dac_east"], GLIDE.current[1], atol=0.02)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,depth\n", "the row of units is missing"),
        ("time,depth\nUTC,m\n2020-01-01T00:00:00Z,1\n2020-01-01T00:00:09Z,deep\n", "depth in row 2 .* 'deep'"),
        ("time,depth\nUTC,m\nyesterday,1\n", "time has a time that is not in ISO 8601 format"),
        (
            "time,depth\n2020-01-01T00:00:00Z,1\n2020-01-01T00:00:09Z,2\n",
            "time is '2020-01-01T.* insert a row of units",
        ),
        ("depth,name\n1.5,a\n2,b\n", "depth is '1.5'.* insert a row of units, such as UTC, degrees_north, m"),
        ("", "is empty; copy it again"),
    ],
)
def test_a_faulty_table_takes_one_line(tmp_path, text, words):
    path = tmp_path / "mission.csv"
    path.write_text(text)
    with pytest.raises(gh.InputError, match=words):
        gh.currents(path)


def _written(dataset: xr.Dataset, path: Path) -> Path:
    dataset.to_netcdf(path)
    return path


def test_a_file_that_cannot_be_inverted_says_what_it_lacks_for_what(tmp_path):
    column = ("time", np.zeros(3))
    path = _written(xr.Dataset({"time": column, "depth": column, "lat": column, "lon": column}), tmp_path / "plain.nc")
    done = program("import", "any", path, tmp_path / "out.nc")
    assert done.status == 2
    assert "currents lack pitch, heading; the inversion lacks ballast volume, roll, pitch, heading" in done.err
    path = _written(mission(GLIDE).drop_vars("ballast_volume", errors="ignore"), tmp_path / "light.nc")
    done = program("import", "any", path, tmp_path / "out.nc")
    assert "`gliderhpc currents` reads it without conversion; the inversion lacks ballast volume" in done.err


def test_the_flight_model_of_an_og1_file_is_stored_as_reference(tmp_path):
    path = tmp_path / "sg099.nc"
    made.write_og1(path)
    with netCDF4.Dataset(path, "a") as file:
        for name, unit, value in (("MASS", "g", 52_000.0), ("VOLMAX", "m3", 0.0518), ("HD_A", "", 0.0038)):
            variable = file.createVariable(name, "f8", ())
            variable.units, variable[...] = unit, value
    import_og1([path], tmp_path / "out.nc")
    reference = read_reference(tmp_path / "out.nc")
    for name, value in (("reference_mass", 52.0), ("reference_maximum_volume", 51_800.0), ("reference_lift", 0.0038)):
        np.testing.assert_allclose(reference[name], value, rtol=1e-12)
    assert np.isnan(reference["reference_drag"]).all()


def test_quantities_have_units_that_can_be_converted():
    assert {term.unit for term in CURRENT_TERMS.values()} <= set(FACTORS)
