"""Forward runs, and the cost of a window with its gradient (eq. 28 and its exact discrete adjoint)."""

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import displacement, step, step_vjp


@formula
def load_state(states, k):
    """Row ``k`` of an array of ten-state rows, as a tuple."""
    return (
        states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4],
        states[k, 5], states[k, 6], states[k, 7], states[k, 8], states[k, 9],
    )  # fmt: skip


@formula
def store_state(states, k, y):
    """Write the tuple ``y`` into row ``k``."""
    for i in range(10):
        states[k, i] = y[i]


@formula
def load_disturbance(b, k):
    """Row ``k`` of the disturbance, as a tuple."""
    return b[k, 0], b[k, 1], b[k, 2], b[k, 3], b[k, 4], b[k, 5]


@formula
def sensed_of(y):
    """The ten sensed states of a twelve-state row."""
    return y[0], y[1], y[2], y[5], y[6], y[7], y[8], y[9], y[10], y[11]


@formula
def store_row(trajectory, k, y, X, Y):
    """Write the twelve-state row ``k``: the sensed states and the track."""
    trajectory[k, 0], trajectory[k, 1], trajectory[k, 2] = y[0], y[1], y[2]
    trajectory[k, 3], trajectory[k, 4], trajectory[k, 5] = X, Y, y[3]
    for i in range(6):
        trajectory[k, 6 + i] = y[4 + i]


@kernel
def simulate(hull, bodies, state0, b, h, trajectory):
    """Fill ``trajectory (n+1, 12)`` from ``state0 (12)`` under ``bodies (n, 11)`` and ``b (n, 6)``."""
    y = sensed_of(state0)
    X, Y = state0[3], state0[4]
    store_row(trajectory, 0, y, X, Y)
    for k in range(b.shape[0]):
        new, y2, y3, y4 = step(hull, load_body(bodies, k), y, load_disturbance(b, k), h)
        north, east = displacement(y, y2, y3, y4, h)
        X += north
        Y += east
        y = new
        store_row(trajectory, k + 1, y, X, Y)


@kernel
def forward(hull, bodies, y0, b, h, states, stages):
    """Integrate the sensed states: fill ``states (n+1, 10)`` and the later stages ``stages (n, 3, 10)``."""
    y = load_state(y0, 0)
    store_state(states, 0, y)
    for k in range(b.shape[0]):
        y, y2, y3, y4 = step(hull, load_body(bodies, k), y, load_disturbance(b, k), h)
        for i in range(10):
            stages[k, 0, i] = y2[i]
            stages[k, 1, i] = y3[i]
            stages[k, 2, i] = y4[i]
        store_state(states, k + 1, y)


@kernel
def tracking_cost(states, measurements, weights, h):
    """Cost of eq. 28 summed over samples 1..n: radians and metres squared, seconds."""
    total = 0.0
    for k in range(1, states.shape[0]):
        d_phi = states[k, 0] - measurements[k, 0]
        d_theta = states[k, 1] - measurements[k, 1]
        d_psi = wrap(states[k, 2] - measurements[k, 2])
        d_Z = states[k, 3] - measurements[k, 3]
        total += weights[k] * (d_phi * d_phi + d_theta * d_theta + d_psi * d_psi + d_Z * d_Z)
    return h * total


@kernel
def adjoint(hull, bodies, states, stages, measurements, weights, h, gradient, gradient_state0):
    """Sweep the exact transpose backwards (terminal costate zero): dJ/db ``(n, 6)`` and dJ/dy0 ``(10,)``."""
    a = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(bodies.shape[0] - 1, -1, -1):
        scale = 2.0 * h * weights[k + 1]
        a = (
            a[0] + scale * (states[k + 1, 0] - measurements[k + 1, 0]),
            a[1] + scale * (states[k + 1, 1] - measurements[k + 1, 1]),
            a[2] + scale * wrap(states[k + 1, 2] - measurements[k + 1, 2]),
            a[3] + scale * (states[k + 1, 3] - measurements[k + 1, 3]),
            a[4], a[5], a[6], a[7], a[8], a[9],
        )  # fmt: skip
        y2 = load_state(stages[k], 0)
        y3 = load_state(stages[k], 1)
        y4 = load_state(stages[k], 2)
        a, g = step_vjp(hull, load_body(bodies, k), load_state(states, k), y2, y3, y4, a, h)
        for i in range(6):
            gradient[k, i] = g[i]
    for i in range(10):
        gradient_state0[i] = a[i]


@kernel
def cost_and_gradient(hull, bodies, y0, b, measurements, weights, h, states, stages, gradient, gradient_state0):
    """Cost of one window, its gradient left in ``gradient`` and ``gradient_state0``."""
    forward(hull, bodies, y0, b, h, states, stages)
    adjoint(hull, bodies, states, stages, measurements, weights, h, gradient, gradient_state0)
    return tracking_cost(states, measurements, weights, h)
