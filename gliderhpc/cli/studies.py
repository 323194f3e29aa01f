"""What the verbs that run studies share: where jobs run, and how findings are written and printed."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import click

from gliderhpc.cli.console import results
from gliderhpc.cli.text import say
from gliderhpc.findings.comparison import comparison_table
from gliderhpc.findings.findings import Findings, write_findings
from gliderhpc.mission.cluster import ClusterAddress, cluster_executor
from gliderhpc.mission.executors import Executor, default_workers, local_executor, warm_estimation

_SHOWN_FAILURES = 10


def executor_for(
    workers: int | None,
    cluster: ClusterAddress | None = None,
    needed: tuple[Path, ...] = (),
    most: int | None = None,
    warm: Callable[[], None] = warm_estimation,
) -> Callable[[], AbstractContextManager[Executor]]:
    """Where jobs run: a running cluster, or local worker processes, one a core unless told otherwise and 0 for none.

    Parameters
    ----------
    workers : int, optional
        Local processes.
    cluster : ClusterAddress, optional
        A running cluster.
    needed : tuple of Path
        What its workers must see.
    most : int, optional
        More local processes than this would have nothing to do.
    warm : callable
        Run before the first job, once on every host.
    """
    if cluster is not None:
        if workers is not None:
            raise click.UsageError("--workers starts workers here; with a running cluster they are there already")
        return lambda: cluster_executor(cluster, needed, warm)
    count = default_workers() if workers is None else workers
    return lambda: local_executor(count if most is None else min(count, most), warm)


def conclude(findings: Findings, study: str, folder: Path) -> int:
    """Write and print a study's findings; returns the exit status."""
    written = write_findings(findings, study, folder)
    console = results()
    for title, rows in findings.comparisons.items():
        console.print(comparison_table(rows, title))
    for remark in findings.remarks:
        say(f"note: {remark}")
    for number, why in list(findings.failed.items())[:_SHOWN_FAILURES]:
        say(f"profile {number} left out: {why}")
    for path in written:
        say(f"written to {path}")
    return 1 if findings.failed else 0
