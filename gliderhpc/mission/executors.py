"""Executors of jobs: in this process, on local processes of one core each, or on a running Dask cluster."""

import pickle
import queue
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from gliderhpc.errors import RunStoppedError, message_line
from gliderhpc.mission.local_workers import LocalWorkers, Message, MessageKind, default_workers
from gliderhpc.wording import counted

Job = TypeVar("Job")
Result = TypeVar("Result")

PATIENCE = 300.0
"""Seconds that a run waits while there is no worker."""

_POLL_INTERVAL = 1.0
"""Seconds between checks of the workers while no result arrives."""

ALLOCATION = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
"""Thresholds (bytes) below which glibc retains freed memory in local workers. With lower thresholds, such as those of
dask's own workers, every array of a profile is returned to the operating system and mapped again page by page, which
took a third of a study's processor time."""

ONE_THREAD = {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1, "MKL_NUM_THREADS": 1}
"""Threads of linear algebra in each worker, since there is one worker for each core."""


class WorkerKilledError(Exception):
    """All workers of a job died, while running it or while it was queued behind a job that kills workers."""

    def __init__(self, deaths: int) -> None:
        super().__init__(f"the worker was killed or ran out of memory {counted(deaths, 'time')}")


@dataclass(frozen=True, eq=False)
class Attempt:
    """Outcome of a job: its result or its error."""

    job: Any
    result: Any = None
    error: Exception | None = None


