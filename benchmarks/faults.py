"""Mission with every kind of fault, repeated: the archive must be identical byte for byte.

Usage: ``python -m benchmarks.faults [--profiles 32] [--seeds 10] [--depth 15]``. Per seed the mission is run four times on
real processes: with workers killed at random, with the scheduler killed and the run resumed, interrupted at random
moments by SIGINT, SIGTERM and SIGKILL and resumed until it is done, and with chunks damaged at random and repaired. Exit
status 1: an archive differs from the undisturbed one.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.clusters import killing_workers, running_cluster, signal_group, start_program, wait_until
from gliderhpc.platform import read_platform
from gliderhpc.simulator import read_scenario, simulate_mission
from gliderhpc.store_schema import damaged_chunks
from gliderhpc.store_schema.compare import compare_archives

PLATFORM = ("--platform", "petrel-l")
WAIT = 600.0
"""Seconds that a run may take."""

Trial = Callable[[Path, Path, int], str]


def run(observations: Path, store: Path, *more: object) -> subprocess.CompletedProcess[str]:
    """Run the mission to its end."""
    code = "import sys; from gliderhpc.cli import main; main(sys.argv[1:])"
    arguments = ["run-mission", observations, *PLATFORM, "--store", store, "--resume", *more]
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, timeout=WAIT, check=False
    )


def with_workers_killed(observations: Path, store: Path, seed: int) -> str:
    """Workers die at random while the mission runs on a cluster."""
    with running_cluster() as cluster:
        with killing_workers(cluster, seed, kills=8, between=(0.5, 4.0)) as killed:
            done = run(observations, store, "--scheduler-file", cluster.file)
        return f"{len(killed)} workers killed, exit status {done.returncode}"


def with_the_scheduler_killed(observations: Path, store: Path, seed: int) -> str:
    """The scheduler dies at a random moment; the run is resumed here."""
    with running_cluster() as cluster:
        process = start_program(
            "run-mission", observations, *PLATFORM, "--store", store, "--scheduler-file", cluster.file
        )
        wait_until((store / "zarr.json").exists, WAIT)
        time.sleep(np.random.default_rng(seed).uniform(0.0, 6.0))
        cluster.scheduler.kill()
        process.communicate(timeout=WAIT)
    return f"exit status {process.returncode}, then {run(observations, store, '--workers', 2).returncode}"


def with_interrupts(observations: Path, store: Path, seed: int) -> str:
    """Interrupt every run at a random moment, up to a dozen times, and finish then."""
    random, ended = np.random.default_rng(seed), []
    for _ in range(12):
        process = start_program("run-mission", observations, *PLATFORM, "--store", store, "--resume", "--workers", 2)
        time.sleep(random.uniform(3.0, 9.0))
        number = [signal.SIGINT, signal.SIGTERM, signal.SIGKILL][random.integers(3)]
        if process.poll() is None:
            (signal_group if number == signal.SIGINT else lambda p, n: p.send_signal(n))(process, number)
        process.communicate(timeout=WAIT)
        ended.append(process.returncode)
        if process.returncode == 0:
            break
    return f"ended with {', '.join(map(str, ended))}, then {run(observations, store, '--workers', 2).returncode}"


def with_damaged_chunks(observations: Path, store: Path, seed: int) -> str:
    """Truncate, delete or flip a byte of random chunks; each must be named, and all repaired."""
    random = np.random.default_rng(seed)
    run(observations, store, "--workers", 2)
    chunks = sorted(path for path in store.rglob("c.*") if path.is_file())
    chosen = [chunks[i] for i in random.choice(len(chunks), 20, replace=False)]
    for chunk in chosen:
        _damage(chunk, random)
    named = damaged_chunks(store)
    return f"20 damaged, {len(named)} lines, exit status {run(observations, store, '--workers', 2).returncode}"


def _damage(chunk: Path, random: np.random.Generator) -> None:
    content = bytearray(chunk.read_bytes())
    kind = random.integers(3)
    if kind == 0:
        chunk.unlink()
    elif kind == 1:
        chunk.write_bytes(content[: random.integers(len(content))])
    else:
        content[random.integers(len(content))] ^= 1 << random.integers(8)
        chunk.write_bytes(content)


TRIALS: dict[str, Trial] = {
    "workers killed": with_workers_killed,
    "scheduler killed": with_the_scheduler_killed,
    "interrupted": with_interrupts,
    "chunks damaged": with_damaged_chunks,
}


def trials(observations: Path, folder: Path, seeds: int) -> Iterator[tuple[str, bool]]:
    """Run every trial with every seed; yields what happened and whether the archive is the undisturbed one."""
    undisturbed = folder / "undisturbed.zarr"
    run(observations, undisturbed, "--workers", 2)
    for seed in range(seeds):
        for name, trial in TRIALS.items():
            store = folder / f"{name.replace(' ', '-')}-{seed}.zarr"
            outcome = trial(observations, store, seed)
            same = compare_archives(undisturbed, store).equal and not damaged_chunks(store) and not _strays(store)
            yield f"seed {seed}, {name}: {outcome}; {'the same' if same else 'DIFFERENT'}", same


def _strays(store: Path) -> list[Path]:
    return list(store.rglob("*.partial"))


def main() -> None:
    """Run the trials."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.faults", description=__doc__.splitlines()[0])
    parser.add_argument("--profiles", type=int, default=32)
    parser.add_argument("--depth", type=float, default=15.0)
    parser.add_argument("--seeds", type=int, default=10)
    chosen = parser.parse_args()
    os.environ["OMP_NUM_THREADS"] = "1"
    scenario = read_scenario(
        {"name": "faults", "profiles": chosen.profiles, "depth": chosen.depth, "steering": {"interval": 120.0}}
    )
    failures = 0
    with tempfile.TemporaryDirectory() as folder:
        path = simulate_mission(read_platform("petrel-l"), Path(folder) / "faults.nc", scenario=scenario, seed=5).path
        for line, same in trials(path, Path(folder), chosen.seeds):
            print(line, flush=True)
            failures += not same
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
