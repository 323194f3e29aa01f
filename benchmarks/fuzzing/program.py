"""Program under test as forks of one process that has imported it and loaded its kernels.

A start of the program costs seconds on imports; a fork costs tens of milliseconds. Every call has a time limit, a limit
of memory, its own session and its own streams, and may be killed after a while. Run as a script, this file is the server:
it reads one call a line (JSON) and answers with one line.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

GIBIBYTE = 2**30
IDLE = 10.0
"""Seconds without any use of the processor, and without workers to wait for, that tell a hang before the limit."""


@dataclass(frozen=True)
class Call:
    """One start of the program.

    Attributes
    ----------
    arguments : tuple of str
        Command line after the program's name.
    folder : Path
        Working folder.
    streams : str
        ``files``, or how the streams are changed: ``no-out``, ``no-err``, ``none`` (closed), ``full`` (/dev/full),
        ``pipe`` (nobody reads).
    kill : tuple of (float, int) or None
        Seconds after which the signal is sent.
    user : int or None
        User id to run as.
    """

    arguments: tuple[str, ...]
    folder: Path
    streams: str = "files"
    kill: tuple[float, int] | None = None
    user: int | None = None


@dataclass(frozen=True)
class Ended:
    """End of a call; `status` is negative for a signal, `killed` means that ours arrived in time."""

    status: int
    seconds: float
    peak: int
    hung: bool
    killed: bool
    text: str = field(repr=False, default="")


class Program:
    """The server of one source tree, restarted when it dies."""

    def __init__(self, tree: Path, limit: float = 60.0, memory: int = 2 * GIBIBYTE, kernels: bool = True) -> None:
        self.tree, self.limit, self.memory, self.kernels = tree, limit, memory, kernels
        self._server: subprocess.Popen[str] | None = None
        self._scratch = tempfile.TemporaryDirectory(prefix="fuzz-output-")

    def __enter__(self) -> Program:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the server, for good."""
        if self._server is not None:
            self._server.terminate()
            self._server.communicate()
            self._server = None
        self._scratch.cleanup()

    def run(self, call: Call) -> Ended:
        """Run one call to its end, its kill or its limit."""
        out, err = (Path(self._scratch.name) / name for name in ("out", "err"))
        asked = {
            "arguments": call.arguments, "folder": str(call.folder), "streams": call.streams, "kill": call.kill,
            "user": call.user, "out": str(out), "err": str(err), "limit": self.limit, "memory": self.memory,
            "modules": str(Path(self._scratch.name) / "modules"),
        }  # fmt: skip
        for path in (out, err):
            path.unlink(missing_ok=True)
        answer = json.loads(self._asked(json.dumps(asked)))
        text = "".join(path.read_text("utf-8", "replace") for path in (out, err) if path.exists())
        return Ended(**answer, text=text)

    def _asked(self, line: str) -> str:
        server = self._server = self._server or self._started()
        assert server.stdin is not None
        assert server.stdout is not None
        server.stdin.write(line + "\n")
        server.stdin.flush()
        answer = server.stdout.readline()
        if not answer:
            self._server = None
            raise RuntimeError(f"the loaded program ended with status {server.wait()}")
        return answer

    def _started(self) -> subprocess.Popen[str]:
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.tree),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "MPLBACKEND": "Agg",
            "PYTHONDONTWRITEBYTECODE": "1",
            "COLUMNS": "200",
        }
        command = [sys.executable, "-P", __file__, *(["--kernels"] if self.kernels else [])]
        return subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=self.tree
        )


def _serve(kernels: bool) -> None:
    """Fork for every call, once all that a call might need is loaded."""
    from gliderhpc.cli.main import VERBS

    for module in VERBS.values():
        __import__(f"gliderhpc.cli.{module}")
    for library in ("matplotlib.pyplot", "scipy.optimize", "scipy.signal", "scipy.stats"):
        __import__(library)
    if kernels:
        from gliderhpc.mission.warm import warm_kernels, warm_simulator

        warm_kernels()
        warm_simulator()
    # Signals are meant for the calls, and for them only while the program runs.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Answers go where calls cannot write.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        call = json.loads(line)
        begun = time.monotonic()
        child = os.fork()
        if child == 0:
            _answer(call)
        answers.write(json.dumps(_ended(child, call, begun)) + "\n")
        answers.flush()
        _load_modules(Path(call["modules"]))


