"""Next surfacings predicted on synthetic missions, compared with the true surfacings.

Prints the table of ``docs/how-to/watch.md``. Usage: ``python -m benchmarks.next_surfacing [--missions N]``, or
``--archives A.zarr ...`` for real missions, each surfacing predicted from the dives before it.

The current of a mission is a mean, two Gauss-Markov parts of different correlation times, M2 and K1 tides and an inertial
oscillation that comes and goes, stepped by the minute; half of the missions have no tide. Dives differ in duration, speed and
course, all displacements have one relative error, as a wrong drag makes it, and the drift at the surface differs from the
current. The filter knows the tidal periods, but neither inertial motion nor a second correlation time; it runs with and without
tidal lines. The inversion is left out: the displacement through the water is the true one with that error. In further missions
one dive in four is ordered to another heading, and the prediction is made with and without this order; in others every dive
turns. For real missions the order is replaced by direction and duration of the next dive's displacement through the water.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.distributions import chi_square_quantile
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.records import Fix
from gliderhpc.surfacing.dive_plan import DivePlan
from gliderhpc.surfacing.next_surfacing import MAX_DIVES, PROBABILITY, dives_until, fix_after, is_followed, predict_from
from gliderhpc.vocabulary import TIDAL_PERIODS

Array = NDArray[np.float64]

FIRST_SEED = 27_000
MISSIONS = 120
AFTER = (3, 6, 12, 24, 48)
"""Dives after which the next surfacing is predicted."""

NOWCASTS: dict[str, tuple[str, ...]] = {"with tidal lines": tuple(TIDAL_PERIODS), "without tidal lines": ()}
"""Tidal lines of the nowcasts that are compared."""

PLANNED = "with the plan"
"""Name of the nowcast, with tidal lines, that knows the plan of the next dive."""

ERRORS = CurrentSettings()
"""Errors of the fixes and of the drift at the surface."""

HOUR, STEP = 3600.0, 60.0
START = np.datetime64("2024-01-01T00:00:00", "ns")
PLACE = (45.0, -30.0)
M2, K1, INERTIAL = 12.42 * HOUR, 23.93 * HOUR, 11.967 * HOUR / np.sin(np.radians(PLACE[0]))

MEAN, SLOW, FAST = 0.1, (0.03, 0.12), (0.01, 0.05)
"""Deviations of the current's mean and of its two Gauss-Markov parts, m/s."""
SLOW_TIME, FAST_TIME = (24.0, 120.0), (3.0, 12.0)
"""Their correlation times, h."""
TIDES, WAVES = (0.08, 0.04), 0.06
"""Largest amplitudes of M2, K1 and the inertial oscillation, m/s."""

DIVE, SURFACE = (2.0 * HOUR, 6.0 * HOUR), 900.0
SPEED = (0.2, 0.35)
SCATTER = {"duration": 0.03, "speed": 0.03, "course": 4.0}
"""Standard deviations of what dives differ in: parts, parts, degrees."""
DRAG = 0.03
"""Standard deviation of the relative error of a mission's displacements."""
TURN = 0.25
"""Share of the dives, in missions with turns, that are ordered to a heading 60 to 120 degrees from the last one."""
SEVERAL = (60.0, 150.0, 240.0, 330.0)
"""Courses that missions steer in turn, degrees."""
WIND = 0.05
"""Standard deviation of the drift at the surface about the current, m/s."""


def gauss_markov(rng: np.random.Generator, deviation: float, hours: float, count: int) -> Array:
    """Gauss-Markov series ``(count, 2)``, a value a step."""
    decay = np.exp(-STEP / (hours * HOUR))
    kicks = rng.normal(0.0, deviation * np.sqrt(1.0 - decay**2), (count, 2))
    kicks[0] = rng.normal(0.0, deviation, 2)
    for k in range(1, count):
        kicks[k] += decay * kicks[k - 1]
    return kicks


