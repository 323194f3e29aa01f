"""``gliderhpc run-mission``: inversion of observations into an archive of disturbances and currents."""

import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.table import Table
from rich.text import Text

from gliderhpc.api.missions import invert_prepared
from gliderhpc.archive.current import adopted_current
from gliderhpc.cli import options
from gliderhpc.cli.console import PRINTED, logging_to, progress, results
from gliderhpc.cli.messages import Verb, echo, warn, with_options
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.cluster import ClusterAddress
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.profile_rows import Row
from gliderhpc.mission.run import Existing, MissionResult
from gliderhpc.mission.settings import build_settings, parse_assignments
from gliderhpc.observations import Observations, open_observations
from gliderhpc.observations.profile_numbers import as_ranges
from gliderhpc.store_schema.commits import is_begun
from gliderhpc.store_schema.create import check_location
from gliderhpc.store_schema.location import Location, check_assertions
from gliderhpc.wording import counted

log = logging.getLogger("gliderhpc.run")

_SHOWN_FAULTS = 10
_MESSAGE_WIDTH = 60


@click.command("run-mission", cls=Verb)
@click.argument("observations", type=click.Path(path_type=Path))
@options.platform
@options.store
@options.profiles
@options.workers
@options.cluster
@options.preset
@click.option(
    "--engine",
    type=options.Choice(["lanes", "scipy", "fortran"]),
    default="lanes",
    show_default=True,
    help="Window solver: lanes (several windows at a time per core), scipy (one at a time), fortran (as lanes).",
)
@options.start
@options.assignments
@click.option(
    "--resume", is_flag=True, help="Finish an archive: compute profiles that are missing, damaged or from other inputs."
)
@click.option("--append", is_flag=True, help="Resume, and add profiles that are new in OBSERVATIONS.")
@click.option("--overwrite", is_flag=True, help="Replace an existing archive.")
@click.option(
    "--dry-run", is_flag=True, help="Only estimate the size of the run: number of profiles, time, memory, disk."
)
@options.log_file
def run_mission(
    observations: Path,
    platform_name: str,
    store: Location,
    profiles: str | None,
    workers: int | None,
    cluster: ClusterAddress | None,
    preset: str,
    engine: str,
    start: str | None,
    assignments: tuple[str, ...],
    resume: bool,
    append: bool,
    overwrite: bool,
    dry_run: bool,
    log_file: Path | None,
) -> int:
    """Invert every profile of OBSERVATIONS and write the results into an archive.

    Exit status 0: done; 1: some or all profiles failed (the archive says why), or the run had to stop (a full disk, no
    worker left; --resume finishes it); 2: unusable input; 130: interrupted by Ctrl-C or SIGTERM, --resume finishes it.

    \b
    Examples:
      gliderhpc run-mission mission.nc --platform petrel-l --store mission.zarr
      gliderhpc run-mission m12.nc --platform seaexplorer --set platform.buoyancy.neutral_volume=-215 --store m12.zarr
      gliderhpc run-mission mission.nc --platform petrel-l --store one.zarr --profiles 18:20,68 --preset paper
      gliderhpc run-mission mission.nc --platform petrel-l --store mission.zarr --scheduler-file scheduler.json --resume
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    check_assertions()
    existing = Existing.of(overwrite=overwrite, resume=resume, append=append)
    values, platform_values = parse_assignments(assignments)
    settings = build_settings({"preset": preset, "engine": engine, "start": start}, values)
    platform = load_platform(platform_name, platform_values)
    with logging_to(log_file), open_observations(observations) as opened:
        prepared = prepare_mission(
            opened, platform, settings, profiles, workers, on_cluster=cluster is not None, warn=_warn
        )
        if dry_run:
            check_location(store, existing is not Existing.REFUSE or not is_begun(store))
            echo(prepared.plan.describe(settings, prepared.workers))
            _print_faults(opened, prepared.plan.profiles)
            return 0
        options.check_workers(workers, cluster)
        result = invert_prepared(
            prepared, store, cluster, existing=existing, progress=lambda count: progress(count, "profiles")
        )
    results().print(summary_table(result))
    echo(closing_line(result, str(store)))
    return 1 if result.failed else 0


def _warn(warning: str) -> None:
    """Print a warning on stderr, and log it in the file."""
    log.warning("%s", warning, extra=PRINTED)
    warn(warning, err=True)


def _print_faults(observations: Observations, chosen: Sequence[int]) -> None:
    """Print the profiles that would fail at once, with the reason."""
    faulty = [number for number in chosen if number in observations.faults]
    for number in faulty[:_SHOWN_FAULTS]:
        echo(f"will fail: {observations.faults[number]}")
    if len(faulty) > _SHOWN_FAULTS:
        echo(f"will fail: {len(faulty) - _SHOWN_FAULTS} more")


def summary_table(result: MissionResult) -> Table:
    """Return a table of a run's profiles."""
    table = Table(
        title="Profiles",
        title_justify="left",
        caption="current from the smoother; a: from the adjoint, where the smoother has none",
        caption_justify="left",
    )
    for heading in ("profile", "status", "depth m", "hours", "windows", "converged", "current N m/s", "E m/s", "s"):
        table.add_column(heading, justify="left" if heading == "status" else "right", no_wrap=True)
    table.add_column("message", max_width=_MESSAGE_WIDTH, overflow="fold")
    for number, row in sorted(result.rows.items()):
        table.add_row(
            str(number),
            row["status"],
            _number(row, "max_depth", ".0f"),
            _number(row, "duration", ".2f", 1.0 / 3600.0),
            _number(row, "window_count", "d"),
            _number(row, "converged_fraction", ".0%"),
            *_current(row),
            _number(row, "run_seconds", ".1f"),
            Text(with_options(row.get("message", ""))),
        )
    return table


def closing_line(result: MissionResult, store: str) -> str:
    """Summarise a run in one line: counts of profiles, median current, duration and archive."""
    done = [row for row in result.rows.values() if row["status"] == "done"]
    parts = [f"{len(done)} of {counted(len(result.rows), 'profile')} done"]
    if result.reused:
        parts[0] += f" ({len(result.reused)} of them in an earlier run)"
    if result.failed:
        parts.append(f"{len(result.failed)} failed: {as_ranges(result.failed)}")
    current = adopted_current(_current_columns(done))
    if current.known.any():
        speed = np.median(np.hypot(current.north, current.east)[current.known])
        parts.append(f"median current {speed:.3f} m/s over {counted(current.known.sum(), 'profile')} ({current.label})")
    return f"{'; '.join(parts)}; {result.seconds:.1f} s; {store}"


def _current_columns(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Collect the columns ``dac_*`` of rows; NaN where a row has no such value."""
    names = dict.fromkeys(name for row in rows for name in row if name.startswith("dac_"))
    return {name: [row.get(name, np.nan) for row in rows] for name in names}


def _current(row: Row) -> tuple[str, str]:
    """Format north and east of the adopted current, with a mark if it is not the smoother's."""
    current = adopted_current(row)
    if not current.known:
        return "-", "-"
    mark = "" if current.smoothed else " a"
    return f"{float(current.north):+.3f}{mark}", f"{float(current.east):+.3f}{mark}"


def _number(row: Row, name: str, form: str, factor: float = 1.0) -> str:
    value = row.get(name)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return format(value * factor if factor != 1.0 else value, form)
