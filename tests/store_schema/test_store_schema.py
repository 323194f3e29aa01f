"""Archive: created whole, written by rows, opened with xarray alone, checked against its schema."""

import errno
import json
import shutil
import struct
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
import zarr
from support.archives import clear_marker, write_profile

from benchmarks.archive_schema import PAGE, VARIABLES_PAGE, group_table, variable_tables
from benchmarks.sections import section_of
from gliderhpc.errors import InputError
from gliderhpc.store_schema import (
    MISSION,
    SCHEMA_VERSION,
    STUDIES,
    ArchiveRows,
    check_archive,
    committed_rows,
    consolidate,
    create_archive,
    is_archive,
    set_attributes,
    write_table_rows,
)
from gliderhpc.store_schema.codecs import check_text_count
from gliderhpc.store_schema.commits import writable_arrays, write_values
from gliderhpc.store_schema.maintenance import grow_archive
from gliderhpc.store_schema.schema import ArchiveVariable, Group, check_manifests
from gliderhpc.vocabulary import CHANNELS

PROFILES = [18, 19, 20, 68]
SIZES = {"sample": 50, "record": 6, "window": 3, "segment": 2}
ATTRIBUTES = {"step": 0.1, "platform": {"mass": {"total": 88.09}}, "engine": "scipy"}


@pytest.fixture(scope="module")
def created(tmp_path_factory):
    path = tmp_path_factory.mktemp("created") / "mission.zarr"
    create_archive(path, PROFILES, SIZES, ATTRIBUTES)
    return path


@pytest.fixture
def archive(created, tmp_path):
    """Copy of an archive just created."""
    return shutil.copytree(created, tmp_path / "mission.zarr")


def _write_series(path, index: int, n: int) -> None:
    depth = np.linspace(0.0, 100.0, n)
    time = 1.7e9 + 10_000.0 * index + 0.1 * np.arange(n)
    write_profile(
        path,
        index,
        "series",
        {"time": time, "depth": depth, "B_cu": depth / 1000 + index, "B_cr": np.full(n, 10.0 * index)},
    )


def test_a_new_archive_passes_its_own_check(archive):
    assert check_archive(archive) == []
    assert is_archive(archive)


def test_every_variable_has_unit_and_name():
    for group in MISSION:
        for variable in group.variables:
            attributes = variable.all_attributes()
            assert attributes["units"], variable
            assert attributes["long_name"], variable


def test_variables_promised_by_the_interface_are_there():
    channels = {"B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr"}
    state = {"time", "roll", "pitch", "heading", "depth", "X", "Y", "u", "v", "w", "p", "q", "r"}
    outcome = {"start", "stop", "cost", "iterations", "evaluations", "gradient_norm", "retracted", "outcome"}
    promised = {
        "series": channels | {"time", "depth", "quality"},
        "prior": channels,
        "state": state,
        "observed": {"roll", "pitch", "heading", "depth", "battery_position", "ballast_volume", "rudder"},
        "smoothed": state | channels | {f"{name}_std" for name in state | channels if name != "time"},
        "windows": outcome,
        "drift_current": {"north", "east", "start", "stop"},
        "/": {
            "status",
            "message",
            "start_time",
            "dac_north",
            "dac_east_glide_angle",
            "surface_drift_north",
            "exit_time",
        },
    }
    for group, names in promised.items():
        assert names <= {variable.name for variable in MISSION[group].variables}


def test_xarray_alone_opens_it_before_and_after_the_first_profile(archive):
    with xr.open_datatree(archive, engine="zarr") as tree:
        assert set(tree.ds["status"].values) == {"pending"}
        assert tree.attrs["platform"]["mass"]["total"] == 88.09
        assert tree.attrs["step"] == 0.1
        assert np.isnan(tree["series"].ds.B_cr).all()
    _write_series(archive, 3, 50)
    consolidate(archive)
    with xr.open_datatree(archive, engine="zarr") as tree:
        row = tree["series"].ds.B_cr.sel(profile=68)
        assert (row == 30.0).all()
        assert row.attrs["units"] == "N m"
        assert set(row.coords) == {"profile", "sample", "time", "depth"}
        assert tree["series"].ds.B_cr.dtype == np.float32


