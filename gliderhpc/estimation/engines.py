"""Engines that solve the windows: scipy, lanes and Fortran.

The scipy engine solves one window at a time. The lanes engine (`gliderhpc.estimation.lanes`) solves several, one in
each lane of the processor's vector registers. The Fortran engine is the lanes engine with cost and gradient from the
library that ``make fortran`` builds.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.joining import flyable
from gliderhpc.estimation.lanes import Key, solve_in_lanes
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.windows import (
    PosedWindow,
    ProfileProblem,
    ProfileSolution,
    StartingPath,
    WindowData,
    WindowSolution,
    outcome_of,
    pose_windows,
    solve_profile,
)
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import window as kernel
from gliderhpc.kernels.fortran.library import Library, LibraryError, load
from gliderhpc.kernels.lane_memory import Descent, LaneProgress, Problem
from gliderhpc.kernels.quasi_newton import proceed, run_until_done
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]


class WindowProblem:
    """Cost and gradient of a window in the scaled unknown ``x = b / s``, with buffers of its own."""

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
        """Disturbance ``(n, 6)`` of the unknown ``x (6 n,)``."""
        return np.asarray(x.reshape(-1, 6) * self.data.scale)

    def evaluate(self, x: Array) -> tuple[float, Array]:
        """Compute the cost and its gradient with respect to ``x``, and write the trajectory to ``states``."""
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


class _Objective:
    """Cost and gradient with a barrier where the trajectory cannot be flown, which shortens such a trial step.

    The barrier is a steep bowl about the best point so far. The line search finds a higher cost and an uphill slope,
    and interpolates back towards the flyable side. A point on the barrier is never returned.
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


def typical_starting_cost(problem: ProfileProblem, states: Array) -> float:
    """Median cost of whole windows at the start of their search, from the states ``(n+1, 12)`` of a path."""
    length, sensed = problem.plan.length, states[:, SENSED]
    costs = []
    for begin in range(0, len(problem.profile.bodies) - length + 1, length):
        data, start = PosedWindow(problem, begin, problem.plan, sensed[begin]).task
        with np.errstate(over="ignore", invalid="ignore"):
            cost, _ = WindowProblem(data).evaluate((start / data.scale).ravel())
        costs.append(cost if np.isfinite(cost) else np.inf)
    return float(np.median(costs)) if costs else np.inf


def solve_window(data: WindowData, start: Array, settings: EstimationSettings) -> WindowSolution:
    """Minimise one window's cost from the disturbance ``start (n, 6)``, N and N m.

    The iteration stops when ``max |s g|`` is within the preset's tolerance; only then has it converged.
    """
    problem = WindowProblem(data)
    x0 = (start / data.scale).ravel()
    with np.errstate(over="ignore", invalid="ignore"):
        cost0, gradient0 = problem.evaluate(x0)
    if not (np.isfinite(cost0) and np.isfinite(gradient0).all() and problem.flyable()):
        return WindowSolution(start, problem.states, float("nan"), float("nan"), 0, 1, Outcome.DIVERGED)
    objective, limit = _Objective(problem, x0, cost0), data.iteration_limit(settings)
    result: Any = scipy.optimize.minimize(
        objective,
        x0,
        jac=True,
        method="L-BFGS-B",
        options={
            "maxiter": limit,
            "maxfun": 20 * limit,
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
    is_valid = np.isfinite(cost) and problem.flyable()
    outcome = outcome_of(norm, iterations, problem.data, settings) if is_valid else Outcome.DIVERGED
    return WindowSolution(problem.disturbances(x), problem.states, cost, norm, iterations, evaluations, outcome)


def solve_profiles(
    profiles: Iterable[tuple[Key, ProfileProblem]], settings: EstimationSettings
) -> Iterator[tuple[Key, ProfileSolution]]:
    """Solve profiles with the engine of the settings; yield each solution with its key when it is complete.

    Parameters
    ----------
    profiles : iterable of (key, ProfileProblem)
        Profiles, taken one by one as they are needed.
    settings : EstimationSettings
        Settings with engine, tolerance and iteration limit.

    Raises
    ------
    InputError
        The engine cannot run on this machine.
    """
    if settings.engine == "scipy":
        solve = partial(solve_window, settings=settings)
        return ((key, solve_profile(problem, solve)) for key, problem in profiles)
    return solve_in_lanes(profiles, settings, FortranRun() if settings.engine == "fortran" else run_until_done)


def invert_windows(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, start: StartingPath | None = None
) -> ProfileSolution:
    """Solve the windows of one filtered profile (section 4.3), from a path if one is given."""
    ((_, solution),) = solve_profiles([(None, pose_windows(profile, filtered, settings, start))], settings)
    return solution


def check_engine(settings: EstimationSettings) -> None:
    """Refuse an engine that cannot run on this machine, before any computation.

    Raises
    ------
    InputError
        The Fortran library cannot be used on this machine.
    """
    if settings.engine == "fortran":
        fortran_library()


def fortran_library() -> Library:
    """Load the Fortran library.

    Raises
    ------
    InputError
        The library cannot be used on this machine; the message explains how to build it.
    """
    try:
        return load()
    except LibraryError as error:
        raise InputError(f"engine fortran: {error}") from None


class FortranRun:
    """Equivalent of `gliderhpc.kernels.quasi_newton.run_until_done` with evaluation by the Fortran library.

    Raises
    ------
    InputError
        The library cannot be used on this machine.
    """

    def __init__(self) -> None:
        self._library = fortran_library()
        self._problem: Problem | None = None
        self._evaluate: Callable[[], None] | None = None

    def __call__(self, problem: Problem, descent: Descent, progress: LaneProgress) -> None:
        """Evaluate and decide until a lane is done or no lane is active."""
        # The library's call is for one memory, which changes only when it grows.
        if self._evaluate is None or problem is not self._problem:
            self._problem, self._evaluate = problem, self._library.evaluation(problem)
        done = False
        while not done:
            self._evaluate()
            done = proceed(problem, descent, progress)
