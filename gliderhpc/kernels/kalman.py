"""Covariance of the filter (eqs. 19-27): ten sensed states and six Gauss-Markov disturbances.

X and Y are left out: they are never measured, and nothing depends on them. The covariance is symmetric by construction:
only one triangle is computed, and the update is the Joseph form of one scalar measurement at a time.
"""

from gliderhpc.kernels.elementwise import load, store, zero_like
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.tangent import decay_over, load_ten, pull_back


@formula
def _load_six(array, k):
    """Return the last six entries of a row of sixteen: those of the disturbances."""
    return (
        load(array, (k, 10)), load(array, (k, 11)), load(array, (k, 12)),
        load(array, (k, 13)), load(array, (k, 14)), load(array, (k, 15)),
    )  # fmt: skip


@formula
def dot6(a, b):
    """Return the product of two tuples of six."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@formula
def _dot10(a, b):
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]
        + a[5] * b[5] + a[6] * b[6] + a[7] * b[7] + a[8] * b[8] + a[9] * b[9]
    )  # fmt: skip


@formula
def _both(matrix, i, j, value):
    store(matrix, (i, j), value)
    store(matrix, (j, i), value)


@formula
def _begin(transition, remaining, added):
    """Initialise the sums over the steps: identity, no decay, no noise."""
    zero = zero_like(load(remaining, 0))
    for i in range(10):
        for j in range(16):
            store(transition, (i, j), zero + (1.0 if i == j else 0.0))
    for i in range(6):
        store(remaining, i, zero + 1.0)
    for i in range(16):
        for j in range(i + 1):
            store(added, (i, j), zero)


@inner_kernel
def add_noise(noise, factor, transition, remaining, added):
    """Add a step's noise as carried to the end of the block (one term of the sum that is Q in eq. 24).

    Parameters
    ----------
    noise : (6,)
        Variance that a step adds to the disturbances.
    factor : float or lanes
        Factor on that variance for this step.
    transition, remaining : (10, 16), (6,)
        Transition of the sensed states and decay of the disturbances, from the end of the step to the end of the block.
    added : (16, 16)
        Sum of the noise, lower triangle.
    """
    q = (
        factor * load(noise, 0), factor * load(noise, 1), factor * load(noise, 2),
        factor * load(noise, 3), factor * load(noise, 4), factor * load(noise, 5),
    )  # fmt: skip
    for i in range(10):
        t = _load_six(transition, i)
        weighted = (q[0] * t[0], q[1] * t[1], q[2] * t[2], q[3] * t[3], q[4] * t[4], q[5] * t[5])
        for j in range(i + 1):
            store(added, (i, j), load(added, (i, j)) + dot6(weighted, _load_six(transition, j)))
        for j in range(6):
            store(added, (10 + j, i), load(added, (10 + j, i)) + weighted[j] * load(remaining, j))
    for j in range(6):
        left = load(remaining, j)
        store(added, (10 + j, 10 + j), load(added, (10 + j, 10 + j)) + q[j] * left * left)


@kernel
def carry_covariance(transition, remaining, added, P, half):
    """Set ``P <- Phi P Phi' + N``: ``Phi = [[transition], [0, diag(remaining)]]``, ``N`` the sum from `add_noise`."""
    for i in range(10):
        t, tb = load_ten(transition, i), _load_six(transition, i)
        for j in range(16):
            store(half, (i, j), _dot10(t, load_ten(P, j)) + dot6(tb, _load_six(P, j)))
    for i in range(10):
        g, gb = load_ten(half, i), _load_six(half, i)
        for j in range(i + 1):
            total = _dot10(g, load_ten(transition, j)) + dot6(gb, _load_six(transition, j))
            _both(P, i, j, total + load(added, (i, j)))
        for j in range(6):
            _both(P, 10 + j, i, gb[j] * load(remaining, j) + load(added, (10 + j, i)))
    for i in range(6):
        for j in range(i + 1):
            left = load(remaining, i) * load(remaining, j)
            _both(P, 10 + i, 10 + j, left * load(P, (10 + i, 10 + j)) + load(added, (10 + i, 10 + j)))


@kernel
def predict_covariance(hull, durations, decay, noise, factors, partials, steps, sweep, P):
    """Carry the covariance over a block of ``steps`` steps (eq. 24).

    Parameters
    ----------
    hull, durations, decay, partials
        Arguments of `gliderhpc.kernels.tangent.advance`.
    noise, factors : (6,), (m,)
        Variance that a step adds to the disturbances, and the factor on that variance for each step.
    sweep : Sweep
        Scratch.
    P : (16, 16)
        Covariance of the sensed states and the disturbances.
    """
    _begin(sweep.transition, sweep.remaining, sweep.added)
    for k in range(steps - 1, -1, -1):
        add_noise(noise, load(factors, k), sweep.transition, sweep.remaining, sweep.added)
        pull_back(hull, durations, decay, partials, sweep.transition, k)
        for i in range(6):
            store(sweep.remaining, i, load(sweep.remaining, i) * decay_over(decay, load(durations, k), i))
    carry_covariance(sweep.transition, sweep.remaining, sweep.added, P, sweep.half)


@kernel
def update(x, P, index, innovation, variance, used, gain):
    """Update ``x (16)`` and ``P`` with a measurement of state ``index`` (eqs. 25-27, Joseph form) where ``used`` is 1.

    Where ``used`` is 0, nothing changes; the innovation must be finite even there.
    """
    total = load(P, (index, index)) + variance
    for i in range(16):
        entry = load(P, (i, index))
        factor = used * (entry / total)
        store(gain, (i, 0), used * entry)
        store(gain, (i, 1), factor)
        store(x, i, load(x, i) + factor * innovation)
    for i in range(16):
        g0, g1 = load(gain, (i, 0)), load(gain, (i, 1))
        rest = g0 - total * g1
        for j in range(i + 1):
            _both(P, i, j, load(P, (i, j)) - g1 * load(gain, (j, 0)) - rest * load(gain, (j, 1)))