def _load_modules(listing: Path) -> None:
    """Load what the last call loaded late, so that the next need not."""
    if listing.exists():
        for name in listing.read_text("utf-8").split():
            if name not in sys.modules:
                with contextlib.suppress(ImportError, AttributeError):
                    __import__(name)
        listing.unlink()


def _ended(child: int, call: dict[str, Any], begun: float) -> dict[str, Any]:
    """Wait for a call; the limit ends its whole session."""
    after, number = call["kill"] or (call["limit"], signal.SIGKILL)
    hung = killed = False
    used_last, used_at = 0.0, begun
    while True:
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            break
        elapsed = time.monotonic() - begun
        if call["kill"] and not killed and elapsed >= after:
            # As a terminal does: Ctrl-C reaches the workers too.
            # A child of the first moments has no session of its own yet.
            group = number == signal.SIGINT and os.getpgid(child) == child
            (os.killpg if group else os.kill)(child, number)
            killed = True
        if elapsed > IDLE and (used_now := _used(child)) != used_last:
            used_last, used_at = used_now, time.monotonic()
        if elapsed >= call["limit"] or (elapsed > 2 * IDLE and time.monotonic() - used_at > IDLE):
            hung = True
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        time.sleep(0.002 if elapsed < 0.5 else 0.01)
    # Workers that outlive their program.
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    return {
        "status": os.waitstatus_to_exitcode(status),
        "seconds": time.monotonic() - begun,
        "peak": 1024 * used.ru_maxrss,
        "hung": hung,
        "killed": killed,
    }


def _used(process: int) -> float:
    """Processor time (clock ticks) of a process; changes at every call where it may wait for others."""
    try:
        if Path(f"/proc/{process}/task/{process}/children").read_text("ascii"):
            return time.monotonic()
        fields = Path(f"/proc/{process}/stat").read_text("ascii").rpartition(")")[2].split()
    except OSError:
        return time.monotonic()
    # More than one thread may wait for a connection, which has a limit of its own.
    return float(fields[11]) + float(fields[12]) if fields[17] == "1" else time.monotonic()


def _answer(call: dict[str, Any]) -> None:
    """Run the program as a shell would have, and end."""
    os.setsid()
    loaded = set(sys.modules)
    _limit_memory(call["memory"])
    _open_streams(call)
    os.chdir(call["folder"])
    if call["user"] is not None:
        os.setgroups([])
        os.setgid(call["user"])
        os.setuid(call["user"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    status = 1
    try:
        from gliderhpc.cli.main import main

        main(call["arguments"])
    except SystemExit as end:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        status = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:  # noqa: BLE001 - a fork must never go on as the process it came from
        if sys.stderr is not None:
            sys.excepthook(*sys.exc_info())
    with contextlib.suppress(OSError), open(call["modules"], "w", encoding="utf-8") as listing:  # noqa: PTH123
        listing.write("\n".join(set(sys.modules) - loaded))
    os._exit(_flushed(status))


def _flushed(status: int) -> int:
    """Flush the streams as the interpreter does when it ends, which gives 120 where that fails."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except (OSError, ValueError):
            status = 120
    return status


def _limit_memory(more: int) -> None:
    """Let the process have so many bytes more than what the loaded program has."""
    with open("/proc/self/status", encoding="ascii") as lines:  # noqa: PTH123
        held = next(int(line.split()[1]) for line in lines if line.startswith("VmData"))
    resource.setrlimit(resource.RLIMIT_DATA, (1024 * held + more,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _open_streams(call: dict[str, Any]) -> None:
    """Connect the streams to files, or break them."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    os.dup2(os.open("/dev/null", os.O_RDONLY), 0)
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(call[name], flags, 0o644), number)
    how = call["streams"]
    if how in ("no-out", "none"):
        os.close(1)
        sys.stdout = sys.__stdout__ = None  # type: ignore[assignment, misc]
    if how in ("no-err", "none"):
        os.close(2)
        sys.stderr = sys.__stderr__ = None  # type: ignore[assignment, misc]
    if how == "full":
        os.dup2(os.open("/dev/full", os.O_WRONLY), 1)
    if how == "pipe":
        read, write = os.pipe()
        os.dup2(write, 1)
        os.close(read)
        os.close(write)


if __name__ == "__main__":
    _serve("--kernels" in sys.argv)
