"""Compare Numba's lanes with Fortran's on one machine and write the section of ``docs/fortran.md``.

Usage: ``python -m benchmarks.fortran [--quick]`` (part of ``make bench``), the library by ``make fortran``. Gradients, windows,
profiles and a small mission are taken in turns; cold starts are processes of their own whose cache of compiled kernels is
empty, as on a host that has never run this version. ``--quick`` is a first look, into ``benchmarks/quick.json``; the page
stays as it is.
"""

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.engines import fortran_engine, lanes_engine
from benchmarks.machine import load_average, machine_row
from benchmarks.measure import described, gradient_rows, profile_rows, window_rows
from benchmarks.peers.base import verify
from benchmarks.results import QUICK, RESULTS, read_results, write_results
from benchmarks.scaling import mission_row
from benchmarks.sections import with_section
from benchmarks.timing import one_core, seconds_of, spread_of
from benchmarks.windows import PLATFORM, SEED, Window, settings_of, twin_series, twin_windows
from gliderhpc import Glider, load_platform
from gliderhpc.findings.formatting import markdown
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.fortran.build import COMPILER, command_of
from gliderhpc.kernels.fortran.library import Library, LibraryError, load
from gliderhpc.simulator import Scenario, simulate_mission

Row = dict[str, Any]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "fortran.md"
SECTION = "measured"
PRESET = "recommended"
BOTH = {"lanes": lanes_engine, "fortran": fortran_engine}

GAIN = 1.3
"""Gain of a mission from which the default engine would change."""
BUSY = 0.5
"""Load of other work from which the page mentions it."""

_FIRST_WINDOWS = """
import pickle, sys
import gliderhpc
from gliderhpc.estimation.engines import FortranRun
from gliderhpc.estimation.lanes import LaneBatch
from gliderhpc.kernels.quasi_newton import run_until_done
engine, path = sys.argv[1:]
with open(path, "rb") as file:
    settings, tasks = pickle.load(file)
batch = LaneBatch(settings, FortranRun() if engine == "fortran" else run_until_done)
for lane, task in enumerate(tasks):
    batch.load(lane, task)
batch.run()
"""
_FIRST_PROFILE = """
import sys
from gliderhpc.cli import main
engine, path = sys.argv[1:]
main(["run-mission", path, "--platform", "petrel-l", "--profiles", "1", "--workers", "0", "--store", path + ".zarr",
      "--overwrite", "--engine", engine])
"""


@dataclass(frozen=True)
class Size:
    """Size of the measurements."""

    windows: int
    gradients: int
    solves: int
    profiles: int
    mission: int
    missions: int
    starts: int
    depth: float


FULL = Size(windows=96, gradients=200, solves=5, profiles=7, mission=3 * LANES, missions=3, starts=3, depth=200.0)
FIRST_LOOK = Size(windows=LANES, gradients=50, solves=2, profiles=2, mission=4, missions=1, starts=1, depth=60.0)


def measure(library: Library, size: Size, console: Console) -> Row:
    """Measure both engines on one core."""
    settings, glider = settings_of(PRESET), Glider(load_platform(PLATFORM))
    engines = {name: make(settings) for name, make in BOTH.items()}
    contenders = [engine.contender for engine in engines.values()]
    results: Row = {"machine": machine_row(), "compiler": library.compiler, "flags": library.flags, "lanes": LANES}
    with one_core():
        console.print("gradients, windows, profiles")
        series = twin_series(settings, size.depth)
        windows = twin_windows(series, settings, size.windows)
        results["contenders"] = {
            contender.name: described(contender, verify(contender, windows[: contender.batch]))
            for contender in contenders
        }
        results["gradient"] = gradient_rows(contenders, windows, size.gradients, "lanes")
        results["window"] = window_rows(contenders, windows, settings, size.solves, "lanes")
        results["profile"] = profile_rows(engines, glider, series, size.profiles)
        results["profile_minutes"] = len(series.controls) * settings.step / 60.0
        console.print("a mission")
        results["mission"] = mission_rows(size)
        console.print("cold starts")
        results["cold_start"] = cold_start_rows(windows[:LANES], size)
        results["build_seconds"] = build_seconds(library)
    # Ours is one process at a time.
    results["machine"]["load"] = max(results["machine"]["load"], load_average() - 1.0)
    return results


def mission_rows(size: Size) -> Row:
    """Seconds of a small mission on one worker, by each engine in turn."""
    seconds: dict[str, list[float]] = {name: [] for name in BOTH}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "twin.nc"
        _simulated(path, size.mission, size.depth)
        for turn in range(size.missions):
            for name, times in seconds.items():
                times.append(mission_row(path, path.with_name(f"{name}-{turn}.zarr"), name, PRESET, 1)["seconds"])
    return {name: {**spread_of(times).row(), "profiles": size.mission} for name, times in seconds.items()}


def cold_start_rows(windows: list[Window], size: Size) -> Row:
    """Seconds from the start of a process to its first windows, and to its first profile, cache empty and filled."""
    with tempfile.TemporaryDirectory() as folder:
        tasks, observations = Path(folder) / "windows.pickle", Path(folder) / "first.nc"
        tasks.write_bytes(pickle.dumps((settings_of(PRESET), [(w.data, w.start) for w in windows])))
        _simulated(observations, 1, size.depth)
        return {
            what: _starts(code, str(path), size.starts)
            for what, code, path in (
                ("first windows", _FIRST_WINDOWS, tasks),
                ("first profile", _FIRST_PROFILE, observations),
            )
        }


