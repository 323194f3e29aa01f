"""Commands about the machine and the shell: doctor, completion, the version."""

import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
from support.missions import program
from support.repository import REPOSITORY

from gliderhpc.cli.main import SHELLS, completion_script
from gliderhpc.errors import InputError
from gliderhpc.kernels.lane_type import LANES
from gliderhpc.mission import doctor
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.doctor import State
from gliderhpc.version import __version__

pytestmark = pytest.mark.compiled


def states(answer):
    """Each line's name and state."""
    lines = answer.out.splitlines()[:-1]
    return {line.split("  ")[0].strip(): line.split()[len(line.split("  ")[0].split())] for line in lines}


def test_a_machine_that_has_everything(tmp_path):
    answer = program("doctor", "--store", tmp_path / "not" / "yet" / "there")
    assert answer.status == 0, answer.out
    assert answer.out.splitlines()[-1] == "everything that a run needs is available"
    found = states(answer)
    needed = {"gliderhpc", "python", *doctor.PACKAGES, "processor", "kernel cache", "write access", "free disk"}
    assert {name for name, state in found.items() if state == "ok"} >= needed
    assert set(found.values()) <= {"ok", "absent"}
    assert f"{LANES} lanes" in answer.out
    assert list(tmp_path.iterdir()) == []


def test_its_lines_are_aligned(tmp_path):
    lines = program("doctor", "--store", tmp_path).out.splitlines()[:-1]
    words = [f" {state.value} " for state in State]
    (column,) = {min(line.index(word) for word in words if word in line) for line in lines}
    assert column > max(len(name) for name in doctor.PACKAGES)


def test_a_folder_that_cannot_be_written_is_missing(tmp_path):
    file = tmp_path / "file"
    file.touch()
    answer = program("doctor", "--store", file / "mission.zarr")
    assert answer.status == 1
    assert answer.out.splitlines()[-1] == "missing: write access"
    (line,) = [line for line in answer.out.splitlines() if line.startswith("write access")]
    assert f"{file / 'mission.zarr'}: Not a directory; give a --store that can be written" in line


def test_a_full_disk_is_missing(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10, 10, 1 << 20))
    check = doctor.free_disk(tmp_path / "archive.zarr")
    assert check.state is State.MISSING
    assert "0.0 GiB" in check.found
    assert check.remedy


def test_a_package_or_an_extra_that_is_not_there(monkeypatch):
    monkeypatch.setitem(doctor.EXTRAS, "nonsense", ("gliderhpc-no-such-thing", "nothing"))
    check = doctor.extra("nonsense")
    assert check.state is State.ABSENT
    assert check.remedy == "pip install 'gliderhpc[nonsense]'"
    assert doctor.package("gliderhpc-no-such-thing").state is State.MISSING


def test_every_extra_is_one_of_the_project():
    text = (REPOSITORY / "pyproject.toml").read_text("utf-8")
    for name, (distribution, _) in doctor.EXTRAS.items():
        section = text.split(f"\n{name} = [", 1)[1].split("]\n", 1)[0]
        assert f'"{distribution}' in section, name


def test_compiled_kernels_are_reported_as_absent_or_loaded(monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "compiled_cache", lambda: tmp_path)
    monkeypatch.setattr(doctor, "warm_kernels", lambda: None)
    assert doctor.compiled_kernels().state is State.ABSENT
    (tmp_path / "kernel.nbc").touch()
    sound = doctor.compiled_kernels()
    assert sound.state is State.OK
    assert sound.found.startswith("1 compiled, loaded and run in ")


@pytest.mark.parametrize(
    ("examined", "state", "fragment"),
    [
        ((3, 2), State.OK, "3 workers on 2 hosts"),
        ((0, 0), State.MISSING, "has no workers"),
        (InputError("worker tcp://a:1: has numba 0.1, but this process has 0.2"), State.MISSING, "numba 0.1"),
    ],
)
def test_a_cluster(monkeypatch, examined, state, fragment):
    def examine(cluster):
        if isinstance(examined, Exception):
            raise examined
        return examined

    monkeypatch.setattr(doctor, "examine_cluster", examine)
    check = doctor.reachable_cluster(ClusterAddress("tcp://a:8786"))
    assert check.state is state
    assert fragment in check.found


def test_a_scheduler_file_that_is_not_there(tmp_path):
    answer = program("doctor", "--store", tmp_path, "--scheduler-file", tmp_path / "scheduler.json")
    assert answer.status == 1
    assert answer.out.splitlines()[-1] == "missing: cluster"
    assert f"dask scheduler --scheduler-file {tmp_path / 'scheduler.json'}" in answer.out


def test_an_unusable_address_is_reported_as_missing(tmp_path):
    check = doctor.write_access("nonsense://bucket/folder")
    assert check.state is State.MISSING
    assert "nonsense://bucket/folder" in check.found


# Shell completion


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_prints_the_shells_script(shell):
    answer = program("completion", shell)
    assert answer.status == 0
    assert answer.out.strip() == completion_script(shell).strip()
    assert "_GLIDERHPC_COMPLETE" in answer.out
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=answer.out, text=True, check=True)


def test_completion_of_a_shell_that_is_not_known():
    answer = program("completion", "csh")
    assert answer.status == 2
    assert "csh" in answer.err


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("gliderhpc run-", "run-mission"),
        ("gliderhpc run-mission a.nc --plat", "--platform"),
        ("gliderhpc run-mission a.nc --platform pet", "petrel-l"),
        ("gliderhpc analyze a.zarr dri", "drift"),
        ("gliderhpc import seag", "seaglider"),
    ],
)
def test_shell_completion_offers_verbs_options_and_files(words, offered):
    environment = {
        **os.environ, "_GLIDERHPC_COMPLETE": "bash_complete", "COMP_WORDS": words, "PYTHONPATH": str(REPOSITORY),
        "COMP_CWORD": str(len(words.split()) - 1),
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-m", "gliderhpc"], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert offered in [line.partition(",")[2] for line in done.stdout.splitlines()], done.stdout + done.stderr


def test_python_m_gliderhpc():
    done = subprocess.run(
        [sys.executable, "-m", "gliderhpc", "--version"],
        cwd=REPOSITORY, env={**os.environ, "PYTHONPATH": str(REPOSITORY)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == f"gliderhpc, version {__version__}\n"
    assert Path(REPOSITORY / "gliderhpc" / "py.typed").is_file()
