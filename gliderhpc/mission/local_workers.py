"""Worker processes on this machine, each at the end of a pipe of its own.

There is no port that another user could reach, no file, and no lock that a killed worker could hold. A process that
dies is replaced, and its job given out again.
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

log = logging.getLogger(__name__)

ALLOWED_DEATHS = 3
"""Deaths of workers at one job after which it is still given out again."""

_GRACE = 1.0
"""Seconds between asking workers to end and killing them."""

_CONTEXT = multiprocessing.get_context("spawn")

_QUIET = "ignore:resource_tracker:UserWarning"
"""Workers are killed when they are not needed any more. Python's tracker then removes the locks that their libraries
had, and would tell the user of each run that they had leaked."""


class Kind(Enum):
    """Kinds of message about a job: a part of its result, its end, the error that it raised, too many deaths."""

    READY = 0
    PART = 1
    END = 2
    ERROR = 3
    DIED = 4


_LAST = (Kind.END, Kind.ERROR, Kind.DIED)

Message = tuple[int, Kind, Any]


class LocalWorkers:
    """Pool of processes of one thread, started when there are jobs for them.

    Parameters
    ----------
    count : int
        Processes at most.
    environment : mapping of str to str
        Variables that they start with, where this process has not set them.
    """

    def __init__(self, count: int, environment: Mapping[str, str]) -> None:
        self._count, self._environment = count, environment
        self._workers: list[_Worker] = []
        self._failed_starts = 0

    def messages(self, function: Callable[[Any], Any], jobs: Sequence[Any], *, in_parts: bool) -> Iterator[Message]:
        """Yield the messages about every job, as they come, each with the job's place in `jobs`.

        Parameters
        ----------
        function : callable
            Of a job; an iterable of the result's parts with `in_parts`.
        jobs : sequence
            What to run it on.
        in_parts : bool
            Send every part as it comes; those of a job whose worker died come again.

        Raises
        ------
        RunStoppedError
            Processes end before they can take a job.
        """
        waiting, deaths, left = deque(range(len(jobs))), Counter[int](), len(jobs)
        try:
            while left:
                self._start(min(self._count, left))
                for worker in self._workers:
                    if worker.is_idle and waiting:
                        worker.give(waiting[0], cloudpickle.dumps((function, jobs[waiting[0]], in_parts)))
                        waiting.popleft()
                for message in self._heard():
                    place, kind, _ = message
                    if kind is Kind.DIED:
                        deaths[place] += 1
                        if deaths[place] <= ALLOWED_DEATHS:
                            waiting.appendleft(place)
                            continue
                        message = place, kind, deaths[place]
                    left -= kind in _LAST
                    yield message
        finally:
            self._end([worker for worker in self._workers if not worker.is_idle])

    def close(self) -> None:
        """End every process, whatever it is at."""
        self._end(self._workers)

    def _start(self, count: int) -> None:
        while len(self._workers) < count:
            with _spawning(self._environment):
                self._workers.append(_Worker())

    def _heard(self) -> Iterator[Message]:
        """Yield what workers say of their jobs, once one of them has something to say."""
        pipes = {worker.pipe: worker for worker in self._workers}
        for pipe in connection.wait(list(pipes)):
            worker = pipes[pipe]  # type: ignore[index]
            heard = worker.take()
            if heard is None:
                place = worker.job
                self._bury(worker)
                if place is not None:
                    yield place, Kind.DIED, None
            elif heard[1] is Kind.READY:
                self._failed_starts = 0
            else:
                yield heard

    def _bury(self, worker: "_Worker") -> None:
        self._end([worker])
        if worker.is_starting:
            self._failed_starts += 1
            if self._failed_starts > ALLOWED_DEATHS:
                raise RunStoppedError(
                    f"local worker processes end as they start (exit status {worker.status}); try --workers 0, and in "
                    'a script call this under `if __name__ == "__main__":`'
                )
        log.warning("worker process %s ended (%s); another replaces it", worker.process_id, worker.status)

    def _end(self, workers: Sequence["_Worker"]) -> None:
        ended = list(workers)
        self._workers = [worker for worker in self._workers if worker not in ended]
        for worker in ended:
            worker.ask_to_end()
        until = time.monotonic() + _GRACE
        for worker in ended:
            worker.end(until - time.monotonic())


class _Worker:
    """A process, the pipe to it, and the place of the job that it has."""

    def __init__(self) -> None:
        self.pipe, theirs = _CONTEXT.Pipe()
        self._process = _CONTEXT.Process(target=_serve, args=(theirs,), name="gliderhpc-worker", daemon=True)
        self._process.start()
        theirs.close()
        self.process_id = self._process.pid
        self.is_starting = True
        self.job: int | None = None
        self.status = "running"

    @property
    def is_idle(self) -> bool:
        return not self.is_starting and self.job is None

    def give(self, place: int, task: bytes) -> None:
        """Give it a job; one that has died meanwhile is found out when it is listened to."""
        self.job = place
        try:
            self.pipe.send_bytes(task)
        except ConnectionError as error:
            log.debug("worker process %s is gone: %s", self.process_id, error)

    def take(self) -> Message | None:
        """Return what it says, None where it has died."""
        try:
            heard = self.pipe.recv_bytes()
        except (EOFError, OSError):
            return None
        try:
            kind, value = pickle.loads(heard)
        except Exception as error:  # noqa: BLE001 - a result that cannot be read here is the job's error
            kind, value = Kind.ERROR, error
        place = -1 if self.job is None else self.job
        self.is_starting = False
        if kind in _LAST:
            self.job = None
        return place, kind, value

    def ask_to_end(self) -> None:
        """Let a job that is being done leave no file half written; where there is none, nothing need be waited for."""
        if self.job is None:
            self._process.kill()
        else:
            self._process.terminate()

    def end(self, patience: float) -> None:
        """End it, by force where it has not ended after `patience` seconds."""
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
    """Start a process with these variables and without Ctrl-C, which is for this process to act on."""
    warned = [os.environ["PYTHONWARNINGS"]] if "PYTHONWARNINGS" in os.environ else []
    added = {name: value for name, value in environment.items() if name not in os.environ}
    wanted = {**added, "PYTHONWARNINGS": ",".join([*warned, _QUIET])}
    before = {name: os.environ.get(name) for name in wanted}
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)


# What follows runs in the worker.


def _serve(pipe: "connection.Connection[Any, Any]") -> None:
    """Run jobs until the other end of the pipe is gone."""
    import dask

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # A job computes here whatever it reads lazily: there are as many workers as cores already.
    with dask.config.set(scheduler="synchronous"):
        try:
            pipe.send_bytes(pickle.dumps((Kind.READY, None)))
            while True:
                for answer in _answers(pipe.recv_bytes()):
                    pipe.send_bytes(answer)
        except (EOFError, ConnectionError):
            return


def _answers(task: bytes) -> Iterator[bytes]:
    try:
        function, job, in_parts = pickle.loads(task)
        result = function(job)
        if in_parts:
            yield from _parts(result)
            result = None
        last = cloudpickle.dumps((Kind.END, result))
    except Exception as error:  # noqa: BLE001 - whoever gave the job decides
        last = cloudpickle.dumps((Kind.ERROR, _portable(error)))
    yield last


def _parts(result: Iterable[Any]) -> Iterator[bytes]:
    for part in result:
        yield cloudpickle.dumps((Kind.PART, part))


def _portable(error: Exception) -> Exception:
    """Give an error its traceback as a note, or its text where it cannot be sent."""
    error.add_note("".join(traceback.format_exception(error)))
    try:
        pickle.loads(cloudpickle.dumps(error))
    except Exception:  # noqa: BLE001 - an error class of anybody's
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _leave(number: int, frame: FrameType | None) -> None:
    sys.exit(1)


def _end_with_parent() -> None:
    """Leave no process behind that computes for nobody."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
