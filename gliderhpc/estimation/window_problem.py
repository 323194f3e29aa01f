"""One window's optimal-tracking problem: cost and gradient as functions of the scaled disturbance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels import window as kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.quasi_newton import MAX_PITCH, MAX_SPEED2
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WindowData:
    """Data of a window.

    Attributes
    ----------
    hull : Hull
        Constants of the hull.
    bodies : (n, 11)
        Mass properties a step.
    state0 : (10,)
        Sensed state at the start.
    measurements : (n+1, 4)
        ``[phi, theta, psi, Z]``, rad and m.
    weights : (n+1,)
        0 in gaps.
    step : float
        h, s.
    scale : (6,)
        s of the control-variable transform ``b = s x`` (ones: none).
    """

    hull: Hull
    bodies: Array
    state0: Array
    measurements: Array
    weights: Array
    step: float
    scale: Array


@dataclass(frozen=True, eq=False)
class WindowSolution:
    """Solution of a window.

    Attributes
    ----------
    disturbances : (n, 6)
        b*, N and N m.
    states : (n+1, 10)
        Sensed states under b*.
    cost : float
        J of eq. 28.
    gradient_norm : float
        Optimality measure ``max |s g|`` with the continuous gradient ``g = (1/h) dJ/db``.
    iterations, evaluations : int
        Of the optimiser; of cost and gradient together.
    outcome : Outcome
        How it ended.
    """

    disturbances: Array
    states: Array
    cost: float
    gradient_norm: float
    iterations: int
    evaluations: int
    outcome: Outcome


class WindowProblem:
    """Evaluates cost and gradient in the scaled unknown ``x = b / s``, in buffers of its own."""

    def __init__(self, data: WindowData) -> None:
        self.data = data
        n = len(data.bodies)
        self.states = np.empty((n + 1, 10))
        self._tape = np.empty((n, kernel.TAPE))
        self._gradient = np.empty((n, 6))
        self._gradient_state0 = np.empty(10)
        self._cost = np.empty(1)
        self._state0 = np.ascontiguousarray(data.state0[None])
        self.evaluations = 0

    @property
    def gradient_norm(self) -> float:
        """Optimality measure at the last point evaluated."""
        return float(np.max(np.abs(self._gradient * self.data.scale)) / self.data.step)

    def disturbances(self, x: Array) -> Array:
        """The disturbance ``(n, 6)`` that the unknown ``x (6 n,)`` stands for."""
        return np.asarray(x.reshape(-1, 6) * self.data.scale)

    def evaluate(self, x: Array) -> tuple[float, Array]:
        """Cost and its gradient with respect to ``x``; the trajectory is left in ``states``."""
        data = self.data
        self.evaluations += 1
        kernel.cost_and_gradient(
            data.hull, data.bodies, self._state0, self.disturbances(x), data.measurements, data.weights, data.step,
            self.states, self._tape, self._gradient, self._gradient_state0, self._cost,
        )  # fmt: skip
        return float(self._cost[0]), (self._gradient * data.scale).ravel()

    def flyable(self) -> bool:
        """Return whether the last trajectory is finite and inside the model's domain."""
        return flyable(self.states)


def flyable(states: Array) -> bool:
    """Test whether states ``(n+1, 10)`` are finite and inside the model's domain (|pitch| < 89 deg, speed < 5 m/s)."""
    with np.errstate(over="ignore", invalid="ignore"):
        speed2 = (states[:, 4:7] ** 2).sum(axis=1)
    # NaN fails the comparisons, as it must.
    return bool((np.abs(states[:, 1]) < MAX_PITCH).all() and (speed2 < MAX_SPEED2).all() and np.isfinite(states).all())
