"""OceanGliders OG1 export: content of the file, round trip through the importer, and refused requests."""

import errno
import shutil

import netCDF4
import numpy as np
import pytest
import xarray as xr
from support.archives import put_table_rows
from support.missions import program

from gliderhpc import output_files
from gliderhpc.archive.mission import open_mission
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.observations import Fix, open_observations
from gliderhpc.observations.files import appended
from gliderhpc.observations.format import read_reference
from gliderhpc.report.exports.og1 import export_og1
from gliderhpc.report.exports.og1_vocabulary import CURRENT_ESTIMATES, PHASES, POSITION_METHODS, TERMS
from gliderhpc.store_schema import MISSION

pytestmark = pytest.mark.compiled

SINGLE_PRECISION = 1e-6


@pytest.fixture(scope="module")
def exported(brief_store, tmp_path_factory):
    """OG1 file of the brief mission."""
    path = tmp_path_factory.mktemp("og1") / "results.nc"
    answer = program("export", "og1", brief_store, path, "--attribute", "contributor_name=A. Name")
    assert answer.status == 0, answer.err
    assert "3 profiles" in answer.out
    asked = next(line for line in answer.out.splitlines() if line.startswith("note:"))
    assert "contributor_email" in asked
    assert "WMO_IDENTIFIER" in asked
    assert "contributor_name" not in asked
    return path


@pytest.fixture(scope="module")
def content(exported):
    with xr.open_dataset(exported) as dataset:
        return dataset.load()


@pytest.fixture(scope="module")
def archive(brief_store):
    with open_mission(brief_store) as tree:
        yield tree


@pytest.fixture
def changed(brief_store, tmp_path):
    """Copy of the archive that a test may change."""
    return shutil.copytree(brief_store, tmp_path / "copy.zarr")


def rows_of(content, number):
    """Rows of a dive that are records."""
    here = (content["DIVE_NUMBER"].values == number) & (content["PHASE"].values != PHASES["surfacing"])
    return content.isel(N_MEASUREMENTS=np.flatnonzero(here))


def archived(archive, group, name, number):
    row = archive[group].ds.sel(profile=number)
    return row[name].values[~np.isnat(row["time"].values)]


def fix_at(row, end):
    return Fix(row[f"{end}_time"].values, float(row[f"{end}_latitude"]), float(row[f"{end}_longitude"]))


# The format


def test_variables_and_attributes_required_by_og1_are_present(content):
    assert dict(content.sizes) == {"N_MEASUREMENTS": content["TIME"].size}
    for name in ("TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS"):
        assert content[name].dims == ("N_MEASUREMENTS",)
        assert content[content[name].attrs["ancillary_variables"]].dtype == np.int8
    for name in ("TRAJECTORY", "WMO_IDENTIFIER", "PLATFORM_MODEL", "PLATFORM_SERIAL_NUMBER"):
        assert content[name].dtype.kind == "U"
    for name in ("DEPLOYMENT_TIME", "DEPLOYMENT_LATITUDE", "DEPLOYMENT_LONGITUDE"):
        assert content[name].ndim == 0
    attributes = content.attrs
    assert attributes["featureType"] == "trajectory"
    assert "OG-1.0" in attributes["Conventions"]
    assert content["TRAJECTORY"].item() == f"petrel-l_{attributes['start_date']}"
    assert attributes["id"] == f"{content['TRAJECTORY'].item()}_delayed"
    assert attributes["rtqc_method"] == "No QC applied"
    assert attributes["contributor_name"] == "A. Name"
    assert content["TRAJECTORY"].attrs["cf_role"] == "trajectory_id"
    assert attributes["geospatial_vertical_max"] == pytest.approx(float(content["DEPTH"].max()))


def test_places_of_deployment_have_their_cf_names(content):
    assert content["DEPLOYMENT_LATITUDE"].attrs["standard_name"] == "latitude"
    assert content["DEPLOYMENT_LONGITUDE"].attrs["standard_name"] == "longitude"


def test_terms_are_named_by_the_vocabulary_s_own_identifiers(content):
    """Those of the NERC vocabulary server begin with http."""
    texts = [content.attrs["platform_vocabulary"]]
    texts += [content[name].attrs["vocabulary"] for name in ("ROLL", "PITCH", "HEADING")]
    assert all(text.startswith("http://vocab.nerc.ac.uk/collection/") for text in texts)


