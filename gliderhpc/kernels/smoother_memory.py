"""Memory of the smoother for one dive: the problem, a block of steps, and a checkpoint at the start of each block.

The sixteen states of the recursion are the ten sensed ones and the six disturbances; X and Y, on which nothing depends,
are carried separately as the track. Matrices with sixteen columns are stored in `GROUPS` vectors of `LANES` columns; a
second view of the same memory gives their numbers.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.elementwise import LANES, copy, lane_array
from gliderhpc.kernels.jit import inner_kernel

Array = Any

BLOCK = 64
"""Number of rows between checkpoints. A block (290 kB) fits into the second-level cache; the checkpoints of a dive of
three hours take 5 MB."""

GROUPS = 16 // LANES
"""Number of vectors in a row of sixteen."""

DEFECTS = 3
"""Index in the tally of the first of the ten sums of the sensed states' defects; before it are the costs of the initial
state, of the measurements and of the noise."""

LOG_DETERMINANT = 13
"""Index in the tally of half the logarithm of the ratio of the Hessian's determinant to that of the prior."""


class Dive(NamedTuple):
    """Problem of one dive with ``n`` steps.

    Attributes
    ----------
    bodies : (n, 11)
        Mass properties of each step.
    step : float
        Length of a step h, s.
    fed : (n+1,) bool
        True in rows with a sample.
    measured, variance : (n+1, 4), (n+1, 4)
        Samples ``[phi, theta, psi, Z]`` (NaN: missing) and their variances, which a gate inflates.
    mean, deviation : (16,), (16,)
        Prior of the initial state.
    decay, noise : (6,), (n, 6)
        Decay of the disturbances over a step, and the variance that each step adds.
    damping : (6,)
        Levenberg-Marquardt damping: variances of pseudo-measurements that tie velocities and rates to the path in rows
        with a sample (infinite: no damping).
    mean_shift : (n+1, 16)
        Gradient of a linear term of the cost: zero for the mode, `gliderhpc.kernels.smoother_mean_shift` for the mean.
    """

    bodies: Array
    step: float
    fed: Array
    measured: Array
    variance: Array
    mean: Array
    deviation: Array
    decay: Array
    noise: Array
    damping: Array
    mean_shift: Array


class Block(NamedTuple):
    """Rows of one block and the row after it, numbered from its first; matrices as lanes and, in place, as numbers.

    Attributes
    ----------
    mean : (m, 16)
        Filtered deviation from the path of linearisation (predicted in the row after the last filtered one).
    covariance, covariance_lanes : (m, 16, 16)
        Covariance of the sixteen states.
    cross, track : (m, 2, 16), (m, 2, 2)
        Covariance of X and Y with the sixteen states, and of X and Y.
    tangent, tangent_lanes : (m, 16, 16)
        Transpose of the step's transition matrix: a row for each state before the step.
    track_tangent : (m, 2, 16)
        Derivatives of X and Y with respect to the states before the step.
    gain, scaled_innovation, information : (m, 10, 16), (m, 10), (m, 10)
        Gain, innovation over its variance, and reciprocal of that variance (zero where there was no update), for the
        update with each sensed state: the four measured ones and the six that may be damped.
    seeds : (12, 16)
        Unit costates of the ten sensed states, X and Y, as lanes.
    half, half_lanes, ahead, ahead_lanes, behind, behind_lanes : (16, 16)
        Scratch.
    """

    mean: Array
    covariance: Array
    covariance_lanes: Array
    cross: Array
    track: Array
    tangent: Array
    tangent_lanes: Array
    track_tangent: Array
    gain: Array
    scaled_innovation: Array
    information: Array
    seeds: Array
    half: Array
    half_lanes: Array
    ahead: Array
    ahead_lanes: Array
    behind: Array
    behind_lanes: Array


class Checkpoints(NamedTuple):
    """Predicted mean, covariance, cross-covariance and covariance of the track at the first row of each block."""

    mean: Array
    covariance: Array
    cross: Array
    track: Array


