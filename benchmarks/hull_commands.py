"""Missions of an unknown hull with the documented commands: coverage of the stated intervals.

Usage: ``python -m benchmarks.hull_commands --work DIR [--kinds impulses,calm] [--seeds 1:2] [--rounds 0,8] [--reuse]``

A mission of petrel-l is simulated. The platform file that the estimator is given is off in everything of the catalogue,
the records' offsets included, by plausible deviations drawn from a standard normal distribution. `calibrate`, with so
many rounds over the dives, and `run-mission` follow. Missions of the other shipped hulls follow with the default rounds.
Writes ``docs/unknown-hull.md``; DIR holds missions, hulls, archives and scores, and with ``--reuse`` missions that have
a score are not flown again.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import gliderhpc as gh
from gliderhpc import Glider
from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.profile import SMOOTHED, read_profile_data, truth_on_samples
from gliderhpc.calibration.estimated_hulls import CalibratedHull
from gliderhpc.calibration.settings import USUAL_ROUNDS
from gliderhpc.estimation.priors import default_prior
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, hull_parameters, moved_platform, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import Platform, platform_yaml
from gliderhpc.simulator import Scenario, simulate_mission
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.twins.cases import drawn_from
from gliderhpc.vocabulary import CHANNELS

HULL, DEPTH, WORKERS = "petrel-l", 200.0, 2
TITLES = {
    "impulses": "Slow forces and yaw impulses, which the prior does not describe",
    "drawn": "Disturbances drawn from the prior",
    "calm": "Calm water",
    "fouling": "A hull that fouls",
    "paper": "Shear and lateral gusts",
    "demo": "Shear, gusts, yaw impulses, and a hull that fouls",
}
OTHER_HULLS = ("slocum", "seaglider", "seaexplorer", "seawing")
OTHER_KINDS = ("impulses", "paper", "waves")
"""Kinds of the missions of the other hulls; the last is `WAVES`."""
WAVES = {
    "current": {"speed": (0.05, 0.30), "surface_rms": 0.10, "mode_rms": 0.05, "mode_depth": 500.0},
    "gusts": {"kind": "gaussian", "rms": 0.01},
    "vertical": {"rms": 0.01},
}
"""Additions of the kind to the scenario ``stratified``: vertical motion of the water, shear and weak gusts."""
WAYS = {0: "steady glides", USUAL_ROUNDS: "rounds over the dives"}
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "unknown-hull.md"
VELOCITY = ("u", "v", "w")
QUANTITIES = (*CHANNELS, *VELOCITY)
UNSPREAD = {"depth_spread": 0.0, "coefficients": {"spread": 0.0}}
"""All dives are of one depth, and the hull that flies is the platform file's, whose numbers are the truth."""
NORMAL = {0.68: 1.0, 0.95: 1.96}
"""Half width of an interval, in standard deviations, by the share that it should contain."""
ELLIPSES = {0.39: 1.0, 0.86: 4.0}
"""Squared radius of an ellipse of two components by the share that it should contain."""
OTHER_CURRENTS = {"adjoint": "dac_{way}", "glide angle": "dac_{way}_glide_angle"}
"""Columns of the archive's currents other than the adopted one, by their name in the tables."""
CURRENTS = ("adopted", *OTHER_CURRENTS)
_STREAM = 78

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MissionScore:
    """One mission: errors and deviations of every quantity over all its dives' steady records, and of the currents.

    Attributes
    ----------
    kind, seed : str, int
        The mission.
    inside : dict
        Share of the truth in the 68 and 95 % intervals, by quantity.
    rmse : dict
        Root mean square error by quantity, N, N m and m/s.
    distances : list of float
        Squared distance of every dive's adopted current from the truth, by its covariance.
    current_rmse : dict
        Root mean square error of a component of the current, m/s, by its name in `CURRENTS`.
    current_deviation : float
        Median of the stated deviation of a component of the adopted current, m/s.
    parameters : dict
        Error of every parameter over its stated deviation.
    failed : int
        Profiles that failed.
    seconds : float
        Wall time of the two commands.
    """

    kind: str
    seed: int
    inside: dict[str, list[float]]
    rmse: dict[str, float]
    distances: list[float]
    current_rmse: dict[str, float]
    current_deviation: float
    parameters: dict[str, float]
    failed: int
    seconds: float


