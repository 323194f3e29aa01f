"""Engines of the project, one entry each: a new engine is one function and one line of `ENGINES`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numba
import numpy as np
import scipy
from numpy.typing import NDArray

from benchmarks.peers.base import Answer, Contender, Evaluator, Value, one_at_a_time
from benchmarks.peers.quasi_newton import options_of
from benchmarks.timing import groups_of
from benchmarks.windows import Window
from gliderhpc import Glider, __version__
from gliderhpc.estimation.engines import FortranRun, WindowProblem, solve_window
from gliderhpc.estimation.lanes import LaneBatch, Run
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profiles
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.windows import WindowSolution
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.fortran.library import LibraryError, load
from gliderhpc.kernels.lane_memory import Problem, allocate, load_window
from gliderhpc.kernels.quasi_newton import run_until_done
from gliderhpc.kernels.window import TAPE, cost_and_gradient
from gliderhpc.observations import ProfileSeries

Array = NDArray[np.float64]
Profiles = Callable[[Glider, Sequence[ProfileSeries]], object]
Evaluation = Callable[[Problem], Callable[[], None]]
"""Gives the call that evaluates the trials of a batch."""

STREAM = 12 * LANES
"""Windows that the lanes engine is given at a time: a lane goes on with the next, as it does along a dive."""


@dataclass(frozen=True)
class Engine:
    """An engine as it solves windows, and as it estimates whole profiles (filter, windows, forward run).

    Attributes
    ----------
    contender : Contender
        It as it solves windows.
    estimate : callable
        Whole profiles.
    at_a_time : int
        Profiles that it is meant to take at a time.
    """

    contender: Contender
    estimate: Profiles
    at_a_time: int = 1


def scipy_engine(settings: EstimationSettings) -> Engine:
    """Give the reference engine: scalar kernels about scipy's L-BFGS-B, one window at a time."""

    def evaluator(window: Window) -> Evaluator:
        return WindowProblem(window.data).evaluate

    def solve(window: Window) -> Answer:
        return _answer(window, solve_window(window.data, window.start, settings))

    contender = one_at_a_time(
        "scipy",
        "gliderhpc, engine scipy",
        evaluator,
        solve,
        options_of(settings, settings.step),
        {"gliderhpc": __version__, "scipy": scipy.__version__},
    )
    contender = replace(contender, gradient=_scalar_kernel)
    return Engine(contender, _estimating(settings.model_copy(update={"engine": "scipy"})))


def lanes_engine(settings: EstimationSettings) -> Engine:
    """Give the lanes engine: as many windows at a time as a vector register holds doubles."""
    return _in_lanes("lanes", settings, run_until_done, _by_numba, {"numba": numba.__version__}, {})


def fortran_engine(settings: EstimationSettings) -> Engine:
    """Give the Fortran engine: the lanes engine about the library's cost and gradient.

    Raises
    ------
    LibraryError
        The library cannot be used here.
    """
    library = load()
    return _in_lanes(
        "fortran", settings, FortranRun(), library.evaluation, {"gfortran": library.compiler}, {"flags": library.flags}
    )


def _in_lanes(
    name: str,
    settings: EstimationSettings,
    run: Run,
    evaluation: Evaluation,
    versions: Mapping[str, str],
    build: Mapping[str, str],
) -> Engine:
    contender = Contender(
        name,
        f"gliderhpc, engine {name} ({LANES} lanes)",
        partial(_lane_evaluator, evaluation),
        lambda windows: _solve_stream(windows, settings, run),
        options_of(settings, settings.step) | {"lanes": LANES, **build},
        {"gliderhpc": __version__, **versions},
        batch=STREAM,
        gradient=partial(_lane_kernel, evaluation),
    )
    return Engine(contender, _estimating(settings.model_copy(update={"engine": name})), at_a_time=LANES)


def _estimating(settings: EstimationSettings) -> Profiles:
    def estimate(glider: Glider, profiles: Sequence[ProfileSeries]) -> object:
        return list(estimate_profiles(((i, prepare_profile(glider, s)) for i, s in enumerate(profiles)), settings))

    return estimate


