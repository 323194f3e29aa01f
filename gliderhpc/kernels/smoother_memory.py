"""Memory of the smoother for one profile: the problem, its segments, a block of rows, and a tape of all rows.

The sixteen states of the recursion are the ten sensed ones and the six disturbances; X and Y, on which nothing depends,
are carried separately as the track.
"""

from typing import Any, NamedTuple

from gliderhpc.kernels.array_sizes import declare_sizes
from gliderhpc.kernels.elementwise import LANES, copy
from gliderhpc.kernels.jacobian import ENTRIES
from gliderhpc.kernels.jit import inner_kernel

Array = Any

BLOCK = 16
"""Number of rows that are linearised before they are filtered, and after which rounding is removed from the covariance.
A block (110 kB) fits into the second-level cache; twice as many rows or more were slower in measurements."""

NOISE_COLUMN = 2
"""Column of the first disturbance among the last eight of the sixteen states, a whole number of vectors."""

DEFECTS = 3
"""Index in the tally of the first of the ten sums of the sensed states' defects; before it are the costs of the initial
state, of the measurements and of the noise."""

LOG_DETERMINANT = 13
"""Index in the tally of half the logarithm of the ratio of the Hessian's determinant to that of the prior."""


class SmootherProblem(NamedTuple):
    """Problem of one profile with ``n`` steps.

    Attributes
    ----------
    bodies : (n, 11)
        Mass properties of each step.
    step : float
        Length of a step h, s.
    fed : (n+1,) bool
        True in rows with a sample.
    measured, variance : (n+1, 4) or (n+1, 7)
        Samples ``[phi, theta, psi, Z]``, or ``[phi, theta, psi, Z, u, v, w]`` where the velocity relative to the water
        is measured (NaN: missing), and their variances, which a gate inflates.
    mean, deviation : (16,), (16,)
        Prior of the initial state.
    decay, noise : (6,), (n, 6)
        Decay of the disturbances over a step, and the variance that each step adds.
    damping : (6,)
        Levenberg-Marquardt damping: variances of pseudo-measurements that tie velocities and rates to the path in rows
        with a sample (infinite: no damping).
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


class Segments(NamedTuple):
    """Segments into which a profile's steps are divided, and the memory to linearise those of one block of ``m`` rows.

    Attributes
    ----------
    rows : (s+1,) int
        First row of each segment, and the last row of the profile. Samples are in these rows only.
    represented_steps : (s,) int
        Number of steps around the first row of each segment that have the mean shift of its first step; where it is
        zero, none is computed.
    noise : (m, 16, 16)
        Covariance that the noise of a segment's steps adds to the sixteen states at its end.
    noise_cross, noise_track : (m, 2, 16), (m, 2, 2)
        Covariance that it adds to X and Y with the sixteen states, and to X and Y.
    offset : (m, 16)
        Deviation at the end of a segment that follows from the path's own defects.
    by_noise : (lanes, l, 11, 8)
        For as many segments as there are lanes: derivatives of the sensed states at the end of a segment with respect
        to the noise of each step, and in the last row those of each disturbance with respect to its own noise; the
        columns are those from `NOISE_COLUMN` on.
    lanes : SegmentLanes
        Scratch for as many segments as there are lanes.
    half : (3, 8)
        Scratch.
    """

    rows: Array
    represented_steps: Array
    noise: Array
    noise_cross: Array
    noise_track: Array
    offset: Array
    by_noise: Array
    lanes: "SegmentLanes"
    half: Array


class SegmentLanes(NamedTuple):
    """Segments of at most ``l`` steps, one in each lane; the arrays have an axis of lanes after these.

    Attributes
    ----------
    durations : (l,)
        Length of each step, s; zero after a segment's own end.
    bodies, disturbances, noise, defects : (l, 11), (l, 6), (l, 6), (l, 6)
        Mass properties, disturbance, variance of the noise, and the disturbance's defect of each step.
    states : (l+1, 12)
        Sensed states from the segment's first row on, and the displacement since then.
    transition, remaining : (12, 16), (6,)
        Derivatives of the sensed states, X and Y at the end with respect to the states before a step, and the decay of
        the disturbances from there.
    gathered, gathered_cross, gathered_own : (12, 12), (6, 12), (6,)
        Covariance of the sensed states, X and Y from the noise (lower triangle), that of the disturbances with them,
        and the variance of the disturbances.
    offset : (16,)
        As in `Segments`, without the defect of the sensed states.
    after : (10, 16)
        As in `Tape`; for the sensed states at the end.
    by_noise, track_by_noise, by_own : (g, l-1, 10, 6), (b, l-1, 2, 6), (g, l, 6)
        Derivatives of the sensed states, X and Y at the end with respect to the noise of each step (those of the last
        step are zero), and the decay of the disturbances from there; for as many groups of segments, each of the number
        of lanes, as are needed at once. Those of X and Y are needed for one block only.
    partials, track_partials : (l, 4, 67), (l, 4, 3, 6)
        Jacobians of the sensed states at the four stages of each step, and those of nothing, X and Y by angles and
        velocities.
    stages, stage_costates : (l, 4, 10), (4, 12, 10)
        States at the four stages of each step, and costates of the rates there for one step, times 6 / h.
    """

    durations: Array
    bodies: Array
    disturbances: Array
    noise: Array
    defects: Array
    states: Array
    transition: Array
    remaining: Array
    gathered: Array
    gathered_cross: Array
    gathered_own: Array
    offset: Array
    after: Array
    by_noise: Array
    track_by_noise: Array
    by_own: Array
    partials: Array
    track_partials: Array
    stages: Array
    stage_costates: Array


class Block(NamedTuple):
    """Rows of one block and the row after it, numbered from its first.

    Of a profile in segments, these are the segments' first rows, and the transitions are those over whole segments.

    Attributes
    ----------
    mean : (m, 16)
        Filtered deviation from the path of linearisation (predicted in the row after the last filtered one).
    covariance : (m, 16, 16)
        Covariance of the sixteen states.
    cross, track : (m, 2, 16), (m, 2, 2)
        Covariance of X and Y with the sixteen states, and of X and Y.
    tangent : (m, 16, 16)
        Transpose of the step's transition matrix: a row for each state before the step.
    track_tangent : (m, 2, 16)
        Derivatives of X and Y with respect to the states before the step.
    gain, scaled_innovation, information : (m, 10, 16), (m, 10), (m, 10)
        Gain, innovation over its variance, and reciprocal of that variance (zero where there was no update), for the
        update with each sensed state: the measured ones and those that may be damped.
    seeds, columns : (10, 24), (16, 32)
        Unit costates of the ten sensed states, twice, and in as many columns the points at which their derivatives are
        computed; the other columns are scratch.
    half, ahead, behind : (16, 16)
        Scratch.
    """

    mean: Array
    covariance: Array
    cross: Array
    track: Array
    tangent: Array
    track_tangent: Array
    gain: Array
    scaled_innovation: Array
    information: Array
    seeds: Array
    columns: Array
    half: Array
    ahead: Array
    behind: Array


class Tape(NamedTuple):
    """Results of the forward sweep needed by the backward sweep, for the ``s + 1`` rows between segments.

    The derivatives with respect to the noise are in `SegmentLanes`.

    Attributes
    ----------
    mean, covariance, cross, track : (s+1, 16), (s+1, 16, 16), (s+1, 2, 16), (s+1, 2, 2)
        Filtered mean and covariances of `Block`.
    transition : (s, 11, 16)
        Transition over each segment: ten rows for the sensed states at its end, and in the last row the decay of the
        disturbances, in their columns.
    sample : (s+1,) int
        Number of each row's sample; of a row without one, that of the sample before.
    gain, scaled_innovation, information : (m, 10, 16), (m, 10), (m, 10)
        Updates of `Block` for each of ``m`` samples; gains only where there was an update.
    shift : (s,) int
        Number of the mean shift that is computed in each segment; where none is, that of the one before.
    after : (g, 16, 16)
        Transition matrix from the end of the first step to the end, of each segment whose mean shift is computed.
    """

    mean: Array
    covariance: Array
    cross: Array
    track: Array
    transition: Array
    sample: Array
    gain: Array
    scaled_innovation: Array
    information: Array
    shift: Array
    after: Array


class Backward(NamedTuple):
    """Results of the sweep from the end to the beginning, for the ``s + 1`` rows between segments and all ``n`` steps.

    Attributes
    ----------
    correction : (s+1, 16)
        Smoothed deviation from the path of linearisation.
    state_variance, disturbance_variance, track_variance : (s+1, 10), (s+1, 6), (s+1, 2)
        Smoothed variances.
    noise_mean, noise_resolved : (n, 6), (n, 6)
        Smoothed mean of each step's noise, and the fraction of its variance that the record resolves: the posterior
        variance is ``noise (1 - noise_resolved)``.
    steepest : (10,)
        Largest absolute costate of each sensed state.
    displacement : (2, 2)
        Covariance of X and Y in the last row.
    mean_shift : (s+1, 16) or (0, 16)
        Mean shift about this path, summed up around each row; computed only if memory is allocated for it.
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
    rows: Array
    covariances: Array


