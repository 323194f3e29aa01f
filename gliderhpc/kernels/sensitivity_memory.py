"""Memory of the sensitivity of filter and smoother to errors of the hull and of its records.

Errors are a vector ``eta`` of ``p`` parameters. Sensitivities have one row for each parameter, with the sixteen states
(or costates) along the row; the same memory is viewed as lanes.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.constants_gradient import CONSTANTS
from gliderhpc.kernels.elementwise import lane_array
from gliderhpc.kernels.smoother_memory import BLOCK, GROUPS, Block, allocate_block

Array = Any


class Forcing(NamedTuple):
    """Derivatives with respect to ``eta`` of a dive's problem with ``n`` steps and ``f`` rows with a sample.

    Attributes
    ----------
    constant, parameter, slope : (e,), (e,), (e,)
        Non-zero derivatives of the hull's constants: index of the constant, index of the parameter, and derivative.
    moving, bodies : (m,), (n, m, 11)
        Parameters that change the mass properties, and the derivatives of these properties.
    reading, samples : (r,), (f, 4, r)
        Parameters that change the records, and the derivatives of the samples ``[phi, theta, psi, Z]``.
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
    predicted : (m, 4, p)
        Sensitivity of the predicted minus the measured sample, when each channel was assimilated.
    by_constant, by_constant_lanes : (CONSTANTS, 16)
        Derivatives of a step's ten sensed states, X and Y with respect to the constants
        (`gliderhpc.kernels.constants_gradient`).
    costate, costate_lanes, half, half_lanes : (p, 16)
        Sensitivity of the smoother's costate, and scratch.
    """

    states: Array
    state_lanes: Array
    track: Array
    predicted: Array
    by_constant: Array
    by_constant_lanes: Array
    costate: Array
    costate_lanes: Array
    half: Array
    half_lanes: Array


class SensitivityCheckpoints(NamedTuple):
    """Predicted mean, covariances and sensitivities at the first row of each block."""

    mean: Array
    covariance: Array
    cross: Array
    track: Array
    states: Array
    track_states: Array


class Information(NamedTuple):
    """Information of a dive on ``eta``.

    Attributes
    ----------
    matrix : (p, p)
        Information matrix, lower triangle.
    score : (p,)
        Gradient of the record's log-likelihood.
    filtered : (n+1, 16)
        Filtered deviation of every row from the path of linearisation.
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


def allocate_sensitivity(parameters: int) -> Sensitivity:
    """Allocate the memory of one block for a number of parameters."""
    m, p = BLOCK + 1, parameters
    states, constants, costate, half = (lane_array(*shape, GROUPS) for shape in ((m, p), (CONSTANTS,), (p,), (p,)))
    return Sensitivity(
        states=states.reshape(m, p, 16), state_lanes=states, track=np.zeros((m, p, 2)),
        predicted=np.zeros((m, 4, p)), by_constant=constants.reshape(CONSTANTS, 16), by_constant_lanes=constants,
        costate=costate.reshape(p, 16), costate_lanes=costate, half=half.reshape(p, 16), half_lanes=half,
    )  # fmt: skip


def allocate_information(steps: int, parameters: int) -> Information:
    """Allocate the memory for the information of a dive."""
    return Information(np.zeros((parameters, parameters)), np.zeros(parameters), np.zeros((steps + 1, 16)))


def allocate_alternatives(
    steps: int, parameters: int, count: int
) -> tuple[tuple[Block, ...], tuple[Sensitivity, ...], tuple[Information, ...]]:
    """Allocate the memory for `count` assumptions of a dive's noise, with common transitions and derivatives."""
    block, sensitivity = allocate_block(), allocate_sensitivity(parameters)
    transitions = {name: getattr(block, name) for name in ("tangent", "tangent_lanes", "track_tangent", "seeds")}
    derivatives = {name: getattr(sensitivity, name) for name in ("by_constant", "by_constant_lanes")}
    blocks = (block, *(allocate_block()._replace(**transitions) for _ in range(count - 1)))
    others = (allocate_sensitivity(parameters)._replace(**derivatives) for _ in range(count - 1))
    sums = tuple(allocate_information(steps, parameters) for _ in range(count))
    return blocks, (sensitivity, *others), sums


def allocate_sensitivity_checkpoints(steps: int, parameters: int) -> SensitivityCheckpoints:
    """Allocate the memory for the checkpoints of a dive."""
    m, p = steps // BLOCK + 1, parameters
    return SensitivityCheckpoints(
        np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)), np.zeros((m, p, 16)),
        np.zeros((m, p, 2)),
    )  # fmt: skip


def allocate_smoothed(rows: Any, parameters: int) -> SmoothedSensitivity:
    """Allocate the memory for the sensitivities in `rows`, which are in ascending order."""
    wanted = np.asarray(rows, dtype=np.int64)
    m, p = len(wanted), parameters
    return SmoothedSensitivity(wanted, np.zeros((m, p, 16)), np.zeros((m, p, 2)), np.zeros((p, 2)))
