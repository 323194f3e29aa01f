"""Sensitivity of filter and smoother to constant errors ``eta``, and the record's information on them (Friedland 1969).

In a linearised problem constants are unknowns like any other, but they need no states. Filter and smoother are linear
in their inputs; the derivative ``V = d x / d eta`` of their mean is therefore computed alongside it, with the same
gains:

    segment     V <- F V + d (end of the segment) / d eta
    sample      h = H V - d z / d eta;   I += h' h / S;   g += h' e / S;   V <- V - K h
    backwards   like the costate:  W <- F' W;   W <- (I - K H)' W + H' h / S;   V smoothed = V - P W

Information ``I`` and score ``g`` of the constants are exactly those of the problem with the constants as states
(docs/smoother.md). Filter, mean and costate are those of `gliderhpc.kernels.smoother`, over the same segments.
Parameters are the columns of all sensitivities, and are computed in lanes.
"""

import math

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import LANES, clear, copy, load_along, store_along, with_columns, with_sizes
from gliderhpc.kernels.jit import inner_kernel, kernel
from gliderhpc.kernels.sensitivity_segments import linearise_with_constants
from gliderhpc.kernels.smoother_covariance import predict_over_segment, symmetrise, update
from gliderhpc.kernels.smoother_memory import BLOCK, copy_row
from gliderhpc.kernels.smoother_segments import sum_noise, write_transition
from gliderhpc.kernels.window import sensed_of


@inner_kernel
def _carry(block, sensitivity, at):
    """Carry the sensitivity over the segment of row ``at``, including X and Y."""
    before, after = sensitivity.states[at], sensitivity.states[at + 1]
    track, track_after = sensitivity.track[at], sensitivity.track[at + 1]
    tangent, moved, forced = block.tangent[at], block.track_tangent[at], sensitivity.forced[at]
    for first in range(0, before.shape[1], LANES):
        for i in range(0, 10, 5):
            a, b = load_along(forced, (i, first)), load_along(forced, (i + 1, first))
            c, d = load_along(forced, (i + 2, first)), load_along(forced, (i + 3, first))
            e = load_along(forced, (i + 4, first))
            for k in range(16):
                row = load_along(before, (k, first))
                a += tangent[k, i] * row
                b += tangent[k, i + 1] * row
                c += tangent[k, i + 2] * row
                d += tangent[k, i + 3] * row
                e += tangent[k, i + 4] * row
            store_along(after, (i, first), a)
            store_along(after, (i + 1, first), b)
            store_along(after, (i + 2, first), c)
            store_along(after, (i + 3, first), d)
            store_along(after, (i + 4, first), e)
        a = load_along(track, (0, first)) + load_along(forced, (10, first))
        b = load_along(track, (1, first)) + load_along(forced, (11, first))
        for k in range(16):
            row = load_along(before, (k, first))
            a += moved[0, k] * row
            b += moved[1, k] * row
        store_along(track_after, (0, first), a)
        store_along(track_after, (1, first), b)
        for i in range(10, 16):
            store_along(after, (i, first), tangent[i, i] * load_along(before, (i, first)))


@inner_kernel
def _assimilate(measured, variance, forcing, states, k, block, at, sensitivity, score, before):
    """Update row ``at`` of the block and its sensitivity with the channels of sample ``k`` in turn.

    The innovations' sensitivities follow the ``before`` ones that the block has already; their new number is returned.
    """
    count = before
    for channel in range(measured.shape[0]):
        value = measured[channel]
        if not math.isfinite(value):
            continue
        residual = value - states[k, channel if channel < 3 else channel + 2]
        if channel == 2:
            residual = wrap(residual)
        innovation = residual - block.mean[at, channel]
        for r in range(2):
            sensitivity.cross[count, r] = block.cross[at, r, channel]
        update(block, at, channel, innovation, variance[channel])
        sensitivity.channel[count] = channel
        sensitivity.weight[count] = block.information[at, channel]
        sensitivity.scaled[count] = block.scaled_innovation[at, channel]
        count += 1
    _absorb(forcing, sensitivity, score, k, at, block.gain[at], before, count)
    return count


