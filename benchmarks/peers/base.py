"""Contenders, their verification before they are timed, and the check of their results.

Engines of this project and peers written with other tools are entries of one kind, so that one loop measures all.
"""

import importlib.util
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.windows import Window
from gliderhpc.estimation.engines import WindowProblem
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]
Value = tuple[float, Array]
"""Cost and gradient."""

Evaluator = Callable[[Array], Value]

MAX_DIFFERENCE = 1e-9
"""Relative difference of cost and gradient from the project's own beyond which a peer solves another problem."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Solution of one window by a contender: its unknown ``x (6 n,)`` and the iterations and evaluations it took."""

    x: Array
    iterations: int
    evaluations: int


@dataclass(frozen=True)
class Contender:
    """One way of solving windows.

    Attributes
    ----------
    name : str
        Key in the results.
    label : str
        Name in a table.
    prepare : callable
        Takes several windows; gives the function from an unknown each to cost and gradient (by ``x``) each.
    solve : callable
        Answers of several windows, each from its own start.
    settings : mapping
        What was chosen: tolerances, histories, flags; whatever repeats the figure.
    versions : mapping
        Of the tools it needs.
    batch : int
        Windows it takes at a time; its time is shared among them.
    gradient : callable, optional
        Gives the call to time for several windows' cost and gradient, where what `prepare` gives does more than the
        contender itself would (copies its answers out, for one).
    """

    name: str
    label: str
    prepare: Callable[[Sequence[Window]], Callable[[Sequence[Array]], list[Value]]]
    solve: Callable[[Sequence[Window]], list[Answer]]
    settings: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    batch: int = 1
    gradient: Callable[[Sequence[Window]], Callable[[], object]] | None = None


def one_at_a_time(
    name: str,
    label: str,
    evaluator: Callable[[Window], Evaluator],
    solve: Callable[[Window], Answer],
    settings: Mapping[str, Any],
    versions: Mapping[str, str],
) -> Contender:
    """Give the contender that takes one window after the other, from its functions of one window."""

    def prepare(windows: Sequence[Window]) -> Callable[[Sequence[Array]], list[Value]]:
        evaluators = [evaluator(window) for window in windows]
        return lambda points: [evaluate(x) for evaluate, x in zip(evaluators, points, strict=True)]

    return Contender(name, label, prepare, lambda windows: [solve(window) for window in windows], settings, versions)


@dataclass(frozen=True)
class Verdict:
    """An answer under the project's own measure: cost (eq. 28), ``max |s g|``, outcome."""

    cost: float
    gradient_norm: float
    outcome: Outcome


class UnavailableError(Exception):
    """Describe in one line what a peer lacks on this machine."""


def require(package: str) -> None:
    """Raise `UnavailableError` unless a package of the extra `bench` is there."""
    if importlib.util.find_spec(package) is None:
        raise UnavailableError(f"{package} is not installed; pip install 'gliderhpc[bench]'")


def require_compiler() -> None:
    """Raise `UnavailableError` unless gcc is there."""
    if shutil.which("gcc") is None:
        raise UnavailableError("no gcc on the path")


def relative_difference(contender: Contender, windows: Sequence[Window]) -> float:
    """Largest relative difference of a contender's costs and gradients from the project's, at start and beyond it.

    The gradient's is relative to the window's largest entry.
    """
    differences = []
    for points in (_starts(windows), _beyond(windows)):
        answers = contender.prepare(windows)(points)
        for window, x, (cost, gradient) in zip(windows, points, answers, strict=True):
            own_cost, own_gradient = WindowProblem(window.data).evaluate(x)
            differences += [abs(cost - own_cost) / own_cost, _relative(gradient, own_gradient)]
    # Unlike Python's, numpy's maximum does not lose a NaN.
    return float(np.max(differences))


def verify(contender: Contender, windows: Sequence[Window]) -> float:
    """Give `relative_difference`.

    Raises
    ------
    ValueError
        It exceeds `MAX_DIFFERENCE`: what such a contender takes is no answer to the same question.
    """
    difference = relative_difference(contender, windows)
    # NaN fails the comparison, as it must.
    if not difference < MAX_DIFFERENCE:
        raise ValueError(f"{contender.name} differs from the project's cost and gradient by {difference:.1e}")
    return difference


def judge(window: Window, answer: Answer, settings: EstimationSettings) -> Verdict:
    """Judge an answer as the scipy engine judges its own."""
    problem = WindowProblem(window.data)
    with np.errstate(over="ignore", invalid="ignore"):
        cost, _ = problem.evaluate(answer.x)
    norm = problem.gradient_norm
    if not (np.isfinite(cost) and problem.flyable()):
        outcome = Outcome.DIVERGED
    elif norm <= settings.tolerance:
        outcome = Outcome.CONVERGED
    elif answer.iterations >= settings.optimizer.max_iterations:
        outcome = Outcome.ITERATION_LIMIT
    else:
        outcome = Outcome.STALLED
    return Verdict(cost, norm, outcome)


def _starts(windows: Sequence[Window]) -> list[Array]:
    return [window.unknown for window in windows]


def _beyond(windows: Sequence[Window]) -> list[Array]:
    """Points away from the start, so that every channel and its derivatives take part."""
    away = 0.02 * np.sin(np.arange(windows[0].unknown.size))
    return [window.unknown + away for window in windows]


def _relative(ours: Array, theirs: Array) -> float:
    return float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs)))