def current(rng: np.random.Generator, count: int, tidal: bool = True) -> Array:
    """Current of one mission ``(count, 2)``, north and east, m/s; without a tide all else is the same."""
    time = STEP * np.arange(count)
    found = rng.normal(0.0, MEAN, 2) + gauss_markov(rng, rng.uniform(*SLOW), rng.uniform(*SLOW_TIME), count)
    found += gauss_markov(rng, rng.uniform(*FAST), rng.uniform(*FAST_TIME), count)
    for largest, period in zip(TIDES, (M2, K1), strict=True):
        for component in (0, 1):
            phase = 2.0 * np.pi * (time / period + rng.uniform())
            found[:, component] += tidal * rng.uniform(0.0, largest) * np.cos(phase)
    turn = np.exp(-2j * np.pi * (time / INERTIAL + rng.uniform()))
    swelling = rng.uniform(0.0, WAVES) * np.sin(np.pi * (time / (60.0 * HOUR) + rng.uniform()))
    return found + swelling[:, None] * np.column_stack([turn.real, turn.imag])


@dataclass(frozen=True, eq=False)
class Mission:
    """Table of a synthetic mission's dives, as in an archive; `predict_from` takes its first rows."""

    table: xr.Dataset

    def fix(self, place: int) -> Fix:
        """First fix after a dive."""
        return fix_after(self.table, place)


Headings = Callable[[int, int, float], Array]
"""Headings ordered for the dives of a mission (rad), from its seed, the number of dives, and the first heading."""


def straight(_: int, dives: int, first: float) -> Array:
    """One heading for all dives."""
    return np.full(dives, first)


def with_turns(seed: int, dives: int, first: float) -> Array:
    """Turn by 60 to 120 degrees on a share `TURN` of the dives."""
    rng = np.random.default_rng([seed, 1])
    turning = rng.uniform(size=dives) < TURN
    return first + np.cumsum(turning * rng.choice([-1.0, 1.0], dives) * np.radians(rng.uniform(60.0, 120.0, dives)))


def alternating(_: int, dives: int, first: float) -> Array:
    """Steer two courses at a right angle in turn."""
    return first + 0.5 * np.pi * (np.arange(dives) % 2)


def several(_: int, dives: int, first: float) -> Array:
    """Steer the courses `SEVERAL` in turn."""
    return first + np.radians(np.resize(SEVERAL, dives))


def drawn(seed: int, dives: int, _: float) -> Array:
    """Draw every course at random."""
    return np.random.default_rng([seed, 2]).uniform(0.0, 2.0 * np.pi, dives)


EVERY_DIVE = {"two courses in turn": alternating, "four courses in turn": several, "random courses": drawn}
"""Headings of missions that turn at every dive."""


def mission(seed: int, dives: int, tidal: bool = True, *, ordered: Headings = straight) -> Mission:
    """Fly one mission."""
    rng = np.random.default_rng(seed)
    lasts, speed, course = rng.uniform(*DIVE), rng.uniform(*SPEED), rng.uniform(0.0, 2.0 * np.pi)
    flow = current(rng, round(1.3 * dives * (lasts + SURFACE) / STEP), tidal)
    carried = np.vstack([np.zeros(2), STEP * np.cumsum(flow, axis=0)])
    drag, position, now = 1.0 + rng.normal(0.0, DRAG), np.zeros(2), 0

    def fixed() -> Array:
        return position + rng.normal(0.0, ERRORS.fix_error, 2)

    rows = []
    entry = fixed()
    for heading in ordered(seed, dives, course):
        steps = round(lasts * (1.0 + rng.normal(0.0, SCATTER["duration"])) / STEP)
        angle = heading + np.radians(rng.normal(0.0, SCATTER["course"]))
        length = speed * (1.0 + rng.normal(0.0, SCATTER["speed"])) * steps * STEP
        through = length * np.array([np.cos(angle), np.sin(angle)])
        begin, now = now, now + steps
        position = position + through + carried[now] - carried[begin]
        exit_, exit_step = fixed(), now
        now += round(SURFACE / STEP)
        position = position + carried[now] - carried[exit_step] + SURFACE * rng.normal(0.0, WIND, 2)
        last = fixed()
        orders = {"stay": SURFACE if rows else np.nan, "heading": np.degrees(heading)}
        rows.append(_row(begin, exit_step, entry, exit_, last, drag * through) | orders)
        entry = last
    return Mission(_table(rows))


