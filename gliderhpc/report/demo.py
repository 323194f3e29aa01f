"""The tour: a synthetic mission simulated, inverted, held against its truth and drawn."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gliderhpc.flight.loading import load_platform
from gliderhpc.mission.batch_job import ProfileResult
from gliderhpc.mission.executors import default_workers, local_executor
from gliderhpc.mission.run import MissionResult, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.synthetic import Scenario, simulate_mission, truth_path
from gliderhpc.report.profile_figure import write_profile_figures

PLATFORM = "petrel-l"
SEED = 1


@dataclass(frozen=True)
class DemoResult:
    """What the tour left behind.

    Attributes
    ----------
    observations, truth, store : Path
        The simulated records, what was true, and the archive.
    figures : tuple of Path
        One a profile.
    mission : MissionResult
        What the run did.
    """

    observations: Path
    truth: Path
    store: Path
    figures: tuple[Path, ...]
    mission: MissionResult


def run_demo(out: Path, say: Callable[[str], None], report: Callable[[ProfileResult], None]) -> DemoResult:
    """Simulate the demo mission into a folder, invert it and draw it; `say` is told each step, `report` each profile.

    What an earlier tour left in the folder is replaced.
    """
    out.mkdir(parents=True, exist_ok=True)
    path, store = out / "mission.nc", out / "mission.zarr"
    platform = load_platform(PLATFORM)
    say(f"simulating {Scenario().profiles} profiles of {PLATFORM}, seed {SEED}")
    simulate_mission(platform, path, seed=SEED)
    say("inverting them (the first run compiles the kernels, about a minute)")
    with open_observations(path) as observations:
        workers = min(default_workers(), len(observations.profile_numbers))
        mission = run_mission(
            observations, platform, MissionSettings(), tuple(observations.profile_numbers), store,
            lambda: local_executor(workers), overwrite=True, report=report,
        )  # fmt: skip
    say("drawing")
    figures = write_profile_figures(store, out / "figures", truth_path(path))
    return DemoResult(path, truth_path(path), store, tuple(figures), mission)
