"""Windows slid along the dive, and their handover (section 4.3, eq. 38, Algorithm 1)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.outcomes import Outcome
from gliderhpc.estimation.window_problem import WindowData, WindowSolution
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import window as kernel
from gliderhpc.kernels.parameters import Hull

Array = NDArray[np.float64]
Solver = Callable[[WindowData, Array], WindowSolution]


@dataclass(frozen=True)
class WindowPlan:
    """Window length and margin in steps, and the cost (rad2 s) over which a window hands over directly."""

    length: int
    margin: int
    cost_threshold: float

    def most_windows(self, steps: int) -> int:
        """Count the windows of a profile in which every one is retracted."""
        return -(-steps // (self.length - self.margin)) + 1


@dataclass(frozen=True, eq=False)
class DiveProblem:
    """Everything the windows of one profile are solved from.

    Attributes
    ----------
    hull, bodies : Hull, (n, 11)
        Constants and mass properties.
    measurements, weights : (n+1, 4), (n+1,)
        Record on the steps, and 0 where it has gaps.
    step : float
        h, s.
    scale : (6,)
        s of the control-variable transform.
    start : (n, 6)
        Disturbance that the windows start from.
    fallback : (n, 6)
        Disturbance that stands where a window fails: the filter's.
    filter_states : (n+1, 12)
        Where to go on after a failed window.
    shaken : (n+1,)
        The vibration set.
    """

    hull: Hull
    bodies: Array
    measurements: Array
    weights: Array
    step: float
    scale: Array
    start: Array
    fallback: Array
    filter_states: Array
    shaken: NDArray[np.bool_]


@dataclass(frozen=True)
class WindowRecord:
    """What is kept of one window: first and last sample (the last exclusive for the disturbance), and how it went."""

    start: int
    stop: int
    cost: float
    iterations: int
    evaluations: int
    gradient_norm: float
    retracted: bool
    outcome: Outcome


@dataclass(frozen=True, eq=False)
class DiveSolution:
    """The dive put together.

    Attributes
    ----------
    disturbances : (n, 6)
        b*, N and N m.
    states : (n+1, 12)
        Reference trajectory under b*, zero drift: each sample from the window whose solution stands there.
    windows : tuple of WindowRecord
        In the order solved.
    source : (n,)
        Number of the window whose solution stands at each step.
    """

    disturbances: Array
    states: Array
    windows: tuple[WindowRecord, ...]
    source: NDArray[np.int64]


def solve_dive(problem: DiveProblem, plan: WindowPlan, solve: Solver) -> DiveSolution:
    """Solve every window in turn and stitch the solutions (Algorithm 1).

    A window whose cost stays under the threshold and whose end lies outside the vibration set is retracted: the next
    one starts a margin earlier, from the state there, and replaces the overlap. A window that fails leaves the filter's
    disturbance over its span, and the next one starts from the filter's state.
    """
    n = len(problem.bodies)
    disturbances, states = problem.fallback.copy(), np.empty((n + 1, 12))
    states[0] = problem.filter_states[0]
    source = np.zeros(n, dtype=np.int64)
    records: list[WindowRecord] = []
    begin = 0
    while begin < n:
        end = min(begin + plan.length, n)
        solution = _solve_span(problem, states[begin], begin, end, solve)
        if solution.outcome.usable:
            disturbances[begin:end] = solution.disturbances
            states[begin + 1 : end + 1] = _with_track(problem, states[begin], disturbances, begin, end)
        else:
            disturbances[begin:end] = problem.fallback[begin:end]
            states[begin + 1 : end + 1] = _filter_track(problem, states[begin], begin, end)
        source[begin:end] = len(records)
        retracted = bool(
            end < n
            and solution.outcome.usable
            and solution.cost < plan.cost_threshold
            and not problem.shaken[end]
            and plan.margin > 0
        )
        records.append(
            WindowRecord(
                begin,
                end,
                solution.cost,
                solution.iterations,
                solution.evaluations,
                solution.gradient_norm,
                retracted,
                solution.outcome,
            )
        )
        begin = end - plan.margin if retracted else end
    return DiveSolution(disturbances, states, tuple(records), source)


def _solve_span(problem: DiveProblem, state: Array, begin: int, end: int, solve: Solver) -> WindowSolution:
    weights = problem.weights[begin : end + 1]
    start = problem.start[begin:end]
    if not weights[1:].any():
        nowhere = np.empty((0, 10))
        return WindowSolution(start, nowhere, float("nan"), float("nan"), 0, 0, Outcome.NO_DATA)
    data = WindowData(
        problem.hull, problem.bodies[begin:end], state[SENSED], problem.measurements[begin : end + 1], weights,
        problem.step, problem.scale,
    )  # fmt: skip
    return solve(data, start)


def _with_track(problem: DiveProblem, state: Array, disturbances: Array, begin: int, end: int) -> Array:
    """States after ``state`` under the stitched disturbance, X and Y included."""
    trajectory = np.empty((end - begin + 1, 12))
    kernel.simulate(problem.hull, problem.bodies[begin:end], state, disturbances[begin:end], problem.step, trajectory)
    return trajectory[1:]


def _filter_track(problem: DiveProblem, state: Array, begin: int, end: int) -> Array:
    """The filter's states over a failed window, its horizontal track carried on from where the dive stands."""
    trajectory = problem.filter_states[begin + 1 : end + 1].copy()
    trajectory[:, 3:5] += state[3:5] - problem.filter_states[begin, 3:5]
    return trajectory
