"""Security: other users and foreign files can run nothing, write nothing and control no terminal."""

import io
import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
import threading

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
from gliderhpc.cli.messages import echo, printable
from gliderhpc.errors import InputError
from gliderhpc.mission import cluster
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.report.page.reproduction import run_command, study_command

ESCAPES = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202egnp.exe\r"


# Text of files on terminals


def test_controls_are_shown_and_not_obeyed(capsys):
    assert printable("a\tb\nc") == "a\tb\nc"
    assert printable("a\nb", lines=False) == "a b"
    echo(ESCAPES)
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
    """No command prints on its own."""
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
        xr.Dataset(
            coords={"profile": [1, 2]}, attrs={"settings": settings, "observations": f"--{evil}", "platform": {}}
        ),
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
    with pytest.raises(InputError, match="accepts only clients with a certificate"):
        cluster.examine_cluster(ClusterAddress(file=file))
    plain = json.loads(file.read_text())["address"].replace("tls://", "tcp://")
    with pytest.raises(InputError, match="no Dask scheduler answers there"):
        cluster.examine_cluster(ClusterAddress(plain))
    assert "without TLS, so anyone who can connect to a port of this cluster can run code as you" in caplog.text
    # What this process computes by dask afterwards, it computes itself.
    assert dask.config.get("scheduler", None) is None
    assert int(da.ones(3).sum().compute()) == 3


@pytest.mark.parametrize("content", ["", "[]", "{}", "17", "[" * 5000, "\udcff"])
def test_a_scheduler_file_with_invalid_content_is_refused(tmp_path, content, monkeypatch):
    file = tmp_path / "scheduler.json"
    file.write_bytes(content.encode("utf-8", "surrogateescape"))
    monkeypatch.setattr(cluster, "_FILE_TIMEOUT", 0.2)
    with pytest.raises(InputError, match="not a file of `dask scheduler --scheduler-file`"):
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
