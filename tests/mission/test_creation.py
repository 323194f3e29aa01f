"""Creation and replacement of archives: no data are lost when a run stops."""

import shutil
import signal
from contextlib import contextmanager
from functools import partial

import pytest
from support.missions import WHOLE, archive_bytes, program

from benchmarks.clusters import start_program, wait_until
from gliderhpc.errors import InputError
from gliderhpc.mission import cluster, lock
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import Existing, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.platform import read_platform
from gliderhpc.store_schema import create_archive, is_archive, read_commits
from gliderhpc.store_schema.replacement import new_token, replacing, restore_set_aside

NOBODY = ("--platform", "petrel-l", "--scheduler", "tcp://127.0.0.1:1")
SIZES = {"sample": 4, "record": 2, "window": 1, "segment": 1}


@pytest.fixture
def own_copy(swift_store, tmp_path):
    """Return an archive of the swift mission, alone in its folder."""
    return shutil.copytree(swift_store, tmp_path / "own" / "copy.zarr")


@pytest.fixture
def soon_refused(monkeypatch):
    monkeypatch.setattr(cluster, "_CONNECT_TIMEOUT", 0.3)


def names(store):
    """Return the names in an archive's folder."""
    return sorted(entry.name for entry in store.parent.iterdir())


def overwrite(swift, store, executor):
    """Replace an archive with a run in this process."""
    with open_observations(swift) as observations:
        prepared = prepare_mission(observations, read_platform("petrel-l"), MissionSettings())
        return run_mission(prepared, store, executor, existing=Existing.OVERWRITE)


@contextmanager
def stopping(error):
    """Yield an executor that ends with an error before its first result."""
    executor = SerialExecutor()

    def stopped(*_):
        raise error

    executor.stream = stopped
    yield executor


@pytest.mark.usefixtures("soon_refused")
def test_a_scheduler_that_does_not_answer_costs_no_archive(swift, swift_store, own_copy):
    answer = program("run-mission", swift, *NOBODY, "--store", own_copy, "--overwrite")
    assert answer.status == 2
    assert "no Dask scheduler answers" in answer.err
    assert archive_bytes(own_copy, ()) == archive_bytes(swift_store, ())
    assert names(own_copy) == ["copy.zarr"]


@pytest.mark.usefixtures("soon_refused")
def test_a_scheduler_that_does_not_answer_leaves_nothing(swift, tmp_path):
    store = tmp_path / "own" / "new.zarr"
    store.parent.mkdir()
    assert program("run-mission", swift, *NOBODY, "--store", store).status == 2
    assert names(store) == []


@pytest.mark.usefixtures("soon_refused")
def test_a_scheduler_that_does_not_answer_changes_nothing_of_what_is_resumed(swift, own_copy):
    (own_copy / "commits" / "marker" / "c.1").unlink()
    before = archive_bytes(own_copy, ())
    assert program("run-mission", swift, *NOBODY, "--store", own_copy, "--resume").status == 2
    assert archive_bytes(own_copy, ()) == before


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")], ids=["^C", "full"])
def test_a_run_that_commits_nothing_does_not_replace_the_archive(swift, swift_store, own_copy, error):
    with pytest.raises(type(error)):
        overwrite(swift, own_copy, lambda: stopping(error))
    assert archive_bytes(own_copy, ()) == archive_bytes(swift_store, ())
    assert names(own_copy) == ["copy.zarr"]


def test_the_first_commit_replaces(own_copy):
    with replacing(own_copy, partial(create_archive, profiles=[1], sizes=SIZES, attributes={}), new_token()) as stands:
        assert len(names(own_copy)) == 2, "the old one is set aside"
        assert read_commits(own_copy) == {}
        (own_copy / "commits" / "marker" / "c.0").write_bytes(b"a marker")
        stands()
        assert names(own_copy) == ["copy.zarr"]
    assert names(own_copy) == ["copy.zarr"]
    assert list(read_commits(own_copy)) == [0]


@pytest.mark.long
@pytest.mark.parametrize("option", ["--resume", "--overwrite"])
def test_killed_before_its_first_profile(swift, swift_store, own_copy, option):
    """After SIGKILL, the next run with either option finds the old archive."""
    run = start_program(
        "run-mission", swift, "--platform", "petrel-l", "--store", own_copy, "--workers", 1, "--overwrite"
    )
    wait_until(lambda: any(name.endswith(".old") for name in names(own_copy)))
    run.send_signal(signal.SIGKILL)
    run.communicate(timeout=60)
    assert read_commits(own_copy) == {}
    answer = program("run-mission", swift, *WHOLE, "--store", own_copy, option)
    assert answer.status == 0
    assert "this archive is restored, because the run that was to replace it was killed" in answer.err
    assert ("3 profiles are valid; nothing to compute" in answer.err) == (option == "--resume")
    assert archive_bytes(own_copy) == archive_bytes(swift_store)
    assert names(own_copy) == ["copy.zarr"]


