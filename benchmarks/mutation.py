"""Mutation testing of numerical code: small changes that no test notices.

Usage: ``python -m benchmarks.mutation [MODULE ...] [--sample 60] [--seed 0] [--timeout 120] [--out FILE.json]``. Every
mutant is one change of one module: a comparison turned, an operator swapped, a constant changed, ``and`` for ``or``, a
``not`` removed, a result dropped. Only the tests that name the module run, in
a fork of one process that has loaded the libraries and the compiled kernels, on a copy of the tree; a mutant is killed by a
failing test, or by taking longer than the limit. Prints killed and survived by module, and the survivors as changes.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]

TARGETS: dict[str, tuple[str, ...]] = {
    "gliderhpc.estimation.currents": ("estimation/test_currents.py", "studies/test_depth_resolved.py"),
    "gliderhpc.estimation.current_errors": ("estimation/test_currents.py",),
    "gliderhpc.estimation.steady_balance": ("estimation/test_steady_balance.py",),
    "gliderhpc.observations.files.foreign": ("observations/test_units.py",),
    "gliderhpc.observations.instruments.slocum_files": ("observations/test_units.py",),
    "gliderhpc.observations.instruments.seaexplorer": (
        "observations/instruments/test_seaexplorer.py",
        "observations/instruments/test_seaexplorer_legs.py",
    ),
    "gliderhpc.observations.instruments.seaglider_dive": ("observations/instruments/test_seaglider.py",),
    "gliderhpc.observations.instruments.og1_variables": ("observations/instruments/test_og1.py",),
    "gliderhpc.calibration.prior.likelihood": (
        "calibration/prior/test_likelihood.py",
        "calibration/prior/test_whiteness.py",
        "calibration/prior/test_tuning.py",
    ),
    "gliderhpc.estimation.least_squares": ("estimation/test_least_squares.py",),
    "gliderhpc.calibration.prior.fisher_scoring": ("calibration/prior/test_fisher_scoring.py",),
    "gliderhpc.record_checks.finding": ("record_checks/test_record_checks.py",),
    "gliderhpc.record_checks.turns": (
        "record_checks/test_compass_turns.py",
        "record_checks/test_record_checks.py",
    ),
    "gliderhpc.record_checks.compass": (
        "record_checks/test_compass_likelihood.py",
        "record_checks/test_record_checks.py",
    ),
}
"""Modules that carry numbers, and the tests that name them."""

_COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
_SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.MatMult: ast.Mult,
}  # fmt: skip

Change = Callable[[ast.AST], None]


@dataclass(frozen=True)
class Mutant:
    """One change of a module: where, what it was and what it became, and the module's new text."""

    line: int
    before: str
    after: str
    source: str


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of a module, in the order of its text."""
    tree = ast.parse(source)
    nodes = list(ast.walk(tree))
    texts = _untouched(tree)
    for place, node in enumerate(nodes):
        if id(node) in texts or not hasattr(node, "lineno"):
            continue
        for change in _changes(node):
            changed = copy.deepcopy(tree)
            target = list(ast.walk(changed))[place]
            change(target)
            before, after = ast.unparse(node), ast.unparse(target)
            if before != after:
                yield Mutant(node.lineno, before, after, ast.unparse(ast.fix_missing_locations(changed)))


def _untouched(tree: ast.AST) -> set[int]:
    """Nodes that carry no numbers: docstrings, annotations, messages, decorators and what only type checkers read."""
    skipped: set[int] = set()

    def skip(node: ast.AST | None) -> None:
        if node is not None:
            skipped.update(id(inside) for inside in ast.walk(node))

    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skip(node)
        elif isinstance(node, ast.AnnAssign | ast.arg):
            skip(node.annotation)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            skip(getattr(node, "returns", None))
            for decorator in node.decorator_list:
                skip(decorator)
        elif isinstance(node, ast.JoinedStr | ast.Raise | ast.Import | ast.ImportFrom | ast.Assert) or _is_alias(node):
            skip(node)
    return skipped


def _is_alias(node: ast.AST) -> bool:
    """Return whether a statement names a type, as ``Array = NDArray[np.float64]``."""
    if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Subscript):
        return False
    name = node.targets[0]
    return isinstance(name, ast.Name) and name.id[0].isupper()


def _changes(node: ast.AST) -> list[Change]:
    """Changes that make sense of one node."""
    if isinstance(node, ast.Compare):
        changes = [_with_operator(_COMPARED[type(node.ops[0])])]
        return changes + ([_with_operator(_TURNED[type(node.ops[0])])] if type(node.ops[0]) in _TURNED else [])
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in _SWAPPED:
        return [lambda found: setattr(found, "op", _SWAPPED[type(found.op)]())]
    if isinstance(node, ast.BoolOp):
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        return [lambda found: setattr(found, "op", other())]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return [lambda found: setattr(found, "op", ast.UAdd())]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return [lambda found: _replace(found, ast.Call(ast.Name("bool", ast.Load()), [found.operand], []))]
    if isinstance(node, ast.Constant):
        return _of_constant(node)
    if isinstance(node, ast.Return) and node.value is not None and not isinstance(node.value, ast.Constant):
        return [lambda found: setattr(found, "value", ast.Constant(None))]
    return []


def _with_operator(kind: type[ast.cmpop]) -> Change:
    def change(found: ast.AST) -> None:
        assert isinstance(found, ast.Compare)
        found.ops[0] = kind()

    return change


def _of_constant(node: ast.Constant) -> list[Change]:
    value = node.value
    if isinstance(value, bool):
        return [lambda found: setattr(found, "value", not value)]
    if isinstance(value, int):
        return [lambda found: setattr(found, "value", value + 1)]
    if isinstance(value, float):
        # A unit's factor that is wrong by a tenth, or by a thousand.
        return [lambda found: setattr(found, "value", value * 1.1 if value else 1.0)]
    return []


def _replace(found: ast.AST, by: ast.AST) -> None:
    found.__class__ = by.__class__
    found.__dict__.clear()
    found.__dict__.update(by.__dict__)


@dataclass(frozen=True)
class Outcome:
    """Result of a module."""

    module: str
    killed: int
    survivors: tuple[Mutant, ...]
    left_out: int

    @property
    def fraction(self) -> float:
        """Part of the mutants that was killed."""
        tried = self.killed + len(self.survivors)
        return self.killed / tried if tried else 1.0


def run_module(module: str, tests: tuple[str, ...], tree: Path, sample: int, number: int, timeout: float) -> Outcome:
    """Try mutants of a module, at most `sample` of them drawn by the seed `number`."""
    path = tree / (module.replace(".", "/") + ".py")
    source = path.read_text("utf-8")
    found = list(mutants(source))
    chosen = random.Random(f"{module}{number}").sample(found, min(sample, len(found)))
    if _fails(tests, tree, 10.0 * timeout):
        raise RuntimeError(f"{module}: {' '.join(tests)} fails without any change")
    survivors = []
    try:
        for mutant in sorted(chosen, key=lambda one: one.line):
            path.write_text(mutant.source, "utf-8")
            if not _fails(tests, tree, timeout):
                survivors.append(mutant)
                print(f"  {module}:{mutant.line}: {mutant.before}  ->  {mutant.after}", flush=True)
    finally:
        path.write_text(source, "utf-8")
    return Outcome(module, len(chosen) - len(survivors), tuple(survivors), len(found) - len(chosen))


def _fails(tests: tuple[str, ...], tree: Path, timeout: float) -> bool:
    """Run tests in a fork; whether one failed, or the time was up."""
    child = os.fork()
    if child == 0:
        _run_tests(tests, tree)
    begun = time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status) != 0
        if time.monotonic() - begun > timeout:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return True
        time.sleep(0.02)


def _run_tests(tests: tuple[str, ...], tree: Path) -> None:
    """Run tests on the tree and end; everything of the program but its kernels is loaded from there."""
    import pytest

    os.setsid()
    os.chdir(tree)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    for name in [name for name in sys.modules if _is_ours(name)]:
        del sys.modules[name]
    sys.path[:] = [str(tree), *(place for place in sys.path if Path(place or ".").resolve() != REPOSITORY)]
    status = 1
    try:
        names = [f"tests/{name}" for name in tests]
        status = int(pytest.main(["-x", "-q", "--assert=plain", "-p", "no:cacheprovider", *names]))
    except BaseException:  # noqa: BLE001 - a fork must never go on as the process it came from
        traceback.print_exc()
    os._exit(status)


def _is_ours(name: str) -> bool:
    top = name.split(".")[0]
    return top == "gliderhpc" and not name.startswith("gliderhpc.kernels")


def _load() -> None:
    """Load libraries, test runner and kernels once; no mutant changes the kernels, which the tests need not compile."""
    from gliderhpc.kernels.cache import compiled_cache
    from gliderhpc.mission.warm import warm_kernels, warm_simulator

    warm_kernels()
    warm_simulator()
    (compiled_cache() / "warm").touch()
    for name in (
        "hypothesis",
        "matplotlib.pyplot",
        "netCDF4",
        "pytest",
        "scipy.signal",
        "scipy.stats",
        "xarray",
        "zarr",
    ):
        __import__(name)


def main() -> None:
    """Try the mutants and print what survived."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutation", description=__doc__.splitlines()[0])
    parser.add_argument("modules", nargs="*", help=f"of {', '.join(TARGETS)}; default all")
    parser.add_argument("--sample", type=int, default=60, help="largest number of mutants per module")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds that a mutant's tests may take")
    parser.add_argument("--out", type=Path, help="also write the result as JSON")
    chosen = parser.parse_args()
    outcomes = []
    with tempfile.TemporaryDirectory() as name:
        tree = Path(name) / "tree"
        wanted = shutil.ignore_patterns(".git", ".venv", "__pycache__", "*.zarr", "site")
        shutil.copytree(REPOSITORY, tree, ignore=wanted, symlinks=True)
        _load()
        for module in chosen.modules or TARGETS:
            outcome = run_module(module, TARGETS[module], tree, chosen.sample, chosen.seed, chosen.timeout)
            outcomes.append(outcome)
            print(_line(outcome), flush=True)
    killed, survived = sum(one.killed for one in outcomes), sum(len(one.survivors) for one in outcomes)
    print(f"all: {killed} killed of {killed + survived}, {100 * killed / max(killed + survived, 1):.0f} %")
    if chosen.out:
        chosen.out.write_text(json.dumps([_content(one) for one in outcomes], indent=1) + "\n", "utf-8")


def _line(outcome: Outcome) -> str:
    tried = outcome.killed + len(outcome.survivors)
    left = f", {outcome.left_out} not tried" if outcome.left_out else ""
    return f"{outcome.module}: {outcome.killed} killed of {tried}, {100 * outcome.fraction:.0f} %{left}"


def _content(outcome: Outcome) -> dict[str, object]:
    survivors = [{"line": one.line, "before": one.before, "after": one.after} for one in outcome.survivors]
    return {"module": outcome.module, "killed": outcome.killed, "survivors": survivors, "not_tried": outcome.left_out}


if __name__ == "__main__":
    main()
