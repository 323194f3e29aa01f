"""Windows slid along the dive, and their handover (section 4.3, eq. 38, Algorithm 1)."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.window_problem import WindowData, WindowSolution
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels import window as kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]
WindowTask = tuple[WindowData, Array]
"""A window and the disturbance ``(n, 6)`` to start from."""
Solver = Callable[[WindowData, Array], WindowSolution]

_LONGEST_WAIT = 64
"""Windows that converge, at most, before a longer one is tried again."""

_NO_DATA = WindowSolution(
    np.empty((0, 6)),
    np.empty((0, 10)),
    float("nan"),
    float("nan"),
    iterations=0,
    evaluations=0,
    outcome=Outcome.NO_DATA,
)  # fmt: skip


@dataclass(frozen=True)
class WindowPlan:
    """Lengths and thresholds by which windows are cut.

    Attributes
    ----------
    length, margin : int
        Window length and margin, steps.
    cost_threshold : float
        Cost (rad2 s) over which a window hands over directly.
    scale : tuple of 6 floats, optional
        s of the control-variable transform for this length; None for that of the problem.
    shorter : WindowPlan, optional
        Plan by which a window that does not converge is solved again.
    """

    length: int
    margin: int
    cost_threshold: float
    scale: tuple[float, ...] | None = None
    shorter: "WindowPlan | None" = None

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
    vibrating : (n+1,)
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
    vibrating: NDArray[np.bool_]


@dataclass(frozen=True)
class WindowRecord:
    """Record of one window: first and last sample (the last exclusive for the disturbance), and its outcome."""

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
    seconds : float
        Computing time, the dive's share of it where several are solved side by side.
    """

    disturbances: Array
    states: Array
    windows: tuple[WindowRecord, ...]
    source: NDArray[np.int64]
    seconds: float = 0.0


class _WindowLength:
    """Plan of the next window: shorter after one that does not converge, longer again after some that do.

    The longer plan is tried again after one window that converges, and after twice as many with every failure, so that
    a record on which long windows never converge costs little more than short windows alone.
    """

    def __init__(self, plan: WindowPlan) -> None:
        self.plan = plan
        self._longer: list[WindowPlan] = []
        self._wait, self._next_wait = 0, 1

    def shorten(self) -> bool:
        """Go over to the shorter plan, if there is one."""
        if self.plan.shorter is None:
            return False
        self._longer.append(self.plan)
        self.plan = self.plan.shorter
        self._wait, self._next_wait = self._next_wait, min(2 * self._next_wait, _LONGEST_WAIT)
        return True

    def count_converged(self) -> None:
        """Count a window that converged, and go over to the longer plan in due time."""
        if not self._longer:
            self._next_wait = 1
            return
        self._wait -= 1
        if self._wait <= 0:
            self.plan = self._longer.pop()


def window_sequence(problem: DiveProblem, plan: WindowPlan) -> Generator[WindowTask, WindowSolution, DiveSolution]:
    """Pose every window in turn and stitch the solutions that are sent back (Algorithm 1).

    A window whose cost stays under the threshold and whose end lies outside the vibration set is retracted: the next
    one starts a margin earlier, from the state there, and replaces the overlap. One that does not converge is solved
    again by the shorter plan, where there is one (`_WindowLength`): the depth that a force makes grows with the square
    of the time, so that a long window is the worse conditioned. A window that fails leaves the filter's disturbance
    over its span, and the next one starts from the filter's state.
    """
    n = len(problem.bodies)
    disturbances, states = problem.fallback.copy(), problem.filter_states[:, SENSED].copy()
    failed, source = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.int64)
    records: list[WindowRecord] = []
    begin, length = 0, _WindowLength(plan)
    while begin < n:
        plan = length.plan
        end = min(begin + plan.length, n)
        if problem.weights[begin + 1 : end + 1].any():
            solution = yield _task(problem, plan, states[begin], begin, end)
        else:
            solution = _NO_DATA
        if solution.outcome.unfinished and length.shorten():
            continue
        if solution.outcome.unfinished and _is_worse_than_filter(problem, plan, solution, begin, end):
            solution = replace(solution, outcome=Outcome.DIVERGED)
        usable = solution.outcome.usable
        disturbances[begin:end] = solution.disturbances if usable else problem.fallback[begin:end]
        states[begin + 1 : end + 1] = (
            solution.states[1:] if usable else problem.filter_states[begin + 1 : end + 1, SENSED]
        )
        failed[begin:end] = not usable
        source[begin:end] = len(records)
        retracted = bool(
            end < n
            and usable
            and solution.cost < plan.cost_threshold
            and not problem.vibrating[end]
            and plan.margin > 0
        )
        records.append(
            WindowRecord(
                begin, end, solution.cost, solution.iterations, solution.evaluations, solution.gradient_norm, retracted,
                solution.outcome,
            )
        )  # fmt: skip
        begin = end - plan.margin if retracted else end
        if solution.outcome == Outcome.CONVERGED:
            length.count_converged()
    return DiveSolution(disturbances, _with_track(problem, states, disturbances, failed), tuple(records), source)


def solve_dive(problem: DiveProblem, plan: WindowPlan, solve: Solver) -> DiveSolution:
    """Solve the windows of one dive, one after the other."""
    began = time.perf_counter()
    sequence = window_sequence(problem, plan)
    try:
        task = next(sequence)
        while True:
            task = sequence.send(solve(*task))
    except StopIteration as stop:
        solution: DiveSolution = stop.value
        return replace(solution, seconds=time.perf_counter() - began)


def _task(problem: DiveProblem, plan: WindowPlan, state: Array, begin: int, end: int) -> WindowTask:
    data = WindowData(
        problem.hull, problem.bodies[begin:end], state, problem.measurements[begin : end + 1],
        problem.weights[begin : end + 1], problem.step, problem.scale if plan.scale is None else np.array(plan.scale),
    )  # fmt: skip
    return data, problem.start[begin:end]


def _is_worse_than_filter(
    problem: DiveProblem, plan: WindowPlan, solution: WindowSolution, begin: int, end: int
) -> bool:
    """Test whether an unconverged window is over the threshold and follows the record worse than the filter."""
    rows = slice(begin + 1, end + 1)
    errors = problem.filter_states[rows][:, [0, 1, 2, 5]] - problem.measurements[rows]
    errors[:, 2] = np.arctan2(np.sin(errors[:, 2]), np.cos(errors[:, 2]))
    filtered = problem.step * float(problem.weights[rows] @ (errors**2).sum(axis=1))
    return not solution.cost <= max(plan.cost_threshold, filtered)


def _with_track(problem: DiveProblem, states: Array, disturbances: Array, failed: NDArray[np.bool_]) -> Array:
    """Twelve-state rows: the stitched states and the track that they lay, the filter's own where a window failed."""
    moves = np.empty((len(disturbances), 2))
    kernel.moves(problem.hull, problem.bodies, states, disturbances, problem.step, moves)
    moves[failed] = np.diff(problem.filter_states[:, 3:5], axis=0)[failed]
    trajectory = np.empty((len(states), 12))
    trajectory[:, SENSED] = states
    trajectory[0, 3:5] = problem.filter_states[0, 3:5]
    trajectory[1:, 3:5] = trajectory[0, 3:5] + np.cumsum(moves, axis=0)
    return trajectory
