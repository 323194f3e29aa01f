"""Ellipses of the light path's currents, on simulated missions with errors of hull, compass, pitch and fixes.

Usage: ``python -m benchmarks.light_ellipses --work DIR [--missions 100] [--dives 2] [--seed 6000]``

Missions of petrel-l are simulated with the flight model, in shear and gusts or in calm water. Drag over lift, pitch,
compass and fixes are off as `gliderhpc.estimation.glide_currents.GlideErrors` and the make's deviation state.
`gliderhpc currents` reads the records. Writes ``docs/light-ellipses.md``.
"""

import argparse
import json
import math
import multiprocessing
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import gliderhpc as gh
from gliderhpc import Glider
from gliderhpc.errors import InputError
from gliderhpc.estimation.glide_currents import GlideErrors
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.glide_polar import MAKE_DEVIATION, with_drag
from gliderhpc.observations.truth import truth_path
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, simulate_mission
from gliderhpc.simulator.plan import plan_flight
from gliderhpc.simulator.scenario import load_scenario

HULL, DEPTH = "petrel-l", 250.0
KINDS = {"paper": "shear and lateral gusts", "calm": "calm water"}
ELLIPSES = {0.39: 1.0, 0.86: 4.0}
"""Squared radius of an ellipse of two components by the share that it should contain."""
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "light-ellipses.md"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MissionEllipses:
    """Currents of one mission.

    Attributes
    ----------
    kind, seed : str, int
        The mission.
    drag : float
        Factor on the drag of the hull that flew.
    distances : list of float
        Squared distance of every dive's current from the truth, by its covariance.
    errors, stated : list of float
        Errors of the components, and their stated deviations, m/s.
    """

    kind: str
    seed: int
    drag: float
    distances: list[float]
    errors: list[float]
    stated: list[float]


def drawn_hull(scenario: Scenario, rng: np.random.Generator) -> tuple[Platform, float]:
    """Draw a hull with more or less drag; one that cannot fly the scenario is drawn again."""
    while True:
        factor = math.exp(MAKE_DEVIATION * rng.standard_normal())
        hull = with_drag(gh.load_platform(HULL), factor)
        try:
            plan_flight(Glider(hull), scenario)
        except InputError:
            continue
        return hull, factor


def fly(job: tuple[str, int, int, Path]) -> MissionEllipses:
    """Simulate one mission and estimate its currents without a flight model."""
    kind, seed, dives, work = job
    stored, records = work / f"{kind}-{seed}.json", work / f"{kind}-{seed}.nc"
    if not stored.exists():
        stored.write_text(json.dumps(asdict(_flown(kind, seed, dives, records)), indent=1), "utf-8")
    return MissionEllipses(**json.loads(stored.read_text("utf-8")))


def _flown(kind: str, seed: int, dives: int, records: Path) -> MissionEllipses:
    rng, stated = np.random.default_rng([seed, 7]), GlideErrors()
    scenario = load_scenario(kind).replaced({
        "profiles": dives, "depth": DEPTH, "depth_spread": 0.0, "coefficients": {"spread": 0.0},
    })  # fmt: skip
    hull, drag = drawn_hull(scenario, rng)
    sensors = {
        "pitch_offset": math.degrees(stated.pitch_offset) * rng.standard_normal(),
        "heading_offset": stated.course * rng.standard_normal(),
        "fix_deviation": stated.fix,
    }
    scenario = scenario.replaced({"sensors": {**scenario.sensors.model_dump(), **sensors}})
    simulate_mission(hull, records, scenario=scenario, seed=seed, overwrite=True)
    found = gh.currents(records)
    with xr.open_dataset(truth_path(records)) as truth:
        error = np.column_stack([found[f"dac_{way}"] - truth[f"current_{way}"].values for way in ("north", "east")])
    north, east = found["dac_north_std"].values, found["dac_east_std"].values
    covariance = np.empty((len(error), 2, 2))
    covariance[:, 0, 0], covariance[:, 1, 1] = north**2, east**2
    covariance[:, 0, 1] = covariance[:, 1, 0] = found["dac_covariance"].values
    distances = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
    for path in (records, truth_path(records)):
        path.unlink()
    return MissionEllipses(
        kind, seed, drag, distances.tolist(), error.ravel().tolist(), np.column_stack([north, east]).ravel().tolist()
    )


def row(kind: str, missions: list[MissionEllipses]) -> list[str]:
    """Shares within the ellipses with binomial errors, each mission counted once, and errors."""
    shares = []
    for share, limit in ELLIPSES.items():
        inside = float(np.mean([np.mean(np.array(mission.distances) <= limit) for mission in missions]))
        shares.append(f"{inside:.2f} ± {math.sqrt(share * (1.0 - share) / len(missions)):.2f}")
    errors = np.concatenate([mission.errors for mission in missions])
    stated = np.concatenate([mission.stated for mission in missions])
    dives = sum(len(mission.distances) for mission in missions)
    return [
        KINDS[kind], f"{dives} of {len(missions)}", *shares, f"{np.sqrt(np.mean(errors**2)):.4f}",
        f"{np.median(stated):.4f}",
    ]  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--missions", type=int, default=100)
    parser.add_argument("--dives", type=int, default=2)
    parser.add_argument("--seed", type=int, default=6000)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args(arguments)
    given.work.mkdir(parents=True, exist_ok=True)
    jobs = [(kind, given.seed + i, given.dives, given.work) for kind in KINDS for i in range(given.missions)]
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        found = pool.map(fly, jobs, chunksize=1)
    rows = [row(kind, [mission for mission in found if mission.kind == kind]) for kind in KINDS]
    heads = ["missions", "dives of missions", "within 1 sigma (39 %)", "within 2 sigma (86 %)",
             "error of a component, RMS, m/s", "stated, median, m/s"]  # fmt: skip
    errors = GlideErrors()
    PAGE.write_text(TEMPLATE.read_text("utf-8").format(
        table=markdown(heads, rows), hull=HULL, depth=DEPTH, dives=given.dives, drag=round(100 * MAKE_DEVIATION),
        pitch=math.degrees(errors.pitch_offset), course=errors.course, fix=errors.fix, first=given.seed,
        last=given.seed + given.missions - 1,
    ), "utf-8")  # fmt: skip


if __name__ == "__main__":
    main()
