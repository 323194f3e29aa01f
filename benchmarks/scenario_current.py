"""Recovery of the current in a scenario with sheared water; writes ``docs/scenario-current.md``.

Usage: ``python -m benchmarks.scenario_current [SCENARIO [PROFILES]]``; default the first 20 profiles of ``paper``. The
current acts through the relative velocity, so the estimator's model contains none of it.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.command_line import positional
from gliderhpc import load_platform, open_mission
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import DisturbancePrior
from gliderhpc.simulator import load_scenario, simulate_mission

PLATFORM = "petrel-l"
SEED = 0
PRIORS: dict[str, DisturbancePrior | None] = {
    "shipped, calm first and then gusts": None,
    "fast lateral channels": DisturbancePrior(
        deviation=(0.4, 1.0, 0.4, 0.3, 0.15, 1.0), correlation_time=(3600.0, 10.0, 3600.0, 10.0, 3600.0, 60.0)
    ),
}
"""Disturbance priors that are compared: the hull's own, and one that lets sway and roll follow gusts within seconds."""


def errors(store: Path, truth: Path) -> np.ndarray:
    """Length of the difference between estimated and true depth-averaged current, m/s, a profile."""
    table = open_mission(store).ds.load()
    found = []
    for number in table.profile.to_numpy():
        row, true = table.sel(profile=number), read_profile_truth(truth, int(number))
        found.append(np.hypot(row.dac_north - true.current_north, row.dac_east - true.current_east).item())
    return np.array(found)


def main(scenario: str, profiles: int) -> None:
    """Simulate, invert with each prior, and write the page."""
    lines = [
        "# Depth-averaged current in sheared water",
        "",
        "How does the disturbance prior affect the depth-averaged current in strong shear and gusts? The page compares the shipped",
        "priors, of which the second is tried in gusts, with one for gusts alone.",
        "",
        f"Made by `python -m benchmarks.scenario_current {scenario} {profiles}`: {PLATFORM}, seed {SEED}, the first {profiles} profiles of",
        f"scenario `{scenario}`. The values are the length of the difference from the true mean current over the dive, m/s.",
        "",
        "| prior | median | 90th percentile | largest | profiles done |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.nc"
        world = load_scenario(scenario).replaced({"profiles": profiles})
        with local_executor(default_workers()) as executor:
            simulate_mission(load_platform(PLATFORM), path, scenario=world, seed=SEED, run=executor.run)
        for name, prior in PRIORS.items():
            store = Path(folder) / f"{name}.zarr"
            with open_observations(path) as observations:
                platform = load_platform(PLATFORM).model_copy(update={"prior": prior})
                prepared = prepare_mission(observations, platform, MissionSettings())
                run_mission(prepared, store, lambda: local_executor(default_workers()))
            size = errors(store, truth_path(path))
            known = size[np.isfinite(size)]
            cells = (
                [f"{value:.4f}" for value in (np.median(known), np.quantile(known, 0.9), known.max())]
                if known.size
                else ["-"] * 3
            )
            lines.append(f"| {name} | {' | '.join(cells)} | {known.size} of {size.size} |")
        for name, prior in PRIORS.items():
            text = "none in the platform file" if prior is None else f"`prior: {prior.model_dump(mode='json')}`"
            lines += ["", f"{name}: {text}"]
    page = Path(__file__).resolve().parents[1] / "docs" / "scenario-current.md"
    page.write_text("\n".join(lines) + "\n", "utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    given = positional(
        __doc__, scenario={"nargs": "?", "default": "paper"}, profiles={"type": int, "nargs": "?", "default": 20}
    )
    main(given.scenario, given.profiles)
