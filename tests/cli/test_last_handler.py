"""Unexpected errors, closed streams, and unreadable files."""

import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from support.missions import program, program_apart
from support.observation_files import write

from gliderhpc.cli.console import logging_to
from gliderhpc.cli.main import VERBS, Verbs


@pytest.fixture
def failing(monkeypatch, tmp_path):
    """Give the program a command that ends in an error."""

    def verb(error, log_file=None):
        def fail():
            with logging_to(log_file):
                raise error

        command = click.Command("doctor", callback=fail)
        monkeypatch.setattr(Verbs, "get_command", lambda self, ctx, name: command)
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        return program("doctor")

    return verb


def test_an_unexpected_error_is_one_line_and_a_file(failing, tmp_path):
    answer = failing(ZeroDivisionError("of all things\nand more"))
    assert answer.status == 1
    found = re.fullmatch(
        r"gliderhpc: unexpected error, ZeroDivisionError: of all things; this is a bug in gliderhpc: please send "
        r"(.*) and the command to its maintainers",
        answer.line,
    )
    file = Path(found[1])
    assert file.parent == tmp_path
    assert file.stat().st_mode & 0o077 == 0
    assert "Traceback" in file.read_text()
    assert "Python" in file.read_text().splitlines()[0]


def test_blank_lines_before_the_message_are_skipped(failing):
    answer = failing(RuntimeError("\n        An attempt has been made to start a new process\n  before"))
    assert answer.line.startswith(
        "gliderhpc: unexpected error, RuntimeError: An attempt has been made to start a new process; this is a bug"
    )
    assert "unexpected error, RuntimeError: no message; this" in failing(RuntimeError(" \n")).line


