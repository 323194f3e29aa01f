"""Covariances forwards and costates' covariances backwards (modified Bryson-Frazier): no covariance is ever inverted.

Every product of two 16 by 16 matrices is computed along their rows in lanes; a matrix that must remain symmetric is
averaged with its transpose.
"""

from gliderhpc.kernels.elementwise import copy, load, store, zero_like
from gliderhpc.kernels.jit import inner_kernel
from gliderhpc.kernels.smoother_memory import GROUPS, NOISE_GROUPS


@inner_kernel
def multiply(left, right, out):
    """Set ``out = left right``; ``left`` is numbers ``(m, 16)``, the others are lanes, ``(16, 16)`` and ``(m, 16)``."""
    for i in range(left.shape[0]):
        for group in range(GROUPS):
            total = left[i, 0] * load(right, (0, group))
            for k in range(1, 16):
                total += left[i, k] * load(right, (k, group))
            store(out, (i, group), total)


@inner_kernel
def symmetrise(matrix):
    """Replace ``matrix (16, 16)`` by the mean of itself and its transpose."""
    for i in range(1, 16):
        for j in range(i):
            value = 0.5 * (matrix[i, j] + matrix[j, i])
            matrix[i, j] = value
            matrix[j, i] = value


@inner_kernel
def predict_over_segment(segments, block, at):
    """Carry mean and covariances of row ``at`` over a segment to row ``at + 1``, with the noise of its steps."""
    mean, tangent, predicted = block.mean[at], block.tangent[at], block.mean[at + 1]
    for i in range(16):
        total = segments.offset[at, i]
        for j in range(16):
            total += mean[j] * tangent[j, i]
        predicted[i] = total
    _carry(block, at)
    covariance_lanes, noise_lanes = block.covariance_lanes[at + 1], segments.noise_lanes[at]
    for i in range(16):
        for group in range(GROUPS):
            store(covariance_lanes, (i, group), load(covariance_lanes, (i, group)) + load(noise_lanes, (i, group)))
    for r in range(2):
        for i in range(16):
            block.cross[at + 1, r, i] += segments.noise_cross[at, r, i]
        for s in range(2):
            block.track[at + 1, r, s] += segments.noise_track[at, r, s]


@inner_kernel
def _carry(block, at):
    """Carry the covariances of row ``at`` to row ``at + 1`` by the transition alone."""
    tangent, tangent_lanes = block.tangent[at], block.tangent_lanes[at]
    half_lanes, new_lanes = block.half_lanes, block.covariance_lanes[at + 1]
    _carry_track(block, at)
    multiply(block.covariance[at], tangent_lanes, half_lanes)
    for i in range(10):
        for group in range(GROUPS):
            total = tangent[0, i] * load(half_lanes, (0, group))
            for k in range(1, 16):
                total += tangent[k, i] * load(half_lanes, (k, group))
            store(new_lanes, (i, group), total)
    for i in range(10, 16):
        for group in range(GROUPS):
            store(new_lanes, (i, group), tangent[i, i] * load(half_lanes, (i, group)))


@inner_kernel
def _carry_track(block, at):
    """Carry the covariance of X and Y by the transition: ``U = C + T P``, ``C <- U Phi'``, ``R <- R + U T' + T C'``."""
    tangent, moved = block.tangent[at], block.track_tangent[at]
    covariance, cross, track = block.covariance[at], block.cross[at], block.track[at]
    for r in range(2):
        u = block.half[r]
        for i in range(16):
            total = cross[r, i]
            for j in range(16):
                total += moved[r, j] * covariance[j, i]
            u[i] = total
        for s in range(2):
            total = track[r, s]
            for j in range(16):
                total += u[j] * moved[s, j] + moved[r, j] * cross[s, j]
            block.track[at + 1, r, s] = total
        for i in range(16):
            total = 0.0
            for k in range(16):
                total += u[k] * tangent[k, i]
            block.cross[at + 1, r, i] = total


@inner_kernel
def update(block, at, index, innovation, variance):
    """Update row ``at`` with a measurement of state ``index`` (eqs. 25-27, Joseph form); the gain is stored."""
    covariance, gain = block.covariance[at], block.gain[at, index]
    cross, track = block.cross[at], block.track[at]
    total = covariance[index, index] + variance
    block.information[at, index] = 1.0 / total
    block.scaled_innovation[at, index] = innovation / total
    column = block.half[0]
    for i in range(16):
        column[i] = covariance[i, index]
        gain[i] = covariance[i, index] / total
        block.mean[at, i] += gain[i] * innovation
    c0, c1 = cross[0, index], cross[1, index]
    for i in range(16):
        rest = column[i] - total * gain[i]
        for j in range(i + 1):
            value = covariance[i, j] - gain[i] * column[j] - rest * gain[j]
            covariance[i, j] = value
            covariance[j, i] = value
        cross[0, i] -= c0 * gain[i]
        cross[1, i] -= c1 * gain[i]
    track[0, 0] -= c0 * c0 / total
    track[0, 1] -= c0 * c1 / total
    track[1, 0] = track[0, 1]
    track[1, 1] -= c1 * c1 / total