@inner_kernel
def _absorb(forcing, sensitivity, score, k, at, gain, before, count):
    """Set ``V <- V - K h`` for the innovations from ``before`` to ``count``, store each ``h``, and update the score."""
    states, track, predicted = sensitivity.states[at], sensitivity.track[at], sensitivity.predicted
    for n in range(before, count):
        for first in range(0, states.shape[1], LANES):
            store_along(predicted, (n, first), load_along(states, (sensitivity.channel[n], first)))
        for r in range(forcing.reading.shape[0]):
            predicted[n, forcing.reading[r]] -= forcing.samples[forcing.number[k], sensitivity.channel[n], r]
    for first in range(0, states.shape[1], LANES):
        for n in range(before, count):
            h = load_along(predicted, (n, first))
            for m in range(before, n):
                h -= gain[sensitivity.channel[m], sensitivity.channel[n]] * load_along(predicted, (m, first))
            store_along(predicted, (n, first), h)
            store_along(score, (first,), load_along(score, (first,)) + sensitivity.scaled[n] * h)
            for r in range(2):
                total = load_along(track, (r, first)) - sensitivity.cross[n, r] * sensitivity.weight[n] * h
                store_along(track, (r, first), total)
        for i in range(0, 16, 4):
            a, b = load_along(states, (i, first)), load_along(states, (i + 1, first))
            c, d = load_along(states, (i + 2, first)), load_along(states, (i + 3, first))
            for n in range(before, count):
                h, channel = load_along(predicted, (n, first)), sensitivity.channel[n]
                a -= gain[channel, i] * h
                b -= gain[channel, i + 1] * h
                c -= gain[channel, i + 2] * h
                d -= gain[channel, i + 3] * h
            store_along(states, (i, first), a)
            store_along(states, (i + 1, first), b)
            store_along(states, (i + 2, first), c)
            store_along(states, (i + 3, first), d)


@inner_kernel
def _add_information(sensitivity, count, matrix):
    """Add ``h' h / S`` of the block's ``count`` innovations to the lower triangle of the information."""
    predicted, weighted = sensitivity.predicted, sensitivity.weighted
    for n in range(count):
        for first in range(0, predicted.shape[1], LANES):
            store_along(weighted, (n, first), sensitivity.weight[n] * load_along(predicted, (n, first)))
    for j in range(0, predicted.shape[1], 4):
        for first in range(0, j + 4, LANES):
            a, b = load_along(matrix, (j, first)), load_along(matrix, (j + 1, first))
            c, d = load_along(matrix, (j + 2, first)), load_along(matrix, (j + 3, first))
            for n in range(count):
                row = load_along(predicted, (n, first))
                a += weighted[n, j] * row
                b += weighted[n, j + 1] * row
                c += weighted[n, j + 2] * row
                d += weighted[n, j + 3] * row
            store_along(matrix, (j, first), a)
            store_along(matrix, (j + 1, first), b)
            store_along(matrix, (j + 2, first), c)
            store_along(matrix, (j + 3, first), d)


@inner_kernel
def _begin(problem, forcing, states, disturbances, carried):
    """Set predicted deviation, covariance and sensitivity of the first row from the prior, under every assumption."""
    y = sensed_of(states[0])
    clear(carried.states)
    for a in range(carried.mean.shape[0]):
        for i in range(16):
            value = y[i] if i < 10 else disturbances[0, i - 10]
            carried.mean[a, i] = problem.mean[i] - value
            for j in range(16):
                carried.covariance[a, i, j] = problem.deviation[i] * problem.deviation[i] if i == j else 0.0
            for j in range(forcing.start.shape[0]):
                carried.states[a, i, j] = forcing.start[j, i]
    clear(carried.cross)
    clear(carried.track)
    clear(carried.track_states)


