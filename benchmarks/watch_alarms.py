"""Alerts on changes of the hull, on synthetic missions without change and with a sudden growth of drag.

Prints the table of ``docs/how-to/watch.md``. Usage: ``python -m benchmarks.watch_alarms --work DIR [--missions 5]``.

The missions are those of the scenario `calm`. The estimator gets a hull off by its plausible deviations, calibrates it
on the first dives and inverts the mission with the result. The messages are then made from the archive, dive by dive:
each depends on its dive and those before it alone. Missions that have a file in DIR are not flown again.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import gliderhpc as gh
from benchmarks.hull_commands import HULL, UNSPREAD, WORKERS, believed_hull, flown_hull
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.findings.formatting import markdown
from gliderhpc.platform import platform_yaml
from gliderhpc.simulator import Scenario, simulate_mission
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.watch.alerts import Rules

DEPTH, DIVES, CALIBRATED = 150.0, 60, "1:8"
ONSET, GROWTH = 21, 0.2
"""First dive with more drag, and its relative growth."""

FIRST_SEED = 27_600
RULES = Rules(hull_changed=0.95, drag_up_fifth=0.95)
NEVER, GROWN = "none", f"drag {GROWTH:+.0%} at dive {ONSET}"


@dataclass(frozen=True)
class Mission:
    """Numbers of the dives inverted, and the alerts of each dive with any."""

    dives: list[int]
    alerts: dict[str, list[str]]

    def quiet(self, before: int | None) -> list[int]:
        """Numbers of the dives inverted, up to a dive."""
        return [number for number in self.dives if before is None or number < before]

    def alarms(self, before: int | None) -> int:
        """Number of dives with an alert that had none on the dive before, up to a dive."""
        alerted = [number for number in self.quiet(before) if str(number) in self.alerts]
        return sum(number - 1 not in alerted for number in alerted)

    @property
    def announced(self) -> int | None:
        """First dive at or after the onset whose alerts include the drag."""
        alerted = (n for n in self.dives if n >= ONSET and "drag" in " ".join(self.alerts.get(str(n), [])))
        return next(alerted, None)


def scenario_of(kind: str) -> Scenario:
    """Scenario of the missions, without or with the growth of drag."""
    grown = {"episode": {"first": ONSET, "last": DIVES, "dive_drag": GROWTH, "climb_drag": GROWTH}}
    changes = grown if kind == GROWN else {}
    return load_scenario("calm").replaced({"profiles": DIVES, "depth": DEPTH, **UNSPREAD, **changes})


def fly(kind: str, seed: int, folder: Path) -> Mission:
    """Simulate a mission, invert it with a hull that is off, and collect the alerts of its dives."""
    name = f"{'grown' if kind == GROWN else 'calm'}-{seed}"
    stored = folder / f"{name}.json"
    if stored.exists():
        return Mission(**json.loads(stored.read_text("utf-8")))
    scenario = scenario_of(kind)
    hull = flown_hull(scenario)
    records, archive, platform = (folder / f"{name}{suffix}" for suffix in (".nc", ".zarr", ".yaml"))
    simulate_mission(hull, records, scenario=scenario, seed=seed)
    platform.write_text(platform_yaml(believed_hull(hull, seed)), "utf-8")
    calibrated = gh.calibrate(records, platform, profiles=CALIBRATED, workers=WORKERS).platform
    gh.run_mission(records, calibrated, archive, workers=WORKERS)
    with open_for_reading(archive) as opened:
        numbers = done_profiles(opened)
        alerts = {str(number): list(RULES.violations(surfacing_message(opened, number))) for number in numbers}
    found = Mission(numbers, {number: each for number, each in alerts.items() if each})
    stored.write_text(json.dumps(asdict(found), indent=1), "utf-8")
    return found


def table(missions: dict[str, Sequence[Mission]]) -> str:
    """Table of the missions by kind."""
    rows = []
    for kind, found in missions.items():
        before = ONSET if kind == GROWN else None
        quiet = sum(len(each.quiet(before)) for each in found)
        alarms = sum(each.alarms(before) for each in found)
        after = [each.announced for each in found]
        announced = ", ".join("never" if n is None else str(n - ONSET + 1) for n in after) if kind == GROWN else "–"
        rows.append([kind, str(len(found)), str(quiet), str(alarms), announced])
    return markdown(["change", "missions", "dives without one", "false alarms", "announced with dive"], rows)


def main(arguments: list[str] | None = None) -> None:
    """Fly the missions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=5, help="number of missions of each kind")
    parser.add_argument("--work", type=Path, required=True)
    given = parser.parse_args(arguments)
    given.work.mkdir(parents=True, exist_ok=True)
    found: dict[str, Sequence[Mission]] = {}
    for kind in (NEVER, GROWN):
        seeds = range(FIRST_SEED, FIRST_SEED + given.missions)
        found[kind] = [fly(kind, seed, given.work) for seed in seeds]
    print(f"{HULL}, seeds from {FIRST_SEED}, {DIVES} dives to {DEPTH:.0f} m each\n")
    print(table(found))


if __name__ == "__main__":
    main()
