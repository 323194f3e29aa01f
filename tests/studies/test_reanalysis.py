"""Study `reanalysis`: model files in their own layouts, exact sampling of known fields, and the command."""

import csv
import json
import shutil
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support.archives import put_table_rows
from support.missions import program
from support.model_files import CMEMS_DEPTHS, Model, linear, write_cmems, write_hycom
from support.shown import check_figure_follows, check_shown_as_left, shown_after

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import local_executor
from gliderhpc.report.studies.reanalysis import ellipse_axes, table_4, table_4_text
from gliderhpc.report.studies.reanalysis_comparisons import Compared, agreement, agreements, comparisons, share_within
from gliderhpc.store_schema import check_archive
from gliderhpc.studies.library.model_file import Axis, LongitudeAxis, open_model_file, product_of, without_password
from gliderhpc.studies.library.ocean_model import Coverage, Grid, expand_source, open_models
from gliderhpc.studies.library.scores import covariance_matrix, direction, direction_difference, sigma_distance
from gliderhpc.studies.library.tracks import DivePath, UncertainCurrent, archived_currents, dive_path
from gliderhpc.studies.reanalysis import compare_with_models
from gliderhpc.studies.registry import missing_input
from gliderhpc.studies.request import Request

START = np.datetime64("2024-01-01T00:00:00", "ns")


def path_of(hours, depth, latitude, longitude):
    given = (np.atleast_1d(np.asarray(column, np.float64)) for column in (hours, depth, latitude, longitude))
    elapsed, *places = np.broadcast_arrays(*given)
    return DivePath(START + np.round(elapsed * 3.6e12).astype("timedelta64[ns]"), *places)


def sampled(path, *sources):
    with open_models([str(source) for source in sources]) as (model,):
        return model.sample(path)