@inner_kernel
def undo_update(block, at, index, costate, information):
    """Carry the costate ``(16,)`` and its covariance ``(16, 16)`` from after an update to before it.

    ``costate <- (I - K H)' costate - H' e / S`` and ``information <- (I - K H)' information (I - K H) + H' H / S``.
    """
    gain, moved = block.gain[at, index], block.half[0]
    along, quadratic = 0.0, 0.0
    for i in range(16):
        along += gain[i] * costate[i]
        total = 0.0
        for j in range(16):
            total += information[i, j] * gain[j]
        moved[i] = total
        quadratic += gain[i] * total
    costate[index] -= along + block.scaled_innovation[at, index]
    for i in range(16):
        information[i, index] -= moved[i]
        information[index, i] -= moved[i]
    information[index, index] += quadratic + block.information[at, index]


@inner_kernel
def undo_step(block, at, costate, information, information_lanes):
    """Carry the costate and its covariance from after the step of row ``at`` to before it, by the transposed tangent.

    ``costate <- Phi' costate`` is the adjoint equation; ``information <- Phi' information Phi``.
    """
    tangent, half, half_lanes = block.tangent[at], block.half, block.half_lanes
    _apply(tangent, costate, half[0])
    # The transpose overwrites the tangent, which is not needed any more.
    multiply(tangent, information_lanes, half_lanes)
    transpose(tangent)
    multiply(half, block.tangent_lanes[at], information_lanes)
    symmetrise(information)


@inner_kernel
def _apply(tangent, costate, before):
    """Set ``costate <- tangent costate``, with scratch for sixteen."""
    copy(costate, before)
    for i in range(16):
        total = 0.0
        for j in range(16):
            total += tangent[i, j] * before[j]
        costate[i] = total


@inner_kernel
def transpose(matrix):
    """Transpose ``matrix (16, 16)`` in place."""
    for i in range(1, 16):
        for j in range(i):
            matrix[i, j], matrix[j, i] = matrix[j, i], matrix[i, j]


@inner_kernel
def smoothed_noise(dive, segments, number, at, costate, information, out):
    """Compute the mean of the noise of a segment's steps, and the resolved fraction of its variance ``Q``.

    With the derivative ``V`` of the state at the segment's end with respect to a step's noise, they are
    ``-Q V' costate`` and the diagonal of ``Q V' information V``.
    """
    begin, half, half_lanes = segments.rows[number], segments.half, segments.half_lanes
    for k in range(begin, segments.rows[number + 1]):
        lanes = segments.by_noise_lanes[at, k - begin]
        for group in range(NOISE_GROUPS):
            for i in range(16):
                total = information[i, 0] * load(lanes, (0, group))
                for j in range(1, 16):
                    total += information[i, j] * load(lanes, (j, group))
                store(half_lanes, (i, group), total)
            along, square = costate[0] * load(lanes, (0, group)), load(lanes, (0, group)) * load(half_lanes, (0, group))
            for i in range(1, 16):
                along += costate[i] * load(lanes, (i, group))
                square += load(lanes, (i, group)) * load(half_lanes, (i, group))
            store(half_lanes, (0, group), along)
            store(half_lanes, (1, group), square)
        for i in range(6):
            out.noise_mean[k, i] = -dive.noise[k, i] * half[0, i]
            out.noise_resolved[k, i] = dive.noise[k, i] * half[1, i]


@inner_kernel
def smoothed_mean(block, at, costate, correction):
    """Set ``correction (16,) = mean - P costate``."""
    covariance = block.covariance[at]
    for i in range(16):
        total = block.mean[at, i]
        for j in range(16):
            total -= covariance[i, j] * costate[j]
        correction[i] = total


@inner_kernel
def smoothed_variances(block, at, information, states, disturbances, track):
    """Compute the diagonal of ``P - P information P`` for the ten sensed states, the disturbances, and X and Y."""
    covariance, lanes, half_lanes = block.covariance[at], block.covariance_lanes[at], block.half_lanes
    multiply(information, lanes, half_lanes)
    for group in range(GROUPS):
        total = zero_like(load(lanes, (0, group)))
        for k in range(16):
            total += load(lanes, (k, group)) * load(half_lanes, (k, group))
        store(block.half_lanes, (0, group), total)
    for i in range(10):
        states[i] = max(covariance[i, i] - block.half[0, i], 0.0)
    for i in range(6):
        disturbances[i] = max(covariance[10 + i, 10 + i] - block.half[0, 10 + i], 0.0)
    for r in range(2):
        c = block.cross[at, r]
        total = block.track[at, r, r]
        for i in range(16):
            weighted = 0.0
            for j in range(16):
                weighted += information[i, j] * c[j]
            total -= c[i] * weighted
        track[r] = max(total, 0.0)


@inner_kernel
def smoothed_covariance(block, at, information, out):
    """Compute the full covariance ``(18, 18)`` of the sixteen states, X and Y: ``P - P information P``."""
    covariance, cross, track = block.covariance[at], block.cross[at], block.track[at]
    for i in range(18):
        left = covariance[i] if i < 16 else cross[i - 16]
        for j in range(i + 1):
            right = covariance[j] if j < 16 else cross[j - 16]
            total = 0.0
            for k in range(16):
                for m in range(16):
                    total += left[k] * information[k, m] * right[m]
            value = (left[j] if j < 16 else track[i - 16, j - 16]) - total
            out[i, j] = value
            out[j, i] = value
