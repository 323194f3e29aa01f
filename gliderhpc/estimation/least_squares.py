"""Least squares with errors that are correlated within clusters: weights, covariances, undetermined directions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import MAD_TO_STD

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
    clusters = [cluster == number for number in np.unique(cluster)]
    parts = [(jacobian[rows].T @ jacobian[rows], jacobian[rows].T @ residuals[rows]) for rows in clusters]
    return _scatter_of_moves(jacobian.T @ jacobian, parts)


def _scatter_of_moves(normal: Array, parts: Sequence[tuple[Array, Array]]) -> Array:
    """Covariance ``(p, p)`` from the moves of an estimate when each of its parts is left out.

    Parameters
    ----------
    normal : (p, p)
        Matrix of the normal equations.
    parts : sequence of ((p, p), (p,))
        Terms of each part in this matrix and in the right-hand side.
    """
    # Pseudo-inverse: directions that one part alone determines cannot be judged by leaving it out.
    moves = np.array([solve_normal_equations(normal - matrix, score) for matrix, score in parts])
    return np.asarray((len(moves) - 1) / len(moves) * moves.T @ moves)


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
    return MAD_TO_STD * float(np.median(np.abs(residuals))) + least


def solve_normal_equations(normal: Array, score: Array) -> Array:
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
    profiles = [profile == number for number in np.unique(profile)]
    parts = [(stiffness * weighted[rows].T @ design[rows], weighted[rows].T @ residuals[rows]) for rows in profiles]
    scatter = _scatter_of_moves(normal, parts)
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