def test_numbers_are_stored_as_og1_requires_them(exported):
    with netCDF4.Dataset(exported) as file:
        assert file["TIME"].units == "seconds since 1970-01-01T00:00:00Z"
        assert file["LATITUDE"]._FillValue == file["DEPTH"]._FillValue == -9999.9
        assert file["TIME_GPS"]._FillValue == -1.0
        assert file["PHASE"].dtype == np.int8
        assert file.dimensions["N_MEASUREMENTS"].isunlimited()


def test_every_number_has_a_unit_and_a_name(exported):
    with netCDF4.Dataset(exported) as file:
        for name, variable in file.variables.items():
            assert variable.long_name, name
            assert variable.dtype is str or variable.units, name


# The rows


def test_time_increases_and_legs_are_counted_through(content):
    assert (np.diff(content["TIME"].values) > np.timedelta64(0, "s")).all()
    number, phase = content["PROFILE_NUMBER"].values, content["PHASE"].values
    assert np.unique(number).tolist() == [1, 2, 3, 4, 5, 6]
    assert (np.diff(number) >= 0).all()
    depth = content["DEPTH"].values
    for leg in range(1, 7):
        inside = (number == leg) & (phase != PHASES["surfacing"])
        fall = depth[inside][-1] - depth[inside][0]
        assert np.unique(phase[inside]).tolist() == [PHASES["descent" if fall > 0.0 else "ascent"]]
        assert abs(fall) > 30.0


def test_fixes_have_rows_of_their_own(content, archive):
    fixed = np.isfinite(content["LATITUDE_GPS"].values)
    assert fixed.sum() == 6
    assert (content["POSITION_METHOD"].values[fixed] == POSITION_METHODS["gps_fix"]).all()
    np.testing.assert_array_equal(content["LATITUDE"].values[fixed], content["LATITUDE_GPS"].values[fixed])
    np.testing.assert_array_equal(content["TIME"].values[fixed], content["TIME_GPS"].values[fixed])
    assert np.isnan(content["PITCH"].values[fixed]).all()
    table = archive.to_dataset()
    assert content["LATITUDE_GPS"].values[fixed][::2] == pytest.approx(table["entry_latitude"].values)
    assert content["LONGITUDE_GPS"].values[fixed][1::2] == pytest.approx(table["exit_longitude"].values)


def test_the_track_closes_on_both_fixes(content, archive):
    """From the fix to the dive and back only the water moves the glider: no faster than the current and its shear."""
    for number in (1, 2, 3):
        row, rows = archive.to_dataset().sel(profile=number), rows_of(content, number)
        assert (rows["POSITION_METHOD"].values == POSITION_METHODS["between_both_fixes"]).all()
        for end, place in (("entry", 0), ("exit", -1)):
            fix = fix_at(row, end)
            here = Fix(fix.time, float(rows["LATITUDE"][place]), float(rows["LONGITUDE"][place]))
            elapsed = abs((rows["TIME"].values[place] - fix.time) / np.timedelta64(1, "s"))
            assert np.linalg.norm(local_displacement(fix, here)) < 0.6 * elapsed


def test_estimates_are_those_of_the_archive(content, archive):
    rows = rows_of(content, 2)
    every = round(archive.attrs["output_interval"] / archive.attrs["step"])
    yaw = archived(archive, "series", "B_cr", 2)
    first = rows["B_CR_ADJOINT"].values[:5]
    assert first == pytest.approx(yaw[: 5 * every].reshape(5, every).mean(axis=1), rel=SINGLE_PRECISION)
    for name in ("u", "pitch", "X"):
        np.testing.assert_array_equal(rows[f"{name.upper()}_ADJOINT"], archived(archive, "state", name, 2))
    for name in ("B_cr", "w", "depth"):
        for suffix in ("", "_std"):
            values = rows[f"{name}_SMOOTHED{suffix}".upper()]
            np.testing.assert_array_equal(values, archived(archive, "smoothed", f"{name}{suffix}", 2))
    found, stored = rows["B_CR_ADJOINT_STD"].values, archived(archive, "state", "B_cr_std", 2)
    np.testing.assert_allclose(found[np.isfinite(stored)], stored[np.isfinite(stored)], rtol=1e-6)
    speed = np.sqrt(sum(archived(archive, "state", name, 2).astype(float) ** 2 for name in "uvw"))
    assert rows["GLIDE_SPEED"].values == pytest.approx(speed, rel=1e-5)
    flags = archived(archive, "series", "quality", 2)
    assert rows["QUALITY"].values[7] == np.bitwise_or.reduce(flags[7 * every : 8 * every].astype(np.uint8))


