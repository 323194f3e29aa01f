"""Worker processes on this machine, each connected by its own pipe.

There is no port that another user could reach, no file, and no lock that a killed worker could hold. A process that
dies is replaced, and its job is reassigned.
"""

import logging
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum
from multiprocessing import connection
from types import FrameType
from typing import Any

import cloudpickle

from gliderhpc.errors import RunStoppedError
from gliderhpc.garbage import infrequent_collection
from gliderhpc.kernels.cache import VARIABLES, compiled_cache
from gliderhpc.kernels.precompiled import precompiled_kernels

log = logging.getLogger(__name__)

ALLOWED_DEATHS = 3
"""Maximum number of worker deaths after which a job is still reassigned."""

_GRACE_PERIOD = 1.0
"""Seconds between terminating workers and killing them."""

_CONTEXT = multiprocessing.get_context("spawn")

_WARNINGS_FILTER = "ignore:resource_tracker:UserWarning"
"""Filter of the warning that killed workers have leaked their libraries' locks, which Python's tracker then removes."""


class MessageKind(Enum):
    """Kind of a message: worker ready, part of a result, end of a job, error of a job, death of a worker."""

    READY = 0
    PART = 1
    END = 2
    ERROR = 3
    DIED = 4


_FINAL_KINDS = (MessageKind.END, MessageKind.ERROR, MessageKind.DIED)

Message = tuple[int, MessageKind, Any]


class LocalWorkers:
    """Pool of processes, started when there are jobs for them.

    Parameters
    ----------
    count : int
        Maximum number of processes.
    environment : mapping of str to str
        Environment variables of the processes, unless this process has set them.
    """

    def __init__(self, count: int, environment: Mapping[str, str]) -> None:
        self._count, self._environment = count, environment
        self._workers: list[_Worker] = []
        self._failed_starts = 0

    def messages(self, function: Callable[[Any], Any], jobs: Sequence[Any], *, in_parts: bool) -> Iterator[Message]:
        """Yield the messages about every job as they arrive, each with the job's position in `jobs`.

        Parameters
        ----------
        function : callable
            Function of a job; with `in_parts` it returns an iterable of the result's parts.
        jobs : sequence
            Arguments of the function.
        in_parts : bool
            Whether every part is sent when it is complete; the parts of a job whose worker died are sent again.

        Raises
        ------
        RunStoppedError
            Processes repeatedly end before they can take a job.
        """
        waiting, deaths, remaining = deque(range(len(jobs))), Counter[int](), len(jobs)
        try:
            while remaining:
                self._start(min(self._count, remaining))
                for worker in self._workers:
                    if worker.is_idle and waiting:
                        worker.assign(waiting[0], cloudpickle.dumps((function, jobs[waiting[0]], in_parts)))
                        waiting.popleft()
                for message in self._receive():
                    index, kind, _ = message
                    if kind is MessageKind.DIED:
                        deaths[index] += 1
                        if deaths[index] <= ALLOWED_DEATHS:
                            waiting.appendleft(index)
                            continue
                        message = index, kind, deaths[index]
                    remaining -= kind in _FINAL_KINDS
                    yield message
        finally:
            self._end([worker for worker in self._workers if not worker.is_idle])

    def close(self) -> None:
        """End every process, even during a job."""
        self._end(self._workers)

    def _start(self, count: int) -> None:
        while len(self._workers) < count:
            with _spawning(self._environment):
                self._workers.append(_Worker())

    def _receive(self) -> Iterator[Message]:
        """Wait for messages of the workers, and yield those about jobs."""
        pipes = {worker.pipe: worker for worker in self._workers}
        for pipe in connection.wait(list(pipes)):
            worker = pipes[pipe]  # type: ignore[index]
            message = worker.receive()
            if message is None:
                index = worker.job
                self._remove_dead(worker)
                if index is not None:
                    yield index, MessageKind.DIED, None
            elif message[1] is MessageKind.READY:
                self._failed_starts = 0
            else:
                yield message

    def _remove_dead(self, worker: "_Worker") -> None:
        self._end([worker])
        if worker.is_starting:
            self._failed_starts += 1
            if self._failed_starts > ALLOWED_DEATHS:
                raise RunStoppedError(
                    f"local worker processes exit immediately ({worker.status}); try `workers=0`, and in "
                    'a script call this function under `if __name__ == "__main__":`'
                )
        log.warning("worker process %s ended (%s); another replaces it", worker.process_id, worker.status)

    def _end(self, workers: Sequence["_Worker"]) -> None:
        ended = list(workers)
        self._workers = [worker for worker in self._workers if worker not in ended]
        for worker in ended:
            worker.terminate()
        deadline = time.monotonic() + _GRACE_PERIOD
        for worker in ended:
            worker.end(deadline - time.monotonic())


