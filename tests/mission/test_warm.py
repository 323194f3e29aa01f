"""Compilation before workers start: two processes compile the kernels that a run uses."""

import ast
import json
import subprocess
from importlib import import_module

import pytest
from support.programs import python
from support.repository import REPOSITORY

from gliderhpc.kernels.cache import compiled_cache
from gliderhpc.kernels.compiler import KernelDispatcher
from gliderhpc.mission import warm

PACKAGE = REPOSITORY / "gliderhpc"

LIST_SIGNATURES = """
import json, sys
from gliderhpc.mission.precompile import used_signatures
from gliderhpc.mission import warm
getattr(warm, sys.argv[1])()
print(json.dumps([(module, name, str(types)) for module, name, types in used_signatures()]))
"""

pytestmark = pytest.mark.compiled


def signatures(function: str) -> set[tuple[str, str, str]]:
    """Return the signatures of the kernels that a function of `warm` calls, in a separate process."""
    done = python(LIST_SIGNATURES, function, GLIDERHPC_CACHE=compiled_cache().parent)
    return {tuple(one) for one in json.loads(done.stdout)}


@pytest.mark.long
def test_the_background_process_compiles_all_smoother_kernels_of_a_run() -> None:
    whole, aside = signatures("warm_kernels"), signatures("warm_smoother")
    assert aside <= whole
    smoothers = {one for one in whole if "smoother" in one[0] or "sensitivity" in one[0]}
    assert smoothers
    assert smoothers <= aside


def kernels_called() -> set[tuple[str, str]]:
    """Return module and name of the kernels that the program's modules outside `gliderhpc.kernels` mention."""
    found: set[tuple[str, str]] = set()
    for path in PACKAGE.rglob("*.py"):
        if path.is_relative_to(PACKAGE / "kernels"):
            continue
        tree = ast.parse(path.read_text("utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        modules = {}
        for node in imports:
            for alias in node.names:
                if node.module == "gliderhpc.kernels":
                    modules[alias.asname or alias.name] = f"gliderhpc.kernels.{alias.name}"
                elif (node.module or "").startswith("gliderhpc.kernels."):
                    found.add((str(node.module), alias.name))
        found |= {
            (modules[node.value.id], node.attr)
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules
        }
    return {one for one in found if isinstance(getattr(import_module(one[0]), one[1]), KernelDispatcher)}


@pytest.mark.long
def test_all_kernels_that_the_program_calls_are_precompiled() -> None:
    """From a wheel nothing need be compiled, whatever the water, the engine or the study."""
    called = kernels_called()
    assert {("gliderhpc.kernels.smoother", "run_path"), ("gliderhpc.kernels.points", "rhs")} <= called
    compiled = {(module, name) for module, name, _ in signatures("warm_everything")}
    # Around kernels in Fortran, which are compiled on the machine that uses them.
    assert called - compiled == {("gliderhpc.kernels.quasi_newton", "proceed")}


def test_warmed_kernels_count_as_compiled() -> None:
    """If it were not, every run would start another process."""
    warm.warm_kernels()
    assert warm.is_compiled()


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> list[subprocess.Popen[bytes]]:
    """Make `warm` find nothing compiled and two cores; return the list of the processes that it starts."""
    started: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *args, **kws):
            super().__init__(*args, **kws)
            started.append(self)

    monkeypatch.setattr(warm, "is_compiled", lambda: False)
    monkeypatch.setattr(warm, "default_workers", lambda: 2)
    monkeypatch.setattr(warm.subprocess, "Popen", Noted)
    return started


def test_the_block_waits_for_the_process(uncompiled: list[subprocess.Popen[bytes]]) -> None:
    with warm.compile_in_background("simulator"):
        assert len(uncompiled) == 1
    assert uncompiled[0].returncode == 0


def test_a_process_that_fails_costs_nothing(uncompiled: list[subprocess.Popen[bytes]]) -> None:
    with warm.compile_in_background("no such part"):
        pass
    assert uncompiled[0].returncode == 1


def test_a_block_that_fails_ends_the_process(uncompiled: list[subprocess.Popen[bytes]]) -> None:
    with pytest.raises(ZeroDivisionError), warm.compile_in_background("kernels"):
        raise ZeroDivisionError
    assert uncompiled[0].returncode not in (None, 0)


def test_nothing_is_started_where_all_is_compiled_or_on_one_core(
    uncompiled: list[subprocess.Popen[bytes]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warm, "default_workers", lambda: 1)
    with warm.compile_in_background("kernels"):
        pass
    monkeypatch.setattr(warm, "default_workers", lambda: 2)
    monkeypatch.setattr(warm, "is_compiled", lambda: True)
    with warm.compile_in_background("kernels"):
        pass
    assert uncompiled == []