def test_horizontal_speed_is_that_of_the_track(content):
    rows = rows_of(content, 1)
    north, east = (np.gradient(rows[f"{axis}_ADJOINT"].values.astype(float)) for axis in "XY")
    steady = slice(100, 200)
    assert rows["GLIDER_HORZ_VELO_MODEL"].values[steady] == pytest.approx(np.hypot(north, east)[steady], abs=5e-3)


def test_the_angle_of_attack_is_that_of_the_motion(content):
    rows = rows_of(content, 2)
    heave, surge = (rows[f"{name}_ADJOINT"].values.astype(float) for name in "WU")
    assert rows["ANGLE_OF_ATTACK"].values == pytest.approx(np.degrees(np.arctan2(heave, surge)), abs=1e-4)
    descending = rows["PHASE"].values == PHASES["descent"]
    assert (
        np.median(rows["ANGLE_OF_ATTACK"].values[descending])
        > 0.0
        > np.median(rows["ANGLE_OF_ATTACK"].values[~descending])
    )


def test_each_dive_has_its_current_once_with_time_place_and_covariance(exported, archive):
    table = archive.to_dataset()
    with xr.open_dataset(exported, group="surfacings") as dataset:
        content = dataset.load()
    assert dict(content.sizes) == {"N_SURFACING": 3}
    assert content["DAC_DIVE_NUMBER"].values.tolist() == [1, 2, 3]
    for place, number in enumerate((1, 2, 3)):
        row, dive = table.sel(profile=number), content.isel(N_SURFACING=place)
        for name, column in (
            ("NORTH", "dac_north_smoothed"), ("EAST", "dac_east_smoothed"), ("NORTH_STD", "dac_north_smoothed_std"),
            ("EAST_STD", "dac_east_smoothed_std"), ("COVARIANCE", "dac_smoothed_covariance"),
        ):  # fmt: skip
            assert float(dive[f"DAC_{name}"]) == float(row[column])
        assert int(dive["DAC_ESTIMATE"]) == CURRENT_ESTIMATES["smoothed"]
        for name, end in (("START", "entry"), ("END", "exit")):
            late = dive[f"DAC_TIME_{name}"].values - row[f"{end}_time"].values
            assert abs(late / np.timedelta64(1, "s")) < 1e-3
        assert dive["DAC_TIME_START"] < dive["DAC_TIME"] < dive["DAC_TIME_END"]
        entry, last = (fix_at(row, end) for end in ("entry", "exit"))
        middle = Fix(entry.time, float(dive["DAC_LATITUDE"]), float(dive["DAC_LONGITUDE"]))
        halves = local_displacement(entry, middle), local_displacement(middle, last)
        np.testing.assert_allclose(*halves, atol=0.05)


def test_currents_stand_on_every_row_of_their_dive(content, archive):
    table = archive.to_dataset()
    for number in (1, 2, 3):
        here = content["DIVE_NUMBER"].values == number
        for name, term in (
            ("dac_north", "NORTH_ADJOINT"), ("dac_east_smoothed_std", "EAST_SMOOTHED_STD"),
            ("dac_north_smoothed", "NORTH"), ("dac_east_smoothed_std", "EAST_STD"),
        ):  # fmt: skip
            found = np.unique(content[f"DAVG_CURR_{term}"].values[here])
            assert found == pytest.approx([float(table[name].sel(profile=number))], rel=SINGLE_PRECISION)
        assert np.unique(content["DAVG_CURR_ESTIMATE"].values[here]).tolist() == [CURRENT_ESTIMATES["smoothed"]]


# The way back