class _Worker:
    """A process, the pipe to it, and the position of its current job."""

    def __init__(self) -> None:
        self.pipe, other_end = _CONTEXT.Pipe()
        self._process = _CONTEXT.Process(target=_serve, args=(other_end,), name="gliderhpc-worker", daemon=True)
        self._process.start()
        other_end.close()
        self.process_id = self._process.pid
        self.is_starting = True
        self.job: int | None = None
        self.status = "running"

    @property
    def is_idle(self) -> bool:
        return not self.is_starting and self.job is None

    def assign(self, index: int, task: bytes) -> None:
        """Assign a job; if the worker has died, `receive` detects it."""
        self.job = index
        try:
            self.pipe.send_bytes(task)
        except ConnectionError as error:
            log.debug("worker process %s is gone: %s", self.process_id, error)

    def receive(self) -> Message | None:
        """Receive a message; None if the worker has died."""
        try:
            content = self.pipe.recv_bytes()
        except (EOFError, OSError):
            return None
        try:
            kind, value = pickle.loads(content)
        except Exception as error:  # noqa: BLE001 - a result that cannot be read here is the job's error
            kind, value = MessageKind.ERROR, error
        index = -1 if self.job is None else self.job
        self.is_starting = False
        if kind in _FINAL_KINDS:
            self.job = None
        return index, kind, value

    def terminate(self) -> None:
        """Terminate a worker during a job, so that it removes its partial files; kill an idle one."""
        if self.job is None:
            self._process.kill()
        else:
            self._process.terminate()

    def end(self, patience: float) -> None:
        """Wait up to `patience` seconds for the process to end, then kill it."""
        self._process.join(max(0.0, patience))
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join()
        self.status = _describe_status(self._process.exitcode)
        self.pipe.close()
        self._process.close()


def _describe_status(status: int | None) -> str:
    if status is not None and status < 0:
        return f"signal {signal.Signals(-status).name}"
    return f"exit status {status}"


@contextmanager
def _spawning(environment: Mapping[str, str]) -> Iterator[None]:
    """Set these variables and block Ctrl-C, which only this process handles, for processes started in the block."""
    filters = [os.environ["PYTHONWARNINGS"]] if "PYTHONWARNINGS" in os.environ else []
    added = {name: value for name, value in environment.items() if name not in os.environ}
    # The same cache as in this process, even if that is a temporary folder; precompiled kernels need none.
    cache = {VARIABLES[0]: str(compiled_cache().parent)} if precompiled_kernels()[0] is None else {}
    variables = {**added, **cache, "PYTHONWARNINGS": ",".join([*filters, _WARNINGS_FILTER])}
    previous = {name: os.environ.get(name) for name in variables}
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in previous.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)


# Code of the worker process.


def _serve(pipe: "connection.Connection[Any, Any]") -> None:
    """Run jobs until the other end of the pipe is closed."""
    import dask

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _exit)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Lazy arrays are computed in this process: there are as many workers as cores already.
    with dask.config.set(scheduler="synchronous"), infrequent_collection():
        try:
            pipe.send_bytes(pickle.dumps((MessageKind.READY, None)))
            while True:
                for message in _messages(pipe.recv_bytes()):
                    pipe.send_bytes(message)
        except (EOFError, ConnectionError):
            return


def _messages(task: bytes) -> Iterator[bytes]:
    try:
        function, job, in_parts = pickle.loads(task)
        result = function(job)
        if in_parts:
            yield from _parts(result)
            result = None
        final = cloudpickle.dumps((MessageKind.END, result))
    except Exception as error:  # noqa: BLE001 - the caller decides
        final = cloudpickle.dumps((MessageKind.ERROR, _picklable(error)))
    yield final


def _parts(result: Iterable[Any]) -> Iterator[bytes]:
    for part in result:
        yield cloudpickle.dumps((MessageKind.PART, part))


def _picklable(error: Exception) -> Exception:
    """Add the traceback to an error as a note; return only the text of an error that cannot be pickled."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(cloudpickle.dumps(error))
    except Exception:  # noqa: BLE001 - any error class can be unpicklable
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _exit(number: int, frame: FrameType | None) -> None:
    sys.exit(1)


def _end_with_parent() -> None:
    """End this process when its parent ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def default_workers() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
