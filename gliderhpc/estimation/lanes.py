"""Windows side by side, one in each lane of the processor's vector registers.

Dives are independent of each other. The windows of one dive are solved in turn, since the previous window's outcome
determines where a window begins and how long it is. If windows start from a given path, nothing else depends on it: the
lanes then take the windows that will probably follow as well, and another dive only when these do not fill them. A
window that turns out to be another one is dropped. A solution does not depend on its lane, its neighbours, or when it
was found. Where a few dives are left and no window after their next ones can be foreseen, each is solved alone, without
lanes.
"""

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from typing import Generic, TypeVar

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_plan import WindowPlan
from gliderhpc.estimation.windows import (
    DiveProblem,
    DiveSolution,
    PosedWindow,
    WindowSolution,
    WindowTask,
    outcome_of,
    window_sequence,
    windows_ahead,
)
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.lane_memory import (
    ENDED,
    IDLE,
    UNFLYABLE,
    Descent,
    Problem,
    Progress,
    allocate,
    load_window,
    read_window,
)
from gliderhpc.kernels.quasi_newton import run_until_done
from gliderhpc.outcomes import Outcome

Key = TypeVar("Key")
Run = Callable[[Problem, Descent, Progress], None]
"""Function that evaluates and decides until a lane is done, such as `run_until_done`."""


_STEPS_ALONE = 2000
"""Steps in all lanes together for each dive that is solved as fast without lanes.

Lanes with long windows wait for memory, and for the longest window among them.
"""

MAX_WINDOWS_AHEAD = 2 * LANES
"""Largest number of windows considered after the next one of a dive."""


class LaneBatch:
    """`LANES` windows solved in step, or one `alone`, with the tolerance, iteration limit and history of the settings.

    The kernels of `run_until_done` alone solve a window alone.
    """

    def __init__(self, settings: EstimationSettings, run: Run = run_until_done, *, alone: bool = False) -> None:
        self._run, self._settings, self._alone = run, settings, alone
        self._problem, self._descent, self._progress = self._allocated(1)
        self._tasks: list[WindowTask | None] = [None] * len(self._progress.status)

    def put(self, lane: int, task: WindowTask) -> None:
        """Put a window into a lane; `run` solves it."""
        data, start = task
        self._tasks[lane] = task
        self._extend(len(data.bodies))
        load_window(
            self._problem, self._descent, self._progress, lane, data.hull, data.bodies,
            # Always contiguous: for a column of a matrix the kernel would be compiled again.
            np.ascontiguousarray(data.state0), data.measurements, data.weights, data.step, data.scale, start,
            self._settings.tolerance * data.step, data.iteration_limit(self._settings),
        )  # fmt: skip

    def _allocated(self, steps: int) -> tuple[Problem, Descent, Progress]:
        return allocate(steps, self._settings.optimizer.history, alone=self._alone)

    def _extend(self, steps: int) -> None:
        """Grow the memory for a longer window; windows in progress continue, with added steps of no duration."""
        capacity = len(self._problem.bodies)
        if self._alone and steps != capacity:
            self._problem, self._descent, self._progress = self._allocated(steps)
        elif steps > capacity:
            problem, descent, _ = self._allocated(steps)
            for new, old in zip((*problem, *descent), (*self._problem, *self._descent), strict=True):
                new[tuple(slice(0, length) for length in old.shape)] = old
            self._problem, self._descent = problem, descent

    def run(self) -> list[tuple[int, WindowSolution]]:
        """Continue until a window is solved; return finished lanes with their solutions, and leave them idle."""
        self._run(self._problem, self._descent, self._progress)
        return [
            (lane, self._take(lane)) for lane, status in enumerate(self._progress.status.tolist()) if status >= ENDED
        ]

    def drop(self, lane: int) -> None:
        """Leave the window in a lane unsolved."""
        self._progress.status[lane] = IDLE
        self._tasks[lane] = None

    def _take(self, lane: int) -> WindowSolution:
        task, progress = self._tasks[lane], self._progress
        assert task is not None
        data, start = task
        evaluations = int(progress.evaluations[lane])
        unflyable = progress.status[lane] == UNFLYABLE
        self.drop(lane)
        if unflyable:
            nowhere = np.empty((0, 10))
            return WindowSolution(start, nowhere, float("nan"), float("nan"), 0, evaluations, Outcome.DIVERGED)
        disturbances, states = np.empty((len(data.bodies), 6)), np.empty((len(data.bodies) + 1, 10))
        read_window(self._problem, lane, disturbances, states)
        norm, iterations = float(progress.norm[lane] / data.step), int(progress.iterations[lane])
        outcome = outcome_of(norm, iterations, data, self._settings)
        return WindowSolution(disturbances, states, float(progress.value[lane]), norm, iterations, evaluations, outcome)


