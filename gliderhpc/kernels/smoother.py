"""One pass of the iterated smoother over a dive: the filter forwards about a path, its costates backwards.

The pass is a Gauss-Newton step of the dive's maximum a posteriori problem, with the path free in every row; the defect
of a row is the difference between the step from the previous row and the row itself. In deviations from the path the
problem is linear. The forward sweep solves it up to each row, and the backward sweep adds the information of the later
samples (Bierman's modified Bryson-Frazier form). Covariances are stored at every `BLOCK`-th row and recomputed in
between.
"""

import math

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.elementwise import clear, copy
from gliderhpc.kernels.jit import inner_kernel, kernel
from gliderhpc.kernels.smoother_covariance import (
    predict,
    smoothed_covariance,
    smoothed_mean,
    smoothed_variances,
    symmetrise,
    undo_step,
    undo_update,
    update,
)
from gliderhpc.kernels.smoother_mean_shift import expected_mean_shift
from gliderhpc.kernels.smoother_memory import BLOCK, DEFECTS, LOG_DETERMINANT, copy_row
from gliderhpc.kernels.smoother_tangent import linearised_step
from gliderhpc.kernels.window import sensed_of


@inner_kernel
def _begin(dive, states, disturbances, block, tally):
    """Set predicted deviation and covariance of row 0 from the prior; add the cost of the path's initial state."""
    y = sensed_of(states[0])
    for i in range(16):
        value = y[i] if i < 10 else disturbances[0, i - 10]
        deviation = dive.deviation[i]
        block.mean[0, i] = dive.mean[i] - value
        for j in range(16):
            block.covariance[0, i, j] = deviation * deviation if i == j else 0.0
        if deviation > 0.0:
            tally[0] += 0.5 * ((value - dive.mean[i]) / deviation) ** 2
    clear(block.cross[0])
    clear(block.track[0])


@inner_kernel
def _assimilate(dive, states, k, block, at, gate, tally):
    """Update row ``at`` of the block with the channels of sample ``k`` in turn; variances are inflated to the gate."""
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
        excess = innovation * innovation / (gate * gate) - block.covariance[at, channel, channel]
        variance = max(dive.variance[k, channel], excess)
        dive.variance[k, channel] = variance
        tally[1] += 0.5 * residual * residual / variance
        tally[LOG_DETERMINANT] += 0.5 * math.log1p(block.covariance[at, channel, channel] / variance)
        update(block, at, channel, innovation, variance)
    for i in range(6):
        if math.isfinite(dive.damping[i]):
            update(block, at, 4 + i, -block.mean[at, 4 + i], dive.damping[i])


@inner_kernel
def _apply_mean_shift(dive, k, block, at):
    """Shift the mean of row ``at`` according to the cost's linear term for row ``k`` of the dive."""
    covariance = block.covariance[at]
    for i in range(16):
        total = 0.0
        for j in range(16):
            total += covariance[i, j] * dive.mean_shift[k, j]
        block.mean[at, i] -= total


@inner_kernel
def _advance(hull, dive, states, disturbances, k, block, at, tally):
    """Predict row ``at + 1`` of the block from row ``at``, which is row ``k`` of the dive; X and Y follow the path."""
    new, north, east = linearised_step(hull, dive, states, disturbances, k, block, at)
    states[k + 1, 3] = states[k, 3] + north
    states[k + 1, 4] = states[k, 4] + east
    following = sensed_of(states[k + 1])
    mean, tangent, predicted = block.mean[at], block.tangent[at], block.mean[at + 1]
    for i in range(16):
        total = 0.0
        for j in range(16):
            total += mean[j] * tangent[j, i]
        predicted[i] = total
    for i in range(10):
        defect = new[i] - following[i]
        predicted[i] += defect
        tally[DEFECTS + i] += abs(defect)
    for i in range(6):
        defect = dive.decay[i] * disturbances[k, i] - disturbances[k + 1, i]
        predicted[10 + i] += defect
        tally[2] += 0.5 * defect * defect / dive.noise[k, i]
    predict(dive.decay, dive.noise[k], block, at)


@inner_kernel
def _filter_block(hull, dive, states, disturbances, first, stop, block, gate, tally):
    """Filter rows ``first`` to ``stop`` (exclusive), and predict row ``stop`` if the dive has it."""
    for k in range(first, stop):
        at = k - first
        _assimilate(dive, states, k, block, at, gate, tally)
        _apply_mean_shift(dive, k, block, at)
        if k < dive.bodies.shape[0]:
            _advance(hull, dive, states, disturbances, k, block, at, tally)


