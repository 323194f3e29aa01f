"""Drift study: accuracy on known truth, real missions, and cost; writes the measured parts of ``docs/drift.md``.

Usage: ``python -m benchmarks.drift FOLDER PART ...`` with the parts

- ``rates``: false trends of the plain and of the robust test in series that do not drift;
- ``changes``: false steps, ramps and episodes in missions that do not change, and those found where they are planted,
  in medians that are drawn (``--series``);
- ``episodes``: the same in synthetic missions, calm, fouling or with an episode (``--calm``, ``--others``);
- ``twins``: synthetic missions that foul, whose pitch or heading is off, or whose buoyancy drifts (``--missions``);
- ``draws``: the time of the Monte-Carlo of coefficients at the paper's size, and what the segments matter;
- ``real``: finished archives, ``--real NAME ARCHIVE [--basestation FOLDER]``.

Missions lie in FOLDER and are not made again where they are there, so that a run that was broken off goes on.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from benchmarks.drift_series import HULL, SERIES, changes_text, rates_text
from benchmarks.sections import with_section
from gliderhpc import load_platform
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.findings.results import write_json
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import Existing, run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.report.studies.drift_tables import table_5, table_5_text
from gliderhpc.simulator import load_scenario, simulate_mission
from gliderhpc.studies.drift import STUDY, MissionDrift, drift_of_rows
from gliderhpc.studies.library.drift.change_text import phases_text
from gliderhpc.studies.library.drift.coefficients import CoefficientSlopes
from gliderhpc.studies.library.drift.drag import CAUSES
from gliderhpc.studies.library.drift.medians import DRAG, PRIMARY, CoefficientSettings, DriftSettings
from gliderhpc.studies.library.drift.verdict import verdict_lines
from gliderhpc.studies.library.trends import SIGNIFICANCE
from gliderhpc.studies.request import Request

PAGE = Path(__file__).resolve().parents[1] / "docs" / "drift.md"
PROFILES, DEPTH = 33, 60.0
"""Of a twin mission: eleven epochs of three dives, as many profiles as in the paper, and shallow ones."""

TWIN_SETTINGS = DriftSettings(resamples=500, coefficients=CoefficientSettings(draws=0))
COMPARED_DRAWS = 20
SEGMENTS = ((120.0, 60.0, 1), (240.0, 120.0, 1), (240.0, 120.0, 2), (360.0, 120.0, 1))
"""Length (s), part not counted (s) and number of segments that are compared with each other."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Twin:
    """A kind of synthetic mission: its planted changes, and the cause that the study should name.

    Attributes
    ----------
    name : str
        Of its files.
    planted : str
        In words.
    fouling, sensors, episode : dict
        Changes to the scenario `fouling`.
    """

    name: str
    planted: str
    fouling: dict[str, float]
    sensors: dict[str, float]
    episode: dict[str, float] = field(default_factory=dict)


CLEAN = {"drag": 0.0, "lift": 0.0, "moment": 0.0, "net_mass": 0.0}
FOULED = Twin("fouling", "fouling: drag +30 %, lift -10 %, moment +10 %, on climbs 0.4 of these, 20 g", {}, {})
OTHERS = (
    Twin("clean", "nothing", CLEAN, {}),
    Twin("pitch", "constant pitch offset of 1 degree", CLEAN, {"pitch_offset": 1.0}),
    Twin("heading", "constant heading offset of 10 degree", CLEAN, {"heading_offset": 10.0}),
    Twin("buoyancy", "loss of buoyancy, 40 g over the mission", {**CLEAN, "net_mass": 0.04}, {}),
    Twin("drag", "drag +30 % on dive and climb alike", {**CLEAN, "drag": 0.3, "climb_share": 1.0}, {}),
)
CALM = OTHERS[0]
EPISODES = (
    Twin("climbs", "profiles 12 to 21, climbs, drag +75 % that decays to a third", CLEAN, {},
         {"first": 12, "last": 21, "climb_drag": 0.75, "remaining": 0.33}),
    Twin("dives", "profiles 15 to 18, dives, drag +30 %", CLEAN, {}, {"first": 15, "last": 18, "dive_drag": 0.3}),
    Twin("both", "profiles 20 to 24, dives and climbs, drag +20 %", CLEAN, {},
         {"first": 20, "last": 24, "dive_drag": 0.2, "climb_drag": 0.2}),
    Twin("short", "profiles 15 to 17, climbs, drag +30 %", CLEAN, {}, {"first": 15, "last": 17, "climb_drag": 0.3}),
)  # fmt: skip


