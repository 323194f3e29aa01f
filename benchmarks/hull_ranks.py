"""Simulation-based calibration of the intervals on missions of an unknown hull (Talts et al. 2018, arXiv:1804.06788).

Usage: ``python -m benchmarks.hull_ranks --work DIR [--kinds drawn,impulses] [--missions 300,30] [--dives 8]``

The estimator gets a platform file that is off in everything of the catalogue, the records' offsets included, by draws
from its plausible deviations, and the disturbances are drawn from its prior. The documented commands follow. If the
stated intervals are right, the probability that the stated distribution gives to values below the truth is distributed
uniformly over the missions, for every quantity. One value of each quantity a mission is used, from a dive and a record
chosen at random, because values of one mission have the errors of the hull in common. Missions in other disturbances
can be added. Writes ``docs/interval-ranks.md``; missions that have a file in DIR are not flown again.
"""

import argparse
import json
import multiprocessing
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import gliderhpc as gh
from benchmarks.hull_commands import (
    ELLIPSES,
    HULL,
    QUANTITIES,
    TITLES,
    believed_hull,
    distance,
    dive_errors,
    done_profiles,
    flown_hull,
    parameter_errors,
    run_commands,
    scenario_of,
)
from gliderhpc.calibration.estimated_hulls import HullFromDives
from gliderhpc.calibration.settings import USUAL_ROUNDS
from gliderhpc.errors import GliderhpcError
from gliderhpc.findings.formatting import markdown
from gliderhpc.platform import platform_yaml
from gliderhpc.simulator import simulate_mission

DEPTH = 120.0
CURRENT, DISTANCE = ("current north", "current east"), "current, distance by its ellipse"
BANDS, BAND_LEVEL, GRID = 4000, 0.95, 50
_STREAM, _BAND_SEED = 79, 80
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "interval-ranks.md"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MissionRanks:
    """One mission.

    Attributes
    ----------
    seed : int
        The mission.
    errors : dict
        Error over stated deviation by quantity, at one record of one dive, and of every parameter.
    distance : float
        Squared distance of that dive's current from the truth by its covariance; not finite without one.
    refused : bool
        Whether the hull of the rounds was refused, so that the hull is that of the steady glides.
    failed : int
        Profiles that failed.
    failure : str
        Why the mission has no values; empty if it has.
    dives, version : int, str
        Dives of the mission, and version of the package.
    """

    seed: int
    errors: dict[str, float]
    distance: float = float("nan")
    refused: bool = False
    failed: int = 0
    failure: str = ""
    dives: int = 0
    version: str = ""


def fly_mission(kind: str, seed: int, dives: int, folder: Path) -> MissionRanks:
    """Simulate one mission, run the commands, and compare one record with its truth."""
    scenario = scenario_of(kind, gh.load_platform(HULL), dives, DEPTH)
    true = flown_hull(scenario)
    records, hull = folder / "mission.nc", folder / "believed.yaml"
    rng = np.random.default_rng([seed, _STREAM])
    try:
        simulate_mission(true, records, scenario=scenario, seed=seed)
        hull.write_text(platform_yaml(believed_hull(true, seed)), "utf-8")
        found, tree = run_commands(records, hull, folder, USUAL_ROUNDS, workers=0)
    except GliderhpcError as error:
        return MissionRanks(seed, {}, failure=str(error))
    refused = not isinstance(found, HullFromDives)
    errors, done = parameter_errors(found.platform, true), done_profiles(tree)
    if not done:
        return MissionRanks(seed, errors, refused=refused, failed=dives, failure="no profile was inverted")
    dive = dive_errors(tree, records, int(rng.choice(done)))
    if len(dive.smoothed):
        k = int(rng.integers(len(dive.smoothed)))
        errors |= dict(zip(QUANTITIES, (dive.smoothed[k] / dive.deviation[k]).tolist(), strict=True))
    if not np.isfinite(dive.covariance).all() or np.linalg.det(dive.covariance) <= 0.0:
        return MissionRanks(seed, errors, refused=refused, failed=dives - len(done))
    errors |= dict(zip(CURRENT, (dive.current / np.sqrt(np.diag(dive.covariance))).tolist(), strict=True))
    return MissionRanks(seed, errors, distance(dive), refused, dives - len(done))


def stored_mission(kind: str, dives: int, work: Path, seed: int) -> MissionRanks:
    """Return a mission's values, from its file if it has one; only this file is kept.

    Raises
    ------
    SystemExit
        The file is of other missions, or of another version.
    """
    folder, stored = work / f"{kind}-{seed}", work / f"{kind}-{seed}.json"
    if not stored.exists():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        found = replace(fly_mission(kind, seed, dives, folder), dives=dives, version=gh.__version__)
        aside = stored.with_suffix(".new")
        aside.write_text(json.dumps(asdict(found)), "utf-8")
        aside.replace(stored)
        shutil.rmtree(folder)
    mission = MissionRanks(**json.loads(stored.read_text("utf-8")))
    if (mission.dives, mission.version) != (dives, gh.__version__):
        raise SystemExit(f"{stored} is of {mission.dives} dives and version {mission.version}; give another --work")
    return mission


