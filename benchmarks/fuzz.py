"""Fuzz every parser and command, kill long commands, and check invariants after each trial.

Usage: ``python -m benchmarks.fuzz [--seconds 600] [--seed 0] [--tree PATH] [--kinds archive,yaml] [--out DIR]`` (``make
fuzz``); ``python -m benchmarks.fuzz --replay FILE`` runs one case again. Inputs are drawn by hypothesis from a seed, and
every command is a fork of one process that has loaded the program of ``--tree`` (default: this one; a worktree of another
version may be given). What counts is not a message but invariants: an exit status of 0, 1, 2, 130 or 141; no traceback; an end
within ``--limit`` seconds and 2 GiB; inputs, and whatever lies next to the outputs, unchanged; archives equal or refused;
no result that cannot be. Failing cases are left in DIR, one JSON file for each cause; the table goes to DIR/table.json.
``--kills 100`` kills each long command so many times at moments drawn from the seed, and nothing else.
Exit status 1: something did not hold.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings

from benchmarks.fuzzing.kills import COMMANDS, KILLS, drawn_kills, kill_one
from benchmarks.fuzzing.kinds import Case, SkippedError, judge
from benchmarks.fuzzing.program import Program
from benchmarks.fuzzing.specimens import Specimens
from benchmarks.fuzzing.strategies import KINDS
from benchmarks.fuzzing.verdicts import CLASSES, Fault

REPOSITORY = Path(__file__).resolve().parents[1]
BATCH = 25
"""Inputs of one kind before the next kind has its turn."""


@dataclass
class Tally:
    """Inputs tried and promises broken, by kind."""

    out: Path
    tried: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)
    seconds: Counter[str] = field(default_factory=Counter)
    broken: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    causes: defaultdict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def add(self, kind: str, recipe: dict[str, Any], case: Case) -> None:
        """Count a case, and leave a file for each cause that is new."""
        self.tried[kind] += 1
        self.broken[kind].update({fault.name for fault in case.faults})
        for fault in case.faults:
            cause = f"{fault.name}: {fault.detail}"
            if not self.causes[kind][cause]:
                _write_failure(self.out, recipe, case, fault)
                print(f"  {kind}: {cause}", flush=True)
            self.causes[kind][cause] += 1

    def content(self) -> dict[str, Any]:
        """Counts by kind, and the causes."""
        rows = {
            kind: {
                "tried": self.tried[kind],
                "seconds": round(self.seconds[kind]),
                **{n: self.broken[kind][n] for n in CLASSES},
            }
            for kind in self.tried
        }
        total = {name: sum(row[name] for row in rows.values()) for name in ("tried", "seconds", *CLASSES)}
        return {
            "kinds": {**rows, "all": total},
            "skipped": dict(self.skipped),
            "causes": {kind: dict(causes.most_common()) for kind, causes in self.causes.items()},
        }


def _write_failure(out: Path, recipe: dict[str, Any], case: Case, fault: Fault) -> None:
    digest = hashlib.blake2b(f"{fault.name}{fault.detail}".encode(), digest_size=4).hexdigest()
    path = out / f"{recipe['kind']}-{fault.name}-{digest}.json"
    if not path.exists():
        content = {"recipe": recipe, "fault": [fault.name, fault.detail], "transcript": case.transcript}
        path.write_text(json.dumps(content, indent=1), "utf-8")


def run_recipe(recipe: dict[str, Any], program: Program, specimens: Specimens, folder: Path) -> Case:
    """Run a recipe, of an input or of a kill."""
    if recipe["kind"] == "kill":
        return kill_one(recipe, program, specimens, folder)
    return judge(recipe, program, specimens, folder)


def fuzz(program: Program, folder: Path, tally: Tally, names: Sequence[str], budget: float, first: int) -> None:
    """Try kinds in turn until the budget (s) is spent; `first` is the seed of the first batch."""
    specimens = Specimens(folder / "specimens", program)
    end = time.monotonic() + budget
    turn = 0
    while time.monotonic() < end:
        # Whoever has had least of its share is next.
        kind = min(names, key=lambda name: (tally.seconds[name] / _share(name), names.index(name)))
        begun = time.monotonic()
        _batch(kind, program, specimens, folder, tally, first + turn, end)
        tally.seconds[kind] += time.monotonic() - begun
        turn += 1


def _share(name: str) -> float:
    return KINDS[name][1] if name in KINDS else 8.0


def _batch(
    kind: str, program: Program, specimens: Specimens, folder: Path, tally: Tally, number: int, end: float
) -> None:
    recipes = KILLS if kind == "kill" else KINDS[kind][0]

    @seed(number)
    @settings(
        max_examples=4 if kind == "kill" else BATCH,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(recipes)
    def trial(recipe: dict[str, Any]) -> None:
        if time.monotonic() > end:
            return
        try:
            case = run_recipe(recipe, program, specimens, folder / "case")
        except SkippedError:
            tally.skipped[kind] += 1
            return
        except (OSError, RuntimeError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError) as error:
            # A long run shall not end because one input could not be made.
            tally.skipped[f"{kind}: {type(error).__name__}: {error}"] += 1
            print(f"  {kind}: the harness failed: {type(error).__name__}: {error}", flush=True)
            shutil.rmtree(folder / "case", ignore_errors=True)
            return
        tally.add(kind, recipe, case)

    trial()


def kill_each(
    program: Program, folder: Path, tally: Tally, count: int, first: int, commands: Sequence[str] = tuple(COMMANDS)
) -> None:
    """Kill each of the long commands `count` times at random moments; `first` is the seed, a command a row of the table.

    The moments of a command do not depend on which others are killed.
    """
    specimens = Specimens(folder / "specimens", program)
    for command in commands:
        random = np.random.default_rng([first, list(COMMANDS).index(command)])
        begun = time.monotonic()
        for recipe in drawn_kills(command, count, random):
            tally.add(f"kill {command}", recipe, kill_one(recipe, program, specimens, folder / "case"))
        tally.seconds[f"kill {command}"] += time.monotonic() - begun
        print(f"kill {command}: {count} in {tally.seconds[f'kill {command}']:.0f} s", flush=True)


def table(content: dict[str, Any]) -> str:
    """Table of a run, a line a kind."""
    heads = ("kind", "tried", "seconds", *CLASSES)
    rows = [heads, *((kind, *(str(row[name]) for name in heads[1:])) for kind, row in content["kinds"].items())]
    widths = [max(len(row[i]) for row in rows) for i in range(len(heads))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def replay(path: Path, program: Program, folder: Path) -> Case:
    """Run the case of a file again."""
    content = json.loads(path.read_text("utf-8"))
    return run_recipe(
        content.get("recipe", content), program, Specimens(folder / "specimens", program), folder / "case"
    )


def replay_all(paths: Sequence[Path], program: Program, folder: Path, tally: Tally) -> None:
    """Run every case of a corpus again, and count them by kind."""
    for path in paths:
        begun = time.monotonic()
        recipe = json.loads(path.read_text("utf-8"))["recipe"]
        try:
            case = replay(path, program, folder)
        except SkippedError:
            tally.skipped[path.stem] += 1
            continue
        tally.add(recipe["kind"], recipe, case)
        tally.seconds[recipe["kind"]] += time.monotonic() - begun
        print(f"{path.stem}: {'; '.join(f'{one.name}: {one.detail}' for one in case.faults) or 'holds'}", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0, help="time to spend on inputs and kills")
    parser.add_argument("--seed", type=int, default=0, help="of the first batch")
    parser.add_argument("--tree", type=Path, default=REPOSITORY, help="source tree of the program under test")
    parser.add_argument("--kinds", default=",".join([*KINDS, "kill"]), help="kinds to try")
    parser.add_argument("--limit", type=float, default=60.0, help="seconds that a command may take")
    parser.add_argument(
        "--out", type=Path, default=Path("fuzz-failures"), help="folder for failing cases and the table"
    )
    parser.add_argument("--kills", type=int, metavar="N", help="kill each long command N times instead")
    parser.add_argument("--commands", default=",".join(COMMANDS), help="commands that --kills kills")
    parser.add_argument("--corpus", type=Path, metavar="DIR", help="run every case of this folder instead")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="run the case of this file again")
    return parser.parse_args()


def main() -> None:
    """Fuzz, or run one case again."""
    chosen = _arguments()
    os.environ["PYTHONHASHSEED"] = "0"
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name, Program(chosen.tree.resolve(), chosen.limit) as program:
        Path(name).chmod(0o755)
        if chosen.replay:
            case = replay(chosen.replay, program, Path(name))
            print(json.dumps(case.transcript, indent=1))
            print("\n".join(f"{fault.name}: {fault.detail}" for fault in case.faults) or "every invariant holds")
            sys.exit(1 if case.faults else 0)
        shutil.rmtree(chosen.out, ignore_errors=True)
        chosen.out.mkdir(parents=True)
        tally = Tally(chosen.out)
        if chosen.corpus:
            replay_all(sorted(chosen.corpus.glob("*.json")), program, Path(name), tally)
        elif chosen.kills:
            kill_each(program, Path(name), tally, chosen.kills, chosen.seed, chosen.commands.split(","))
        else:
            fuzz(program, Path(name), tally, chosen.kinds.split(","), chosen.seconds, chosen.seed)
        content = {"tree": str(chosen.tree.name), "seed": chosen.seed, **tally.content()}
        (chosen.out / "table.json").write_text(json.dumps(content, indent=1), "utf-8")
        print(table(content))
        sys.exit(1 if any(content["kinds"]["all"][name] for name in CLASSES) else 0)


if __name__ == "__main__":
    main()
