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

from gliderhpc.kernels.elementwise import load, store
from gliderhpc.kernels.jit import inner_kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import step, step_vjp
from gliderhpc.kernels.smoother_covariance import multiply
from gliderhpc.kernels.smoother_memory import GROUPS
from gliderhpc.kernels.window import sensed_of

_OUTPUTS = 10
"""Number of nonlinear outputs of the step, the sensed states; the disturbances are linear."""


@inner_kernel
def expected_mean_shift(hull, dive, states, disturbances, k, segments, block, at, mean_shift):
    """Compute the mean shift ``(16,)`` of a segment's first step, row ``k`` of the dive, right after its `undo_step`.

    The second derivatives are differences of the step's transpose over at most one standard deviation to either side of
    the path, with one output in each lane.
    """
    covariance, ahead, behind = block.covariance[at], block.ahead, block.behind
    # `undo_step` has stored Phi' L in the scratch, for the transition Phi of the whole segment. With the costate's
    # covariance carried back to the end of the first step, this is F' L of the step.
    multiply(block.half, segments.after_lanes[at], block.behind_lanes)
    multiply(covariance, block.behind_lanes, block.ahead_lanes)
    length = block.half[0]
    for i in range(_OUTPUTS):
        length[i] = 0.0
    for j in range(16):
        precision = 1.0 / math.sqrt(covariance[j, j]) if covariance[j, j] > 0.0 else 0.0
        for i in range(_OUTPUTS):
            length[i] = max(length[i], abs(ahead[j, i]) * precision)
    for i in range(_OUTPUTS):
        length[i] = 1.0 / length[i] if length[i] > 0.0 else 0.0
    y = sensed_of(states[k])
    for j in range(16):
        centre = y[j] if j < 10 else disturbances[k, j - 10]
        for i in range(16):
            move = length[i] * ahead[j, i] if i < _OUTPUTS else 0.0
            ahead[j, i] = centre + move
            behind[j, i] = centre - move
    _transposes(hull, dive, k, block.ahead_lanes, block.seeds)
    _transposes(hull, dive, k, block.behind_lanes, block.seeds)
    for j in range(16):
        total = 0.0
        for i in range(_OUTPUTS):
            if length[i] > 0.0:
                total += 0.5 * (ahead[j, i] - behind[j, i]) / length[i]
        mean_shift[j] = total


@inner_kernel
def _transposes(hull, dive, k, lanes, seeds):
    """Replace the states and disturbances in each lane by the derivatives of the lane's output at that point."""
    body, h = load_body(dive.bodies, k), dive.step
    for group in range(GROUPS):
        y = (
            load(lanes, (0, group)), load(lanes, (1, group)), load(lanes, (2, group)), load(lanes, (3, group)),
            load(lanes, (4, group)), load(lanes, (5, group)), load(lanes, (6, group)), load(lanes, (7, group)),
            load(lanes, (8, group)), load(lanes, (9, group)),
        )  # fmt: skip
        b = (
            load(lanes, (10, group)), load(lanes, (11, group)), load(lanes, (12, group)), load(lanes, (13, group)),
            load(lanes, (14, group)), load(lanes, (15, group)),
        )  # fmt: skip
        a = (
            load(seeds, (0, group)), load(seeds, (1, group)), load(seeds, (2, group)), load(seeds, (3, group)),
            load(seeds, (4, group)), load(seeds, (5, group)), load(seeds, (6, group)), load(seeds, (7, group)),
            load(seeds, (8, group)), load(seeds, (9, group)),
        )  # fmt: skip
        _, stages, geometry = step(hull, body, y, b, h)
        e, g = step_vjp(hull, body, stages, geometry, a, h)
        for j in range(10):
            store(lanes, (j, group), e[j])
        for j in range(6):
            store(lanes, (10 + j, group), g[j])
