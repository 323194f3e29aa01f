"""Lock: it may be taken over only from a process known to be dead."""

import errno
import json
import os
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from gliderhpc.errors import InputError
from gliderhpc.mission import lock
from gliderhpc.mission.lock import Holder, lock_name, locked

DEAD = 2**22 + 1
"""Number beyond the largest that Linux gives to a process."""


def left_by(archive, holder):
    Path(lock_name(archive)).write_text(json.dumps(asdict(holder)), "utf-8")


@pytest.fixture
def here(tmp_path):
    """Holder of a lock as this process writes it."""
    with locked(tmp_path / "own.zarr"):
        return Holder(**json.loads((tmp_path / "own.zarr.lock").read_text("utf-8")))


def test_the_lock_of_a_dead_process_is_taken_over(here, tmp_path):
    archive = tmp_path / "a.zarr"
    left_by(archive, replace(here, process=DEAD, token="other"))
    with locked(archive) as token:
        assert token != "other"
    assert not Path(lock_name(archive)).exists()


@pytest.mark.parametrize("change", [{"namespace": "pid:[1]"}, {"namespace": ""}, {"host": "elsewhere"}])
def test_a_process_that_cannot_be_seen_from_here_is_not_taken_for_dead(here, tmp_path, change):
    """A container may share its host's name; a process of the other has no number here. Its lock counts by its age."""
    if here.namespace == "" and "namespace" in change:
        pytest.skip("this system does not name the namespaces of its processes")
    archive = tmp_path / "a.zarr"
    left_by(archive, replace(here, process=DEAD, token="other", **change))
    with pytest.raises(InputError, match="another run is writing it"), locked(archive):
        raise AssertionError
    os.utime(lock_name(archive), (1.0, 1.0))
    with locked(archive) as token:
        assert token != "other"


def test_a_lock_of_an_earlier_version_is_read(here, tmp_path, monkeypatch):
    """Without a namespace in the lock and on this system, the process alone decides, as before."""
    archive, earlier = tmp_path / "a.zarr", asdict(replace(here, process=DEAD))
    del earlier["namespace"]
    (tmp_path / "a.zarr.lock").write_text(json.dumps(earlier), "utf-8")
    monkeypatch.setattr(lock, "_namespace", lambda: "")
    with locked(archive) as token:
        assert token != here.token
        holder = Holder(**json.loads(Path(lock_name(archive)).read_text("utf-8")))
        assert (holder.token, holder.process, holder.namespace) == (token, os.getpid(), "")
    assert not Path(lock_name(archive)).exists()


def test_a_lock_needs_no_hard_links(tmp_path, monkeypatch):
    """Such as exFAT and the file systems of buckets have none."""

    def refuse(*_):
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(os, "link", refuse)
    archive = tmp_path / "a.zarr"
    with locked(archive):
        with pytest.raises(InputError, match="another run is writing it"), locked(archive):
            raise AssertionError
        assert json.loads(Path(lock_name(archive)).read_text("utf-8"))["process"] == os.getpid()
    assert list(tmp_path.iterdir()) == []


def test_a_link_whose_reply_was_lost_is_this_run_s_lock(tmp_path, monkeypatch):
    """NFS repeats the request, and reports that the name exists."""
    real = os.link

    def repeated(*names):
        real(*names)
        real(*names)

    monkeypatch.setattr(os, "link", repeated)
    with locked(tmp_path / "a.zarr") as token:
        assert token in Path(lock_name(tmp_path / "a.zarr")).read_text("utf-8")


def test_a_lock_that_cannot_be_removed_does_not_fail_the_run(tmp_path, monkeypatch, caplog):
    def refuse(_):
        raise OSError(errno.EIO, "no answer")

    with monkeypatch.context() as patched, locked(tmp_path / "a.zarr"):
        patched.setattr(lock.FileLock, "remove", refuse)
    assert "cannot be removed" in caplog.text


def test_an_error_of_the_network_is_one_of_the_system():
    """The library's errors are none, and would end the thread that refreshes the lock."""
    exceptions = pytest.importorskip("obstore.exceptions", reason="the extra 'cloud' is not installed")
    with pytest.raises(OSError, match="no answer"), lock.network_errors():
        raise exceptions.GenericError("no answer\nafter three attempts")
    with pytest.raises(exceptions.AlreadyExistsError), lock.network_errors():
        raise exceptions.AlreadyExistsError("there")