def scenario_of(kind: str, hull: Platform, dives: int, depth: float = DEPTH) -> Scenario:
    """Scenario of a kind of disturbances; `depth` in m."""
    if kind == "drawn":
        # Net masses with which a heave force drawn from the prior hardly ever holds the glider down.
        drawn = {
            "disturbances": drawn_from(default_prior(hull)).model_dump(),
            "actuation": {"dive_net_mass": 0.6, "climb_net_mass": -0.6},
        }
        return Scenario().replaced({"name": "drawn from the prior", "profiles": dives, "depth": depth, **drawn})
    if kind == "waves":
        return load_scenario("stratified").replaced({"profiles": dives, "depth": depth, **UNSPREAD, **WAVES})
    return load_scenario(kind).replaced({"profiles": dives, "depth": depth, **UNSPREAD})


def flown_hull(scenario: Scenario, name: str = HULL) -> Platform:
    """Return the hull that flies, with the truth of its errors: the actuators follow their commands with a lag."""
    return with_values(gh.load_platform(name), {ACTUATOR_LAG: scenario.actuation.lag})


def believed_hull(true: Platform, seed: int) -> Platform:
    """Hull off by its plausible deviations; one that cannot glide is drawn again."""
    rng, parameters = np.random.default_rng([seed, _STREAM]), hull_parameters(true)
    while True:
        hull = moved_platform(true, parameters, rng.standard_normal(len(parameters)))
        if glides_stably(Glider(hull)):
            return hull


def run_commands(
    records: Path, hull: Path, folder: Path, rounds: int | None, workers: int = WORKERS
) -> tuple[CalibratedHull, xr.DataTree]:
    """Calibrate, by default with the rounds that the hull's sensors suggest, and invert the mission with the result."""
    store, calibrated = folder / "mission.zarr", folder / "calibrated.yaml"
    found = gh.calibrate(records, hull, workers=workers, rounds={} if rounds is None else {"most": rounds})
    found.save(calibrated, overwrite=True)
    return found, gh.run_mission(records, calibrated, store, workers=workers, overwrite=store.exists())


@dataclass(frozen=True)
class DiveErrors:
    """Errors of one dive and their stated deviations.

    Attributes
    ----------
    smoothed, deviation : (m, 9)
        Errors of the quantities of the smoother at the steady records, and their stated deviations.
    currents : dict of (2,)
        Errors of the depth-averaged currents to the north and to the east, m/s, by their name in `CURRENTS`.
    covariance : (2, 2)
        Stated covariance of the adopted current.
    """

    smoothed: Array
    deviation: Array
    currents: dict[str, Array]
    covariance: Array

    @property
    def current(self) -> Array:
        """Error of the adopted current to the north and to the east, m/s."""
        return self.currents["adopted"]


def done_profiles(tree: xr.DataTree) -> list[int]:
    """Return the numbers of the profiles that were inverted."""
    return [int(number) for number in tree["profile"].values[(tree["status"] == "done").values]]


def dive_errors(tree: xr.DataTree, records: Path, number: int) -> DiveErrors:
    """Compare a dive of an archive with its truth."""
    data = read_profile_data(tree, number, SMOOTHED)
    truth = read_profile_truth(truth_path(records), number)
    smoothed = tree["smoothed"].ds.sel(profile=number).load()
    at = np.searchsorted(data.time, data.record_time)
    rows = np.flatnonzero(data.steady_records & (at < len(data.time)))
    disturbances = truth_on_samples(data, truth)[at[rows]]
    instants = (truth["time"].values - data.epoch) / np.timedelta64(1, "s")
    velocity = np.column_stack([np.interp(data.record_time[rows], instants, truth[name].values) for name in VELOCITY])
    true_values = np.hstack([disturbances, velocity])
    known = np.isfinite(smoothed["u"].values)
    found = np.column_stack([smoothed[name].values[known][rows] for name in QUANTITIES])
    stated = np.column_stack([smoothed[f"{name}_std"].values[known][rows] for name in QUANTITIES])
    whole = np.isfinite(np.hstack([true_values, found, stated])).all(axis=1)
    currents, covariance = current_errors(tree.ds.sel(profile=number), truth)
    return DiveErrors((found - true_values)[whole], stated[whole], currents, covariance)


def current_errors(row: xr.Dataset, truth: xr.Dataset) -> tuple[dict[str, Array], Array]:
    """Errors of the currents of a dive by their name in `CURRENTS`, m/s, and the covariance of the adopted one."""
    adopted = adopted_current(row)
    true = np.array([float(truth[f"current_{way}"]) for way in ("north", "east")])
    errors = {"adopted": np.array([float(adopted.north), float(adopted.east)]) - true}
    for name, column in OTHER_CURRENTS.items():
        errors[name] = np.array([float(row[column.format(way=way)]) for way in ("north", "east")]) - true
    covariance = np.diag([float(adopted.north_std) ** 2, float(adopted.east_std) ** 2])
    covariance[0, 1] = covariance[1, 0] = float(adopted.covariance)
    return errors, covariance


