"""Differences between an estimate and a reference: root mean square, correlation, and distances between currents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.angles import wrap

Array = NDArray[np.float64]

COVERAGE = {1: 0.393, 2: 0.865}
"""Probability inside the ellipse of the given number of sigma, in two dimensions."""

MIN_COVERAGE = 0.9
"""Share of the dive's time that a model or a profiler must cover; with less, its mean does not represent the dive."""


@dataclass(frozen=True)
class EstimateScore:
    """Root mean square error in the quantity's unit, and correlation (NaN if either series is constant)."""

    rmse: float
    correlation: float


def score_columns(estimate: Array, true: Array) -> tuple[EstimateScore, ...]:
    """Score every column of an estimate ``(n, m)`` against the truth ``(n, m)``."""
    columns = zip(estimate.T, true.T, strict=True)
    return tuple(EstimateScore(rms(ours - theirs), correlation(ours, theirs)) for ours, theirs in columns)


def rms(values: Array) -> float:
    """Root mean square of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def finite_median(values: ArrayLike) -> float:
    """Return the median of the finite values; NaN if there are none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else float("nan")


def correlation(a: Array, b: Array) -> float:
    """Correlation over the samples where both are finite; NaN if either is constant."""
    known = np.isfinite(a) & np.isfinite(b)
    if not known.any() or np.ptp(a[known]) == 0.0 or np.ptp(b[known]) == 0.0:
        return float("nan")
    return float(np.corrcoef(a[known], b[known])[0, 1])


def speed(velocity: ArrayLike) -> Array:
    """Speed ``(...)`` of velocities ``(..., 2)``, in their unit."""
    return np.asarray(np.linalg.norm(np.asarray(velocity, dtype=np.float64), axis=-1))


def direction(velocity: ArrayLike) -> Array:
    """Direction of velocities ``(..., 2)``, north and east: degree ``(...)`` clockwise from north, 0 to 360."""
    north, east = np.moveaxis(np.asarray(velocity, dtype=np.float64), -1, 0)
    return np.asarray(np.mod(np.degrees(np.arctan2(east, north)), 360.0))


def direction_difference(velocity: ArrayLike, reference: ArrayLike) -> Array:
    """Direction of velocities minus that of others ``(..., 2)``: degree, clockwise positive, -180 to 180."""
    return wrap(direction(velocity) - direction(reference))


def vector_rmsd(velocity: Array, reference: Array) -> float:
    """Root mean square length of the difference of velocities ``(n, 2)`` where both are known; NaN if none are."""
    squares = ((velocity - reference) ** 2).sum(axis=1)
    known = np.isfinite(squares)
    return float(np.sqrt(squares[known].mean())) if known.any() else float("nan")


def covariance_matrix(first_std: ArrayLike, second_std: ArrayLike, covariance: ArrayLike) -> Array:
    """Covariances ``(..., 2, 2)`` of two components from their standard deviations and their covariance ``(...)``."""
    first, second, both = (np.asarray(values, dtype=np.float64) for values in (first_std, second_std, covariance))
    rows = np.stack([first**2, both], axis=-1), np.stack([both, second**2], axis=-1)
    return np.stack(rows, axis=-2)


def ellipse_axes(covariance: Array) -> tuple[float, float, float]:
    """Return the 1-sigma ellipse of a covariance ``(2, 2)`` of north and east: semi-axes, direction of the longer one.

    Returns
    -------
    longer, shorter : float
        Semi-axes, in the unit whose square is that of the covariance.
    angle : float
        Direction of the longer semi-axis, degree anticlockwise from east, as used in figures with east to the right.
    """
    variances, vectors = np.linalg.eigh(covariance)
    shorter, longer = np.sqrt(np.maximum(variances, 0.0))
    north, east = vectors[:, 1]
    return float(longer), float(shorter), float(np.degrees(np.arctan2(north, east)))


def sigma_distance(difference: Array, covariance: Array) -> float:
    """Mahalanobis distance of a difference ``(2,)`` from an ellipse of covariance ``(2, 2)``.

    ``sqrt(d^T C^-1 d)``: 1 on the 1-sigma ellipse, which contains 39 % of a two-dimensional Gaussian (2 sigma 86 %, 3
    sigma 99 %). NaN if a value is missing or the ellipse has no area.
    """
    if not (np.isfinite(difference).all() and np.isfinite(covariance).all() and np.linalg.det(covariance) > 0.0):
        return float("nan")
    return float(np.sqrt(difference @ np.linalg.solve(covariance, difference)))
