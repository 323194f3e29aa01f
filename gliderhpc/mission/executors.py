"""Where jobs run: in this process, or on a local Dask cluster of one-thread processes."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol, TypeVar

from gliderhpc.mission.warm import warm_kernels

Job = TypeVar("Job")
Result = TypeVar("Result")


class Executor(Protocol):
    """Runs a function over jobs and yields results as they come, in any order; ``workers`` at a time."""

    workers: int

    def run(self, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Any]:
        """Yield the function's result for every job."""


class SerialExecutor:
    """One job after the other in this process: for debugging and for very small missions."""

    workers = 1

    def run(self, function: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the function's result for every job, in order."""
        for job in jobs:
            yield function(job)


class DaskExecutor:
    """Jobs on a Dask client: one task a job, results released as soon as they are seen."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self.workers = max(1, len(client.nthreads()))

    def run(self, function: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Yield the function's result for every job, as they finish."""
        from distributed import as_completed

        futures = self._client.map(partial(_by_itself, function), jobs, pure=False, retries=1)
        for future in as_completed(futures):
            result = future.result()
            future.release()
            yield result


def _by_itself(function: Callable[[Job], Result], job: Job) -> Result:
    """Run a job that computes here whatever it reads lazily.

    Within a task dask would hand it to the cluster, an array at a time, and the scheduler would be busier than the
    workers.
    """
    import dask

    with dask.config.set(scheduler="synchronous"):
        return function(job)


@contextmanager
def local_executor(workers: int, warm: Callable[[], None] = warm_kernels) -> Iterator[Executor]:
    """Executor on this machine: `workers` processes of one thread each, or none (0) for this process.

    Kernels are compiled once by `warm`, here, before a worker starts, so that the workers load them from the cache.
    """
    warm()
    if workers == 0:
        yield SerialExecutor()
        return
    import dask
    from distributed import Client, LocalCluster

    options = {
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.logging.distributed": "error",
        "distributed.admin.system-monitor.gil.enabled": False,
    }
    with (
        dask.config.set(options),
        LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=40
        ) as cluster,
        Client(cluster) as client,
    ):
        yield DaskExecutor(client)


def default_workers() -> int:
    """One worker a core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