def distance(dive: DiveErrors) -> float:
    """Return the squared distance of a dive's current from the truth, by its covariance."""
    return float(dive.current @ np.linalg.solve(dive.covariance, dive.current))


def score_mission(tree: xr.DataTree, records: Path) -> dict[str, object]:
    """Compare an archive with its truth."""
    dives = [dive_errors(tree, records, number) for number in done_profiles(tree)]
    error, deviation = np.vstack([dive.smoothed for dive in dives]), np.vstack([dive.deviation for dive in dives])
    covariance = np.array([dive.covariance for dive in dives])
    shares = {level: np.mean(np.abs(error) <= width * deviation, axis=0) for level, width in NORMAL.items()}
    return {
        "inside": {name: [float(shares[level][i]) for level in NORMAL] for i, name in enumerate(QUANTITIES)},
        "rmse": dict(zip(QUANTITIES, np.sqrt(np.mean(error**2, axis=0)).tolist(), strict=True)),
        "distances": [distance(dive) for dive in dives],
        "current_rmse": {
            name: float(np.sqrt(np.nanmean([dive.currents[name] ** 2 for dive in dives]))) for name in CURRENTS
        },
        "current_deviation": float(np.median(np.sqrt(np.trace(covariance, axis1=1, axis2=2) / 2.0))),
        "failed": len(tree["profile"]) - len(dives),
    }


def parameter_errors(hull: Platform, true: Platform) -> dict[str, float]:
    """Errors of a calibrated hull's parameters over their stated deviations."""
    errors = (hull.uncertainty and hull.uncertainty.covariance) or hull.calibration
    if errors is None:
        return {}
    known = {parameter.key: parameter for parameter in hull_parameters(true)}
    return {
        key: (known[key].value(hull) - known[key].value(true)) / deviation
        for key, deviation in zip(errors.parameters, errors.deviation, strict=True)
        if key in known and deviation > 0.0
    }


def fly_mission(kind: str, seed: int, dives: int, folder: Path, rounds: int | None, name: str = HULL) -> MissionScore:
    """Simulate one mission of a shipped hull, run the commands, and score what came of it."""
    scenario = scenario_of(kind, gh.load_platform(name), dives)
    true = flown_hull(scenario, name)
    folder.mkdir(parents=True, exist_ok=True)
    records, hull = folder / "mission.nc", folder / "believed.yaml"
    if not records.exists():
        simulate_mission(true, records, scenario=scenario, seed=seed)
    hull.write_text(platform_yaml(believed_hull(true, seed)), "utf-8")
    began = time.monotonic()
    _, tree = run_commands(records, hull, folder, rounds)
    seconds = time.monotonic() - began
    errors = parameter_errors(gh.load_platform(folder / "calibrated.yaml"), true)
    return MissionScore(kind, seed, parameters=errors, seconds=seconds, **score_mission(tree, records))  # type: ignore[arg-type]


def scored_mission(
    kind: str, seed: int, dives: int, folder: Path, rounds: int | None, name: str = HULL, *, reuse: bool
) -> MissionScore:
    """Score of a mission, from its file where it has one and may be used again."""
    stored = folder / "score.json"
    if not (reuse and stored.exists()):
        score = fly_mission(kind, seed, dives, folder, rounds, name)
        stored.write_text(json.dumps(asdict(score), indent=1), "utf-8")
    score = MissionScore(**json.loads(stored.read_text("utf-8")))
    way = "default" if rounds is None else str(rounds)
    print(
        f"{name}, {way} rounds, {kind} {seed}: {score.seconds:.0f} s, {score.failed} failed, "
        f"current {score.current_rmse['adopted']:.4f} m/s, stated {score.current_deviation:.4f}", flush=True,
    )  # fmt: skip
    return score


def coverage_rows(ways: Mapping[str, Sequence[MissionScore]]) -> list[list[str]]:
    """Share of the truth in the 68 and 95 % intervals and RMSE, a row a quantity, for every way."""
    rows = []
    for name in QUANTITIES:
        cells = [name]
        for scores in ways.values():
            shares = np.mean([score.inside[name] for score in scores], axis=0)
            size = np.sqrt(np.mean([score.rmse[name] ** 2 for score in scores]))
            cells += [f"{shares[0]:.2f} / {shares[1]:.2f}", f"{size:.3g}"]
        rows.append(cells)
    return rows


