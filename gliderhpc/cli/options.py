"""Options shared by several verbs, each defined once."""

import functools
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from gliderhpc.api.import_options import NUMBERS
from gliderhpc.api.workers import executor_of
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.executors import PATIENCE, OpenExecutor
from gliderhpc.platform import shipped_platforms
from gliderhpc.shipped import nearest

if TYPE_CHECKING:
    from gliderhpc.store_schema.location import Location

Command = Callable[..., Any]


class _Place(click.ParamType):  # type: ignore[type-arg]
    """Parameter type of a folder or an address in an object store."""

    name = "archive"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> "Location":
        """Return an address unchanged, and a folder as a path."""
        # This imports zarr, which verbs without an archive do not need.
        from gliderhpc.store_schema.location import is_address

        return str(value) if is_address(value) else Path(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Complete folders."""
        return [CompletionItem(incomplete, type="dir")]


PLACE = _Place()

MAX_WORKERS = 4096
"""Maximum number of local worker processes."""

PROFILE_NUMBER = click.IntRange(min=1, max=2**31 - 1)
PROFILE_COUNT = click.IntRange(min=1, max=100_000)
SEED = click.IntRange(min=0, max=2**63 - 1)


class Finite(click.FloatRange):
    """Parameter type of a finite number within limits; click's own range accepts NaN."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Refuse numbers that are not finite."""
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


class Choice(click.Choice[str]):
    """Parameter type of one of several words; the message about another word suggests the nearest."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word."""
        if isinstance(value, str) and value not in self.choices:
            self.fail(f"{value!r} is not one of {', '.join(self.choices)}{nearest(value, self.choices)}", param, ctx)
        return super().convert(value, param, ctx)


MAX_PATIENCE = 1e7
"""Longest wait for a cluster's workers: about four months, in seconds."""


def _hulls_and_files(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the names of shipped hulls, or files if none matches."""
    names = [CompletionItem(name) for name in shipped_platforms() if name.startswith(incomplete)]
    return names or [CompletionItem(incomplete, type="file")]


platform = click.option(
    "--platform",
    "platform_name",
    required=True,
    metavar="NAME_OR_FILE",
    shell_complete=_hulls_and_files,
    help="A shipped hull, or a platform file.",
)
store = click.option(
    "--store", required=True, type=PLACE, help="The archive: a folder, ARCHIVE.zarr, or s3://BUCKET/ARCHIVE.zarr."
)


def _check_digits(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """Refuse profile numbers too large for any file, before they are used."""
    if value is not None and re.search(r"\d{10}", value):
        raise click.BadParameter(f"'{value[:40]}' has a number of more than nine digits; write it as 18:20,68")
    return value


profiles = click.option(
    "--profiles", metavar="LIST", callback=_check_digits, help="Profiles to use, such as 18:20,68; by default all."
)
workers = click.option(
    "--workers",
    type=click.IntRange(min=0, max=MAX_WORKERS),
    help="Worker processes on this machine; by default one per core, 0 to compute in this process.",
)
scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster of this scheduler, such as tcp://node17:8786."
)
scheduler_file_option = click.option(
    "--scheduler-file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="The same, from the file that `dask scheduler --scheduler-file` wrote.",
)
_patience = click.option(
    "--worker-timeout",
    type=Finite(min=0.0, min_open=True, max=MAX_PATIENCE),
    default=PATIENCE,
    show_default=True,
    help="Seconds to wait while the cluster has no workers, before the run stops.",
)


def cluster(command: Command) -> Command:
    """Add the options of a running cluster; the command receives ``cluster``, a `ClusterAddress` or None."""

    @functools.wraps(command)
    def with_cluster(
        *arguments: Any, scheduler: str | None, scheduler_file: Path | None, worker_timeout: float, **named: Any
    ) -> Any:
        address = cluster_address(scheduler, scheduler_file, worker_timeout)
        return command(*arguments, cluster=address, **named)

    return scheduler_option(scheduler_file_option(_patience(with_cluster)))


def cluster_address(scheduler: str | None, file: Path | None, patience: float = PATIENCE) -> ClusterAddress | None:
    """Return the cluster of either option, None if neither is set."""
    if scheduler is not None and file is not None:
        raise click.UsageError("--scheduler and --scheduler-file are mutually exclusive; give one of them")
    return None if scheduler is None and file is None else ClusterAddress(scheduler, file, patience)


def executor_for(workers: int | None, cluster: ClusterAddress | None = None, *further: Any) -> OpenExecutor:
    """Check the arguments as options, and return the function of `executor_of` that opens the executor."""
    check_workers(workers, cluster)
    return executor_of(workers, cluster, *further)


def check_workers(workers: int | None, cluster: ClusterAddress | None) -> None:
    """Refuse local workers where a cluster is running."""
    if cluster is not None and workers is not None:
        raise click.UsageError(
            "--workers starts local workers; leave it out, since a running cluster has its own workers"
        )


assignments = click.option(
    "--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Override a setting, or platform.KEY; repeatable."
)
study_assignments = click.option(
    "--set", "assignments", multiple=True, metavar="STUDY.KEY=VALUE", help="Override a study's setting; repeatable."
)
preset = click.option(
    "--preset",
    type=Choice(["recommended", "paper"]),
    default="recommended",
    show_default=True,
    help="recommended: with a transform of the control variables; paper: as in the paper.",
)
start = click.option(
    "--start",
    type=Choice(["prior", "smoothed"]),
    help="Path from which the windows start: the filter's (prior) or the smoother's.  [default: by preset and sensors]",
)
deployment = click.option(
    "--deployment",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.yaml",
    help="Global attributes from a file, such as pyglider's deployment.yml.",
)
records_out = click.argument("out", type=click.Path(path_type=Path), metavar="OUT.nc")


def sources(metavar: str) -> Callable[[Command], Command]:
    """Return the argument of the files or folders to import."""
    return click.argument("sources", nargs=-1, required=True, type=click.Path(path_type=Path), metavar=metavar)


def declination(default: str = ", instead of that in the files.") -> Callable[[Command], Command]:
    """Return the option of the magnetic declination; `default` ends its help with the value used without it."""
    return click.option(
        "--declination",
        type=Finite(*NUMBERS["declination"].limits),
        metavar="DEGREE",
        help=f"Magnetic declination, east positive{default}",
    )


overwrite = click.option("--overwrite", is_flag=True, help="Replace an existing file.")
log_file = click.option("--log-file", type=click.Path(dir_okay=False, path_type=Path), help="Also log to this file.")
study_folder = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the study's files.  [default: ARCHIVE-studies/STUDY in the archive's folder]",
)
