"""Checks of a run's requirements: versions, processor, compiled kernels, write access, free disk, and a cluster."""

from __future__ import annotations

import platform
import shutil
import time
import uuid
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from gliderhpc.errors import InputError
from gliderhpc.kernels.cache import VARIABLES, compiled_cache
from gliderhpc.kernels.jit import UNCOMPILED, is_uncompiled
from gliderhpc.kernels.lane_type import LANES
from gliderhpc.kernels.precompiled import precompiled_kernels
from gliderhpc.mission.cluster import ClusterAddress, examine_cluster
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.store_schema.location import Location, check_assertions, is_address
from gliderhpc.version import __version__
from gliderhpc.wording import counted

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "zarr", "xarray", "dask", "distributed")
"""Packages whose versions are reported."""

EXTRAS = {
    "slocum": ("dbdreader", "binary files of Slocum gliders"),
    "cloud": ("obstore", "archives in object stores"),
    "slurm": ("dask-jobqueue", "workers that SLURM starts"),
    "bench": ("casadi", "make bench"),
    "docs": ("mkdocs-material", "make docs"),
}
"""Optional extras: a distribution that identifies each, and its purpose."""

MIN_FREE_BYTES = 1 << 30
"""Free disk space below which no run should begin: a mission of a few hundred profiles takes one or two GiB."""

_BY_WIDTH = (("avx512f", "512-bit vectors (AVX-512)"), ("avx2", "256-bit vectors (AVX2)"), ("neon", "128-bit (NEON)"))


