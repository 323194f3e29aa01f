"""Sensitivity of filter and smoother to constant errors ``eta``, and the record's information on them (Friedland 1969).

In a linearised problem constants are unknowns like any other, but they need no states. Filter and smoother are linear
in their inputs; the derivative ``V = d x / d eta`` of their mean is therefore computed alongside it, with the same
gains:

    step        V <- F V + d step / d eta
    sample      h = H V - d z / d eta;   I += h' h / S;   g += h' e / S;   V <- V - K h
    backwards   like the costate:  W <- F' W;   W <- (I - K H)' W + H' h / S;   V smoothed = V - P W

Information ``I`` and score ``g`` of the constants are exactly those of the problem with the constants as states
(docs/smoother.md). Filter, mean and costate are those of `gliderhpc.kernels.smoother`.
"""

import math

from gliderhpc.kernels.constants_gradient import CONSTANTS, HULL_CONSTANTS, by_constants
from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import clear, copy, load, store
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import displacement, step
from gliderhpc.kernels.smoother_covariance import multiply, predict, symmetrise, transpose, update
from gliderhpc.kernels.smoother_memory import BLOCK, GROUPS, copy_row
from gliderhpc.kernels.smoother_tangent import separate_track, step_vjp_with_track
from gliderhpc.kernels.window import sensed_of


@formula
def _add_gradient(hull, body, y, geometry, b, a, lanes, group):
    """Add the gradient of one stage's rates with respect to the constants to a group of ``lanes (CONSTANTS, 16)``."""
    gradient = by_constants(hull, body, y, geometry, b, a)
    for i in range(CONSTANTS):
        store(lanes, (i, group), load(lanes, (i, group)) + gradient[i])


@kernel
def step_by_state_and_constants(hull, dive, states, disturbances, k, block, at, sensitivity):
    """Step from row ``k`` of the path; store its transition in row ``at`` of the block, and derivatives by constants.

    Returns
    -------
    tuple of 10, float, float
        Sensed states after the step, and its displacement north and east (m).
    """
    body, h = load_body(dive.bodies, k), dive.step
    disturbance = disturbances[k]
    b = (disturbance[0], disturbance[1], disturbance[2], disturbance[3], disturbance[4], disturbance[5])
    new, stages, geometry = step(hull, body, sensed_of(states[k]), b, h)
    seeds, lanes, gradient = block.seeds, block.tangent_lanes[at], sensitivity.by_constant_lanes
    clear(sensitivity.by_constant)
    for group in range(GROUPS):
        a = (
            load(seeds, (0, group)), load(seeds, (1, group)), load(seeds, (2, group)), load(seeds, (3, group)),
            load(seeds, (4, group)), load(seeds, (5, group)), load(seeds, (6, group)), load(seeds, (7, group)),
            load(seeds, (8, group)), load(seeds, (9, group)),
        )  # fmt: skip
        e, g, costates = step_vjp_with_track(
            hull, body, stages, geometry, a, load(seeds, (10, group)), load(seeds, (11, group)), h
        )
        for j in range(10):
            store(lanes, (j, group), e[j])
        for j in range(6):
            store(lanes, (10 + j, group), g[j])
        _add_gradient(hull, body, stages[0], geometry[0], b, costates[0], gradient, group)
        _add_gradient(hull, body, stages[1], geometry[1], b, costates[1], gradient, group)
        _add_gradient(hull, body, stages[2], geometry[2], b, costates[2], gradient, group)
        _add_gradient(hull, body, stages[3], geometry[3], b, costates[3], gradient, group)
    separate_track(dive.decay, block.tangent[at], block.track_tangent[at])
    north, east = displacement(stages, h)
    return new, north, east


