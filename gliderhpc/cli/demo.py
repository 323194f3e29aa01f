"""``gliderhpc demo``: simulate a synthetic mission, invert it, run every study, and write the report."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import xarray as xr
from rich.table import Table

from gliderhpc.api.currents import currents
from gliderhpc.api.studies import analyze_archive
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.cli.console import logging_to, results
from gliderhpc.cli.messages import Verb, echo
from gliderhpc.cli.run_mission import closing_line, summary_table
from gliderhpc.errors import InputError
from gliderhpc.findings.results import write_findings
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.executors import Executor, local_executor, warm_estimation
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import Existing, MissionResult, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.mission.warm import compile_in_background, is_compiled, warm_simulator
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import truth_path
from gliderhpc.output_files import check_folder
from gliderhpc.platform import Platform
from gliderhpc.report.accuracy import accuracy_table, render
from gliderhpc.report.page.mission_page import write_mission_page
from gliderhpc.report.page.rendering import ReportFiles
from gliderhpc.simulator import Scenario, load_scenario, simulate_mission, write_ocean_model
from gliderhpc.store_schema import is_archive
from gliderhpc.store_schema.location import check_assertions
from gliderhpc.studies.registry import STUDIES, VALIDATION
from gliderhpc.studies.request import Request, Simulation
from gliderhpc.twins.windows.experiment import STUDY as WINDOWS
from gliderhpc.wording import counted


@click.command("demo", cls=Verb)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Folder for all output of the demo.",
)
@click.option("--full", is_flag=True, help="Run all fifteen dives of two months, and the twin experiment on windows.")
def demo(out: Path, full: bool) -> int:
    """Simulate a mission, invert it, compare the result with the truth, run every study, and report on it.

    Without --full only the first dives of the mission are simulated. Studies with ensembles run at their quick sizes,
    as the page states.

    \b
    Examples:
      gliderhpc demo --out demo
      gliderhpc demo --full
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    with logging_to(None):
        result = run_demo(out, lambda line: echo(line, err=True), results().print, full=full)
    echo(closing_line(result.mission, str(result.store)))
    echo(f"the archive: gliderhpc info {result.store}")
    echo(f"the report: {result.report.page}")
    return 1 if result.mission.failed else 0


PLATFORM, SCENARIO = "petrel-l", "demo"
SEED = 1

SHORT_DEMO_DIVES = 6
"""Number of dives of the demo without `--full`."""

QUICK = ("intermittency", "nulls", "drift")
"""Studies with ensembles; the demo runs them at their quick sizes."""

_MODELS = {"model_a.nc": 11, "model_b.nc": 12}
"""Files of synthetic ocean models, and the seeds of their errors."""

Announce = Callable[[str], None]
ShowTable = Callable[[Table], None]


@dataclass(frozen=True)
class DemoResult:
    """Outputs of the demo.

    Attributes
    ----------
    observations, truth, store : Path
        The simulated records, their truth, and the archive.
    report : ReportFiles
        Page of the report, its tables and figures.
    mission : MissionResult
        Result of the run.
    """

    observations: Path
    truth: Path
    store: Path
    report: ReportFiles
    mission: MissionResult


@dataclass(frozen=True)
class _DemoRun:
    """Inputs and workers shared by all steps of the demo."""

    out: Path
    platform: Platform
    observations: Path
    store: Path
    executor: Executor
    announce: Announce

    def workers(self) -> AbstractContextManager[Executor]:
        """Return the shared workers for a step; they stay open after it."""
        return nullcontext(self.executor)


