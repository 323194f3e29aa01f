"""Output files: never replaced without permission, never a device or an input, and always complete or absent."""

import logging
import os
import shutil
import stat
import subprocess
import sys

import pytest
from support import seaglider_files as made
from support.missions import program
from support.observation_files import write
from support.slocum_files import flight, write_netcdf

from gliderhpc.cli.console import logging_to
from gliderhpc.errors import InputError
from gliderhpc.observations.files.appended import AppendedFile
from gliderhpc.output_files import check_output, write_text, written_aside

VERBS = ("import", "simulate-mission", "calibrate", "tune", "inspect")


def arguments(verb, folder, out):
    """Words of a command that writes a single file, but for the file's options."""
    records = write(folder)
    source = write_netcdf(folder / "glider.nc", flight())
    hull = ("--platform", "petrel-l")
    return {
        "import": ("import", "slocum", source, out),
        "simulate-mission": ("simulate-mission", out, *hull, "--profiles", 1, "--depth", 20, "--workers", 0),
        "calibrate": ("calibrate", records, *hull, "--out", out),
        "tune": ("tune", records, *hull, "--out", out),
        "inspect": ("inspect", records, *hull, "--out", out),
    }[verb]


@pytest.mark.parametrize("verb", VERBS)
def test_an_existing_file_is_left_as_it_is(tmp_path, verb):
    out = tmp_path / "out.nc"
    out.write_text("years of work")
    answer = program(*arguments(verb, tmp_path, out))
    assert answer.status == 2
    assert f"{out}: this file exists; give" in answer.line
    assert out.read_text() == "years of work"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("verb", VERBS)
def test_a_device_is_no_place_even_with_overwrite(tmp_path, verb):
    pipe = tmp_path / "pipe.nc"
    os.mkfifo(pipe)
    answer = program(*arguments(verb, tmp_path, pipe), "--overwrite")
    assert answer.status == 2
    assert "cannot be written, it is a device or a pipe" in answer.line
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_truth_that_is_there_is_not_replaced(tmp_path):
    truth = tmp_path / "out.truth.nc"
    truth.write_text("of another mission")
    answer = program(*arguments("simulate-mission", tmp_path, tmp_path / "out.nc"))
    assert (answer.status, "out.truth.nc: this file exists" in answer.line) == (2, True)
    assert truth.read_text() == "of another mission"
    assert not (tmp_path / "out.nc").exists()


def test_overwrite_replaces(tmp_path):
    out = tmp_path / "out.nc"
    out.write_text("older")
    assert program(*arguments("import", tmp_path, out), "--overwrite").status == 0
    assert out.read_bytes()[1:4] == b"HDF"


@pytest.mark.parametrize("verb", ["calibrate", "tune", "inspect"])
def test_an_input_is_no_output(tmp_path, verb):
    records = write(tmp_path)
    before = records.read_bytes()
    answer = program(verb, records, "--platform", "petrel-l", "--out", records, "--overwrite")
    assert (answer.status, "is one of the inputs" in answer.line) == (2, True)
    linked = tmp_path / "linked.nc"
    linked.hardlink_to(records)
    assert (
        "is one of the inputs" in program(verb, records, "--platform", "petrel-l", "--out", linked, "--overwrite").line
    )
    assert records.read_bytes() == before


def test_places_that_are_refused(tmp_path):
    store = tmp_path / "records.zarr"
    store.mkdir()
    (store / "zarr.json").write_text("{}")
    records = write(tmp_path).rename(tmp_path / "records.nc")
    dangling = tmp_path / "dangling.nc"
    dangling.symlink_to(tmp_path / "nowhere.nc")
    for out, words in (
        (tmp_path, "it is a folder"),
        (dangling, "it is a broken link"),
        (tmp_path / "absent" / "out.nc", "absent does not exist"),
        (store / "out.nc", "lies within the input"),
        (records / "out.nc", "records.nc is a file and not a folder; give another name"),
    ):
        with pytest.raises(InputError, match=words):
            check_output(out, overwrite=True, inputs=[store, "petrel-l"])


def test_an_archive_in_a_file_is_refused(tmp_path):
    records = write(tmp_path)
    answer = program("run-mission", records, "--platform", "petrel-l", "--store", records / "a.zarr", "--workers", "0")
    assert answer.status == 2
    assert f"{records} is a file and not a folder; give another place with --store" in answer.line


