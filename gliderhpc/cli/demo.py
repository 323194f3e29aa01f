"""``gliderhpc demo``: a synthetic mission is simulated, inverted, analysed by every study, and reported."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import click
import xarray as xr

from gliderhpc.archive.mission import open_mission
from gliderhpc.cli.console import logging_to, results
from gliderhpc.cli.messages import say
from gliderhpc.errors import InputError
from gliderhpc.findings.findings import write_findings
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.executors import Executor, default_workers, local_executor
from gliderhpc.mission.jobs import ProfileResult
from gliderhpc.mission.run import MissionResult, closing_line, run_mission, summary_table
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import truth_path
from gliderhpc.output_files import check_folder
from gliderhpc.platform import Platform
from gliderhpc.report.accuracy import accuracy_table, render
from gliderhpc.report.page import Written, write_mission_page
from gliderhpc.report.studies import analyze_archive, validate_archive
from gliderhpc.simulator import load_scenario, simulate_mission, write_ocean_model
from gliderhpc.store_schema import is_archive
from gliderhpc.studies.registry import STUDIES
from gliderhpc.studies.study import Request
from gliderhpc.twins.windows import STUDY as WINDOWS


@click.command("demo")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Folder for all output of the demo.",
)
def demo(out: Path) -> int:
    """Simulate a mission, invert it, compare the result with the truth, run every study, and report on it.

    Studies with ensembles run at their quick sizes, which the page states.

    \b
    Example:
      gliderhpc demo --out demo
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with logging_to(None):
        made = run_demo(out, lambda line: say(line, err=True), lambda _: None)
    console = results()
    console.print(summary_table(made.mission))
    console.print(render(accuracy_table(open_mission(made.store), made.truth)))
    say(closing_line(made.mission, str(made.store)))
    say(f"the archive: gliderhpc info {made.store}")
    say(f"the report: {made.report.page}")
    return 1 if made.mission.failed else 0


PLATFORM, SCENARIO = "petrel-l", "demo"
SEED = 1

QUICK = ("intermittency", "nulls", "drift")
"""Studies with ensembles, which the demo runs at their quick sizes."""

_MODELS = {"model_a.nc": 11, "model_b.nc": 12}
"""Files of synthetic ocean models, and the seeds of their errors."""

Say = Callable[[str], None]


@dataclass(frozen=True)
class DemoResult:
    """Outputs of the demo.

    Attributes
    ----------
    observations, truth, store : Path
        The simulated records, their truth, and the archive.
    report : Written
        The page, its tables and figures.
    mission : MissionResult
        Result of the run.
    """

    observations: Path
    truth: Path
    store: Path
    report: Written
    mission: MissionResult


@dataclass(frozen=True)
class _Tour:
    """Inputs and workers shared by all steps of the demo."""

    out: Path
    platform: Platform
    observations: Path
    store: Path
    executor: Executor
    say: Say

    def workers(self) -> AbstractContextManager[Executor]:
        """Return the shared workers for a step; they stay open after it."""
        return nullcontext(self.executor)


def run_demo(out: Path, say: Say, report: Callable[[ProfileResult], None]) -> DemoResult:
    """Simulate the demo mission into a folder, invert it, run the studies and write the report.

    `say` is called at each step, `report` after each inverted profile. Outputs of an earlier demo are replaced.

    Raises
    ------
    InputError
        The folder holds a mission other than the demo's.
    """
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    platform, scenario, observations = load_platform(PLATFORM), load_scenario(SCENARIO), out / "mission.nc"
    _check_folder(observations, f"synthetic {scenario.name}, seed {SEED}")
    say(f"simulating {scenario.profiles} profiles of {PLATFORM} over two months, seed {SEED}")
    simulate_mission(platform, observations, scenario=scenario, seed=SEED, overwrite=True)
    say("inverting them (the first run compiles the kernels, about a minute)")
    with local_executor(default_workers()) as executor:
        tour = _Tour(out, platform, observations, out / "mission.zarr", executor, say)
        mission = _invert(tour, report)
        _validate(tour)
        _study(tour)
        twins = _twins(tour)
    say("drawing the report")
    page = write_mission_page(tour.store, out / "report", twins)
    return DemoResult(observations, truth_path(observations), tour.store, page, mission)


def _check_folder(observations: Path, mission: str) -> None:
    """Check that a folder holds no other mission, since users may name theirs ``mission.nc`` too."""
    if not observations.exists():
        if is_archive(observations.with_suffix(".zarr")):
            raise InputError(f"{observations.with_suffix('.zarr')}: is not an earlier demo's; give another --out")
        return
    try:
        with xr.open_dataset(observations, decode_times=False) as dataset:
            found = dataset.attrs.get("mission")
    except (OSError, ValueError):
        found = None
    if found != mission:
        raise InputError(f"{observations}: is not an earlier demo's, so it is left alone; give another --out")


def _invert(tour: _Tour, report: Callable[[ProfileResult], None]) -> MissionResult:
    with open_observations(tour.observations) as opened:
        return run_mission(
            opened,
            tour.platform,
            MissionSettings(),
            tuple(opened.profile_numbers),
            tour.store,
            tour.workers,
            overwrite=True,
            report=report,
        )


def _validate(tour: _Tour) -> None:
    tour.say("comparing the model with fixed coefficients to the records")
    with open_observations(tour.observations) as opened:
        validate_archive(opened, tour.platform, MissionSettings(), tour.store, tour.workers)


def _study(tour: _Tour) -> None:
    """Make every study, those with ensembles at their quick sizes; the ocean models are synthesised.

    Their findings are in the archive, from which the report shows them, so that they write no files of their own.
    """
    truth = truth_path(tour.observations)
    models = tuple(str(write_ocean_model(truth, tour.out / name, seed)) for name, seed in _MODELS.items())
    for name in STUDIES:
        quick = name in QUICK
        tour.say(f"study {name}{', at its quick size' if quick else ''}")
        request = Request(tour.store, tour.workers, quick=quick, truth=truth, models=models)
        analyze_archive(name, request)


def _twins(tour: _Tour) -> Path:
    """Make the twin experiment of the windows, which is of no mission, at its quick size."""
    tour.say("twin experiment of the windows, at its quick size")
    folder = tour.out / "twins"
    plan = WINDOWS.plan([tour.platform], quick=True)
    write_findings(WINDOWS.run(plan, tour.executor, lambda: None), WINDOWS.name, folder)
    return folder
