"""Running Dask clusters: connection, check of versions and shared files, and compilation once on every host."""

from __future__ import annotations

import asyncio
import json
import logging
import platform
import socket
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gliderhpc.errors import InputError, RunStoppedError, first_line
from gliderhpc.mission.executors import PATIENCE, DaskExecutor, Executor, warm_estimation
from gliderhpc.version import __version__

log = logging.getLogger(__name__)

COMPARED_PACKAGES = ("dask", "distributed", "numba", "numpy", "scipy", "zarr", "xarray")
"""Packages whose versions must agree for workers to understand jobs and compute the same results."""

_CONNECTION_LOGGERS = (
    "distributed",
    "distributed.client",
    "distributed.comm",
    "distributed.core",
    "distributed.utils",
    "asyncio",
    "tornado.application",
)
"""Loggers that report broken connections."""

_CONNECT_TIMEOUT = 30.0
"""Seconds within which a scheduler must answer."""

_FILE_TIMEOUT = 2.0
"""Seconds within which a scheduler must complete its file."""


@dataclass(frozen=True)
class ClusterAddress:
    """Address of a cluster's scheduler, or the file that it wrote.

    Attributes
    ----------
    address : str, optional
        Address, such as ``tcp://node17:8786``.
    file : Path, optional
        File written by ``dask scheduler --scheduler-file``.
    patience : float
        Time that a run waits for a worker if there is none, s.
    """

    address: str | None = None
    file: Path | None = None
    patience: float = PATIENCE

    def __str__(self) -> str:
        return str(self.address or self.file)


class FileNotSharedError(InputError):
    """A worker of a cluster does not see a file that it needs.

    Attributes
    ----------
    path : Path
        The file.
    worker : str
        The worker and its host.
    """

    def __init__(self, path: Path, worker: str) -> None:
        super().__init__(f"{path}: {worker} cannot see this file; put it on storage that all workers share")
        self.path, self.worker = path, worker


@contextmanager
def cluster_executor(
    cluster: ClusterAddress, needed: tuple[Path, ...] = (), warm: Callable[[], None] = warm_estimation
) -> Iterator[Executor]:
    """Open an executor on a running cluster, after checking its workers' versions and files and compiling the kernels.

    Parameters
    ----------
    cluster : ClusterAddress
        Address of its scheduler.
    needed : tuple of Path
        Files and folders that workers must see under the same name.
    warm : callable
        Function called once on every host before the first job.

    Raises
    ------
    InputError
        The scheduler does not answer, a worker runs other versions, or does not see a file.
    RunStoppedError
        No worker joined within the patience.
    """
    with _connection(cluster) as client:
        _wait_for_a_worker(client, cluster)
        check_versions(client)
        _check_shared_files(client, needed)
        executor = DaskExecutor(client, cluster.patience)
        _warm_hosts(client, executor, warm)
        yield executor


def examine_cluster(cluster: ClusterAddress) -> tuple[int, int]:
    """Count the workers and hosts of a running cluster, without waiting for any.

    Raises
    ------
    InputError
        The scheduler does not answer, or a worker runs other versions.
    """
    with _connection(cluster) as client:
        workers = len(client.nthreads())
        if workers == 0:
            return 0, 0
        check_versions(client)
        return workers, len(_one_worker_per_host(client))


def local_versions() -> dict[str, str]:
    """Return the versions of this process: gliderhpc, Python and the compared packages."""
    return {
        "gliderhpc": __version__,
        "Python": ".".join(platform.python_version_tuple()[:2]),
        **{name: version(name) for name in COMPARED_PACKAGES},
    }


def check_versions(client: Any) -> None:
    """Refuse workers that run other versions, naming the first that differs.

    Raises
    ------
    InputError
        A worker has another version, or no gliderhpc.
    """
    local = local_versions()
    for worker, versions in sorted(client.run(local_versions, on_error="return").items()):
        if isinstance(versions, OSError):
            continue  # the worker died during the query
        if not isinstance(versions, dict):
            raise InputError(
                f"worker {worker}: cannot run gliderhpc {local['gliderhpc']} ({first_line(versions)}); install the "
                "same version there"
            )
        for name, required in local.items():
            if versions.get(name) != required:
                raise InputError(
                    f"worker {worker}: has {name} {versions.get(name)}, but this process has {required}; start workers "
                    "from the same environment"
                )


@contextmanager
def _quiet_connections() -> Iterator[None]:
    """Silence the libraries' tracebacks on connections of a lost scheduler, which is reported in one line instead."""
    import distributed  # noqa: F401 - it sets its loggers' levels when it is imported

    loggers = {name: logging.getLogger(name) for name in _CONNECTION_LOGGERS}
    levels = {name: logger.level for name, logger in loggers.items()}
    for logger in loggers.values():
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for name, logger in loggers.items():
            logger.setLevel(levels[name])