def test_each_group_opens_alone(archive):
    _write_series(archive, 0, 50)
    for group in MISSION:
        name = None if group.name == "/" else group.name
        with xr.open_dataset(archive, group=name, engine="zarr") as dataset:
            assert list(dataset.profile.values) == PROFILES
            assert set(dataset.variables) == {variable.name for variable in group.variables}


def test_times_decode_and_short_rows_are_filled(archive):
    _write_series(archive, 1, 30)
    with xr.open_dataset(archive, group="series", engine="zarr") as series:
        time = series.time.sel(profile=19)
        assert time.values[10] == np.datetime64("2023-11-15T01:00:01", "ns")
        assert np.isnat(time.values[30:]).all()
        assert np.isnan(series.B_cu.sel(profile=19).values[30:]).all()
        assert series.quality.dtype == np.uint8
        assert series.quality.attrs["flag_masks"] == [1, 2, 4, 8, 16, 32, 64]


def test_lazy_mean_over_profiles_within_a_depth_band(archive):
    for index in range(len(PROFILES)):
        _write_series(archive, index, 50 - 5 * index)
    with xr.open_datatree(archive, engine="zarr", chunks={}) as tree:
        series = tree["series"].ds
        mean = series.B_cu.where((series.depth > 40) & (series.depth < 60)).mean("sample")
        assert mean.chunks is not None
        np.testing.assert_allclose(mean.compute(), 0.05 + np.arange(4), atol=1e-3)


def test_a_row_is_one_chunk_and_writing_it_twice_changes_nothing(archive):
    _write_series(archive, 2, 40)
    files = {file: file.read_bytes() for file in archive.rglob("*") if file.is_file()}
    _write_series(archive, 2, 40)
    assert files == {file: file.read_bytes() for file in archive.rglob("*") if file.is_file()}
    assert sorted(file.name for file in (archive / "series" / "B_cu").iterdir()) == ["c.2.0", "zarr.json"]
    array = zarr.open_group(archive, mode="r")["series/B_cu"]
    assert array.chunks == (1, 50)


def test_a_shorter_row_replaces_all_of_a_longer_one(archive):
    _write_series(archive, 2, 50)
    _write_series(archive, 2, 20)
    with xr.open_dataset(archive, group="series", engine="zarr") as series:
        assert int(series.B_cu.sel(profile=20).notnull().sum()) == 20


def test_the_writes_at_hand_are_finished_before_an_error_is_raised(archive):
    """Nothing is written after it; those behind it are not begun."""

    class Full:
        async def setitem(self, selection, values):
            raise OSError(errno.ENOSPC, "no space left")

    root = zarr.open_group(archive, mode="r+", use_consolidated=False)
    names = [f"series/{name}" for name in ("B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr", "depth", "time")]
    arrays = writable_arrays(root, names)
    with pytest.raises(OSError, match="no space left"):
        write_values([(Full(), 0, 1.0), *((array, 0, 1.0) for array in arrays.values())])
    written = [bool(np.isfinite(root[name][0]).all()) for name in names]
    assert written == [True] * 7 + [False]


def test_window_records_and_flags(archive):
    write_profile(
        archive,
        0,
        "windows",
        {
            "start": np.array([0, 20]),
            "stop": np.array([30, 50]),
            "cost": [0.1, 0.2],
            "retracted": np.array([True, False]),
            "outcome": np.array([0, 1], dtype=np.int8),
        },
    )
    with xr.open_dataset(archive, group="windows", engine="zarr") as windows:
        row = windows.sel(profile=18)
        np.testing.assert_array_equal(row.stop, [30, 50, np.nan])
        np.testing.assert_array_equal(row.outcome, [0, 1, np.nan])
        np.testing.assert_array_equal(row.retracted, [1, 0, np.nan])
        assert windows.outcome.attrs["flag_meanings"] == "converged iteration_limit stalled diverged no_data"


