"""Covariances forwards and costates' covariances backwards (modified Bryson-Frazier): no covariance is ever inverted.

Vectors of sixteen, and the rows of 16 by 16 matrices, are computed in lanes. In a segment's transition, the rows of the
disturbances contain only their own decay. Of a product that is symmetric, only the first eight rows of the first eight
columns and the rows after them are computed, and the rest is copied.
"""

from gliderhpc.kernels.elementwise import LANES, load_along, store_along
from gliderhpc.kernels.jit import inner_kernel
from gliderhpc.kernels.smoother_memory import NOISE_COLUMN

_TAIL = 8
"""First column that is not computed in full where a matrix is symmetric: a multiple of the number of lanes."""


@inner_kernel
def multiply(left, right, out):
    """Set ``out (m, 16) = left (m, 16) right (16, 16)``."""
    paired = left.shape[0] - left.shape[0] % 4
    for i in range(0, paired, 4):
        for first in range(0, 16, LANES):
            row = load_along(right, (0, first))
            a, b, c, d = left[i, 0] * row, left[i + 1, 0] * row, left[i + 2, 0] * row, left[i + 3, 0] * row
            for k in range(1, 16):
                row = load_along(right, (k, first))
                a += left[i, k] * row
                b += left[i + 1, k] * row
                c += left[i + 2, k] * row
                d += left[i + 3, k] * row
            store_along(out, (i, first), a)
            store_along(out, (i + 1, first), b)
            store_along(out, (i + 2, first), c)
            store_along(out, (i + 3, first), d)
    for i in range(paired, left.shape[0]):
        for first in range(0, 16, LANES):
            total = left[i, 0] * load_along(right, (0, first))
            for k in range(1, 16):
                total += left[i, k] * load_along(right, (k, first))
            store_along(out, (i, first), total)


@inner_kernel
def _multiply_transposed(left, right, rows, stop, out):
    """Set the first ``rows`` rows (a multiple of five) of ``out = left' right``, up to column ``stop`` (exclusive)."""
    for i in range(0, rows, 5):
        for first in range(0, stop, LANES):
            row = load_along(right, (0, first))
            a, b, c = left[0, i] * row, left[0, i + 1] * row, left[0, i + 2] * row
            d, e = left[0, i + 3] * row, left[0, i + 4] * row
            for k in range(1, 16):
                row = load_along(right, (k, first))
                a += left[k, i] * row
                b += left[k, i + 1] * row
                c += left[k, i + 2] * row
                d += left[k, i + 3] * row
                e += left[k, i + 4] * row
            store_along(out, (i, first), a)
            store_along(out, (i + 1, first), b)
            store_along(out, (i + 2, first), c)
            store_along(out, (i + 3, first), d)
            store_along(out, (i + 4, first), e)


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
    for first in range(0, 16, LANES):
        total = load_along(segments.offset, (at, first))
        for j in range(16):
            total += mean[j] * load_along(tangent, (j, first))
        store_along(predicted, (first,), total)
    _carry_track(segments, block, at)
    _carry(segments.noise[at], block, at)


@inner_kernel
def _carry(noise, block, at):
    """Carry the covariance of row ``at`` to row ``at + 1`` by the transition ``Phi``, and add the noise.

    Of ``Phi P Phi'``, the columns of the disturbances are those of ``Phi P`` times their decay.
    """
    tangent, covariance, new, half = block.tangent[at], block.covariance[at], block.covariance[at + 1], block.half
    _multiply_transposed(tangent, covariance, 10, 16, half)
    decay = half[10]
    for i in range(16):
        decay[i] = tangent[i, i] if i >= 10 else 0.0
    for i in range(8, 10):
        for first in range(0, _TAIL + LANES, LANES):
            total = load_along(noise, (i, first))
            for k in range(16):
                total += half[i, k] * load_along(tangent, (k, first))
            store_along(new, (i, first), total)
    for first in range(0, _TAIL, LANES):
        for i in range(0, 8, 4):
            a, b = load_along(noise, (i, first)), load_along(noise, (i + 1, first))
            c, d = load_along(noise, (i + 2, first)), load_along(noise, (i + 3, first))
            for k in range(16):
                row = load_along(tangent, (k, first))
                a += half[i, k] * row
                b += half[i + 1, k] * row
                c += half[i + 2, k] * row
                d += half[i + 3, k] * row
            store_along(new, (i, first), a)
            store_along(new, (i + 1, first), b)
            store_along(new, (i + 2, first), c)
            store_along(new, (i + 3, first), d)
    for first in range(_TAIL, 16, LANES):
        left = load_along(decay, (first,))
        for i in range(8):
            store_along(new, (i, first), load_along(noise, (i, first)) + left * load_along(half, (i, first)))
        if first > _TAIL:
            for i in range(8, 10):
                store_along(new, (i, first), load_along(noise, (i, first)) + left * load_along(half, (i, first)))
        for i in range(10, 16):
            own = decay[i] * load_along(covariance, (i, first))
            store_along(new, (i, first), load_along(noise, (i, first)) + left * own)
    for i in range(8):
        new[i, 8] = new[8, i]
        new[i, 9] = new[9, i]
    for i in range(10, 16):
        for j in range(10):
            new[i, j] = new[j, i]