def build_seconds(library: Library) -> float:
    """Seconds that the compiler takes for the library, once for all hosts of a kind."""
    with tempfile.TemporaryDirectory() as folder:
        command = command_of(COMPILER, library.flags, LANES, folder, Path(folder) / "library.so")
        return seconds_of(lambda: subprocess.run(command, check=True))


def _starts(code: str, path: str, repetitions: int) -> dict[str, Row]:
    """Medians of a start with an empty cache and of the one after it, by engine."""
    times: dict[str, dict[str, list[float]]] = {name: {"cold": [], "warm": []} for name in BOTH}
    for _ in range(repetitions):
        for name, row in times.items():
            with tempfile.TemporaryDirectory() as cache:
                for state in row.values():
                    state.append(_seconds_of_process(code, name, path, cache))
    return {name: {state: spread_of(seconds).median for state, seconds in row.items()} for name, row in times.items()}


def _seconds_of_process(code: str, engine: str, path: str, cache: str) -> float:
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", code, engine, path],
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    return time.perf_counter() - began


def _simulated(path: Path, profiles: int, depth: float) -> None:
    scenario = Scenario().replaced({"profiles": profiles, "depth": depth})
    simulate_mission(load_platform(PLATFORM), path, scenario=scenario, seed=SEED)


def section(results: Mapping[str, Any]) -> str:
    """Render what stands between the page's marks."""
    machine = results["machine"]
    lines = [
        f"Measured on {machine['day']} by `python -m benchmarks.fortran`: {machine['cpu']}, one core, "
        f"{results['lanes']} lanes; numba {machine['numba']}, {results['compiler']} with `{results['flags']}`. "
        f"Medians, engines measured in turn, preset `{PRESET}`."
    ]
    if machine["load"] > BUSY:
        lines[0] += f" The machine was busy with other work (load {machine['load']:.1f}): prefer ratios to times."
    return "\n".join(
        [*lines, "", markdown(("", "lanes (Numba)", "fortran", "gain"), _rows(results)), "", *_verdict(results)]
    )


def _rows(results: Mapping[str, Any]) -> list[list[str]]:
    mission = results["mission"]["lanes"]["profiles"]
    rows = [
        _row("cost and gradient of a 300-step window, µs", results["gradient"], "median", 1e6),
        _row("whole window, ms", results["window"], "mean", 1e3),
        _row(f"whole profile of {results['profile_minutes']:.0f} min, s", results["profile"], "median", 1.0),
        _row(f"mission of {mission} profiles, one worker, s", results["mission"], "median", 1.0),
    ]
    for what, row in results["cold_start"].items():
        rows.append(_row(f"{what} of a process, cache empty, s", row, "cold", 1.0))
        rows.append(_row(f"{what} of a process, cache filled, s", row, "warm", 1.0))
    return rows


def _row(what: str, rows: Mapping[str, Mapping[str, float]], key: str, unit: float) -> list[str]:
    lanes, fortran = rows["lanes"][key], rows["fortran"][key]
    return [what, f"{unit * lanes:.3g}", f"{unit * fortran:.3g}", f"{lanes / fortran:.2f}"]


def gain_of(results: Mapping[str, Any]) -> float:
    """Speed-up of a mission by Fortran."""
    return float(results["mission"]["lanes"]["median"] / results["mission"]["fortran"]["median"])


def _verdict(results: Mapping[str, Any]) -> list[str]:
    gain = gain_of(results)
    gradient = results["gradient"]["lanes"]["median"] / results["gradient"]["fortran"]["median"]
    faster, slower = ("Fortran", "Numba") if gradient > 1.0 else ("Numba", "Fortran")
    decided = (
        f"below the {GAIN} required to change the default, which remains `lanes`"
        if gain <= GAIN
        else f"above {GAIN}: the default should change"
    )
    return [
        f"{faster} is the faster of the two for cost and gradient, {max(gradient, 1.0 / gradient):.2f} times "
        f"{slower}'s speed. A mission, whose filter, smoother and quasi-Newton method use Numba with either engine, "
        f"gains a factor of {gain:.2f}, {decided}. The library took {results['build_seconds']:.0f} s to compile, once "
        "for all hosts of the same kind."
    ]


def main() -> None:
    """Measure, and write results and page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fortran", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a first look; publishes nothing")
    quick = parser.parse_args().quick
    try:
        library = load()
    except LibraryError as error:
        parser.exit(2, f"error: {error}\n")
    found = measure(library, FIRST_LOOK if quick else FULL, Console(stderr=True))
    path = QUICK if quick else RESULTS
    write_results(path, {**read_results(path), "fortran": found})
    text = section(found)
    if not quick:
        PAGE.write_text(with_section(PAGE.read_text("utf-8"), SECTION, text), "utf-8")
    print(f"{text}\nwritten to {path}" + ("" if quick else f" and into {PAGE.name}"))


if __name__ == "__main__":
    main()