def twin_archive(folder: Path, twin: Twin, seed: int) -> Path:
    """Simulate and run a mission, unless it exists."""
    observations, store = (folder / f"{twin.name}-{seed}{suffix}" for suffix in (".nc", ".zarr"))
    done = folder / f"{twin.name}-{seed}.done"
    if done.exists():
        return store
    hull, base = load_platform(HULL), load_scenario("fouling")
    scenario = base.replaced({
        "profiles": PROFILES, "depth": DEPTH,
        "fouling": {**base.fouling.model_dump(), "profiles": PROFILES, **twin.fouling},
        "sensors": {**base.sensors.model_dump(), **twin.sensors},
        "episode": twin.episode or base.episode.model_dump(),
    })  # fmt: skip
    simulate_mission(hull, observations, scenario=scenario, seed=seed)
    with open_observations(observations) as opened:
        prepared = prepare_mission(opened, hull, MissionSettings())
        run_mission(prepared, store, lambda: local_executor(0), existing=Existing.OVERWRITE)
    done.touch()
    return store


def planted_drag(twin: Twin) -> float:
    """Change of K_D0 from the first to the last profile that dive and climb share, kg/m."""
    fouling = load_scenario("fouling").fouling.model_copy(update=dict(twin.fouling))
    share = 0.5 * (1.0 + fouling.climb_share) * fouling.drag
    return share * load_platform(HULL).viscous.K_D0 * (PROFILES - 1) / PROFILES


def studied(store: Path, settings: DriftSettings, workers: int = 0) -> MissionDrift:
    """Study an archive without writing anything."""
    plan = STUDY.plan(Request(store, lambda: local_executor(workers)), settings)
    return drift_of_rows(plan, STUDY.study_profiles(plan)[0])


def twin_row(folder: Path, twin: Twin, seed: int) -> dict[str, Any]:
    """Study a mission, unless its row is in the folder; the values needed for the page."""
    path = folder / f"{twin.name}-{seed}.json"
    if not path.exists():
        write_json(path, _row_of(studied(twin_archive(folder, twin, seed), TWIN_SETTINGS)))
    row: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return row


def _row_of(one: MissionDrift) -> dict[str, Any]:
    verdict = one.found.verdict
    shown = {own.estimate: len(own.drifting) for own in one.found.trends}
    estimates = {
        drag.estimate: {
            "change": drag.change,
            "interval": drag.change_interval,
            "scatter": (drag.shared.trend.low * drag.shared.span, drag.shared.trend.high * drag.shared.span),
            "weight": drag.phase_difference.drift,
            "shown": shown[drag.estimate],
        }
        for drag in verdict.drags
    }
    both = {"change": verdict.change, "interval": verdict.interval}
    changes = [
        {"kind": one.kind, "first": one.first, "last": one.last, "phases": phases_text(one),
         "size": max((one.size(DRAG, phase).value for phase in one.phases), key=abs) / verdict.drags[0].reference}
        for one in verdict.changes.found
    ]  # fmt: skip
    return {"cause": verdict.cause, "both": both, "changes": changes, **estimates}


def episodes_text(folder: Path, calm: int, others: int) -> str:
    """Lay out which change points are named in synthetic missions that are calm, foul or hold an episode."""
    kinds = {CALM: calm, FOULED: others, OTHERS[-1]: others, **dict.fromkeys(EPISODES, others)}
    rows = []
    for twin, missions in kinds.items():
        found = [twin_row(folder, twin, seed) for seed in range(1, missions + 1)]
        named = [_changes_cell(row["changes"]) for row in found]
        causes = [row["cause"] for row in found]
        rows.append([
            twin.planted, str(missions), "; ".join(f"{text} ({named.count(text)})" for text in dict.fromkeys(named)),
            ", ".join(f"{name} {causes.count(name)}" for name in dict.fromkeys(causes)),
        ])  # fmt: skip
    columns = ["planted", "missions", "named (missions)", "cause outside episodes"]
    return (
        f"Synthetic missions of {PROFILES} dives to {DEPTH:g} m through the whole pipeline; size: the largest change.\n\n"
        + markdown(columns, rows, columns[1:2])
    )


def _changes_cell(changes: Sequence[dict[str, Any]]) -> str:
    return ", ".join(
        f"{one['kind']} {one['first']} to {one['last']}, {one['phases']}, {one['size']:+.0%}" for one in changes
    ) or "nothing"  # fmt: skip


