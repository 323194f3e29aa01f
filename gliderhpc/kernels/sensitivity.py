"""Sensitivity of filter and smoother to constant errors ``eta``, and the record's information on them (Friedland 1969).

In a linearised problem constants are unknowns like any other, but they need no states. Filter and smoother are linear
in their inputs; the derivative ``V = d x / d eta`` of their mean is therefore computed alongside it, with the same
gains:

    segment     V <- F V + d (end of the segment) / d eta
    sample      h = H V - d z / d eta;   I += h' h / S;   g += h' e / S;   V <- V - K h
    backwards   like the costate:  W <- F' W;   W <- (I - K H)' W + H' h / S;   V smoothed = V - P W

Information ``I`` and score ``g`` of the constants are exactly those of the problem with the constants as states
(docs/smoother.md). Filter, mean and costate are those of `gliderhpc.kernels.smoother`, over the same segments.
"""

import math

from gliderhpc.kernels.constants_gradient import CONSTANTS, HULL_CONSTANTS, by_constants
from gliderhpc.kernels.dynamics import geometry_of
from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import LANES, clear, copy, load, store
from gliderhpc.kernels.jit import inner_kernel, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.smoother_covariance import (
    multiply,
    predict_over_segment,
    symmetrise,
    transpose,
    update,
)
from gliderhpc.kernels.smoother_memory import BLOCK, copy_row
from gliderhpc.kernels.smoother_segments import (
    add_defects,
    add_noise,
    begin_products,
    gather,
    gather_noise,
    pull_back,
    run_model,
    scatter_noise,
    scatter_run,
    scatter_transition,
)
from gliderhpc.kernels.tangent import load_ten
from gliderhpc.kernels.window import sensed_of


@inner_kernel
def _gather_slopes(forcing, segments, number, gradient):
    """Copy the slopes of the mass properties of segments ``number`` to ``number + LANES`` into the lanes."""
    rows = segments.rows
    last = rows.shape[0] - 2
    for lane in range(LANES):
        segment = min(number + lane, last)
        first, stop = rows[segment], rows[segment + 1]
        for s in range(gradient.slopes.shape[0]):
            for m in range(forcing.moving.shape[0]):
                for i in range(CONSTANTS - HULL_CONSTANTS):
                    slope = forcing.bodies[first + s, m, i] if first + s < stop else 0.0
                    gradient.slopes[s, m, i, lane] = slope


@inner_kernel
def _add_gradient(hull, lanes, gradient, s):
    """Add the derivatives of the segment's end by the constants that act at step ``s``."""
    h, body = load(lanes.durations, s), load_body(lanes.bodies, s)
    sixth = h / 6.0
    b = (
        load(lanes.disturbances, (s, 0)), load(lanes.disturbances, (s, 1)), load(lanes.disturbances, (s, 2)),
        load(lanes.disturbances, (s, 3)), load(lanes.disturbances, (s, 4)), load(lanes.disturbances, (s, 5)),
    )  # fmt: skip
    clear(gradient.body)
    for number in range(4):
        y, costates = load_ten(lanes.stages, number), lanes.stage_costates[number]
        geometry = geometry_of(y)
        for i in range(12):
            found = by_constants(hull, body, y, geometry, b, load_ten(costates, i))
            for c in range(HULL_CONSTANTS):
                store(gradient.hull, (i, c), load(gradient.hull, (i, c)) + sixth * found[c])
            for c in range(CONSTANTS - HULL_CONSTANTS):
                total = load(gradient.body, (i, c)) + sixth * found[HULL_CONSTANTS + c]
                store(gradient.body, (i, c), total)
    for m in range(gradient.moving.shape[0]):
        for i in range(12):
            total = load(gradient.moving, (m, i))
            for c in range(CONSTANTS - HULL_CONSTANTS):
                total += load(gradient.slopes, (s, m, c)) * load(gradient.body, (i, c))
            store(gradient.moving, (m, i), total)


