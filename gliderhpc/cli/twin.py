"""``gliderhpc twin``: worlds we made, inverted as users do it, and held against their truth."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from gliderhpc.analysis.study_output import comparison_table
from gliderhpc.analysis.twin import recoverability as recoverability_study
from gliderhpc.analysis.twin import sensitivity as sensitivity_study
from gliderhpc.analysis.twin import windows as windows_study
from gliderhpc.analysis.twin.runs import Report
from gliderhpc.analysis.twin.worlds import seeds_of
from gliderhpc.cli import options
from gliderhpc.cli.console import results
from gliderhpc.cli.progress import logging_to, progress
from gliderhpc.errors import InputError
from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.executors import Executor, default_workers, local_executor
from gliderhpc.report import twin as report

Study = TypeVar("Study")

_OUT = click.option(
    "--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for CSV, JSON and PNG."
)
_QUICK = click.option("--quick", is_flag=True, help="A small size, under two minutes on two cores.")
_SEEDS = click.option("--seeds", type=int, help="Number of twins; default the study's own.")
_PLATFORM = click.option(
    "--platform", "platform_name", default="petrel-l", show_default=True, metavar="NAME_OR_FILE",
    help="A shipped hull, or a platform file.",
)  # fmt: skip


@click.group("twin")
def command() -> None:
    """Twin experiments: how near the answers come to a truth that is known.

    \b
    Example:
      gliderhpc twin windows --out twins --quick
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@command.command("windows")
@_OUT
@_QUICK
@click.option(
    "--platform", "platform_names", multiple=True, metavar="NAME_OR_FILE",
    help="A shipped hull, or a platform file; repeatable. Default petrel-l and seawing.",
)  # fmt: skip
@_SEEDS
@options.workers
@options.log_file
def windows(
    out: Path, quick: bool, platform_names: tuple[str, ...], seeds: int | None, workers: int | None, log_file: Path | None
) -> None:  # fmt: skip
    """Window length, margin, handover and transform against the truth (Figure 5).

    \b
    Example:
      gliderhpc twin windows --out twins --platform petrel-l --seeds 10
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    platforms = [load_platform(name) for name in platform_names or ("petrel-l", "seawing")]
    size = windows_study.QUICK if quick else windows_study.FULL
    chosen = seeds_of(seeds, size.seeds)
    total = len(windows_study.window_runs(platforms, size, chosen))
    study = _run(
        out, total, workers, log_file,
        lambda executor, advance: windows_study.study_windows(platforms, size, chosen, executor, advance),
    )  # fmt: skip
    _show(report.write_windows(study, out, report.about("windows", platforms, size, chosen, quick)), out)
    for line in study.verdicts:
        click.echo(windows_study.verdict_sentence(line))


@command.command("sensitivity")
@_OUT
@_QUICK
@_PLATFORM
@_SEEDS
@options.workers
@options.log_file
def sensitivity(
    out: Path, quick: bool, platform_name: str, seeds: int | None, workers: int | None, log_file: Path | None
) -> None:
    """Noise, offsets, wrong coefficients, steps, sample intervals and gaps through the whole pipeline.

    \b
    Example:
      gliderhpc twin sensitivity --out twins --platform seawing
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    platform = load_platform(platform_name)
    size = sensitivity_study.QUICK if quick else sensitivity_study.FULL
    chosen = seeds_of(seeds, size.seeds)
    total = len(sensitivity_study.sensitivity_runs(platform, size, chosen))
    study = _run(
        out, total, workers, log_file,
        lambda executor, advance: sensitivity_study.study_sensitivity(platform, size, chosen, executor, advance),
    )  # fmt: skip
    _show(report.write_sensitivity(study, out, report.about("sensitivity", [platform], size, chosen, quick)), out)


@command.command("recoverability")
@_OUT
@_QUICK
@_PLATFORM
@_SEEDS
@options.workers
@options.log_file
def recoverability(
    out: Path, quick: bool, platform_name: str, seeds: int | None, workers: int | None, log_file: Path | None
) -> None:
    """Which yaw impulses can be found, and the uncertainty budget of the current: budget.yaml.

    \b
    Example:
      gliderhpc twin recoverability --out twins --platform petrel-l
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    platform = load_platform(platform_name)
    size = recoverability_study.QUICK if quick else recoverability_study.FULL
    chosen = seeds_of(seeds, size.seeds)
    recoverability_study.refuse_few(chosen)
    total = len(recoverability_study.recoverability_runs(platform, size, chosen))
    study = _run(
        out, total, workers, log_file,
        lambda executor, advance: recoverability_study.study_recoverability(platform, size, chosen, executor, advance),
    )  # fmt: skip
    header = report.about("recoverability", [platform], size, chosen, quick)
    _show(report.write_recoverability(study, out, header), out)
    click.echo(f"budget: {out / 'budget.yaml'}")


def _run(
    out: Path,
    total: int,
    workers: int | None,
    log_file: Path | None,
    study: Callable[[Executor, Report], Study],
) -> Study:
    """Run a study on local workers with a progress bar; the folder is made first, so that hours are not lost to it."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be made ({error.strerror}); give another --out") from None
    count = default_workers() if workers is None else workers
    with logging_to(log_file), local_executor(count) as executor, progress(total, "twins") as advance:
        return study(executor, advance)


def _show(tables: report.Tables, out: Path) -> None:
    console = results()
    for title, rows in tables.items():
        console.print(comparison_table(rows, title))
    click.echo(f"written to {out}")
