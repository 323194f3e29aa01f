"""How far two currents lie apart: as vectors, in speed, in direction, and in standard deviations of one of them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.archive.profile import wrap

Array = NDArray[np.float64]

COVERAGE = {1: 0.393, 2: 0.865}
"""Probability inside the ellipse of so many sigma, in two dimensions."""


def speed(velocity: ArrayLike) -> Array:
    """Speed ``(...)`` of velocities ``(..., 2)``, in their unit."""
    return np.asarray(np.linalg.norm(np.asarray(velocity, dtype=np.float64), axis=-1))


def direction(velocity: ArrayLike) -> Array:
    """Where velocities ``(..., 2)``, north and east, set to: degree ``(...)`` clockwise from north, 0 to 360."""
    north, east = np.moveaxis(np.asarray(velocity, dtype=np.float64), -1, 0)
    return np.asarray(np.mod(np.degrees(np.arctan2(east, north)), 360.0))


def turn(velocity: ArrayLike, reference: ArrayLike) -> Array:
    """Direction of velocities less that of others ``(..., 2)``: degree, clockwise positive, -180 to 180."""
    return wrap(direction(velocity) - direction(reference))


def vector_rmsd(velocity: Array, reference: Array) -> float:
    """Root mean square length of the difference of velocities ``(n, 2)`` where both are known; NaN where none are."""
    squares = ((velocity - reference) ** 2).sum(axis=1)
    known = np.isfinite(squares)
    return float(np.sqrt(squares[known].mean())) if known.any() else float("nan")


def sigma_distance(difference: Array, covariance: Array) -> float:
    """Mahalanobis distance of a difference ``(2,)`` from an ellipse of covariance ``(2, 2)``.

    ``sqrt(d^T C^-1 d)``: 1 on the 1-sigma ellipse, which holds 39 % of a Gaussian in the plane (2 sigma 86 %, 3 sigma
    99 %). NaN where something is missing or the ellipse has no area.
    """
    if not (np.isfinite(difference).all() and np.isfinite(covariance).all() and np.linalg.det(covariance) > 0.0):
        return float("nan")
    return float(np.sqrt(difference @ np.linalg.solve(covariance, difference)))