def test_table_rows_are_merged(archive):
    write_table_rows(
        archive, {1: {"status": "done", "dac_north": 0.1}, 3: {"status": "failed", "message": "näs no depth"}}
    )
    write_table_rows(archive, {1: {"dac_east": -0.2, "start_time": np.datetime64("2023-04-01T00:00:00.5")}})
    with xr.open_dataset(archive, engine="zarr") as table:
        assert list(table.status.values) == ["pending", "done", "pending", "failed"]
        assert table.message.sel(profile=68).item() == "näs no depth"
        assert table.dac_north.sel(profile=19).item() == 0.1
        assert table.dac_east.sel(profile=19).item() == -0.2
        assert table.start_time.sel(profile=19).values == np.datetime64("2023-04-01T00:00:00.5", "ns")
        assert np.isnat(table.start_time.sel(profile=18).values)
        assert table.duration.dtype == np.float64
        assert int((table.status == "done").sum()) == 1


def test_table_rows_reach_the_tables_of_groups_below(archive):
    write_table_rows(archive, {1: {"status": "done", "smoothed/passes": 3, "smoothed/outcome": 0}})
    with xr.open_datatree(archive, engine="zarr") as tree:
        assert tree.ds["status"].sel(profile=19).item() == "done"
        np.testing.assert_array_equal(tree["smoothed"].ds["passes"].values, [np.nan, 3, np.nan, np.nan])
        np.testing.assert_array_equal(tree["smoothed"].ds["outcome"].values, [np.nan, 0, np.nan, np.nan])
    for name in ("smoothed/nothing", "nothing/passes"):
        with pytest.raises(KeyError):
            write_table_rows(archive, {1: {name: 3}})
    with pytest.raises(ValueError, match="smoothed/B_cu is not a column of a table"):
        write_table_rows(archive, {1: {"smoothed/B_cu": 3.0}})


def test_every_smoothed_quantity_has_its_deviation_in_its_unit():
    group = MISSION["smoothed"]
    rows = [variable for variable in group.variables if variable.dims == ("profile", "record")]
    values = [
        variable for variable in rows if not variable.name.endswith(("_std", "_noise")) and variable.name != "time"
    ]
    assert len(values) == 18
    for variable in values:
        deviation = group[f"{variable.name}_std"]
        assert deviation.units == variable.units
        assert deviation.long_name == f"standard deviation of {variable.name}"
        assert deviation.standard_name is None
    noise = [variable for variable in rows if variable.name.endswith("_noise")]
    assert [(one.name.removesuffix("_noise"), one.units) for one in noise] == [(name, "1") for name in CHANNELS]


def test_missing_times_are_nan(archive):
    write_table_rows(archive, {0: {"exit_time": np.datetime64("NaT", "ns")}})
    assert np.isnan(zarr.open_group(archive, mode="r")["exit_time"][0])


def _commit(path, index: int, row: dict) -> None:
    ArchiveRows(path).commit(index, row, {"settings": "ab"}, "2026-01-01T00:00:00Z")


def test_markers(archive):
    assert committed_rows(archive) == {}
    _commit(archive, 2, {"status": "done", "window_count": 3})
    _commit(archive, 0, {})
    assert committed_rows(archive) == {2: {"status": "done", "window_count": 3}, 0: {}}
    clear_marker(archive, 2)
    assert committed_rows(archive) == {0: {}}


def test_a_grown_archive_has_the_metadata_of_one_created_with_all_profiles(archive, tmp_path):
    create_archive(tmp_path / "larger.zarr", [*PROFILES, 70, 71], SIZES, ATTRIBUTES)
    grow_archive(archive, [*PROFILES, 70, 71], SIZES)
    grown, larger = (
        {file.relative_to(place): file.read_bytes() for file in place.rglob("*") if file.is_file()}
        for place in (archive, tmp_path / "larger.zarr")
    )
    assert grown == larger


