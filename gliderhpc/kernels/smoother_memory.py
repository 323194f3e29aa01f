"""Memory of the smoother for one dive: the problem, a block of steps, and a checkpoint at the start of each block.

The sixteen states of the recursion are the ten sensed ones and the six disturbances; X and Y, on which nothing depends,
go along as a track of two. Matrices of sixteen columns lie in `GROUPS` vectors of `LANES` columns, and a second view of
the same memory gives their numbers.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.elementwise import LANES, copy, lane_array
from gliderhpc.kernels.jit import inner_kernel

Array = Any

BLOCK = 64
"""Rows between checkpoints. A block (290 kB) stays in the second-level cache; the checkpoints of a dive of three hours
take 5 MB."""

GROUPS = 16 // LANES
"""Vectors in a row of sixteen."""

DEFECTS = 3
"""Index in the tally of the first of the ten sensed states' sums of defects; before them are the costs of the initial
state, of the measurements and of the noise."""

LOG_DETERMINANT = 13
"""Index in the tally of half the logarithm of the determinant of the cost's Hessian, over that of the prior's."""


class Dive(NamedTuple):
    """The problem, of ``n`` steps.

    Attributes
    ----------
    bodies : (n, 11)
        Mass properties a step.
    step : float
        h, s.
    fed : (n+1,) bool
        Rows with a sample.
    measured, variance : (n+1, 4), (n+1, 4)
        ``[phi, theta, psi, Z]`` (NaN: missing) and its variances; those are widened where a gate is given.
    mean, deviation : (16,), (16,)
        Prior of the initial state.
    decay, noise : (6,), (n, 6)
        The disturbances' decay over a step, and the variance that each step adds.
    damping : (6,)
        Levenberg-Marquardt damping: variances with which velocities and rates are held to the path in rows with a
        sample; infinite: not at all.
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
    """Rows of one block and one more, numbered from its first; matrices as lanes, and the same memory as numbers.

    Attributes
    ----------
    mean : (m, 16)
        Filtered deviation from the path of linearisation (in the row behind the last one filtered: predicted).
    covariance, covariance_lanes : (m, 16, 16)
        Of the sixteen states.
    cross, track : (m, 2, 16), (m, 2, 2)
        Covariance of X and Y with the sixteen, and their own.
    tangent, tangent_lanes : (m, 16, 16)
        Transpose of the step's transition matrix: a row for each state before the step.
    track_tangent : (m, 2, 16)
        X and Y by the states before the step.
    gain, scaled_innovation, information : (m, 10, 16), (m, 10), (m, 10)
        Of the update by each sensed state, the four measured and the six that may be damped: its gain, its innovation
        over the innovation's variance, and one over that variance (zero where there was none).
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
    """Predicted mean, covariance, cross covariance and track's covariance at the first row of each block."""

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
        Smoothed mean of each step's noise, and the share of its variance that the record resolves: what is left of the
        variance is ``noise (1 - noise_resolved)``.
    steepest : (10,)
        Largest costate of each sensed state.
    displacement : (2, 2)
        Covariance of X and Y in the last row.
    mean_shift : (n+1, 16) or (0, 16)
        The mean shift about this path; computed only where memory is allocated for it.
    every : int
        Steps of a stretch that shares the mean shift of its middle one.
    rows, covariances : (m,), (m, 18, 18)
        Rows in ascending order whose whole covariance is wanted (the sixteen states, X and Y), and it.
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
    """Memory of one block."""
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
    """Copy row ``i`` of a `Block` or `Checkpoints` to row ``j`` of another, as far as checkpoints have it."""
    copy(source.mean[i], target.mean[j])
    copy(source.covariance[i], target.covariance[j])
    copy(source.cross[i], target.cross[j])
    copy(source.track[i], target.track[j])


def allocate_checkpoints(steps: int) -> Checkpoints:
    """Memory for the checkpoints of a dive."""
    m = steps // BLOCK + 1
    return Checkpoints(np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)))


def allocate_backward(steps: int, rows: Any = (), *, every: int | None = None) -> Backward:
    """Memory for the results of the sweep from the end.

    `rows` are those whose whole covariance is wanted; the mean shift is computed ``every`` so many steps, or never.
    """
    wanted = np.asarray(rows, dtype=np.int64)
    n = steps
    return Backward(
        np.zeros((n + 1, 16)), np.zeros((n + 1, 10)), np.zeros((n + 1, 6)), np.zeros((n + 1, 2)), np.zeros((n, 6)),
        np.zeros((n, 6)), np.zeros(10), np.zeros((2, 2)), np.zeros((n + 1 if every else 0, 16)),
        every or 1, wanted, np.zeros((len(wanted), 18, 18)),
    )  # fmt: skip


def allocate_costate() -> tuple[Array, Array, Array]:
    """Memory for the costate, and for its covariance as numbers and as lanes."""
    lanes = lane_array(16, GROUPS)
    return np.zeros(16), lanes.reshape(16, 16), lanes
