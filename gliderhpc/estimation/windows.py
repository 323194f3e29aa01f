"""Windows of a profile: where each starts, and the handover from one to the next (section 4.3, Algorithm 1)."""

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.angles import principal_angle
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.joining import JoinedWindows
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_plan import WindowLength, WindowPlan, plan_windows
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Hull
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]
LATERAL = np.array([1, 3, 5])
"""Indices of sway, roll and yaw among the six channels."""


@dataclass(frozen=True, eq=False)
class WindowData:
    """Data of a window.

    Attributes
    ----------
    hull : Hull
        Constants of the hull.
    bodies : (n, 11)
        Mass properties at each step.
    state0 : (10,)
        Sensed state at the start.
    measurements : (n+1, 4)
        Measurements ``[phi, theta, psi, Z]``, rad and m.
    weights : (n+1,)
        Weights of the samples; 0 in gaps.
    step : float
        Step h, s.
    scale : (6,)
        Scale s of the control-variable transform ``b = s x`` (ones: none).
    halves_early : bool
        Whether a third of the iterations are enough before the window is solved again with half the length.
    """

    hull: Hull
    bodies: Array
    state0: Array
    measurements: Array
    weights: Array
    step: float
    scale: Array
    halves_early: bool = False

    def iteration_limit(self, settings: EstimationSettings) -> int:
        """Largest number of iterations: a third of the usual one for a long window that may be halved."""
        limit = settings.optimizer.max_iterations
        return max(1, limit // 3) if self.halves_early else limit


@dataclass(frozen=True, eq=False)
class WindowSolution:
    """Solution of a window.

    Attributes
    ----------
    disturbances : (n, 6)
        Disturbances b*, N and N m.
    states : (n+1, 10)
        Sensed states under b*.
    cost : float
        Cost J of eq. 28.
    gradient_norm : float
        Optimality measure ``max |s g|`` with the continuous gradient ``g = (1/h) dJ/db``.
    iterations, evaluations : int
        Number of iterations of the optimiser, and of joint evaluations of cost and gradient.
    outcome : Outcome
        Outcome of the solution.
    """

    disturbances: Array
    states: Array
    cost: float
    gradient_norm: float
    iterations: int
    evaluations: int
    outcome: Outcome


WindowTask = tuple[WindowData, Array]
"""A window and the disturbance ``(n, 6)`` to start from."""
Solver = Callable[[WindowData, Array], WindowSolution]


def outcome_of(norm: float, iterations: int, data: WindowData, settings: EstimationSettings) -> Outcome:
    """Return the outcome of a solution that can be flown, with its optimality measure and number of iterations."""
    if norm <= settings.tolerance:
        return Outcome.CONVERGED
    return Outcome.ITERATION_LIMIT if iterations >= data.iteration_limit(settings) else Outcome.STALLED


_NO_DATA = WindowSolution(
    np.empty((0, 6)),
    np.empty((0, 10)),
    float("nan"),
    float("nan"),
    iterations=0,
    evaluations=0,
    outcome=Outcome.NO_DATA,
)


def misfit(states: Array, measurements: Array) -> Array:
    """States ``(n, 12)`` less measurements ``(n, 4)``: roll, pitch, heading (rad, wrapped) and depth (m)."""
    errors = states[:, [0, 1, 2, 5]] - measurements
    errors[:, 2] = principal_angle(errors[:, 2])
    return np.asarray(errors)


def starting_disturbance(filtered: FilterEstimate, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Disturbance ``(n, 6)`` at the start of the windows: the filter's, with zero or slow lateral channels."""
    start = filtered.disturbances[:-1].copy()
    if not settings.transformed:
        start[:, LATERAL] = 0.0
        return start
    width = round(max(settings.slow_part, 30.0 * series.sample_interval) / settings.step)
    start[:, LATERAL] = scipy.ndimage.uniform_filter1d(
        start[:, LATERAL], size=min(width, len(start)) | 1, axis=0, mode="nearest"
    )
    return start


@dataclass(frozen=True, eq=False)
class ProfileProblem:
    """The inverse problem of one profile, which is solved window by window.

    Attributes
    ----------
    profile : PreparedProfile
        Record, hull and vibration set.
    filtered : FilterEstimate
        Fallback if a window fails: disturbance over the window, and state from which the next window starts.
    start : (n, 6)
        Disturbance from which the windows start, N and N m.
    plan : WindowPlan
        Lengths and thresholds of the windows.
    path : (n+1, 10), optional
        Sensed states of the path with that disturbance. If it is given, each window starts from a state of the path,
        and the solutions are joined (`gliderhpc.estimation.joining`); if not, each starts from the end of the previous
        window.
    from_smoothed : bool
        Whether the disturbance from which the windows start is the smoother's.
    """

    profile: PreparedProfile
    filtered: FilterEstimate
    start: Array
    plan: WindowPlan
    path: Array | None = None
    from_smoothed: bool = False

    @cached_property
    def samples_before(self) -> NDArray[np.int64]:
        """Number of samples with a weight in the rows before each row ``(n+2,)``."""
        return np.concatenate([[0], np.cumsum(self.profile.series.weights != 0.0)])


class StartingPath(NamedTuple):
    """Path from which windows start: disturbance ``(n, 6)`` and the resulting states ``(n+1, 12)``."""

    disturbances: Array
    states: Array


def pose_windows(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, start: StartingPath | None = None
) -> ProfileProblem:
    """Pose the windows of a filtered profile; they start from the filter's disturbance if no path is given.

    Windows of a slow record take only the disturbance from the path, and each starts from the end of the previous one.
    The path's states are farther from the record than that end, and a search from them takes more iterations. Many
    windows are halved too, so that those that were solved ahead from the path would be dropped.
    """
    plan = plan_windows(settings, profile.series.sample_interval, filtered.prior)
    if start is None:
        return ProfileProblem(profile, filtered, starting_disturbance(filtered, profile.series, settings), plan)
    path = None if profile.is_slow else start.states[:, SENSED]
    return ProfileProblem(profile, filtered, start.disturbances, plan, path, from_smoothed=True)


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
class ProfileSolution:
    """Solution of a profile, joined from its windows.

    Attributes
    ----------
    disturbances : (n, 6)
        Disturbances b*, N and N m.
    states : (n+1, 12)
        Reference trajectory under b*, zero drift.
    windows : tuple of WindowRecord
        Records of the windows, in the order in which they were joined.
    source : (n,)
        Number of the window whose solution is used at each step.
    seconds : float
        Computing time, s; the profile's share if several are solved at the same time.
    from_smoothed : bool
        Whether the windows started from the smoother's disturbance.
    """

    disturbances: Array
    states: Array
    windows: tuple[WindowRecord, ...]
    source: NDArray[np.int64]
    seconds: float = 0.0
    from_smoothed: bool = False


@dataclass(frozen=True, eq=False)
class PosedWindow:
    """A window of a profile, to be solved: first step, plan, and the sensed state ``(10,)`` from which it starts."""

    problem: ProfileProblem
    begin: int
    plan: WindowPlan
    state: Array

    @property
    def identity(self) -> tuple[int, WindowPlan]:
        """First step and plan, which identify a window of a given path."""
        return self.begin, self.plan

    @property
    def task(self) -> WindowTask:
        """Data of the window, and the disturbance from which it starts."""
        problem, profile = self.problem, self.problem.profile
        series, steps = profile.series, slice(self.begin, min(self.begin + self.plan.length, len(profile.bodies)))
        rows = slice(steps.start, steps.stop + 1)
        data = WindowData(
            profile.glider.hull,
            profile.bodies[steps],
            self.state,
            series.measurements[rows],
            series.weights[rows],
            series.step,
            np.array(self.plan.scale),
            self.plan.halves_early,
        )
        return data, problem.start[steps]


def window_sequence(problem: ProfileProblem) -> Generator[PosedWindow, WindowSolution, ProfileSolution]:
    """Pose every window in turn and join the solutions that are sent back (Algorithm 1).

    A window is retracted if its cost is below the threshold and its end lies outside the vibration set: the next one
    starts a margin earlier, from the state there, and replaces the overlap (`JoinedWindows`). A window that does not
    converge is solved again with the shorter plan, if there is one (`WindowLength`). The effect of a force on depth
    grows with the square of the time, and a long window is therefore worse conditioned. If a window fails, the filter's
    disturbance is used over its span, and the next window starts from the filter's state. Windows of a path start from
    the path's states instead.
    """
    joined, n = JoinedWindows(problem.profile, problem.filtered, problem.path), len(problem.profile.bodies)
    records: list[WindowRecord] = []
    begin, length = 0, WindowLength(problem.plan)
    while begin < n:
        plan = length.plan
        end = min(begin + plan.length, n)
        if _has_data(problem, begin, end):
            solution = yield PosedWindow(problem, begin, plan, joined.state_at(begin))
        else:
            solution = _NO_DATA
        if solution.outcome.unfinished and length.shorten():
            continue
        if solution.outcome.unfinished and _is_worse_than_filter(problem, plan, solution, begin, end):
            solution = replace(solution, outcome=Outcome.DIVERGED)
        usable = solution.outcome.usable
        if usable:
            joined.add(begin, len(records), solution.disturbances, solution.states)
        else:
            joined.add_filter(begin, end, len(records))
        retracted = usable and solution.cost < plan.cost_threshold and _may_retract(problem, plan, end)
        records.append(
            WindowRecord(
                begin, end, solution.cost, solution.iterations, solution.evaluations, solution.gradient_norm, retracted,
                solution.outcome,
            )
        )  # fmt: skip
        begin = end - plan.margin if retracted else end
        if solution.outcome == Outcome.CONVERGED:
            length.count_converged()
    disturbances, states = joined.trajectory()
    return ProfileSolution(disturbances, states, tuple(records), joined.source, from_smoothed=problem.from_smoothed)


def windows_ahead(problem: ProfileProblem, window: PosedWindow, *, below_threshold: bool) -> Iterator[PosedWindow]:
    """Predict the windows after a given one.

    All are assumed to have its plan, and a cost below the threshold if `below_threshold`, else above it. Nothing can be
    predicted if windows start from the end of the previous one.
    """
    if problem.path is None:
        return
    n, plan, begin = len(problem.profile.bodies), window.plan, window.begin
    while (end := min(begin + plan.length, n)) < n:
        begin = (
            end - plan.margin
            if below_threshold and _has_data(problem, begin, end) and _may_retract(problem, plan, end)
            else end
        )
        end = min(begin + plan.length, n)
        if _has_data(problem, begin, end):
            yield PosedWindow(problem, begin, plan, problem.path[begin])


def _has_data(problem: ProfileProblem, begin: int, end: int) -> bool:
    return bool(problem.samples_before[end + 1] > problem.samples_before[begin + 1])


def _may_retract(problem: ProfileProblem, plan: WindowPlan, end: int) -> bool:
    """Return whether a window that ends at this step is retracted if it is usable and its cost is small."""
    return bool(end < len(problem.profile.bodies) and not problem.profile.vibrating[end] and plan.margin > 0)


def solve_profile(problem: ProfileProblem, solve: Solver) -> ProfileSolution:
    """Solve the windows of one profile one by one."""
    began = time.perf_counter()
    sequence = window_sequence(problem)
    try:
        window = next(sequence)
        while True:
            window = sequence.send(solve(*window.task))
    except StopIteration as stop:
        solution: ProfileSolution = stop.value
        return replace(solution, seconds=time.perf_counter() - began)


def _is_worse_than_filter(
    problem: ProfileProblem, plan: WindowPlan, solution: WindowSolution, begin: int, end: int
) -> bool:
    """Return whether an unconverged window is above the threshold and fits the record worse than the filter does."""
    series, rows = problem.profile.series, slice(begin + 1, end + 1)
    errors = misfit(problem.filtered.states[rows], series.measurements[rows])
    cost = series.step * float(series.weights[rows] @ (errors**2).sum(axis=1))
    return not solution.cost <= max(plan.cost_threshold, cost)