def test_a_grown_table_keeps_its_values_unless_they_are_damaged(archive):
    write_table_rows(archive, {0: {"duration": 600.0, "max_depth": 90.0}})
    (archive / "max_depth" / "c.0").write_bytes(b"damaged")
    grow_archive(archive, [*PROFILES, 70], SIZES)
    root = zarr.open_group(archive, mode="r")
    np.testing.assert_array_equal(root["duration"][:], [600.0, *[np.nan] * 4])
    assert np.isnan(root["max_depth"][:]).all()


def test_rows_that_do_not_fit_are_refused(archive):
    with pytest.raises(ValueError, match="does not fit into one of shape \\(50,\\)"):
        write_profile(archive, 0, "series", {"B_cu": np.zeros(51)})
    with pytest.raises(ValueError, match="without loss"):
        write_profile(archive, 0, "series", {"quality": np.zeros(5)})
    with pytest.raises(ValueError, match="outside the archive's 4 profiles"):
        write_profile(archive, -1, "series", {"B_cu": np.zeros(5)})
    with pytest.raises(ValueError, match="outside the archive's 4 profiles"):
        write_table_rows(archive, {4: {"status": "done"}})
    with pytest.raises(ValueError, match="fixed when"):
        write_table_rows(archive, {0: {"profile": 7}})
    with pytest.raises(ValueError, match="is not a row of a profile"):
        write_profile(archive, 0, "series", {"sample": np.zeros(5)})
    with pytest.raises(KeyError, match="no variable 'B_cx'"):
        write_profile(archive, 0, "series", {"B_cx": np.zeros(5)})


def test_an_existing_archive_is_refused_unless_overwritten(archive):
    write_table_rows(archive, {0: {"status": "done"}})
    with pytest.raises(InputError, match=r"`resume=True`.*`overwrite=True`"):
        create_archive(archive, PROFILES, SIZES, {})
    create_archive(archive, [1, 2], SIZES, {}, overwrite=True)
    with xr.open_dataset(archive, engine="zarr") as table:
        assert list(table.profile.values) == [1, 2]
        assert list(table.status.values) == ["pending", "pending"]
    assert [entry.name for entry in archive.parent.iterdir()] == ["mission.zarr"]


def test_overwrite_never_removes_a_folder_that_is_not_an_archive(tmp_path):
    folder = tmp_path / "papers"
    folder.mkdir()
    (folder / "thesis.tex").write_text("work")
    with pytest.raises(InputError, match="not replaced"):
        create_archive(folder, PROFILES, SIZES, {}, overwrite=True)
    assert (folder / "thesis.tex").exists()
    create_archive(tmp_path / "new" / "deep.zarr", PROFILES, SIZES, {})
    assert is_archive(tmp_path / "new" / "deep.zarr")


def test_bad_arguments_are_refused(tmp_path):
    for profiles in ([], [3, 2], [1, 1], [1.5]):
        with pytest.raises(ValueError, match="profiles must be"):
            create_archive(tmp_path / "a.zarr", profiles, SIZES, {})
    with pytest.raises(TypeError, match="attribute 'when' is not plain JSON"):
        create_archive(tmp_path / "a.zarr", PROFILES, SIZES, {"when": np.datetime64("2023-01-01")})
    assert not is_archive(tmp_path / "a.zarr")


def test_attributes_can_be_added_later(archive):
    set_attributes(archive, {"finished": "2023-04-02T00:00:00Z"})
    with xr.open_datatree(archive, engine="zarr") as tree:
        assert tree.attrs["finished"] == "2023-04-02T00:00:00Z"
        assert tree.attrs["engine"] == "scipy"


def _damage(path, group: str):
    return zarr.open_group(path, mode="r+", use_consolidated=False)[group]


