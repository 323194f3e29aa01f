"""Windows of a dive: lengths, start and handover (section 4.3, eq. 38, Algorithm 1)."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.joining import JoinedWindows
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import USUAL_WINDOW, EstimationSettings
from gliderhpc.flight.glider import SENSED
from gliderhpc.kernels.parameters import Hull
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import DisturbancePrior

Array = NDArray[np.float64]
LATERAL = np.array([1, 3, 5])
"""Indices of sway, roll and yaw among the six channels."""

_SPLIT = 1.25
"""Length, in usual windows, beyond which windows that do not converge are halved."""

_LONGEST_WAIT = 64
"""Largest number of windows that must converge before a longer one is tried again."""


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
    errors[:, 2] = np.arctan2(np.sin(errors[:, 2]), np.cos(errors[:, 2]))
    return np.asarray(errors)


@dataclass(frozen=True)
class WindowPlan:
    """Lengths and thresholds of the windows.

    Attributes
    ----------
    length, margin : int
        Window length and margin, steps.
    cost_threshold : float
        Cost (rad2 s) from which on a window hands over without retraction.
    scale : tuple of 6 floats
        Scale s of the control-variable transform ``b = s x`` for this length, N and N m.
    shorter : WindowPlan, optional
        Plan with which a window that does not converge is solved again.
    """

    length: int
    margin: int
    cost_threshold: float
    scale: tuple[float, ...] = (1.0,) * 6
    shorter: "WindowPlan | None" = None

    def most_windows(self, steps: int) -> int:
        """Count the windows of a profile in which every one is retracted."""
        return -(-steps // (self.length - self.margin)) + 1


def plan_windows(settings: EstimationSettings, interval: float, prior: DisturbancePrior | None = None) -> WindowPlan:
    """Plan the windows of a record with a sample interval (s).

    The disturbance prior scales the unknowns. Without a prior there is neither a scale nor a shorter window. If the
    length is not set, windows of slow sensors may be halved until they are as short as those of fast ones.
    """
    lengths = [settings.window_length(interval)]
    while prior is not None and settings.window.length is None and lengths[-1] > _SPLIT * USUAL_WINDOW:
        lengths.append(max(0.5 * lengths[-1], USUAL_WINDOW))
    plan: WindowPlan | None = None
    for length in reversed(lengths):
        share = length / lengths[0]
        steps, margin = _whole_records(length, share * settings.window_margin(interval), settings)
        scale = np.ones(6) if prior is None else transform_scale(prior, length, settings)
        plan = WindowPlan(steps, margin, share * settings.cost_threshold(interval), tuple(scale.tolist()), plan)
    assert plan is not None
    return plan


def _whole_records(length: float, margin: float, settings: EstimationSettings) -> tuple[int, int]:
    """Length and margin (s) in steps, as whole output intervals, which makes windows start at stored records."""
    records = settings.steps_per_record
    steps = max(records, max(1, round(length / settings.step)) // records * records)
    return steps, min(round(margin / settings.step) // records * records, steps - records)


def transform_scale(prior: DisturbancePrior, length: float, settings: EstimationSettings) -> Array:
    """Scale ``s (6,)`` of the control-variable transform for a window length (s): set, from the prior, or ones."""
    if settings.optimizer.scale is not None:
        return np.array(settings.optimizer.scale)
    if not settings.transformed:
        return np.ones(6)
    share = np.minimum(1.0, 2.0 * length / np.array(prior.correlation_time))
    return np.array(prior.deviation) * np.sqrt(share)


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
class DiveProblem:
    """The inverse problem of one dive, whose windows are solved in turn.

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
        Sensed states of the path with that disturbance. Each window then starts from a state of the path, and windows
        are joined (`gliderhpc.estimation.joining`). Without it, each starts from the end of the previous window.
    """

    profile: PreparedProfile
    filtered: FilterEstimate
    start: Array
    plan: WindowPlan
    path: Array | None = None


class StartingPath(NamedTuple):
    """Path from which windows start: disturbance ``(n, 6)`` and the resulting states ``(n+1, 12)``."""

    disturbances: Array
    states: Array


def pose_windows(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings, start: StartingPath | None = None
) -> DiveProblem:
    """Pose the windows of a filtered profile; they start from the filter's disturbance if no path is given."""
    plan = plan_windows(settings, profile.series.sample_interval, filtered.prior)
    if start is None:
        return DiveProblem(profile, filtered, starting_disturbance(filtered, profile.series, settings), plan)
    return DiveProblem(profile, filtered, start.disturbances, plan, start.states[:, SENSED])


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
    """Solution of a dive, joined from its windows.

    Attributes
    ----------
    disturbances : (n, 6)
        Disturbances b*, N and N m.
    states : (n+1, 12)
        Reference trajectory under b*, zero drift.
    windows : tuple of WindowRecord
        Records of the windows, in the order in which they were solved.
    source : (n,)
        Number of the window whose solution is used at each step.
    seconds : float
        Computing time; the dive's share if several are solved side by side.
    from_path : bool
        Whether the windows started from a path.
    """

    disturbances: Array
    states: Array
    windows: tuple[WindowRecord, ...]
    source: NDArray[np.int64]
    seconds: float = 0.0
    from_path: bool = False


