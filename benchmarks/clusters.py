"""Dask clusters of real processes on loopback, for runs and for fault tests."""

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from unittest.mock import patch

import numpy as np

TIMEOUT = 300.0


@cache
def forking() -> BaseContext:
    """Context of a server that has loaded all that a worker needs, which takes a new process three seconds."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["benchmarks.loaded"])
    return context


class Cluster:
    """``dask scheduler`` and ``dask worker`` processes, each of which can be killed."""

    def __init__(self, folder: Path, workers: int) -> None:
        self._folder = folder
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.file = folder / "scheduler.json"
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--scheduler-file", self.file
        )
        self.workers = [self.start_worker() for _ in range(workers)]

    def start_worker(self) -> BaseProcess:
        """Start one, of one thread and without a nanny that would restart it."""
        return self._start(
            "worker", self.address, "--nthreads", 1, "--no-nanny", "--no-dashboard", "--local-directory", self._folder,
            "--host", "127.0.0.1",
        )  # fmt: skip

    def kill_worker(self, place: int) -> None:
        """Kill one outright, and start another in its place."""
        self.workers[place].kill()
        self.workers[place].join()
        self.workers[place] = self.start_worker()

    def close(self) -> None:
        """Kill the remaining processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
        for process in (*self.workers, self.scheduler):
            process.join()

    def _start(self, what: str, *arguments: object) -> BaseProcess:
        words = ["dask", what, *map(str, arguments)]
        log, environment = self._folder / f"{what}.log", dict(os.environ)
        process = forking().Process(target=_run_dask, args=(words, log, environment), daemon=True)
        # The first process starts the server, which imports from these folders.
        with patch.dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path))):
            process.start()
        return process


def _run_dask(words: list[str], log: Path, environment: dict[str, str]) -> None:
    """Run the command line of Dask in this process, in the caller's environment, with its output in a file."""
    from dask.cli import run_cli

    os.environ.update(environment)
    with log.open("ab") as out:
        for stream in (1, 2):
            os.dup2(out.fileno(), stream)
    sys.argv = words
    run_cli()


@contextmanager
def running_cluster(workers: int = 2) -> Iterator[Cluster]:
    """Cluster that is killed at the end, whatever happens."""
    with tempfile.TemporaryDirectory() as folder:
        cluster = Cluster(Path(folder), workers)
        try:
            yield cluster
        finally:
            cluster.close()


@contextmanager
def killing_workers(cluster: Cluster, seed: int, kills: int, between: tuple[float, float]) -> Iterator[list[float]]:
    """Kill workers drawn at random, at random intervals (s), while the body runs; yields when that was, s."""
    random = np.random.default_rng(seed)
    stop, killed, began = threading.Event(), [], time.monotonic()

    def kill() -> None:
        for _ in range(kills):
            if stop.wait(random.uniform(*between)):
                return
            cluster.kill_worker(int(random.integers(len(cluster.workers))))
            killed.append(time.monotonic() - began)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        yield killed
    finally:
        stop.set()
        thread.join()


def start_program(*arguments: object) -> subprocess.Popen:
    """Start the program in a separate session, so that a signal to its group reaches its workers too."""
    # A shell's background job ignores Ctrl-C, and so would what it starts.
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from gliderhpc.cli import main; main(sys.argv[1:])"
    )
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def signal_group(process: subprocess.Popen, number: signal.Signals) -> None:
    """Send a signal to a program and all its workers, as a terminal does."""
    os.killpg(process.pid, number)


def freeze_when(process: subprocess.Popen, condition, step: float = 0.02) -> None:
    """Freeze a program and all its workers as soon as a condition holds, checked while all of them stand still.

    Processes as fast as these would otherwise have finished by the time the condition is known. A program that ends
    meanwhile is left as it ended.
    """
    while process.poll() is None:
        signal_group(process, signal.SIGSTOP)
        if condition():
            return
        signal_group(process, signal.SIGCONT)
        time.sleep(step)


def wait_until(condition, timeout: float = TIMEOUT) -> None:
    """Wait until a condition holds."""
    until = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < until, "timed out"
        time.sleep(0.02)
