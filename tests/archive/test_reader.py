"""Reader that opens an archive's groups on demand, compared with xarray's tree of all groups."""

import shutil
import warnings

import numpy as np
import pytest
import xarray as xr
from support.archives import Content, write_archive
from support.missions import program

from gliderhpc.archive import profile
from gliderhpc.archive.mission import archive_errors, open_for_reading, open_mission
from gliderhpc.archive.profile import ESTIMATES, read_profile_data, read_recorded_profiles
from gliderhpc.errors import InputError
from gliderhpc.report.exports import og1
from gliderhpc.report.page import mission_page
from gliderhpc.store_schema import create_study, finish_study, set_attributes
from gliderhpc.store_schema.create import check_location


@pytest.fixture
def archive(tmp_path):
    path = write_archive(tmp_path / "mission.zarr", Content(1))
    create_study(path, "events", sizes={"event": 2})
    finish_study(path, "events", {})
    return path


def test_every_group_is_that_of_the_tree(archive):
    with open_for_reading(archive) as ours, open_mission(archive) as theirs:
        assert set(ours.children) == set(theirs.children)
        assert ours.attrs == theirs.attrs
        assert ours.sizes == theirs.sizes
        xr.testing.assert_identical(ours.to_dataset().load(), theirs.to_dataset().load())
        for name, group in ours.children.items():
            xr.testing.assert_identical(group.to_dataset().load(), theirs[name].to_dataset().load())
            assert group.attrs == theirs[name].attrs
            assert group.sizes == theirs[name].sizes


def test_a_name_is_a_group_or_a_variable_of_the_table(archive):
    with open_for_reading(archive) as opened, open_mission(archive) as tree:
        assert opened["events"] is opened.children["events"]
        xr.testing.assert_identical(opened["max_depth"].load(), tree["max_depth"].load())
        with pytest.raises(KeyError, match="depht"):
            opened["depht"]


@pytest.mark.damages_archive
def test_a_group_is_opened_when_it_is_asked_for(archive):
    """Damage of a group that is not read has no effect."""
    (archive / "events" / "profile" / "c.0").write_bytes(b"damaged")
    with open_for_reading(archive) as opened:
        assert opened["series"].to_dataset().sizes["profile"] == 1
        with pytest.raises(InputError, match="events/profile"), archive_errors(archive):
            opened["events"].to_dataset().load()


@pytest.mark.damages_archive
@pytest.mark.parametrize("opened", [open_mission, open_for_reading])
def test_archives_of_other_versions_are_refused_by_every_way_to_open(opened, archive):
    set_attributes(archive, {"schema_version": "999.0"})
    with pytest.raises(InputError, match=r"the archive's schema has version 999.0, but this program reads"):
        opened(archive)


@pytest.mark.compiled
@pytest.mark.parametrize("estimate", ESTIMATES)
def test_records_alone_are_those_of_the_whole_profile(brief_store, estimate):
    with open_for_reading(brief_store) as opened:
        (_, records), whole = read_recorded_profiles(opened, [1, 2]), read_profile_data(opened, 2, estimate)
        with pytest.raises(InputError, match="no profile 9"):
            read_recorded_profiles(opened, [2, 9])
    for name, value in vars(records).items():
        np.testing.assert_equal(getattr(whole, name), value, err_msg=name)
    assert len(records.measured) == len(records.record_time) > 100


@pytest.mark.compiled
def test_records_read_together_are_those_read_one_by_one(brief_store, monkeypatch):
    with open_for_reading(brief_store) as opened:
        together = read_recorded_profiles(opened, [1, 2])
        monkeypatch.setattr(profile, "_READ_AT_ONCE", 1)
        one_by_one = read_recorded_profiles(opened, [1, 2])
    for ours, theirs in zip(together, one_by_one, strict=True):
        for name, value in vars(ours).items():
            np.testing.assert_equal(value, getattr(theirs, name), err_msg=name)


@pytest.mark.parametrize("whole", [False, True], ids=["without commits", "whole"])
def test_a_copy_by_xarray_is_named_as_such(whole, tmp_path, brief_store):
    """It has the groups of an archive and none of its commits: the commands called it damaged, in 274 places."""
    copy = tmp_path / "dive.zarr"
    with warnings.catch_warnings():
        # Zarr warns that consolidated metadata is not yet part of its format.
        warnings.simplefilter("ignore")
        with xr.open_datatree(brief_store, engine="zarr") as tree:
            content = tree.load().map_over_datasets(lambda group: group.drop_encoding())
            if not whole:
                del content["commits"]
            content.to_zarr(copy)
    for arguments in (("info", copy), ("check", copy), ("compare", copy, brief_store)):
        answer = program(*arguments)
        assert answer.status == 2
        assert "a copy of results, such as of one dive, that xarray wrote" in answer.line
    with pytest.raises(InputError, match="copy of results"):
        open_mission(copy)
    with pytest.raises(InputError, match="not an archive"):
        check_location(str(copy), overwrite=True)


def _replaced(path):
    """Put another archive in an archive's place, as ``run-mission --overwrite`` does."""
    write_archive(path.with_name("other.zarr"), Content(1))
    path.rename(path.with_name("old"))
    path.with_name("other.zarr").rename(path)


def test_an_archive_that_is_replaced_while_it_is_read_is_named(archive):
    """Otherwise the values of two runs would be mixed, or chunks would seem to be damaged."""
    with (
        pytest.raises(InputError, match="another run replaced it while it was read; try again"),
        archive_errors(archive),
    ):
        _replaced(archive)


def _reading_replaced(path, error):
    with archive_errors(path):
        _replaced(path)
        raise error


@pytest.mark.parametrize("error", [InputError("a chunk is missing"), ValueError("cannot reshape array")])
def test_the_replacement_explains_errors_that_follow_from_it(archive, error):
    with pytest.raises(InputError, match="another run replaced it"):
        _reading_replaced(archive, error)


def test_no_export_is_left_of_an_archive_that_is_replaced_meanwhile(swift_store, tmp_path, monkeypatch):
    copy, export = tmp_path / "m.zarr", og1._export
    shutil.copytree(swift_store, copy)

    def replace_after(*arguments):
        export(*arguments)
        _replaced(copy)

    monkeypatch.setattr(og1, "_export", replace_after)
    answer = program("export", "og1", copy, tmp_path / "og1.nc")
    assert answer.status == 2
    assert answer.line.endswith("m.zarr: another run replaced it while it was read; try again")
    assert list(tmp_path.glob("*.nc*")) == []


def test_no_page_is_written_of_an_archive_that_is_replaced_meanwhile(swift_store, tmp_path, monkeypatch):
    copy, make = tmp_path / "m.zarr", mission_page.profile_page
    shutil.copytree(swift_store, copy)

    def replace_after(*arguments):
        page = make(*arguments)
        _replaced(copy)
        return page

    monkeypatch.setattr(mission_page, "profile_page", replace_after)
    answer = program("report", copy, "--out", tmp_path / "report", "--profile", 2)
    assert answer.status == 2
    assert answer.line.endswith("m.zarr: another run replaced it while it was read; try again")
    assert not (tmp_path / "report").exists()
