"""What other users of a machine, and files of others, can do: run nothing, write nothing, and steer no terminal."""

import io
import json
import logging
import os
import shlex
import shutil
import stat
import subprocess
import sys
import threading
from pathlib import Path

import click
import dask
import dask.array as da
import distributed  # noqa: F401 - it brings its settings
import pytest
import xarray as xr
from rich.console import Console
from support.repository import REPOSITORY

from benchmarks.clusters import wait_until
from gliderhpc.cli import console as consoles
from gliderhpc.cli.console import LogFormatter, results, table
from gliderhpc.cli.messages import printable, say
from gliderhpc.errors import InputError
from gliderhpc.kernels import cache as compiled_cache
from gliderhpc.mission import cluster
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.report.page.reproduction import run_command, study_command

NOBODY = 65534

ESCAPES = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\r"


# Compiled kernels


@pytest.fixture
def cache(monkeypatch):
    """Choose the folder of the kernels as a new process does; gives the folder and any warning."""

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
    assert "every user can write it" in caplog.text
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
    assert "its group can write it" in caplog.text
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
    """Exit status of a function that runs as a user who owns nothing: 0 where it succeeded."""
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


# Text of files on terminals


def test_controls_are_shown_and_not_obeyed(capsys):
    assert printable("a\tb\nc") == "a\tb\nc"
    assert printable("a\nb", lines=False) == "a b"
    say(ESCAPES)
    shown = capsys.readouterr().out
    assert not set(shown) & set("\x1b\x07\x9b\u202e\r")
    assert "]0;owned" in shown


def test_tables_obey_neither_controls_nor_markup(monkeypatch):
    screen = io.StringIO()
    monkeypatch.setattr(consoles._Console, "file", property(lambda self: screen, lambda self, value: None))
    cells = (f"{ESCAPES}", "[bold]x[/bold]", "[/nothing]")
    results().print(table("[red]", [cells], ("[blink]a", ":smile:", "b"), ()))
    shown = screen.getvalue()
    assert not set(shown) & set("\x1b\x07\x9b\u202e\r")
    for text in ("[red]", "[bold]x[/bold]", "[/nothing]", "[blink]a", ":smile:"):
        assert text in shown


def test_log_lines_are_single_lines_without_controls():
    record = logging.LogRecord("gliderhpc", logging.WARNING, __file__, 1, "from %s", (f"{ESCAPES}\nERROR all",), None)
    line = LogFormatter().format(record)
    assert "\n" not in line
    assert "\x1b" not in line


def test_every_command_prints_by_the_one_place():
    """No command has a printer of its own."""
    allowed = {"messages.py", "main.py"}
    for path in (REPOSITORY / "gliderhpc" / "cli").glob("*.py"):
        if path.name not in allowed:
            assert "click.echo(" not in path.read_text(), path
    assert issubclass(consoles._Console, Console)
    assert click.echo


# Commands on the page


@pytest.fixture
def hostile():
    """Archive whose attributes would run a command, or be an option, where they are not quoted."""
    evil = "$(touch owned); `touch owned`\n& --store elsewhere"
    settings = {"preset": evil, "engine": evil, "start": "prior", "window": {"length": 40.0}, evil: evil}
    study = xr.Dataset(attrs={"models": {"hycom": [evil, "-x.nc"]}, "complete": True})
    return xr.DataTree(
        xr.Dataset(attrs={"settings": settings, "observations": f"--{evil}", "platform": {}}),
        {"reanalysis": xr.DataTree(study)},
    )


