"""Smoother in water that moves vertically, with and without that motion among its unknowns.

Prints the tables of ``docs/smoother.md`` (water that moves vertically). Usage: ``python -m benchmarks.vertical_motion
[--seeds 1:8] [--dives 12]``.

The hull is the platform file's (petrel-l), so that the motion of the water, slow forces or gusts are the only cause of
errors. The first table has single dives to 200 m, the second the drag of missions, from `run-mission` and the study
`hull`.
"""

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gliderhpc as gh
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.profile import smooth_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.simulator.mission import simulate_mission
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.studies.hull import HullSettings, agreeing_terms, combine_terms, read_terms

Array = NDArray[np.float64]

HULL, DEPTH = "petrel-l", 200.0
WAYS: dict[str, float | None] = {"still water": 0.0, "from the record": None}
"""Settings of `smoother.vertical_motion` by their name in the tables."""
DIVES: dict[str, tuple[str, dict[str, Any]]] = {
    "calm": ("calm", {}),
    "waves of 0.5 cm/s": ("calm", {"vertical": {"rms": 0.005}}),
    "waves of 1 cm/s": ("calm", {"vertical": {"rms": 0.01}}),
    "waves of 2 cm/s": ("calm", {"vertical": {"rms": 0.02}}),
    "shear and gusts": ("paper", {}),
    "slow forces and yaw impulses": ("impulses", {}),
}
"""Scenarios and their changes by the name in the first table."""
MISSIONS = ("calm", "waves of 0.5 cm/s", "waves of 1 cm/s", "waves of 2 cm/s", "slow forces and yaw impulses")
"""Dives of the second table."""
VELOCITIES = {"u": 6, "w": 8}
"""Velocities in the first table, and their positions among the states."""
DRAG = "viscous.K_D0"


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors (k, 3) of u and w (m/s) and B_cu (N) in the steady glides of some dives, and their stated deviations."""

    error: Array
    deviation: Array


def settings_of(deviation: float | None) -> EstimationSettings:
    """Return the default settings with a standard deviation of the water's vertical velocity, m/s."""
    return EstimationSettings.model_validate({"smoother": {"vertical_motion": deviation}})


def dive_errors(platform: Platform, name: str, seed: int, deviation: float | None) -> Errors:
    """Compare the smoothed estimate of one simulated dive with the truth."""
    scenario, changes = DIVES[name]
    settings = settings_of(deviation)
    record, truth = simulate_profile(platform, load_scenario(scenario).replaced({"depth": DEPTH, **changes}), seed)
    profile = prepare_profile(Glider(platform), on_steps(record, settings, platform))
    estimate, _ = smooth_profile(profile, run_filter(profile, settings), settings)
    if estimate is None:
        raise RuntimeError(f"{name}, seed {seed}: no estimate")
    rows = np.flatnonzero(_steady(profile))
    rows = rows[rows % settings.steps_per_record == 0]
    at = rows // settings.steps_per_record
    time = profile.series.time[rows]
    instants = truth.step * (np.arange(len(truth.disturbances)) + 0.5)
    true = [np.interp(time, truth.time, truth.states[:, place]) for place in VELOCITIES.values()]
    true.append(np.interp(time, instants, truth.disturbances[:, 0]))
    found = [estimate.states[at, place] for place in VELOCITIES.values()] + [estimate.disturbances[at, 0]]
    stated = [estimate.states_std[at, place] for place in VELOCITIES.values()] + [estimate.disturbances_std[at, 0]]
    return Errors(np.column_stack(found) - np.column_stack(true), np.column_stack(stated))


def _steady(profile: PreparedProfile) -> NDArray[np.bool_]:
    time = profile.series.time
    inside = (time > time[0] + 60.0) & (time < time[-1] - 60.0)
    return np.asarray(~profile.vibrating & inside & (np.arange(len(time)) < len(time) - 1))


def dive_rows(seeds: Sequence[int]) -> Iterator[Mapping[str, str]]:
    """Rows of the first table."""
    platform = gh.load_platform(HULL)
    for name in DIVES:
        row = {"dives": name}
        for way, deviation in WAYS.items():
            every = [dive_errors(platform, name, seed, deviation) for seed in seeds]
            error, stated = (np.vstack([getattr(each, part) for each in every]) for part in ("error", "deviation"))
            for i, quantity in enumerate((*VELOCITIES, "B_cu")):
                share = np.mean(np.abs(error[:, i]) <= stated[:, i])
                row[f"{quantity}, {way}"] = f"{np.sqrt(np.mean(error[:, i] ** 2)):.4f} ({share:.2f})"
        yield row


def mission_row(name: str, seed: int, dives: int, deviation: float | None, folder: Path) -> tuple[float, ...]:
    """Motion (cm/s) and chi-square of the comparison with the depth rates, and drag with its deviation before it."""
    platform = gh.load_platform(HULL)
    scenario, changes = DIVES[name]
    records, store = folder / "mission.nc", folder / "mission.zarr"
    if not records.exists():
        flown = load_scenario(scenario).replaced({"profiles": dives, "depth": DEPTH, "depth_spread": 0.0, **changes})
        flown = flown.replaced({"coefficients": {"spread": 0.0}})
        simulate_mission(platform, records, scenario=flown, seed=seed)
    settings = MissionSettings.model_validate({"smoother": {"vertical_motion": deviation}})
    gh.run_mission(records, platform, store, settings=settings, overwrite=store.exists())
    with open_for_reading(store) as archive:
        mission = read_terms(archive, done_profiles(archive))
        mission, check = agreeing_terms(archive, mission, robust=True)
        found, *_ = combine_terms(mission, HullSettings())
    place = [p.key for p in mission.parameters].index(DRAG)
    drag = mission.parameters[place]
    values = []
    for each in (mission.undivided, found):
        assert each is not None
        mean, std = float(each.overall.mean[place]), float(each.overall.std[place])
        values += [drag.moved(platform, mean), std * abs(drag.slope(platform, mean))]
    motion, chi_square = (np.nan, np.nan) if check is None else (100.0 * check.motion, check.chi_square)
    return motion, chi_square, *values


def mission_rows(dives: int) -> Iterator[Mapping[str, str]]:
    """Rows of the second table."""
    for name in MISSIONS:
        row = {"mission": name}
        with tempfile.TemporaryDirectory() as folder:
            for way, deviation in WAYS.items():
                motion, chi_square, before, before_std, after, after_std = mission_row(
                    name, 1, dives, deviation, Path(folder)
                )
                row["motion, cm/s"] = f"{motion:.2f}"
                row[f"chi-square, {way}"] = f"{chi_square:.1f}"
                row[f"K_D0, {way}"] = f"{before:.2f} ± {before_std:.2f}"
                row[f"K_D0 after the comparison, {way}"] = f"{after:.2f} ± {after_std:.2f}"
        yield row


def print_table(rows: Sequence[Mapping[str, str]]) -> None:
    """Print rows as a table in Markdown."""
    print(markdown(list(rows[0]), [list(row.values()) for row in rows]), end="\n\n", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="1:8", help="first and last seed of the dives")
    parser.add_argument("--dives", type=int, default=12, help="dives of each mission")
    options = parser.parse_args()
    first, last = map(int, options.seeds.split(":"))
    print_table(list(dive_rows(range(first, last + 1))))
    print_table(list(mission_rows(options.dives)))


if __name__ == "__main__":
    main()
