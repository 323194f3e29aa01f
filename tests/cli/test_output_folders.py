"""Folders of tables, figures and pages: checked before the work, written atomically, and not left incomplete."""

import errno
import shutil

import pytest
import zarr
from support.missions import program

from gliderhpc.errors import InputError
from gliderhpc.output_files import check_folder, filled_aside


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files_are_moved_when_all_are_there(tmp_path):
    out = tmp_path / "new" / "study"
    out.mkdir(parents=True)
    (out / "a.csv").write_text("old")
    (out / "mine.txt").write_text("mine")
    with filled_aside(out) as aside:
        (aside / "a.csv").write_text("new")
        (aside / "b.csv").write_text("new")
        assert (out / "a.csv").read_text() == "old"
    assert {name: (out / name).read_text() for name in names(out)} == {
        "a.csv": "new", "b.csv": "new", "mine.txt": "mine",
    }  # fmt: skip


def fill_and_fail(out, *, error, theirs=None):
    """Write a file aside, and one that another program puts straight into the folder; then fail."""
    with filled_aside(out) as aside:
        (aside / "ours").write_text("half")
        if theirs:
            (out / theirs).touch()
        raise error


def test_a_failed_write_leaves_no_files(tmp_path):
    lost = OSError(errno.EIO, "Input/output error")
    with pytest.raises(InputError, match=r"study: cannot be written \(Input/output error\); give another `out`"):
        fill_and_fail(tmp_path / "new" / "study", error=lost)
    assert names(tmp_path) == []


def test_a_full_disk_is_named_by_the_folder_and_leaves_no_files(tmp_path):
    """The commands end with status 1, as for files and archives: the same command succeeds when there is space."""
    full = OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(OSError, match="No space left on device") as error:
        fill_and_fail(tmp_path / "new" / "study", error=full)
    assert error.value.filename == str(tmp_path / "new" / "study")
    assert names(tmp_path) == []


def test_files_added_by_others_in_the_meantime_are_not_removed(tmp_path):
    with pytest.raises(ZeroDivisionError):
        fill_and_fail(tmp_path / "new", error=ZeroDivisionError(), theirs="theirs")
    assert names(tmp_path / "new") == ["theirs"]


@pytest.mark.parametrize("below", ["", "deeper"])
def test_a_folder_that_cannot_be_made_is_refused(tmp_path, below):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    with pytest.raises(InputError, match="file is not a folder; give another `out`"):
        check_folder(tmp_path / "file" / below)
    with pytest.raises(InputError, match="link is a broken link; remove it or give another `out`"):
        check_folder(tmp_path / "link" / below)
    check_folder(tmp_path / "new" / below)
    assert not (tmp_path / "new").exists()


@pytest.mark.compiled
def test_a_study_is_not_run_for_a_folder_that_cannot_be_made(swift_store, tmp_path):
    out, archive = tmp_path / "file" / "study", shutil.copytree(swift_store, tmp_path / "a.zarr")
    out.parent.touch()
    answer = program("analyze", archive, "reconstruction", "--workers", 0, "--out", out)
    assert answer.status == 2
    assert f"{out}: cannot be written" in answer.err.splitlines()[-1]
    assert "reconstruction" not in zarr.open_group(archive, mode="r")
