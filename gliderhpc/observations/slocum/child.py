"""dbdreader behind a process border: its compiled code trusts the files, and a damaged one can end the process."""

import json
import os
import selectors
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray

LONGEST_READ = 120.0
"""Seconds after which the reading of a file is given up: a sound one of 100 MB takes a few."""

_SCRIPT = Path(__file__).with_name("dbd_process.py")
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@dataclass(frozen=True, eq=False)
class DbdValues:
    """Sensors read from one file: units and values ``(n,)`` by name."""

    units: dict[str, str]
    values: dict[str, FloatArray]


class DbdProcess:
    """A process that reads binary files one after the other (a context manager); a new one where it has died.

    Parameters
    ----------
    folder : Path
        An empty folder to work in; cache files are looked for there.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._end()

    def read(self, path: Path, plain: Path, names: Sequence[str]) -> DbdValues:
        """Read sensors of a file, those that it has.

        Parameters
        ----------
        path : Path
            The file, for messages.
        plain : Path
            The same or its decompressed content.
        names : sequence of str
            The sensors.

        Raises
        ------
        InputError
            The library refuses the file, ends, or does not come to an end.
        """
        values = self._folder / "values.npy"
        request = {"path": str(plain), "cache": str(self._folder), "names": [*names], "values": str(values)}
        reply = self._ask(path, request)
        if "error" in reply:
            reason = str(reply["error"]).splitlines()[0]
            raise InputError(f"{path}: cannot be read, it may be damaged ({reason}); copy it again from the glider")
        held = [str(name) for name in reply["held"]]
        columns = dict(zip(held, np.load(values, allow_pickle=False), strict=True))
        return DbdValues(dict(zip(held, map(str, reply["units"]), strict=True)), columns)

    def _ask(self, path: Path, request: dict[str, Any]) -> dict[str, Any]:
        process = self._process = self._process or self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            line = process.stdout.readline() if self._answered(process) else None
        except BrokenPipeError:
            line = ""
        if line is None:
            self._end()
            raise InputError(f"{path}: cannot be read within {LONGEST_READ:.0f} s, it is damaged; leave it out")
        if not line:
            status = process.wait()
            self._end()
            raise InputError(
                f"{path}: cannot be read, dbdreader ended {_how(status)}; the file is damaged, leave it out"
            )
        reply: dict[str, Any] = json.loads(line)
        return reply

    def _started(self) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-P", str(_SCRIPT)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True, encoding="utf-8", env={**os.environ, **_ONE_THREAD},
        )  # fmt: skip

    def _answered(self, process: "subprocess.Popen[str]") -> bool:
        """Wait for an answer, or for the process to end; False where neither comes."""
        assert process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(process.stdout, selectors.EVENT_READ)
            return bool(selector.select(LONGEST_READ))

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        # Closes the pipes, too.
        process.communicate()


def _how(status: int) -> str:
    return f"by signal {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
