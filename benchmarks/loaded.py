"""Import of this module loads what a mission's worker on a cluster needs: for a server that forks workers."""

from benchmarks.preload import preload

for _name in ("dask.cli", "distributed.cli.dask_scheduler", "distributed.cli.dask_worker"):
    __import__(_name)
preload(kernels=True)
