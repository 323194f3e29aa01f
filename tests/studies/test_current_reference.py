"""`analyze currents --reference`: a profiler's or the operator's own currents compared with ours."""

import csv
import shutil

import numpy as np
import pytest
import xarray as xr
from support.missions import program

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.store_schema import check_archive
from gliderhpc.studies.library.reference_currents import (
    ReferenceFile,
    bin_count,
    open_reference,
    read_reference_currents,
)
from gliderhpc.studies.library.scores import COVERAGE, MIN_COVERAGE

pytestmark = pytest.mark.compiled

BIN = 10.0
NORTH, EAST = 0.2, -0.1
SHEAR = 1e-3
"""1/s, of the northward component."""


@pytest.fixture
def archive(brief_store, tmp_path):
    return shutil.copytree(brief_store, tmp_path / "brief.zarr")


def field(depth):
    """North and east (m/s) at depths."""
    return NORTH + SHEAR * depth, np.full_like(depth, EAST)


def cells(data, deepest=np.inf):
    """Times every half minute of a dive, and depths of ten cells of 4 m below the glider."""
    rows = np.arange(0, len(data.record_time), 30)
    depth = data.measured[rows, 3, None] + 4.0 * np.arange(10)
    times = data.epoch + np.round(data.record_time[rows] * 1e9).astype("timedelta64[ns]")
    return times, np.where(depth < deepest, depth, np.nan)


def write_grid(path, data, deepest=np.inf):
    """A profiler's file on time and cell, its depths on both, velocities by standard name in cm/s."""
    times, depth = cells(data, deepest)
    north, east = field(depth)
    xr.Dataset(
        {
            "VN": (("time", "cell"), 100.0 * north, {"standard_name": "northward_sea_water_velocity", "units": "cm/s"}),
            "VE": (("time", "cell"), 100.0 * east, {"standard_name": "eastward_sea_water_velocity", "units": "cm/s"}),
            "z": (("time", "cell"), -depth, {"standard_name": "depth", "units": "m", "positive": "up"}),
        },
        coords={"time": times},
    ).to_netcdf(path)
    return path


def write_rows(path, data):
    """The same as rows, in any order, under customary names."""
    times, depth = cells(data)
    rows = np.random.default_rng(1).permutation(depth.size)
    north, east = field(depth.ravel()[rows])
    xr.Dataset(
        {
            "v": ("obs", north, {"units": "m s-1"}),
            "u": ("obs", east, {"units": "m s-1"}),
            "time": ("obs", np.repeat(times, depth.shape[1])[rows]),
            "depth": ("obs", depth.ravel()[rows], {"units": "m"}),
        }
    ).to_netcdf(path)
    return path


@pytest.mark.parametrize("write", [write_grid, write_rows])
def test_a_profilers_velocities_are_binned_and_averaged_as_the_glider_was_there(archive, tmp_path, write):
    with open_mission(archive) as opened:
        data = read_profile_data(opened, 2)
    reference = read_reference_currents(write(tmp_path / "adcp.nc", data))
    bins = bin_count(float(np.nanmax(data.measured[:, 3])) + 40.0, BIN)
    found = reference.for_dive(data, BIN, bins)
    known = found.count > 0
    middle = (np.arange(bins) + 0.5) * BIN
    np.testing.assert_allclose(found.by_depth[known, 0], NORTH + SHEAR * middle[known], atol=SHEAR * BIN / 2)
    np.testing.assert_allclose(found.by_depth[known, 1], EAST, atol=1e-12)
    assert found.covered == pytest.approx(1.0)
    met = np.nanmean(field(np.maximum(data.measured[:, 3], 0.0))[0])
    np.testing.assert_allclose(found.velocity, [met, EAST], atol=SHEAR * BIN / 2)


def test_a_profiler_that_saw_too_little_of_the_dive_gives_no_mean(archive, tmp_path):
    with open_mission(archive) as opened:
        data, other = (read_profile_data(opened, number) for number in (2, 3))
    depth = data.measured[:, 3]
    reference = read_reference_currents(write_grid(tmp_path / "adcp.nc", data, deepest=float(np.nanmedian(depth))))
    found = reference.for_dive(data, BIN, bin_count(float(np.nanmax(depth)), BIN))
    assert 0.3 < found.covered < MIN_COVERAGE
    assert np.isnan(found.velocity).all()
    assert np.isfinite(found.by_depth[0]).all()
    elsewhere = reference.for_dive(other, BIN, 30)
    assert elsewhere.covered == 0.0
    assert not elsewhere.count.any()


@pytest.mark.usefixtures("undrawn_studies")
def test_the_study_compares_it_with_ours_in_table_and_archive(archive, tmp_path):
    with open_mission(archive) as opened:
        data = read_profile_data(opened, 2)
    path = write_grid(tmp_path / "adcp.nc", data)
    answer = program("analyze", archive, "currents", "--reference", path, "--workers", 0)
    assert answer.status == 0, answer.err
    assert "reference within 1 sigma" in answer.out
    assert check_archive(archive) == []
    with open_mission(archive) as opened:
        study = opened["currents"].to_dataset().load()
    two = study.sel(profile=2)
    apart = np.array([two["current_north"] - two["reference_north"], two["current_east"] - two["reference_east"]])
    assert float(two["reference_difference"]) == pytest.approx(np.hypot(*apart))
    assert float(two["reference_distance"]) > 0.0
    assert float(two["reference_by_depth_north"][1]) == pytest.approx(NORTH + SHEAR * 15.0, abs=SHEAR * BIN / 2)
    others = study.sel(profile=[1, 3])
    assert np.isnan(others["reference_north"]).all()
    assert (others["reference_covered"] == 0.0).all()
    with (archive.with_name("brief-studies") / "currents" / "currents.csv").open() as file:
        rows = {row["profile"]: row for row in csv.DictReader(file)}
    assert float(rows["2"]["reference_north"]) == pytest.approx(float(two["reference_north"]))


