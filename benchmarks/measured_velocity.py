"""Missions of an unknown hull with a measured velocity relative to the water, and the same missions without it.

Usage: ``python -m benchmarks.measured_velocity --work DIR [--kinds calm,paper] [--seeds 1:4] [--reuse]``

The missions are those of `benchmarks.hull_commands`, with a Doppler profiler on board. `calibrate`, `run-mission` and
`currents` are run on the whole records and on records without the velocity. Writes ``docs/measured-velocity.md``; DIR
holds missions, hulls, archives and scores.
"""

import argparse
import json
import multiprocessing
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import gliderhpc as gh
from benchmarks.hull_commands import (
    HULL,
    NORMAL,
    TITLES,
    MissionScore,
    believed_hull,
    coverage_rows,
    flown_hull,
    run_commands,
    scenario_of,
    score_mission,
)
from gliderhpc.calibration.settings import USUAL_ROUNDS
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.steady_glide import drag_and_lift
from gliderhpc.observations.format import VELOCITY, VELOCITY_STD
from gliderhpc.observations.truth import truth_path
from gliderhpc.platform import Platform, platform_yaml
from gliderhpc.simulator import simulate_mission

KINDS = ("calm", "drawn", "impulses", "paper")
WAYS = ("without", "measured")
DEVIATION, OFFSET = 0.02, 0.002
"""Standard deviation of a sample, and of the sensor's constant error in each component, m/s."""
DEPTH, ROUNDS = 120.0, USUAL_ROUNDS
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "measured-velocity.md"
_STREAM = 79

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VelocityScore(MissionScore):
    """One mission by one way.

    Attributes
    ----------
    drag, lift : float
        Relative errors of drag and lift at the mission's median angle of attack.
    light_rmse, light_deviation : float
        Error of a component of the current by `gliderhpc currents`, and its median stated deviation, m/s.
    """

    drag: float
    lift: float
    light_rmse: float
    light_deviation: float


def fly(kind: str, seed: int, dives: int, folder: Path) -> Path:
    """Simulate a mission with a Doppler profiler; write the same records without it beside it; return the records."""
    records = folder / "measured.nc"
    if not records.exists():
        folder.mkdir(parents=True, exist_ok=True)
        scenario = scenario_of(kind, gh.load_platform(HULL), dives, DEPTH)
        offset = OFFSET * np.random.default_rng([seed, _STREAM]).standard_normal(3)
        sensors = {"velocity_deviation": DEVIATION, "velocity_offset": offset.tolist()}
        scenario = scenario.replaced({"sensors": {**scenario.sensors.model_dump(), **sensors}})
        simulate_mission(flown_hull(scenario), records, scenario=scenario, seed=seed)
    without = folder / "without.nc"
    if not without.exists():
        with xr.open_dataset(records) as content:
            content.drop_vars([*VELOCITY, *VELOCITY_STD]).to_netcdf(without)
        truth_path(without).hardlink_to(truth_path(records))
    return records


def forces_off(found: Platform, true: Platform, records: Path) -> tuple[float, float]:
    """Relative errors of drag and lift at the median angle of attack of the dives."""
    with xr.open_dataset(truth_path(records)) as truth:
        diving = truth["pitch"].values < 0.0
        attack = float(np.median(np.arctan2(truth["w"].values[diving], truth["u"].values[diving])))
    (drag, lift), (true_drag, true_lift) = drag_and_lift(found, attack), drag_and_lift(true, attack)
    return float(drag / true_drag - 1.0), float(lift / true_lift - 1.0)


def light_errors(records: Path) -> tuple[float, float]:
    """Error and median stated deviation of a component of the current by `gliderhpc currents`, m/s."""
    found = gh.currents(records)
    with xr.open_dataset(truth_path(records)) as truth:
        errors = [found[f"dac_{way}"].values - truth[f"current_{way}"].values for way in ("north", "east")]
    stated = [found[f"dac_{way}_std"].values for way in ("north", "east")]
    return float(np.sqrt(np.nanmean(np.square(errors)))), float(np.nanmedian(stated))


