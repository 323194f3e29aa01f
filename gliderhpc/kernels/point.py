"""The right-hand side at one point, for callers that hold arrays."""

from gliderhpc.kernels.dynamics import horizontal_velocity, rates
from gliderhpc.kernels.jit import kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.window import sensed_of


@kernel
def rhs(hull, bodies, state, b, out):
    """Fill ``out (12)`` with the state's time derivative; ``bodies`` has one row."""
    y = sensed_of(state)
    d = rates(hull, load_body(bodies, 0), y, (b[0], b[1], b[2], b[3], b[4], b[5]))
    out[3], out[4] = horizontal_velocity(y)
    out[0], out[1], out[2], out[5] = d[0], d[1], d[2], d[3]
    for i in range(6):
        out[6 + i] = d[4 + i]
