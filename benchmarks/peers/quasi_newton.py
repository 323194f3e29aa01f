"""Scipy's L-BFGS-B about a peer's cost and gradient, with the settings of the scipy engine."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.peers.base import Answer, Evaluator
from benchmarks.windows import Window
from gliderhpc.estimation.settings import EstimationSettings

Array = NDArray[np.float64]

_STEEP = 1e30
"""Cost handed to the line search where a trial step's is not finite: it is shortened, as in the scipy engine."""


def options_of(settings: EstimationSettings, step: float) -> dict[str, Any]:
    """Options of L-BFGS-B: those of the scipy engine."""
    return {
        "maxiter": settings.optimizer.max_iterations,
        "maxfun": 20 * settings.optimizer.max_iterations,
        "maxcor": settings.optimizer.history,
        "gtol": settings.tolerance * step,
        "ftol": 0.0,
    }


def minimise(evaluate: Evaluator, window: Window, options: Mapping[str, Any]) -> Answer:
    """Minimise from the window's start."""
    result: Any = minimize(
        lambda x: _walled(*evaluate(x)), window.unknown, jac=True, method="L-BFGS-B", options=dict(options)
    )
    return Answer(np.asarray(result.x), int(result.nit), int(result.nfev))


def _walled(cost: float, gradient: Array) -> tuple[float, Array]:
    if np.isfinite(cost):
        return cost, gradient
    return _STEEP, np.zeros_like(gradient)
