"""Files shared by several tests, made once for all workers of a test run."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numba
import pytest
from filelock import FileLock

from gliderhpc.kernels.cache import compiled_cache
from support.repository import REPOSITORY


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder that all workers share; the first that asks for it fills it, the others wait.

    Parameters
    ----------
    factory : pytest.TempPathFactory
        Gives the folder of this run.
    name : str
        Name of the folder.
    make : callable
        Called with the empty folder; what it raises leaves the folder to the next who asks.
    """
    base = factory.getbasetemp()
    # Each worker of pytest-xdist has a folder of its own in that of the run.
    root = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    root.mkdir(exist_ok=True)
    folder, done = root / name, root / f"{name}.done"
    with FileLock(root / f"{name}.lock"):
        if not done.exists():
            folder.mkdir()
            make(folder)
            done.touch()
    return folder


class CompiledKernels:
    """The kernels, which two processes begin to compile unless that was done for these sources before."""

    def __init__(self) -> None:
        self._started: list[subprocess.Popen[bytes]] = []
        if numba.config.DISABLE_JIT:
            return
        self._done = compiled_cache() / "warm"
        if self._done.exists():
            return
        environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
        program = [sys.executable, "-m", "gliderhpc.mission.warm"]
        self._started = [
            subprocess.Popen([*program, part], stdout=subprocess.DEVNULL, env=environment)
            for part in ("kernels", "simulator")
        ]

    def wait(self) -> None:
        """Wait until they are compiled."""
        failed = [process.args for process in self._started if process.wait() != 0]
        if failed:
            raise RuntimeError(f"the kernels cannot be compiled: {failed}")
        if self._started:
            self._done.touch()