@pytest.mark.parametrize("verb", ["currents", "import"])
def test_names_that_libraries_cannot_encode_are_refused_in_one_line(tmp_path, verb):
    """Python reads such names; the netCDF library does not."""
    records = write(tmp_path) if verb == "currents" else made.write_og1(tmp_path / "og1.nc")
    command = (verb,) if verb == "currents" else (verb, "og1")
    odd = tmp_path / os.fsdecode(b"odd\xff.nc")
    shutil.copy(records, odd)
    folder = tmp_path / os.fsdecode(b"odd\xff")
    folder.mkdir()
    for arguments in ((odd, tmp_path / "out.nc"), (records, folder / "out.nc")):
        answer = program(*command, *arguments)
        assert answer.status == 2
        assert "has characters in its path that are not valid in utf-8; rename it, or use a loc" in answer.line
    assert sorted(tmp_path.iterdir()) == sorted([records, odd, folder])


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    held, link = tmp_path / "elsewhere" / "held.txt", tmp_path / "link.txt"
    held.write_text("old")
    link.symlink_to(held)
    write_text(link, "new", overwrite=True)
    assert link.is_symlink()
    assert held.read_text() == "new"


def test_a_failed_write_leaves_no_files(tmp_path):
    out = tmp_path / "out.txt"
    out.write_text("old")
    with pytest.raises(FileNotFoundError), written_aside(out, overwrite=True) as aside:
        (aside.parent / "absent" / "half").write_text("half")
    with pytest.raises(ZeroDivisionError), AppendedFile(tmp_path / "new.nc", {}):
        raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]
    assert out.read_text() == "old"


def test_a_file_that_comes_meanwhile_is_not_replaced(tmp_path):
    out = tmp_path / "out.txt"
    with (
        pytest.raises(InputError, match="another program has written this file meanwhile"),
        written_aside(out, overwrite=False) as aside,
    ):
        out.write_bytes(aside.write_text("ours") * b"x")
    assert out.read_text() == "xxxx"
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]


def test_names_aside_are_random_and_never_too_long(tmp_path):
    out = tmp_path / f"{'n' * 250}.nc"
    names = set()
    for _ in range(2):
        with written_aside(out, overwrite=True) as aside:
            names.add(aside.name)
            aside.write_text("whole")
    assert len(names) == 2
    assert out.read_text() == "whole"


# The log


@pytest.mark.parametrize("content", [b"\x89HDF\r\n", b"name: petrel-l\n", b"2024 is no log line\n"])
def test_a_log_is_not_appended_to_a_file_that_is_not_a_log(tmp_path, content):
    held = tmp_path / "mission.nc"
    held.write_bytes(content)
    (tmp_path / "records").mkdir()
    records = write(tmp_path / "records")
    answer = program("inspect", records, "--platform", "petrel-l", "--log-file", held)
    assert answer.status == 2
    assert f"{held}: exists and is not a log of gliderhpc; give another --log-file" in answer.line
    assert held.read_bytes() == content


def test_a_log_is_appended_to_an_earlier_log_or_an_empty_file(tmp_path):
    log = tmp_path / "run.log"
    log.touch()
    for word in ("first", "second"):
        with logging_to(log):
            logging.getLogger("gliderhpc.test").info(word)
    assert [line.split()[-1] for line in log.read_text().splitlines()] == ["first", "second"]
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="is not a regular file; give another --log-file"), logging_to(pipe):
        pass


LITTLE_ROOM = """
import resource, sys
from gliderhpc.cli import main
resource.setrlimit(resource.RLIMIT_FSIZE, (1024, resource.RLIM_INFINITY))
main(sys.argv[1:])
"""


@pytest.mark.parametrize("verb", ["import", "currents", "simulate-mission", "inspect"])
def test_a_file_that_does_not_fit_is_1_and_the_earlier_one_remains(brief, tmp_path, verb):
    """The netCDF library reports this as an HDF error, and a full disk also as a denied permission."""
    out = tmp_path / ("out.json" if verb == "inspect" else "out.nc")
    if verb == "import":
        write_netcdf(tmp_path / "raw.nc", flight())
    arguments = {
        "import": ("import", "slocum", tmp_path / "raw.nc", out),
        "currents": ("currents", brief, out),
        "simulate-mission": ("simulate-mission", out, "--platform", "petrel-l", "--profiles", 1, "--workers", 0),
        "inspect": ("inspect", brief, "--platform", "petrel-l", "--out", out),
    }[verb]
    assert program(*arguments).status == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    done = subprocess.run(
        [sys.executable, "-c", LITTLE_ROOM, *map(str, arguments), "--overwrite"],
        capture_output=True,
        text=True,
        check=False,
    )
    last = done.stderr.splitlines()[-1]
    assert (done.returncode, "; free some space and run it again" in last) == (1, True), done.stderr
    assert f"gliderhpc: no space left to write {tmp_path}/out" in last
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_another_failure_of_the_library_is_no_full_disk(tmp_path):
    with pytest.raises(RuntimeError, match="NetCDF: HDF error"), written_aside(tmp_path / "out.nc", overwrite=False):
        raise RuntimeError("NetCDF: HDF error")
    assert list(tmp_path.iterdir()) == []
