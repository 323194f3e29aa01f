"""`gliderhpc export currents`: content of the file, and refused requests."""

import shutil

import numpy as np
import pytest
import xarray as xr
import zarr
from geographiclib.geodesic import Geodesic
from support.archives import put_table_rows
from support.missions import program

from gliderhpc.archive.mission import open_mission
from gliderhpc.store_schema import consolidate

pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def studied(brief_store, tmp_path_factory):
    """Archive with the study: its first dive without a smoothed current, its second without any.

    The third is moved across the antimeridian.
    """
    archive = shutil.copytree(brief_store, tmp_path_factory.mktemp("currents") / "brief.zarr")
    put_table_rows(archive, {
        0: {"dac_north_smoothed": np.nan},
        1: {"dac_north": np.nan, "dac_east": np.nan},
        2: {"entry_longitude": 179.99, "exit_longitude": -179.98, "entry_latitude": 80.0, "exit_latitude": 80.0},
    })  # fmt: skip
    answer = program("analyze", archive, "currents", "--workers", 0)
    assert answer.status == 0, answer.err
    return archive


@pytest.fixture(scope="module")
def exported(studied):
    path = studied.with_name("currents.nc")
    answer = program("export", "currents", studied, path)
    assert answer.status == 0, answer.err
    assert "profile 2 left out: no depth-averaged current" in answer.out
    assert "currents of 2 profiles" in answer.out
    with xr.open_dataset(path) as dataset:
        return dataset.load()


def test_an_outdated_study_is_exported_with_a_warning(studied, tmp_path, caplog):
    archive = shutil.copytree(studied, tmp_path / "brief.zarr")
    zarr.open_group(archive, mode="r+", use_consolidated=False)["currents"].attrs["outdated"] = "made before a change"
    consolidate(archive)
    answer = program("export", "currents", archive, tmp_path / "currents.nc")
    assert answer.status == 0
    assert "the study currents was made before a change; run it again before the export" in caplog.text
    with xr.open_dataset(tmp_path / "currents.nc") as dataset:
        assert dataset.attrs["comment"].endswith("The shear-sensitive part was made before a change.")


@pytest.mark.parametrize("kind", ["og1", "currents"])
def test_an_address_is_not_read_as_a_path(kind, tmp_path):
    answer = program("export", kind, "memory://bucket/none.zarr", tmp_path / "out.nc")
    assert answer.status == 2
    assert "memory://bucket/none.zarr" in answer.err


def test_currents_and_errors_are_those_of_the_study(studied, exported):
    with open_mission(studied) as tree:
        study = tree["currents"].to_dataset().load().sel(profile=[1, 3])
    for name, along in (("u", "east"), ("v", "north")):
        assert float(exported[name][0]) == float(study[f"current_{along}"][0])
        assert float(exported[f"{name}_error"][0]) == float(study[f"current_{along}_std"][0])
        np.testing.assert_array_equal(exported[f"{name}_shear_sensitive"], study[f"both_shear_{along}"])
        assert exported[name].attrs["standard_name"] == f"{along}ward_sea_water_velocity"
        assert "standard_name" not in exported[f"{name}_shear_sensitive"].attrs
    assert float(exported["uv_covariance"][0]) == float(study["current_covariance"][0])
    np.testing.assert_array_equal(exported["shear_sensitive_count"], study["both_count"])
    np.testing.assert_allclose(exported["depth"], study["bin_depth"].isel(profile=0))
    assert exported.attrs["featureType"] == "profile"
    assert exported["profile"].attrs["cf_role"] == "profile_id"


def test_the_smoother_s_current_is_taken_where_there_is_one(studied, exported):
    """With the ellipse that the run gave it: the study was made without a budget."""
    with open_mission(studied) as tree:
        table = tree.to_dataset().load().sel(profile=3)
    for name, along in (("u", "east"), ("v", "north")):
        # The third dive was moved, so its current is the archive's and not that of its fixes.
        assert float(exported[name][1]) == pytest.approx(float(table[f"dac_{along}_smoothed"]), rel=1e-12)
    meanings = exported["current_estimate"].attrs["flag_meanings"].split()
    assert [meanings[code] for code in exported["current_estimate"].values] == ["adjoint", "smoothed"]
    assert "current_estimate" in exported["u"].attrs["ancillary_variables"]


def test_coordinates_and_their_bounds_have_no_fill_value(studied, exported):
    """CF 2.5.1 and 7.1: neither may be missing."""
    assert "depth" in exported.coords
    with xr.open_dataset(studied.with_name("currents.nc"), mask_and_scale=False) as stored:
        bounds = [variable.attrs["bounds"] for variable in stored.variables.values() if "bounds" in variable.attrs]
        assert sorted(bounds) == ["depth_bounds", "time_bounds"]
        for name in (*bounds, "time", "latitude", "longitude", "depth"):
            assert "_FillValue" not in stored[name].attrs | stored[name].encoding, name
        assert "_FillValue" in stored["u_error"].attrs


def test_time_and_place_lie_midway_between_the_fixes(studied, exported):
    with open_mission(studied) as tree:
        table = tree.to_dataset().load().sel(profile=[1, 3])
    middle = table["entry_time"].values + (table["exit_time"].values - table["entry_time"].values) / 2
    assert (np.abs(exported["time"].values - middle) < np.timedelta64(1, "ms")).all()
    first = table.sel(profile=1)
    ends = [float(first[f"{end}_{axis}"]) for end in ("entry", "exit") for axis in ("latitude", "longitude")]
    place = float(exported["latitude"][0]), float(exported["longitude"][0])
    halves = [Geodesic.WGS84.Inverse(*ends[2 * i : 2 * i + 2], *place)["s12"] for i in (0, 1)]
    assert halves[0] == pytest.approx(halves[1], rel=1e-6)
    assert halves[0] + halves[1] == pytest.approx(Geodesic.WGS84.Inverse(*ends)["s12"], rel=1e-9)
    assert float(exported["longitude"][1]) == pytest.approx(-179.995)
    assert float(exported["latitude"][1]) == pytest.approx(80.0, abs=1e-4)


def test_export_of_an_unusable_archive_is_refused_in_one_line(brief_store, studied, exported, tmp_path):
    bare = program("export", "currents", brief_store, tmp_path / "out.nc")
    assert (bare.status, "has no group currents" in bare.line) == (2, True)
    there = program("export", "currents", studied, studied.with_name("currents.nc"))
    assert (there.status, "this file exists" in there.line) == (2, True)
    nowhere = program("export", "currents", studied, tmp_path / "none" / "out.nc")
    assert (nowhere.status, "does not exist; create it first" in nowhere.line) == (2, True)
    copy = shutil.copytree(studied, tmp_path / "nothing.zarr")
    put_table_rows(copy, {row: {"current_north": np.nan} for row in range(3)}, "currents")
    nothing = program("export", "currents", copy, tmp_path / "out.nc")
    assert (nothing.status, "no profile has a current" in nothing.line) == (2, True)
    assert not (tmp_path / "out.nc").exists()


def test_profiles_that_were_not_studied_are_reported_by_the_export(studied, tmp_path):
    archive = shutil.copytree(studied, tmp_path / "brief.zarr")
    assert program("analyze", archive, "currents", "--profiles", "1,2", "--workers", 0).status == 0
    answer = program("export", "currents", archive, tmp_path / "currents.nc")
    assert "profile 2 left out: no depth-averaged current: a fix before or after the dive is missing" in answer.out
    assert "profile 3 left out: study currents was run without this profile; run it again for all" in answer.out