def test_an_empty_archive_of_a_killed_run_is_no_obstacle(swift, swift_store, tmp_path):
    """The same command, repeated, runs the mission, since there is nothing to replace."""
    store = tmp_path / "empty.zarr"
    create_archive(store, [1, 2, 3], SIZES, {})
    assert program("run-mission", swift, *WHOLE, "--store", store).status == 0
    assert archive_bytes(store) == archive_bytes(swift_store)


def test_folders_with_like_names_are_left_alone(swift, own_copy):
    """Backups may have such names."""
    theirs = [own_copy.with_name("copy.zarr" + suffix) for suffix in (".old", ".partial", ".0123456789abcdef.old")]
    for folder in theirs:
        folder.mkdir()
        (folder / "thesis.tex").write_text("work")
    assert program("run-mission", swift, *WHOLE, "--store", own_copy, "--overwrite").status == 0
    assert program("run-mission", swift, *WHOLE, "--store", own_copy, "--resume").status == 0
    assert [(folder / "thesis.tex").read_text() for folder in theirs] == ["work"] * 3
    assert names(own_copy) == ["copy.zarr", *sorted(folder.name for folder in theirs)]


def test_a_replaced_archive_that_cannot_be_removed_is_named(own_copy, swift_store, caplog, monkeypatch):
    """Without the permission to write in its folders, it was left without a word."""
    monkeypatch.setattr(shutil, "rmtree", lambda _, ignore_errors: None)
    with replacing(own_copy, partial(shutil.copytree, swift_store), "0123456789abcdef") as discard:
        discard()
    aside = own_copy.with_name("copy.zarr.0123456789abcdef.old")
    assert is_archive(aside)
    assert f"{aside}: the replaced archive cannot be removed; remove it if it is not needed" in caplog.text


def test_an_archive_set_aside_by_an_earlier_run_is_named_and_left(own_copy, caplog):
    aside = shutil.copytree(own_copy, own_copy.with_name("copy.zarr.0123456789abcdef.old"))
    restore_set_aside(own_copy)
    assert is_archive(aside)
    assert f"{aside}: is the archive that an earlier run replaced; remove it if it is not needed" in caplog.text


def test_an_archive_that_cannot_take_its_place(own_copy, swift_store, monkeypatch):
    """The old archive is moved back, and the files of the new one are removed."""
    rename = type(own_copy).rename

    def refused(self, target):
        if self.name.endswith(".partial"):
            raise PermissionError(13, "Permission denied")
        return rename(self, target)

    monkeypatch.setattr(type(own_copy), "rename", refused)
    with pytest.raises(InputError, match=r"cannot be written \(Permission denied\)"):
        create_archive(own_copy, [1], SIZES, {}, overwrite=True)
    assert names(own_copy) == ["copy.zarr"]
    assert archive_bytes(own_copy, ()) == archive_bytes(swift_store, ())


def test_workers_are_asked_whether_they_see_the_lock(tmp_path):
    """The archive does not exist yet at that time."""
    with lock.locked(tmp_path / "new.zarr"):
        assert lock.lock_name(tmp_path / "new.zarr") == str(tmp_path / "new.zarr.lock")
        assert (tmp_path / "new.zarr.lock").exists()


@pytest.mark.parametrize("foreign", ["notes.txt", "inner.zarr"])
def test_an_archive_with_foreign_content_is_not_replaced(swift, swift_store, own_copy, foreign):
    if foreign.endswith(".zarr"):
        shutil.copytree(swift_store, own_copy / foreign)
    else:
        (own_copy / foreign).write_text("mine", "utf-8")
    with pytest.raises(InputError, match=f"contains {foreign}, which is not part of the archive"):
        overwrite(swift, own_copy, lambda: stopping(AssertionError("nothing is run")))
    assert (own_copy / foreign).exists()


def test_no_archive_is_made_within_another(swift, own_copy):
    with pytest.raises(InputError, match="is within the archive"):
        overwrite(swift, own_copy / "smoothed" / "inner.zarr", lambda: stopping(AssertionError("nothing is run")))
    assert not (own_copy / "smoothed" / "inner.zarr").exists()