@inner_kernel
def _carry_track(segments, block, at):
    """Carry the covariance of X and Y by the transition: ``U = C + T P``, ``C <- U Phi'``, ``R <- R + U T' + T C'``."""
    tangent, moved = block.tangent[at], block.track_tangent[at]
    covariance, cross, track = block.covariance[at], block.cross[at], block.track[at]
    half = block.half
    for r in range(2):
        for first in range(0, 16, LANES):
            total = load_along(cross, (r, first))
            for j in range(16):
                total += moved[r, j] * load_along(covariance, (j, first))
            store_along(half, (r, first), total)
        for first in range(0, 16, LANES):
            total = load_along(segments.noise_cross, (at, r, first))
            for k in range(16):
                total += half[r, k] * load_along(tangent, (k, first))
            store_along(block.cross, (at + 1, r, first), total)
        for s in range(2):
            for first in range(0, 16, LANES):
                products = load_along(half, (r, first)) * load_along(moved, (s, first))
                store_along(half, (2, first), products + load_along(moved, (r, first)) * load_along(cross, (s, first)))
            total = track[r, s] + segments.noise_track[at, r, s]
            for i in range(16):
                total += half[2, i]
            block.track[at + 1, r, s] = total


@inner_kernel
def update(block, at, index, innovation, variance):
    """Update row ``at`` with a measurement of state ``index`` (eqs. 25-27, Joseph form); the gain is stored."""
    covariance, gain, mean = block.covariance[at], block.gain[at, index], block.mean[at]
    cross, track, column = block.cross[at], block.track[at], block.half[0]
    total = covariance[index, index] + variance
    inverse = 1.0 / total
    block.information[at, index] = inverse
    block.scaled_innovation[at, index] = innovation * inverse
    c0, c1 = cross[0, index], cross[1, index]
    for first in range(0, 16, LANES):
        entries = load_along(covariance, (index, first))
        factors = entries * inverse
        store_along(column, (first,), entries)
        store_along(gain, (first,), factors)
        store_along(mean, (first,), load_along(mean, (first,)) + innovation * factors)
        store_along(cross, (0, first), load_along(cross, (0, first)) - c0 * factors)
        store_along(cross, (1, first), load_along(cross, (1, first)) - c1 * factors)
    for i in range(16):
        factor = gain[i]
        rest = column[i] - total * factor
        for first in range(0, 16, LANES):
            entries = load_along(covariance, (i, first)) - factor * load_along(column, (first,))
            store_along(covariance, (i, first), entries - rest * load_along(gain, (first,)))
    track[0, 0] -= c0 * c0 * inverse
    track[0, 1] -= c0 * c1 * inverse
    track[1, 0] = track[0, 1]
    track[1, 1] -= c1 * c1 * inverse


@inner_kernel
def undo_update(gain, scaled_innovation, inverse, index, moved, costate, information):
    """Carry the costate ``(16,)`` and its covariance ``(16, 16)`` from after an update to before it.

    ``costate <- (I - K H)' costate - H' e / S`` and ``information <- (I - K H)' information (I - K H) + H' H / S``,
    with the gain ``K (16,)``, ``e / S`` and ``1 / S`` of a measurement of state ``index``; ``moved (16,)`` is scratch.
    """
    for first in range(0, 16, LANES):
        total = gain[0] * load_along(information, (0, first))
        for i in range(1, 16):
            total += gain[i] * load_along(information, (i, first))
        store_along(moved, (first,), total)
    along, quadratic = 0.0, 0.0
    for i in range(16):
        along += gain[i] * costate[i]
        quadratic += gain[i] * moved[i]
    costate[index] -= along + scaled_innovation
    for first in range(0, 16, LANES):
        store_along(information, (index, first), load_along(information, (index, first)) - load_along(moved, (first,)))
    for i in range(16):
        information[i, index] -= moved[i]
    information[index, index] += quadratic + inverse


