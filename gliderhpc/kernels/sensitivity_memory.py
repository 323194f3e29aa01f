"""Memory of the sensitivity of filter and smoother to errors of the hull and of its records.

Errors are a vector ``eta`` of ``p`` parameters. Sensitivities have one row for each parameter, with the sixteen states
(or costates) along the row; the same memory is viewed as lanes.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.constants_gradient import CONSTANTS, HULL_CONSTANTS
from gliderhpc.kernels.elementwise import lane_array
from gliderhpc.kernels.smoother_memory import (
    BLOCK,
    GROUPS,
    LOG_DETERMINANT,
    Block,
    Segments,
    allocate_block,
    allocate_segments,
)

Array = Any


class Forcing(NamedTuple):
    """Derivatives with respect to ``eta`` of a dive's problem with ``n`` steps and ``f`` rows with a sample.

    Attributes
    ----------
    constant, parameter, slope : (e,), (e,), (e,)
        Non-zero derivatives of the hull's constants: index of the constant, index of the parameter, and derivative.
    moving, bodies : (m,), (n, m, 11)
        Parameters that change the mass properties, and the derivatives of these properties.
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
    reading: Array
    samples: Array
    number: Array
    start: Array


class Sensitivity(NamedTuple):
    """Sensitivities along the rows of one block and the row after it, and scratch.

    Attributes
    ----------
    states, state_lanes : (m, p, 16)
        Sensitivity ``d x / d eta`` of the filtered states and disturbances, transposed (predicted in the row after the
        last filtered one).
    track : (m, p, 2)
        Sensitivity of the filtered X and Y.
    predicted : (m, 7, p)
        Sensitivity of the predicted minus the measured sample, when each channel was assimilated.
    forced : (m, p, 12)
        Derivatives of the ten sensed states, X and Y at the end of each segment with respect to ``eta`` along it.
    costate, costate_lanes, half, half_lanes : (p, 16)
        Sensitivity of the smoother's costate, and scratch.
    """

    states: Array
    state_lanes: Array
    track: Array
    predicted: Array
    forced: Array
    costate: Array
    costate_lanes: Array
    half: Array
    half_lanes: Array


class Gradient(NamedTuple):
    """Derivatives of the sensed states, X and Y at the end of segments, one in each lane, the last axis of the arrays.

    Attributes
    ----------
    hull, body : (12, 24), (12, 11)
        Derivatives with respect to the hull's constants, and to the mass properties of one step
        (`gliderhpc.kernels.constants_gradient`).
    slopes, moving : (l, m, 11), (m, 12)
        Derivatives of the mass properties of each step with respect to the parameters that change them, and those of
        the end with respect to these parameters.
    """

    hull: Array
    body: Array
    slopes: Array
    moving: Array


class Assumptions(NamedTuple):
    """Samples, variances and noise of a dive, as in `Dive`, under each of ``a`` assumptions: the first axis."""

    measured: Array
    variance: Array
    noise: Array


class SensitivityRows(NamedTuple):
    """Predicted mean, covariances and sensitivities: at the first row of each block, or under each assumption."""

    mean: Array
    covariance: Array
    cross: Array
    track: Array
    states: Array
    track_states: Array


class Information(NamedTuple):
    """Information of a dive on ``eta``, under each of ``a`` assumptions; of a single one, without that axis.

    Attributes
    ----------
    matrix : (a, p, p)
        Information matrix, lower triangle.
    score : (a, p)
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
    states, track : (m, p, 16), (m, p, 2)
        Sensitivities ``d x / d eta`` in these rows, of the sixteen states, and of X and Y.
    displacement : (p, 2)
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
    sensitivity: Sensitivity
    carried: SensitivityRows


def allocate_scratch(rows: Array, forcing: Forcing, assumptions: int = 1) -> Scratch:
    """Allocate the memory for a number of assumptions of the noise of a dive in segments with first rows `rows`."""
    longest, moving, parameters = int(np.diff(rows).max()), len(forcing.moving), len(forcing.start)
    gradient = Gradient(
        hull=lane_array(12, HULL_CONSTANTS), body=lane_array(12, CONSTANTS - HULL_CONSTANTS),
        slopes=lane_array(longest, moving, CONSTANTS - HULL_CONSTANTS), moving=lane_array(moving, 12),
    )  # fmt: skip
    return Scratch(
        segments=allocate_segments(rows),
        block=allocate_block(),
        tally=np.zeros(LOG_DETERMINANT + 1),
        gradient=gradient,
        sensitivity=allocate_sensitivity(parameters),
        carried=allocate_rows(assumptions, parameters),
    )


def allocate_sensitivity(parameters: int) -> Sensitivity:
    """Allocate the memory of one block for a number of parameters."""
    m, p = BLOCK + 1, parameters
    states, costate, half = (lane_array(*shape, GROUPS) for shape in ((m, p), (p,), (p,)))
    return Sensitivity(
        states=states.reshape(m, p, 16), state_lanes=states, track=np.zeros((m, p, 2)),
        predicted=np.zeros((m, 7, p)), forced=np.zeros((BLOCK, p, 12)),
        costate=costate.reshape(p, 16), costate_lanes=costate, half=half.reshape(p, 16), half_lanes=half,
    )  # fmt: skip


def allocate_information(assumptions: int, segments: int, parameters: int) -> Information:
    """Allocate the memory for the information of a dive."""
    a, p = assumptions, parameters
    return Information(np.zeros((a, p, p)), np.zeros((a, p)), np.zeros((a, segments + 1, 16)))


def allocate_checkpoints(segments: int, parameters: int) -> SensitivityRows:
    """Allocate the memory for the checkpoints of a dive in segments."""
    return allocate_rows(segments // BLOCK + 1, parameters)


def allocate_rows(rows: int, parameters: int) -> SensitivityRows:
    """Allocate the memory for a number of rows."""
    m, p = rows, parameters
    return SensitivityRows(
        np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)), np.zeros((m, p, 16)),
        np.zeros((m, p, 2)),
    )  # fmt: skip


def allocate_smoothed(rows: Any, parameters: int) -> SmoothedSensitivity:
    """Allocate the memory for the sensitivities in `rows`, which are in ascending order."""
    wanted = np.ascontiguousarray(rows, dtype=np.int64)
    m, p = len(wanted), parameters
    return SmoothedSensitivity(wanted, np.zeros((m, p, 16)), np.zeros((m, p, 2)), np.zeros((p, 2)))