class Backward(NamedTuple):
    """Results of the sweep from the end to the beginning.

    Attributes
    ----------
    correction : (n+1, 16)
        Smoothed deviation from the path of linearisation.
    state_variance, disturbance_variance, track_variance : (n+1, 10), (n+1, 6), (n+1, 2)
        Smoothed variances.
    noise_mean, noise_resolved : (n, 6), (n, 6)
        Smoothed mean of each step's noise, and the fraction of its variance that the record resolves: the posterior
        variance is ``noise (1 - noise_resolved)``.
    steepest : (10,)
        Largest absolute costate of each sensed state.
    displacement : (2, 2)
        Covariance of X and Y in the last row.
    mean_shift : (n+1, 16) or (0, 16)
        Mean shift about this path; computed only if memory is allocated for it.
    every : int
        Number of steps in a stretch that uses the mean shift of its middle step.
    rows, covariances : (m,), (m, 18, 18)
        Selected rows in ascending order, and their full covariances (the sixteen states, X and Y).
    """

    correction: Array
    state_variance: Array
    disturbance_variance: Array
    track_variance: Array
    noise_mean: Array
    noise_resolved: Array
    steepest: Array
    displacement: Array
    mean_shift: Array
    every: int
    rows: Array
    covariances: Array


def allocate_block() -> Block:
    """Allocate the memory of one block."""
    m = BLOCK + 1
    covariance, tangent, half, ahead, behind = (
        lane_array(*shape, GROUPS) for shape in ((m, 16), (m, 16), (16,), (16,), (16,))
    )
    return Block(
        mean=np.zeros((m, 16)), covariance=covariance.reshape(m, 16, 16), covariance_lanes=covariance,
        cross=np.zeros((m, 2, 16)), track=np.zeros((m, 2, 2)), tangent=tangent.reshape(m, 16, 16),
        tangent_lanes=tangent, track_tangent=np.zeros((m, 2, 16)), gain=np.zeros((m, 10, 16)),
        scaled_innovation=np.zeros((m, 10)), information=np.zeros((m, 10)), seeds=_seeds(),
        half=half.reshape(16, 16), half_lanes=half, ahead=ahead.reshape(16, 16), ahead_lanes=ahead,
        behind=behind.reshape(16, 16), behind_lanes=behind,
    )  # fmt: skip


def _seeds() -> Array:
    seeds = lane_array(12, GROUPS)
    seeds.reshape(12, 16)[:, :12] = np.eye(12)
    return seeds


@inner_kernel
def copy_row(source, i, target, j):
    """Copy row ``i`` of a `Block` or `Checkpoints` to row ``j`` of another: the entries that checkpoints have."""
    copy(source.mean[i], target.mean[j])
    copy(source.covariance[i], target.covariance[j])
    copy(source.cross[i], target.cross[j])
    copy(source.track[i], target.track[j])


def allocate_checkpoints(steps: int) -> Checkpoints:
    """Allocate the memory for the checkpoints of a dive."""
    m = steps // BLOCK + 1
    return Checkpoints(np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)))


def allocate_backward(steps: int, rows: Any = (), *, every: int | None = None) -> Backward:
    """Allocate the memory for the results of the backward sweep.

    The full covariance is computed in `rows`, and the mean shift once every `every` steps, or never.
    """
    wanted = np.asarray(rows, dtype=np.int64)
    n = steps
    return Backward(
        np.zeros((n + 1, 16)), np.zeros((n + 1, 10)), np.zeros((n + 1, 6)), np.zeros((n + 1, 2)), np.zeros((n, 6)),
        np.zeros((n, 6)), np.zeros(10), np.zeros((2, 2)), np.zeros((n + 1 if every else 0, 16)),
        every or 1, wanted, np.zeros((len(wanted), 18, 18)),
    )  # fmt: skip


def allocate_costate() -> tuple[Array, Array, Array]:
    """Allocate the memory for the costate, and for its covariance as numbers and as lanes."""
    lanes = lane_array(16, GROUPS)
    return np.zeros(16), lanes.reshape(16, 16), lanes
