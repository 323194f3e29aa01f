"""Runge-Kutta step of the filter and its exact tangent, applied from the end of a block of steps to its beginning.

A block extends from one fed sample to the next. The covariance at its end is ``Phi P Phi' + N``: ``Phi`` is the product
of the steps' tangents, and ``N`` the steps' noise as carried to the end. Sweeping ten costates (the rows of ``Phi``)
backwards is cheaper than carrying the covariance step by step: only the Jacobians of the sensed states, 67 entries per
stage, are multiplied, and the columns of the disturbances follow from the costates.
"""

from gliderhpc.kernels.dynamics import horizontal_velocity, rates
from gliderhpc.kernels.elementwise import load, select, store, zero_like
from gliderhpc.kernels.jacobian import pulled, store_partials
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import scaled, shifted
from gliderhpc.kernels.window import hull_in


@formula
def load_ten(array, k):
    """Return the first ten entries of row ``k``, as a tuple: the sensed states, or a costate."""
    return (
        load(array, (k, 0)), load(array, (k, 1)), load(array, (k, 2)), load(array, (k, 3)), load(array, (k, 4)),
        load(array, (k, 5)), load(array, (k, 6)), load(array, (k, 7)), load(array, (k, 8)), load(array, (k, 9)),
    )  # fmt: skip


@kernel
def advance(hull, bodies, durations, decay, path, partials, k):
    """Compute step ``k`` of a block, from row ``k`` of ``path`` to the next, and the stages' Jacobians, ``partials``.

    Parameters
    ----------
    hull : (24,)
        Constants, as in `Hull`.
    bodies, durations : (m, 11), (m,)
        Mass properties and length of each step, s; a step of zero length leaves every bit unchanged.
    decay : (6,)
        Decay of the disturbances over a step of non-zero length.
    path : (m+1, 18)
        Sensed states, disturbances, X and Y.
    partials : (m, 4, 67)
        Jacobians of the sensed states at the four stages, times h, h/2, h/2 and h.
    """
    constants = hull_in(hull)
    body = load_body(bodies, k)
    h = load(durations, k)
    y = load_ten(path, k)
    b = (
        load(path, (k, 10)), load(path, (k, 11)), load(path, (k, 12)),
        load(path, (k, 13)), load(path, (k, 14)), load(path, (k, 15)),
    )  # fmt: skip
    stage = y
    total = scaled(0.0, y)
    north = east = zero_like(h)
    for number in range(4):
        inner = number == 1 or number == 2
        store_partials(constants, body, stage, 0.5 * h if inner else h, partials, (k, number))
        rate = rates(constants, body, stage, b)
        weight = 2.0 if inner else 1.0
        to_north, to_east = horizontal_velocity(stage)
        total = shifted(total, weight, rate)
        north = north + weight * to_north
        east = east + weight * to_east
        stage = shifted(y, h if number == 2 else 0.5 * h, rate)
    # Summed first: a depth of hundreds of metres is then rounded only once per step.
    new = shifted(y, h / 6.0, total)
    moves = h > 0.0
    for i in range(10):
        store(path, (k + 1, i), select(moves, new[i], y[i]))
    for i in range(6):
        store(path, (k + 1, 10 + i), decay_over(decay, h, i) * b[i])
    X, Y = load(path, (k, 16)), load(path, (k, 17))
    store(path, (k + 1, 16), select(moves, X + h / 6.0 * north, X))
    store(path, (k + 1, 17), select(moves, Y + h / 6.0 * east, Y))


@formula
def decay_over(decay, h, i):
    """Return the decay of disturbance ``i`` over a step of length ``h``; there is none over a step of zero length."""
    return select(h > 0.0, load(decay, i), 1.0)


@formula
def _with_psi(f, n_psi):
    """Insert psi's entry into the nine of the other states; no rate depends on psi."""
    return f[0], f[1], n_psi, f[2], f[3], f[4], f[5], f[6], f[7], f[8]


NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@formula
def pulled_over_step(partials, k, a, by_stages, zero):
    """Apply the transposed tangent of a step to a costate ``a`` (ten) after it.

    Parameters
    ----------
    partials, k : (m, 4, 67), int
        Jacobians of the stages from `advance`, and the step.
    by_stages : tuple of four tuples of ten
        Derivatives of something that is summed along the step's stages, times h, to be added.
    zero : float or lanes
        Zero.

    Returns
    -------
    tuple of ten, tuple of four tuples of ten
        The costate before the step, and those of the four stages, times 6 / h.

    Notes
    -----
    The stages' costates are ``h/6`` times ``n4 = a``, ``n3 = 2a + f4``, ``n2 = 2a + f3``, ``n1 = a + f2``, where
    ``f4 = (h J4)' n4``, ``f3 = (h/2 J3)' n3``, ``f2 = (h/2 J2)' n2`` and ``f1 = (h J1)' n1``; the costate before the
    step is ``a + (f1 + 2 f2 + 2 f3 + f4) / 6``.
    """
    f4 = shifted(_with_psi(pulled(partials, (k, 3), a), zero), 1.0, by_stages[3])
    n3 = shifted(f4, 2.0, a)
    f3 = shifted(_with_psi(pulled(partials, (k, 2), n3), zero), 1.0, by_stages[2])
    n2 = shifted(f3, 2.0, a)
    f2 = shifted(_with_psi(pulled(partials, (k, 1), n2), zero), 1.0, by_stages[1])
    n1 = shifted(f2, 1.0, a)
    f1 = shifted(_with_psi(pulled(partials, (k, 0), n1), zero), 1.0, by_stages[0])
    new = shifted(a, 1.0 / 6.0, shifted(shifted(f1, 1.0, f4), 2.0, shifted(f2, 1.0, f3)))
    return new, (n1, n2, n3, a)


@kernel
def pull_back(hull, durations, decay, partials, transition, k):
    """Multiply ``transition (10, 16)`` from the right by the tangent of step ``k`` (eq. 24's matrix).

    Its rows are costates of the sensed states at the end of the block; its columns are the sensed states and the
    disturbances.
    """
    h = load(durations, k)
    sixth = h / 6.0
    pushes = (
        sixth / load(hull, 0), sixth / load(hull, 1), sixth / load(hull, 2),
        sixth / load(hull, 3), sixth / load(hull, 4), sixth / load(hull, 5),
    )  # fmt: skip
    for row in range(10):
        a = load_ten(transition, row)
        new, (n1, n2, n3, n4) = pulled_over_step(partials, k, a, (NOTHING, NOTHING, NOTHING, NOTHING), zero_like(h))
        for i in range(10):
            store(transition, (row, i), new[i])
        for i in range(6):
            decayed = load(transition, (row, 10 + i)) * decay_over(decay, h, i)
            store(transition, (row, 10 + i), decayed + pushes[i] * (n4[4 + i] + n3[4 + i] + n2[4 + i] + n1[4 + i]))
