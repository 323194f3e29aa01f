"""Time the engines with their peers and bounds: a table, ``benchmarks/results.json``, the README's section.

Usage: ``python -m benchmarks.run [--quick]`` (``make bench``), the peers by ``pip install '.[bench]'``. Whoever is
compared takes turns on the same windows of one synthetic dive; ratios are taken within the run, because machines differ
and drift. Nothing here is asserted but that every contender solves the same problem. ``--quick`` is a first look: fewer
windows and repetitions, into ``benchmarks/quick.json``, the README untouched.
"""

import argparse
from dataclasses import dataclass

from rich.console import Console

from benchmarks.engines import ENGINES, REFERENCE
from benchmarks.machine import load_average, machine_row
from benchmarks.measure import described, gradient_rows, profile_rows, window_rows
from benchmarks.operations import operations_a_step
from benchmarks.peak import fma_peak
from benchmarks.peers import available_peers
from benchmarks.peers.base import verify
from benchmarks.readme import update_readme
from benchmarks.results import QUICK, RESULTS, Results, read_results, terminal_table, write_results
from benchmarks.scaling import duration_rows, worker_rows
from benchmarks.smoother import smoother_rows
from benchmarks.timing import one_core
from benchmarks.windows import PLATFORM, STEPS, settings_of, twin_series, twin_windows
from gliderhpc import Glider, load_platform

PRESETS = ("paper", "recommended")


@dataclass(frozen=True)
class Size:
    """Size of the measurements."""

    windows: int
    gradients: int
    solves: int
    profiles: int
    depth: float
    depths: tuple[float, ...]
    mission: int


FULL = Size(96, 100, 5, 7, 200.0, (50.0, 100.0, 200.0, 400.0, 800.0), 8)
FIRST_LOOK = Size(8, 20, 2, 2, 60.0, (30.0, 60.0), 2)


def measure(size: Size, console: Console) -> Results:
    """Measure everything, one process on one core but for the workers."""
    results: Results = {"machine": machine_row(), "reference": REFERENCE}
    with one_core():
        console.print("peak and operations")
        results["peak_flops"] = fma_peak()
        results["operations_a_gradient"] = STEPS * operations_a_step()
        _measure_windows(results, size, console)
        console.print("smoother")
        results["smoother"] = smoother_rows(settings_of("recommended"), size.depth, size.solves)
        console.print("scaling with duration")
        results["duration"] = duration_rows("recommended", size.depths, max(2, size.profiles // 2))
    # The average lags by a minute: other work that began meanwhile shows at the end of this part, our own one process aside.
    results["machine"]["load"] = max(results["machine"]["load"], load_average() - 1.0)
    console.print("scaling with workers")
    results["workers"] = {name: worker_rows(name, "recommended", size.mission, size.depth) for name in ENGINES}
    return results


def _measure_windows(results: Results, size: Size, console: Console) -> None:
    """Gradients, windows and profiles; the peers with preset `paper`, whose problem they solve."""
    glider = Glider(load_platform(PLATFORM))
    results.update(contenders={}, skipped={}, gradient={}, window={}, profile={})
    for preset in PRESETS:
        console.print(f"windows and profiles, preset {preset}")
        settings = settings_of(preset)
        engines = {name: make(settings) for name, make in ENGINES.items()}
        contenders = [engine.contender for engine in engines.values()]
        if preset == "paper":
            peers, results["skipped"] = available_peers(settings)
            contenders += peers
        series = twin_series(settings, size.depth)
        windows = twin_windows(series, settings, size.windows)
        for contender in contenders:
            difference = verify(contender, windows[: contender.batch])
            results["contenders"].setdefault(contender.name, described(contender, difference))
        results["gradient"][preset] = gradient_rows(contenders, windows, size.gradients, REFERENCE)
        results["window"][preset] = window_rows(contenders, windows, settings, size.solves, REFERENCE)
        results["profile"][preset] = profile_rows(engines, glider, series, size.profiles)
        results["profile_minutes"] = len(series.controls) * settings.step / 60.0
    results["fraction_of_peak"] = {
        name: results["operations_a_gradient"] / results["gradient"]["paper"][name]["median"] / results["peak_flops"]
        for name in ENGINES
    }


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.run", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a first look in two minutes; publishes nothing")
    quick = parser.parse_args().quick
    console = Console(width=160)
    results = measure(FIRST_LOOK if quick else FULL, Console(stderr=True))
    console.print(terminal_table(results))
    path = QUICK if quick else RESULTS
    if not quick:
        before = read_results(path)
        results |= {name: before[name] for name in ("missions", "fortran") if name in before}
        update_readme(results)
    write_results(path, results)
    console.print(f"written to {path}" + ("" if quick else " and into README.md"), highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