def _row(begin: int, end: int, entry: Array, exit_: Array, last: Array, through: Array) -> dict[str, object]:
    latitude, longitude = moved(PLACE, exit_)
    duration = (end - begin) * STEP
    dac = (exit_ - entry - through) / duration
    return {
        "start_time": _instant(begin), "entry_time": _instant(begin), "exit_time": _instant(end), "duration": duration,
        "exit_latitude": latitude, "exit_longitude": longitude, "exit_surface_time": SURFACE,
        "exit_surface_north": last[0] - exit_[0], "exit_surface_east": last[1] - exit_[1],
        "dac_north_smoothed": dac[0], "dac_east_smoothed": dac[1],
        "dac_north_smoothed_std": 0.01, "dac_east_smoothed_std": 0.01, "dac_smoothed_covariance": 0.0,
        "displacement_north": through[0], "displacement_east": through[1],
    }  # fmt: skip


def _instant(step: int) -> np.datetime64:
    return START + np.timedelta64(round(step * STEP), "s")


def _table(rows: list[dict[str, object]]) -> xr.Dataset:
    columns = {name: ("profile", np.array([row[name] for row in rows])) for name in rows[0]}
    return xr.Dataset(columns, coords={"profile": np.arange(1, len(rows) + 1)})


def plan_of(following: xr.Dataset) -> DivePlan:
    """Return the heading ordered for a dive; for a real one direction and duration of its displacement."""
    if "heading" in following:
        return DivePlan(heading=float(following["heading"]) % 360.0)
    north, east = float(following["displacement_north"]), float(following["displacement_east"])
    return DivePlan(heading=float(np.degrees(np.arctan2(east, north))), duration=float(following["duration"]))


def misses(
    flown: Mission, after: int, errors: CurrentSettings = ERRORS, *, planned: bool = False
) -> tuple[dict[str, float], dict[str, float]]:
    """Miss (m) of the nowcasts, of persistence and of no current; and the squared distance in the nowcasts' ellipses."""
    dives = flown.table.isel(profile=slice(max(after - MAX_DIVES, 0), after))
    here, there, last = flown.fix(after - 1), flown.fix(after), dives.isel(profile=-1)
    way = np.array(local_displacement(here, there))
    ways, distances = {}, {}
    plan = plan_of(flown.table.isel(profile=after)) if planned else None
    cases = [(name, tides, None) for name, tides in NOWCASTS.items()]
    cases += [(PLANNED, tuple(TIDAL_PERIODS), plan)] if planned else []
    for name, tides, given in cases:
        found = predict_from(dives, errors.fix_error, errors.surface_shear, tides, given)
        error = way - np.array(local_displacement(here, Fix(found.time, found.latitude, found.longitude)))
        ways[name], distances[name] = error, float(error @ np.linalg.solve(found.covariance, error))
    own = np.array([float(last["displacement_north"]), float(last["displacement_east"])])
    dac = np.array([float(last["dac_north_smoothed"]), float(last["dac_east_smoothed"])])
    elapsed = (found.time - here.time) / np.timedelta64(1, "s")
    ways |= {"persistence": way - own - dac * elapsed, "no current": way - own}
    return {name: float(np.linalg.norm(miss)) for name, miss in ways.items()}, distances


def archived(path: Path) -> tuple[Mission, CurrentSettings]:
    """Return the dives of an archive that have a current, and the settings of its currents."""
    with open_for_reading(path) as archive:
        last = max(done_profiles(archive), key=archive.to_dataset()["start_time"].load().to_series().get)
        return Mission(dives_until(archive, last, most=None)), CurrentSettings(**archive.attrs["settings"]["current"])