@inner_kernel
def _linearise_block(hull, problem, forcing, states, disturbances, first, stop, scratch):
    """Linearise the segments that begin in rows ``first`` to ``stop`` (exclusive)."""
    segments = scratch.segments
    for number in range(first, min(stop, segments.rows.shape[0] - 1), LANES):
        linearise_with_constants(
            hull, problem, forcing, states, disturbances, segments, number, scratch.block, number - first,
            scratch.tally, scratch.gradient, scratch.sensitivity,
        )  # fmt: skip


@inner_kernel
def _filter_block(problem, assumed, a, forcing, states, first, stop, scratch, information, tape, out, done):
    """Filter rows ``first`` to ``stop`` (exclusive) under one assumption, and predict row ``stop`` if there is one.

    The backward sweep needs the transitions and updates of the first assumption, which are stored on the tape, and the
    state of the filter in the requested rows, of which ``done`` were done before; return their new number.
    """
    segments, block, sensitivity = scratch.segments, scratch.block, scratch.sensitivity
    measured, variance, noise = assumed.measured[a], assumed.variance[a], assumed.noise[a]
    score, filtered = information.score[a], information.filtered[a]
    last = segments.rows.shape[0] - 1
    taped = a == 0 and out.rows.shape[0] > 0
    count = 0
    for number in range(first, stop):
        at, k = number - first, segments.rows[number]
        if number < last and at % LANES == 0:
            sum_noise(noise, segments, number, at // LANES, at)
        clear(block.information[at])
        before = count
        if problem.fed[k]:
            count = _assimilate(measured[k], variance[k], forcing, states, k, block, at, sensitivity, score, count)
        copy(block.mean[at], filtered[number])
        if taped:
            _write_updates(block, sensitivity, at, before, tape, forcing.number[k])
            if number < last:
                write_transition(block.tangent[at], tape.transition[number])
            else:
                copy(sensitivity.track[at], out.displacement)
            if done < out.rows.shape[0] and out.rows[done] == k:
                copy(sensitivity.states[at], out.states[done])
                copy(sensitivity.track[at], out.track[done])
                copy(block.covariance[at], tape.covariance[done])
                copy(block.cross[at], tape.cross[done])
                done += 1
        if number < last:
            predict_over_segment(segments, block, at)
            _carry(block, sensitivity, at)
    _add_information(sensitivity, count, information.matrix[a])
    return done


@inner_kernel
def _write_updates(block, sensitivity, at, count, tape, sample):
    """Write the updates of row ``at``, the first of them the block's innovation ``count``, to the tape."""
    for channel in range(tape.gain.shape[1]):
        if block.information[at, channel] > 0.0:
            copy(block.gain[at, channel], tape.gain[sample, channel])
            copy(sensitivity.predicted[count], tape.predicted[sample, channel])
            tape.inverse[sample, channel] = block.information[at, channel]
            count += 1


@kernel
def sum_information(hull, problem, assumed, forcing, states, disturbances, scratch, information, tape, out):
    """Filter a profile with the sensitivity, and sum its information on ``eta`` under several assumptions of its noise.

    The steps and their derivatives, which take most of the time, are common to all assumptions. Where rows are asked
    for, the sensitivity is then smoothed from the end to the beginning, under the first assumption.

    Parameters
    ----------
    hull, problem, assumed, forcing : Hull, SmootherProblem, Assumptions, Forcing
        The problem and its derivatives; the profile's own samples, variances, noise and damping are not used.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path of linearisation. Its rows inside the segments are replaced by the model's run, and its X and Y by the
        displacement.
    scratch : Scratch
        Memory.
    information : ErrorInformation
        Result, to be filled; zero at first.
    tape : SensitivityTape
        Memory of the forward sweep for the backward sweep; not used without rows.
    out : SmoothedSensitivity
        Sensitivities in the requested rows, and of the displacement, to be filled; nothing is filled without rows.
    """
    problem, assumed, forcing = with_sizes(problem), with_sizes(assumed), with_sizes(forcing)
    scratch = with_sizes(scratch)
    information, tape, out = with_sizes(information), with_sizes(tape), with_sizes(out)
    states, disturbances = with_columns(states, 12), with_columns(disturbances, 6)
    block, sensitivity, carried = scratch.block, scratch.sensitivity, scratch.carried
    rows, done = scratch.segments.rows.shape[0], 0
    _begin(problem, forcing, states, disturbances, carried)
    for first in range(0, rows, BLOCK):
        stop = min(first + BLOCK, rows)
        _linearise_block(hull, problem, forcing, states, disturbances, first, stop, scratch)
        for a in range(carried.mean.shape[0]):
            copy_row(carried, a, block, 0)
            copy(carried.states[a], sensitivity.states[0])
            copy(carried.track_states[a], sensitivity.track[0])
            symmetrise(block.covariance[0])
            done = _filter_block(
                problem, assumed, a, forcing, states, first, stop, scratch, information, tape, out, done
            )
            copy_row(block, BLOCK, carried, a)
            copy(sensitivity.states[BLOCK], carried.states[a])
            copy(sensitivity.track[BLOCK], carried.track_states[a])
    if out.rows.shape[0] > 0:
        _smooth(problem, forcing, scratch, tape, out)


@inner_kernel
def _smooth(problem, forcing, scratch, tape, out):
    """Smooth the sensitivity from the end to the beginning, from the tape."""
    segments, sensitivity = scratch.segments, scratch.sensitivity
    rows, wanted = segments.rows.shape[0], out.rows.shape[0]
    clear(sensitivity.costate)
    for number in range(rows - 1, -1, -1):
        k = segments.rows[number]
        if number < rows - 1:
            _undo_step(tape.transition[number], sensitivity)
        if wanted > 0 and out.rows[wanted - 1] == k:
            wanted -= 1
            covariance, cross = tape.covariance[wanted], tape.cross[wanted]
            _subtract(covariance, sensitivity.costate, out.states[wanted])
            _subtract(cross, sensitivity.costate, out.track[wanted])
        if problem.fed[k]:
            sample = forcing.number[k]
            for channel in range(tape.gain.shape[1] - 1, -1, -1):
                if tape.inverse[sample, channel] > 0.0:
                    _undo_update(tape, sample, channel, sensitivity.costate)


@inner_kernel
def _undo_step(transition, sensitivity):
    """Carry the costate's sensitivity from after a step to before it, by its transition."""
    after, before = sensitivity.costate, sensitivity.half
    copy(after, before)
    for first in range(0, after.shape[1], LANES):
        for k in range(0, 16, 4):
            row = load_along(before, (0, first))
            a, b, c, d = (
                transition[0, k] * row, transition[0, k + 1] * row,
                transition[0, k + 2] * row, transition[0, k + 3] * row,
            )  # fmt: skip
            for i in range(1, 10):
                row = load_along(before, (i, first))
                a += transition[i, k] * row
                b += transition[i, k + 1] * row
                c += transition[i, k + 2] * row
                d += transition[i, k + 3] * row
            store_along(after, (k, first), a)
            store_along(after, (k + 1, first), b)
            store_along(after, (k + 2, first), c)
            store_along(after, (k + 3, first), d)
        for k in range(10, 16):
            total = load_along(after, (k, first)) + transition[10, k] * load_along(before, (k, first))
            store_along(after, (k, first), total)


@inner_kernel
def _undo_update(tape, sample, channel, costate):
    """Carry the costate's sensitivity from after an update to before it, ``W <- (I - K H)' W + H' h / S``."""
    gain, inverse = tape.gain[sample, channel], tape.inverse[sample, channel]
    for first in range(0, costate.shape[1], LANES):
        total = load_along(costate, (channel, first)) + inverse * load_along(tape.predicted, (sample, channel, first))
        for i in range(16):
            total -= gain[i] * load_along(costate, (i, first))
        store_along(costate, (channel, first), total)


@inner_kernel
def _subtract(left, right, out):
    """Subtract ``left (m, 16) right (16, p)`` from ``out (m, p)``."""
    for i in range(left.shape[0]):
        for first in range(0, out.shape[1], LANES):
            total = load_along(out, (i, first))
            for k in range(16):
                total -= left[i, k] * load_along(right, (k, first))
            store_along(out, (i, first), total)