@kernel
def sweep(backwards, hull, dive, states, disturbances, gate, block, checkpoints, tally, costates, out):
    """Sweep `backward` or `forward`: one kernel, since both contain the filter and its step.

    Parameters
    ----------
    hull, dive, states, disturbances, gate, block, checkpoints, tally
        Arguments of `forward`; the gate is not used backwards.
    costates : tuple of (16,), (16, 16), (16, 16)
        Scratch of `backward`.
    out : Backward
        Results, filled by `backward`.
    """
    if backwards:
        backward(hull, dive, states, disturbances, block, checkpoints, tally, costates, out)
    else:
        forward(hull, dive, states, disturbances, gate, block, checkpoints, tally)


@inner_kernel
def forward(hull, dive, states, disturbances, gate, block, checkpoints, tally):
    """Filter the dive about a path, store checkpoints, and sum up the cost of the path.

    Parameters
    ----------
    hull, dive : Hull, Dive
        The problem.
    states, disturbances : (n+1, 12), (n+1, 6)
        Path; its X and Y are replaced by the displacement along it.
    gate : float
        Number of standard deviations that no innovation may exceed; variances are inflated permanently to achieve this
        (infinite: never).
    tally : (14,)
        Costs of initial state, measurements and noise (half the sums of squares over variances), sums of the sensed
        states' absolute defects, and half the logarithm of the ratio of the Hessian's determinant to that of the prior;
        to be filled.
    """
    clear(tally)
    rows = states.shape[0]
    _begin(dive, states, disturbances, block, tally)
    for first in range(0, rows, BLOCK):
        number, stop = first // BLOCK, min(first + BLOCK, rows)
        symmetrise(block.covariance[0])
        copy_row(block, 0, checkpoints, number)
        _filter_block(hull, dive, states, disturbances, first, stop, block, gate, tally)
        copy_row(block, BLOCK, block, 0)


@inner_kernel
def backward(hull, dive, states, disturbances, block, checkpoints, tally, costates, out):
    """Smooth the dive from its end to its beginning, about the path and from the checkpoints of `forward`.

    Parameters
    ----------
    tally, costates : (14,), tuple of (16,), (16, 16), (16, 16)
        Scratch; `costates` are the costate, and its covariance as numbers and as lanes in the same memory.
    out : Backward
        Results, to be filled; the mean shift only if memory is allocated for it.
    """
    rows = states.shape[0]
    costate, information, information_lanes = costates
    clear(costate)
    clear(information)
    clear(out.steepest)
    wanted = out.rows.shape[0]
    for number in range((rows - 1) // BLOCK, -1, -1):
        first = number * BLOCK
        stop = min(first + BLOCK, rows)
        copy_row(checkpoints, number, block, 0)
        _filter_block(hull, dive, states, disturbances, first, stop, block, math.inf, tally)
        if stop == rows:
            copy(block.track[rows - 1 - first], out.displacement)
        for k in range(stop - 1, first - 1, -1):
            at = k - first
            if k < rows - 1:
                _smooth_noise(dive, k, costate, information, out)
                undo_step(block, at, costate, information, information_lanes)
                if out.mean_shift.shape[0] > 0 and k % out.every == out.every // 2:
                    begin = k - out.every // 2
                    expected_mean_shift(hull, dive, states, disturbances, k, block, at, out.mean_shift[begin])
                    for row in range(begin + 1, min(begin + out.every, rows - 1)):
                        copy(out.mean_shift[begin], out.mean_shift[row])
            smoothed_mean(block, at, costate, out.correction[k])
            smoothed_variances(
                block, at, information, out.state_variance[k], out.disturbance_variance[k], out.track_variance[k]
            )
            if wanted > 0 and out.rows[wanted - 1] == k:
                wanted -= 1
                smoothed_covariance(block, at, information, out.covariances[wanted])
            for i in range(16):
                costate[i] += dive.mean_shift[k, i]
            if dive.fed[k]:
                for index in range(9, -1, -1):
                    if block.information[at, index] > 0.0:
                        undo_update(block, at, index, costate, information)
            for i in range(10):
                out.steepest[i] = max(out.steepest[i], abs(costate[i]))


@inner_kernel
def _smooth_noise(dive, k, costate, information, out):
    """Compute the mean of step ``k``'s noise, ``-Q costate``, and the resolved fraction of its variance ``Q``."""
    for i in range(6):
        out.noise_mean[k, i] = -dive.noise[k, i] * costate[10 + i]
        out.noise_resolved[k, i] = dive.noise[k, i] * information[10 + i, 10 + i]