def twins_text(folder: Path, missions: int, others: int) -> str:
    """Format the study's results on missions whose drift is known."""
    fouled = [twin_row(folder, FOULED, seed) for seed in range(1, missions + 1)]
    kinds = {twin: [twin_row(folder, twin, seed) for seed in range(1, others + 1)] for twin in OTHERS}
    return "\n\n".join([_recovered(fouled), _causes({FOULED: fouled, **kinds})])


def _recovered(rows: Sequence[dict[str, Any]]) -> str:
    truth = planted_drag(FOULED)
    columns = [
        "estimate",
        "sign",
        "in the 95 % interval",
        "mean",
        "root mean square error",
        "in the interval by scatter alone",
    ]
    cells = [_recovered_by(name, [row[name] for row in rows], truth) for name in (*PRIMARY, "both")]
    return (
        f"{len(rows)} missions of {PROFILES} dives to {DEPTH:g} m ({FOULED.planted}), {TWIN_SETTINGS.resamples} "
        f"bootstrap series, coefficients not drawn. Planted change of K_D0 common to dive and climb: {number(truth)} "
        f"kg/m ({truth / load_platform(HULL).viscous.K_D0:.1%}).\n\n" + markdown(columns, cells, columns[1:])
    )


def _recovered_by(name: str, found: Sequence[dict[str, Any]], truth: float) -> list[str]:
    changes = np.array([one["change"] for one in found])
    scatter = f"{_inside(found, 'scatter', truth):.0%}" if "scatter" in found[0] else "–"
    return [
        name, f"{np.mean(changes > 0.0):.0%}", f"{_inside(found, 'interval', truth):.0%}", number(float(changes.mean())),
        number(float(np.sqrt(np.mean((changes - truth) ** 2)))), scatter,
    ]  # fmt: skip


def _inside(found: Sequence[dict[str, Any]], name: str, truth: float) -> float:
    return float(np.mean([one[name][0] <= truth <= one[name][1] for one in found]))


def _causes(kinds: dict[Twin, list[dict[str, Any]]]) -> str:
    columns = [
        "planted",
        "missions",
        "cause named",
        "series that drift, adjoint",
        "smoothed",
        "weight, N",
        "K_D0, kg/m",
    ]
    return (
        "Causes that the study names, with the number of missions; series out of twelve after Holm's correction; "
        "means of weight in water and K_D0 over missions and estimates. "
        + "; ".join(f"*{name}*: {text}" for name, text in CAUSES.items())
        + ".\n\n" + markdown(columns, [_kind(twin, rows) for twin, rows in kinds.items()], columns[3:])
    )  # fmt: skip


def _kind(twin: Twin, rows: Sequence[dict[str, Any]]) -> list[str]:
    causes = [row["cause"] for row in rows]
    named = ", ".join(f"{name} {causes.count(name)}" for name in dict.fromkeys(causes))
    shown = [f"{np.mean([row[name]['shown'] for row in rows]):.1f}" for name in PRIMARY]
    weight = float(np.mean([row[name]["weight"] for row in rows for name in PRIMARY]))
    change = float(np.mean([row["both"]["change"] for row in rows]))
    return [twin.planted, str(len(rows)), named, *shown, number(weight), number(change)]


def draws_text(folder: Path, workers: int) -> str:
    """Time the study at the paper's size, and compare segments with each other."""
    store = twin_archive(folder, FOULED, 1)
    began = time.perf_counter()
    whole = studied(store, DriftSettings(), workers)
    minutes = (time.perf_counter() - began) / 60.0
    rows = [_segments_row("as set, 300 draws", whole)]
    for length, settling, count in SEGMENTS:
        drawn = CoefficientSettings(draws=COMPARED_DRAWS, length=length, settling=settling, segments=count)
        label = f"{count} of {length:g} s, {settling:g} s not counted, {COMPARED_DRAWS} draws"
        rows.append(_segments_row(label, studied(store, DriftSettings(coefficients=drawn), workers)))
    columns = ["segments per profile and phase", "inverted", *(f"{c} {p}" for c, p in _SHOWN)]
    settings = DriftSettings().coefficients
    with_workers = f"{workers} worker{'' if workers == 1 else 's'}"
    return (
        f"{PROFILES} profiles, {settings.draws} draws, {with_workers}: {minutes:.1f} minutes for the whole study "
        "(a mission with fouling, see above). Slopes per day by the segments with the 95 % interval over draws, and "
        "the share of draws with the same sign:\n\n" + markdown(columns, rows, columns[1:])
    )


_SHOWN = (("B_cu", "dive"), ("B_cu", "climb"), ("B_cq", "climb"), ("K_D0", "dive"), ("K_D0", "climb"))


