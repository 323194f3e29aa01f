"""Strict OG1 file: terms of the manual alone, one current per dive, and reading with other software."""

import re
import shutil
from importlib import resources

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support.archives import put_table_rows
from support.missions import program

from gliderhpc.api.currents import currents
from gliderhpc.archive.mission import open_mission
from gliderhpc.report.exports.og1_forms import DIRECTIONS, RECKONINGS
from gliderhpc.report.exports.og1_vocabulary import PHASES, SINGLE
from gliderhpc.yaml_text import parse_yaml

pytestmark = pytest.mark.compiled

TERMS = parse_yaml(
    (resources.files("gliderhpc.report.exports") / "og1_terms.yaml").read_text("utf-8"), "og1_terms.yaml"
)
DEPLOYMENT = """\
Conventions: CF-1.6
Metadata_Conventions: CF-1.6
contributor_name: A. Name
platform_model_vocabulary: http://vocab.nerc.ac.uk/collection/B76/current/B7600014/
"""


@pytest.fixture(scope="module")
def strict(brief_store, tmp_path_factory):
    """Strict file of the brief mission."""
    folder = tmp_path_factory.mktemp("og1")
    (folder / "deployment.yaml").write_text(DEPLOYMENT)
    answer = program(
        "export", "og1", brief_store, folder / "strict.nc", "--community", "--deployment", folder / "deployment.yaml"
    )
    assert answer.status == 0, answer.err
    assert "contributor_email" in answer.out
    return folder / "strict.nc"


@pytest.fixture(scope="module")
def content(strict):
    with xr.open_dataset(strict) as dataset:
        return dataset.load()


def test_nothing_but_listed_terms_is_in_the_file(strict):
    with netCDF4.Dataset(strict) as file:
        assert set(file.dimensions) == {"N_MEASUREMENTS"}
        along = {name for name, variable in file.variables.items() if variable.dimensions}
        assert {name for name in along if not name.endswith("_QC")} == set(TERMS["variables"])
        assert {name.removesuffix("_QC") for name in along} == set(TERMS["variables"])
        assert set(file.variables) - along <= set(SINGLE)
        for name in TERMS["variables"]:
            term = TERMS["variables"][name]["term"]
            assert file[name].vocabulary == f"{TERMS['collection']}{term}/"
            assert not [key for key in file[name].ncattrs() if key in {"time_vocabulary", "depth_vocabulary"}]
            flag = f"{name}_QC"
            assert flag not in file.variables or file[name].ancillary_variables == flag


def test_every_term_has_a_source():
    assert TERMS["collection"] == "http://vocab.nerc.ac.uk/collection/OG1/current/"
    for entry in TERMS["variables"].values():
        assert entry["state"] in {"published", "approved", "requested"}
        assert re.search(r"manual 1.0|issue \d+|pull request \d+", entry["source"])


def test_mandatory_variables_have_a_quality_flag(content):
    for name in ("TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS", "PHASE",
                 "ROLL", "PITCH", "HEADING", "WCUR_X", "WCUR_Y"):  # fmt: skip
        assert content[f"{name}_QC"].dtype == np.int8
        assert (content[f"{name}_QC"].values == 0).all()


def test_attributes_are_those_of_og1(content):
    allowed = {"Conventions", "featureType"}
    assert [name for name in content.attrs if not name.islower() and name not in allowed] == []
    assert not any(name.startswith("gliderhpc_") for name in content.attrs)
    assert content.attrs["Conventions"] == "CF-1.11, ACDD-1.3, OG-1.0"
    assert content.attrs["contributor_name"] == "A. Name"
    assert content["PLATFORM_MODEL"].attrs["platform_model_vocabulary"].endswith("B7600014/")
    assert "platform_model_vocabulary" not in content.attrs
    assert content.attrs["geospatial_vertical_max"] == pytest.approx(float(content["DEPTH"].max()))


def test_each_dive_has_its_current_in_the_row_of_the_fix_after_it(content, brief_store):
    known = np.flatnonzero(np.isfinite(content["WCUR_X"].values))
    assert np.isfinite(content["LATITUDE_GPS"].values[known]).all()
    assert content["SEGMENT_NUMBER"].values[known].tolist() == [1, 2, 3]
    with open_mission(brief_store) as archive:
        table = archive.to_dataset()
        assert content["WCUR_X"].values[known] == pytest.approx(table["dac_east_smoothed"].values, rel=1e-6)
        assert content["WCUR_Y"].values[known] == pytest.approx(table["dac_north_smoothed"].values, rel=1e-6)
        late = (content["TIME"].values[known] - table["exit_time"].values) / np.timedelta64(1, "s")
    assert np.abs(late).max() < 1e-3
    assert content["WCUR_X"].attrs["standard_name"] == "eastward_sea_water_velocity"
    assert content["WCUR_Y"].attrs["standard_name"] == "northward_sea_water_velocity"


def test_directions_and_kinds_of_position_follow_the_rows(content):
    phase, direction = content["PHASE"].values, content["PROFILE_DIRECTION"].values
    assert (direction[phase == PHASES["descent"]] == DIRECTIONS["descending"]).all()
    assert (direction[phase == PHASES["ascent"]] == DIRECTIONS["ascending"]).all()
    assert (direction[phase == PHASES["surfacing"]] == DIRECTIONS["neither"]).all()
    fixed = np.isfinite(content["LATITUDE_GPS"].values)
    assert (content["DEAD_RECKONING"].values[fixed] == RECKONINGS["position_of_a_fix"]).all()
    assert (content["DEAD_RECKONING"].values[~fixed] == RECKONINGS["dead_reckoning"]).all()


def test_without_fixes_there_is_no_position_and_no_current(brief_store, tmp_path):
    store = shutil.copytree(brief_store, tmp_path / "copy.zarr")
    put_table_rows(store, {1: {f"{end}_{what}": float("nan") for end in ("entry", "exit")
                               for what in ("time", "latitude", "longitude")}})  # fmt: skip
    assert program("export", "og1", store, tmp_path / "strict.nc", "--community").status == 0
    with xr.open_dataset(tmp_path / "strict.nc", mask_and_scale=False) as content:
        here = content["SEGMENT_NUMBER"].values == 2
        assert (content["DEAD_RECKONING"].values[here] == content["DEAD_RECKONING"].attrs["_FillValue"]).all()
        assert np.isnan(content["WCUR_X"].values[here]).all()


def test_currents_are_estimated_from_the_file(strict, content):
    """The file is enough for the light path: its heading is taken as true."""
    found = currents(strict)
    known = np.isfinite(content["WCUR_X"].values)
    assert found["dac_east"].values == pytest.approx(content["WCUR_X"].values[known], abs=0.05)
    assert found["dac_north"].values == pytest.approx(content["WCUR_Y"].values[known], abs=0.05)
    assert "magnetic" not in found.attrs["comment"]


def test_the_importer_says_what_the_file_lacks(strict, tmp_path):
    answer = program("import", "og1", strict, tmp_path / "back.nc")
    assert answer.status == 2
    assert "has no ballast volume (VBD_CC" in answer.err
