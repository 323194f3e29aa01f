"""What a least-squares fit determines: errors robust to correlation within clusters, and directions it does not see."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Direction:
    """A direction of the parameters, one of the Jacobian's right singular vectors.

    Attributes
    ----------
    singular_value : float
        Of the Jacobian of normalised residuals: reciprocal of the direction's standard error.
    vector : (p,)
        Unit length.
    """

    singular_value: float
    vector: Array


def directions(jacobian: Array) -> tuple[Direction, ...]:
    """Directions of a Jacobian (n, p), the best determined first; those that no residual sees have value zero."""
    _, values, vectors = np.linalg.svd(np.vstack([jacobian, np.zeros((jacobian.shape[1],) * 2)]), full_matrices=False)
    return tuple(Direction(float(value), vector) for value, vector in zip(values, vectors, strict=True))


def jackknife_covariance(jacobian: Array, residuals: Array, cluster: NDArray[np.int64]) -> Array:
    """Covariance (p, p) of a least-squares estimate, robust to any correlation within clusters.

    Parameters
    ----------
    jacobian, residuals : (n, p), (n,)
        At the estimate, weights applied.
    cluster : (n,)
        To which cluster a residual belongs; at least two of them.

    Notes
    -----
    The delete-one-cluster jackknife of the linearised problem (CR3 of Bell and McCaffrey 2002):
    ``C = (G-1)/G sum_g d_g d_g^T`` with ``d_g = (J^T J - J_g^T J_g)^-1 J_g^T r_g`` what leaving out cluster g moves. It
    stays on the safe side where clusters are few.
    """
    information = jacobian.T @ jacobian
    numbers = np.unique(cluster)
    moves = []
    for number in numbers:
        own = cluster == number
        rest = information - jacobian[own].T @ jacobian[own]
        # The pseudo-inverse: what one cluster alone determines cannot be judged by leaving it out.
        moves.append(np.linalg.pinv(rest, hermitian=True) @ (jacobian[own].T @ residuals[own]))
    moved = np.array(moves)
    return np.asarray((len(numbers) - 1) / len(numbers) * moved.T @ moved)


def sensitivity(jacobian: Array, held: Array) -> Array:
    """By how much an estimate (p,) moves a unit of what is held (h,): (p, h)."""
    return np.asarray(-np.linalg.lstsq(jacobian, held, rcond=None)[0])