@dataclass(eq=False)
class _DiveInProgress(Generic[Key]):
    """A dive whose windows are being solved.

    Attributes
    ----------
    key
        The caller's name of the dive.
    problem, sequence : DiveProblem, generator
        The dive and its windows in turn.
    wanted : list of PosedWindow
        The next window and those expected after it, without those solved; empty at the end.
    solved : dict
        Solutions found ahead, by `PosedWindow.identity`.
    below_threshold : bool
        Whether the cost of the last window was below its threshold; the same is expected of the next ones.
    seconds : float
        Computing time so far.
    solution : DiveSolution, optional
        Solution of the whole dive, when there is one.
    """

    key: Key
    problem: DiveProblem
    sequence: Generator[PosedWindow, WindowSolution, DiveSolution] = field(init=False)
    wanted: list[PosedWindow] = field(default_factory=list)
    solved: dict[tuple[int, WindowPlan], WindowSolution] = field(default_factory=dict)
    below_threshold: bool = True
    seconds: float = 0.0
    solution: DiveSolution | None = None

    def __post_init__(self) -> None:
        self.sequence = window_sequence(self.problem)
        self._expect(self._next(None))

    def add(self, window: PosedWindow, solution: WindowSolution) -> None:
        """Add a window's solution, and join windows to the dive as long as they are solved."""
        self.solved[window.identity] = solution
        following = self.wanted[0] if self.wanted else None
        while following is not None and following.identity in self.solved:
            found = self.solved.pop(following.identity)
            self.below_threshold = bool(found.cost < following.plan.cost_threshold)
            following = self._next(found)
        self._expect(following)

    def _next(self, solution: WindowSolution | None) -> PosedWindow | None:
        try:
            return next(self.sequence) if solution is None else self.sequence.send(solution)
        except StopIteration as stop:
            self.solution = replace(stop.value, seconds=self.seconds)
            return None

    def _expect(self, window: PosedWindow | None) -> None:
        """Note the next window and those expected after it, and forget solutions of windows before it."""
        self.wanted = []
        if window is None:
            return
        self.solved = {of: solution for of, solution in self.solved.items() if of[0] >= window.begin}
        ahead = windows_ahead(self.problem, window, below_threshold=self.below_threshold)
        expected = chain([window], islice(ahead, MAX_WINDOWS_AHEAD))
        self.wanted = [each for each in expected if each.identity not in self.solved]

    @property
    def is_alone(self) -> bool:
        """Return whether only the next window is known, since those after it start from its end."""
        return self.problem.path is None and len(self.wanted) == 1


_Lanes = dict[int, tuple[_DiveInProgress[Key], PosedWindow]]


def solve_in_lanes(
    dives: Iterable[tuple[Key, DiveProblem]], settings: EstimationSettings, run: Run = run_until_done
) -> Iterator[tuple[Key, DiveSolution]]:
    """Solve dives side by side with the kernels of ``run``; yield each solution when it is complete."""
    batch, waiting = LaneBatch(settings, run), iter(dives)
    active: list[_DiveInProgress[Key]] = []
    lanes: _Lanes[Key] = {}
    while True:
        _take_dives(active, waiting)
        if run is run_until_done and _are_too_few_for_lanes(active):
            _finish_alone(active[0], settings)
        else:
            _occupy(batch, lanes, active)
            if lanes:
                _run(batch, lanes)
        # Only the results of a dive that has ended remain in memory while the next one is posed.
        ended = [(dive.key, dive.solution) for dive in active if dive.solution is not None]
        active = [dive for dive in active if dive.solution is None]
        _release(batch, lanes)
        yield from ended
        if not active and not ended:
            return


def _are_too_few_for_lanes(dives: list[_DiveInProgress[Key]]) -> bool:
    """Return whether dives, of which only the next window is known, are too few (at least one) to gain by lanes."""
    longest = max((dive.problem.plan.length for dive in dives), default=0)
    most = max(1, LANES * longest // _STEPS_ALONE)
    return 0 < len(dives) <= most and all(dive.is_alone for dive in dives)


def _take_dives(active: list[_DiveInProgress[Key]], waiting: Iterator[tuple[Key, DiveProblem]]) -> None:
    """Take dives until their windows fill the lanes; each of them occupies memory."""
    while sum(len(dive.wanted) for dive in active) < LANES and (posed := next(waiting, None)) is not None:
        active.append(_DiveInProgress(*posed))


def _release(batch: LaneBatch, lanes: _Lanes[Key]) -> None:
    """Drop the windows of dives that have ended."""
    for lane, (dive, _) in list(lanes.items()):
        if dive.solution is not None:
            batch.drop(lane)
            del lanes[lane]


def _finish_alone(dive: _DiveInProgress[Key], settings: EstimationSettings) -> None:
    """Solve the windows of one of the last dives one after the other, each without lanes."""
    batch = LaneBatch(settings, alone=True)
    while dive.wanted:
        window, began = dive.wanted[0], time.perf_counter()
        batch.put(0, window.task)
        ((_, solution),) = batch.run()
        dive.seconds += time.perf_counter() - began
        dive.add(window, solution)


def _run(batch: LaneBatch, lanes: _Lanes[Key]) -> None:
    """Continue until a window is solved, and give solutions and computing time to their dives."""
    began = time.perf_counter()
    solved = batch.run()
    share = (time.perf_counter() - began) / len(lanes)
    for dive, _ in lanes.values():
        dive.seconds += share
    for lane, solution in solved:
        dive, window = lanes.pop(lane)
        dive.add(window, solution)


def _occupy(batch: LaneBatch, lanes: _Lanes[Key], dives: list[_DiveInProgress[Key]]) -> None:
    """Put every dive's next window into a lane, then the windows ahead of the dives in turn; drop all others."""
    first = [(dive, window) for dive in dives for window in dive.wanted[:1]]
    ahead = [(dive, window) for dive in dives for window in dive.wanted[1:]]
    chosen = {(id(dive), window.identity): (dive, window) for dive, window in (first + ahead)[:LANES]}
    for lane, (dive, window) in list(lanes.items()):
        if chosen.pop((id(dive), window.identity), None) is None:
            batch.drop(lane)
            del lanes[lane]
    free = iter([lane for lane in range(LANES) if lane not in lanes])
    for dive, window in chosen.values():
        lane = next(free)
        batch.put(lane, window.task)
        lanes[lane] = (dive, window)
