"""Run a whole mission with its command and add its cost to ``benchmarks/results.json`` and the README.

Usage: ``python -m benchmarks.mission OBS.nc --platform petrel-l --workers 2 [--engine scipy] [--preset paper]``. The
archive goes to a temporary folder, or to ``--store``, and remains there.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import machine_row
from benchmarks.memory import watched_memory
from benchmarks.readme import update_readme
from benchmarks.results import RESULTS, read_results, write_results
from gliderhpc import open_mission
from gliderhpc.mission.local_workers import default_workers

MEBI = 2.0**20
SAMPLING = 0.5
"""Seconds between samples of memory: looking costs milliseconds, and a mission runs for long."""

FINISHED = (0, 1)
"""Exit statuses of a mission that ran to its end: all well, or some profile failed."""


def run_and_measure(
    observations: Path, store: Path, platform: str, engine: str, preset: str, workers: int
) -> dict[str, Any]:
    """Run the mission in a process of its own; its row.

    Raises
    ------
    RuntimeError
        The mission did not run to its end; the message is its own last line.
    """
    arguments = [
        "run-mission", observations, "--platform", platform, "--store", store, "--engine", engine, "--preset", preset,
        "--workers", workers, "--overwrite",
    ]  # fmt: skip
    code = "import sys; from gliderhpc.cli import main; main(sys.argv[1:])"
    began = time.perf_counter()
    with tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            [sys.executable, "-c", code, *map(str, arguments)], stdout=subprocess.DEVNULL, stderr=errors
        )
        with watched_memory(process.pid, SAMPLING) as peak:
            status = process.wait()
        if status not in FINISHED:
            errors.seek(0)
            lines = errors.read().strip().splitlines() or [f"exit status {status}"]
            raise RuntimeError(lines[-1])
    seconds = time.perf_counter() - began
    return {
        "engine": engine,
        "preset": preset,
        "workers": workers,
        "wall_seconds": seconds,
        "core_hours": core_hours(seconds, workers),
        "peak_worker_mib": peak.of_a_worker / MEBI,
        "peak_parent_mib": peak.parent / MEBI,
        "archive_mib": folder_bytes(store) / MEBI,
        **_contents(store),
        "machine": machine_row(),
    }


def core_hours(seconds: float, workers: int) -> float:
    """Hours of core that a run reserved: its wall time on every worker's core, busy or not."""
    return seconds * max(1, workers) / 3600.0


def folder_bytes(folder: Path) -> int:
    """Bytes of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _contents(store: Path) -> dict[str, Any]:
    with open_mission(store) as tree:
        table = tree.to_dataset()[["status", "duration"]].load()
    return {
        "profiles": int(table.sizes["profile"]),
        "failed": int((table["status"] == "failed").sum()),
        "record_hours": float(np.nansum(table["duration"].values)) / 3600.0,
    }


def main() -> None:
    """Run, and add the row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mission", description=__doc__.splitlines()[0])
    parser.add_argument("observations", type=Path, metavar="OBS.nc")
    parser.add_argument("--platform", default="petrel-l")
    parser.add_argument("--engine", default="scipy")
    parser.add_argument("--preset", default="recommended", choices=("recommended", "paper"))
    parser.add_argument("--workers", type=int, default=default_workers())
    parser.add_argument("--store", type=Path, help="folder for the archive; default a temporary folder")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        store = chosen.store or Path(folder) / "mission.zarr"
        row = run_and_measure(chosen.observations, store, chosen.platform, chosen.engine, chosen.preset, chosen.workers)
    results = read_results(RESULTS)
    results.setdefault("machine", row["machine"])
    key = f"{chosen.observations.stem}, {chosen.engine}, {chosen.preset}, {chosen.workers} workers"
    results.setdefault("missions", {})[key] = row
    write_results(RESULTS, results)
    update_readme(results)
    print(f"{key}: {row['wall_seconds']:.0f} s, {row['peak_worker_mib']:.0f} MiB per worker; added to {RESULTS}")


if __name__ == "__main__":
    main()
