"""One pass of the iterated smoother over a profile: the filter forwards about a path, its costates backwards.

The pass is a Gauss-Newton step of the profile's maximum a posteriori problem. The profile is divided into segments of a
few steps, between samples. The path is free in the first row of every segment; inside, it is the model's run with the
path's disturbances. The defect of a row is the difference between the run from the previous row and the row itself. In
deviations from the path the problem is linear (`gliderhpc.kernels.smoother_segments`). The forward sweep solves it up
to each row, and the backward sweep adds the information of the later samples (Bierman's modified Bryson-Frazier form).
Intermediate results of the forward sweep that the backward one needs are stored on a tape: computing them twice would
take longer than reading them from memory.
"""

import math

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import (
    LANES,
    clear,
    copy,
    load_along,
    prefetch,
    store_along,
    with_columns,
    with_sizes,
)
from gliderhpc.kernels.jit import inner_kernel, kernel
from gliderhpc.kernels.smoother_covariance import (
    predict_over_segment,
    smoothed_covariance,
    smoothed_mean,
    smoothed_noise,
    smoothed_variances,
    symmetrise,
    undo_step,
    undo_update,
    update,
)
from gliderhpc.kernels.smoother_mean_shift import expected_mean_shift
from gliderhpc.kernels.smoother_memory import BLOCK, LOG_DETERMINANT, copy_row
from gliderhpc.kernels.smoother_segments import (
    linearise_segments,
    run_segments,
    scatter_after,
    scatter_products,
    write_transition,
)
from gliderhpc.kernels.window import sensed_of

_AHEAD = 4
"""Number of rows by which a prefetch is ahead of the row that is read."""


@inner_kernel
def _begin(problem, states, disturbances, block):
    """Set predicted deviation and covariance of row 0 from the prior."""
    y = sensed_of(states[0])
    for i in range(16):
        value = y[i] if i < 10 else disturbances[0, i - 10]
        deviation = problem.deviation[i]
        block.mean[0, i] = problem.mean[i] - value
        for j in range(16):
            block.covariance[0, i, j] = deviation * deviation if i == j else 0.0
    clear(block.cross[0])
    clear(block.track[0])


@inner_kernel
def _add_cost_of_start(problem, states, disturbances, tally):
    """Add the cost of the path's initial state."""
    y = sensed_of(states[0])
    for i in range(16):
        value = y[i] if i < 10 else disturbances[0, i - 10]
        if problem.deviation[i] > 0.0:
            tally[0] += 0.5 * ((value - problem.mean[i]) / problem.deviation[i]) ** 2


@inner_kernel
def _residual(problem, states, k, channel):
    """Return the deviation of a channel of sample ``k``, which must exist, from the path."""
    residual = problem.measured[k, channel] - states[k, channel if channel < 3 else channel + 2]
    return wrap(residual) if channel == 2 else residual


@inner_kernel
def _assimilate(problem, states, k, block, at, gate, tally):
    """Update row ``at`` of the block with the channels of sample ``k``, one by one; inflate variances to the gate."""
    clear(block.information[at])
    if not problem.fed[k]:
        return
    for channel in range(problem.measured.shape[1]):
        if not math.isfinite(problem.measured[k, channel]):
            continue
        residual = _residual(problem, states, k, channel)
        innovation = residual - block.mean[at, channel]
        excess = innovation * innovation / (gate * gate) - block.covariance[at, channel, channel]
        variance = max(problem.variance[k, channel], excess)
        problem.variance[k, channel] = variance
        tally[1] += 0.5 * residual * residual / variance
        tally[LOG_DETERMINANT] += 0.5 * math.log1p(block.covariance[at, channel, channel] / variance)
        update(block, at, channel, innovation, variance)
    for i in range(6):
        # A measured velocity needs no damping.
        if math.isfinite(problem.damping[i]) and block.information[at, 4 + i] == 0.0:
            update(block, at, 4 + i, -block.mean[at, 4 + i], problem.damping[i])


