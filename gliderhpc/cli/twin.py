"""``gliderhpc twin``: inversion of simulated dives like real ones, and comparison of the estimates with the truth."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from gliderhpc.cli import options
from gliderhpc.cli.console import logging_to, progress
from gliderhpc.cli.messages import Verb
from gliderhpc.cli.options import executor_for
from gliderhpc.cli.studies import write_and_print
from gliderhpc.estimation.current_errors import read_budget
from gliderhpc.flight.glider import load_platform
from gliderhpc.output_files import check_folder
from gliderhpc.twins.currents.experiment import NAME as CURRENTS
from gliderhpc.twins.currents.experiment import currents_study
from gliderhpc.twins.estimators.experiment import STUDY as ESTIMATORS
from gliderhpc.twins.recoverability.experiment import STUDY as RECOVERABILITY
from gliderhpc.twins.sensitivity.experiment import STUDY as SENSITIVITY
from gliderhpc.twins.study import TwinStudy
from gliderhpc.twins.windows.experiment import STUDY as WINDOWS

_HULLS = ("petrel-l", "seawing")

_COMMON = (
    click.option(
        "--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for CSV, JSON and PNG."
    ),
    click.option("--quick", is_flag=True, help="A small size, under two minutes on two cores."),
    click.option("--seeds", type=options.PROFILE_COUNT, help="Number of twins; the default depends on the study."),
    options.workers,
    options.log_file,
)
_PLATFORMS = click.option(
    "--platform",
    "platforms",
    multiple=True,
    metavar="NAME_OR_FILE",
    help=f"A shipped hull, or a platform file; repeatable. Default {' and '.join(_HULLS)}.",
)
_PLATFORM = click.option(
    "--platform",
    default=_HULLS[0],
    show_default=True,
    metavar="NAME_OR_FILE",
    help="A shipped hull, or a platform file.",
)


def _common(command: Callable[..., int]) -> Callable[..., int]:
    """Add to a command the options common to all studies."""
    for option in reversed(_COMMON):
        command = option(command)
    return command


@click.group("twin")
def twin() -> None:
    """Twin experiments: estimates compared with a known truth.

    \b
    Example:
      gliderhpc twin windows --out twins --quick
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped


@twin.command(WINDOWS.name, cls=Verb, short_help="Window length, margin, handover, transform (Figure 5).")
@_PLATFORMS
@_common
def windows(platforms: tuple[str, ...], **arguments: Any) -> int:
    """Effect of window length, margin, handover and transform on the errors (Figure 5).

    \b
    Example:
      gliderhpc twin windows --out twins --platform petrel-l --seeds 10
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _run(WINDOWS, platforms or _HULLS, **arguments)


@twin.command(SENSITIVITY.name, cls=Verb, short_help="Noise, offsets, wrong coefficients, steps, gaps.")
@_PLATFORM
@_common
def sensitivity(platform: str, **arguments: Any) -> int:
    """Effect of noise, offsets, wrong coefficients, steps, sample intervals and gaps on the whole pipeline.

    \b
    Example:
      gliderhpc twin sensitivity --out twins --platform seawing
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _run(SENSITIVITY, [platform], **arguments)


@twin.command(RECOVERABILITY.name, cls=Verb, short_help="Detectable yaw impulses; error budget of the current.")
@_PLATFORM
@_common
def recoverability(platform: str, **arguments: Any) -> int:
    """Detectable yaw impulses, and the uncertainty budget of the current: budget.yaml.

    \b
    Example:
      gliderhpc twin recoverability --out twins --platform petrel-l
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _run(RECOVERABILITY, [platform], **arguments)


@twin.command(ESTIMATORS.name, cls=Verb, short_help="Filter, smoothers and adjoint on the same twins.")
@_PLATFORM
@_common
def estimators(platform: str, **arguments: Any) -> int:
    """Filter, smoothers and adjoint on the same twins: errors, intervals, cost, and which to use for what.

    \b
    Example:
      gliderhpc twin estimators --out twins --quick
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _run(ESTIMATORS, [platform], **arguments)


@twin.command(CURRENTS, cls=Verb, short_help="Coverage of the ellipses; vertical resolution.")
@_PLATFORM
@click.option(
    "--budget",
    type=click.Path(path_type=Path),
    help="budget.yaml of `twin recoverability`: compared with the fitted constants, and written with them.",
)
@_common
def currents(platform: str, budget: Path | None, **arguments: Any) -> int:
    """Coverage of the current's ellipses, and the transfer function of its depth-resolved part by vertical scale.

    \b
    Example:
      gliderhpc twin currents --out twins --budget twins/budget.yaml
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    return _run(currents_study(None if budget is None else read_budget(budget)), [platform], **arguments)


def _run(
    study: TwinStudy[Any],
    platforms: Sequence[str],
    *,
    out: Path,
    quick: bool,
    seeds: int | None,
    workers: int | None,
    log_file: Path | None,
) -> int:
    """Check the output folder, and run a study on local workers with a progress bar."""
    plan = study.plan([load_platform(name) for name in platforms], quick=quick, seeds=seeds)
    check_folder(out)
    total = len(study.runs(plan))
    with logging_to(log_file), executor_for(workers)() as executor, progress(total, "twins") as advance:
        findings = study.run(plan, executor, advance)
    return write_and_print(findings, study.name, out)
