"""Processor time of a watch for one new dive, by the number of dives before it.

Prints a table; ``docs/how-to/watch.md`` states its figures. Usage: ``python -m benchmarks.watch_growth [--dives N ...] [--profile]``.

A simulated dive is repeated, one file a dive, cut short so that its inversion takes little. The dives before are inverted and
marked as reported without a message; then one file at a time lands, and each look is timed in this process.
"""

import argparse
import cProfile
import pstats
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import xarray as xr

from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.simulator import read_scenario
from gliderhpc.simulator.mission import simulate_mission
from gliderhpc.watch.records import FileImport
from gliderhpc.watch.state import ReportedDive
from gliderhpc.watch.watcher import Listener, Watch, WatchInputs, open_watch

DIVES = (10, 100, 300, 565)
"""Numbers of dives in the archive when the timed ones land."""

TIMED = 3
"""Number of dives that land one by one; the median is given."""

SECONDS, PERIOD = 130.0, 900.0
"""Length of a dive's record, and time between two dives, s."""
NORTHWARD = 2e-4
"""Distance between two dives, degrees."""

SCENARIO = {"name": "short", "profiles": 1, "depth": 15.0, "steering": {"interval": 120.0}}


def template(folder: Path) -> xr.Dataset:
    """Simulate one dive, and return the beginning of its record with the fixes before and after it."""
    path = folder / "template.nc"
    simulate_mission(load_platform("petrel-l"), path, scenario=read_scenario(SCENARIO), seed=3)
    with xr.open_dataset(path, decode_times=False) as records:
        dive = records.load()
    first, last = dive["time"].values[[0, -1]]
    early = dive["time"].values <= first + SECONDS
    later = dive["fix_time"].values > last
    dive["fix_time"].values[later] -= last - first - SECONDS
    return dive.isel(time=early)


def write_dive(dive: xr.Dataset, number: int, folder: Path) -> None:
    """Write the template as the dive of a number."""
    moved = dive.copy(deep=True).assign_coords(time=dive["time"] + PERIOD * number)
    moved["time"].attrs = dive["time"].attrs
    moved["fix_time"] += PERIOD * number
    moved["fix_time"].attrs = dive["fix_time"].attrs
    moved["fix_latitude"] += NORTHWARD * number
    moved["fix_latitude"].attrs = dive["fix_latitude"].attrs
    moved["profile"].values[:] = number
    moved.to_netcdf(folder / f"dive{number:04d}.nc")


class SilentWatch(Watch):
    """A watch that marks dives as reported without a message."""

    def _report(self, observations: Observations, number: int, digest: str) -> None:
        span = observations.survey.spans[number]
        start, end = str(span.start_time), str(span.end_time)
        entry = ReportedDive(profile=number, start=start, end=end, samples=digest, revision=0, file=f"{number}.json")
        self.state.reported.append(entry)


def look_once(watched: WatchInputs, kind: type[Watch]) -> float:
    """Process what has landed; processor seconds of it."""
    heard = Listener(lambda message, path: None, lambda name, why: None)
    with open_watch(watched, heard) as opened:
        began = time.process_time()
        kind(watched, heard, opened.state).once(0.0)
        return time.process_time() - began


def rows_of(
    sizes: Sequence[int], folder: Path, profiler: cProfile.Profile | None = None
) -> Iterator[dict[str, object]]:
    """Rows of the table: one for each number of dives before."""
    land = folder / "land"
    land.mkdir()
    watched = WatchInputs(
        land, FileImport(None, {}), load_platform("petrel-l"), MissionSettings(), folder / "m.zarr", folder / "watch"
    )
    dive, landed = template(folder), 0
    for size in sorted(sizes):
        for number in range(landed + 1, size + 1):
            write_dive(dive, number, land)
        look_once(watched, SilentWatch)
        if profiler is not None and size == max(sizes):
            profiler.enable()
        seconds = []
        for number in range(size + 1, size + TIMED + 1):
            write_dive(dive, number, land)
            seconds.append(look_once(watched, Watch))
        landed = size + TIMED
        yield {"dives before": size, "processor time of one more (s)": f"{statistics.median(seconds):.2f}"}
    if profiler is not None:
        profiler.disable()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dives", type=int, nargs="+", default=list(DIVES))
    parser.add_argument("--profile", action="store_true", help="print where the time goes at the largest number")
    options = parser.parse_args()
    profiler = cProfile.Profile() if options.profile else None
    with tempfile.TemporaryDirectory() as folder:
        rows = list(rows_of(options.dives, Path(folder), profiler))
    print(markdown(list(rows[0]), [list(map(str, row.values())) for row in rows]))
    if profiler is not None:
        pstats.Stats(profiler).sort_stats("cumulative").print_stats(90)


if __name__ == "__main__":
    main()
