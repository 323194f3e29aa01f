"""Files for other people: discovery attributes, and the IOOS compliance checker where it is installed."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.glides import Glide, mission
from support.missions import program

CHECKER = shutil.which(
    "compliance-checker", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
)
needs_checker = pytest.mark.skipif(
    CHECKER is None, reason="the program compliance-checker (extra compliance) is not installed"
)

DEPLOYMENT = "creator_name: A. Name\nlicense: CC-BY-4.0\ncontributor_name: A. Name\n"
WANTED = {
    "Conventions", "title", "summary", "keywords", "id", "history", "source", "standard_name_vocabulary",
    "processing_level", "date_created", "time_coverage_start", "time_coverage_end", "time_coverage_duration",
    "time_coverage_resolution", "geospatial_bounds",
    "geospatial_lat_min", "geospatial_lat_max", "geospatial_lon_min", "geospatial_lon_max", "geospatial_vertical_min",
    "geospatial_vertical_max", "geospatial_vertical_positive", "creator_name", "license",
}  # fmt: skip
"""Attributes by which a data centre finds a file (ACDD 1.3)."""


@pytest.fixture
def deployment(tmp_path):
    (tmp_path / "deployment.yaml").write_text(DEPLOYMENT)
    return tmp_path / "deployment.yaml"


def _checked(path):
    """See that a file can be found, that every variable says what it holds, and that its extent is its own."""
    with xr.open_dataset(path) as content:
        assert set(content.attrs) >= WANTED
        assert content.attrs["license"] == "CC-BY-4.0"
        assert "ACDD-1.3" in content.attrs["Conventions"]
        assert " " not in content.attrs["id"]
        lacking = [
            name for name, variable in content.variables.items()
            if variable.ndim and not name.endswith("_bounds") and "coverage_content_type" not in variable.attrs
        ]  # fmt: skip
        assert lacking == []
        latitude = content["latitude" if "latitude" in content.variables else "LATITUDE"].values
    assert content.attrs["geospatial_lat_min"] == pytest.approx(np.nanmin(latitude), abs=1e-6)
    assert content.attrs["geospatial_lat_max"] == pytest.approx(np.nanmax(latitude), abs=1e-6)


def test_light_currents_can_be_found(deployment, tmp_path):
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    answer = program("currents", tmp_path / "records.nc", tmp_path / "out.nc", "--deployment", deployment)
    assert answer.status == 0, answer.err
    _checked(tmp_path / "out.nc")


@pytest.mark.compiled
def test_exports_can_be_found(brief_store, deployment, tmp_path):
    shutil.copytree(brief_store, tmp_path / "m.zarr")
    assert program("analyze", tmp_path / "m.zarr", "currents", "--workers", 0).status == 0
    for name, *kind in (("og1", "og1"), ("strict", "og1", "--community"), ("currents", "currents")):
        answer = program("export", *kind, tmp_path / "m.zarr", tmp_path / f"{name}.nc", "--deployment", deployment)
        assert answer.status == 0, answer.err
        _checked(tmp_path / f"{name}.nc")


def _cf_errors(path):
    """Run the checker of CF 1.11 on a file; return the messages of what it calls an error."""
    report = path.with_suffix(".json")
    subprocess.run(
        [str(CHECKER), "-t", "cf:1.11", "-f", "json", "-o", str(report), str(path)],
        check=False, capture_output=True, timeout=300,
    )  # fmt: skip
    (found,) = json.loads(report.read_text()).values()
    assert found["possible_points"] > 0
    return [item["msgs"] for item in found["high_priorities"] if item["value"][0] < item["value"][1]]


@needs_checker
def test_currents_have_no_error_against_cf_1_11(tmp_path):
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    answer = program("currents", tmp_path / "records.nc", tmp_path / "currents.nc")
    assert answer.status == 0, answer.err
    assert _cf_errors(tmp_path / "currents.nc") == []


@needs_checker
@pytest.mark.compiled
@pytest.mark.parametrize("options", [(), ("--community",)])
def test_og1_files_have_no_error_against_cf_1_11(brief_store, tmp_path, options):
    assert program("export", "og1", brief_store, tmp_path / "og1.nc", *options).status == 0
    assert _cf_errors(tmp_path / "og1.nc") == []
