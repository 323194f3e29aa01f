"""Least squares on profiles whose errors hang together: outliers' weights, covariance by leaving profiles out."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TUKEY = 4.685


def biweights(residuals: Array, least: float) -> Array:
    """Tukey's biweights ``(n,)`` over the squared scale of the residuals, which is at least `least`."""
    scale = 1.4826 * float(np.median(np.abs(residuals))) + least
    return np.asarray(np.maximum(1.0 - (residuals / (_TUKEY * scale)) ** 2, 0.0) ** 2 / scale**2)


def solved(normal: Array, score: Array) -> Array:
    """Least-squares solution of the normal equations; directions that nothing tells stay where they are."""
    return np.asarray(np.linalg.pinv(normal, hermitian=True) @ score)


def left_out_covariance(
    design: Array, weights: Array, residuals: Array, profile: NDArray[np.int64], prior: Array
) -> Array:
    """Covariance ``(p, p)`` of an estimate by how far leaving one profile out moves it, and by its prior.

    Parameters
    ----------
    design, weights, residuals : (n, p), (n,), (n,)
        At the estimate.
    profile : (n,)
        Number of the profile of every row.
    prior : (p,)
        Inverse variances of what was known before; that is wrong in every profile alike, so it counts once.
    """
    weighted = design * weights[:, None]
    normal = weighted.T @ design + np.diag(prior)
    moves = []
    for number in np.unique(profile):
        own = profile == number
        rest = normal - weighted[own].T @ design[own]
        moves.append(solved(rest, weighted[own].T @ residuals[own]))
    count = len(moves)
    scatter = (count - 1) / count * np.array(moves).T @ np.array(moves)
    inverse = np.linalg.pinv(normal, hermitian=True)
    return np.asarray(scatter + inverse @ np.diag(prior) @ inverse)


def cluster_inflation(residuals: Array, cluster: NDArray[np.int64]) -> float:
    """By how much clusters' sums scatter more than those of independent residuals would, squared; at least one.

    Parameters
    ----------
    residuals : (n,)
        In units of their scale.
    cluster : (n,) of int
        Which of them belong together.
    """
    _, index, count = np.unique(cluster, return_inverse=True, return_counts=True)
    scatter = float(np.mean(np.bincount(index, residuals) ** 2 / count))
    return max(scatter / max(float(np.mean(residuals**2)), np.finfo(float).tiny), 1.0)