def rows_of_archives(paths: Sequence[Path]) -> Iterator[dict[str, object]]:
    """Rows of the table for real missions: all dives that follow one another within the longest stay at the surface."""
    for path in paths:
        flown, errors = archived(path)
        places = range(flown.table.sizes["profile"] - 1)
        found = [misses(flown, place + 1, errors, planned=True) for place in places if is_followed(flown.table, place)]
        yield {"mission": path.stem, **_summary(found)}


def _summary(found: Sequence[tuple[dict[str, float], dict[str, float]]]) -> dict[str, object]:
    """Columns of the table for predictions."""
    limit = chi_square_quantile(PROBABILITY, 2)
    inside = {key: np.mean([distance[key] <= limit for _, distance in found]) for key in found[0][1]}
    medians = {key: float(np.median([miss[key] for miss, _ in found])) for key in found[0][0]}
    return {
        "predictions": len(found),
        **{f"in the {PROBABILITY:.0%} ellipse, {key}": f"{value:.2f}" for key, value in inside.items()},
        **{f"median miss, {key} (m)": f"{value:.0f}" for key, value in medians.items()},
    }


def rows_of(missions: int) -> Iterator[dict[str, object]]:
    """Rows of the table: one for each number of dives, and all, with and without a tide."""
    seeds = range(FIRST_SEED, FIRST_SEED + missions)
    for tidal in (True, False):
        flown = [mission(seed, AFTER[-1] + 1, tidal) for seed in seeds]
        groups = {str(after): [misses(one, after) for one in flown] for after in AFTER}
        groups["all"] = [found for group in list(groups.values()) for found in group]
        for name, found in groups.items():
            yield {"tide": "M2, K1" if tidal else "none", "dives so far": name, **_summary(found)}


def rows_with_turns(missions: int) -> Iterator[dict[str, object]]:
    """Rows of the table of missions with turns: all dives, and those that turn."""
    flown = [mission(seed, AFTER[-1] + 1, ordered=with_turns) for seed in range(FIRST_SEED, FIRST_SEED + missions)]
    every = [(one, after) for one in flown for after in AFTER]
    turning = [(one, after) for one, after in every if np.ptp(one.table["heading"].values[after - 1 : after + 1]) > 1.0]
    for name, chosen in {"all": every, "dives after a turn": turning}.items():
        yield {"missions with turns": name, **_summary([misses(one, after, planned=True) for one, after in chosen])}


def rows_of_turning(missions: int) -> Iterator[dict[str, object]]:
    """Rows of the table of missions that turn at every dive, without a plan."""
    seeds = range(FIRST_SEED, FIRST_SEED + missions)
    for name, ordered in EVERY_DIVE.items():
        flown = [mission(seed, AFTER[-1] + 1, ordered=ordered) for seed in seeds]
        groups = {str(after): [misses(one, after) for one in flown] for after in AFTER}
        groups["all"] = [found for group in list(groups.values()) for found in group]
        for dives, found in groups.items():
            yield {"every dive turns": name, "dives so far": dives, **_summary(found)}


def print_table(rows: Sequence[dict[str, object]]) -> None:
    """Print rows as a table in Markdown."""
    print(markdown(list(rows[0]), [list(map(str, row.values())) for row in rows]), end="\n\n")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=MISSIONS)
    parser.add_argument(
        "--archives", type=Path, nargs="+", help="archives of real missions, in place of synthetic ones"
    )
    options = parser.parse_args()
    if options.archives:
        print_table(list(rows_of_archives(options.archives)))
        return
    print_table(list(rows_of(options.missions)))
    print_table(list(rows_with_turns(options.missions)))
    print_table(list(rows_of_turning(options.missions)))


if __name__ == "__main__":
    main()