def test_commands_of_the_page_are_quoted(hostile, tmp_path):
    for line in (run_command(hostile, "a b.zarr"), study_command("reanalysis", hostile, "a b.zarr")):
        assert "\n" not in line
        words = shlex.split(line)
        assert words[0] == "gliderhpc"
        assert "a b.zarr" in words
        ran = subprocess.run(
            ["sh", "-c", line.replace("gliderhpc", "printf '%s\\n'", 1)], cwd=tmp_path, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        assert ran.stdout.splitlines() == words[1:]
        assert list(tmp_path.iterdir()) == []
    assert shlex.split(run_command(hostile, "a.zarr"))[2].startswith("./--")


# Clusters


@pytest.fixture
def tls_scheduler(tmp_path):
    """Scheduler as docs/clusters.md starts it; gives its file and the settings of a client with the certificate."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here to make a certificate")
    certificate, key = tmp_path / "certificate.pem", tmp_path / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=gliderhpc", "-keyout",
         key, "-out", certificate], check=True, capture_output=True,
    )  # fmt: skip
    prefix, file = "DASK_DISTRIBUTED__COMM__", tmp_path / "scheduler.json"
    environment = {
        f"{prefix}REQUIRE_ENCRYPTION": "True", f"{prefix}TLS__CA_FILE": certificate,
        f"{prefix}TLS__SCHEDULER__CERT": certificate, f"{prefix}TLS__SCHEDULER__KEY": key,
    }  # fmt: skip
    command = [
        sys.executable, "-m", "dask", "scheduler", "--protocol", "tls", "--host", "127.0.0.1", "--port", "0",
        "--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(file),
    ]  # fmt: skip
    with (tmp_path / "log").open("wb") as log:
        scheduler = subprocess.Popen(
            command, stdout=log, stderr=log, env={**os.environ, **{name: str(v) for name, v in environment.items()}}
        )
    wait_until(file.exists)
    tls = "distributed.comm.tls."
    yield file, {
        "distributed.comm.require-encryption": True, f"{tls}ca-file": str(certificate),
        f"{tls}client.cert": str(certificate), f"{tls}client.key": str(key),
    }  # fmt: skip
    scheduler.kill()
    scheduler.wait()


def test_a_cluster_with_tls_takes_nobody_without_its_certificate(tls_scheduler, monkeypatch, caplog):
    file, settings = tls_scheduler
    monkeypatch.setattr(cluster, "_CONNECT_TIMEOUT", 5.0)
    with dask.config.set(settings):
        assert cluster.examine_cluster(ClusterAddress(file=file)) == (0, 0)
    assert "run code as you" not in caplog.text
    with pytest.raises(InputError, match="takes clients with a certificate only"):
        cluster.examine_cluster(ClusterAddress(file=file))
    plain = json.loads(file.read_text())["address"].replace("tls://", "tcp://")
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        cluster.examine_cluster(ClusterAddress(plain))
    assert "without TLS, so whoever reaches a port of this cluster can run code as you" in caplog.text
    # What this process computes by dask afterwards, it computes itself.
    assert dask.config.get("scheduler", None) is None
    assert int(da.ones(3).sum().compute()) == 3


@pytest.mark.parametrize("content", ["", "[]", "{}", "17", "[" * 5000, "\udcff"])
def test_a_scheduler_file_of_odd_content(tmp_path, content, monkeypatch):
    file = tmp_path / "scheduler.json"
    file.write_bytes(content.encode("utf-8", "surrogateescape"))
    monkeypatch.setattr(cluster, "_FILE_TIMEOUT", 0.2)
    with pytest.raises(InputError, match="not what `dask scheduler --scheduler-file` writes"):
        cluster.examine_cluster(ClusterAddress(file=file))


def test_a_scheduler_file_that_is_being_written_is_waited_for(tmp_path, monkeypatch):
    file = tmp_path / "scheduler.json"
    file.write_text('{"type": "Sched')
    monkeypatch.setattr(cluster, "_CONNECT_TIMEOUT", 0.5)
    writing = threading.Timer(0.5, file.write_text, ['{"address": "tcp://127.0.0.1:1"}'])
    writing.start()
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        cluster.examine_cluster(ClusterAddress(file=file))
    writing.join()