def least_tail(ranks: Array) -> float:
    """Return the smallest two-sided probability of the empirical distribution on a grid, if ranks are uniform."""
    grid = np.arange(1, GRID) / GRID
    below = np.searchsorted(np.sort(ranks), grid, side="right")
    low, high = stats.binom.cdf(below, len(ranks), grid), stats.binom.sf(below - 1, len(ranks), grid)
    return float(np.min(2.0 * np.minimum(low, high)))


def band_of(number: int) -> float:
    """Return the pointwise probability of the simultaneous band for so many ranks (Säilynoja et al. 2022)."""
    rng = np.random.default_rng([number, _BAND_SEED])
    return float(np.quantile([least_tail(rng.random(number)) for _ in range(BANDS)], 1.0 - BAND_LEVEL))


def row_of(name: str, errors: Array, ranks: Array, band: float) -> list[str]:
    """Row of a quantity: its ranks' mean, shares in the intervals, and whether they lie in the simultaneous band."""
    inside = " / ".join(f"{np.mean(np.abs(ranks - 0.5) <= 0.5 * level):.2f}" for level in (0.68, 0.95))
    size = f"{np.sqrt(np.mean(errors**2)):.2f}"
    return [name, str(len(ranks)), f"{np.mean(ranks):.2f}", size, inside, _answer(ranks, band)]


def _answer(ranks: Array, band: float) -> str:
    return "yes" if least_tail(ranks) >= band else "no"


def rank_rows(missions: Sequence[MissionRanks], names: Sequence[str]) -> list[list[str]]:
    """Rows of the quantities, or of the parameters, of missions of one kind."""
    rows, bands = [], dict[int, float]()
    for name in names:
        if name == DISTANCE:
            found = np.array([mission.distance for mission in missions])
        else:
            found = np.array([mission.errors.get(name, np.nan) for mission in missions])
        found = found[np.isfinite(found)]
        if not len(found):
            continue
        if len(found) not in bands:
            bands[len(found)] = band_of(len(found))
        band = bands[len(found)]
        if name == DISTANCE:
            ranks = stats.chi2.cdf(found, 2)
            rows.append([name, str(len(ranks)), f"{np.mean(ranks):.2f}", "-", "-", _answer(ranks, band)])
        else:
            rows.append(row_of(name, found, stats.norm.sf(found), band))
    return rows


def ellipses(missions: Sequence[MissionRanks]) -> str:
    """Shares of the currents in the ellipses of 39 and 86 %."""
    squares = np.array([mission.distance for mission in missions if np.isfinite(mission.distance)])
    return " / ".join(f"{np.mean(squares <= limit):.2f}" for limit in ELLIPSES.values()) if len(squares) else "none"


def kind_text(kind: str, missions: Sequence[MissionRanks]) -> str:
    """Section of the missions of a kind."""
    parameters = sorted({name for mission in missions for name in mission.errors} - {*QUANTITIES, *CURRENT})
    heads = ["quantity", "missions", "mean rank", "error over deviation, RMS", "in 68 / 95 %", "in the band"]
    lost = [mission for mission in missions if mission.failure]
    summary = (
        f"{len(missions)} missions: {len(lost)} without values, {sum(m.refused for m in missions)} with the hull of the "
        f"steady glides, {sum(m.failed for m in missions)} profiles failed. Currents in the ellipses of 39 and 86 %: "
        f"{ellipses(missions)}."
    )
    # A reason that names the file is given without it.
    reasons = sorted({mission.failure.rpartition("mission.nc: ")[2] for mission in lost})
    parts = [
        f"## {TITLES[kind]}", summary, "\n".join(f"- {reason}" for reason in reasons),
        markdown(heads, rank_rows(missions, (*QUANTITIES, *CURRENT, DISTANCE))),
    ]  # fmt: skip
    if parameters:
        parts.append(markdown(["parameter", *heads[1:]], rank_rows(missions, parameters)))
    return "\n\n".join(part for part in parts if part)


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", default="drawn", help=f"of {', '.join(TITLES)}")
    parser.add_argument("--missions", default="300", help="number of missions of each kind")
    parser.add_argument("--dives", type=int, default=8)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--work", type=Path, required=True)
    given = parser.parse_args(arguments)
    given.work.mkdir(parents=True, exist_ok=True)
    texts = []
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        for kind, number in zip(given.kinds.split(","), map(int, given.missions.split(",")), strict=True):
            fly = partial(stored_mission, kind, given.dives, given.work)
            found = []
            for mission in pool.imap(fly, range(1, number + 1)):
                found.append(mission)
                print(f"{kind} {mission.seed}: distance {mission.distance:.2f} {mission.failure}", flush=True)
            texts.append(kind_text(kind, found))
    PAGE.write_text(
        TEMPLATE.read_text("utf-8").format(dives=given.dives, depth=DEPTH, tables="\n\n".join(texts)),
        "utf-8",
    )


if __name__ == "__main__":
    main()