@inner_kernel
def _carry(forcing, block, sensitivity, k, at):
    """Carry the sensitivity over the step of row ``at``: ``V <- F V + d step / d eta``, including X and Y."""
    before, after = sensitivity.states[at], sensitivity.states[at + 1]
    track, track_after = sensitivity.track[at], sensitivity.track[at + 1]
    multiply(before, block.tangent_lanes[at], sensitivity.state_lanes[at + 1])
    moved = block.track_tangent[at]
    for j in range(before.shape[0]):
        for r in range(2):
            total = track[j, r]
            for i in range(16):
                total += before[j, i] * moved[r, i]
            track_after[j, r] = total
    for entry in range(forcing.constant.shape[0]):
        row, j = sensitivity.by_constant[forcing.constant[entry]], forcing.parameter[entry]
        _force(after[j], track_after[j], row, forcing.slope[entry])
    for number in range(forcing.moving.shape[0]):
        j = forcing.moving[number]
        for i in range(CONSTANTS - HULL_CONSTANTS):
            slope = forcing.bodies[k, number, i]
            if slope != 0.0:
                _force(after[j], track_after[j], sensitivity.by_constant[HULL_CONSTANTS + i], slope)


@inner_kernel
def _force(states, track, row, slope):
    """Add a constant's effect on the sensed states, X and Y, times the derivative of the constant itself."""
    for i in range(10):
        states[i] += slope * row[i]
    track[0] += slope * row[10]
    track[1] += slope * row[11]


@inner_kernel
def _absorb(forcing, sensitivity, information, k, at, channel, gain, cross, innovation, inverse):
    """Update information and score with one channel's innovation, and set ``V <- V - K h``."""
    states, track, h = sensitivity.states[at], sensitivity.track[at], sensitivity.predicted[at, channel]
    parameters = states.shape[0]
    for j in range(parameters):
        h[j] = states[j, channel]
    for r in range(forcing.reading.shape[0]):
        h[forcing.reading[r]] -= forcing.samples[forcing.number[k], channel, r]
    for j in range(parameters):
        weighted = h[j] * inverse
        information.score[j] += weighted * innovation
        for i in range(j + 1):
            information.matrix[j, i] += weighted * h[i]
        for i in range(16):
            states[j, i] -= h[j] * gain[i]
        track[j, 0] -= weighted * cross[0]
        track[j, 1] -= weighted * cross[1]


@inner_kernel
def _assimilate(dive, forcing, states, k, block, at, sensitivity, information):
    """Update row ``at`` of the block and its sensitivity with the channels of sample ``k`` in turn."""
    clear(block.information[at])
    if not dive.fed[k]:
        return
    for channel in range(4):
        value = dive.measured[k, channel]
        if not math.isfinite(value):
            continue
        residual = value - states[k, 5 if channel == 3 else channel]
        if channel == 2:
            residual = wrap(residual)
        innovation = residual - block.mean[at, channel]
        cross = (block.cross[at, 0, channel], block.cross[at, 1, channel])
        update(block, at, channel, innovation, dive.variance[k, channel])
        inverse = block.information[at, channel]
        _absorb(forcing, sensitivity, information, k, at, channel, block.gain[at, channel], cross, innovation, inverse)


@inner_kernel
def _advance(hull, dive, forcing, states, disturbances, k, block, at, sensitivity):
    """Predict row ``at + 1`` of the block and its sensitivity from row ``at``, which is row ``k`` of the dive."""
    new, _, _ = step_by_state_and_constants(hull, dive, states, disturbances, k, block, at, sensitivity)
    _predict(dive, forcing, states, disturbances, k, new, block, at, sensitivity)


@inner_kernel
def _predict(dive, forcing, states, disturbances, k, new, block, at, sensitivity):
    """Predict row ``at + 1`` from row ``at``, with the stored transition of the step to the sensed states ``new``."""
    following = sensed_of(states[k + 1])
    mean, tangent, predicted = block.mean[at], block.tangent[at], block.mean[at + 1]
    for i in range(16):
        total = 0.0
        for j in range(16):
            total += mean[j] * tangent[j, i]
        predicted[i] = total
    for i in range(10):
        predicted[i] += new[i] - following[i]
    for i in range(6):
        predicted[10 + i] += dive.decay[i] * disturbances[k, i] - disturbances[k + 1, i]
    predict(dive.noise[k], block, at)
    _carry(forcing, block, sensitivity, k, at)