@contextmanager
def _connection(cluster: ClusterAddress) -> Iterator[Any]:
    address = cluster.address or ""
    if cluster.file is not None:
        address = _read_address(cluster.file)
    if not address.startswith("tls://"):
        log.warning(
            "%s: without TLS, so anyone who can connect to a port of this cluster can run code as you; see "
            "docs/clusters.md",
            address,
        )
    with _quiet_connections():
        yield from _client(address, cluster)


def _client(address: str, cluster: ClusterAddress) -> Iterator[Any]:
    from distributed import Client

    try:
        _check_answer(address)
        with warnings.catch_warnings():
            # Versions are compared later, and a difference is reported in one line.
            warnings.filterwarnings("ignore", message="Mismatched versions found", category=UserWarning)
            # Not the default client: other dask computations of this process stay in this process.
            client = Client(address, timeout=_CONNECT_TIMEOUT, set_as_default=False)
    except (OSError, TimeoutError, CancelledError, ValueError, OverflowError, MemoryError, ImportError) as error:
        # Another kind of server may answer with bytes that are then read as message sizes.
        raise InputError(
            f"{cluster}: no Dask scheduler answers there ({first_line(error)}); check the address, or start one"
        ) from None
    except TypeError as error:
        if not address.startswith("tls://"):
            raise
        raise InputError(
            f"{cluster}: accepts only clients with a certificate; set the DASK_DISTRIBUTED__COMM__TLS__... variables "
            f"of docs/clusters.md ({first_line(error)})"
        ) from None
    try:
        yield client
    finally:
        client.close(timeout=5)


def _check_answer(address: str) -> None:
    """Connect to a scheduler without a client, because a client that fails leaves its threads and settings behind."""
    from distributed.comm.core import connect
    from distributed.security import Security

    async def ask() -> None:
        comm = await connect(address, timeout=_CONNECT_TIMEOUT, **Security().get_connection_args("client"))
        await comm.close()

    # In a thread, since notebooks have a running event loop.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, ask()).result()


def _read_address(file: Path) -> str:
    """Read the address that a scheduler wrote, and wait for it if the scheduler has just been started."""
    began = time.monotonic()
    while not file.exists():
        if time.monotonic() - began > _CONNECT_TIMEOUT:
            raise InputError(f"{file}: no such file; start `dask scheduler --scheduler-file {file}` first")
        time.sleep(0.2)
    file_found = time.monotonic()
    while True:
        try:
            return str(json.loads(file.read_text("utf-8"))["address"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            if time.monotonic() - file_found > _FILE_TIMEOUT:
                raise InputError(
                    f"{file}: not a file of `dask scheduler --scheduler-file` ({first_line(error)}); start a scheduler "
                    "with it"
                ) from None
        time.sleep(0.1)


def _wait_for_a_worker(client: Any, cluster: ClusterAddress) -> None:
    if not client.nthreads():
        log.info("%s has no worker yet; waiting up to %.0f s", cluster, cluster.patience)
    try:
        client.wait_for_workers(1, timeout=cluster.patience)
    except TimeoutError:
        raise RunStoppedError(f"the scheduler at {cluster} has had no worker for {cluster.patience:.0f} s") from None


def _check_shared_files(client: Any, needed: tuple[Path, ...]) -> None:
    """Check that one worker on every host can see the files."""
    names = [str(path.resolve()) for path in needed]
    for host, worker in _one_worker_per_host(client).items():
        for unseen in client.run(_missing_files, names, workers=[worker], on_error="ignore").values():
            for name in unseen:
                raise FileNotSharedError(Path(name), f"worker {worker} on {host}")


def _warm_hosts(client: Any, executor: DaskExecutor, warm: Callable[[], None]) -> None:
    """Compile on one worker of every host; the others load the kernels from its cache.

    A worker lost in the meantime is skipped: the first job on its host compiles instead.
    """
    tasks = {
        client.submit(_warm_worker, warm, workers=[worker], pure=False): worker
        for worker in _one_worker_per_host(client).values()
    }
    for ended in executor.poll(tasks):
        for task in ended:
            del tasks[task]
            task.result()
        workers = client.nthreads()
        lost = [task for task, worker in tasks.items() if worker not in workers]
        for task in lost:
            del tasks[task]
        client.cancel(lost, force=True)
        if not tasks:
            return


def _warm_worker(warm: Callable[[], None]) -> None:
    """Compile or load the kernels in the worker that runs this task."""
    warm()


def _missing_files(names: list[str]) -> list[str]:
    return [name for name in names if not Path(name).exists()]


def _one_worker_per_host(client: Any) -> dict[str, str]:
    """Return the address of one worker by host."""
    return {host: worker for worker, host in client.run(socket.gethostname, on_error="ignore").items()}
