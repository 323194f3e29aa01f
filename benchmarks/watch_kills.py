"""Watch killed at random, with truncated and repeated files: lost and repeated reports are counted.

Usage: ``python -m benchmarks.watch_kills [--kills 30] [--dives 8] [--seed 0]``; prints a table.

Short simulated dives land one by one, each first truncated, then whole, then again under another name. ``gliderhpc watch
--once`` is started for each and killed (SIGKILL) after a random time, several times, before it may end. Archive and
messages are compared with those of a watch that nothing disturbed.
"""

import argparse
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.watch_growth import template, write_dive
from gliderhpc.findings.formatting import markdown

LONGEST = 0.9
"""Latest kill, as a fraction of the time that an undisturbed run takes."""


def watch(land: Path, store: Path) -> subprocess.Popen[bytes]:
    """Start a watch that processes what is there and ends."""
    command = [sys.executable, "-m", "gliderhpc", "watch", str(land), "--platform", "petrel-l", "--store", str(store)]
    return subprocess.Popen([*command, "--once", "--settle", "0"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def finish(land: Path, store: Path) -> float:
    """Run a watch to its end; seconds."""
    began = time.monotonic()
    if watch(land, store).wait() not in (0, 1):
        raise RuntimeError("the watch ended with wrong usage")
    return time.monotonic() - began


def messages(store: Path) -> dict[str, dict[str, object]]:
    """Messages of a watch by file name, without the time of the inversion and the revisions."""
    found = {}
    for path in sorted(store.with_name(f"{store.stem}-watch").glob("dive-*.json")):
        content = json.loads(path.read_text("utf-8"))
        del content["inversion"]["seconds"], content["revision"], content["changes"]
        found[path.name] = content
    return found


def kill_at_random(land: Path, store: Path, seconds: float, rng: random.Random) -> bool:
    """Start a watch and kill it after a random time; return whether it was still running."""
    process = watch(land, store)
    try:
        process.wait(rng.uniform(0.0, LONGEST * seconds))
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGKILL)
        process.wait()
        return True
    return False


def disturbed(dives: list[Path], land: Path, store: Path, seconds: float, kills: int, rng: random.Random) -> int:
    """Land the dives, truncated, whole and twice, with kills after each; number of kills."""
    killed = 0
    for number, dive in enumerate(dives, start=1):
        content = dive.read_bytes()
        (land / dive.name).write_bytes(content[: len(content) // 2])
        killed += kill_at_random(land, store, seconds, rng)
        (land / dive.name).write_bytes(content)
        while killed < kills * number / len(dives):
            killed += kill_at_random(land, store, seconds, rng)
        shutil.copy(land / dive.name, land / f"again-{dive.name}")
        finish(land, store)
    return killed


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--dives", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("made", "calm", "rough"):
            (folder / part).mkdir()
        dive = template(folder)
        for number in range(1, given.dives + 1):
            write_dive(dive, number, folder / "made")
        dives = sorted((folder / "made").glob("*.nc"))
        calm, rough = folder / "calm.zarr", folder / "rough.zarr"
        for path in dives:
            shutil.copy(path, folder / "calm")
            seconds = finish(folder / "calm", calm)
        killed = disturbed(dives, folder / "rough", rough, seconds, given.kills, random.Random(given.seed))
        same = subprocess.run(
            [sys.executable, "-m", "gliderhpc", "compare", str(calm), str(rough)], check=False, capture_output=True
        )
        expected, reported = messages(calm), messages(rough)
    rows = {
        "dives": str(given.dives),
        "kills while the watch was running": str(killed),
        "archive equal to the undisturbed one": "yes" if same.returncode == 0 else f"no: {same.stdout.decode()[-300:]}",
        "dives with one message": str(len(reported)),
        "messages equal to the undisturbed ones": str(
            sum(reported.get(name) == value for name, value in expected.items())
        ),
    }
    print(markdown(list(rows), [list(rows.values())]))


if __name__ == "__main__":
    main()
