"""Import of this module loads the modules of a cluster worker: for a server that forks workers."""

from benchmarks.preload import preload

for _name in ("dask.cli", "distributed.cli.dask_scheduler", "distributed.cli.dask_worker"):
    __import__(_name)
preload(kernels=True)