@pytest.mark.damages_archive
def test_check_names_every_corruption(archive):
    series = _damage(archive, "series")
    del series["B_cu"]
    del series["B_cv"]
    series.create_array("B_cv", shape=(4, 50), chunks=(2, 50), dtype="float64", dimension_names=("profile", "sample"))
    series["B_cw"].attrs["units"] = "kN"
    series["extra"] = np.zeros(3)
    _damage(archive, "windows")["profile"][:] = [1, 2, 3, 4]
    _damage(archive, "/")["status"][1] = "lost"
    del zarr.open_group(archive, mode="r+", use_consolidated=False)["prior"]
    found = check_archive(archive)
    expected = [
        "series/B_cu: the variable is missing",
        "series/B_cv: chunks are (2, 50), not (1, 50)",
        "series/B_cv: dtype is float64, not float32",
        "series/B_cv: attribute units is missing",
        "series/B_cw: attribute units is 'kN', not 'N'",
        "series/extra: not in the schema",
        "windows/profile: the profiles' numbers differ from those of the root",
        "/status: entry 1 is 'lost', not one of pending, done, failed",
        "prior: the group is missing",
    ]
    assert [line for line in expected if line not in found] == []


@pytest.mark.damages_archive
def test_check_names_wrong_shape_dims_and_fill(archive):
    state = _damage(archive, "state")
    for name in ("u", "v", "w"):
        del state[name]
    attributes = MISSION["state"]["u"].all_attributes()
    common = {"chunks": (1, 6), "dtype": "float32", "attributes": attributes}
    state.create_array("u", shape=(4, 7), dimension_names=("profile", "record"), fill_value=np.nan, **common)
    state.create_array("v", shape=(4, 6), dimension_names=("profile", "sample"), fill_value=np.nan, **common)
    state.create_array("w", shape=(4, 6), dimension_names=("profile", "record"), fill_value=0, **common)
    found = "\n".join(check_archive(archive))
    assert "state/u: shape is (4, 7), but its coordinates have (4, 6)" in found
    assert "state/v: dimensions are ('profile', 'sample'), not ('profile', 'record')" in found
    assert "state/w: fill value is 0.0, not nan" in found


@pytest.mark.damages_archive
def test_an_archive_of_another_schema_is_reported_as_such_and_no_more(archive):
    zarr.open_group(archive, mode="r+", use_consolidated=False).attrs["schema_version"] = "0.1"
    (difference,) = check_archive(archive)
    assert difference.startswith(f"/: schema_version is '0.1', but this program's is '{SCHEMA_VERSION}'")


def _group(archive, name):
    return zarr.open_group(archive, mode="r+", use_consolidated=False)[name]


def _metadata(archive, name, change):
    """Change a variable's own metadata file."""
    path = archive / name / "zarr.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))


CORRUPTIONS = {
    "a group is gone": (lambda a: shutil.rmtree(a / "smoothed"), "smoothed: the group is missing"),
    "a variable is gone": (lambda a: shutil.rmtree(a / "state" / "u"), "state/u: the variable is missing"),
    "a stranger": (lambda a: _group(a, "/").create_array("x", shape=(4,), dtype="i4"), "//x: not in the schema"),
    "another unit": (
        lambda a: _metadata(a, "series/B_cr", lambda m: m["attributes"].update(units="kN m")),
        "series/B_cr: attribute units is 'kN m', not 'N m'",
    ),
    "no standard name": (
        lambda a: _metadata(a, "dac_east", lambda m: m["attributes"].pop("standard_name")),
        "//dac_east: attribute standard_name is missing",
    ),
    "other flags": (
        lambda a: _metadata(a, "series/quality", lambda m: m["attributes"].update(flag_masks=[1, 2])),
        "series/quality: attribute flag_masks is [1, 2]",
    ),
    "another type": (
        lambda a: _metadata(a, "prior/B_cu", lambda m: m.update(data_type="float64")),
        "prior/B_cu: dtype is float64, not float32",
    ),
    "another fill": (
        lambda a: _metadata(a, "windows/start", lambda m: m.update(fill_value=0)),
        "windows/start: fill value is 0, not -1",
    ),
    "a shorter row": (
        lambda a: _metadata(a, "observed/pitch", lambda m: m.update(shape=[4, 5])),
        "observed/pitch: shape is (4, 5), but its coordinates have (4, 6)",
    ),
    "other chunks": (
        lambda a: _metadata(a, "smoothed/w", lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=[4, 6])),
        "smoothed/w: chunks are (4, 6), not (1, 6)",
    ),
    "other dimensions": (
        lambda a: _metadata(a, "state/v", lambda m: m.update(dimension_names=["profile", "sample"])),
        "state/v: dimensions are ('profile', 'sample')",
    ),
    "no checksum": (
        lambda a: _metadata(a, "observed/depth", lambda m: m["codecs"].pop()),
        "observed/depth: codecs are blosc, not blosc, crc32c",
    ),
    "a count that does not count": (
        lambda a: _group(a, "series/sample").__setitem__(3, 7), "series/sample: does not count from 0",
    ),
    "stale consolidated metadata": (
        lambda a: _group(a, "series/B_cu").attrs.update(comment="new"),
        "series/B_cu: the consolidated metadata differs from its own",
    ),
    "metadata that is no JSON": (
        lambda a: (a / "drift_current" / "north" / "zarr.json").write_text("{"),
        "drift_current/north: the metadata cannot be read",
    ),
}  # fmt: skip