class Executor(ABC):
    """Executor of a function over jobs, ``workers`` at a time."""

    workers: int

    def threads(self, jobs: int) -> int:
        """Return the number of threads that each of ``jobs`` concurrent jobs may use without sharing a core."""
        return 1

    @abstractmethod
    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield the outcome of every job as it ends, in any order.

        Raises
        ------
        RunStoppedError
            No worker is left.
        """

    def stream(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of the jobs' results as it arrives, and the error of each job that fails.

        A part may be yielded twice.

        Raises
        ------
        RunStoppedError
            No worker is left.
        """
        for attempt in self.attempts(partial(_all_parts, function), jobs):
            yield from _parts_of(attempt)

    def run(self, function: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the function's result for every job; the first error is raised."""
        for attempt in self.attempts(function, jobs):
            if attempt.error is not None:
                raise attempt.error
            yield attempt.result


OpenExecutor = Callable[[], AbstractContextManager[Executor]]
"""Function that opens an executor."""

Progress = Callable[[int], AbstractContextManager[Callable[[], None]]]
"""Function that opens a display of progress over a number of steps; its context is the function that advances it."""


@contextmanager
def no_progress(_: int) -> Iterator[Callable[[], None]]:
    """Open no display, and yield a function that does nothing."""
    yield lambda: None


class SerialExecutor(Executor):
    """Executor of one job after another in this process, for debugging and very small missions."""

    workers = 1

    def threads(self, jobs: int) -> int:
        """Return the number of cores, since jobs run one after another."""
        return default_workers()

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield the outcome of every job, in order."""
        for job in jobs:
            try:
                result = function(job)
            except Exception as error:  # noqa: BLE001 - the caller decides
                yield Attempt(job, error=error)
            else:
                yield Attempt(job, result)

    def stream(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of the jobs' results once, as it arrives, and the error of each job that fails."""
        for job in jobs:
            parts = iter(function(job))
            while True:
                try:
                    part = next(parts)
                except StopIteration:
                    break
                except Exception as error:  # noqa: BLE001 - the caller decides
                    yield Attempt(job, error=error)
                    break
                yield Attempt(job, part)


class LocalExecutor(Executor):
    """Executor on processes of this machine, over pipes.

    Parameters
    ----------
    workers : int
        Number of processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._processes = LocalWorkers(workers, {name: str(value) for name, value in (ALLOCATION | ONE_THREAD).items()})

    def threads(self, jobs: int) -> int:
        """Return the number of cores for each job; there is one core for each process."""
        return max(1, self.workers // max(1, jobs))

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield the outcome of every job as it ends."""
        for message in self._processes.messages(function, jobs, in_parts=False):
            yield _attempt_of(message, jobs)

    def stream(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of the jobs' results as it arrives, and the error of each job that fails."""
        for message in self._processes.messages(function, jobs, in_parts=True):
            if message[1] is not MessageKind.END:
                yield _attempt_of(message, jobs)

    def close(self) -> None:
        """End the processes."""
        self._processes.close()


def _attempt_of(message: Message, jobs: Sequence[Any]) -> Attempt:
    index, kind, value = message
    if kind is MessageKind.DIED:
        return Attempt(jobs[index], error=WorkerKilledError(value))
    return Attempt(jobs[index], error=value) if kind is MessageKind.ERROR else Attempt(jobs[index], value)


class DaskExecutor(Executor):
    """Executor on a Dask client: one task for each job, results released as soon as they are received.

    Parameters
    ----------
    client : distributed.Client
        Client of the cluster.
    patience : float
        Time to wait for a worker if there is none, s.
    """

    def __init__(self, client: Any, patience: float = PATIENCE) -> None:
        self._client, self._patience = client, patience
        self.workers = max(1, len(client.nthreads()))

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield the outcome of every job as it ends."""
        for attempts in self._completed(function, jobs):
            yield from attempts

    def stream(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of the jobs' results: when a worker announces it, and again with the job's complete result.

        Workers announce each part as an event of the scheduler. If an event is lost, the part comes with the result.
        """
        topic, announced = f"gliderhpc-{uuid.uuid4().hex}", queue.SimpleQueue[tuple[int, bytes]]()
        self._client.subscribe_topic(topic, lambda event: announced.put(event[1]))
        try:
            for attempts in self._completed(partial(_announce_parts, function, topic), list(enumerate(jobs))):
                while not announced.empty():
                    index, part = announced.get()
                    yield Attempt(jobs[index], pickle.loads(part))
                for attempt in attempts:
                    yield from _parts_of(Attempt(attempt.job[1], attempt.result, attempt.error))
        finally:
            if self._client.status == "running":
                self._client.unsubscribe_topic(topic)

    def _completed(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[list[Attempt]]:
        """Yield the outcomes of the jobs that have ended since the last time, at least every second."""
        futures = self._client.map(partial(_run_synchronously, function), jobs, pure=False, retries=1)
        waiting = dict(zip(futures, jobs, strict=True))
        del futures
        try:
            while waiting:
                for done in self.poll(waiting):
                    yield [_outcome_of(future, waiting.pop(future)) for future in done]
                    if done:
                        break
        finally:
            if waiting and self._client.status == "running":
                self._client.cancel(list(waiting), force=True)

    def poll(self, futures: Collection[Any]) -> Iterator[set[Any]]:
        """Yield the futures that have ended, as soon as one has; an empty set every second until then.

        The caller may remove futures from the collection, but not add any.

        Raises
        ------
        RunStoppedError
            The scheduler cannot be reached, or has had no worker for longer than the patience.
        """
        from distributed import wait

        last_seen = time.monotonic()
        while True:
            try:
                with self._client.as_current():
                    done = set(wait(list(futures), timeout=_POLL_INTERVAL, return_when="FIRST_COMPLETED").done)
            except TimeoutError:
                done = set()
                if self._has_workers():
                    last_seen = time.monotonic()
            except CancelledError:
                raise RunStoppedError(f"the scheduler at {self._address} has stopped or cannot be reached") from None
            if time.monotonic() - last_seen > self._patience:
                raise RunStoppedError(f"the scheduler at {self._address} has had no worker for {self._patience:.0f} s")
            yield done

    def _has_workers(self) -> bool:
        try:
            return bool(self._client.nthreads())
        except (OSError, CancelledError):
            raise RunStoppedError(f"the scheduler at {self._address} has stopped or cannot be reached") from None

    @property
    def _address(self) -> str:
        return str(self._client.scheduler.address) if self._client.scheduler is not None else "its address"


def _outcome_of(future: Any, job: Any) -> Attempt:
    """Return the outcome of a job that has ended, and release its future."""
    from distributed.scheduler import KilledWorker

    try:
        error = future.exception()
        if isinstance(error, KilledWorker):
            error = WorkerKilledError(error.allowed_failures + 1)
        return Attempt(job, error=error) if error is not None else Attempt(job, future.result())
    except CancelledError:
        raise RunStoppedError("the scheduler has stopped or cannot be reached") from None
    finally:
        future.release()


def _parts_of(attempt: Attempt) -> Iterator[Attempt]:
    """Yield one attempt for each part of a job's result, or the failed attempt."""
    if attempt.error is not None:
        yield attempt
    else:
        yield from (Attempt(attempt.job, part) for part in attempt.result)


def _all_parts(function: Callable[[Any], Iterable[Any]], job: Any) -> list[Any]:
    return list(function(job))


def _announce_parts(function: Callable[[Any], Iterable[Any]], topic: str, numbered: tuple[int, Any]) -> list[Any]:
    """Run a job on a worker and announce each part of its result, with the job's number, as soon as it is complete.

    A cancelled job ends after its current part, whereas dask itself would let it finish.
    """
    from distributed import get_worker

    number, job = numbered
    worker, parts = get_worker(), []
    for part in function(job):
        parts.append(part)
        worker.log_event(topic, (number, pickle.dumps(part)))
        if _is_cancelled(worker):
            break
    return parts


def _is_cancelled(worker: Any) -> bool:
    task = worker.state.tasks.get(worker.get_current_task())
    return task is None or task.state == "cancelled"


def was_killed(error: Exception) -> bool:
    """Return whether a job failed because its workers died (`WorkerKilledError`)."""
    return isinstance(error, WorkerKilledError)


def one_line(error: Exception) -> str:
    """Describe an error in one line."""
    if isinstance(error, WorkerKilledError):
        return str(error)
    return f"{type(error).__name__}: {message_line(error) or 'no message'}"


def _run_synchronously(function: Callable[[Job], Result], job: Job) -> Result:
    """Run a job with lazy arrays computed in its own process.

    Within a task dask would submit each array to the cluster, and the scheduler would be busier than the workers.
    """
    import dask

    with dask.config.set(scheduler="synchronous"):
        return function(job)


@contextmanager
def spare_threads(count: int) -> Iterator[ThreadPoolExecutor | None]:
    """Open threads for computations concurrent with the calling thread's work; None for zero threads."""
    if count < 1:
        yield None
        return
    with ThreadPoolExecutor(count) as threads:
        yield threads


def warm_estimation() -> None:
    """Compile or load the estimation's kernels."""
    # Imported here, since readers of an archive need neither numba nor the kernels.
    from gliderhpc.mission.warm import warm_kernels

    warm_kernels()


@contextmanager
def local_executor(workers: int, warm: Callable[[], None] = warm_estimation) -> Iterator[Executor]:
    """Open an executor on this machine: `workers` processes of one core each, or this process if 0.

    Kernels are compiled once by `warm` in this process, before a worker starts; the workers load them from the cache.
    Those for a single window are compiled by the first worker that needs them.
    """
    warm()
    if workers == 0:
        yield SerialExecutor()
        return
    with closing(LocalExecutor(workers)) as executor:
        yield executor
