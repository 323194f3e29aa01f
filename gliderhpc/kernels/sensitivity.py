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
    begin_products,
    gather,
    pull_back,
    run_model,
    save_products,
    scatter_run,
    scatter_transition,
    sum_noise,
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
    hull, dive, forcing, states, disturbances, segments, number, block, at, tally, gradient, sensitivity
):
    """Linearise segments ``number`` to ``number + LANES`` by states and parameters, and save the products of each step.

    `gliderhpc.kernels.smoother_segments.linearise_segments` is the same without the derivatives by parameters, and with
    the noise.

    Parameters
    ----------
    at : int
        First row in the block, a multiple of `LANES`: the products are saved in group ``at // LANES``.
    tally, gradient : (14,), Gradient
        Scratch.
    sensitivity : Sensitivity
        Memory, in the field `forced` of which the derivatives are stored.
    """
    lanes = segments.lanes
    gather(dive, states, disturbances, segments, number)
    _gather_slopes(forcing, segments, number, gradient)
    run_model(hull, lanes)
    begin_products(lanes)
    clear(gradient.hull)
    clear(gradient.moving)
    for s in range(lanes.durations.shape[0] - 1, -1, -1):
        add_defects(lanes, s)
        save_products(lanes, at // LANES, s)
        pull_back(hull, dive.decay, lanes, s)
        _add_gradient(hull, lanes, gradient, s)
    scatter_run(dive, states, segments, number, tally)
    scatter_transition(segments, number, block, at)
    _scatter_gradient(forcing, segments, number, gradient, sensitivity, at)


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
def _absorb(forcing, sensitivity, matrix, score, k, at, channel, gain, cross, innovation, inverse):
    """Update information and score with one channel's innovation, and set ``V <- V - K h``."""
    states, track, h = sensitivity.states[at], sensitivity.track[at], sensitivity.predicted[at, channel]
    parameters = states.shape[0]
    for j in range(parameters):
        h[j] = states[j, channel]
    for r in range(forcing.reading.shape[0]):
        h[forcing.reading[r]] -= forcing.samples[forcing.number[k], channel, r]
    for j in range(parameters):
        weighted = h[j] * inverse
        score[j] += weighted * innovation
        for i in range(j + 1):
            matrix[j, i] += weighted * h[i]
        for i in range(16):
            states[j, i] -= h[j] * gain[i]
        track[j, 0] -= weighted * cross[0]
        track[j, 1] -= weighted * cross[1]


@inner_kernel
def _assimilate(measured, variance, forcing, states, k, block, at, sensitivity, matrix, score):
    """Update row ``at`` of the block and its sensitivity with the channels of sample ``k`` in turn."""
    for channel in range(measured.shape[0]):
        value = measured[channel]
        if not math.isfinite(value):
            continue
        residual = value - states[k, channel if channel < 3 else channel + 2]
        if channel == 2:
            residual = wrap(residual)
        innovation = residual - block.mean[at, channel]
        cross = (block.cross[at, 0, channel], block.cross[at, 1, channel])
        update(block, at, channel, innovation, variance[channel])
        inverse = block.information[at, channel]
        gain = block.gain[at, channel]
        _absorb(forcing, sensitivity, matrix, score, k, at, channel, gain, cross, innovation, inverse)


@inner_kernel
def _begin(dive, forcing, states, disturbances, carried):
    """Set predicted deviation, covariance and sensitivity of the first row from the prior, under every assumption."""
    y = sensed_of(states[0])
    for a in range(carried.mean.shape[0]):
        for i in range(16):
            value = y[i] if i < 10 else disturbances[0, i - 10]
            carried.mean[a, i] = dive.mean[i] - value
            for j in range(16):
                carried.covariance[a, i, j] = dive.deviation[i] * dive.deviation[i] if i == j else 0.0
        copy(forcing.start, carried.states[a])
    clear(carried.cross)
    clear(carried.track)
    clear(carried.track_states)


@inner_kernel
def _load_row(rows, i, block, sensitivity, at):
    """Copy row ``i`` of a `SensitivityRows` to row ``at`` of the block."""
    copy_row(rows, i, block, at)
    copy(rows.states[i], sensitivity.states[at])
    copy(rows.track_states[i], sensitivity.track[at])


@inner_kernel
def _save_row(block, sensitivity, at, rows, i):
    """Copy row ``at`` of the block to row ``i`` of a `SensitivityRows`."""
    copy_row(block, at, rows, i)
    copy(sensitivity.states[at], rows.states[i])
    copy(sensitivity.track[at], rows.track_states[i])


@inner_kernel
def _linearise_block(hull, dive, forcing, states, disturbances, first, stop, scratch):
    """Linearise the segments that begin in rows ``first`` to ``stop`` (exclusive)."""
    segments = scratch.segments
    for number in range(first, min(stop, segments.rows.shape[0] - 1), LANES):
        linearise_with_constants(
            hull, dive, forcing, states, disturbances, segments, number, scratch.block, number - first, scratch.tally,
            scratch.gradient, scratch.sensitivity,
        )  # fmt: skip


@inner_kernel
def _filter_block(dive, assumed, a, forcing, states, first, stop, scratch, information):
    """Filter rows ``first`` to ``stop`` (exclusive) under one assumption, and predict row ``stop`` if there is one."""
    segments, block, sensitivity = scratch.segments, scratch.block, scratch.sensitivity
    measured, variance, noise = assumed.measured[a], assumed.variance[a], assumed.noise[a]
    matrix, score, filtered = information.matrix[a], information.score[a], information.filtered[a]
    last = segments.rows.shape[0] - 1
    for number in range(first, stop):
        at, k = number - first, segments.rows[number]
        if number < last and at % LANES == 0:
            sum_noise(noise, segments, number, at // LANES, at)
        clear(block.information[at])
        if dive.fed[k]:
            _assimilate(measured[k], variance[k], forcing, states, k, block, at, sensitivity, matrix, score)
        copy(block.mean[at], filtered[number])
        if number < last:
            predict_over_segment(segments, block, at)
            _carry(block, sensitivity, at)


@kernel
def sum_information(hull, dive, assumed, forcing, states, disturbances, scratch, checkpoints, information, again, out):
    """Filter a dive with the sensitivity and sum up its information on ``eta``, under several assumptions of its noise.

    The steps and their derivatives, which take most of the time, are common to all assumptions. Where rows are asked
    for, the sensitivity is then smoothed from the end to the beginning, under the first assumption.

    Parameters
    ----------
    hull, dive, assumed, forcing : Hull, Dive, Assumptions, Forcing
        The problem and its derivatives; the dive's own samples, variances, noise and damping are not used.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation. Its rows inside the segments are replaced by the model's run, and its X and Y by the
        displacement.
    scratch, checkpoints : Scratch, SensitivityRows
        Memory; checkpoints are written only if rows are asked for.
    information, again : Information
        Result, to be filled, and memory for one assumption, in which the backward sweep adds up everything again.
    out : SmoothedSensitivity
        Sensitivities in the rows asked for, and of the displacement, to be filled; nothing is filled without rows.
    """
    block, sensitivity, carried = scratch.block, scratch.sensitivity, scratch.carried
    rows = scratch.segments.rows.shape[0]
    clear(information.matrix)
    clear(information.score)
    _begin(dive, forcing, states, disturbances, carried)
    for first in range(0, rows, BLOCK):
        stop = min(first + BLOCK, rows)
        _linearise_block(hull, dive, forcing, states, disturbances, first, stop, scratch)
        for a in range(carried.mean.shape[0]):
            _load_row(carried, a, block, sensitivity, 0)
            symmetrise(block.covariance[0])
            if a == 0 and out.rows.shape[0] > 0:
                _save_row(block, sensitivity, 0, checkpoints, first // BLOCK)
            _filter_block(dive, assumed, a, forcing, states, first, stop, scratch, information)
            _save_row(block, sensitivity, BLOCK, carried, a)
    if out.rows.shape[0] > 0:
        _smooth(hull, dive, assumed, forcing, states, disturbances, scratch, checkpoints, again, out)


@inner_kernel
def _smooth(hull, dive, assumed, forcing, states, disturbances, scratch, checkpoints, again, out):
    """Smooth the sensitivity from the end to the beginning, from the checkpoints."""
    segments, block, sensitivity = scratch.segments, scratch.block, scratch.sensitivity
    rows, wanted = segments.rows.shape[0], out.rows.shape[0]
    clear(sensitivity.costate)
    for checkpoint in range((rows - 1) // BLOCK, -1, -1):
        first = checkpoint * BLOCK
        stop = min(first + BLOCK, rows)
        _load_row(checkpoints, checkpoint, block, sensitivity, 0)
        _linearise_block(hull, dive, forcing, states, disturbances, first, stop, scratch)
        _filter_block(dive, assumed, 0, forcing, states, first, stop, scratch, again)
        if stop == rows:
            copy(sensitivity.track[rows - 1 - first], out.displacement)
        for number in range(stop - 1, first - 1, -1):
            at, k = number - first, segments.rows[number]
            if number < rows - 1:
                _undo_step(block, at, sensitivity)
            if wanted > 0 and out.rows[wanted - 1] == k:
                wanted -= 1
                _smoothed(block, at, sensitivity, out.states[wanted], out.track[wanted])
            if dive.fed[k]:
                for channel in range(assumed.measured.shape[2] - 1, -1, -1):
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