@pytest.mark.damages_archive
@pytest.mark.parametrize(("damage", "difference"), CORRUPTIONS.values(), ids=CORRUPTIONS)
def test_check_names_each_corruption_of_the_schema(archive, damage, difference):
    damage(archive)
    found = check_archive(archive)
    assert any(line.startswith(difference) for line in found), found
    name = difference.partition(":")[0]
    assert all(line.startswith((name, "the consolidated", name.lstrip("/"))) for line in found), found


def test_the_pages_are_the_schema():
    assert section_of(PAGE.read_text("utf-8"), "groups") == group_table()
    page = VARIABLES_PAGE.read_text("utf-8")
    assert section_of(page, "schema") == variable_tables()
    for group in (*MISSION, *STUDIES):
        for variable in group.variables:
            assert f"| `{variable.name}` |" in page


def test_check_refuses_what_is_no_archive(tmp_path):
    with pytest.raises(InputError, match="not an archive of gliderhpc"):
        check_archive(tmp_path)


@pytest.mark.parametrize("content", [b"\0\0\0\0", b"\1\0\0\0\1\0\0\0a"])
def test_a_sound_text_chunk_passes(content):
    check_text_count(content)


@pytest.mark.parametrize("content", [b"\2\0\0\0\1\0\0\0a", b"\xc9\x84\xcf\x2b" * 9])
def test_a_text_chunk_claims_no_more_than_it_holds(content):
    with pytest.raises(ValueError, match="bytes claims"):
        check_text_count(content)


def test_a_damaged_text_chunk_takes_no_memory(tmp_path):
    """Zarr would allocate memory for the number of strings stated in the chunk's first bytes."""
    texts = zarr.create_array(store=str(tmp_path), shape=(4,), dtype="string", name="marker", compressors=None)
    texts[:] = np.array(["a", "b", "c", "d"])
    (chunk,) = [path for path in (tmp_path / "marker" / "c").rglob("*") if path.is_file()]
    chunk.write_bytes(struct.pack("<I", 735_028_105) + chunk.read_bytes()[4:])
    with pytest.raises(ValueError, match="claims 735028105 texts"):
        zarr.open_array(str(tmp_path), path="marker", mode="r")[:]


def test_opening_an_archive_registers_its_codecs():
    code = (
        "import gliderhpc.store_schema.location, zarr; "
        "print(zarr.registry.get_codec_class('blosc').__name__, zarr.registry.get_codec_class('vlen-utf8').__module__)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["InlineBloscCodec", "gliderhpc.store_schema.codecs"]


def test_a_study_with_rows_needs_a_manifest():
    rows = ArchiveVariable("by_depth", ("profile", "bin"), "float64", "N m", "yaw moment by depth")
    manifest = ArchiveVariable("manifest", ("profile",), "string", "1", "digests")
    check_manifests([Group("calmness", "calm profiles", (rows, manifest))])
    with pytest.raises(ValueError, match=r"\[calmness\]: by_depth has a row for each profile, so .* 'manifest \| prof"):
        check_manifests([Group("calmness", "calm profiles", (rows,))])