def scattered(seed, count=200):
    """A path all over the inside of the default grid."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(*ends, count) for ends in ((0.0, 48.0), (0.5, 250.0), (17.6, 18.6), (114.6, 115.64))]


# The files that models really come in


def interpolated(dataset, names, **places):
    dims = {name: xr.DataArray(values, dims="point") for name, values in places.items()}
    return np.column_stack([dataset[name].interp(dims).values for name in names])


def compare_with_xarray(found, wanted, least):
    np.testing.assert_array_equal(np.isnan(found.velocity), np.isnan(wanted))
    np.testing.assert_allclose(found.velocity, wanted, rtol=0.0, atol=2e-6)
    known = np.isfinite(wanted).all(axis=1)
    np.testing.assert_array_equal(found.coverage == Coverage.VELOCITY, known)
    assert least < known.mean() < 1.0


def test_a_real_hycom_file_is_read_as_it_is(shared_data):
    source = shared_data / "reanalysis" / "hycom_glby_930_2019030712_t003_uv3z.nc"
    rng = np.random.default_rng(0)
    with xr.open_dataset(source, drop_variables="tau") as dataset:
        places = {
            name: rng.uniform(dataset[name].values.min(), most, 400)
            for name, most in (("lat", 35.64), ("lon", -74.321), ("depth", 300.0))
        }
        wanted = interpolated(dataset.isel(time=0), ("water_v", "water_u"), **places)
        time = np.full(400, dataset["time"].values[0])
    found = sampled(DivePath(time, places["depth"], places["lat"], places["lon"]), source)
    compare_with_xarray(found, wanted, 0.3)
    turned = sampled(DivePath(time, places["depth"], places["lat"], places["lon"] + 360.0), source)
    np.testing.assert_allclose(turned.velocity, wanted, rtol=0.0, atol=2e-6)
    with open_models([str(source)]) as (model,):
        assert model.name == "HYCOM"


def test_a_real_copernicus_file_is_read_as_it_is(shared_data):
    source = shared_data / "reanalysis" / "test_data_python.nc"
    rng = np.random.default_rng(1)
    with xr.open_dataset(source) as dataset:
        places = {
            name: rng.uniform(dataset[name].values.min(), dataset[name].values.max(), 400)
            for name in ("latitude", "longitude", "depth")
        }
        time = dataset["time"].values[0] + rng.integers(0, 86_400, 400) * np.timedelta64(1, "s")
        wanted = interpolated(dataset, ("vo", "uo"), time=time, **places)
    found = sampled(DivePath(time, places["depth"], places["latitude"], places["longitude"]), source)
    compare_with_xarray(found, wanted, 0.2)
    with open_models([str(source)]) as (model,):
        assert (model.name, model.daily_at_midnight) == ("GLO12", True)


def test_a_real_file_of_one_point_answers_there_and_nowhere_else(shared_data):
    source = shared_data / "reanalysis" / "cmems_glo12_point_50lev_6h_ship_uv.nc"
    with xr.open_dataset(source) as dataset:
        depth, time = np.array([0.6, 100.0, 900.0, 0.3]), np.repeat(dataset["time"].values[1:2], 4)
        along = dataset.isel(latitude=0, longitude=0)
        wanted = interpolated(along, ("vo", "uo"), time=time, depth=depth)
    at_point = sampled(DivePath(time, depth, np.zeros(4), np.zeros(4)), source)
    np.testing.assert_allclose(at_point.velocity, wanted, atol=1e-7)
    assert at_point.coverage.tolist() == [Coverage.VELOCITY] * 3 + [Coverage.DEPTH]
    neighbour = sampled(DivePath(time, depth, np.zeros(4), np.full(4, 0.01)), source)
    assert neighbour.coverage.tolist() == [Coverage.BOX] * 4


# Sampling of a known field


def test_a_linear_field_is_sampled_exactly_from_either_layout(tmp_path):
    columns = scattered(2)
    hycom = sampled(path_of(*columns), write_hycom(tmp_path / "hycom.nc", Model()))
    np.testing.assert_allclose(hycom.velocity, linear(*columns), rtol=0.0, atol=1e-6)
    cmems = sampled(path_of(*columns), write_cmems(tmp_path / "cmems.nc", Model(depths=np.array(CMEMS_DEPTHS))))
    np.testing.assert_allclose(cmems.velocity, linear(*columns), rtol=0.0, atol=1e-9)
    assert (cmems.coverage == Coverage.VELOCITY).all()


def test_axes_that_run_the_other_way_change_nothing(tmp_path):
    model = Model()
    model.latitudes, model.depths = model.latitudes[::-1], model.depths[::-1]
    columns = scattered(3)
    found = sampled(path_of(*columns), write_cmems(tmp_path / "falling.nc", model))
    np.testing.assert_allclose(found.velocity, linear(*columns), rtol=0.0, atol=1e-9)


def test_a_file_that_counts_depth_upwards_in_other_units_is_converted(tmp_path):
    path = write_cmems(tmp_path / "up.nc", Model())
    with netCDF4.Dataset(path, "a") as file:
        file["depth"][:] = -100.0 * file["depth"][:]
        file["depth"].setncatts({"positive": "up", "units": "cm"})
        for name in ("uo", "vo"):
            file[name][:] = 100.0 * file[name][:]
            file[name].units = "cm/s"
    columns = scattered(4)
    np.testing.assert_allclose(sampled(path_of(*columns), path).velocity, linear(*columns), rtol=0.0, atol=1e-9)


def about_the_antimeridian(time, depth, latitude, longitude):
    return linear(time, depth, latitude, np.mod(longitude, 360.0) - 180.0 + 115.0)


@pytest.mark.parametrize("branch", ["file from 0 to 360", "file from -180 to 180"])
def test_a_track_across_the_antimeridian_is_followed(tmp_path, branch):
    model = Model(longitudes=np.arange(179.44, 180.5, 0.08), velocity=about_the_antimeridian)
    if branch.endswith("360"):
        source = write_hycom(tmp_path / "east.nc", model)
    else:
        source = write_cmems(tmp_path / "both.nc", model)
    longitude = np.linspace(179.5, 180.35, 50)
    wanted = about_the_antimeridian(3.5, 20.0, 18.0, longitude)
    for shifted in (longitude, np.mod(longitude + 180.0, 360.0) - 180.0, longitude - 360.0):
        found = sampled(path_of(3.5, 20.0, 18.0, shifted), source)
        np.testing.assert_allclose(found.velocity, wanted, rtol=0.0, atol=1e-6)


def waves(time, depth, latitude, longitude):
    turns = np.radians(longitude)
    return np.stack(np.broadcast_arrays(np.sin(turns) + 0 * (time + depth + latitude), np.cos(turns)), axis=-1)


@pytest.mark.parametrize("first", [0.0, -180.0])
def test_a_global_file_closes_on_itself_and_is_read_at_both_ends_only(tmp_path, first):
    model = Model(
        hours=np.array([0.0, 3.0]), depths=np.array([0.0, 100.0]), latitudes=np.array([17.0, 19.0]),
        longitudes=np.arange(first, first + 360.0, 0.5), velocity=waves,
    )  # fmt: skip
    source = write_cmems(tmp_path / "global.nc", model)
    longitude = first + np.array([-0.9, -0.3, -0.2, 0.0, 0.1, 0.7])
    boxes = []
    with open_model_file(str(source)) as file:
        found = Grid([_Recorder(file, boxes)]).sample(path_of(1.0, 50.0, 18.0, longitude))
    np.testing.assert_allclose(found.velocity[3], waves(0, 0, 0, np.array([first]))[0], atol=1e-12)
    np.testing.assert_allclose(found.velocity, waves(0, 0, 0, longitude), rtol=0.0, atol=1e-4)
    assert sum(box[3].stop - box[3].start for box in boxes) <= 6


class _Recorder:
    """A file that records which parts of it were read."""

    def __init__(self, file, boxes):
        self._file, self._boxes = file, boxes

    def __getattr__(self, name):
        return getattr(self._file, name)

    def read(self, *box):
        self._boxes.append(box)
        return self._file.read(*box)


def test_outside_is_never_extrapolated(tmp_path):
    source = write_cmems(tmp_path / "cmems.nc", Model(depths=np.array(CMEMS_DEPTHS)))
    outside = {
        Coverage.BOX: [(1.0, 5.0, 17.59, 115.0), (1.0, 5.0, 18.61, 115.0), (1.0, 5.0, 18.0, 114.59),
                     (1.0, 5.0, 18.0, 115.65), (1.0, 5.0, 18.0, -65.0)],
        Coverage.TIME: [(-0.001, 5.0, 18.0, 115.0), (48.001, 5.0, 18.0, 115.0)],
        Coverage.DEPTH: [(1.0, 0.49, 18.0, 115.0), (1.0, 318.2, 18.0, 115.0)],
    }  # fmt: skip
    for coverage, places in outside.items():
        found = sampled(path_of(*np.array(places).T), source)
        assert np.isnan(found.velocity).all()
        assert found.coverage.tolist() == [coverage] * len(places)


def test_land_and_bottom_are_missing_up_to_the_next_point_of_water(tmp_path):
    model = Model()
    model.missing = (model.depths[:, None, None] > 100.0) & (model.longitudes < 115.0)
    for source in (write_hycom(tmp_path / "h.nc", model), write_cmems(tmp_path / "c.nc", model)):
        found = sampled(path_of(1.0, [110.0, 110.0, 100.0, 99.0], 18.0, [114.8, 114.97, 114.8, 114.8]), source)
        assert found.coverage.tolist() == [Coverage.LAND, Coverage.LAND, Coverage.VELOCITY, Coverage.VELOCITY]
        np.testing.assert_allclose(found.velocity[2], linear(1.0, 100.0, 18.0, 114.8), atol=1e-6)
        assert np.isnan(found.velocity[:2]).all()


# Several files


def test_files_of_one_grid_are_joined_along_time(tmp_path):
    hours = np.arange(0.0, 49.0, 3.0)
    sources = [
        write_hycom(tmp_path / f"{index}.nc", Model(hours=part))
        for index, part in enumerate((hours[6:12], hours[:6], hours[11:12], hours[12:]))
    ]
    columns = scattered(5)
    found = sampled(path_of(*columns), *sources)
    np.testing.assert_allclose(found.velocity, linear(*columns), rtol=0.0, atol=1e-6)


def test_a_pattern_is_all_files_that_fit_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.nc", "a.nc", "c.txt", "odd[1].nc"):
        (tmp_path / name).touch()
    assert expand_source("?.nc") == [str(tmp_path / "a.nc"), str(tmp_path / "b.nc")]
    assert expand_source("odd[1].nc") == [str(tmp_path / "odd[1].nc")]
    assert expand_source("https://somewhere/*") == ["https://somewhere/*"]
    with pytest.raises(InputError, match="no such file"):
        expand_source("*.nc4")


def test_a_missing_month_is_not_interpolated_across(tmp_path):
    sources = [
        write_hycom(tmp_path / f"{index}.nc", Model(hours=hours))
        for index, hours in enumerate((np.arange(0.0, 13.0, 3.0), np.arange(720.0, 733.0, 3.0)))
    ]
    found = sampled(path_of([1.0, 12.0, 13.0, 719.0, 720.0, 721.0], 5.0, 18.0, 115.0), *sources)
    water, hole = Coverage.VELOCITY, Coverage.TIME
    assert found.coverage.tolist() == [water, water, hole, hole, water, water]


def test_files_of_other_regions_answer_where_the_first_does_not(tmp_path):
    west, east = Model(), Model()
    west.longitudes, east.longitudes = west.longitudes[:7], east.longitudes[6:]
    sources = [write_cmems(tmp_path / f"{name}.nc", part) for name, part in (("w", west), ("e", east))]
    columns = scattered(6)
    found = sampled(path_of(*columns), *sources)
    np.testing.assert_allclose(found.velocity, linear(*columns), rtol=0.0, atol=1e-9)
    assert sampled(path_of(1.0, 5.0, 18.0, 114.0), *sources).coverage.tolist() == [Coverage.BOX]


def test_each_product_is_a_model_of_its_own(tmp_path):
    sources = [
        write_hycom(tmp_path / "h.nc", Model()),
        write_cmems(tmp_path / "g.nc", Model()),
        write_cmems(tmp_path / "elsewhere.nc", Model(), source="a model of our own"),
    ]
    with open_models(map(str, sources)) as models:
        assert [model.name for model in models] == ["HYCOM", "GLORYS12", "elsewhere"]
        assert models[1].labels == [str(sources[1])]
        assert not models[0].daily_at_midnight
    assert product_of({"product": "GLOBAL_MULTIYEAR_PHY_001_030"}, "x") == "GLORYS12"


def test_a_file_far_larger_than_memory_is_read_a_box_at_a_time(tmp_path):
    path = tmp_path / "large.nc"
    sizes = {"time": 8000, "depth": 40, "lat": 2000, "lon": 4500}
    with netCDF4.Dataset(path, "w") as file:
        for (name, size), step, axis in zip(sizes.items(), (3.0, 10.0, 0.08, 0.08), "TZYX", strict=True):
            file.createDimension(name, size)
            variable = file.createVariable(name, "f8", (name,))
            units = {"T": "hours since 2024-01-01", "Z": "m", "Y": "degrees_north", "X": "degrees_east"}[axis]
            variable.setncatts({"units": units, "axis": axis})
            variable[:] = step * np.arange(size) - (80.0 if name == "lat" else 0.0)
        for name in ("water_v", "water_u"):
            variable = file.createVariable(name, "f4", tuple(sizes), chunksizes=(1, 1, 20, 20), fill_value=1e20)
            variable.units = "m/s"
            variable[100:102, 5:7, 1200:1210, 1400:1410] = 0.25
    assert 4 * np.prod(list(sizes.values()), dtype=float) > 1e12
    found = sampled(path_of(301.0, 55.0, 16.1, [112.1, 112.2, 200.0]), path)
    np.testing.assert_allclose(found.velocity, [[0.25, 0.25]] * 2 + [[np.nan, np.nan]])


# Files that are none


def refused(path):
    with pytest.raises(InputError) as refusal, open_model_file(str(path)):
        pytest.fail("it was accepted")
    text = str(refusal.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


@pytest.mark.compiled
def test_a_file_that_is_not_an_ocean_model_is_refused_in_one_line(tmp_path, brief):
    assert "no such file" in refused(tmp_path / "nowhere.nc")
    (tmp_path / "text.nc").write_text("this is\nno netCDF\n")
    assert "cannot be opened" in refused(tmp_path / "text.nc")
    assert "has no northward_sea_water_velocity" in refused(brief)


def changed(tmp_path, change, name="changed.nc"):
    """The text with which a changed file is refused."""
    path = write_cmems(tmp_path / "sound.nc", Model(hours=np.array([0.0, 3.0])))
    with xr.open_dataset(path, decode_times=False) as dataset:
        change(dataset.load()).to_netcdf(tmp_path / name)
    return refused(tmp_path / name)


def with_units(name, units):
    return lambda dataset: dataset.assign({name: dataset[name].assign_attrs(units=units)})


def without_axis(dataset):
    bare = dataset.assign_coords(depth=("depth", dataset["depth"].values))
    return bare.rename(depth="layer")


def curvilinear(dataset):
    return dataset.drop_vars("longitude")


def broken(dataset):
    return dataset.isel(latitude=[0, 2, 1, 3])


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        (with_units("uo", "knots"), "uo is in 'knots'"),
        (with_units("depth", "sigma"), "depth is in 'sigma'"),
        (with_units("time", "hours since analysis"), "not a unit of time"),
        (with_units("time", "hours"), "no unit of time since"),
        (lambda dataset: dataset.drop_vars("uo"), "has no eastward_sea_water_velocity"),
        (lambda dataset: dataset.isel(depth=0, drop=True), "has no northward_sea_water_velocity"),
        (without_axis, "vo has no axis of depth"),
        (curvilinear, "dimension longitude of vo has no coordinate"),
        (broken, "latitude is not monotonic"),
    ],
)
def test_a_file_that_cannot_be_sampled_is_refused_by_what_is_wrong(tmp_path, change, fragment):
    assert fragment in changed(tmp_path, change)


def test_the_layout_of_hycom_breaks_the_usual_decoder(tmp_path):
    source = write_hycom(tmp_path / "hycom.nc", Model())
    with pytest.raises(ValueError, match="analysis"), xr.open_dataset(source):
        pass
    with open_model_file(str(source)) as file:
        assert file.time[0] == START


def test_a_password_in_an_address_is_shown_to_nobody():
    shown = without_password("https://me:secret@tds.hycom.org/thredds/dodsC/uv3z?water_u")
    assert shown == "https://tds.hycom.org/thredds/dodsC/uv3z?water_u"
    assert without_password("folder/me@home.nc") == "folder/me@home.nc"


# Axes


def test_the_neighbours_on_an_axis():
    cells = Axis(np.array([0.0, 1.0, 3.0]), longest=1.5).cells(np.array([-0.1, 0.0, 0.25, 1.0, 2.0, 3.0, 3.1]))
    assert cells.inside.tolist() == [False, True, True, True, False, True, False]
    np.testing.assert_allclose(cells.weight[[1, 2, 3, 5]], [0.0, 0.25, 0.0, 1.0])
    alone = Axis(np.array([2.0])).cells(np.array([2.0, 2.1]))
    assert alone.inside.tolist() == [True, False]
    assert not LongitudeAxis(np.arange(0.0, 359.0, 1.0)).closes
    assert LongitudeAxis(np.arange(0.0, 360.0, 1.0)).closes
    assert not LongitudeAxis(np.array([5.0])).closes
    # A region across the antimeridian, cut from a global grid in ascending order.
    region = LongitudeAxis(np.array([-180.0, -179.5, 179.0, 179.5]))
    cells = region.cells(np.array([179.75, -179.75, 179.25, 181.0, 0.0]))
    assert cells.inside.tolist() == [True, True, True, False, False]
    assert list(zip(cells.lower[:3].tolist(), cells.upper[:3].tolist(), strict=True)) == [(3, 0), (0, 1), (2, 3)]
    np.testing.assert_allclose(cells.weight[:3], 0.5)


# Differences


def test_directions_turn_the_short_way_and_distances_are_in_standard_deviations():
    assert direction([-0.112, -0.023]) == pytest.approx(191.6, abs=0.1)
    assert direction_difference([1.0, 0.01], [1.0, -0.01]) == pytest.approx(1.146, abs=1e-3)
    covariance = np.array([[0.05, 0.02], [0.02, 0.03]])
    longer, shorter, angle = ellipse_axes(covariance)
    along = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle))])
    assert sigma_distance(longer * along, covariance) == pytest.approx(1.0)
    assert sigma_distance(2.0 * shorter * np.array([-along[1], along[0]]), covariance) == pytest.approx(2.0)
    assert np.isnan(sigma_distance(along, np.zeros((2, 2))))
    assert np.isnan(sigma_distance(np.array([np.nan, 0.0]), covariance))


def test_agreement_counts_only_where_both_are_known():
    ours = np.array([[1.0, 0.0], [0.0, 1.0], [np.nan, 0.0]])
    theirs = np.array([[0.0, 1.0], [0.0, 2.0], [1.0, 1.0]])
    found = agreement("a", ours, "b", theirs)
    assert (found.profiles, found.direction_least, found.direction_most) == (2, 0.0, pytest.approx(90.0))
    assert found.vector_rmsd == pytest.approx(np.sqrt(1.5))
    assert found.direction == pytest.approx(-45.0)
    assert (found.north, found.east, found.speed) == pytest.approx((0.5, -1.0, -0.5))
    assert np.isnan(agreement("a", ours[2:], "b", theirs[2:]).vector_rmsd)
    assert share_within(np.array([0.5, 1.5, np.nan]), 1) == 0.5
    assert np.isnan(share_within(np.array([np.nan]), 1))


def side_by_side(count=20):
    currents = [UncertainCurrent(np.array([0.1, -0.02 * index]), 0.01 * np.eye(2)) for index in range(count)]
    glider = np.array([current.velocity for current in currents])
    models = np.stack([glider + np.array([0.1, 0.0]), glider + np.array([0.0, 0.25])], axis=1)
    models[3] = np.nan
    distance = np.array([[1.0, 2.5]] * count)
    distance[3] = np.nan
    return Compared(
        np.arange(1, count + 1), np.arange(count) / 2.0, "adjoint", currents, glider, ("HYCOM", "GLORYS12"), models,
        distance,
    )  # fmt: skip


def test_table_4_and_the_comparison_with_the_paper():
    compared = side_by_side()
    places = compared.panels()
    assert len(places) == 9
    assert (places[0], places[-1]) == (0, 19)
    assert 3 not in places
    rows = table_4(compared, places)
    assert rows[0]["HYCOM speed"] == pytest.approx(0.2)
    assert rows[0]["GLORYS12 direction"] == pytest.approx(np.degrees(np.arctan2(0.25, 0.1)))
    text = table_4_text(rows).splitlines()
    assert text[2].startswith("| profile | day | adjoint speed | adjoint direction | glide angle speed")
    assert text[4] == "| 1 | 0 | 0.100 | 0 | 0.100 | 0 | 0.200 | 0 | 0.269 | 68 | 1.0 | 2.5 |"
    by_quantity = {row.quantity: row for row in comparisons(compared, agreements(compared))}
    mutual = by_quantity["vector RMSD, GLORYS12 against HYCOM"]
    assert (mutual.ours, mutual.paper) == (pytest.approx(np.hypot(0.1, 0.25)), 0.11)
    assert by_quantity["share of profiles with HYCOM within 1 sigma"].ours == 1.0
    beyond = by_quantity["share of profiles with GLORYS12 within 2 sigma"]
    assert (beyond.ours, beyond.paper) == (0.0, pytest.approx(2 / 9))
    assert by_quantity["share of profiles with GLORYS12 within 3 sigma"].ours == 1.0


# The study


@pytest.fixture
def archive(brief_store, tmp_path):
    return shutil.copytree(brief_store, tmp_path / "brief.zarr")


@pytest.fixture
def sources(tmp_path):
    return (
        write_hycom(tmp_path / "hycom.nc", Model()),
        write_cmems(tmp_path / "glorys.nc", Model(depths=np.array([0.0, *CMEMS_DEPTHS]))),
    )


def models_of(sources):
    return [argument for source in sources for argument in ("--model", source)]


@pytest.mark.compiled
def test_the_path_leads_from_fix_to_fix(brief_store):
    with open_mission(brief_store) as archive:
        for number in (1, 2, 3):
            data = read_profile_data(archive, number)
            path = dive_path(archive, data)
            table = data.table
            last = np.array([path.latitude[-1], path.longitude[-1]])
            leave = np.array([table["exit_latitude"], table["exit_longitude"]])
            drift = float((table["exit_time"] - path.time[-1]) / np.timedelta64(1, "s"))
            assert 0.0 <= drift < 120.0
            # What is left is the drift at the surface, which the fixes around it tell.
            np.testing.assert_allclose(last, leave, atol=1.0 * drift / 1.1e5)
            assert abs(float(table["entry_latitude"]) - path.latitude[0]) < 1e-3
            assert path.depth.max() == pytest.approx(float(table["max_depth"]), abs=0.5)
            assert path.depth.min() >= 0.0


@pytest.mark.compiled
def test_the_models_mean_is_that_of_the_field_along_the_dive(archive, sources):
    answer = program("analyze", archive, "reanalysis", *models_of(sources), "--workers", 0)
    assert answer.status == 0, answer.err
    assert check_archive(archive) == []
    with open_mission(archive) as opened:
        group, root = opened["reanalysis"].to_dataset().load(), opened.to_dataset().load()
        assert group.attrs["complete"]
        assert group.attrs["models"] == {"HYCOM": [str(sources[0])], "GLORYS12": [str(sources[1])]}
        for number in (1, 2, 3):
            path = dive_path(opened, read_profile_data(opened, number))
            hours = (path.time - START) / np.timedelta64(1, "h")
            wanted = linear(hours, path.depth, path.latitude, path.longitude).mean(axis=0)
            row, table = group.sel(profile=number), root.sel(profile=number)
            for name in ("HYCOM", "GLORYS12"):
                found = row.sel(model=name)
                velocity = np.array([found["north"], found["east"]])
                np.testing.assert_allclose(velocity, wanted, atol=1e-6)
                assert found["covered_fraction"] == 1.0
                apart = velocity - [table["dac_north"], table["dac_east"]]
                covariance = np.array([
                    [table["dac_north_std"] ** 2, table["dac_covariance"]],
                    [table["dac_covariance"], table["dac_east_std"] ** 2],
                ])  # fmt: skip
                assert float(found["distance"]) ** 2 == pytest.approx(apart @ np.linalg.inv(covariance) @ apart)
                assert float(found["vector_difference"]) == pytest.approx(np.hypot(*apart))
            assert row["time"].values == path.time[len(path.time) // 2]
    folder = archive.with_name("brief-studies") / "reanalysis"
    assert {path.name for path in folder.iterdir()} == {
        "agreement.csv", "figure_8.png", "profiles.csv", "reanalysis.json", "table_4.csv", "table_4.md",
    }  # fmt: skip
    with (folder / "agreement.csv").open() as file:
        rows = {(row["of"], row["against"]): row for row in csv.DictReader(file)}
    assert float(rows["GLORYS12", "HYCOM"]["vector_rmsd"]) < 1e-6
    assert rows["HYCOM", "glider"]["profiles"] == "3"
    assert json.loads((folder / "reanalysis.json").read_text())["facts"]["profiles"] == [1, 2, 3]
    assert "vector RMSD, HYCOM" in answer.out
    before = check_shown_as_left(archive, "reanalysis", folder, folder.with_name("again"))
    changed = {"north": np.array([0.9, np.nan])}
    after = shown_after(
        archive, "reanalysis", folder.parent, lambda copy: put_table_rows(copy, {0: changed}, "reanalysis")
    )  # fmt: skip
    assert after.tables["profiles"][0]["north"] == 0.9
    assert "GLORYS12 has no value for 1 of 3 profiles" in "".join(after.remarks)
    assert after.tables["table_4"][0]["HYCOM speed"] > 0.9
    check_figure_follows(before, after, "figure_8")


@pytest.mark.compiled
def test_a_depth_weighs_as_long_as_the_glider_was_there(archive, tmp_path):
    def layered(time, depth, latitude, longitude):
        return np.stack(np.broadcast_arrays(0.01 * depth + 0.0 * (time + latitude + longitude), 0.0 * depth), axis=-1)

    source = write_cmems(tmp_path / "layers.nc", Model(velocity=layered))
    with open_mission(archive) as opened, open_models([str(source)]) as models:
        data = read_profile_data(opened, 2)
        (current,) = archived_currents(opened, [2], data.estimate)
        row = compare_with_models(opened, data, current, models)
    depth = data.measured[:, 3]
    assert row["north"][0] == pytest.approx(0.01 * np.maximum(depth, 0.0).mean(), abs=1e-6)


@pytest.mark.compiled
def test_a_dive_outside_a_model_has_no_value_and_a_count(archive, tmp_path):
    elsewhere, shallow = Model(), Model()
    elsewhere.longitudes = elsewhere.longitudes + 10.0
    shallow.depths = shallow.depths[shallow.depths <= 20.0]
    sources = (write_hycom(tmp_path / "h.nc", elsewhere), write_cmems(tmp_path / "g.nc", shallow))
    answer = program("analyze", archive, "reanalysis", *models_of(sources), "--workers", 0)
    assert answer.status == 0, answer.err
    assert "HYCOM has no value for 3 of 3 profiles: outside box 3" in answer.out
    assert "GLORYS12 has no value for 3 of 3 profiles: outside depth 3" in answer.out
    with open_mission(archive) as opened:
        group = opened["reanalysis"].to_dataset().load()
    assert np.isnan(group["north"]).all()
    assert np.isnan(group["distance"]).all()
    box, deep = group.sel(model="HYCOM"), group.sel(model="GLORYS12")
    np.testing.assert_array_equal(box["outside_box"], group["records"])
    np.testing.assert_allclose(deep["outside_depth"] / group["records"], 1.0 - deep["covered_fraction"])
    assert ((deep["covered_fraction"] > 0.2) & (deep["covered_fraction"] < 0.8)).all()


@pytest.mark.compiled
def test_the_smoothed_estimate_is_held_against_its_own_current(archive, sources):
    answer = program(
        "analyze", archive, "reanalysis", *models_of(sources[:1]), "--estimate", "smoothed", "--profiles", "2",
        "--workers", 0,
    )  # fmt: skip
    assert answer.status == 0, answer.err
    with open_mission(archive) as opened:
        row = opened["reanalysis"].to_dataset().load().sel(profile=2, model="HYCOM")
        table = opened.to_dataset().load().sel(profile=2)
        assert np.isnan(opened["reanalysis"].to_dataset()["north"].sel(profile=1)).all()
    apart = np.array([row["north"] - table["dac_north_smoothed"], row["east"] - table["dac_east_smoothed"]])
    assert float(row["vector_difference"]) == pytest.approx(np.hypot(*apart))
    assert (archive.with_name("brief-studies") / "reanalysis-smoothed" / "table_4.csv").is_file()


@pytest.mark.compiled
@pytest.mark.usefixtures("undrawn_studies")
def test_the_ellipse_is_that_of_the_study_of_the_currents_where_it_was_run(archive, sources):
    with open_mission(archive) as opened:
        (before,) = archived_currents(opened, [2], "adjoint")
    answer = program("analyze", archive, "reanalysis", *models_of(sources[:1]), "--profiles", "2", "--workers", 0)
    assert "the ellipses are those of the mission's run" in answer.out
    made = program(
        "analyze", archive, "currents", "--profiles", "2", "--workers", 0, "--set", "currents.actuation_error=1"
    )
    assert made.status == 0, made.err
    answer = program("analyze", archive, "reanalysis", *models_of(sources[:1]), "--profiles", "2,3", "--workers", 0)
    assert answer.status == 0, answer.err
    assert "the ellipses are those of the mission's run" not in answer.out
    with open_mission(archive) as opened:
        after, other = archived_currents(opened, [2, 3], "adjoint")
        study = opened["currents"].to_dataset().sel(profile=2).load()
        distance = float(opened["reanalysis"].to_dataset()["distance"].sel(profile=2, model="HYCOM"))
        apart = opened["reanalysis"].to_dataset().sel(profile=2, model="HYCOM").load()
        table = opened.to_dataset().sel(profile=3).load()
    assert np.trace(after.covariance) > np.trace(before.covariance)
    assert after.covariance[0, 0] == pytest.approx(float(study["current_north_std"]) ** 2)
    assert other.covariance[1, 1] == pytest.approx(float(table["dac_east_std"]) ** 2)
    difference = np.array([apart["north"], apart["east"]]) - after.velocity
    assert distance == pytest.approx(sigma_distance(difference, after.covariance))


@pytest.mark.compiled
def test_a_missing_fix_is_stated_in_the_message_of_the_profile(archive, sources):
    put_table_rows(archive, {1: {"exit_latitude": np.nan}})
    answer = program("analyze", archive, "reanalysis", *models_of(sources), "--workers", 0)
    assert answer.status == 0, answer.err
    assert "profile 2: a fix before or after the dive is missing" in answer.out
    with open_mission(archive) as opened:
        group = opened["reanalysis"].to_dataset().load()
    assert np.isfinite(group["north"].sel(profile=[1, 3])).all()
    assert np.isnan(group["north"].sel(profile=2)).all()


@pytest.mark.compiled
def test_with_all_studies_it_runs_only_where_a_model_is_given(archive):
    request = Request(archive, lambda: local_executor(0))
    assert "`models`" in missing_input("reanalysis", request)
    assert missing_input("reanalysis", replace(request, models=("hycom.nc",))) is None


@pytest.mark.compiled
def test_without_a_usable_model_there_is_one_line(archive, tmp_path):
    lacking = program("analyze", archive, "reanalysis")
    assert lacking.status == 2
    assert "--model" in lacking.line
    absent = program("analyze", archive, "reanalysis", "--model", tmp_path / "none.nc")
    assert absent.status == 2
    assert "none.nc: no such file" in absent.line
    with open_mission(archive) as opened:
        assert "reanalysis" not in opened.children


def test_covariances_are_built_from_deviations_and_their_covariance():
    matrix = covariance_matrix(3.0, 2.0, -1.5)
    np.testing.assert_array_equal(matrix, [[9.0, -1.5], [-1.5, 4.0]])
    several = covariance_matrix([3.0, 0.5], [2.0, np.nan], [-1.5, np.nan])
    np.testing.assert_array_equal(several, [matrix, [[0.25, np.nan], [np.nan, np.nan]]])
