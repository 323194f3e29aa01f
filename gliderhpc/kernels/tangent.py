"""One Runge-Kutta step of all twelve states with its transition matrix: the tangent of the step itself, not ``I + h A``."""

from gliderhpc.kernels.dynamics import horizontal_velocity, rates
from gliderhpc.kernels.jacobian import rhs_jacobian
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.window import sensed_of


@formula
def _rates12(hull, body, y, b):
    sensed = sensed_of(y)
    d = rates(hull, body, sensed, b)
    X, Y = horizontal_velocity(sensed)
    return (d[0], d[1], d[2], X, Y, d[3], d[4], d[5], d[6], d[7], d[8], d[9])


@formula
def _shifted12(y, a, k):
    return (
        y[0] + a * k[0], y[1] + a * k[1], y[2] + a * k[2], y[3] + a * k[3], y[4] + a * k[4], y[5] + a * k[5],
        y[6] + a * k[6], y[7] + a * k[7], y[8] + a * k[8], y[9] + a * k[9], y[10] + a * k[10], y[11] + a * k[11],
    )  # fmt: skip


@kernel
def _stage_sensitivity(hull, jacobian, scale, previous, out):
    """``out = J ([I 0] + scale previous) + [0 G]``: how one stage's rates depend on the step's start and disturbance."""
    for i in range(12):
        for j in range(18):
            out[i, j] = 0.0
        for k in range(12):
            entry = jacobian[i, k]
            if entry != 0.0:
                out[i, k] += entry
                for j in range(18):
                    out[i, j] += scale * entry * previous[k, j]
    for i in range(6):
        out[6 + i, 12 + i] += 1.0 / hull[i]


@kernel
def step_tangent(hull, body, y, b, h, transition, work):
    """Advance the twelve-state tuple ``y``; fill ``transition (12, 18)`` = [dy+/dy, dy+/db] (eq. 24's matrix).

    ``work`` is ``(3, 18, 18)`` scratch.
    """
    jacobian, previous, current = work[0], work[1], work[2]
    for i in range(12):
        for j in range(18):
            previous[i, j] = 0.0
            transition[i, j] = 1.0 if i == j else 0.0
    stage = y
    new = y
    for number in range(4):
        weight = h / 6.0 if number in (0, 3) else h / 3.0
        reach = 0.0 if number == 0 else (h if number == 3 else 0.5 * h)
        k = _rates12(hull, body, stage, b)
        rhs_jacobian(hull, body, stage, jacobian)
        _stage_sensitivity(hull, jacobian, reach, previous, current)
        for i in range(12):
            for j in range(18):
                transition[i, j] += weight * current[i, j]
                previous[i, j] = current[i, j]
        new = _shifted12(new, weight, k)
        stage = _shifted12(y, h if number == 2 else 0.5 * h, k)
    return new
