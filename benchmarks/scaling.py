"""Growth of the cost with the profile's duration, speed-up with the number of workers, and memory of a worker."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.engines import ENGINES
from benchmarks.measure import profile_calls
from benchmarks.memory import watched_memory
from benchmarks.timing import growth_exponent, in_turns, spread_of
from benchmarks.windows import PLATFORM, SEED, settings_of, twin_series
from gliderhpc import Glider, load_platform
from gliderhpc.mission.executors import Executor, local_executor
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.planning import prepare_mission
from gliderhpc.mission.run import run_mission
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.simulator import Scenario, simulate_mission

Row = dict[str, Any]

MEBI = 2.0**20


def duration_rows(preset: str, depths: Sequence[float], repetitions: int) -> dict[str, Row]:
    """Seconds a profile against its duration, by engine, with the exponent of growth (1: in proportion)."""
    settings, glider = settings_of(preset), Glider(load_platform(PLATFORM))
    engines = {name: make(settings) for name, make in ENGINES.items()}
    minutes: list[float] = []
    medians: dict[str, list[float]] = {name: [] for name in engines}
    for depth in depths:
        series = twin_series(settings, depth)
        minutes.append(len(series.controls) * settings.step / 60.0)
        for name, seconds in in_turns(profile_calls(engines, glider, series), repetitions).items():
            medians[name].append(spread_of(seconds).median / engines[name].at_a_time)
    return {
        name: {"minutes": minutes, "seconds": seconds, "exponent": growth_exponent(minutes, seconds)}
        for name, seconds in medians.items()
    }


def worker_rows(engine: str, preset: str, profiles: int, depth: float) -> list[Row]:
    """Seconds and a worker's peak memory of one small mission, by the number of workers: 1, 2, 4 to one a core."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.nc"
        scenario = Scenario().replaced({"profiles": profiles, "depth": depth})
        simulate_mission(load_platform(PLATFORM), path, scenario=scenario, seed=SEED)
        rows = [
            mission_row(path, path.with_name(f"{workers}.zarr"), engine, preset, workers)
            for workers in worker_counts(default_workers())
        ]
    for row in rows:
        row["speedup"] = rows[0]["seconds"] / row["seconds"]
    return rows


def worker_counts(most: int) -> list[int]:
    """Powers of two up to, and then, the most."""
    counts = []
    count = 1
    while count < most:
        counts.append(count)
        count *= 2
    return [*counts, most]


def mission_row(path: Path, store: Path, engine: str, preset: str, workers: int) -> Row:
    """Run the mission of a file once, into a new archive; the time counts from when the workers stand ready."""
    settings = MissionSettings.model_validate({"preset": preset, "engine": engine})
    ready: list[float] = []

    @contextmanager
    def executor() -> Iterator[Executor]:
        with local_executor(workers) as opened:
            ready.append(time.perf_counter())
            yield opened
            ready.append(time.perf_counter())

    with open_observations(path) as observations, watched_memory() as peak:
        prepared = prepare_mission(observations, load_platform(PLATFORM), settings)
        result = run_mission(prepared, store, executor)
    if result.failed:
        raise RuntimeError(f"profiles {result.failed} failed, so that their times mean nothing")
    began, ended = ready
    return {
        "workers": workers,
        "profiles": len(prepared.plan.profiles),
        "seconds": ended - began,
        "peak_worker_mib": peak.of_a_worker / MEBI,
    }