class State(Enum):
    """Outcome of a check: in order; absent and optional; missing and required."""

    OK = "ok"
    ABSENT = "absent"
    MISSING = "missing"


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Attributes
    ----------
    name : str
        Name of the check.
    state : State
        Outcome.
    found : str
        Finding.
    remedy : str
        Remedy, empty where none is needed.
    """

    name: str
    state: State
    found: str
    remedy: str = ""


def examine(location: Location, cluster: ClusterAddress | None = None) -> Iterable[Check]:
    """Yield all checks for an archive at `location` and, if given, for a run on `cluster`."""
    yield Check("gliderhpc", State.OK, f"{__version__}, {Path(__file__).parents[1]}")
    yield interpreter()
    yield from map(package, PACKAGES)
    yield processor()
    yield kernel_cache()
    yield precompiled()
    yield compiled_kernels()
    yield write_access(location)
    if not is_address(location):
        yield free_disk(Path(location))
    if cluster is not None:
        yield reachable_cluster(cluster)
    yield from (extra(name) for name in EXTRAS)


def interpreter() -> Check:
    """Check that this Python can read archives."""
    found = f"{platform.python_version()}, {platform.system()} {platform.machine()}"
    try:
        check_assertions()
    except InputError as error:
        fault, remedy = str(error).split("; ", 1)
        return Check("python", State.MISSING, f"{found}: {fault}", remedy)
    return Check("python", State.OK, found)


def package(name: str) -> Check:
    """Check the version of a required package."""
    try:
        return Check(name, State.OK, version(name))
    except PackageNotFoundError:
        return Check(name, State.MISSING, "not installed", "pip install --upgrade gliderhpc")


def processor() -> Check:
    """Report available cores, width of the vector registers, and lanes of the kernels."""
    import llvmlite.binding

    features = llvmlite.binding.get_host_cpu_features()
    width = next((text for feature, text in _BY_WIDTH if features.get(feature)), "vector width unknown")
    cores = counted(default_workers(), "core")
    found = f"{llvmlite.binding.get_host_cpu_name()}, {cores}, {width}, {LANES} lanes per kernel"
    return Check("processor", State.OK, found)


def kernel_cache() -> Check:
    """Check that the cache of compiled kernels can be written."""
    folder = compiled_cache()
    return _check_write(
        "kernel cache", str(folder), lambda: _write_file(folder), f"set {VARIABLES[0]} to a folder that can be written"
    )


def precompiled() -> Check:
    """Report whether precompiled kernels, from the wheel or a named folder, are used, and the reason if not."""
    folder, reason = precompiled_kernels()
    if folder is None:
        return Check("precompiled", State.ABSENT, reason, "kernels are compiled on this machine instead, once")
    return Check("precompiled", State.OK, f"{folder.name}, {_compiled_in(folder)} kernels in {folder}")


def compiled_kernels() -> Check:
    """Check whether the kernels are compiled and can be loaded; damaged ones are compiled again."""
    if is_uncompiled():
        return Check("kernels", State.MISSING, UNCOMPILED, "unset it")
    folder = compiled_cache()
    count = _compiled_in(folder)
    if count == 0 and precompiled_kernels()[0] is None:
        return Check(
            "kernels", State.ABSENT, "none compiled yet", "the first run compiles them, in about half a minute"
        )
    began = time.perf_counter()
    warm_kernels()
    seconds, new = time.perf_counter() - began, _compiled_in(folder) - count
    found = (
        f"{count} compiled, " * bool(count) + f"loaded and run in {seconds:.1f} s" + f"; {new} were missing" * bool(new)
    )
    return Check("kernels", State.OK, found)


def write_access(location: Location) -> Check:
    """Check that an archive can be written at a location."""
    write = (lambda: _write_object(str(location))) if is_address(location) else (lambda: _write_file(Path(location)))
    return _check_write("write access", str(location), write, "give a `store` that can be written")


def free_disk(location: Path) -> Check:
    """Check the free space on the disk of a folder, which need not exist yet."""
    free = shutil.disk_usage(_existing(location)).free
    is_enough = free >= MIN_FREE_BYTES
    found = f"{free / 2**30:.1f} GiB at {location}"
    remedy = (
        ""
        if is_enough
        else f"free some space: a mission takes gigabytes, and this is less than {MIN_FREE_BYTES / 2**30:g} GiB"
    )
    return Check("free disk", State.OK if is_enough else State.MISSING, found, remedy)


def reachable_cluster(cluster: ClusterAddress) -> Check:
    """Check that a cluster responds, has workers, and runs the same versions."""
    if cluster.file is not None and not cluster.file.exists():
        remedy = f"dask scheduler --scheduler-file {cluster.file}"
        return Check("cluster", State.MISSING, f"{cluster.file}: no such file", remedy)
    try:
        workers, hosts = examine_cluster(cluster)
    except InputError as error:
        return Check("cluster", State.MISSING, str(error), "see docs/clusters.md")
    if workers == 0:
        return Check("cluster", State.MISSING, f"{cluster} answers, but has no workers", "start a `dask worker`")
    return Check("cluster", State.OK, f"{cluster}: {workers} workers on {hosts} hosts, with the same versions as here")


def extra(name: str) -> Check:
    """Check whether an optional extra is installed."""
    distribution, purpose = EXTRAS[name]
    try:
        return Check(f"extra {name}", State.OK, f"{distribution} {version(distribution)} ({purpose})")
    except PackageNotFoundError:
        remedy = f"pip install 'gliderhpc[{name}]'"
        return Check(f"extra {name}", State.ABSENT, f"{distribution} ({purpose})", remedy)


def _compiled_in(folder: Path) -> int:
    """Count the compiled kernels in a folder of numba's cache."""
    return len(list(folder.glob("*.nbc")))


def _check_write(name: str, where: str, write: Callable[[], None], remedy: str) -> Check:
    """Try to write, and report an obstacle in one line."""
    try:
        write()
    except InputError as error:
        return Check(name, State.MISSING, str(error), remedy)
    except OSError as error:
        reason = (error.strerror or str(error) or type(error).__name__).splitlines()[0]
        return Check(name, State.MISSING, f"{where}: {reason}", remedy)
    return Check(name, State.OK, f"{where} can be written")


def _write_file(folder: Path) -> None:
    """Write a file in a folder, or in the nearest existing parent, and delete it."""
    probe = _existing(folder) / f".gliderhpc-doctor-{uuid.uuid4().hex}"
    try:
        probe.write_bytes(b"gliderhpc")
    finally:
        probe.unlink(missing_ok=True)


def _write_object(address: str) -> None:
    """Put an object beneath an address and delete it.

    Raises
    ------
    OSError
        The store refuses it.
    """
    from gliderhpc.store_schema.location import bucket_at, network_errors

    bucket, key = bucket_at(address), f".gliderhpc-doctor-{uuid.uuid4().hex}"
    with network_errors():
        bucket.put(key, b"gliderhpc")
        bucket.delete(key)


def _existing(path: Path) -> Path:
    """Return the path itself or its nearest existing parent."""
    path = path.absolute()
    return next(found for found in (path, *path.parents) if found.exists())