@inner_kernel
def _filter_block(hull, dive, forcing, states, disturbances, first, stop, block, sensitivity, information):
    """Filter rows ``first`` to ``stop`` (exclusive), and predict row ``stop`` if the dive has it."""
    for k in range(first, stop):
        at = k - first
        _assimilate(dive, forcing, states, k, block, at, sensitivity, information)
        copy(block.mean[at], information.filtered[k])
        if k < dive.bodies.shape[0]:
            _advance(hull, dive, forcing, states, disturbances, k, block, at, sensitivity)


@inner_kernel
def _begin(dive, forcing, states, disturbances, block, sensitivity):
    """Set predicted deviation, covariance and sensitivity of row 0 from the prior."""
    y = sensed_of(states[0])
    for i in range(16):
        value = y[i] if i < 10 else disturbances[0, i - 10]
        block.mean[0, i] = dive.mean[i] - value
        for j in range(16):
            block.covariance[0, i, j] = dive.deviation[i] * dive.deviation[i] if i == j else 0.0
    clear(block.cross[0])
    clear(block.track[0])
    copy(forcing.start, sensitivity.states[0])
    clear(sensitivity.track[0])


@kernel
def sweep(hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, information, scratch, out):
    """Filter the dive with the sensitivity, then smooth the sensitivity: one kernel, since most code is common to both.

    Parameters
    ----------
    hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, information
        Arguments of `filter_with_sensitivity`.
    scratch, out : Information, SmoothedSensitivity
        Arguments of `smooth_sensitivity`.
    """
    filter_with_sensitivity(hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, information)
    smooth_sensitivity(hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, scratch, out)


@inner_kernel
def filter_with_sensitivity(hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, information):
    """Filter the dive about a path with the sensitivity, store checkpoints, and sum up its information on ``eta``.

    Parameters
    ----------
    hull, dive, forcing : Hull, Dive, Forcing
        The problem, with its final variances and noise, and its derivatives; its damping and its mean shift are not
        used.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation.
    block, sensitivity : Block, Sensitivity
        Scratch.
    checkpoints, information : SensitivityCheckpoints, Information
        Results, to be filled.
    """
    clear(information.matrix)
    clear(information.score)
    rows = states.shape[0]
    _begin(dive, forcing, states, disturbances, block, sensitivity)
    for first in range(0, rows, BLOCK):
        number, stop = first // BLOCK, min(first + BLOCK, rows)
        symmetrise(block.covariance[0])
        copy_row(block, 0, checkpoints, number)
        copy(sensitivity.states[0], checkpoints.states[number])
        copy(sensitivity.track[0], checkpoints.track_states[number])
        _filter_block(hull, dive, forcing, states, disturbances, first, stop, block, sensitivity, information)
        _begin_next(block, sensitivity)


@inner_kernel
def _begin_next(block, sensitivity):
    """Make the row after a block the first row of the next block."""
    copy_row(block, BLOCK, block, 0)
    copy(sensitivity.states[BLOCK], sensitivity.states[0])
    copy(sensitivity.track[BLOCK], sensitivity.track[0])