@inner_kernel
def _scatter_gradient(forcing, segments, number, gradient, sensitivity, at):
    """Write the derivatives of the segments' ends by the parameters to the rows of the block from ``at`` on."""
    for lane in range(min(LANES, segments.rows.shape[0] - 1 - number)):
        forced = sensitivity.forced[at + lane]
        clear(forced)
        for entry in range(forcing.constant.shape[0]):
            j, c, slope = forcing.parameter[entry], forcing.constant[entry], forcing.slope[entry]
            for i in range(12):
                forced[j, i] += slope * gradient.hull[i, c, lane]
        for m in range(forcing.moving.shape[0]):
            for i in range(12):
                forced[forcing.moving[m], i] += gradient.moving[m, i, lane]


@kernel
def linearise_with_constants(
    hull, dives, forcing, states, disturbances, segments, number, block, at, tally, gradient, sensitivity
):
    """Linearise segments ``number`` to ``number + LANES`` by states and parameters, and gather each dive's noise.

    `gliderhpc.kernels.smoother_segments.linearise_segments` is the same without the derivatives by parameters.

    Parameters
    ----------
    dives, segments : tuple of Dive, tuple of Segments
        The problem under each assumption of its noise. All segments share the memory of what the noise does not change.
    tally, gradient : (14,), Gradient
        Scratch.
    sensitivity : Sensitivity
        Memory, in the field `forced` of which the derivatives are stored.
    """
    shared = segments[0].lanes
    gather(dives[0], states, disturbances, segments[0], number)
    for i in range(len(dives)):
        gather_noise(dives[i], segments[i], number)
    _gather_slopes(forcing, segments[0], number, gradient)
    run_model(hull, shared)
    begin_products(shared)
    clear(gradient.hull)
    clear(gradient.moving)
    for s in range(shared.durations.shape[0] - 1, -1, -1):
        for i in range(len(dives)):
            add_noise(segments[i].lanes, s)
        add_defects(shared, s)
        pull_back(hull, dives[0].decay, shared, s)
        _add_gradient(hull, shared, gradient, s)
    scatter_run(dives[0], states, segments[0], number, tally)
    scatter_transition(segments[0], number, block, at)
    _scatter_gradient(forcing, segments[0], number, gradient, sensitivity, at)
    for i in range(len(dives)):
        scatter_noise(segments[i], number, at)


@inner_kernel
def _carry(block, sensitivity, at):
    """Carry the sensitivity over the segment of row ``at``, including X and Y."""
    before, after = sensitivity.states[at], sensitivity.states[at + 1]
    track, track_after = sensitivity.track[at], sensitivity.track[at + 1]
    multiply(before, block.tangent_lanes[at], sensitivity.state_lanes[at + 1])
    moved, forced = block.track_tangent[at], sensitivity.forced[at]
    for j in range(before.shape[0]):
        for r in range(2):
            total = track[j, r] + forced[j, 10 + r]
            for i in range(16):
                total += before[j, i] * moved[r, i]
            track_after[j, r] = total
        for i in range(10):
            after[j, i] += forced[j, i]


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


@inner_kernel
def _filter_block(
    hull, dives, forcing, states, disturbances, first, stop, segments, blocks, tally, gradient, sensitivities, sums
):
    """Filter rows ``first`` to ``stop`` (exclusive) between segments, and predict row ``stop`` if the dive has it."""
    last = segments[0].rows.shape[0] - 1
    for number in range(first, stop):
        at = number - first
        if number < last and at % LANES == 0:
            linearise_with_constants(
                hull, dives, forcing, states, disturbances, segments, number, blocks[0], at, tally, gradient,
                sensitivities[0],
            )  # fmt: skip
        k = segments[0].rows[number]
        for i in range(len(dives)):
            _assimilate(dives[i], forcing, states, k, blocks[i], at, sensitivities[i], sums[i])
            copy(blocks[i].mean[at], sums[i].filtered[number])
            if number < last:
                predict_over_segment(segments[i], blocks[i], at)
                _carry(blocks[i], sensitivities[i], at)


