"""Memory of the sensitivity of filter and smoother to errors of the hull and of its records.

Errors are a vector ``eta`` of ``p`` parameters. Sensitivities have a row for each of the sixteen states (or costates)
and a column for each parameter. The number of columns is rounded up to ``q``, a multiple of eight; those left over are
zero.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.array_sizes import declare_sizes
from gliderhpc.kernels.constants_gradient import CONSTANTS, HULL_CONSTANTS
from gliderhpc.kernels.elementwise import LANES, lane_array
from gliderhpc.kernels.smoother_allocation import aligned, allocate_block, allocate_segments
from gliderhpc.kernels.smoother_memory import BLOCK, LOG_DETERMINANT, Block, Segments

Array = Any


class Forcing(NamedTuple):
    """Derivatives with respect to ``eta`` of a profile's problem with ``n`` steps and ``f`` rows with a sample.

    Attributes
    ----------
    constant, parameter, slope : (e,), (e,), (e,)
        Non-zero derivatives of the hull's constants: index of the constant, index of the parameter, and derivative.
    moving, bodies, row : (m,), (b, m, 11), (n,)
        Parameters that change the mass properties, the derivatives of these properties, and the row of these that each
        step has: they change only where an actuator moves.
    reading, samples : (r,), (f, 4, r) or (f, 7, r)
        Parameters that change the records, and the derivatives of the samples ``[phi, theta, psi, Z]``, or
        ``[phi, theta, psi, Z, u, v, w]`` where the velocity relative to the water is measured.
    number : (n+1,)
        Position of each row among those with a sample.
    start : (p, 16)
        Derivative of the prior's initial state.
    """

    constant: Array
    parameter: Array
    slope: Array
    moving: Array
    bodies: Array
    row: Array
    reading: Array
    samples: Array
    number: Array
    start: Array


class SensitivityBlock(NamedTuple):
    """Sensitivities along the rows of one block and the row after it, and scratch.

    Attributes
    ----------
    states : (m, 16, q)
        Sensitivity ``d x / d eta`` of the filtered states and disturbances (predicted in the row after the last
        filtered one).
    track : (m, 2, q)
        Sensitivity of the filtered X and Y.
    predicted, weighted : (7 m, q), (7 m, q)
        Sensitivity of the predicted minus the measured sample, when each channel was assimilated, and the same over the
        innovation's variance.
    channel, weight, scaled, cross : (7 m,), (7 m,), (7 m,), (7 m, 2)
        Channel, reciprocal variance, innovation over its variance, and covariance of X and Y with it.
    forced : (m, 12, q)
        Derivatives of the ten sensed states, X and Y at the end of each segment with respect to ``eta`` along it.
    costate, half : (16, q)
        Sensitivity of the smoother's costate, and scratch.
    """

    states: Array
    track: Array
    predicted: Array
    weighted: Array
    channel: Array
    weight: Array
    scaled: Array
    cross: Array
    forced: Array
    costate: Array
    half: Array


class Gradient(NamedTuple):
    """Derivatives of the sensed states, X and Y at the end of segments, one in each lane, the last axis of the arrays.

    Attributes
    ----------
    hull, body : (12, 24), (12, 11)
        Derivatives with respect to the hull's constants, and to the mass properties of steps with equal slopes
        (`gliderhpc.kernels.constants_gradient`).
    slopes, row : (l, m, 11), (l,)
        Derivatives of the mass properties of each step with respect to the parameters that change them, and their rows
        in `Forcing`.
    acting, forced : (a,), (a, 12)
        Parameters that act along a segment, without lanes, and the derivatives with respect to these.
    place, moving : (e,), (m,)
        Position among the acting parameters of those by which the constants and the mass properties change; without
        lanes.
    """

    hull: Array
    body: Array
    slopes: Array
    row: Array
    acting: Array
    forced: Array
    place: Array
    moving: Array


class Assumptions(NamedTuple):
    """Samples, variances and noise as in `SmootherProblem`, under each of ``a`` assumptions along the first axis."""

    measured: Array
    variance: Array
    noise: Array


class SensitivityRows(NamedTuple):
    """Predicted mean, covariances and sensitivities under each assumption."""

    mean: Array
    covariance: Array
    cross: Array
    track: Array
    states: Array
    track_states: Array


class SensitivityTape(NamedTuple):
    """Memory of a forward sweep, for the backward sweep.

    Attributes
    ----------
    transition : (s, 11, 16)
        Transition of the sensed states over each segment, and in the last row the decay of each disturbance.
    gain, predicted, inverse : (f, c, 16), (f, c, q), (f, c)
        Gain, sensitivity of the innovation and reciprocal of its variance, for each channel of each row with a sample;
        zero where it has none.
    covariance, cross : (m, 16, 16), (m, 2, 16)
        Filtered covariances in the requested rows.
    """

    transition: Array
    gain: Array
    predicted: Array
    inverse: Array
    covariance: Array
    cross: Array


class ErrorInformation(NamedTuple):
    """Information of a profile on ``eta``, under each of ``a`` assumptions; of a single one, without that axis.

    Attributes
    ----------
    matrix : (a, q, q)
        Information matrix, lower triangle.
    score : (a, q)
        Gradient of the record's log-likelihood.
    filtered : (a, s+1, 16)
        Filtered deviation from the path of linearisation in the rows between segments.
    """

    matrix: Array
    score: Array
    filtered: Array


class SmoothedSensitivity(NamedTuple):
    """Sensitivities of the smoothed states.

    Attributes
    ----------
    rows : (m,)
        Selected rows in ascending order.
    states, track : (m, 16, q), (m, 2, q)
        Sensitivities ``d x / d eta`` in these rows, of the sixteen states, and of X and Y.
    displacement : (2, q)
        Sensitivity of X and Y in the last row.
    """

    rows: Array
    states: Array
    track: Array
    displacement: Array


class Scratch(NamedTuple):
    """Memory of filter and sensitivity: one block, and the row after it as predicted under each assumption."""

    segments: Segments
    block: Block
    tally: Array
    gradient: Gradient
    sensitivity: SensitivityBlock
    carried: SensitivityRows


declare_sizes(Forcing, start=(16,), bodies=(11,))
declare_sizes(SensitivityBlock, cross=(2,))
declare_sizes(
    Gradient,
    hull=(HULL_CONSTANTS, LANES),
    body=(CONSTANTS - HULL_CONSTANTS, LANES),
    slopes=(CONSTANTS - HULL_CONSTANTS, LANES),
    row=(LANES,),
    forced=(12, LANES),
)
declare_sizes(Assumptions, noise=(6,))
declare_sizes(SensitivityRows, mean=(16,), covariance=(16, 16), cross=(2, 16), track=(2, 2))
declare_sizes(SensitivityTape, transition=(11, 16), gain=(16,), covariance=(16, 16), cross=(2, 16))
declare_sizes(ErrorInformation, filtered=(16,))


def columns_for(parameters: int) -> int:
    """Return the number of columns for a number of parameters: a multiple of eight."""
    return -(-parameters // 8) * 8


def allocate_scratch(rows: Array, forcing: Forcing, assumptions: int = 1) -> Scratch:
    """Allocate the memory for a number of assumptions of the noise of a profile in segments with first rows `rows`."""
    longest, moving = int(np.diff(rows).max()), len(forcing.moving)
    acting = np.union1d(forcing.parameter, forcing.moving).astype(np.int64)
    gradient = Gradient(
        hull=lane_array(12, HULL_CONSTANTS), body=lane_array(12, CONSTANTS - HULL_CONSTANTS),
        slopes=lane_array(longest, moving, CONSTANTS - HULL_CONSTANTS), row=np.full((longest, LANES), -1),
        acting=acting, forced=lane_array(len(acting), 12), place=np.searchsorted(acting, forcing.parameter),
        moving=np.searchsorted(acting, forcing.moving),
    )  # fmt: skip
    return Scratch(
        segments=allocate_segments(rows),
        block=allocate_block(),
        tally=np.zeros(LOG_DETERMINANT + 1),
        gradient=gradient,
        sensitivity=allocate_sensitivity(len(forcing.start)),
        carried=allocate_rows(assumptions, len(forcing.start)),
    )


def allocate_sensitivity(parameters: int) -> SensitivityBlock:
    """Allocate the memory of one block for a number of parameters."""
    m, innovations, q = BLOCK + 1, 7 * BLOCK, columns_for(parameters)
    return SensitivityBlock(
        states=aligned(m, 16, q), track=aligned(m, 2, q), predicted=aligned(innovations, q),
        weighted=aligned(innovations, q), channel=np.zeros(innovations, dtype=np.int64), weight=np.zeros(innovations),
        scaled=np.zeros(innovations), cross=np.zeros((innovations, 2)), forced=aligned(BLOCK, 12, q),
        costate=aligned(16, q), half=aligned(16, q),
    )  # fmt: skip


def allocate_information(assumptions: int, segments: int, parameters: int) -> ErrorInformation:
    """Allocate the memory for the information of a profile."""
    a, q = assumptions, columns_for(parameters)
    return ErrorInformation(np.zeros((a, q, q)), np.zeros((a, q)), np.zeros((a, segments + 1, 16)))


def allocate_tape(segments: int, samples: int, channels: int, rows: int, parameters: int) -> SensitivityTape:
    """Allocate the memory for the tape of a profile, given the numbers of rows with a sample and of requested rows."""
    f, c, q = samples, channels, columns_for(parameters)
    return SensitivityTape(
        np.zeros((segments, 11, 16)), np.zeros((f, c, 16)), np.zeros((f, c, q)), np.zeros((f, c)),
        np.zeros((rows, 16, 16)), np.zeros((rows, 2, 16)),
    )  # fmt: skip


def allocate_rows(rows: int, parameters: int) -> SensitivityRows:
    """Allocate the memory for a number of rows."""
    m, q = rows, columns_for(parameters)
    return SensitivityRows(
        np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)), np.zeros((m, 16, q)),
        np.zeros((m, 2, q)),
    )  # fmt: skip


def allocate_smoothed(rows: Any, parameters: int) -> SmoothedSensitivity:
    """Allocate the memory for the sensitivities in `rows`, which are in ascending order."""
    wanted = np.ascontiguousarray(rows, dtype=np.int64)
    m, q = len(wanted), columns_for(parameters)
    return SmoothedSensitivity(wanted, np.zeros((m, 16, q)), np.zeros((m, 2, q)), np.zeros((2, q)))
