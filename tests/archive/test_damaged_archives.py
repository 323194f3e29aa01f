"""Damaged archives with every command that reads them: one line, whatever the damage."""

import os
import re
import shutil

import pytest
from support.damages import damages
from support.missions import program

from gliderhpc.archive.mission import archive_errors, open_mission
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.store_schema import create_study, restored_on_error
from gliderhpc.studies import validation

pytestmark = pytest.mark.compiled

CHOSEN = (
    "zarr.json rubbish", "zarr.json nested", "zarr.json a folder", "zarr.json without attributes",
    "root attribute settings = '-1'", "root attribute output_interval missing", "root attribute observations = '[]'",
    "state missing", "series a file", "windows/zarr.json truncated", "start_time/zarr.json data_type = string",
    "max_depth/zarr.json shape = [1]", "series/time/zarr.json attributes = []", "dac_north/zarr.json codecs = []",
)  # fmt: skip
"""One damage of every kind."""


@pytest.fixture(scope="module")
def commands(brief, tmp_path_factory):
    """Arguments of every reading command, with a copy and with the intact archive."""
    out = tmp_path_factory.mktemp("out")
    return lambda copy, sound: (
        ("info", copy),
        ("check", copy),
        ("check", copy, "--deep"),
        ("compare", copy, sound),
        ("export", "og1", copy, out / "og1.nc", "--overwrite"),
        ("export", "currents", copy, out / "currents.nc", "--overwrite"),
        ("analyze", copy, "vertical", "--workers", 0, "--profiles", "2", "--out", out / "vertical"),
        ("validate", brief, "--platform", "petrel-l", "--store", copy, "--workers", 0, "--profiles", "99"),
        ("report", copy, "--out", out / "report", "--profile", 99),
    )


def _copy(archive, folder):
    """Copy of an archive whose files are links; damaging one replaces the link."""
    return shutil.copytree(archive, folder / "copy.zarr", copy_function=os.link)


@pytest.mark.damages_archive
@pytest.mark.parametrize("name", CHOSEN)
def test_damage_is_one_line(brief_store, commands, tmp_path, name):
    damage = next(damage for found, damage in damages(brief_store) if found == name)
    copy = _copy(brief_store, tmp_path)
    damage(copy)
    for arguments in commands(copy, brief_store):
        answer = program(*arguments)
        assert answer.status in (0, 1, 2), arguments
        assert "Traceback" not in answer.err, arguments
        assert "unexpected error" not in answer.err, (arguments, answer.err)


@pytest.mark.long
@pytest.mark.damages_archive
@pytest.mark.parametrize("key", ["series/depth/c.1.0", "state/zarr.json", "start_time/c.0"])
def test_a_pipe_in_place_of_a_file_keeps_nobody_waiting(brief_store, commands, tmp_path, key):
    copy = _copy(brief_store, tmp_path)
    (copy / key).unlink()
    os.mkfifo(copy / key)
    for arguments in commands(copy, brief_store):
        answer = program(*arguments)
        assert answer.status in (0, 1, 2), arguments
        assert "Traceback" not in answer.err, arguments
        assert "unexpected error" not in answer.err, (arguments, answer.err)
    assert re.search(rf"{key} is a pipe, socket or device, not a file; remove it", program("check", copy, "--deep").err)


@pytest.mark.damages_archive
def test_the_line_names_archive_and_damage(brief_store, tmp_path):
    copy = _copy(brief_store, tmp_path)
    dict(damages(brief_store))["root attribute step = 'xxxxxxxxxxxxxxxxxxxx'"](copy)
    for answer in (program("info", copy), program("export", "og1", copy, tmp_path / "o.nc")):
        assert answer.status == 2
        assert re.fullmatch(
            rf"gliderhpc: {copy}: damaged: the root attribute step is 'x+', .*; run the mission again", answer.line
        )
    assert program("check", copy).status == 1


def test_an_error_on_a_sound_archive_goes_on_as_it_is(brief_store):
    with pytest.raises(ZeroDivisionError), archive_errors(brief_store):
        raise ZeroDivisionError
    with pytest.raises(InputError, match="as it is"), archive_errors(brief_store):
        raise InputError("as it is")


def test_an_archive_that_the_system_does_not_give_out(brief_store):
    with (
        pytest.raises(InputError, match=r"cannot be read \(.*zarr.json: Permission denied\)"),
        archive_errors(brief_store),
    ):
        raise PermissionError(13, "Permission denied", str(brief_store / "zarr.json"))
    with open_mission(brief_store) as opened:
        assert opened.sizes["profile"] == 3


@pytest.mark.damages_archive
def test_a_refused_study_leaves_the_earlier_one(swift_store, tmp_path):
    """The damage is found half way, when the study's group has been replaced."""
    copy = _copied(swift_store, tmp_path)
    study = ("analyze", copy, "currents", "--workers", 0, "--out", tmp_path / "out")
    assert program(*study).status == 0
    before = _files(copy)
    lost = copy / "series" / "depth" / "c.2.0"
    lost.unlink()
    del before[lost.relative_to(copy)]
    answer = program(*study)
    assert answer.status == 2
    assert answer.line.endswith("series/depth: the chunk is missing; run-mission --resume repairs it")
    assert _files(copy) == before


def test_a_refused_validation_leaves_the_earlier_one(swift, swift_store, tmp_path, monkeypatch):
    copy = _copied(swift_store, tmp_path)
    command = ("validate", swift, "--platform", "petrel-l", "--store", copy, "--workers", 0, "--out", tmp_path / "out")
    assert program(*command).status == 0
    before = _files(copy)

    def not_flown(*_):
        raise ProfileError("too short")

    monkeypatch.setattr(validation, "run_forward", not_flown)
    answer = program(*command)
    assert answer.status == 2
    assert "no profile could be simulated; too short" in answer.line
    assert _files(copy) == before


def test_a_study_that_fails_at_first_leaves_no_group(swift_store, tmp_path):
    copy = _copied(swift_store, tmp_path)
    before = _files(copy)

    def begin_and_stop():
        create_study(copy, "vertical")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), restored_on_error(copy, "vertical"):
        begin_and_stop()
    assert _files(copy) == before


def _copied(archive, folder):
    return shutil.copytree(archive, folder / "copy.zarr")


def _files(archive):
    return {path.relative_to(archive): path.read_bytes() for path in sorted(archive.rglob("*")) if path.is_file()}
