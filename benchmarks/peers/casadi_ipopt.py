"""CasADi with IPOPT, the interior-point solver with a limited-memory Hessian that the paper used."""

import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.base import (
    Answer,
    Contender,
    Evaluator,
    Value,
    one_at_a_time,
    require,
    require_compiler,
)
from benchmarks.peers.casadi_c import FLAGS, compiler_version
from benchmarks.peers.casadi_problem import once_for_all, parameters_of, symbolic_problem
from benchmarks.windows import Window
from gliderhpc.estimation.settings import EstimationSettings

Array = NDArray[np.float64]

SILENT = {
    "jit_cleanup": False,
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}

TUNING = {
    "calc_lam_p": False,
    "calc_lam_x": False,
    "no_nlp_grad": True,
    "ipopt.nlp_scaling_method": "none",
    "ipopt.limited_memory_aug_solver": "extended",
    "ipopt.limited_memory_max_history": 3,
    "ipopt.fast_step_computation": "yes",
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_scaling": 0,
    "ipopt.mumps_pivot_order": 0,
}
"""Settings that helped. Nearly all of IPOPT's time goes into the linear algebra of its limited-memory Hessian: the extended
augmented system, a factorisation without scaling or pivoting heuristics (the matrix is nearly diagonal) and a shorter
history make an iteration cheaper by more than the iterations that they add. Histories of 10 and 20, the line searches
``penalty`` and ``cg-penalty`` and the initialisation ``scalar2`` of the Hessian gained nothing on top."""


def stopping_rule(settings: EstimationSettings) -> dict[str, Any]:
    """Stop where the project's engines stop: ``max |dJ/dx| <= tolerance h``, or at the preset's iteration limit.

    Left at its own tolerance of 1e-8, IPOPT goes on to its own cap of 3,000 iterations: the problem is
    under-determined, and where to stop is part of it.
    """
    return {
        "ipopt.tol": settings.tolerance * settings.step,
        "ipopt.max_iter": settings.optimizer.max_iterations,
    }


def casadi_ipopt(settings: EstimationSettings) -> Contender:
    """Give the peer at IPOPT's default settings but for the stopping rule, or raise `UnavailableError`."""
    return _contender("casadi_ipopt", "CasADi + IPOPT, limited memory, defaults", stopping_rule(settings))


def casadi_ipopt_tuned(settings: EstimationSettings) -> Contender:
    """Give the peer with what helped (`TUNING`), or raise `UnavailableError`."""
    options = {**stopping_rule(settings), **TUNING}
    return _contender("casadi_ipopt_tuned", "CasADi + IPOPT, limited memory, tuned", options)


def _contender(name: str, label: str, options: Mapping[str, Any]) -> Contender:
    require("casadi")
    require_compiler()
    import casadi

    chosen = {
        "jit": True,
        "compiler": "shell",
        "jit_options": {"compiler": "gcc", "flags": list(FLAGS), "cleanup": False},
        "ipopt.hessian_approximation": "limited-memory",
        **options,
    }
    built = once_for_all(lambda window: _build(casadi, window, {**SILENT, **chosen}))
    return one_at_a_time(
        name,
        label,
        lambda window: _evaluator(casadi, built(window)[1], window),
        lambda window: _solve(built(window)[0], window),
        {**chosen, "jit_options": f"gcc {' '.join(FLAGS)}"},
        {"casadi": casadi.__version__, "ipopt": _ipopt_version(casadi), "gcc": compiler_version()},
    )


def _build(ca: Any, window: Window, options: Mapping[str, Any]) -> tuple[Any, Any]:
    """Build the solver, and its own compiled cost and gradient."""
    symbols = symbolic_problem(ca, window)
    here = os.getcwd()  # noqa: PTH109 - CasADi leaves what it compiles in the working directory
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            solver = ca.nlpsol("solver", "ipopt", {"x": symbols.x, "p": symbols.parameters, "f": symbols.cost}, options)
            return solver, solver.get_function("nlp_grad_f")
        finally:
            os.chdir(here)


def _solve(solver: Any, window: Window) -> Answer:
    result = solver(x0=window.unknown, p=parameters_of(window))
    counts = solver.stats()
    return Answer(np.array(result["x"]).ravel(), int(counts["iter_count"]), int(counts["n_call_nlp_grad_f"]))


def _evaluator(ca: Any, gradient: Any, window: Window) -> Evaluator:
    parameters = ca.DM(parameters_of(window))

    def evaluate(x: Array) -> Value:
        cost, slope = gradient(x, parameters)
        return float(cost), np.asarray(slope.full()).ravel()

    return evaluate


def _ipopt_version(ca: Any) -> str:
    """Version that CasADi ships, from its header."""
    header = Path(ca.__file__).parent / "include" / "coin-or" / "IpoptConfig.h"
    found = re.search(r'IPOPT_VERSION "([^"]+)"', header.read_text("utf-8")) if header.exists() else None
    return found.group(1) if found else f"as shipped with CasADi {ca.__version__}"