declare_sizes(SmootherProblem, bodies=(11,), noise=(6,), mean=(16,), deviation=(16,), decay=(6,), damping=(6,))
declare_sizes(
    Segments,
    noise=(16, 16),
    noise_cross=(2, 16),
    noise_track=(2, 2),
    offset=(16,),
    by_noise=(11, 8),
    half=(3, 8),
)
declare_sizes(
    SegmentLanes,
    bodies=(11, LANES),
    disturbances=(6, LANES),
    noise=(6, LANES),
    defects=(6, LANES),
    states=(12, LANES),
    transition=(12, 16, LANES),
    remaining=(6, LANES),
    gathered=(12, 12, LANES),
    gathered_cross=(6, 12, LANES),
    gathered_own=(6, LANES),
    offset=(16, LANES),
    after=(10, 16, LANES),
    by_noise=(10, 6, LANES),
    track_by_noise=(2, 6, LANES),
    by_own=(6, LANES),
    partials=(4, ENTRIES, LANES),
    track_partials=(4, 3, 6, LANES),
    stages=(4, 10, LANES),
    stage_costates=(4, 12, 10, LANES),
    durations=(LANES,),
)
declare_sizes(
    Block,
    mean=(16,),
    covariance=(16, 16),
    cross=(2, 16),
    track=(2, 2),
    tangent=(16, 16),
    track_tangent=(2, 16),
    gain=(10, 16),
    scaled_innovation=(10,),
    information=(10,),
    seeds=(10, 24),
    columns=(16, 32),
    half=(16, 16),
    ahead=(16, 16),
    behind=(16, 16),
)
declare_sizes(
    Tape,
    mean=(16,),
    covariance=(16, 16),
    cross=(2, 16),
    track=(2, 2),
    transition=(11, 16),
    gain=(10, 16),
    scaled_innovation=(10,),
    information=(10,),
    after=(16, 16),
)
declare_sizes(
    Backward,
    correction=(16,),
    state_variance=(10,),
    disturbance_variance=(6,),
    track_variance=(2,),
    noise_mean=(6,),
    noise_resolved=(6,),
    steepest=(10,),
    displacement=(2, 2),
    mean_shift=(16,),
    covariances=(18, 18),
)


@inner_kernel
def copy_row(source, i, target, j):
    """Copy mean and covariances of row ``i`` of a `Block`, or of another tuple that has them, to row ``j`` of one."""
    copy(source.mean[i], target.mean[j])
    copy(source.covariance[i], target.covariance[j])
    copy(source.cross[i], target.cross[j])
    copy(source.track[i], target.track[j])