@pytest.mark.long
def test_vertical_velocities_of_the_study(content, changed, tmp_path):
    """Upward; the water's is the difference of the other two; the flag follows descent against ascent."""
    assert not any("VERT" in name for name in content.data_vars)
    assert program("analyze", changed, "vertical").status == 0
    path = tmp_path / "vertical.nc"
    export_og1(changed, path)
    with xr.open_dataset(path) as dataset, xr.open_datatree(changed, engine="zarr") as tree:
        found, group = dataset.load(), tree["vertical"].ds.load()
    water, model, by_depth = (found[name].values for name in ("VERT_CURR_MODEL", "GLIDER_VERT_VELO_MODEL",
                                                                "GLIDER_VERT_VELO_DZDT"))  # fmt: skip
    known = np.isfinite(water)
    assert known.sum() == np.isfinite(group["water_up"].values).sum() > 100
    np.testing.assert_allclose(water[known], (by_depth - model)[known], atol=1e-5)
    assert (found["VERT_CURR_MODEL_STD"].values[known] > 0.0).all()
    descending = known & (found["PHASE"].values == PHASES["descent"])
    assert np.median(by_depth[descending]) < -0.05
    assert np.median(model[descending]) < -0.05
    flags = found["VERT_CURR_MODEL_QC"].values
    assert (flags[~known] == 0).all()
    for number in group["profile"].values:
        row = group.sel(profile=number)
        apart = abs(float(row["difference"])) / float(row["difference_std"])
        here = known & (found["DIVE_NUMBER"].values == number)
        assert set(flags[here]) <= {2 if apart <= 2.0 else 3 if np.isfinite(apart) else 0}
    assert found["VERT_CURR_MODEL"].attrs["ancillary_variables"] == "VERT_CURR_MODEL_QC VERT_CURR_MODEL_STD"
    assert program("import", "og1", path, tmp_path / "back.nc").status == 0
    back = read_reference(tmp_path / "back.nc")
    time = back["reference_time"].values
    rows = np.searchsorted(found["TIME"].values, time)
    for name, sent in (("vertical_current", water), ("vertical_speed", model), ("depth_rate", by_depth)):
        values = back[f"reference_{name}"].values
        assert np.isfinite(values).sum() > 100
        np.testing.assert_allclose(values, sent[rows], rtol=1e-6)


@pytest.mark.long
def test_a_difference_between_descent_and_ascent_is_flagged(changed, tmp_path):
    assert program("analyze", changed, "vertical").status == 0
    put_table_rows(changed, {0: {"difference": 0.05, "difference_std": 0.01}}, "vertical")
    path = tmp_path / "vertical.nc"
    export_og1(changed, path)
    with xr.open_dataset(path) as content:
        here = (content["DIVE_NUMBER"].values == 1) & np.isfinite(content["VERT_CURR_MODEL"].values)
        assert here.any()
        assert (content["VERT_CURR_MODEL_QC"].values[here] == 3).all()


def test_our_importer_reads_the_records_back(exported, archive, brief, tmp_path):
    answer = program("import", "og1", exported, tmp_path / "back.nc")
    assert answer.status == 0, answer.err
    with open_observations(tmp_path / "back.nc") as back, open_observations(brief) as original:
        assert back.profile_numbers == [1, 2, 3]
        assert back.faults == {}
        for number in (1, 2, 3):
            found, sent = back.profile(number), original.profile(number)
            place = np.searchsorted(sent.time, ((found.epoch - sent.epoch) / np.timedelta64(1, "s")) + found.time - 0.5)
            for name in ("roll", "pitch", "depth"):
                assert getattr(found, name) == pytest.approx(getattr(sent, name)[place], rel=SINGLE_PRECISION, abs=1e-7)
            turned = np.angle(np.exp(1j * (found.heading - sent.heading[place])))
            assert np.abs(turned).max() < 1e-6
            units = {"battery_position": 1.0, "battery_rotation": np.pi / 180.0, "ballast_volume": 1e-6}
            for name, unit in units.items():
                values = archived(archive, "observed", name, number)[place] * unit
                assert getattr(found, name) == pytest.approx(values, rel=1e-5, abs=1e-7)
            assert found.entry_fix.latitude == pytest.approx(sent.entry_fix.latitude, abs=1e-9)
            assert found.exit_fix.time == sent.exit_fix.time
    reference = read_reference(tmp_path / "back.nc")
    assert reference["reference_current_north"].values == pytest.approx(
        archive.to_dataset()["dac_north_smoothed"].values, rel=1e-5
    )
    assert np.isfinite(reference["reference_speed"].values).all()


# Fixes that are missing


@pytest.mark.parametrize(
    ("lost", "method"),
    [(("exit",), "from_the_fix_before"), (("entry",), "to_the_fix_after"), (("entry", "exit"), "none")],
)
def test_without_fixes_the_track_says_what_it_rests_on(changed, tmp_path, lost, method):
    nan = float("nan")
    gone = {f"{end}_{what}": nan for end in lost for what in ("time", "latitude", "longitude")}
    put_table_rows(changed, {1: gone})
    export_og1(changed, tmp_path / "out.nc")
    with xr.open_dataset(tmp_path / "out.nc") as content:
        rows = rows_of(content.load(), 2)
    assert (rows["POSITION_METHOD"].values == POSITION_METHODS[method]).all()
    with xr.open_dataset(tmp_path / "out.nc", group="surfacings") as dives:
        assert dives["DAC_DIVE_NUMBER"].values.tolist() == [1, 3]
    known = np.isfinite(rows["LATITUDE"].values)
    assert known.all() if method != "none" else not known.any()
    with open_mission(changed) as archive:
        row = archive.to_dataset().sel(profile=2)
        for end, place in (("entry", 0), ("exit", -1)):
            if end not in lost:
                fix = fix_at(row, end)
                here = Fix(fix.time, float(rows["LATITUDE"][place]), float(rows["LONGITUDE"][place]))
                assert np.linalg.norm(local_displacement(fix, here)) < 1e-3