@pytest.mark.usefixtures("undrawn_studies")
def test_the_operators_own_currents_come_with_their_error(archive, tmp_path):
    path = tmp_path / "imported.nc"
    xr.Dataset(
        {
            "reference_current_north": ("reference_profile", [0.1, np.nan], {"units": "m s-1"}),
            "reference_current_east": ("reference_profile", [-0.2, np.nan], {"units": "m s-1"}),
            "reference_current_error": ("reference_profile", [0.02, np.nan], {"units": "m s-1"}),
        },
        coords={"reference_profile": [2, 3]},
    ).to_netcdf(path)
    answer = program("analyze", archive, "currents", "--reference", path, "--workers", 0)
    assert answer.status == 0, answer.err
    with open_mission(archive) as opened:
        study = opened["currents"].to_dataset().load().sel(profile=2)
    apart = np.array([float(study["current_north"]) - 0.1, float(study["current_east"]) + 0.2])
    across = float(study["current_covariance"])
    covariance = np.array([
        [float(study["current_north_std"]) ** 2 + 0.02**2, across],
        [across, float(study["current_east_std"]) ** 2 + 0.02**2],
    ])  # fmt: skip
    expected = np.sqrt(apart @ np.linalg.solve(covariance, apart))
    assert float(study["reference_distance"]) == pytest.approx(expected)
    shares = {f"{int(expected <= sigma)} of 1" for sigma in COVERAGE}
    assert {share for share in ("0 of 1", "1 of 1") if share in answer.out} == shares


def test_an_unreadable_reference_file_is_refused_in_one_line(archive, tmp_path):
    absent = program("analyze", archive, "currents", "--reference", tmp_path / "none.nc")
    assert (absent.status, "none.nc: no such file" in absent.line) == (2, True)
    other = tmp_path / "other.nc"
    xr.Dataset({"temperature": ("time", [1.0])}).to_netcdf(other)
    with pytest.raises(InputError, match=r"holds neither northward_sea_water_velocity and eastward"):
        read_reference_currents(other)
    timeless = tmp_path / "timeless.nc"
    xr.Dataset({name: ("x", [1.0], {"units": "m/s"}) for name in ("u", "v")}).to_netcdf(timeless)
    with pytest.raises(InputError, match="its velocities have no time"):
        read_reference_currents(timeless)
    text = tmp_path / "text.nc"
    text.write_text("no netCDF")
    with pytest.raises(InputError, match="cannot be read as netCDF"):
        read_reference_currents(text)


def test_cells_deeper_than_the_dive_do_not_count(archive, tmp_path):
    with open_mission(archive) as opened:
        data = read_profile_data(opened, 2)
    path = write_grid(tmp_path / "adcp.nc", data)
    bins = bin_count(float(np.nanmax(data.measured[:, 3])), BIN)
    whole = read_reference_currents(path).for_dive(data, BIN, bins)
    with xr.open_dataset(path) as content:
        wrong = content.load()
    wrong["VN"] = wrong["VN"].where(-wrong["z"] < bins * BIN, -5000.0)
    wrong.to_netcdf(tmp_path / "deep.nc")
    np.testing.assert_allclose(
        read_reference_currents(tmp_path / "deep.nc").for_dive(data, BIN, bins).velocity, whole.velocity
    )


def test_the_depths_of_the_cells_are_those_along_both_dimensions(archive, tmp_path):
    """A profiler on a glider has its own depth too, and both have the standard name."""
    with open_mission(archive) as opened:
        data = read_profile_data(opened, 2)
    path = write_grid(tmp_path / "adcp.nc", data)
    with xr.open_dataset(path) as content:
        both = content.load()
    own = xr.zeros_like(both["z"].isel(cell=0)).assign_attrs(standard_name="depth", units="m", positive="down")
    xr.Dataset({"depth": own, **both.data_vars}, coords=both.coords).to_netcdf(tmp_path / "both.nc")
    one, other = (read_reference_currents(tmp_path / name) for name in ("adcp.nc", "both.nc"))
    np.testing.assert_array_equal(one.depth, other.depth)


def test_a_reference_that_was_replaced_is_read_again(archive, tmp_path):
    with open_mission(archive) as opened:
        data = read_profile_data(opened, 2)
    path = write_grid(tmp_path / "adcp.nc", data)
    first = open_reference(ReferenceFile.of(path))
    assert open_reference(ReferenceFile.of(path)) is first
    path.unlink()
    write_grid(path, data, deepest=20.0)
    assert len(open_reference(ReferenceFile.of(path)).depth[np.isfinite(first.depth)]) == len(first.depth)
    assert open_reference(ReferenceFile.of(path)) is not first
