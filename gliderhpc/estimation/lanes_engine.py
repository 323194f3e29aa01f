"""The lanes engine: windows of several dives at a time, one in each lane of the processor's vector registers.

Windows of one dive follow each other, but dives are independent. A lane takes a dive and solves its windows in turn; it
takes the next dive when that ends, so that all lanes are busy until no dive is left to start.
"""

import time
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.window_problem import WindowSolution
from gliderhpc.estimation.windows import DiveProblem, DiveSolution, WindowPlan, WindowTask, window_sequence
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
"""Evaluates and decides, within a cap on iterations, until a lane is done: `run_until_done`, or another of its kind."""


class LaneBatch:
    """`LANES` windows being solved in step, by settings that give tolerance, cap and history."""

    def __init__(self, settings: EstimationSettings, run: Run = run_until_done) -> None:
        self._run = run
        self._tolerance, self._history = settings.tolerance, settings.optimizer.history
        self._max_iterations = settings.optimizer.max_iterations
        self._problem, self._descent, self._progress = allocate(1, self._history)
        self._tasks: list[WindowTask | None] = [None] * LANES

    def put(self, lane: int, task: WindowTask) -> None:
        """Put a window into a lane; `run` solves it."""
        data, start = task
        self._tasks[lane] = task
        self._make_room(len(data.bodies))
        load_window(
            self._problem, self._descent, self._progress, lane, data.hull, data.bodies, data.state0, data.measurements,
            data.weights, data.step, data.scale, start, self._tolerance * data.step,
        )  # fmt: skip

    def _make_room(self, steps: int) -> None:
        """Grow the memory for a longer window; those under way go on behind steps of no duration."""
        if steps <= len(self._problem.bodies):
            return
        problem, descent, _ = allocate(steps, self._history)
        for new, old in zip((*problem, *descent), (*self._problem, *self._descent), strict=True):
            new[tuple(slice(0, length) for length in old.shape)] = old
        self._problem, self._descent = problem, descent

    def run(self) -> list[tuple[int, WindowSolution]]:
        """Go on until a window is solved; give the lanes that are done with their solutions, and leave those idle."""
        self._run(self._problem, self._descent, self._progress, self._max_iterations)
        return [
            (lane, self._take(lane)) for lane, status in enumerate(self._progress.status.tolist()) if status >= ENDED
        ]

    def _take(self, lane: int) -> WindowSolution:
        task, progress = self._tasks[lane], self._progress
        assert task is not None
        data, start = task
        evaluations = int(progress.evaluations[lane])
        unflyable = progress.status[lane] == UNFLYABLE
        progress.status[lane] = IDLE
        self._tasks[lane] = None
        if unflyable:
            nowhere = np.empty((0, 10))
            return WindowSolution(start, nowhere, float("nan"), float("nan"), 0, evaluations, Outcome.DIVERGED)
        disturbances, states = np.empty((len(data.bodies), 6)), np.empty((len(data.bodies) + 1, 10))
        read_window(self._problem, lane, disturbances, states)
        norm, iterations = float(progress.norm[lane] / data.step), int(progress.iterations[lane])
        if norm <= self._tolerance:
            outcome = Outcome.CONVERGED
        elif iterations >= self._max_iterations:
            outcome = Outcome.ITERATION_LIMIT
        else:
            outcome = Outcome.STALLED
        return WindowSolution(disturbances, states, float(progress.value[lane]), norm, iterations, evaluations, outcome)


@dataclass
class _UnderWay:
    """A dive in a lane: its windows to come, and the computing time that it has had."""

    key: Any
    sequence: Generator[WindowTask, WindowSolution, DiveSolution]
    seconds: float = 0.0


def solve_dives(
    dives: Iterable[tuple[Key, DiveProblem, WindowPlan]], settings: EstimationSettings, run: Run = run_until_done
) -> Iterator[tuple[Key, DiveSolution]]:
    """Solve many dives side by side; each is given with its key as it ends.

    Parameters
    ----------
    dives : iterable of (key, DiveProblem, WindowPlan)
        Taken one by one, as lanes fall free.
    settings : EstimationSettings
        How to solve.
    run : callable
        By which kernels.
    """
    batch, waiting = LaneBatch(settings, run), iter(dives)
    under_way: dict[int, _UnderWay] = {}
    while True:
        for lane in range(LANES):
            while lane not in under_way and (posed := next(waiting, None)) is not None:
                key, problem, plan = posed
                under_way[lane] = _UnderWay(key, window_sequence(problem, plan))
                ended = _advance(batch, lane, under_way[lane].sequence, None)
                if ended is not None:
                    del under_way[lane]
                    yield key, ended
        if not under_way:
            return
        began = time.perf_counter()
        solved = batch.run()
        share = (time.perf_counter() - began) / len(under_way)
        for dive in under_way.values():
            dive.seconds += share
        for lane, solution in solved:
            ended = _advance(batch, lane, under_way[lane].sequence, solution)
            if ended is not None:
                dive = under_way.pop(lane)
                yield dive.key, replace(ended, seconds=dive.seconds)


def _advance(
    batch: LaneBatch,
    lane: int,
    sequence: Generator[WindowTask, WindowSolution, DiveSolution],
    solution: WindowSolution | None,
) -> DiveSolution | None:
    """Send a solution and put the next window into the lane; the dive's solution when there is none."""
    try:
        batch.put(lane, next(sequence) if solution is None else sequence.send(solution))
    except StopIteration as stop:
        ended: DiveSolution = stop.value
        return ended
    return None
