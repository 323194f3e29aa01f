"""Run a gliderhpc command on workers that SLURM starts as its queue allows, with dask-jobqueue (``gliderhpc[slurm]``).

Usage, on a node from which jobs can be submitted: ``python examples/slurm_workers.py --jobs 8 --queue short --
run-mission mission.nc --platform petrel-l --store mission.zarr --resume``. Every job is one node's worth of one-thread
workers; the run waits for the first of them, and goes on with those that it has.
"""

import argparse
from typing import Any

import dask

from gliderhpc.cli import main
from gliderhpc.mission.executors import ALLOCATION

WORKERS_A_JOB = 16
MEMORY = "32GB"
WAIT = 24 * 3600
"""Seconds that the run waits for the queue to give it a worker."""


def slurm_cluster(queue: str | None, walltime: str) -> Any:
    """Cluster whose jobs each start `WORKERS_A_JOB` processes of one thread, and which takes nobody else's.

    Whoever reaches a port of a Dask cluster can run code as you: this one has a certificate that is made for it.
    """
    from dask_jobqueue import SLURMCluster
    from distributed import Security

    return SLURMCluster(
        queue=queue,
        cores=WORKERS_A_JOB,
        processes=WORKERS_A_JOB,
        memory=MEMORY,
        walltime=walltime,
        job_script_prologue=[
            "export OMP_NUM_THREADS=1",
            *(f"export {name}={value}" for name, value in ALLOCATION.items()),
        ],
        protocol="tls://",
        security=Security.temporary(),
        scheduler_options={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
    )


def run_on(cluster: Any, jobs: int, arguments: list[str]) -> None:
    """Ask for jobs and run the verb on them; ends with the verb's exit status."""
    cluster.scale(jobs=jobs)
    with dask.config.set(_certificate(cluster.security)):
        main([*arguments, "--scheduler", cluster.scheduler_address, "--worker-timeout", str(WAIT)])


def _certificate(security: Any) -> dict[str, Any]:
    """Settings by which a client shows the cluster's certificate, none where it has none."""
    if not security.require_encryption:
        return {}
    made = security.get_tls_config_for_role("client")
    return {
        "distributed.comm.require-encryption": True,
        "distributed.comm.tls.ca-file": made["ca_file"],
        "distributed.comm.tls.client.cert": made["cert"],
        "distributed.comm.tls.client.key": made["key"],
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=4)
    parser.add_argument("--queue")
    parser.add_argument("--walltime", default="04:00:00")
    parser.add_argument("arguments", nargs="+", help="the verb and its options, after --")
    chosen = parser.parse_args()
    with slurm_cluster(chosen.queue, chosen.walltime) as started:
        run_on(started, chosen.jobs, chosen.arguments)
