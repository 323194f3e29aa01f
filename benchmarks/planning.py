"""Measure the constants of `run-mission --dry-run`: seconds and bytes per step, for each engine.

Usage: ``python -m benchmarks.planning [--depth 700] [--profiles 12]``. Each run is a process of its own on one core; what
it takes to start (imports, compiled kernels) is measured apart and taken off. Seconds are those of the processor, so
that a busy machine tells much the same. The figures go into `gliderhpc/mission/planning.py` by hand.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from gliderhpc import load_platform, open_mission
from gliderhpc.simulator import Scenario, simulate_mission

PLATFORM = "petrel-l"
START = "import gliderhpc.cli; from gliderhpc.mission.warm import warm_kernels; warm_kernels()"
RUN = "import sys; from gliderhpc.cli import main; main(sys.argv[1:])"


@dataclass(frozen=True)
class Usage:
    """Processor time (s) and largest resident memory (bytes) of a process."""

    seconds: float
    memory: float


def usage_of(code: str, *arguments: object) -> Usage:
    """Run Python code in a process of its own.

    Raises
    ------
    RuntimeError
        It failed.
    """
    command = [sys.executable, "-c", code, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"exit status {process.returncode}: {' '.join(command)}")
    kibi = 1024.0 if sys.platform != "darwin" else 1.0
    return Usage(used.ru_utime + used.ru_stime, used.ru_maxrss * kibi)


def main() -> None:
    """Measure and print a line a run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning", description=__doc__.splitlines()[0])
    parser.add_argument("--depth", type=float, default=700.0, help="depth of the profiles, m")
    parser.add_argument("--profiles", type=int, default=12)
    chosen = parser.parse_args()
    usage_of(START)
    start = usage_of(START)
    print(f"start: {start.seconds:.1f} s, {start.memory / 1e6:.0f} MB")
    with tempfile.TemporaryDirectory() as folder:
        observations, store = Path(folder) / "twin.nc", Path(folder) / "twin.zarr"
        scenario = Scenario().replaced({"profiles": chosen.profiles, "depth": chosen.depth})
        simulate_mission(load_platform(PLATFORM), observations, scenario=scenario, seed=1)
        for engine, preset, last in (
            ("lanes", "recommended", chosen.profiles),
            ("lanes", "paper", chosen.profiles),
            ("scipy", "recommended", 1),
            ("scipy", "paper", 1),
        ):
            used = usage_of(
                RUN, "run-mission", observations, "--platform", PLATFORM, "--store", store, "--overwrite", "--workers",
                0, "--engine", engine, "--preset", preset, "--profiles", f"1:{last}",
            )  # fmt: skip
            with open_mission(store) as archive:
                steps = archive["duration"].values / float(archive.attrs["step"])
            disk = sum(path.stat().st_size for path in store.rglob("*") if path.is_file())
            print(
                f"{engine}, {preset}, {last} profiles of up to {steps.max():.0f} steps: "
                f"{(used.seconds - start.seconds) / steps.sum():.2e} s, {disk / steps.sum():.0f} bytes of disk per "
                f"step; {(used.memory - start.memory) / steps.max():.0f} bytes of memory per step of the longest"
            )


if __name__ == "__main__":
    main()