def scored(job: tuple[str, int, int, Path, bool]) -> list[VelocityScore]:
    """Scores of one mission, without and with the velocity; from its file where it has one and may be used again."""
    kind, seed, dives, work, reuse = job
    folder = work / f"{kind}-{seed}"
    stored = folder / "scores.json"
    if not (reuse and stored.exists()):
        fly(kind, seed, dives, folder)
        scores = [asdict(_scored_way(kind, seed, dives, folder, way)) for way in WAYS]
        stored.write_text(json.dumps(scores, indent=1), "utf-8")
    scores = [VelocityScore(**each) for each in json.loads(stored.read_text("utf-8"))]
    sizes = ", ".join(f"{score.current_rmse['adopted']:.4f}" for score in scores)
    print(
        f"{kind} {seed}: current {sizes} m/s; drag "
        f"{scores[0].drag:+.3f}, {scores[1].drag:+.3f}; lift {scores[0].lift:+.3f}, {scores[1].lift:+.3f}", flush=True,
    )  # fmt: skip
    return scores


def _scored_way(kind: str, seed: int, dives: int, folder: Path, way: str) -> VelocityScore:
    records, hull, out = folder / f"{way}.nc", folder / "believed.yaml", folder / way
    true = flown_hull(scenario_of(kind, gh.load_platform(HULL), dives, DEPTH))
    hull.write_text(platform_yaml(believed_hull(true, seed)), "utf-8")
    out.mkdir(exist_ok=True)
    began = time.monotonic()
    found, tree = run_commands(records, hull, out, ROUNDS, workers=0)
    seconds = time.monotonic() - began
    drag, lift = forces_off(found.platform, true, records)
    light = light_errors(records)
    return VelocityScore(
        kind, seed, parameters={}, seconds=seconds, drag=drag, lift=lift, light_rmse=light[0],
        light_deviation=light[1], **score_mission(tree, records),  # type: ignore[arg-type]
    )  # fmt: skip


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def summary_row(kind: str, way: str, scores: list[VelocityScore]) -> list[str]:
    """Currents, speeds, drag and lift of the missions of a kind by one way."""
    distances = np.concatenate([score.distances for score in scores])
    return [
        TITLES[kind], way, f"{_rms([score.current_rmse['adopted'] for score in scores]):.4f}",
        f"{np.median([score.current_deviation for score in scores]):.4f}",
        f"{np.mean(distances <= 1.0):.2f} / {np.mean(distances <= 4.0):.2f}",
        f"{_rms([score.drag for score in scores]):.3f}", f"{_rms([score.lift for score in scores]):.3f}",
        f"{_rms([score.light_rmse for score in scores]):.4f}",
        f"{np.median([score.light_deviation for score in scores]):.4f}",
    ]  # fmt: skip


def page(found: dict[str, list[list[VelocityScore]]], dives: int, seeds: str) -> str:
    """Page of the missions by kind."""
    names = ["missions", "velocity", "current RMSE, m/s", "stated, m/s", "in the 39 / 86 % ellipses", "drag off, RMS",
             "lift off, RMS", "`currents` RMSE, m/s", "stated, m/s"]  # fmt: skip
    summary = [
        summary_row(kind, way, [mission[i] for mission in missions])
        for kind, missions in found.items()
        for i, way in enumerate(WAYS)
    ]
    levels = " / ".join(f"{100 * level:.0f}" for level in NORMAL)
    heads = ["quantity", *(head for way in WAYS for head in (f"{way}: in {levels} %", "RMSE"))]
    tables = [
        f"### {TITLES[kind]}\n\n"
        + markdown(heads, coverage_rows({way: [mission[i] for mission in missions] for i, way in enumerate(WAYS)}))
        for kind, missions in found.items()
    ]
    return TEMPLATE.read_text("utf-8").format(
        dives=dives, depth=DEPTH, seeds=seeds.replace(":", " to "), deviation=DEVIATION, offset=OFFSET,
        summary=markdown(names, summary), tables="\n\n".join(tables),
    )  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1:4", help="first and last seed of each kind")
    parser.add_argument("--dives", type=int, default=8)
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--reuse", action="store_true", help="skip missions that already have a score")
    parser.add_argument("--work", type=Path, required=True)
    given = parser.parse_args(arguments)
    first, last = map(int, given.seeds.split(":"))
    kinds, seeds = given.kinds.split(","), range(first, last + 1)
    jobs = [(kind, seed, given.dives, given.work, given.reuse) for kind in kinds for seed in seeds]
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        scores = pool.map(scored, jobs, chunksize=1)
    found = {kind: scores[i * len(seeds) : (i + 1) * len(seeds)] for i, kind in enumerate(kinds)}
    PAGE.write_text(page(found, given.dives, given.seeds), "utf-8")


if __name__ == "__main__":
    main()
