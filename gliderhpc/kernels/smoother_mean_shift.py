"""Shift from the most probable path to the mean path: the term of the log-determinant in the costate's equation.

The costate of every path obeys ``l[k] = F(x[k])' l[k+1]`` over a step. Its posterior mean obeys the same equation with
the transition of the mean, plus the covariance of the costate with the transition, which depends on the state. To
second order this term is

    mean_shift[k] = sum over i of (second derivatives of the step's output i) M[:, i],   M = P F' L

with the filtered covariance ``P`` before the step and the costate's covariance ``L`` after it; ``M`` is the covariance
of the state before the step with the costate after it. The term is the gradient of half the logarithm of the
determinant of the cost's Hessian; it is larger where the record determines the noise less well (docs/smoother.md).
"""

import math

from gliderhpc.kernels.elementwise import LANES, clear, load_along, select, store_along
from gliderhpc.kernels.jit import formula, inner_kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import step, step_vjp
from gliderhpc.kernels.smoother_covariance import multiply

_OUTPUTS = 10
"""Number of nonlinear outputs of the step, the sensed states; the disturbances are linear."""


@formula
def _load_ten(columns, first):
    """Return rows 0 to 9 of as many columns as there are lanes."""
    c = columns
    return (
        load_along(c, (0, first)), load_along(c, (1, first)), load_along(c, (2, first)), load_along(c, (3, first)),
        load_along(c, (4, first)), load_along(c, (5, first)), load_along(c, (6, first)), load_along(c, (7, first)),
        load_along(c, (8, first)), load_along(c, (9, first)),
    )  # fmt: skip


@formula
def _load_six(columns, first):
    """Return rows 10 to 15 of as many columns as there are lanes."""
    c = columns
    return (
        load_along(c, (10, first)), load_along(c, (11, first)), load_along(c, (12, first)),
        load_along(c, (13, first)), load_along(c, (14, first)), load_along(c, (15, first)),
    )  # fmt: skip


@inner_kernel
def expected_mean_shift(hull, problem, states, disturbances, k, covariance, after, block, mean_shift):
    """Compute the mean shift ``(16,)`` of a segment's first step, in row ``k``, right after its `undo_step`.

    The second derivatives are differences of the step's transpose over at most one standard deviation to either side of
    the path, with one output in each column.
    """
    product, joint, columns = block.behind, block.ahead, block.columns
    # `undo_step` has stored Phi' L in the scratch, for the transition Phi of the whole segment. With the costate's
    # covariance carried back to the end of the first step, this is F' L of the step.
    multiply(block.half, after, product)
    multiply(covariance, product, joint)
    # Scratch: largest moves in deviations, their reciprocals, and products.
    longest, length, products = block.half[0], block.half[1], block.half[2]
    clear(longest)
    for j in range(16):
        precision = 1.0 / math.sqrt(covariance[j, j]) if covariance[j, j] > 0.0 else 0.0
        for first in range(0, 16, LANES):
            size, most = precision * abs(load_along(joint, (j, first))), load_along(longest, (first,))
            store_along(longest, (first,), select(size > most, size, most))
    for i in range(_OUTPUTS, 16):
        longest[i] = 0.0
    for i in range(16):
        length[i] = 1.0 / longest[i] if longest[i] > 0.0 else 0.0
    for j in range(16):
        centre = disturbances[k, j - 10] if j >= 10 else states[k, j if j < 3 else j + 2]
        for first in range(0, 16, LANES):
            move = load_along(length, (first,)) * load_along(joint, (j, first))
            store_along(columns, (j, first), centre + move)
            store_along(product, (j, first), centre - move)
        # The remaining columns belong to no output and lie at the centre.
        for first in range(0, 16, LANES):
            store_along(columns, (j, _OUTPUTS + first), load_along(product, (j, first)))
    _transposes(hull, problem, k, columns, block.seeds)
    for j in range(16):
        for first in range(0, 16, LANES):
            change = load_along(columns, (j, first)) - load_along(columns, (j, _OUTPUTS + first))
            store_along(products, (first,), change * load_along(longest, (first,)))
        total = 0.0
        for i in range(_OUTPUTS):
            total += products[i]
        mean_shift[j] = 0.5 * total


@inner_kernel
def _transposes(hull, problem, k, columns, seeds):
    """Replace each column of states and disturbances ``(16, m)`` by the derivatives there of its seed's output."""
    body, h = load_body(problem.bodies, k), problem.step
    for first in range(0, seeds.shape[1], LANES):
        y, b, a = _load_ten(columns, first), _load_six(columns, first), _load_ten(seeds, first)
        _, stages, geometry = step(hull, body, y, b, h)
        e, g = step_vjp(hull, body, stages, geometry, a, h)
        for j in range(10):
            store_along(columns, (j, first), e[j])
        for j in range(6):
            store_along(columns, (10 + j, first), g[j])
