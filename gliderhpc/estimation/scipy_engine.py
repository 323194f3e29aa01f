"""The reference engine: scipy's L-BFGS-B, one window at a time."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_problem import WindowData, WindowProblem, WindowSolution
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]


class _Objective:
    """Cost and gradient with a wall where the trajectory cannot be flown, so that such a trial step is shortened.

    The wall is a steep bowl about the best point so far: the line search sees a higher cost and an uphill slope, and
    interpolates back towards the flyable side. A point on the wall is never the one returned.
    """

    def __init__(self, problem: WindowProblem, start: Array, cost: float) -> None:
        self.problem = problem
        self.best_x, self.best_cost = start.copy(), cost

    def __call__(self, x: Array) -> tuple[float, Array]:
        with np.errstate(over="ignore", invalid="ignore"):
            cost, gradient = self.problem.evaluate(x)
        if np.isfinite(cost) and np.isfinite(gradient).all() and self.problem.flyable():
            if cost < self.best_cost:
                self.best_x, self.best_cost = x.copy(), cost
            return cost, gradient
        away = x - self.best_x
        stiffness = (1.0 + self.best_cost) / max(float(away @ away), 1e-300)
        return self.best_cost + 0.5 * stiffness * float(away @ away), stiffness * away


def solve_window(data: WindowData, start: Array, settings: EstimationSettings) -> WindowSolution:
    """Minimise one window's cost from the disturbance ``start (n, 6)``, N and N m.

    Stops when ``max |s g|`` is within the preset's tolerance, and counts as converged only then.
    """
    problem = WindowProblem(data)
    x0 = (start / data.scale).ravel()
    with np.errstate(over="ignore", invalid="ignore"):
        cost0, gradient0 = problem.evaluate(x0)
    if not (np.isfinite(cost0) and np.isfinite(gradient0).all() and problem.flyable()):
        return WindowSolution(start, problem.states, float("nan"), float("nan"), 0, 1, Outcome.DIVERGED)
    objective = _Objective(problem, x0, cost0)
    result: Any = scipy.optimize.minimize(
        objective,
        x0,
        jac=True,
        method="L-BFGS-B",
        options={
            "maxiter": settings.optimizer.max_iterations,
            "maxfun": 20 * settings.optimizer.max_iterations,
            "maxcor": settings.optimizer.history,
            "gtol": settings.tolerance * data.step,
            "ftol": 0.0,
        },
    )
    return _solution(problem, result.x, int(result.nit), settings)


def _solution(problem: WindowProblem, x: Array, iterations: int, settings: EstimationSettings) -> WindowSolution:
    evaluations = problem.evaluations
    cost, _ = problem.evaluate(x)
    norm = problem.gradient_norm
    if not (np.isfinite(cost) and problem.flyable()):
        outcome = Outcome.DIVERGED
    elif norm <= settings.tolerance:
        outcome = Outcome.CONVERGED
    elif iterations >= settings.optimizer.max_iterations:
        outcome = Outcome.ITERATION_LIMIT
    else:
        outcome = Outcome.STALLED
    return WindowSolution(problem.disturbances(x), problem.states, cost, norm, iterations, evaluations, outcome)
