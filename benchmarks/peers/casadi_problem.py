"""The window problem in CasADi: a scalar (SX) step, mapped over the window, in matrix (MX) unknowns.

Single shooting: the disturbance alone is unknown, as in the project's own problem.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.model import Functions, rk4
from benchmarks.windows import Window
from gliderhpc.kernels.parameters import Body

Array = NDArray[np.float64]

_STATES, _BODY, _SENSED = 10, 11, 4
HEADING = 2


@dataclass(frozen=True, eq=False)
class Symbols:
    """Unknown ``x (6 n)``, parameters as `parameters_of` packs them, and the cost as an expression of both."""

    x: Any
    parameters: Any
    cost: Any


def symbolic_problem(ca: ModuleType, window: Window) -> Symbols:
    """Build the cost of every window of this hull, length, step and scale; `ca` is the module casadi."""
    n, data = len(window.data.bodies), window.data
    x = ca.MX.sym("x", 6 * n)
    sizes = (_STATES, _BODY * n, _SENSED * n, n)
    parameters = ca.MX.sym("parameters", sum(sizes))
    y0, bodies, measured, weights = ca.vertsplit(parameters, [0, *np.cumsum(sizes).tolist()])
    b = ca.reshape(x, 6, n) * ca.repmat(ca.DM(data.scale), 1, n)
    states = _step(ca, window).mapaccum(n)(y0, b, ca.reshape(bodies, _BODY, n))
    misfit = states[:_SENSED, :] - ca.reshape(measured, _SENSED, n)
    turn = misfit[HEADING, :]
    turn -= 2.0 * np.pi * ca.floor(turn / (2.0 * np.pi) + 0.5)
    misfit = ca.vertcat(misfit[:HEADING, :], turn, misfit[HEADING + 1 :, :])
    cost = data.step * ca.dot(ca.repmat(ca.reshape(weights, 1, n), _SENSED, 1), misfit**2)
    return Symbols(x, parameters, cost)


def parameters_of(window: Window) -> Array:
    """Pack what differs from window to window, in the order of `symbolic_problem`."""
    data = window.data
    return np.concatenate([data.state0, data.bodies.ravel(), data.measurements[1:].ravel(), data.weights[1:]])


def once_for_all(build: Callable[[Window], Any]) -> Callable[[Window], Any]:
    """Build at the first window and use the result for every one like it (same hull, length, step and scale)."""
    built: dict[tuple[Any, ...], Any] = {}

    def of(window: Window) -> Any:
        data = window.data
        key = (data.hull, len(data.bodies), data.step, *data.scale.tolist())
        if key not in built:
            built[key] = build(window)
        return built[key]

    return of


def _step(ca: ModuleType, window: Window) -> Any:
    y, b, body = ca.SX.sym("y", _STATES), ca.SX.sym("b", 6), ca.SX.sym("body", _BODY)
    functions = Functions(ca.sin, ca.cos, ca.atan2, ca.sqrt)
    new = rk4(
        functions, window.data.hull, Body(*ca.vertsplit(body)), ca.vertsplit(y), ca.vertsplit(b), window.data.step
    )
    return ca.Function("step", [y, b, body], [ca.vertcat(*new)])
