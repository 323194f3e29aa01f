"""Least squares with errors that are correlated within clusters, and maximisation of a likelihood by Fisher scoring.

The functions for least squares give robust weights, covariances, and undetermined directions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction of the parameters, one of the Jacobian's right singular vectors.

    Attributes
    ----------
    singular_value : float
        Singular value of the Jacobian of normalised residuals: reciprocal of the direction's standard error.
    vector : (p,)
        Direction, of unit length.
    """

    singular_value: float
    vector: Array


def directions(jacobian: Array) -> tuple[Direction, ...]:
    """Directions of a Jacobian (n, p), the best determined first; the value is zero if no residual depends on one."""
    _, values, vectors = np.linalg.svd(np.vstack([jacobian, np.zeros((jacobian.shape[1],) * 2)]), full_matrices=False)
    return tuple(Direction(float(value), vector) for value, vector in zip(values, vectors, strict=True))


def jackknife_covariance(jacobian: Array, residuals: Array, cluster: NDArray[np.int64]) -> Array:
    """Covariance (p, p) of a least-squares estimate, robust to any correlation within clusters.

    Parameters
    ----------
    jacobian, residuals : (n, p), (n,)
        Jacobian and residuals at the estimate, with their weights.
    cluster : (n,)
        Number of the cluster of every residual; at least two clusters.

    Notes
    -----
    The delete-one-cluster jackknife of the linearised problem (CR3 of Bell and McCaffrey 2002):
    ``C = (G-1)/G sum_g d_g d_g^T``, where ``d_g = (J^T J - J_g^T J_g)^-1 J_g^T r_g`` is the move of the estimate when
    cluster g is left out. It is conservative where clusters are few.
    """
    information = jacobian.T @ jacobian
    numbers = np.unique(cluster)
    moves = []
    for number in numbers:
        own = cluster == number
        rest = information - jacobian[own].T @ jacobian[own]
        # Pseudo-inverse: directions that one cluster alone determines cannot be judged by leaving it out.
        moves.append(np.linalg.pinv(rest, hermitian=True) @ (jacobian[own].T @ residuals[own]))
    moved = np.array(moves)
    return np.asarray((len(numbers) - 1) / len(numbers) * moved.T @ moved)


def sensitivity(jacobian: Array, held: Array) -> Array:
    """Change (p, h) of an estimate (p,) per unit of the held parameters (h,)."""
    return np.asarray(-np.linalg.lstsq(jacobian, held, rcond=None)[0])


_TUKEY = 4.685


def biweights(residuals: Array, least: float) -> Array:
    """Tukey's biweights ``(n,)``, divided by the squared scale of the residuals, which is at least `least`."""
    scale = _scale(residuals, least)
    return np.asarray(np.maximum(1.0 - (residuals / (_TUKEY * scale)) ** 2, 0.0) ** 2 / scale**2)


def biweight_stiffness(residuals: Array, least: float) -> float:
    """Ratio of the mean curvature of Tukey's loss to the mean biweight: four fifths for normal residuals.

    The weights overestimate the curvature, because a residual that grows also loses weight (Huber 1981, section 7.6).
    Without this factor the errors of a robust estimate would be too small by the same factor.
    """
    squares = np.minimum((residuals / (_TUKEY * _scale(residuals, least))) ** 2, 1.0)
    return float(np.sum((1.0 - squares) * (1.0 - 5.0 * squares)) / np.sum((1.0 - squares) ** 2))


def _scale(residuals: Array, least: float) -> float:
    return 1.4826 * float(np.median(np.abs(residuals))) + least


def solved(normal: Array, score: Array) -> Array:
    """Least-squares solution of the normal equations, zero in undetermined directions."""
    return np.asarray(np.linalg.pinv(normal, hermitian=True) @ score)


def left_out_covariance(
    design: Array, weights: Array, residuals: Array, profile: NDArray[np.int64], prior: Array, stiffness: float = 1.0
) -> Array:
    """Covariance ``(p, p)`` of an estimate from its moves when one profile is left out, and from its prior.

    Parameters
    ----------
    design, weights, residuals : (n, p), (n,), (n,)
        Derivatives, weights and residuals at the estimate.
    profile : (n,)
        Number of the profile of every row.
    prior : (p,)
        Inverse variances of the prior. Its error is the same in every profile, and so it is included once.
    stiffness : float
        Value of `biweight_stiffness` if the weights are biweights.
    """
    weighted = design * weights[:, None]
    normal = stiffness * weighted.T @ design + np.diag(prior)
    moves = []
    for number in np.unique(profile):
        own = profile == number
        rest = normal - stiffness * weighted[own].T @ design[own]
        moves.append(solved(rest, weighted[own].T @ residuals[own]))
    count = len(moves)
    scatter = (count - 1) / count * np.array(moves).T @ np.array(moves)
    inverse = np.linalg.pinv(normal, hermitian=True)
    return np.asarray(scatter + inverse @ np.diag(prior) @ inverse)


def cluster_inflation(residuals: Array, cluster: NDArray[np.int64]) -> float:
    """Ratio of the variance of sums over clusters to that of sums of independent residuals; at least one.

    Parameters
    ----------
    residuals : (n,)
        Residuals in units of their scale.
    cluster : (n,) of int
        Number of the cluster of every residual.
    """
    _, index, count = np.unique(cluster, return_inverse=True, return_counts=True)
    scatter = float(np.mean(np.bincount(index, residuals) ** 2 / count))
    return max(scatter / max(float(np.mean(residuals**2)), np.finfo(float).tiny), 1.0)


Mask = NDArray[np.bool_]

DAMPINGS = (0.01, 1.0, 30.0, 1000.0)
"""Information added to each parameter, one value for each of the steps that a round tries."""

LONGEST_STEP = 2.0
"""Largest move of a parameter in a round."""


class Likelihood(Protocol):
    """A log-likelihood that costs less when evaluated at several points at once."""

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
    report: Callable[[float], None] = lambda _: None,
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
