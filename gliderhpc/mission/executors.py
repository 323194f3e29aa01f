"""Where jobs run: in this process, on local processes of one thread each, or on a Dask cluster that is there."""

import os
import pickle
import queue
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from gliderhpc.errors import RunStoppedError
from gliderhpc.mission.local_workers import Kind, LocalWorkers, Message

Job = TypeVar("Job")
Result = TypeVar("Result")

PATIENCE = 300.0
"""Seconds that a run waits for a worker where there is none."""

_LOOK = 1.0
"""Seconds between looks at the workers while no result comes."""

ALLOCATION = {"MALLOC_TRIM_THRESHOLD_": 2**28, "MALLOC_MMAP_THRESHOLD_": 2**25}
"""How glibc keeps freed memory in workers, bytes: by dask's own setting every array of a profile goes back to the
kernel when it is freed and comes anew page by page, which took a third of a study's processor time."""

ONE_THREAD = {"OMP_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1, "MKL_NUM_THREADS": 1}
"""Threads of linear algebra in workers, of which there is one a core."""


class WorkerKilledError(Exception):
    """Every worker that ran a job died, or those on which it waited beside one that kills them."""

    def __init__(self, deaths: int) -> None:
        super().__init__(f"the worker was killed, or ran out of memory, {deaths} times")


@dataclass(frozen=True, eq=False)
class Attempt:
    """What came of a job: its result, or the error that it ended in."""

    job: Any
    result: Any = None
    error: Exception | None = None


class Executor(ABC):
    """Runs a function over jobs, ``workers`` at a time."""

    workers: int

    @abstractmethod
    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield what came of every job, as they end, in any order.

        Raises
        ------
        RunStoppedError
            There is nobody left to run them.
        """

    def streamed(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of what jobs give, as it comes, and the error of each job that ends in one.

        A part may come twice.

        Raises
        ------
        RunStoppedError
            There is nobody left to run them.
        """
        for attempt in self.attempts(partial(_all_parts, function), jobs):
            yield from _parts_of(attempt)

    def run(self, function: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the function's result for every job; the first error is raised."""
        for attempt in self.attempts(function, jobs):
            if attempt.error is not None:
                raise attempt.error
            yield attempt.result


class SerialExecutor(Executor):
    """One job after the other in this process: for debugging and for very small missions."""

    workers = 1

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield what came of every job, in order."""
        for job in jobs:
            try:
                result = function(job)
            except Exception as error:  # noqa: BLE001 - whoever asked decides
                yield Attempt(job, error=error)
            else:
                yield Attempt(job, result)

    def streamed(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of what jobs give, once, as it comes, and the error of each job that ends in one."""
        for job in jobs:
            parts = iter(function(job))
            while True:
                try:
                    part = next(parts)
                except StopIteration:
                    break
                except Exception as error:  # noqa: BLE001 - whoever asked decides
                    yield Attempt(job, error=error)
                    break
                yield Attempt(job, part)


class LocalExecutor(Executor):
    """Jobs on processes of this machine, over pipes.

    Parameters
    ----------
    workers : int
        Number of processes.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._processes = LocalWorkers(workers, {name: str(value) for name, value in (ALLOCATION | ONE_THREAD).items()})

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield what came of every job, as they end."""
        for message in self._processes.messages(function, jobs, in_parts=False):
            yield _heard_of(message, jobs)

    def streamed(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of what jobs give, as it comes, and the error of each job that ends in one."""
        for message in self._processes.messages(function, jobs, in_parts=True):
            if message[1] is not Kind.END:
                yield _heard_of(message, jobs)

    def close(self) -> None:
        """End the processes."""
        self._processes.close()


def _heard_of(message: Message, jobs: Sequence[Any]) -> Attempt:
    place, kind, value = message
    if kind is Kind.DIED:
        return Attempt(jobs[place], error=WorkerKilledError(value))
    return Attempt(jobs[place], error=value) if kind is Kind.ERROR else Attempt(jobs[place], value)


class DaskExecutor(Executor):
    """Jobs on a Dask client: one task a job, results released as soon as they are seen.

    Parameters
    ----------
    client : distributed.Client
        The cluster's.
    patience : float
        Seconds to wait for a worker where there is none.
    """

    def __init__(self, client: Any, patience: float = PATIENCE) -> None:
        self._client, self._patience = client, patience
        self.workers = max(1, len(client.nthreads()))

    def attempts(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield what came of every job, as they end."""
        for ended in self._rounds(function, jobs):
            yield from ended

    def streamed(self, function: Callable[[Any], Iterable[Any]], jobs: Sequence[Any]) -> Iterator[Attempt]:
        """Yield every part of what jobs give: soon after a worker has it, and once more with its job's others.

        Workers announce each part as an event of the scheduler; an event that is lost costs no part.
        """
        topic, announced = f"gliderhpc-{uuid.uuid4().hex}", queue.SimpleQueue[tuple[int, bytes]]()
        self._client.subscribe_topic(topic, lambda event: announced.put(event[1]))
        try:
            for ended in self._rounds(partial(_announced_parts, function, topic), list(enumerate(jobs))):
                while not announced.empty():
                    index, part = announced.get()
                    yield Attempt(jobs[index], pickle.loads(part))
                for attempt in ended:
                    yield from _parts_of(Attempt(attempt.job[1], attempt.result, attempt.error))
        finally:
            if self._client.status == "running":
                self._client.unsubscribe_topic(topic)

    def _rounds(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[list[Attempt]]:
        """Yield what came of the jobs that ended since the round before, at least every second."""
        futures = self._client.map(partial(_by_itself, function), jobs, pure=False, retries=1)
        waiting = dict(zip(futures, jobs, strict=True))
        del futures
        try:
            while waiting:
                for done in self.looks(waiting):
                    yield [_taken(future, waiting.pop(future)) for future in done]
                    if done:
                        break
        finally:
            if waiting and self._client.status == "running":
                self._client.cancel(list(waiting), force=True)

    def looks(self, futures: Collection[Any]) -> Iterator[set[Any]]:
        """Yield those of the futures that have ended, as soon as one has; none of them every second until then.

        Futures may be taken out, not added, between one look and the next; there must be a scheduler and, within
        patience, a worker.
        """
        from distributed import wait

        seen = time.monotonic()
        while True:
            try:
                with self._client.as_current():
                    done = set(wait(list(futures), timeout=_LOOK, return_when="FIRST_COMPLETED").done)
            except TimeoutError:
                done = set()
                if self._has_workers():
                    seen = time.monotonic()
            except CancelledError:
                raise RunStoppedError(f"the scheduler at {self._address} is gone") from None
            if time.monotonic() - seen > self._patience:
                raise RunStoppedError(f"the scheduler at {self._address} has had no worker for {self._patience:.0f} s")
            yield done

    def _has_workers(self) -> bool:
        try:
            return bool(self._client.nthreads())
        except (OSError, CancelledError):
            raise RunStoppedError(f"the scheduler at {self._address} is gone") from None

    @property
    def _address(self) -> str:
        return str(self._client.scheduler.address) if self._client.scheduler is not None else "its address"


def _taken(future: Any, job: Any) -> Attempt:
    """Outcome of a job that has ended; its future is released."""
    from distributed.scheduler import KilledWorker

    try:
        error = future.exception()
        if isinstance(error, KilledWorker):
            error = WorkerKilledError(error.allowed_failures + 1)
        return Attempt(job, error=error) if error is not None else Attempt(job, future.result())
    except CancelledError:
        raise RunStoppedError("the scheduler is gone") from None
    finally:
        future.release()


def _parts_of(attempt: Attempt) -> Iterator[Attempt]:
    """Attempts of the parts that a job gave, or the one that it ended in."""
    if attempt.error is not None:
        yield attempt
    else:
        yield from (Attempt(attempt.job, part) for part in attempt.result)


def _all_parts(function: Callable[[Any], Iterable[Any]], job: Any) -> list[Any]:
    return list(function(job))


def _announced_parts(function: Callable[[Any], Iterable[Any]], topic: str, numbered: tuple[int, Any]) -> list[Any]:
    """Run a job on a worker and announce each part, with the job's number, as soon as it is there.

    A job that was cancelled ends after the part at hand: dask itself would let it run to its end.
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
    """Whether the workers that ran a job died, or those on which it waited beside one that kills them."""
    return isinstance(error, WorkerKilledError)


def told(error: Exception) -> str:
    """An error on one line, for people."""
    if isinstance(error, WorkerKilledError):
        return str(error)
    return f"{type(error).__name__}: {(str(error).splitlines() or ['no message'])[0]}"


def _by_itself(function: Callable[[Job], Result], job: Job) -> Result:
    """Run a job that computes here whatever it reads lazily.

    Within a task dask would hand it to the cluster, an array at a time, and the scheduler would be busier than the
    workers.
    """
    import dask

    with dask.config.set(scheduler="synchronous"):
        return function(job)


def warm_estimation() -> None:
    """Compile or load the estimation's kernels."""
    # Imported here: who only reads an archive needs neither numba nor the kernels.
    from gliderhpc.mission.warm import warm_kernels

    warm_kernels()


@contextmanager
def local_executor(workers: int, warm: Callable[[], None] = warm_estimation) -> Iterator[Executor]:
    """Executor on this machine: `workers` processes of one thread each, or none (0) for this process.

    Kernels are compiled once by `warm`, here, before a worker starts, so that the workers load them from the cache.
    """
    warm()
    if workers == 0:
        yield SerialExecutor()
        return
    with closing(LocalExecutor(workers)) as executor:
        yield executor


def default_workers() -> int:
    """One worker a core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
