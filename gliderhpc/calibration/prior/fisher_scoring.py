"""Maximisation of a log-likelihood within bounds by damped Fisher scoring."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DAMPINGS = (0.01, 1.0, 30.0, 1000.0)
"""Information added to each parameter, one value for each of the steps that a round tries."""

LONGEST_STEP = 2.0
"""Maximum move of a parameter in a round."""


class Likelihood(Protocol):
    """A log-likelihood that is cheaper to evaluate at several points at once."""

    def values(self, points: Sequence[Array]) -> list[float]:
        """Log-likelihoods of points ``(p,)``."""

    def expanded(self, point: Array, free: Mask) -> "Expansion":
        """Value, and gradient and information with respect to the free parameters."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """A log-likelihood about a point: its value, gradient ``(f,)`` and expected information ``(f, f)``."""

    value: float
    gradient: Array
    information: Array


@dataclass(frozen=True, eq=False)
class Maximum:
    """Result of `maximise`.

    Attributes
    ----------
    point : (p,)
        Values of all parameters.
    expansion : Expansion
        Expansion about that point, in the free parameters.
    rounds : int
        Number of steps taken.
    settled : bool
        Whether no tried step gained more than the tolerance.
    """

    point: Array
    expansion: Expansion
    rounds: int
    settled: bool


def maximise(
    likelihood: Likelihood,
    start: Array,
    free: Mask,
    bounds: tuple[Array, Array],
    *,
    tolerance: float,
    max_rounds: int,
    on_round: Callable[[float], None] = lambda _: None,
) -> Maximum:
    """Maximise a log-likelihood by damped Fisher scoring.

    Each round solves ``(information + damping) step = gradient`` with several dampings, cuts the steps at the bounds
    and takes the step with the largest gain.

    Parameters
    ----------
    likelihood : Likelihood
        The function.
    start : (p,)
        First point, inside the bounds.
    free : (p,) bool
        Parameters that may move.
    bounds : ((p,), (p,))
        Smallest and largest values.
    tolerance : float
        Gain of log-likelihood at or below which a round is the last; its step is not taken.
    max_rounds : int
        Largest number of steps.
    on_round : callable
        Called with the log-likelihood of every round.
    """
    point, rounds = start.copy(), 0
    while True:
        expansion = likelihood.expanded(point, free)
        on_round(expansion.value)
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
    start, gradient = point[free], expansion.gradient
    at_bound = ((start <= low) & (gradient < 0.0)) | ((start >= high) & (gradient > 0.0))
    moving = np.flatnonzero(~at_bound)
    trials = []
    for damping in DAMPINGS if len(moving) else ():
        information = expansion.information[np.ix_(moving, moving)] + damping * np.eye(len(moving))
        step = np.clip(np.linalg.solve(information, gradient[moving]), -LONGEST_STEP, LONGEST_STEP)
        end = start.copy()
        end[moving] = np.clip(start[moving] + step, low[moving], high[moving])
        trial = point.copy()
        trial[free] = end
        trials.append(trial)
    return trials