# What is refused, what is left out


def test_a_failed_profile_is_left_out_and_reported(changed, tmp_path):
    put_table_rows(changed, {1: {"status": "failed", "message": "profile 2: no depth"}})
    answer = program("export", "og1", changed, tmp_path / "out.nc")
    assert answer.status == 0
    assert "profile 2 left out: profile 2: no depth" in answer.out
    assert "2 profiles" in answer.out


@pytest.mark.parametrize(
    ("status", "words"),
    [("pending", "unfinished, 1 of 3 profiles is still to be done; finish it with"), ("failed", "nothing to export")],
)
def test_an_archive_without_results_takes_one_line(changed, tmp_path, status, words):
    rows = (0,) if status == "pending" else (0, 1, 2)
    put_table_rows(changed, {index: {"status": status} for index in rows})
    answer = program("export", "og1", changed, tmp_path / "out.nc")
    assert answer.status == 2
    assert words in answer.line
    assert not (tmp_path / "out.nc").exists()


def test_unreadable_archives_and_unwritable_files_are_refused_in_one_line(brief_store, tmp_path):
    (tmp_path / "there.nc").write_text("mine")
    for arguments, words in (
        ((tmp_path / "none.zarr", tmp_path / "out.nc"), "no such archive"),
        ((tmp_path, tmp_path / "out.nc"), "not an archive of gliderhpc"),
        ((brief_store, tmp_path / "there.nc"), "this file exists; give another name or replace it with --overwrite"),
        ((brief_store, tmp_path / "no" / "out.nc"), "does not exist; create it first"),
        ((brief_store, tmp_path), "is a folder"),
        ((brief_store, tmp_path / "out.nc", "--attribute", "site"), "write it as NAME=VALUE"),
        ((brief_store, tmp_path / "out.nc", "--attribute", "WMO=1"), "give one of TRAJECTORY"),
    ):
        answer = program("export", "og1", *arguments)
        assert answer.status == 2
        assert words in answer.line
    assert (tmp_path / "there.nc").read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["there.nc"]


def test_a_file_is_replaced_on_demand(brief_store, tmp_path):
    (tmp_path / "there.nc").write_text("mine")
    summary = export_og1(
        brief_store, tmp_path / "there.nc", overwrite=True,
        described={"PLATFORM_SERIAL_NUMBER": "sea035", "WMO_IDENTIFIER": "6801706"},
    )  # fmt: skip
    assert "WMO_IDENTIFIER" not in summary.unknown
    with xr.open_dataset(tmp_path / "there.nc") as content:
        assert content["WMO_IDENTIFIER"].item() == "6801706"
        assert content.attrs["id"].startswith("sea035_")


def test_a_full_disk_is_1_and_leaves_nothing(brief_store, tmp_path, monkeypatch):
    def no_room(*_):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(appended.AppendedFile, "_write", no_room)
    monkeypatch.setattr(output_files, "_error_of_write", lambda _: errno.ENOSPC)
    answer = program("export", "og1", brief_store, tmp_path / "out.nc")
    assert answer.status == 1
    assert f"no space left to write {tmp_path / 'out.nc'}; free some space and run it again" in answer.line
    assert list(tmp_path.iterdir()) == []


def test_the_archive_names_what_the_export_calls_its_variables():
    """Every ``og1_name`` of the schema is a variable of the exported file with the same unit and standard name."""
    named = {
        (group.name, variable.name): variable
        for group in MISSION for variable in group.variables if "og1_name" in (variable.attributes or {})
    }  # fmt: skip
    assert ("observed", "pitch") in named
    assert ("/", "dac_north") in named
    for variable in named.values():
        term = TERMS[variable.attributes["og1_name"]]
        assert term.attributes["units"] == variable.units
        if variable.standard_name is not None and "standard_name" in term.attributes:
            assert term.attributes["standard_name"] == variable.standard_name