def summary_row(heads: tuple[str, str], scores: list[MissionScore]) -> list[str]:
    """Currents, parameters and times of some missions, after two heads."""
    distances = np.concatenate([score.distances for score in scores])
    off = np.concatenate([list(score.parameters.values()) for score in scores])
    return [
        *heads,
        *(f"{np.sqrt(np.mean([score.current_rmse[name] ** 2 for score in scores])):.4f}" for name in CURRENTS),
        f"{np.median([score.current_deviation for score in scores]):.4f}",
        " / ".join(f"{np.mean(distances <= limit):.2f}" for limit in ELLIPSES.values()),
        f"{np.mean(np.abs(off) <= NORMAL[0.68]):.2f} / {np.mean(np.abs(off) <= NORMAL[0.95]):.2f}",
        str(sum(score.failed for score in scores)), f"{np.median([score.seconds for score in scores]):.0f}",
    ]  # fmt: skip


SUMMARY = (*(f"{name} current RMSE, m/s" for name in CURRENTS), "stated, m/s", "in the 39 / 86 % ellipses", "parameters in 68 / 95 %",
           "profiles failed", "s per mission")  # fmt: skip
"""Heads of `summary_row`, after the first two."""


def other_hulls_tables(found: dict[str, dict[str, list[MissionScore]]]) -> tuple[str, str]:
    """Tables of the missions of the other hulls: currents and parameters, and shares in the intervals with RMSE."""
    rows = [(name, kind, scores) for name, kinds in found.items() for kind, scores in kinds.items()]
    summary = markdown(
        ["hull", "missions", *SUMMARY], [summary_row((name, kind), scores) for name, kind, scores in rows]
    )
    shown = ("B_cu", "B_cw", "B_cr", "u", "w")
    cells = [[name, kind] for name, kind, _ in rows]
    for row, (_, _, scores) in zip(cells, rows, strict=True):
        of_each = {quantity: rest for quantity, *rest in coverage_rows({"": scores})}
        row += [f"{shares}, {size}" for shares, size in (of_each[quantity] for quantity in shown)]
    return summary, markdown(["hull", "missions", *shown], cells)


def page(
    found: dict[str, dict[str, list[MissionScore]]],
    others: dict[str, dict[str, list[MissionScore]]],
    dives: int,
    seeds: str,
) -> str:
    """Page of the missions of petrel-l by kind and way, and of those of the other hulls by hull and kind."""
    ways = list(next(iter(found.values())))
    heads = ["quantity", *(head for way in ways for head in (f"{way}: in 68 / 95 %", "RMSE"))]
    tables = [f"### {TITLES[kind]}\n\n{markdown(heads, coverage_rows(by_way))}" for kind, by_way in found.items()]
    summary = [summary_row((kind, way), scores) for kind, by_way in found.items() for way, scores in by_way.items()]
    names = ["missions", "calibration", *SUMMARY]
    other_summary, other_coverage = other_hulls_tables(others)
    return TEMPLATE.read_text("utf-8").format(
        dives=dives, depth=DEPTH, seeds=seeds.replace(":", " to "), workers=WORKERS, summary=markdown(names, summary),
        count=len(hull_parameters(gh.load_platform(HULL))), tables="\n\n".join(tables), other_summary=other_summary,
        other_coverage=other_coverage,
    )  # fmt: skip


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1:2", help="first and last seed of each kind")
    parser.add_argument("--dives", type=int, default=16)
    parser.add_argument("--kinds", default=",".join(TITLES), help=f"of {', '.join(TITLES)}")
    parser.add_argument(
        "--rounds", default=f"0,{USUAL_ROUNDS}", help="numbers of rounds over the dives, one column each"
    )
    parser.add_argument("--reuse", action="store_true", help="skip missions that already have a score")
    parser.add_argument("--work", type=Path, required=True)
    given = parser.parse_args(arguments)
    first, last = map(int, given.seeds.split(":"))
    seeds = range(first, last + 1)
    found = {
        kind: {
            WAYS.get(rounds, f"{rounds} rounds"): [
                scored_mission(
                    kind, seed, given.dives, given.work / f"rounds-{rounds}" / f"{kind}-{seed}", rounds,
                    reuse=given.reuse,
                )
                for seed in seeds
            ]
            for rounds in map(int, given.rounds.split(","))
        }
        for kind in given.kinds.split(",")
    }  # fmt: skip
    others = {
        name: {
            kind: [
                scored_mission(
                    kind, seed, given.dives, given.work / name / f"{kind}-{seed}", None, name, reuse=given.reuse
                )
                for seed in seeds
            ]
            for kind in OTHER_KINDS
        }
        for name in OTHER_HULLS
    }
    PAGE.write_text(page(found, others, given.dives, given.seeds), "utf-8")


if __name__ == "__main__":
    main()
