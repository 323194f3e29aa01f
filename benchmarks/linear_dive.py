"""A dive linearised about a path, and a dense pass of a smoother over it in NumPy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.problem import Trajectory
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.smoother_allocation import allocate_block, allocate_segments
from gliderhpc.kernels.smoother_memory import LOG_DETERMINANT, SmootherProblem
from gliderhpc.kernels.smoother_segments import linearise_segments

Array = NDArray[np.float64]

_DEPTH = 5
"""Index of the depth among the twelve states; the first three are the angles."""


@dataclass(frozen=True, eq=False)
class LinearDive:
    """A dive linearised about a path: what a smoother of linear problems needs, in deviations from the path.

    Attributes
    ----------
    start, deviation : (16,), (16,)
        Deviation of the prior's mean from the path at the start, and the prior's standard deviations.
    transition, noise, offset : (s, 16, 16), (s, 16, 16), (s, 16)
        Transition over each segment, covariance of its noise, and defect of the path.
    fed : (s+1,) bool
        Whether a row between segments has a sample.
    residual, variance : (s+1, 4), (s+1, 4)
        Sample less the path, NaN where missing, and its variance.
    """

    start: Array
    deviation: Array
    transition: Array
    noise: Array
    offset: Array
    fed: NDArray[np.bool_]
    residual: Array
    variance: Array


def linear_dive(hull: Hull, dive: SmootherProblem, path: Trajectory, rows: NDArray[np.int64]) -> LinearDive:
    """Linearise a dive about a path whose rows inside the segments are the model's run already."""
    count = len(rows) - 1
    segments, block, tally = allocate_segments(rows), allocate_block(), np.zeros(LOG_DETERMINANT + 1)
    transition, noise, offset = np.empty((count, 16, 16)), np.empty((count, 16, 16)), np.empty((count, 16))
    for number in range(0, count, LANES):
        linearise_segments(hull, dive, path.states, path.disturbances, segments, number, 0, block, 0, tally)
        part = slice(number, min(number + LANES, count))
        size = part.stop - part.start
        transition[part] = block.tangent[:size].swapaxes(1, 2)
        noise[part], offset[part] = segments.noise[:size], segments.offset[:size]
    states = path.states[rows]
    residual = dive.measured[rows] - states[:, [0, 1, 2, _DEPTH]]
    residual[:, 2] = np.mod(residual[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    sensed = np.concatenate([np.delete(states[0], [3, 4]), path.disturbances[0]])
    return LinearDive(
        dive.mean - sensed, dive.deviation, transition, noise, offset, dive.fed[rows], residual, dive.variance[rows]
    )


def dense_pass(linear: LinearDive) -> tuple[Array, Array]:
    """Smoothed means and variances ``(s+1, 16)`` by a Kalman filter and the smoother of Rauch, Tung and Striebel.

    Whole matrices in NumPy, whose products and solutions are LAPACK's; the linearisation is given.
    """
    count = len(linear.transition)
    mean, covariance = linear.start.copy(), np.diag(linear.deviation**2)
    means, covariances = np.empty((count + 1, 16)), np.empty((count + 1, 16, 16))
    predicted, spread = np.empty((count + 1, 16)), np.empty((count + 1, 16, 16))
    for k in range(count + 1):
        if linear.fed[k]:
            there = np.flatnonzero(np.isfinite(linear.residual[k]))
            across = covariance[:, there]
            gain = np.linalg.solve(across[there] + np.diag(linear.variance[k, there]), across.T).T
            mean = mean + gain @ (linear.residual[k, there] - mean[there])
            covariance = covariance - gain @ across.T
        means[k], covariances[k] = mean, covariance
        if k < count:
            transition = linear.transition[k]
            mean = transition @ mean + linear.offset[k]
            covariance = transition @ covariance @ transition.T + linear.noise[k]
            # Over thousands of segments, rounding would make it asymmetric and then indefinite.
            covariance = 0.5 * (covariance + covariance.T)
            predicted[k + 1], spread[k + 1] = mean, covariance
    variances = np.empty((count + 1, 16))
    variances[count] = np.diag(covariances[count])
    for k in range(count - 1, -1, -1):
        gain = np.linalg.solve(spread[k + 1], linear.transition[k] @ covariances[k]).T
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        smoothed = covariances[k] + gain @ (covariances[k + 1] - spread[k + 1]) @ gain.T
        covariances[k] = 0.5 * (smoothed + smoothed.T)
        variances[k] = np.diag(covariances[k])
    return means, variances
