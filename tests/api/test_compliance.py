"""Files for other users: discovery attributes, and the IOOS compliance checker where it is installed.

The part of the OG1 checker that asks the vocabulary server is answered from the list of terms in the package.
"""

import json
import os
import shutil
import subprocess
import sys
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support.glides import Glide, mission
from support.missions import program

from gliderhpc.report import exports
from gliderhpc.yaml_text import parse_yaml

CHECKER = shutil.which(
    "compliance-checker", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
)
needs_checker = pytest.mark.skipif(
    CHECKER is None, reason="the program compliance-checker (extra compliance) is not installed"
)

FAST_CHECKER = """
import functools, os, sys
from compliance_checker.cf import util

sys.path.insert(0, os.path.dirname(sys.argv.pop(1)))
from cchecker import main


def looked_up_once(lookup):
    found = functools.cache(lookup)
    return functools.wraps(lookup)(lambda file: list(found(file)))


# Each check of each variable goes through the attributes of all variables again, of a file that nobody changes.
for kind in ("auxiliary_coordinate", "axis", "time", "longitude", "latitude", "z", "geophysical"):
    setattr(util, f"get_{kind}_variables", looked_up_once(getattr(util, f"get_{kind}_variables")))
main()
"""
"""The compliance checker, asking a file for its coordinates once and not thousands of times."""

DEPLOYMENT = """\
creator_name: A. Name
creator_email: a.name@example.org
creator_url: https://example.org
creator_institution: An institute
publisher_name: A data centre
publisher_email: data@example.org
publisher_url: https://data.example.org
institution: An institute
project: A project
program: A programme
acknowledgement: Supported by nobody
naming_authority: org.example
license: CC-BY-4.0
references: https://example.org/paper
contributor_name: A. Name
contributor_email: a.name@example.org
contributor_role: Principal investigator
contributor_role_vocabulary: http://vocab.nerc.ac.uk/collection/W08/current/
contributing_institutions: An institute
contributing_institutions_role: Operator
contributing_institutions_role_vocabulary: http://vocab.nerc.ac.uk/collection/W08/current/
"""
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
    """Check that a file has discovery attributes, that variables describe their content, and its extent."""
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


@pytest.mark.long
def test_light_currents_can_be_found(deployment, tmp_path):
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    answer = program("currents", tmp_path / "records.nc", tmp_path / "out.nc", "--deployment", deployment)
    assert answer.status == 0, answer.err
    _checked(tmp_path / "out.nc")


@pytest.mark.long
@pytest.mark.compiled
def test_exports_can_be_found(brief_store, deployment, tmp_path):
    shutil.copytree(brief_store, tmp_path / "m.zarr")
    assert program("analyze", tmp_path / "m.zarr", "currents", "--workers", 0).status == 0
    for name, *kind in (("og1", "og1"), ("strict", "og1", "--community"), ("currents", "currents")):
        answer = program("export", *kind, tmp_path / "m.zarr", tmp_path / f"{name}.nc", "--deployment", deployment)
        assert answer.status == 0, answer.err
        _checked(tmp_path / f"{name}.nc")


def _report(path, standard):
    """Run the checker of a standard on a file, and return its report."""
    report = path.with_suffix(".json")
    subprocess.run(
        [sys.executable, "-c", FAST_CHECKER, str(CHECKER), "-t", standard, "-f", "json", "-o", str(report), str(path)],
        check=False, capture_output=True, timeout=300,
    )  # fmt: skip
    (found,) = json.loads(report.read_text()).values()
    assert found["possible_points"] > 0
    return found


def _cf_errors(path):
    """Return the error messages of the CF 1.11 checker."""
    found = _report(path, "cf:1.11")
    return [item["msgs"] for item in found["high_priorities"] if item["value"][0] < item["value"][1]]


def _og1_errors(path, monkeypatch):
    """Return the messages of the OG1 checker by check."""
    checker = pytest.importorskip("cc_plugin_og.checker")
    terms = parse_yaml((resources.files(exports) / "og1_terms.yaml").read_text("utf-8"), "og1_terms.yaml")
    listed = [{"@id": f"{terms['collection']}{entry['term']}/"} for entry in terms["variables"].values()]
    # The server's last entry is that of the collection itself.
    answer = SimpleNamespace(json=lambda: {"@graph": [*listed, {"@id": terms["collection"]}]})
    monkeypatch.setattr(checker.requests, "get", lambda address: answer)
    found, errors = checker.OGChecker(), {}
    with netCDF4.Dataset(path) as file:
        for name in sorted(dir(found)):
            if name.startswith("check_"):
                result = getattr(found, name)(file)
                score, out_of = result.value
                if score < out_of:
                    errors[name] = result.msgs
    return errors


@pytest.mark.long
@needs_checker
def test_currents_have_no_error_against_cf_1_11(tmp_path):
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    answer = program("currents", tmp_path / "records.nc", tmp_path / "currents.nc")
    assert answer.status == 0, answer.err
    assert _cf_errors(tmp_path / "currents.nc") == []


@pytest.mark.long
@needs_checker
@pytest.mark.compiled
@pytest.mark.parametrize("options", [(), ("--community",)])
def test_og1_files_have_no_error_against_cf_1_11(brief_store, tmp_path, options):
    assert program("export", "og1", brief_store, tmp_path / "og1.nc", *options).status == 0
    assert _cf_errors(tmp_path / "og1.nc") == []


@pytest.mark.long
@needs_checker
@pytest.mark.compiled
def test_a_community_file_has_no_error_against_og1(brief_store, deployment, tmp_path, monkeypatch):
    out = ("export", "og1", brief_store, tmp_path / "og1.nc", "--community", "--deployment", deployment)
    assert program(*out).status == 0
    assert _og1_errors(tmp_path / "og1.nc", monkeypatch) == {}


@pytest.mark.long
@needs_checker
@pytest.mark.compiled
def test_the_full_file_lacks_only_terms_that_og1_has_not(brief_store, deployment, tmp_path, monkeypatch):
    assert program("export", "og1", brief_store, tmp_path / "og1.nc", "--deployment", deployment).status == 0
    assert set(_og1_errors(tmp_path / "og1.nc", monkeypatch)) <= {"check_variables_og1_url"}


@pytest.mark.long
@needs_checker
@pytest.mark.compiled
def test_files_can_be_discovered(brief_store, deployment, tmp_path):
    """At least nine tenths of the points of ACDD 1.3."""
    mission(Glide()).to_netcdf(tmp_path / "records.nc")
    strict = ("export", "og1", brief_store, tmp_path / "og1.nc", "--community", "--deployment", deployment)
    assert program(*strict).status == 0
    light = ("currents", tmp_path / "records.nc", tmp_path / "light.nc", "--deployment", deployment)
    assert program(*light).status == 0
    for name in ("og1", "light"):
        found = _report(tmp_path / f"{name}.nc", "acdd:1.3")
        assert found["scored_points"] >= 0.9 * found["possible_points"], found
