"""Rates, their derivatives and moments at one or many points, for callers with arrays."""

from gliderhpc.kernels.dynamics import horizontal_velocity, rates
from gliderhpc.kernels.hydrodynamics import flow_of, load_of, to_body
from gliderhpc.kernels.jacobian import store_partials
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


@kernel
def rates_and_partials(hull, bodies, states, values, entries):
    """Fill the undisturbed rates ``values (n, 10)`` of sensed states ``(n, 10)``, and the entries of their Jacobians.

    A row of ``entries (n, ENTRIES)`` is the list of `gliderhpc.kernels.jacobian`.
    """
    for k in range(states.shape[0]):
        y = (
            states[k, 0], states[k, 1], states[k, 2], states[k, 3], states[k, 4],
            states[k, 5], states[k, 6], states[k, 7], states[k, 8], states[k, 9],
        )  # fmt: skip
        body = load_body(bodies, k)
        d = rates(hull, body, y, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        for i in range(10):
            values[k, i] = d[i]
        store_partials(hull, body, y, 1.0, entries, (k,))


@kernel
def viscous_yaw_moments(hull, motion, rudder, moments):
    """Fill the viscous yaw moments ``moments (n,)`` about the body axis (eqs. 12, 14), at ``motion (n, 6)``: u ... r.

    ``rudder (n,)`` is in rad.
    """
    for k in range(motion.shape[0]):
        flow = flow_of(motion[k, 0], motion[k, 1], motion[k, 2])
        load = load_of(hull, rudder[k], flow, motion[k, 3], motion[k, 4], motion[k, 5])
        _, _, yaw = to_body(flow, load.m1, load.m2, load.m3)
        moments[k] = yaw
