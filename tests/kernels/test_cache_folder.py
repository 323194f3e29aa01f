"""Folder of compiled kernels: private to its owner, and refused if others could have written to it."""

import grp
import os
import pwd
import stat
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from gliderhpc.kernels import cache as compiled_cache

NOBODY = 65534


@pytest.fixture
def cache(monkeypatch):
    """Choose the folder of the kernels as a new process does; return the folder and any warning."""

    def choose(**environment):
        for name in compiled_cache.VARIABLES:
            monkeypatch.delenv(name, raising=False)
        for name, value in environment.items():
            monkeypatch.setenv(name, str(value))
        return compiled_cache.choose_folder()

    return choose


def test_the_folder_is_made_for_us_alone(cache, tmp_path, caplog):
    before = os.umask(0)
    try:
        folder = cache(XDG_CACHE_HOME=tmp_path / "caches")
    finally:
        os.umask(before)
    assert folder.is_relative_to(tmp_path / "caches" / "gliderhpc")
    assert {stat.S_IMODE(made.stat().st_mode) for made in (folder, folder.parent, folder.parents[1])} == {0o700}
    assert caplog.text == ""


def test_the_working_folder_is_never_taken(cache, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache(XDG_CACHE_HOME="caches").is_relative_to(tmp_path / "home" / ".cache")
    assert cache(NUMBA_CACHE_DIR="").is_relative_to(tmp_path / "home" / ".cache")
    assert caplog.text == ""
    for name in compiled_cache.VARIABLES:
        caplog.clear()
        folder = cache(**{name: "kernels"})
        assert folder.is_absolute()
        assert not folder.is_relative_to(tmp_path)
        assert f"kernels-{compiled_cache.kernel_digest()}: not an absolute path" in caplog.text
    assert {path.name for path in tmp_path.iterdir()} == {"home"}


@pytest.mark.parametrize("where", ["itself", "above it", "within it"])
def test_a_folder_that_all_can_write_is_refused(cache, tmp_path, caplog, where):
    folder = tmp_path / "shared" / "kernels"
    inside = folder / f"kernels-{compiled_cache.kernel_digest()}"
    inside.mkdir(parents=True, mode=0o700)
    {"itself": folder, "above it": folder.parent, "within it": inside}[where].chmod(0o777)
    taken = cache(GLIDERHPC_CACHE=folder)
    assert taken.parent != folder
    assert stat.S_IMODE(taken.stat().st_mode) == 0o700
    assert "every user can write to it" in caplog.text
    assert "with mode 0700" in caplog.text
    folder.parent.chmod(0o1777)
    for path in (folder, inside):
        path.chmod(0o700)
    assert cache(GLIDERHPC_CACHE=folder) == inside
    assert cache(NUMBA_CACHE_DIR=folder) == inside
    assert cache(GLIDERHPC_CACHE=folder, NUMBA_CACHE_DIR=tmp_path) == inside


def test_a_folder_that_a_group_can_write_is_refused(cache, tmp_path, caplog, monkeypatch):
    folder = tmp_path / "kernels"
    folder.mkdir()
    folder.chmod(0o770)
    monkeypatch.setattr(compiled_cache, "_is_own_group", lambda group: False)
    assert cache(NUMBA_CACHE_DIR=folder).parent != folder
    assert "its group can write to it" in caplog.text
    monkeypatch.setattr(compiled_cache, "_is_own_group", lambda group: True)
    assert cache(NUMBA_CACHE_DIR=folder).parent == folder


@pytest.mark.skipif(os.geteuid() != 0, reason="only an administrator can give a folder away")
def test_a_folder_of_another_user_is_refused(cache, tmp_path, caplog):
    folder = tmp_path / "kernels"
    folder.mkdir()
    os.chown(folder, NOBODY, NOBODY)
    assert cache(NUMBA_CACHE_DIR=folder).parent != folder
    assert "belongs to another user" in caplog.text


def test_without_a_home_the_cache_lasts_as_long_as_the_process(tmp_path):
    code = (
        "import pathlib\n"
        "pathlib.Path.home = classmethod(lambda cls: (_ for _ in ()).throw(RuntimeError('no home')))\n"
        "from gliderhpc.kernels.cache import compiled_cache\n"
        "assert compiled_cache().is_dir()\n"
        "print(compiled_cache().parent)\n"
    )
    places = (*compiled_cache.VARIABLES, "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in places}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**environment, "TMPDIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    assert Path(done.stdout.strip()).parent == tmp_path
    assert list(tmp_path.iterdir()) == []
    assert "compiled kernels are not stored (no home folder is known)" in done.stderr


def _as_nobody(attempt):
    """Return the exit status of a function run as a user who owns nothing: 0 if it succeeded."""
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            attempt()
        except OSError:
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


# A child that only makes system calls may be forked from a process with threads.
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
@pytest.mark.skipif(os.geteuid() != 0, reason="only an administrator can act as another user")
def test_another_user_can_neither_read_nor_write_compiled_kernels(cache, tmp_path_factory):
    open_to_all = tmp_path_factory.mktemp("open")
    for folder in (open_to_all, *open_to_all.parents):
        if folder.stat().st_uid == os.geteuid() and folder.is_relative_to(tmp_path_factory.getbasetemp().parents[1]):
            folder.chmod(0o755)
    folder = cache(XDG_CACHE_HOME=open_to_all / "caches")
    kernel = folder / "window.nbc"
    kernel.write_bytes(b"x")
    for path in folder.relative_to(open_to_all).parents:
        (open_to_all / path).chmod(0o755)
    assert _as_nobody(lambda: open_to_all.stat()) == 0
    assert _as_nobody(lambda: (folder / "other.nbc").touch()) == 1
    assert _as_nobody(lambda: kernel.read_bytes()) == 1


def test_a_group_is_ones_own_where_nobody_else_is_in_it(monkeypatch):
    user = SimpleNamespace(pw_name="ada", pw_gid=1000)
    groups = {
        1000: SimpleNamespace(gr_name="ada", gr_mem=["ada"]),
        1001: SimpleNamespace(gr_name="lab", gr_mem=[]),
        0: SimpleNamespace(gr_name="root", gr_mem=[]),
    }
    monkeypatch.setattr(pwd, "getpwuid", lambda _: user)
    monkeypatch.setattr(grp, "getgrgid", groups.__getitem__)
    assert [compiled_cache._is_own_group(group) for group in (1000, 1001, 0, 7)] == [True, False, True, False]
    groups[1000].gr_mem.append("bob")
    assert not compiled_cache._is_own_group(1000)


def test_a_folder_that_cannot_be_made_is_refused(cache, tmp_path, caplog):
    (tmp_path / "file").touch()
    assert not cache(GLIDERHPC_CACHE=tmp_path / "file").is_relative_to(tmp_path / "file")
    assert "File exists" in caplog.text or "Not a directory" in caplog.text


def test_a_temporary_folder_goes_with_the_process_that_made_it(monkeypatch, tmp_path):
    ends = []
    monkeypatch.setattr(compiled_cache.atexit, "register", ends.append)
    monkeypatch.setattr(compiled_cache.tempfile, "mkdtemp", lambda prefix: str(tmp_path / "made"))
    (tmp_path / "made").mkdir()
    folder = compiled_cache._temporary_folder()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    own = os.getpid()
    monkeypatch.setattr(compiled_cache.os, "getpid", lambda: own + 1)
    ends[0]()
    assert folder.is_dir()
    monkeypatch.undo()
    ends[0]()
    assert not (tmp_path / "made").exists()


def test_without_a_home_no_folder_is_known(cache, monkeypatch, caplog):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", classmethod(lambda _: (_ for _ in ()).throw(RuntimeError("no home"))))
    assert cache().is_dir()
    assert "no home folder is known" in caplog.text