def run_demo(out: Path, announce: Announce, show: ShowTable, *, full: bool = False) -> DemoResult:
    """Simulate the demo mission into a folder, invert it, run the studies and write the report.

    `announce` is called with a line at each step, `show` with the tables of the inverted mission. Outputs of an earlier
    demo are replaced.

    Raises
    ------
    InputError
        The folder contains a mission other than the demo's; or zarr cannot read archives in this Python.
    """
    check_assertions()
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    platform, scenario, observations = load_platform(PLATFORM), _scenario(full), out / "mission.nc"
    _check_folder(observations, f"synthetic {scenario.name}, seed {SEED}")
    if not is_compiled():
        announce("compiling the kernels, once for this machine: about half a minute")
    with ExitStack() as opened:
        with compile_in_background("kernels"):
            dives = counted(scenario.profiles, "dive")
            announce(f"simulating {dives} of {PLATFORM} over {_days(scenario):.0f} days, seed {SEED}")
            executor = opened.enter_context(local_executor(default_workers(), warm_simulator))
            simulate_mission(platform, observations, scenario=scenario, seed=SEED, run=executor.run, overwrite=True)
            announce(_describe_light_currents(observations))
        announce("inverting the dives")
        if not is_compiled():
            warm_estimation()
        tour = _DemoRun(out, platform, observations, out / "mission.zarr", executor, announce)
        mission = _invert(tour)
        show(summary_table(mission))
        show(render(accuracy_table(open_for_reading(tour.store), truth_path(observations))))
        _validate(tour)
        _study(tour)
        twins = _twins(tour) if full else None
        announce("drawing the report")
        page = write_mission_page(tour.store, out / "report", twins, executor=executor)
    return DemoResult(observations, truth_path(observations), tour.store, page, mission)


def _scenario(full: bool) -> Scenario:
    """Return the scenario of the demo, complete or with its first dives only."""
    scenario = load_scenario(SCENARIO)
    return scenario if full else scenario.replaced({"profiles": min(scenario.profiles, SHORT_DEMO_DIVES)})


def _days(scenario: Scenario) -> float:
    """Return the duration of the mission, days."""
    return float(scenario.profiles * 2 * np.mean(scenario.surface.half_interval) / 86_400.0)


def _describe_light_currents(observations: Path) -> str:
    """Describe the currents estimated without a flight model, the first results of the demo."""
    estimates = currents(observations)
    north, east = (np.asarray(estimates[f"dac_{name}"]) for name in ("north", "east"))
    error = float(np.nanmedian([estimates["dac_north_std"], estimates["dac_east_std"]]))
    vectors = ", ".join(f"{n:+.2f} {e:+.2f}" for n, e in zip(north, east, strict=True))
    return (
        f"depth-averaged currents from pitch, heading, depth and fixes alone, by gliderhpc currents, "
        f"m/s north and east (each ± {error:.2f}): {vectors}"
    )


def _check_folder(observations: Path, mission: str) -> None:
    """Check that a folder contains no other mission; users may also name theirs ``mission.nc``."""
    if not observations.exists():
        if is_archive(observations.with_suffix(".zarr")):
            raise InputError(f"{observations.with_suffix('.zarr')}: was not made by the demo; give another --out")
        return
    try:
        with xr.open_dataset(observations, decode_times=False) as dataset:
            name = dataset.attrs.get("mission")
    except (OSError, ValueError):
        name = None
    if name != mission:
        raise InputError(f"{observations}: was not made by the demo, so it is not replaced; give another --out")


def _invert(tour: _DemoRun) -> MissionResult:
    with open_observations(tour.observations) as opened:
        prepared = prepare_mission(opened, tour.platform, MissionSettings())
        return run_mission(prepared, tour.store, tour.workers, existing=Existing.OVERWRITE)


def _validate(tour: _DemoRun) -> None:
    tour.announce("comparing the fixed-coefficient model with the records")
    with open_observations(tour.observations) as opened:
        simulation = Simulation(opened, tour.platform, MissionSettings())
        analyze_archive(VALIDATION, Request(tour.store, tour.workers, simulation=simulation))


def _study(tour: _DemoRun) -> None:
    """Run every study on the mission and on synthetic ocean models; studies with ensembles run at their quick sizes.

    The report reads the findings from the archive, so no files are written here.
    """
    truth = truth_path(tour.observations)
    models = tuple(str(write_ocean_model(truth, tour.out / name, seed)) for name, seed in _MODELS.items())
    for name in STUDIES:
        quick = name in QUICK
        tour.announce(f"study {name}{', at its quick size' if quick else ''}")
        request = Request(tour.store, tour.workers, quick=quick, truth=truth, models=models)
        analyze_archive(name, request)


def _twins(tour: _DemoRun) -> Path:
    """Run the twin experiment on windows, which is independent of the mission, at its quick size."""
    tour.announce("twin experiment on windows, at its quick size")
    folder = tour.out / "twins"
    plan = WINDOWS.plan([tour.platform], quick=True)
    write_findings(WINDOWS.run(plan, tour.executor, lambda: None), WINDOWS.name, folder)
    return folder
