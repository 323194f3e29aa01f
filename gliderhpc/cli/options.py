"""Options that several verbs share, each defined once."""

import functools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from gliderhpc.archive.profile import ADJOINT, ESTIMATES
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.executors import PATIENCE
from gliderhpc.platform import shipped_platforms
from gliderhpc.store_schema.place import Place, is_address

Command = Callable[..., Any]


class _Place(click.ParamType):  # type: ignore[type-arg]
    """A folder, or the address of an object store."""

    name = "archive"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Place:
        """Keep an address as it is."""
        return str(value) if is_address(value) else Path(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Let the shell complete folders."""
        return [CompletionItem(incomplete, type="dir")]


PLACE = _Place()

MOST_WORKERS = 4096
"""Processes that a machine may be asked for."""

PROFILE_NUMBER = click.IntRange(min=1, max=2**31 - 1)
PROFILE_COUNT = click.IntRange(min=1, max=100_000)
SEED = click.IntRange(min=0, max=2**63 - 1)


class Finite(click.FloatRange):
    """A finite number within limits: a plain range lets NaN pass, which is neither below nor above."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Refuse what is no number."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


LONGEST_WAIT = 1e7
"""Seconds, about four months: no cluster is waited for as long."""


def _hulls_and_files(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the names of shipped hulls; where none begins so, files."""
    names = [CompletionItem(name) for name in shipped_platforms() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


platform = click.option(
    "--platform", "platform_name", required=True, metavar="NAME_OR_FILE", shell_complete=_hulls_and_files,
    help="A shipped hull, or a platform file.",
)  # fmt: skip
store = click.option(
    "--store", required=True, type=PLACE, help="The archive: a folder, ARCHIVE.zarr, or s3://BUCKET/ARCHIVE.zarr."
)


def _of_sane_length(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """Refuse numbers of profiles that no file holds, before anything counts with them."""
    if value is not None and re.search(r"\d{10}", value):
        raise click.BadParameter(f"'{value[:40]}' has a number of more than nine digits; write it as 18:20,68")
    return value


profiles = click.option(
    "--profiles", metavar="LIST", callback=_of_sane_length, help="Profiles to take, such as 18:20,68; default all."
)
workers = click.option(
    "--workers",
    type=click.IntRange(min=0, max=MOST_WORKERS),
    help="Worker processes here; default one a core, 0 for this process alone.",
)
scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, such as tcp://node17:8786."
)
scheduler_file_option = click.option(
    "--scheduler-file", type=click.Path(dir_okay=False, path_type=Path),
    help="The same, by the file that `dask scheduler --scheduler-file` wrote.",
)  # fmt: skip
_patience = click.option(
    "--worker-timeout", type=Finite(min=0.0, min_open=True, max=LONGEST_WAIT), default=PATIENCE, show_default=True,
    help="Seconds to wait for a cluster's workers where there are none, before the run stops.",
)  # fmt: skip


def cluster(command: Command) -> Command:
    """Options that name a running cluster; the command gets ``cluster``, a `ClusterAddress` or None."""

    @functools.wraps(command)
    def with_cluster(
        *arguments: Any, scheduler: str | None, scheduler_file: Path | None, worker_timeout: float, **named: Any
    ) -> Any:
        address = cluster_address(scheduler, scheduler_file, worker_timeout)
        return command(*arguments, cluster=address, **named)

    return scheduler_option(scheduler_file_option(_patience(with_cluster)))


def cluster_address(scheduler: str | None, file: Path | None, patience: float = PATIENCE) -> ClusterAddress | None:
    """Cluster that one of the two names, None where neither does."""
    if scheduler is not None and file is not None:
        raise click.UsageError("--scheduler and --scheduler-file exclude each other")
    return None if scheduler is None and file is None else ClusterAddress(scheduler, file, patience)


assignments = click.option(
    "--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Override a setting, or platform.KEY; repeatable."
)
study_assignments = click.option(
    "--set", "assignments", multiple=True, metavar="STUDY.KEY=VALUE", help="Override a study's setting; repeatable."
)
preset = click.option(
    "--preset", type=click.Choice(["recommended", "paper"]), default="recommended", show_default=True,
    help="Control-variable transform, or the paper's own choices.",
)  # fmt: skip
start = click.option(
    "--start", type=click.Choice(["prior", "smoothed"]), default="prior", show_default=True,
    help="Whose disturbance the windows start from: the filter's, or the smoother's.",
)  # fmt: skip
estimate = click.option(
    "--estimate", type=click.Choice(ESTIMATES), default=ADJOINT, show_default=True,
    help="Whose disturbances and motion are studied: the windows', or the smoother's.",
)  # fmt: skip
overwrite = click.option("--overwrite", is_flag=True, help="Replace a file that exists.")
log_file = click.option("--log-file", type=click.Path(dir_okay=False, path_type=Path), help="Also log to this file.")
study_folder = click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the study's files.  [default: ARCHIVE-studies/STUDY beside the archive]",
)  # fmt: skip