@kernel
def sum_information(
    hull, dives, forcing, states, disturbances, segments, blocks, tally, gradient, sensitivities, checkpoints, sums
):
    """Filter a dive with the sensitivity, and sum up its information on ``eta`` under several assumptions of its noise.

    The steps and their derivatives, which take most of the time, are common to all assumptions.

    Parameters
    ----------
    hull, dives, forcing : Hull, tuple of Dive, Forcing
        The problem under each assumption, with its final variances and noise, and its derivatives; its damping is not
        used. The assumptions differ in their variances and their noise.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation. Its rows inside the segments are replaced by the model's run, and its X and Y by the
        displacement.
    segments, blocks, sensitivities : tuple of Segments, tuple of Block, tuple of Sensitivity
        Scratch for each assumption; all share the memory of the transitions and of the derivatives by the parameters.
    tally, gradient : (14,), Gradient
        Scratch.
    checkpoints : SensitivityCheckpoints
        Results for `smooth_sensitivity`, of the first assumption; none are stored if it is empty.
    sums : tuple of Information
        Results, one for each assumption, to be filled.
    """
    rows, count = segments[0].rows.shape[0], len(dives)
    for i in range(count):
        clear(sums[i].matrix)
        clear(sums[i].score)
        _begin(dives[i], forcing, states, disturbances, blocks[i], sensitivities[i])
    for first in range(0, rows, BLOCK):
        for i in range(count):
            symmetrise(blocks[i].covariance[0])
        if checkpoints.states.shape[0] > 0:
            number = first // BLOCK
            copy_row(blocks[0], 0, checkpoints, number)
            copy(sensitivities[0].states[0], checkpoints.states[number])
            copy(sensitivities[0].track[0], checkpoints.track_states[number])
        _filter_block(
            hull, dives, forcing, states, disturbances, first, min(first + BLOCK, rows), segments, blocks, tally,
            gradient, sensitivities, sums,
        )  # fmt: skip
        for i in range(count):
            copy_row(blocks[i], BLOCK, blocks[i], 0)
            copy(sensitivities[i].states[BLOCK], sensitivities[i].states[0])
            copy(sensitivities[i].track[BLOCK], sensitivities[i].track[0])


@kernel
def smooth_sensitivity(
    hull, dives, forcing, states, disturbances, segments, blocks, tally, gradient, sensitivities, checkpoints, sums, out
):
    """Smooth the sensitivity from the end to the beginning, from the checkpoints of `sum_information`.

    Parameters
    ----------
    hull, dives, forcing, states, disturbances, segments, blocks, tally, gradient, sensitivities, checkpoints
        Arguments of `sum_information`, with a single assumption.
    sums : tuple of Information
        Scratch.
    out : SmoothedSensitivity
        Result, to be filled.
    """
    rows = segments[0].rows.shape[0]
    dive, block, sensitivity = dives[0], blocks[0], sensitivities[0]
    clear(sensitivity.costate)
    wanted = out.rows.shape[0]
    for checkpoint in range((rows - 1) // BLOCK, -1, -1):
        first = checkpoint * BLOCK
        stop = min(first + BLOCK, rows)
        copy_row(checkpoints, checkpoint, block, 0)
        copy(checkpoints.states[checkpoint], sensitivity.states[0])
        copy(checkpoints.track_states[checkpoint], sensitivity.track[0])
        _filter_block(
            hull, dives, forcing, states, disturbances, first, stop, segments, blocks, tally, gradient, sensitivities,
            sums,
        )  # fmt: skip
        if stop == rows:
            copy(sensitivity.track[rows - 1 - first], out.displacement)
        for number in range(stop - 1, first - 1, -1):
            at, k = number - first, segments[0].rows[number]
            if number < rows - 1:
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
