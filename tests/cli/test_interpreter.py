"""Settings of Python and numba with which a long job cannot succeed: reported before it begins."""

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from support.missions import Answer, program

from gliderhpc.kernels.jit import UNCOMPILED
from gliderhpc.mission import doctor
from gliderhpc.mission.doctor import State


def interpreted(*arguments: object, options: tuple[str, ...] = (), **environment: object) -> Answer:
    """Run the program in a separate interpreter with options of Python."""
    done = subprocess.run(
        [sys.executable, *options, "-m", "gliderhpc", *map(str, arguments)],
        env={**os.environ, **{name: str(value) for name, value in environment.items()}},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return Answer(done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("verb", ["run-mission", "watch", "demo"])
def test_without_assertions_nothing_is_compiled_or_written(swift, tmp_path, verb):
    archive = ("--platform", "petrel-l", "--store", tmp_path / "out.zarr")
    rest = {"run-mission": (swift, *archive), "watch": (swift, *archive, "--once"), "demo": ("--out", tmp_path / "out")}
    answer = interpreted(verb, *rest[verb], options=("-O",), GLIDERHPC_CACHE=tmp_path / "cache")
    assert answer.status == 2
    assert answer.line.endswith("start Python without -O, or unset PYTHONOPTIMIZE")
    assert list(tmp_path.glob("cache/**/*.nb*")) == []
    assert list(tmp_path.glob("out*")) == []


def test_doctor_reports_a_python_without_assertions(monkeypatch):
    monkeypatch.setattr("sys.flags", SimpleNamespace(optimize=1))
    check = doctor.interpreter()
    assert check.state is State.MISSING
    assert check.remedy == "start Python without -O, or unset PYTHONOPTIMIZE"


def test_a_compiler_that_is_off_is_reported_in_one_line():
    answer = interpreted("simulate-mission", "--help", NUMBA_DISABLE_JIT=1)
    assert answer.status == 0
    assert answer.line == f"{UNCOMPILED}; unset it unless you are debugging"


def test_workers_do_not_repeat_it():
    code = (
        "import multiprocessing as m\n"
        "if __name__ == '__main__':\n"
        "    p = m.get_context('spawn').Process(target=__import__, args=('gliderhpc.kernels.jit',))\n"
        "    p.start(); p.join(); assert p.exitcode == 0\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""


def test_doctor_does_not_run_the_kernels_uncompiled(monkeypatch):
    monkeypatch.setattr("numba.core.config.DISABLE_JIT", 1)
    answer = program("doctor")
    assert answer.status == 1
    assert answer.out.splitlines()[-1] == "missing: kernels"
    assert UNCOMPILED in answer.out