def test_the_traceback_of_an_unexpected_error_is_in_the_log_file(failing, tmp_path):
    log = tmp_path / "run.log"
    answer = failing(ZeroDivisionError("of all things"), log)
    assert answer.status == 1
    assert f"please send {log} and" in answer.err.splitlines()[-1]
    assert "Traceback" not in answer.err
    assert "Traceback" in log.read_text()
    assert list(tmp_path.iterdir()) == [log]


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (
            PermissionError(errno.EACCES, "Permission denied", "a.zarr/zarr.json"),
            2,
            "a.zarr/zarr.json: Permission denied",
        ),
        (OSError(errno.EIO, "Input/output error", "a.nc"), 1, "a.nc: Input/output error"),
        (
            OSError(errno.ENOSPC, "No space left on device", "a.nc"),
            1,
            "no space left to write a.nc; free some space and run it",
        ),
        (MemoryError(), 1, "not enough memory; use fewer --workers"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 1, "not enough memory; use fewer --workers"),
        (
            ImportError("libhdf5.so: failed to map segment from shared object"),
            1,
            "not enough memory; use fewer --workers",
        ),
        (OSError("of no file"), 1, "unexpected error, OSError: of no file"),
        (RecursionError("too deep"), 1, "unexpected error, RecursionError: too deep"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_known_errors_of_the_system(failing, error, status, line):
    answer = failing(error)
    assert answer.status == status
    assert answer.line.startswith(f"gliderhpc: {line}")


def test_a_shortage_of_memory_during_an_import_has_its_own_remedy(monkeypatch):
    def fail():
        raise MemoryError

    monkeypatch.setattr(Verbs, "get_command", lambda self, ctx, name: click.Command("import", callback=fail))
    answer = program("import")
    assert answer.status == 1
    assert answer.line.startswith("gliderhpc: not enough memory; give fewer files at a time, or a machine with more")


def test_an_error_of_a_file_with_controls_in_its_name(failing):
    answer = failing(FileNotFoundError(errno.ENOENT, "No such file", "a\x1b[2J\nb"))
    assert answer.line == "gliderhpc: a\N{REPLACEMENT CHARACTER}[2J b: No such file"


CLOSED = "import os, sys\nos.close({number})\nos.execv(sys.executable, [sys.executable, '-c', {code!r}, 'platforms'])\n"
CODE = "import sys; from gliderhpc.cli import main; main(sys.argv[1:])"
PLATFORMS = [sys.executable, "-c", CODE, "platforms"]


@pytest.mark.parametrize("number", [0, 1, 2])
def test_closed_streams(number):
    done = subprocess.run(
        [sys.executable, "-c", CLOSED.format(number=number, code=CODE)], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written(unbuffered):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            PLATFORMS, stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("gliderhpc: ")


@pytest.mark.parametrize("options", [(), ("petrel-l", "--yaml")], ids=["a table", "lines"])
def test_output_that_nobody_reads(options):
    command = [*PLATFORMS, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        run.stdout.close()
        err = run.stderr.read()
    assert run.returncode == 141
    assert err == ""


def test_an_unknown_backend_of_matplotlib_is_not_used(monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    answer = program_apart("demo", "--help")
    assert (answer.status, answer.err) == (0, "")


def test_a_locale_of_ascii_reads_other_names_or_refuses_them(monkeypatch, tmp_path):
    for name, value in (("LC_ALL", "C"), ("PYTHONUTF8", "0"), ("PYTHONCOERCECLOCALE", "0")):
        monkeypatch.setenv(name, value)
    path = write(tmp_path).rename(tmp_path / "größe.nc")
    answer = program_apart("currents", path, tmp_path / "out.nc")
    assert answer.status == 2
    assert "not valid in ascii; rename it, or use a locale with UTF-8" in answer.line


@pytest.mark.parametrize(
    "arguments",
    [
        ("run-mission", "a.nc", "--platform", "petrel-l", "--store", "a.zarr", "--workers", 10**30),
        ("run-mission", "a.nc", "--platform", "petrel-l", "--store", "a.zarr", "--profiles", "1" * 5000),
        ("run-mission", "a.nc", "--platform", "petrel-l", "--store", "a.zarr", "--worker-timeout", "inf"),
        ("simulate-mission", "a.nc", "--platform", "petrel-l", "--profiles", 10**30),
        ("simulate-mission", "a.nc", "--platform", "petrel-l", "--seed", 10**30),
        ("report", "a.zarr", "--out", "b", "--profile", 10**30),
        ("twin", "windows", "--out", "b", "--seeds", 10**30),
    ],
    ids=lambda arguments: f"{arguments[0]} {arguments[-2]}",
)
def test_huge_numbers_are_wrong_usage(arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = program(*arguments)
    assert answer.status == 2
    assert "Traceback" not in answer.err
    assert len(answer.err) < 1000
    assert list(tmp_path.iterdir()) == []


def test_every_verb_answers_help_apart():
    assert program_apart("--help").status == 0
    assert set(VERBS) >= {"run-mission", "doctor"}


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limit")
def test_a_limit_in_which_the_libraries_do_not_fit_is_refused_at_once():
    """OpenBLAS tries forever to allocate its buffers, or interrupts the process as Ctrl-C does."""
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (300_000_000, 300_000_000)); "
        "from gliderhpc.cli import main; main(['info', 'm.zarr'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "may use 300 MB of address space, and needs at least 600 MB; raise the limit" in done.stderr


@pytest.mark.parametrize("encoding", ["ascii", "ascii:surrogateescape"])
def test_letters_that_the_output_lacks_are_escaped(encoding, monkeypatch, tmp_path):
    """A name with an umlaut ended a command whose output is in ASCII, as an error of the program; also in locale C."""
    monkeypatch.setenv("PYTHONIOENCODING", encoding)
    file = tmp_path / "hull.yaml"
    text = program("platforms", "petrel-l", "--yaml").out
    file.write_text(re.sub("(?m)^name:.*$", "name: hülle", text), encoding="utf-8")
    answer = program_apart("platforms", file)
    assert (answer.status, answer.err) == (0, "")
    assert "h\\xfclle" in answer.out