class _WindowLength:
    """Plan of the next window: shorter after one that does not converge, longer again after some that do.

    The longer plan is tried again after one window that converges, and after twice as many with every failure. A record
    on which long windows never converge therefore takes little more time than short windows alone.
    """

    def __init__(self, plan: WindowPlan) -> None:
        self.plan = plan
        self._longer: list[WindowPlan] = []
        self._wait, self._next_wait = 0, 1

    def shorten(self) -> bool:
        """Switch to the shorter plan; return whether there is one."""
        if self.plan.shorter is None:
            return False
        self._longer.append(self.plan)
        self.plan = self.plan.shorter
        self._wait, self._next_wait = self._next_wait, min(2 * self._next_wait, _LONGEST_WAIT)
        return True

    def count_converged(self) -> None:
        """Count a window that converged, and switch to the longer plan after enough of them."""
        if not self._longer:
            self._next_wait = 1
            return
        self._wait -= 1
        if self._wait <= 0:
            self.plan = self._longer.pop()


def window_sequence(problem: DiveProblem) -> Generator[WindowTask, WindowSolution, DiveSolution]:
    """Pose every window in turn and join the solutions that are sent back (Algorithm 1).

    A window is retracted if its cost is below the threshold and its end lies outside the vibration set: the next one
    starts a margin earlier, from the state there, and replaces the overlap (`JoinedWindows`). A window that does not
    converge is solved again with the shorter plan, if there is one (`_WindowLength`). The effect of a force on depth
    grows with the square of the time, and a long window is therefore worse conditioned. If a window fails, the filter's
    disturbance is used over its span, and the next window starts from the filter's state. Windows of a path start from
    the path's states instead.
    """
    profile, joined = problem.profile, JoinedWindows(problem.profile, problem.filtered, problem.path)
    n = len(profile.bodies)
    records: list[WindowRecord] = []
    begin, length = 0, _WindowLength(problem.plan)
    while begin < n:
        plan = length.plan
        end = min(begin + plan.length, n)
        if profile.series.weights[begin + 1 : end + 1].any():
            solution = yield _task(problem, plan, joined.state_at(begin), begin, end)
        else:
            solution = _NO_DATA
        if solution.outcome.unfinished and length.shorten():
            continue
        if solution.outcome.unfinished and _is_worse_than_filter(problem, plan, solution, begin, end):
            solution = replace(solution, outcome=Outcome.DIVERGED)
        usable = solution.outcome.usable
        if usable:
            joined.put(begin, len(records), solution.disturbances, solution.states)
        else:
            joined.put_filter(begin, end, len(records))
        retracted = bool(
            end < n
            and usable
            and solution.cost < plan.cost_threshold
            and not profile.vibrating[end]
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
    disturbances, states = joined.trajectory()
    return DiveSolution(disturbances, states, tuple(records), joined.source, from_path=problem.path is not None)


def solve_dive(problem: DiveProblem, solve: Solver) -> DiveSolution:
    """Solve the windows of one dive, one after the other."""
    began = time.perf_counter()
    sequence = window_sequence(problem)
    try:
        task = next(sequence)
        while True:
            task = sequence.send(solve(*task))
    except StopIteration as stop:
        solution: DiveSolution = stop.value
        return replace(solution, seconds=time.perf_counter() - began)


def _task(problem: DiveProblem, plan: WindowPlan, state: Array, begin: int, end: int) -> WindowTask:
    profile, series = problem.profile, problem.profile.series
    data = WindowData(
        profile.glider.hull,
        profile.bodies[begin:end],
        state,
        series.measurements[begin : end + 1],
        series.weights[begin : end + 1],
        series.step,
        np.array(plan.scale),
    )
    return data, problem.start[begin:end]


def _is_worse_than_filter(
    problem: DiveProblem, plan: WindowPlan, solution: WindowSolution, begin: int, end: int
) -> bool:
    """Return whether an unconverged window is over the threshold and follows the record worse than the filter."""
    series, rows = problem.profile.series, slice(begin + 1, end + 1)
    errors = misfit(problem.filtered.states[rows], series.measurements[rows])
    cost = series.step * float(series.weights[rows] @ (errors**2).sum(axis=1))
    return not solution.cost <= max(plan.cost_threshold, cost)
