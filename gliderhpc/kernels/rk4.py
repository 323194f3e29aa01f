"""Classical Runge-Kutta step of the ten sensed states, and its exact transpose.

A state, a stage or a costate is a tuple of ten; the disturbance (six) is constant over the step.
"""

from gliderhpc.kernels.dynamics import geometry_of, horizontal_velocity, rates_at, rates_vjp
from gliderhpc.kernels.jit import formula


@formula
def shifted(y, a, k):
    """Return ``y + a k``, elementwise."""
    return (
        y[0] + a * k[0], y[1] + a * k[1], y[2] + a * k[2], y[3] + a * k[3], y[4] + a * k[4],
        y[5] + a * k[5], y[6] + a * k[6], y[7] + a * k[7], y[8] + a * k[8], y[9] + a * k[9],
    )  # fmt: skip


@formula
def scaled(a, y):
    """Return ``a y``, elementwise."""
    return (a * y[0], a * y[1], a * y[2], a * y[3], a * y[4], a * y[5], a * y[6], a * y[7], a * y[8], a * y[9])


@formula
def _sum6(a, b, c, d):
    return (
        a[0] + b[0] + c[0] + d[0], a[1] + b[1] + c[1] + d[1], a[2] + b[2] + c[2] + d[2],
        a[3] + b[3] + c[3] + d[3], a[4] + b[4] + c[4] + d[4], a[5] + b[5] + c[5] + d[5],
    )  # fmt: skip


@formula
def advanced(y, a, k1, k2, k3, k4):
    """Return ``y + a (k1 + 2 k2 + 2 k3 + k4)``; the sum comes first, and a large depth is rounded once per step."""
    return (
        y[0] + a * (k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0]),
        y[1] + a * (k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1]),
        y[2] + a * (k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2]),
        y[3] + a * (k1[3] + 2.0 * (k2[3] + k3[3]) + k4[3]),
        y[4] + a * (k1[4] + 2.0 * (k2[4] + k3[4]) + k4[4]),
        y[5] + a * (k1[5] + 2.0 * (k2[5] + k3[5]) + k4[5]),
        y[6] + a * (k1[6] + 2.0 * (k2[6] + k3[6]) + k4[6]),
        y[7] + a * (k1[7] + 2.0 * (k2[7] + k3[7]) + k4[7]),
        y[8] + a * (k1[8] + 2.0 * (k2[8] + k3[8]) + k4[8]),
        y[9] + a * (k1[9] + 2.0 * (k2[9] + k3[9]) + k4[9]),
    )


@formula
def step(hull, body, y, b, h):
    """Advance ``y`` by ``h``: return the new state, and for the transpose the four stages and their geometry."""
    g1 = geometry_of(y)
    k1 = rates_at(hull, body, y, g1, b)
    y2 = shifted(y, 0.5 * h, k1)
    g2 = geometry_of(y2)
    k2 = rates_at(hull, body, y2, g2, b)
    y3 = shifted(y, 0.5 * h, k2)
    g3 = geometry_of(y3)
    k3 = rates_at(hull, body, y3, g3, b)
    y4 = shifted(y, h, k3)
    g4 = geometry_of(y4)
    k4 = rates_at(hull, body, y4, g4, b)
    return advanced(y, h / 6.0, k1, k2, k3, k4), (y, y2, y3, y4), (g1, g2, g3, g4)


@formula
def step_vjp(hull, body, stages, geometry, a, h):
    """Apply the transposed derivative of `step` to ``a`` (ten): parts of the state and of the disturbance."""
    y, y2, y3, y4 = stages
    e4, b4 = rates_vjp(hull, body, y4, geometry[3], scaled(h / 6.0, a))
    e3, b3 = rates_vjp(hull, body, y3, geometry[2], shifted(scaled(h / 3.0, a), h, e4))
    e2, b2 = rates_vjp(hull, body, y2, geometry[1], shifted(scaled(h / 3.0, a), 0.5 * h, e3))
    e1, b1 = rates_vjp(hull, body, y, geometry[0], shifted(scaled(h / 6.0, a), 0.5 * h, e2))
    return shifted(shifted(shifted(shifted(a, 1.0, e1), 1.0, e2), 1.0, e3), 1.0, e4), _sum6(b1, b2, b3, b4)


@formula
def displacement(stages, h):
    """Return the horizontal displacement over the step: the Runge-Kutta quadrature of eq. 1 along the stages."""
    x1, e1 = horizontal_velocity(stages[0])
    x2, e2 = horizontal_velocity(stages[1])
    x3, e3 = horizontal_velocity(stages[2])
    x4, e4 = horizontal_velocity(stages[3])
    return h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4), h / 6.0 * (e1 + 2.0 * e2 + 2.0 * e3 + e4)
