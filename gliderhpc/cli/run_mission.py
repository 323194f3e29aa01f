"""``gliderhpc run-mission``: observations in, disturbances and current out, in an archive."""

import logging
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import click
from threadpoolctl import threadpool_limits

from gliderhpc.cli import options
from gliderhpc.cli.console import results
from gliderhpc.cli.progress import logging_to, progress
from gliderhpc.cli.studies import executor_for
from gliderhpc.cli.text import say
from gliderhpc.errors import InputError
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.estimation.profile import check_engine
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.executors import default_workers
from gliderhpc.mission.lock import lock_name
from gliderhpc.mission.planning import plan_mission, select_profiles
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings, build_settings, parse_assignments
from gliderhpc.mission.summary import closing_line, summary_table
from gliderhpc.mission.warm import warm_kernels
from gliderhpc.observations import Observations, open_observations
from gliderhpc.platform import Platform
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.create import check_place
from gliderhpc.store_schema.place import Place
from gliderhpc.tuning.record_checks import inspect_records

log = logging.getLogger("gliderhpc.run")

LOOK, LOOK_FOR_LAG = 24, 4
"""Profiles whose records a run looks at before it begins, and those among them that a lag is sought in."""


_SHOWN_FAULTS = 10


@click.command("run-mission")
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.store
@options.profiles
@options.workers
@options.cluster
@options.preset
@click.option(
    "--engine", type=click.Choice(["lanes", "scipy", "fortran"]), default="lanes", show_default=True,
    help="Window solver: several profiles at a time on one core, one by one, or as lanes by kernels built beforehand.",
)  # fmt: skip
@options.start
@options.assignments
@click.option("--resume", is_flag=True, help="Finish an archive: do what is missing, damaged or of other inputs.")
@click.option("--append", is_flag=True, help="Resume, with the profiles that OBSERVATIONS has gained.")
@click.option("--overwrite", is_flag=True, help="Replace an archive that exists.")
@click.option("--dry-run", is_flag=True, help="Say how many profiles, how long, how much memory and disk; do nothing.")
@options.log_file
def command(
    observations: Path, platform_name: str, store: Place, profiles: str | None, workers: int | None,
    cluster: ClusterAddress | None, preset: str, engine: str, start: str, assignments: tuple[str, ...], resume: bool,
    append: bool, overwrite: bool, dry_run: bool, log_file: Path | None,
) -> int:  # fmt: skip
    """Estimate every profile of OBSERVATIONS and leave the results in an archive.

    Exit status 0: done; 1: some or all profiles failed (the archive says why), or the run had to stop (a full disk, no
    worker left; --resume finishes it); 2: unusable input; 130: interrupted by Ctrl-C or SIGTERM, --resume finishes it.

    \b
    Examples:
      gliderhpc run-mission mission.nc --platform petrel-l --store mission.zarr
      gliderhpc run-mission m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --store m12.zarr
      gliderhpc run-mission mission.nc --platform petrel-l --store one.zarr --profiles 18:20,68 --preset paper
      gliderhpc run-mission mission.nc --platform petrel-l --store mission.zarr --scheduler-file scheduler.json --resume
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    if sum((resume, append, overwrite)) > 1:
        raise click.UsageError("--resume, --append and --overwrite exclude each other")
    values, platform_values = parse_assignments(assignments)
    settings = build_settings({"preset": preset, "engine": engine, "start": start}, values)
    check_engine(settings)
    platform = load_platform(platform_name, platform_values)
    with logging_to(log_file), open_observations(observations) as opened:
        chosen = select_profiles(opened.profile_numbers, profiles)
        for warning in opened.warnings:
            log.warning(warning)
            say(f"warning: {warning}", err=True)
        if not set(chosen) - set(opened.faults):
            raise InputError(f"{observations}: no usable profile; {opened.faults[chosen[0]]}")
        check_seawater(platform, settings)
        plan = plan_mission(opened, settings, chosen)
        count = default_workers() if workers is None else workers
        if cluster is None:
            if workers is None:
                workers = count = plan.workers_that_fit(settings, count)
            plan.check_memory(settings, count)
        if dry_run:
            check_place(store, resume or append or overwrite or not is_begun(store))
            say(plan.describe(settings, count))
            _say_faults(opened, chosen)
            return 0
        if not (resume or append):
            _warn_of_records(opened, platform, settings, chosen)
        # The archive is created only once workers are there; its lock lies in the same folder.
        needed = (observations, *([Path(lock_name(store))] if isinstance(store, Path) else []))
        executor = executor_for(workers, cluster, needed, len(chosen), partial(warm_kernels, settings.engine))
        with progress(len(chosen), "profiles") as advance:
            result = run_mission(
                opened, platform, settings, chosen, store, executor, overwrite=overwrite, resume=resume, append=append,
                report=lambda _: advance(),
            )  # fmt: skip
    results().print(summary_table(result))
    say(closing_line(result, str(store)))
    return 1 if result.failed else 0


def _say_faults(observations: Observations, chosen: Sequence[int]) -> None:
    """Say which of the profiles would fail at once, and why."""
    faulty = [number for number in chosen if number in observations.faults]
    for number in faulty[:_SHOWN_FAULTS]:
        say(f"will fail: {observations.faults[number]}")
    if len(faulty) > _SHOWN_FAULTS:
        say(f"will fail: {len(faulty) - _SHOWN_FAULTS} more")


def _warn_of_records(
    observations: Observations, platform: Platform, settings: MissionSettings, chosen: Sequence[int]
) -> None:
    """Log a line for each error that a brief look at the records finds; nothing is corrected."""
    checks = settings.inspect
    brief = checks.model_copy(
        update={"profiles": min(checks.profiles, LOOK), "lag_profiles": min(checks.lag_profiles, LOOK_FOR_LAG)}
    )
    with threadpool_limits(limits=1):
        found = inspect_records(observations, platform, chosen, settings, brief, settings.current)
    for finding in found.found:
        log.warning("%s (gliderhpc inspect says more)", finding.line)
