"""Solution of several windows at a time, one in each lane of the processor's vector registers.

Profiles are independent of each other, but the windows of one profile depend on each other: the outcome of a window
determines where the next one begins and how long it is. If windows start from a given path, they depend on each other
in no other way. The windows that will probably follow are then solved ahead of time, and a further profile is taken
only when these do not fill the lanes. A window that was predicted wrongly is dropped. A solution depends neither on its
lane nor on the windows in the other lanes. When only a few profiles are left whose further windows cannot be predicted,
their windows are solved one by one, without lanes.
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
    PosedWindow,
    ProfileProblem,
    ProfileSolution,
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
    LaneProgress,
    Problem,
    allocate,
    load_window,
    read_window,
)
from gliderhpc.kernels.quasi_newton import run_until_done
from gliderhpc.outcomes import Outcome

Key = TypeVar("Key")
Run = Callable[[Problem, Descent, LaneProgress], None]
"""Function that evaluates and decides until a lane is done, such as `run_until_done`."""


_STEPS_ALONE = 2000
"""Number of steps in all lanes together, per profile, beyond which profiles are solved as fast one by one.

With long windows the lanes wait for memory, and for the longest window among them.
"""

MAX_WINDOWS_AHEAD = 2 * LANES
"""Largest number of windows of a profile that are predicted after its next one."""


class LaneBatch:
    """Batch of `LANES` windows, or of one window if `alone`, solved with the settings' tolerance, limit and history.

    Only the kernels of `run_until_done` can solve a single window.
    """

    def __init__(self, settings: EstimationSettings, run: Run = run_until_done, *, alone: bool = False) -> None:
        self._run, self._settings, self._alone = run, settings, alone
        self._problem, self._descent, self._progress = self._allocated(1)
        self._tasks: list[WindowTask | None] = [None] * len(self._progress.status)

    def load(self, lane: int, task: WindowTask) -> None:
        """Load a window into a lane; `run` solves it."""
        data, start = task
        self._tasks[lane] = task
        self._extend(len(data.bodies))
        load_window(
            self._problem, self._descent, self._progress, lane, data.hull, data.bodies,
            # Always contiguous: for a column of a matrix the kernel would be compiled again.
            np.ascontiguousarray(data.state0), data.measurements, data.weights, data.step, data.scale, start,
            self._settings.tolerance * data.step, data.iteration_limit(self._settings),
        )  # fmt: skip

    def _allocated(self, steps: int) -> tuple[Problem, Descent, LaneProgress]:
        return allocate(steps, self._settings.optimizer.history, alone=self._alone)

    def _extend(self, steps: int) -> None:
        """Enlarge the memory for a longer window; windows in progress continue, padded with steps of no duration."""
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
            (lane, self._read(lane)) for lane, status in enumerate(self._progress.status.tolist()) if status >= ENDED
        ]

    def drop(self, lane: int) -> None:
        """Leave the window in a lane unsolved."""
        self._progress.status[lane] = IDLE
        self._tasks[lane] = None

    def _read(self, lane: int) -> WindowSolution:
        task, progress = self._tasks[lane], self._progress
        assert task is not None
        data, start = task
        evaluations = int(progress.evaluations[lane])
        unflyable = progress.status[lane] == UNFLYABLE
        self.drop(lane)
        if unflyable:
            no_states = np.empty((0, 10))
            return WindowSolution(start, no_states, float("nan"), float("nan"), 0, evaluations, Outcome.DIVERGED)
        disturbances, states = np.empty((len(data.bodies), 6)), np.empty((len(data.bodies) + 1, 10))
        read_window(self._problem, lane, disturbances, states)
        norm, iterations = float(progress.norm[lane] / data.step), int(progress.iterations[lane])
        outcome = outcome_of(norm, iterations, data, self._settings)
        return WindowSolution(disturbances, states, float(progress.value[lane]), norm, iterations, evaluations, outcome)


@dataclass(eq=False)
class _ProfileInProgress(Generic[Key]):
    """A profile whose windows are being solved.

    Attributes
    ----------
    key
        The caller's key of the profile.
    problem, sequence : ProfileProblem, generator
        The profile, and the generator of its windows.
    pending : list of PosedWindow
        The next window and those predicted after it, except those already solved; empty at the end.
    solved : dict
        Solutions of windows that were solved ahead of time, by `PosedWindow.identity`.
    below_threshold : bool
        Whether the cost of the last window was below its threshold, from which the next windows are predicted.
    seconds : float
        Computing time so far.
    solution : ProfileSolution, optional
        Solution of the whole profile, once it is complete.
    """

    key: Key
    problem: ProfileProblem
    sequence: Generator[PosedWindow, WindowSolution, ProfileSolution] = field(init=False)
    pending: list[PosedWindow] = field(default_factory=list)
    solved: dict[tuple[int, WindowPlan], WindowSolution] = field(default_factory=dict)
    below_threshold: bool = True
    seconds: float = 0.0
    solution: ProfileSolution | None = None

    def __post_init__(self) -> None:
        self.sequence = window_sequence(self.problem)
        self._predict(self._next(None))

    def add(self, window: PosedWindow, solution: WindowSolution) -> None:
        """Add a window's solution, and join to the profile all windows that are solved."""
        self.solved[window.identity] = solution
        next_window = self.pending[0] if self.pending else None
        while next_window is not None and next_window.identity in self.solved:
            joined = self.solved.pop(next_window.identity)
            self.below_threshold = bool(joined.cost < next_window.plan.cost_threshold)
            next_window = self._next(joined)
        self._predict(next_window)

    def _next(self, solution: WindowSolution | None) -> PosedWindow | None:
        try:
            return next(self.sequence) if solution is None else self.sequence.send(solution)
        except StopIteration as stop:
            self.solution = replace(stop.value, seconds=self.seconds)
            return None

    def _predict(self, window: PosedWindow | None) -> None:
        """Set the next window and predict those after it; solutions of windows before it are discarded."""
        self.pending = []
        if window is None:
            return
        self.solved = {identity: solution for identity, solution in self.solved.items() if identity[0] >= window.begin}
        ahead = windows_ahead(self.problem, window, below_threshold=self.below_threshold)
        predicted = chain([window], islice(ahead, MAX_WINDOWS_AHEAD))
        self.pending = [candidate for candidate in predicted if candidate.identity not in self.solved]

    @property
    def is_unpredictable(self) -> bool:
        """Return whether only the next window is known, since those after it start from its end."""
        return self.problem.path is None and len(self.pending) == 1