@inner_kernel
def _apply_mean_shift(mean_shift, block, at):
    """Shift the mean of row ``at`` of the block according to the cost's linear term for that row."""
    for first in range(0, 16, LANES):
        total = load_along(block.mean, (at, first))
        for j in range(16):
            total -= mean_shift[j] * load_along(block.covariance, (at, j, first))
        store_along(block.mean, (at, first), total)


@inner_kernel
def _filter_block(hull, problem, states, disturbances, mean_shift, first, stop, segments, block, gate, tally, tape):
    """Filter rows ``first`` to ``stop`` (exclusive) between segments, and predict row ``stop`` if there is one."""
    last = segments.rows.shape[0] - 1
    for number in range(first, stop):
        at, k = number - first, segments.rows[number]
        if number < last and at % LANES == 0:
            linearise_segments(hull, problem, states, disturbances, segments, number, number // LANES, block, at, tally)
            scatter_after(segments, number, tape)
        _assimilate(problem, states, k, block, at, gate, tally)
        if mean_shift.shape[0] > 0:
            _apply_mean_shift(mean_shift[number], block, at)
        copy_row(block, at, tape, number)
        if problem.fed[k]:
            _write_updates(block, at, tape, tape.sample[number])
        if number < last:
            write_transition(block.tangent[at], tape.transition[number])
            predict_over_segment(segments, block, at)


@inner_kernel
def _write_updates(block, at, tape, sample):
    """Write the updates of row ``at`` of the block to the tape."""
    copy(block.information[at], tape.information[sample])
    copy(block.scaled_innovation[at], tape.scaled_innovation[sample])
    for index in range(10):
        if block.information[at, index] > 0.0:
            copy(block.gain[at, index], tape.gain[sample, index])


@kernel
def forward(hull, problem, states, disturbances, mean_shift, gate, segments, block, tally, tape):
    """Filter the profile about a path, fill the tape, and sum up the cost of the path.

    Parameters
    ----------
    hull, problem : Hull, SmootherProblem
        The problem.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path. Its rows inside the segments are replaced by the model's run, and its X and Y by the displacement.
    mean_shift : (s+1, 16) or (0, 16)
        Gradient of a linear term of the cost in the rows between the segments: none for the mode, that of
        `gliderhpc.kernels.smoother_mean_shift` for the mean.
    gate : float
        Number of standard deviations that no innovation may exceed; variances are inflated permanently to achieve this
        (infinite: never).
    segments, block : Segments, Block
        Memory; that of the segments for the whole profile.
    tally : (14,)
        Costs of initial state, measurements and noise (half the sums of squares over variances), sums of the sensed
        states' absolute defects, and half the logarithm of the ratio of the Hessian's determinant to that of the prior;
        to be filled.
    tape : Tape
        Memory for `backward`, to be filled.
    """
    problem, segments, block, tape = with_sizes(problem), with_sizes(segments), with_sizes(block), with_sizes(tape)
    states, disturbances = with_columns(states, 12), with_columns(disturbances, 6)
    mean_shift = with_columns(mean_shift, 16)
    clear(tally)
    rows = segments.rows.shape[0]
    _begin(problem, states, disturbances, block)
    _add_cost_of_start(problem, states, disturbances, tally)
    for first in range(0, rows, BLOCK):
        stop = min(first + BLOCK, rows)
        symmetrise(block.covariance[0])
        _filter_block(hull, problem, states, disturbances, mean_shift, first, stop, segments, block, gate, tally, tape)
        copy_row(block, BLOCK, block, 0)


@kernel
def run_path(hull, problem, states, disturbances, segments, tally):
    """Run the model along a path and sum up its cost, as `forward` does, without filtering.

    The log determinant, which follows from the filter's covariances, is left at zero.

    Parameters
    ----------
    hull, problem, states, disturbances, segments, tally
        Arguments of `forward`.
    """
    problem, segments = with_sizes(problem), with_sizes(segments)
    states, disturbances = with_columns(states, 12), with_columns(disturbances, 6)
    clear(tally)
    run_segments(hull, problem, states, disturbances, segments, tally)
    _add_cost_of_start(problem, states, disturbances, tally)
    for k in range(problem.fed.shape[0]):
        if problem.fed[k]:
            for channel in range(problem.measured.shape[1]):
                if math.isfinite(problem.measured[k, channel]):
                    residual = _residual(problem, states, k, channel)
                    tally[1] += 0.5 * residual * residual / problem.variance[k, channel]


@kernel
def backward(hull, problem, states, disturbances, mean_shift, segments, block, tape, costates, out):
    """Smooth the profile from its end to its beginning, about the path and from the tape of the last `forward`.

    Parameters
    ----------
    hull, problem, states, disturbances, mean_shift, segments, block, tape
        Arguments of `forward`, as it left them; the block is scratch.
    costates : tuple of (16,), (16, 16)
        Scratch: the costate and its covariance.
    out : Backward
        Results, to be filled; the mean shift only if memory is allocated for it.
    """
    problem, segments, block, tape = with_sizes(problem), with_sizes(segments), with_sizes(block), with_sizes(tape)
    states, disturbances = with_columns(states, 12), with_columns(disturbances, 6)
    mean_shift, out = with_columns(mean_shift, 16), with_sizes(out)
    last = segments.rows.shape[0] - 1
    costate, information = costates
    clear(costate)
    clear(information)
    clear(out.steepest)
    copy(tape.track[last], out.displacement)
    wanted = out.rows.shape[0]
    for number in range(last, -1, -1):
        k = segments.rows[number]
        _prefetch_row(tape, max(number - _AHEAD, 0))
        if number < last:
            if number == last - 1 or number % LANES == LANES - 1:
                scatter_products(segments, number // LANES)
                prefetch(segments.lanes.by_noise[max(number // LANES - 1, 0)])
            smoothed_noise(problem, segments, number, costate, information, out)
            undo_step(tape.transition[number], block, costate, information)
            if segments.represented_steps[number] > 0:
                _mean_shift(hull, problem, states, disturbances, segments, number, block, tape, out.mean_shift[number])
        smoothed_mean(tape, number, costate, out.correction[number])
        smoothed_variances(
            tape, number, information, block.half, out.state_variance[number], out.disturbance_variance[number],
            out.track_variance[number],
        )  # fmt: skip
        if wanted > 0 and out.rows[wanted - 1] == k:
            wanted -= 1
            smoothed_covariance(tape, number, information, out.covariances[wanted])
        if mean_shift.shape[0] > 0:
            for i in range(16):
                costate[i] += mean_shift[number, i]
        if problem.fed[k]:
            _undo_updates(tape, tape.sample[number], block, costate, information)
        for i in range(10):
            out.steepest[i] = max(out.steepest[i], abs(costate[i]))


@inner_kernel
def _prefetch_row(tape, number):
    """Ask for a row of the tape, which processors expect less well in this order than in ascending order."""
    prefetch(tape.covariance[number])
    prefetch(tape.cross[number])
    prefetch(tape.transition[number])


@inner_kernel
def _undo_updates(tape, sample, block, costate, information):
    """Carry the costate and its covariance from after the updates of a sample to before them."""
    for index in range(9, -1, -1):
        inverse = tape.information[sample, index]
        if inverse > 0.0:
            undo_update(
                tape.gain[sample, index], tape.scaled_innovation[sample, index], inverse, index, block.half[0], costate,
                information,
            )  # fmt: skip


@inner_kernel
def _mean_shift(hull, problem, states, disturbances, segments, number, block, tape, mean_shift):
    """Compute the mean shift of a segment's first step, times the number of steps that it represents."""
    expected_mean_shift(
        hull, problem, states, disturbances, segments.rows[number], tape.covariance[number],
        tape.after[tape.shift[number]], block, mean_shift,
    )  # fmt: skip
    for i in range(16):
        mean_shift[i] *= segments.represented_steps[number]