def _segments_row(label: str, one: MissionDrift) -> list[str]:
    slopes = {(slope.quantity, slope.phase): slope for slope in one.found.slopes}
    return [label, str(one.segments), *(_slope_cell(slopes[key]) for key in _SHOWN)]


def _slope_cell(one: CoefficientSlopes) -> str:
    low, high = one.interval
    known = np.isfinite(one.nominal)
    return (
        f"{number(one.nominal)} ({number(low)} to {number(high)}; {one.same_sign:.0%})"
        if known
        else "no segment of this length"
    )


def real_text(name: str, store: Path, settings: DriftSettings, workers: int, basestation: Path | None) -> str:
    """Format the verdict on a finished mission, and the drag from its files."""
    one = studied(store, settings, workers)
    primary = [own for own in one.found.trends if own.estimate in PRIMARY]
    lines = [*([one.mission.band.remark] if one.mission.band.remark else [])]
    lines += verdict_lines(one.found.verdict, primary, settings.drag_increase)
    table = table_5_text([row for row in table_5(primary) if row["p"] < SIGNIFICANCE])
    days = one.mission.days.values()
    parts = [
        f"### {name}\n\n{len(one.mission.numbers)} profiles in {len(one.mission.epochs)} epochs, day {min(days):.1f} to "
        f"{max(days):.1f}, {one.mission.hull.name}; {settings.coefficients.draws} draws of the coefficients.",
        "\n".join(f"- {line}" for line in lines),
        table.strip(),
    ]
    if basestation is not None:
        parts.append(_basestation(basestation, one.mission.numbers))
    return "\n\n".join(parts)


def _basestation(folder: Path, numbers: Sequence[int]) -> str:
    """Drag and volume parameters that a Seaglider's own files were made with, over the dives."""
    rows = []
    for label, key in (("sg_cal_hd_b", "drag, Pa^(-1/4) by the basestation's flight model"), ("sg_cal_vbdbias", "cm3")):
        values = dict(_scalars(folder, label))
        own = [values[number] for number in numbers if number in values]
        if own:
            rows.append([label, key, str(len(own)), *map(number, (own[0], own[-1], min(own), max(own)))])
    columns = ["in the files", "what", "dives", "first", "last", "smallest", "largest"]
    return "The files' own parameters, a soft reference:\n\n" + markdown(columns, rows, columns[2:])


def _scalars(folder: Path, name: str) -> Iterator[tuple[int, float]]:
    for path in sorted(folder.glob("*.nc")):
        with netCDF4.Dataset(path) as file:
            if name in file.variables and hasattr(file, "dive_number"):
                yield int(file.dive_number), float(np.ma.getdata(file.variables[name][...]))


def write_part(name: str, text: str, page: Path = PAGE) -> None:
    """Write a measured part of the page."""
    page.write_text(with_section(page.read_text("utf-8"), name, text), "utf-8")


def parts_of(options: argparse.Namespace) -> Iterable[tuple[str, Callable[[], str]]]:
    """Every part with its function, in the order of the page."""
    drawn = DriftSettings(coefficients=CoefficientSettings(draws=options.draws))
    known: dict[str, Callable[[], str]] = {
        "rates": rates_text,
        "changes": lambda: changes_text(options.series),
        "episodes": lambda: episodes_text(options.folder, options.calm, options.others),
        "twins": lambda: twins_text(options.folder, options.missions, options.others),
        "draws": lambda: draws_text(options.folder, options.workers),
        "real": lambda: "\n\n".join(
            real_text(name, Path(store), drawn, options.workers, base) for name, store, base in options.real
        ),
    }
    return [(name, known[name]) for name in options.parts]


def main() -> None:
    """Make the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("parts", nargs="+", choices=["rates", "changes", "episodes", "twins", "draws", "real"])
    parser.add_argument("--missions", type=int, default=40)
    parser.add_argument("--others", type=int, default=2)
    parser.add_argument("--series", type=int, default=SERIES, help="drawn missions without a change, per cell")
    parser.add_argument("--calm", type=int, default=20, help="synthetic missions without a change")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--draws", type=int, default=300, help="draws of the coefficients, for --real")
    parser.add_argument("--real", nargs=2, action="append", default=[], metavar=("NAME", "ARCHIVE"))
    parser.add_argument("--basestation", type=Path, help="folder of the basestation files of the last --real")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    last = len(options.real) - 1
    options.real = [(*pair, options.basestation if k == last else None) for k, pair in enumerate(options.real)]
    for name, make in parts_of(options):
        write_part(name, make())


if __name__ == "__main__":
    main()