_Lanes = dict[int, tuple[_ProfileInProgress[Key], PosedWindow]]


def solve_in_lanes(
    profiles: Iterable[tuple[Key, ProfileProblem]], settings: EstimationSettings, run: Run = run_until_done
) -> Iterator[tuple[Key, ProfileSolution]]:
    """Solve profiles side by side with the kernels of ``run``; yield each solution when it is complete."""
    batch, waiting = LaneBatch(settings, run), iter(profiles)
    active: list[_ProfileInProgress[Key]] = []
    lanes: _Lanes[Key] = {}
    while True:
        _take_profiles(active, waiting)
        if run is run_until_done and _are_too_few_for_lanes(active):
            _finish_alone(active[0], settings)
        else:
            _occupy(batch, lanes, active)
            if lanes:
                _run(batch, lanes)
        # Of a profile that has ended, only the results remain in memory while the next one is posed.
        ended = [(profile.key, profile.solution) for profile in active if profile.solution is not None]
        active = [profile for profile in active if profile.solution is None]
        _release(batch, lanes)
        yield from ended
        if not active and not ended:
            return


def _are_too_few_for_lanes(profiles: list[_ProfileInProgress[Key]]) -> bool:
    """Return whether there are profiles, but too few of them for a gain by lanes: only their next windows are known."""
    longest = max((profile.problem.plan.length for profile in profiles), default=0)
    limit = max(1, LANES * longest // _STEPS_ALONE)
    return 0 < len(profiles) <= limit and all(profile.is_unpredictable for profile in profiles)


def _take_profiles(active: list[_ProfileInProgress[Key]], waiting: Iterator[tuple[Key, ProfileProblem]]) -> None:
    """Take no more profiles than fill the lanes with their windows, since each of them occupies memory."""
    while sum(len(profile.pending) for profile in active) < LANES and (posed := next(waiting, None)) is not None:
        active.append(_ProfileInProgress(*posed))


def _release(batch: LaneBatch, lanes: _Lanes[Key]) -> None:
    """Drop the windows of profiles that have ended."""
    for lane, (profile, _) in list(lanes.items()):
        if profile.solution is not None:
            batch.drop(lane)
            del lanes[lane]


def _finish_alone(profile: _ProfileInProgress[Key], settings: EstimationSettings) -> None:
    """Solve the windows of one of the last profiles one by one, without lanes."""
    batch = LaneBatch(settings, alone=True)
    while profile.pending:
        window, began = profile.pending[0], time.perf_counter()
        batch.load(0, window.task)
        ((_, solution),) = batch.run()
        profile.seconds += time.perf_counter() - began
        profile.add(window, solution)


def _run(batch: LaneBatch, lanes: _Lanes[Key]) -> None:
    """Continue until a window is solved, and give solutions and computing time to their profiles."""
    began = time.perf_counter()
    solved = batch.run()
    share = (time.perf_counter() - began) / len(lanes)
    for profile, _ in lanes.values():
        profile.seconds += share
    for lane, solution in solved:
        profile, window = lanes.pop(lane)
        profile.add(window, solution)


def _occupy(batch: LaneBatch, lanes: _Lanes[Key], profiles: list[_ProfileInProgress[Key]]) -> None:
    """Load every profile's next window into a lane, then predicted ones, profile by profile; drop all other windows."""
    upcoming = [(profile, window) for profile in profiles for window in profile.pending[:1]]
    predicted = [(profile, window) for profile in profiles for window in profile.pending[1:]]
    chosen = {(id(profile), window.identity): (profile, window) for profile, window in (upcoming + predicted)[:LANES]}
    for lane, (profile, window) in list(lanes.items()):
        if chosen.pop((id(profile), window.identity), None) is None:
            batch.drop(lane)
            del lanes[lane]
    free = iter([lane for lane in range(LANES) if lane not in lanes])
    for profile, window in chosen.values():
        lane = next(free)
        batch.load(lane, window.task)
        lanes[lane] = (profile, window)
