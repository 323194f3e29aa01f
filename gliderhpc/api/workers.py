"""Executors of jobs: worker processes on this machine, or a running Dask cluster."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.mission.cluster import ClusterAddress, cluster_executor
from gliderhpc.mission.executors import OpenExecutor, local_executor, warm_estimation
from gliderhpc.mission.local_workers import default_workers

Scheduler = str | Path | ClusterAddress | None
"""Address of a running Dask cluster's scheduler, such as ``tcp://node17:8786``, or the file that it wrote."""


def executor_of(
    workers: int | None,
    cluster: ClusterAddress | None = None,
    needed: tuple[Path, ...] = (),
    max_workers: int | None = None,
    warm: Callable[[], None] = warm_estimation,
) -> OpenExecutor:
    """Return the function that opens an executor.

    Parameters
    ----------
    workers : int, optional
        Number of local worker processes, 0 to compute in this process; None for one per core.
    cluster : ClusterAddress, optional
        Running cluster.
    needed : tuple of Path
        Files and folders that the cluster's workers must see.
    max_workers : int, optional
        Largest useful number of local processes.
    warm : callable
        Function called before the first job, once on every host.

    Raises
    ------
    InputError
        The number of workers is not a number from 0 on, or workers are requested with a running cluster.
    """
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int | np.integer) or workers < 0):
        raise InputError(f"workers={workers!r}: give a number of processes, 0 for this process alone")
    if cluster is not None:
        if workers is not None:
            raise InputError(
                f"workers={workers}: a running cluster has its own workers; leave out workers or scheduler"
            )
        return lambda: cluster_executor(cluster, needed, warm)
    count = default_workers() if workers is None else workers
    return lambda: local_executor(count if max_workers is None else min(count, max_workers), warm)


def cluster_of(scheduler: Scheduler) -> ClusterAddress | None:
    """Return the cluster given as an argument: a string with ``://`` is an address, anything else a file."""
    if scheduler is None or isinstance(scheduler, ClusterAddress):
        return scheduler
    if isinstance(scheduler, str) and "://" in scheduler:
        return ClusterAddress(scheduler)
    return ClusterAddress(file=Path(scheduler))
