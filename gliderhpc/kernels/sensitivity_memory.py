"""Memory of the sensitivity of filter and smoother to errors of the hull and of its records.

Errors are a vector ``eta`` of ``p`` parameters. Sensitivities lie a parameter a row, the sixteen states (or costates)
along the row, as lanes in the same memory.
"""

from typing import Any, NamedTuple

import numpy as np

from gliderhpc.kernels.constants_gradient import CONSTANTS
from gliderhpc.kernels.elementwise import lane_array
from gliderhpc.kernels.smoother_memory import BLOCK, GROUPS, Block, allocate_block

Array = Any


class Forcing(NamedTuple):
    """Derivatives of a dive's problem by ``eta``, of ``n`` steps and ``f`` rows with a sample.

    Attributes
    ----------
    constant, parameter, slope : (e,), (e,), (e,)
        Derivatives of the hull's constants that are not zero: which constant, by which parameter, and how much.
    moving, bodies : (m,), (n, m, 11)
        Parameters that change the mass properties, and the derivatives of these.
    reading, samples : (r,), (f, 4, r)
        Parameters that change the records, and the derivatives of the samples ``[phi, theta, psi, Z]``.
    number : (n+1,)
        Number of a row among those with a sample.
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
    """Sensitivities along one block of rows and one more, and scratch.

    Attributes
    ----------
    states, state_lanes : (m, p, 16)
        Of the filtered states and disturbances, ``d x / d eta``, transposed (in the row behind the last one filtered:
        predicted).
    track : (m, p, 2)
        Of the filtered X and Y.
    predicted : (m, 4, p)
        Of the measured less the predicted sample, of opposite sign, as each channel was assimilated.
    by_constant, by_constant_lanes : (CONSTANTS, 16)
        Derivatives of a step's ten sensed states, X and Y by the constants (`gliderhpc.kernels.constants_gradient`).
    costate, costate_lanes, half, half_lanes : (p, 16)
        Of the smoother's costate, and scratch.
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
    """What a dive says of ``eta``.

    Attributes
    ----------
    matrix : (p, p)
        Information, lower triangle.
    score : (p,)
        Gradient of the record's log likelihood.
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
        Rows in ascending order.
    states, track : (m, p, 16), (m, p, 2)
        ``d x / d eta`` there, of X and Y apart.
    displacement : (p, 2)
        Of X and Y in the last row.
    """

    rows: Array
    states: Array
    track: Array
    displacement: Array


def allocate_sensitivity(parameters: int) -> Sensitivity:
    """Memory of one block for so many parameters."""
    m, p = BLOCK + 1, parameters
    states, constants, costate, half = (lane_array(*shape, GROUPS) for shape in ((m, p), (CONSTANTS,), (p,), (p,)))
    return Sensitivity(
        states=states.reshape(m, p, 16), state_lanes=states, track=np.zeros((m, p, 2)),
        predicted=np.zeros((m, 4, p)), by_constant=constants.reshape(CONSTANTS, 16), by_constant_lanes=constants,
        costate=costate.reshape(p, 16), costate_lanes=costate, half=half.reshape(p, 16), half_lanes=half,
    )  # fmt: skip


def allocate_information(steps: int, parameters: int) -> Information:
    """Memory for the information of a dive."""
    return Information(np.zeros((parameters, parameters)), np.zeros(parameters), np.zeros((steps + 1, 16)))


def allocate_alternatives(
    steps: int, parameters: int, count: int
) -> tuple[tuple[Block, ...], tuple[Sensitivity, ...], tuple[Information, ...]]:
    """Memory for so many assumptions of a dive's noise, with the transitions and derivatives by constants in common."""
    block, sensitivity = allocate_block(), allocate_sensitivity(parameters)
    transitions = {name: getattr(block, name) for name in ("tangent", "tangent_lanes", "track_tangent", "seeds")}
    derivatives = {name: getattr(sensitivity, name) for name in ("by_constant", "by_constant_lanes")}
    blocks = (block, *(allocate_block()._replace(**transitions) for _ in range(count - 1)))
    others = (allocate_sensitivity(parameters)._replace(**derivatives) for _ in range(count - 1))
    sums = tuple(allocate_information(steps, parameters) for _ in range(count))
    return blocks, (sensitivity, *others), sums


def allocate_sensitivity_checkpoints(steps: int, parameters: int) -> SensitivityCheckpoints:
    """Memory for the checkpoints of a dive."""
    m, p = steps // BLOCK + 1, parameters
    return SensitivityCheckpoints(
        np.zeros((m, 16)), np.zeros((m, 16, 16)), np.zeros((m, 2, 16)), np.zeros((m, 2, 2)), np.zeros((m, p, 16)),
        np.zeros((m, p, 2)),
    )  # fmt: skip


def allocate_smoothed(rows: Any, parameters: int) -> SmoothedSensitivity:
    """Memory for the sensitivities in rows in ascending order."""
    wanted = np.asarray(rows, dtype=np.int64)
    m, p = len(wanted), parameters
    return SmoothedSensitivity(wanted, np.zeros((m, p, 16)), np.zeros((m, p, 2)), np.zeros((p, 2)))