@kernel
def sum_information(hull, dives, forcing, states, disturbances, blocks, sensitivities, sums):
    """Sum up the information of a dive on ``eta`` under several assumptions of its noise, about one path.

    The step and its derivatives, which take most of the time, are common to all assumptions.

    Parameters
    ----------
    hull, forcing : Hull, Forcing
        Arguments of `filter_with_sensitivity`.
    dives : tuple of Dive
        The problem under each assumption; they differ in their variances and their noise.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation.
    blocks, sensitivities : tuple of Block, tuple of Sensitivity
        Scratch for each assumption; all share the memory of the transitions and of the derivatives by constants.
    sums : tuple of Information
        Results, one for each assumption, to be filled.
    """
    rows, count = states.shape[0], len(dives)
    for i in range(count):
        clear(sums[i].matrix)
        clear(sums[i].score)
        _begin(dives[i], forcing, states, disturbances, blocks[i], sensitivities[i])
    for first in range(0, rows, BLOCK):
        for i in range(count):
            symmetrise(blocks[i].covariance[0])
        for k in range(first, min(first + BLOCK, rows)):
            at = k - first
            for i in range(count):
                _assimilate(dives[i], forcing, states, k, blocks[i], at, sensitivities[i], sums[i])
                copy(blocks[i].mean[at], sums[i].filtered[k])
            if k < rows - 1:
                new, _, _ = step_by_state_and_constants(
                    hull, dives[0], states, disturbances, k, blocks[0], at, sensitivities[0]
                )
                for i in range(count):
                    _predict(dives[i], forcing, states, disturbances, k, new, blocks[i], at, sensitivities[i])
        for i in range(count):
            _begin_next(blocks[i], sensitivities[i])


@inner_kernel
def smooth_sensitivity(hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints, information, out):
    """Smooth the sensitivity from the end to the beginning, from the checkpoints of `filter_with_sensitivity`.

    Parameters
    ----------
    hull, dive, forcing, states, disturbances, block, sensitivity, checkpoints
        Arguments of `filter_with_sensitivity`.
    information : Information
        Scratch.
    out : SmoothedSensitivity
        Result, to be filled.
    """
    rows = states.shape[0]
    clear(sensitivity.costate)
    wanted = out.rows.shape[0]
    for number in range((rows - 1) // BLOCK, -1, -1):
        first = number * BLOCK
        stop = min(first + BLOCK, rows)
        copy_row(checkpoints, number, block, 0)
        copy(checkpoints.states[number], sensitivity.states[0])
        copy(checkpoints.track_states[number], sensitivity.track[0])
        _filter_block(hull, dive, forcing, states, disturbances, first, stop, block, sensitivity, information)
        if stop == rows:
            copy(sensitivity.track[rows - 1 - first], out.displacement)
        for k in range(stop - 1, first - 1, -1):
            at = k - first
            if k < rows - 1:
                _undo_step(block, at, sensitivity)
            if wanted > 0 and out.rows[wanted - 1] == k:
                wanted -= 1
                _smoothed(block, at, sensitivity, out.states[wanted], out.track[wanted])
            if dive.fed[k]:
                for channel in range(3, -1, -1):
                    if block.information[at, channel] > 0.0:
                        _undo_update(block, at, channel, sensitivity)


@inner_kernel
def _undo_step(block, at, sensitivity):
    """Carry the costate's sensitivity from after the step of row ``at`` to before it."""
    transpose(block.tangent[at])
    multiply(sensitivity.costate, block.tangent_lanes[at], sensitivity.half_lanes)
    copy(sensitivity.half, sensitivity.costate)


@inner_kernel
def _undo_update(block, at, channel, sensitivity):
    """Carry the costate's sensitivity from after an update to before it, ``W <- (I - K H)' W + H' h / S``."""
    gain, inverse, costate = block.gain[at, channel], block.information[at, channel], sensitivity.costate
    for j in range(costate.shape[0]):
        along = 0.0
        for i in range(16):
            along += gain[i] * costate[j, i]
        costate[j, channel] += inverse * sensitivity.predicted[at, channel, j] - along


@inner_kernel
def _smoothed(block, at, sensitivity, states, track):
    """Compute the sensitivity of the smoothed row ``at``: ``V - P W``, including X and Y."""
    multiply(sensitivity.costate, block.covariance_lanes[at], sensitivity.half_lanes)
    for j in range(states.shape[0]):
        for i in range(16):
            states[j, i] = sensitivity.states[at, j, i] - sensitivity.half[j, i]
        for r in range(2):
            total = sensitivity.track[at, j, r]
            for i in range(16):
                total -= block.cross[at, r, i] * sensitivity.costate[j, i]
            track[j, r] = total