def _answer(window: Window, solution: WindowSolution) -> Answer:
    x = np.asarray((solution.disturbances / window.data.scale).ravel())
    return Answer(x, solution.iterations, solution.evaluations)


def _scalar_kernel(windows: Sequence[Window]) -> Callable[[], object]:
    """The kernel alone, on one window at its start."""
    data = windows[0].data
    n = len(data.bodies)
    return partial(
        cost_and_gradient, data.hull, data.bodies, data.state0[None], np.ascontiguousarray(windows[0].start),
        data.measurements, data.weights, data.step, np.empty((n + 1, 10)), np.empty((n, TAPE)), np.empty((n, 6)),
        np.empty(10), np.empty(1),
    )  # fmt: skip


def _lane_kernel(evaluation: Evaluation, windows: Sequence[Window]) -> Callable[[], object]:
    """The kernel alone, on `LANES` windows at their starts, as often as makes as many windows as there are.

    In the memory of one batch, as the engine does it.
    """
    once, rounds = evaluation(_lane_problem(windows[:LANES])), len(windows) // LANES

    def evaluate() -> None:
        for _ in range(rounds):
            once()

    return evaluate


def _by_numba(p: Problem) -> Callable[[], None]:
    return partial(
        cost_and_gradient, p.hull, p.bodies, p.state0, p.trial, p.measurements, p.weights, p.durations, p.states,
        p.tape, p.gradient, p.gradient_state0, p.cost,
    )  # fmt: skip


def _lane_evaluator(evaluation: Evaluation, windows: Sequence[Window]) -> Callable[[Sequence[Array]], list[Value]]:
    """Cost and gradient of windows, `LANES` at a time."""
    groups = [[windows[i] for i in group] for group in groups_of(len(windows), LANES)]
    problems = [_lane_problem(group) for group in groups]
    calls = [evaluation(problem) for problem in problems]

    def evaluate(points: Sequence[Array]) -> list[Value]:
        values: list[Value] = []
        for p, call, group in zip(problems, calls, groups, strict=True):
            mine = points[len(values) : len(values) + len(group)]
            x = np.stack(mine, axis=-1).reshape(-1, 6, len(group))
            p.trial[..., : len(group)] = x * p.scale[:, : len(group)]
            call()
            gradient = p.gradient * p.scale
            values += [(float(p.cost[0, lane]), gradient[..., lane].ravel()) for lane in range(len(group))]
        return values

    return evaluate


def _lane_problem(windows: Sequence[Window]) -> Problem:
    problem, descent, progress = allocate(max(len(window.data.bodies) for window in windows), 1)
    for lane, window in enumerate(windows):
        d = window.data
        load_window(
            problem, descent, progress, lane, d.hull, d.bodies, d.state0, d.measurements, d.weights, d.step, d.scale,
            window.start, 0.0, 1,
        )  # fmt: skip
    return problem


def _solve_stream(windows: Sequence[Window], settings: EstimationSettings, run: Run) -> list[Answer]:
    """Solve windows as lanes fall free."""
    batch, waiting = LaneBatch(settings, run), iter(enumerate(windows))
    answers: dict[int, Answer] = {}
    at_work: dict[int, int] = {}
    while True:
        for lane in range(LANES):
            if lane not in at_work and (posed := next(waiting, None)) is not None:
                at_work[lane], window = posed
                batch.load(lane, (window.data, window.start))
        if not at_work:
            return [answers[number] for number in range(len(windows))]
        for lane, solution in batch.run():
            number = at_work.pop(lane)
            answers[number] = _answer(windows[number], solution)


def _available() -> dict[str, Callable[[EstimationSettings], Engine]]:
    engines: dict[str, Callable[[EstimationSettings], Engine]] = {"lanes": lanes_engine, "scipy": scipy_engine}
    try:
        load()
    except LibraryError:
        return engines
    return engines | {"fortran": fortran_engine}


ENGINES = _available()
"""By name; Fortran's where it is built."""

REFERENCE = "scipy"
"""The engine whose time is one in every ratio."""
