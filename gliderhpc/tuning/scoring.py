"""Fisher scoring within bounds: a maximum of a log-likelihood whose expected information is known."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DAMPINGS = (0.01, 1.0, 30.0, 1000.0)
"""Information added to each parameter in the steps that are tried side by side."""

LONGEST_STEP = 2.0
"""Most that a parameter moves in a round."""


class Likelihood(Protocol):
    """A log-likelihood that is cheaper for several points at once."""

    def values(self, points: Sequence[Array]) -> list[float]:
        """Log-likelihoods of points ``(p,)``."""

    def expanded(self, point: Array, free: Mask) -> "Expansion":
        """Value, gradient and information in the free parameters."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """A log-likelihood about a point: its value, gradient ``(f,)`` and expected information ``(f, f)``."""

    value: float
    gradient: Array
    information: Array


@dataclass(frozen=True, eq=False)
class Maximum:
    """Result of scoring.

    Attributes
    ----------
    point : (p,)
        All parameters.
    expansion : Expansion
        About it, in the free ones.
    rounds : int
        Steps taken.
    settled : bool
        Whether no tried step gained more than the tolerance.
    """

    point: Array
    expansion: Expansion
    rounds: int
    settled: bool


def maximise(
    likelihood: Likelihood, start: Array, free: Mask, bounds: tuple[Array, Array], *, tolerance: float, max_rounds: int,
    report: Callable[[float], None] = lambda _: None,
) -> Maximum:  # fmt: skip
    """Climb to a maximum.

    Each round solves ``(information + damping) step = gradient`` with several dampings, cuts the steps at the bounds
    and takes the one that gains most.

    Parameters
    ----------
    likelihood : Likelihood
        The function.
    start : (p,)
        First point, inside the bounds.
    free : (p,) bool
        Parameters that may move.
    bounds : ((p,), (p,))
        Least and greatest values.
    tolerance : float
        A round that gains less is the last, and its step is not made.
    max_rounds : int
        Cap.
    report : callable
        Called with the log-likelihood of every round.
    """
    point, rounds = start.copy(), 0
    while True:
        expansion = likelihood.expanded(point, free)
        report(expansion.value)
        if rounds == max_rounds:
            return Maximum(point, expansion, rounds, settled=False)
        trials = _trials(point, free, expansion, bounds)
        values = likelihood.values(trials) if trials else []
        if not values or max(values) - expansion.value <= tolerance:
            return Maximum(point, expansion, rounds, settled=True)
        point = trials[int(np.argmax(values))]
        rounds += 1


def _trials(point: Array, free: Mask, expansion: Expansion, bounds: tuple[Array, Array]) -> list[Array]:
    low, high = (bound[free] for bound in bounds)
    here, gradient = point[free], expansion.gradient
    stuck = ((here <= low) & (gradient < 0.0)) | ((here >= high) & (gradient > 0.0))
    moving = np.flatnonzero(~stuck)
    trials = []
    for damping in DAMPINGS if len(moving) else ():
        information = expansion.information[np.ix_(moving, moving)] + damping * np.eye(len(moving))
        move = np.clip(np.linalg.solve(information, gradient[moving]), -LONGEST_STEP, LONGEST_STEP)
        there = here.copy()
        there[moving] = np.clip(here[moving] + move, low[moving], high[moving])
        trial = point.copy()
        trial[free] = there
        trials.append(trial)
    return trials