@inner_kernel
def undo_step(transition, block, costate, information):
    """Carry the costate and its covariance from after a segment to before it, by its transition as in `Tape`.

    ``costate <- Phi' costate`` is the adjoint equation; ``information <- Phi' information Phi``, of which the scratch
    `half` of the block gets ``Phi' information``.
    """
    half, decay = block.half, block.behind[0]
    for i in range(16):
        decay[i] = transition[10, i]
    for first in range(0, 16, LANES):
        total = load_along(decay, (first,)) * load_along(costate, (first,))
        for k in range(10):
            total += costate[k] * load_along(transition, (k, first))
        # Row 1 is scratch: the costate is still needed.
        store_along(block.behind, (1, first), total)
    for first in range(0, 16, LANES):
        store_along(costate, (first,), load_along(block.behind, (1, first)))
    for i in range(0, 16, 4):
        for first in range(0, 16, LANES):
            a = decay[i] * load_along(information, (i, first))
            b = decay[i + 1] * load_along(information, (i + 1, first))
            c = decay[i + 2] * load_along(information, (i + 2, first))
            d = decay[i + 3] * load_along(information, (i + 3, first))
            for k in range(10):
                row = load_along(information, (k, first))
                a += transition[k, i] * row
                b += transition[k, i + 1] * row
                c += transition[k, i + 2] * row
                d += transition[k, i + 3] * row
            store_along(half, (i, first), a)
            store_along(half, (i + 1, first), b)
            store_along(half, (i + 2, first), c)
            store_along(half, (i + 3, first), d)
    for i in range(0, 16, 4):
        for first in range(0, 16 if i >= 8 else _TAIL, LANES):
            left = load_along(decay, (first,))
            a, b = left * load_along(half, (i, first)), left * load_along(half, (i + 1, first))
            c, d = left * load_along(half, (i + 2, first)), left * load_along(half, (i + 3, first))
            for k in range(10):
                row = load_along(transition, (k, first))
                a += half[i, k] * row
                b += half[i + 1, k] * row
                c += half[i + 2, k] * row
                d += half[i + 3, k] * row
            store_along(information, (i, first), a)
            store_along(information, (i + 1, first), b)
            store_along(information, (i + 2, first), c)
            store_along(information, (i + 3, first), d)
    for i in range(1, 16):
        for j in range(i):
            if j >= 8 or i < 8:
                information[i, j] = 0.5 * (information[i, j] + information[j, i])
            information[j, i] = information[i, j]


@inner_kernel
def smoothed_noise(problem, segments, number, costate, information, out):
    """Compute the mean of the noise of a segment's steps, and the resolved fraction of its variance ``Q``.

    With the derivative ``V`` of the state at the segment's end with respect to a step's noise, they are
    ``-Q V' costate`` and the diagonal of ``Q V' information V``.
    """
    begin, half = segments.rows[number], segments.half
    for i in range(6):
        half[2, NOISE_COLUMN + i] = information[10 + i, 10 + i]
    for k in range(begin, segments.rows[number + 1]):
        by_noise = segments.by_noise[number % LANES, k - begin]
        for first in range(0, 8, LANES):
            # A disturbance depends on its own noise only; the columns are those of the disturbances.
            own = load_along(by_noise, (10, first))
            along = load_along(costate, (_TAIL + first,)) * own
            square = load_along(half, (2, first)) * own * own
            for i in range(10):
                v = load_along(by_noise, (i, first))
                total = 2.0 * own * load_along(information, (i, _TAIL + first))
                for j in range(10):
                    total += information[i, j] * load_along(by_noise, (j, first))
                along += costate[i] * v
                square += v * total
            store_along(half, (0, first), along)
            store_along(half, (1, first), square)
        for i in range(6):
            out.noise_mean[k, i] = -problem.noise[k, i] * half[0, NOISE_COLUMN + i]
            out.noise_resolved[k, i] = problem.noise[k, i] * half[1, NOISE_COLUMN + i]


@inner_kernel
def smoothed_mean(tape, number, costate, correction):
    """Set ``correction (16,) = mean - P costate`` for a row."""
    covariance = tape.covariance[number]
    for first in range(0, 16, LANES):
        total = load_along(tape.mean, (number, first))
        for j in range(16):
            total -= costate[j] * load_along(covariance, (j, first))
        store_along(correction, (first,), total)


@inner_kernel
def smoothed_variances(tape, number, information, half, states, disturbances, track):
    """Compute the diagonal of ``P - P information P`` for the ten sensed states, the disturbances, and X and Y.

    ``half (16, 16)`` is scratch.
    """
    covariance = tape.covariance[number]
    multiply(information, covariance, half)
    for first in range(0, 16, LANES):
        total = load_along(covariance, (0, first)) * load_along(half, (0, first))
        for k in range(1, 16):
            total += load_along(covariance, (k, first)) * load_along(half, (k, first))
        store_along(half, (0, first), total)
    for i in range(10):
        states[i] = max(covariance[i, i] - half[0, i], 0.0)
    for i in range(6):
        disturbances[i] = max(covariance[10 + i, 10 + i] - half[0, 10 + i], 0.0)
    for r in range(2):
        c = tape.cross[number, r]
        for first in range(0, 16, LANES):
            weighted = c[0] * load_along(information, (0, first))
            for j in range(1, 16):
                weighted += c[j] * load_along(information, (j, first))
            store_along(half, (1, first), weighted * load_along(c, (first,)))
        total = tape.track[number, r, r]
        for i in range(16):
            total -= half[1, i]
        track[r] = max(total, 0.0)


@inner_kernel
def smoothed_covariance(tape, number, information, out):
    """Compute the full covariance ``(18, 18)`` of the sixteen states, X and Y: ``P - P information P``."""
    covariance, cross, track = tape.covariance[number], tape.cross[number], tape.track[number]
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
