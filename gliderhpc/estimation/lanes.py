"""Windows side by side, one in each lane of the processor's vector registers.

Dives are independent of each other. The windows of one dive are solved in turn, since where a window begins depends on
the previous one's outcome. If windows start from a given path, nothing else depends on it: the lanes then take the
windows that will probably follow as well, and another dive only when these do not fill them. A window that turns out to
begin elsewhere is dropped. A solution does not depend on its lane, its neighbours, or when it was found.
"""

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, islice, zip_longest
from typing import Generic, TypeVar

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.windows import (
    DiveProblem,
    DiveSolution,
    PosedWindow,
    WindowSolution,
    WindowTask,
    ended_as,
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
Run = Callable[[Problem, Descent, Progress, int], None]
"""Function that evaluates and decides, within an iteration limit, until a lane is done, such as `run_until_done`."""


FARTHEST = 2 * LANES
"""Number of windows after the next one that are considered for lanes that are free."""


class LaneBatch:
    """`LANES` windows solved in step, with the tolerance, iteration limit and history of the settings."""

    def __init__(self, settings: EstimationSettings, run: Run = run_until_done) -> None:
        self._run, self._settings = run, settings
        self._problem, self._descent, self._progress = allocate(1, settings.optimizer.history)
        self._tasks: list[WindowTask | None] = [None] * LANES

    def put(self, lane: int, task: WindowTask) -> None:
        """Put a window into a lane; `run` solves it."""
        data, start = task
        self._tasks[lane] = task
        self._make_room(len(data.bodies))
        load_window(
            self._problem, self._descent, self._progress, lane, data.hull, data.bodies,
            # Always contiguous: for a column of a matrix the kernel would be compiled again.
            np.ascontiguousarray(data.state0), data.measurements, data.weights, data.step, data.scale, start,
            self._settings.tolerance * data.step,
        )  # fmt: skip

    def _make_room(self, steps: int) -> None:
        """Grow the memory for a longer window; windows under way continue, with added steps of no duration."""
        if steps <= len(self._problem.bodies):
            return
        problem, descent, _ = allocate(steps, self._settings.optimizer.history)
        for new, old in zip((*problem, *descent), (*self._problem, *self._descent), strict=True):
            new[tuple(slice(0, length) for length in old.shape)] = old
        self._problem, self._descent = problem, descent

    def run(self) -> list[tuple[int, WindowSolution]]:
        """Continue until a window is solved; return finished lanes with their solutions, and leave them idle."""
        self._run(self._problem, self._descent, self._progress, self._settings.optimizer.max_iterations)
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
        outcome = ended_as(norm, iterations, self._settings)
        return WindowSolution(disturbances, states, float(progress.value[lane]), norm, iterations, evaluations, outcome)


@dataclass(eq=False)
class _DiveUnderWay(Generic[Key]):
    """A dive whose windows are being solved.

    Attributes
    ----------
    key
        The caller's name of the dive.
    problem, sequence : DiveProblem, generator
        The dive and its windows in turn.
    window : PosedWindow or None
        Window that comes next; None at the end.
    solved : dict
        Solutions of windows that come later, if they come, by the window's `PosedWindow.place`.
    below : bool
        Whether the last window was below the threshold of its cost, as the next ones will be expected to be.
    seconds : float
        Computing time so far.
    solution : DiveSolution, optional
        Solution of the whole dive, when there is one.
    """

    key: Key
    problem: DiveProblem
    sequence: Generator[PosedWindow, WindowSolution, DiveSolution] = field(init=False)
    window: PosedWindow | None = None
    solved: dict[tuple[int, int], WindowSolution] = field(default_factory=dict)
    below: bool = True
    seconds: float = 0.0
    solution: DiveSolution | None = None

    def __post_init__(self) -> None:
        self.sequence = window_sequence(self.problem)
        self._continue(None)

    def advance(self) -> None:
        """Join windows to the dive as long as they are solved."""
        while self.window is not None and self.window.place in self.solved:
            solution = self.solved.pop(self.window.place)
            self.below = bool(solution.cost < self.window.plan.cost_threshold)
            self._continue(solution)
        if self.window is not None:
            begin = self.window.begin
            self.solved = {place: solution for place, solution in self.solved.items() if place[0] >= begin}

    def _continue(self, solution: WindowSolution | None) -> None:
        try:
            self.window = next(self.sequence) if solution is None else self.sequence.send(solution)
        except StopIteration as stop:
            self.window, self.solution = None, replace(stop.value, seconds=self.seconds)

    def unsolved(self) -> Iterator[PosedWindow]:
        """Yield the next window, and those that will probably follow; none of them is solved."""
        if self.window is None:
            return
        ahead = windows_ahead(self.problem, self.window, below=self.below)
        for window in chain([self.window], islice(ahead, FARTHEST)):
            if window.place not in self.solved:
                yield window


def solve_in_lanes(
    dives: Iterable[tuple[Key, DiveProblem]], settings: EstimationSettings, run: Run = run_until_done
) -> Iterator[tuple[Key, DiveSolution]]:
    """Solve dives side by side with the kernels of ``run``; yield each solution when it is complete."""
    batch, waiting = LaneBatch(settings, run), iter(dives)
    at_work: list[_DiveUnderWay[Key]] = []
    lanes: dict[int, tuple[_DiveUnderWay[Key], PosedWindow]] = {}
    while True:
        for dive in [dive for dive in at_work if dive.solution is not None]:
            assert dive.solution is not None
            at_work.remove(dive)
            yield dive.key, dive.solution
        # As few dives as fill the lanes: each of them occupies memory.
        while _windows_at_hand(at_work) < LANES and (posed := next(waiting, None)) is not None:
            at_work.append(_DiveUnderWay(*posed))
        if not at_work:
            return
        _occupy(batch, lanes, at_work)
        began = time.perf_counter()
        solved = batch.run()
        share = (time.perf_counter() - began) / len(at_work)
        for dive in at_work:
            dive.seconds += share
        for lane, solution in solved:
            dive, window = lanes.pop(lane)
            dive.solved[window.place] = solution
        for dive in at_work:
            dive.advance()


def _windows_at_hand(dives: list[_DiveUnderWay[Key]]) -> int:
    """Count the windows that dives can put into lanes now, `LANES` of each at most."""
    return sum(1 for dive in dives for _ in islice(dive.unsolved(), LANES))


def _occupy(
    batch: LaneBatch, lanes: dict[int, tuple[_DiveUnderWay[Key], PosedWindow]], dives: list[_DiveUnderWay[Key]]
) -> None:
    """Put every dive's next window into a lane, then every dive's second, and so on; drop what is not among these."""
    ranks = zip_longest(*([(dive, window) for window in islice(dive.unsolved(), LANES)] for dive in dives))
    chosen = list(islice((entry for rank in ranks for entry in rank if entry is not None), LANES))
    places = {(id(dive), window.place) for dive, window in chosen}
    for lane, (dive, window) in list(lanes.items()):
        if (id(dive), window.place) not in places:
            batch.drop(lane)
            del lanes[lane]
    present = {(id(dive), window.place) for dive, window in lanes.values()}
    free = iter(lane for lane in range(LANES) if lane not in lanes)
    for dive, window in chosen:
        if (id(dive), window.place) not in present:
            lane = next(free)
            batch.put(lane, window.task)
            lanes[lane] = (dive, window)
