"""Derivatives of the rates with respect to the hull's constants and the mass properties, on which its errors act.

The rates are linear in every coefficient. The derivatives are therefore products of costates with the terms of
eqs. 9 to 14; only the masses and inertias are divisors.
"""

from gliderhpc.kernels.dynamics import rates_at
from gliderhpc.kernels.hydrodynamics import flow_along, to_flow
from gliderhpc.kernels.jit import formula
from gliderhpc.kernels.mass import GRAVITY
from gliderhpc.kernels.parameters import Body, Hull

HULL_CONSTANTS = len(Hull._fields)
"""Number of constants of the hull, which come first."""

CONSTANTS = HULL_CONSTANTS + len(Body._fields)
"""Number of constants of the hull and of the mass properties after them, in the order of `Hull` and `Body`."""


@formula
def by_constants(hull, body, y, geometry, b, a):
    """Apply the transposed derivative of `rates` with respect to the constants to ``a`` (ten): a tuple of `CONSTANTS`.

    ``b`` is the disturbance (six) and ``geometry`` that of ``y`` (`gliderhpc.kernels.dynamics.geometry_of`).
    """
    _, _, _, Z, u, v, w, p, q, r = y
    _, _, _, _, a_u, a_v, a_w, a_p, a_q, a_r = a
    (sp, cp, st, ct), bearing = geometry
    kx, ky, kz = -st, sp * ct, cp * ct
    gx, gy, gz = GRAVITY * kx, GRAVITY * ky, GRAVITY * kz
    rate = rates_at(hull, body, y, geometry, b)
    flow = flow_along(bearing, u, v, w)
    alpha, beta, V2 = flow.alpha, flow.beta, flow.V2
    W2 = V2 + hull.rate_floor2
    fx, fy, fz = a_u / hull.mass_u, a_v / hull.mass_v, a_w / hull.mass_w
    mx, my, mz = a_p / hull.inertia_p, a_q / hull.inertia_q, a_r / hull.inertia_r
    a1, a2, a3 = to_flow(flow, fx, fy, fz)
    b1, b2, b3 = to_flow(flow, mx, my, mz)
    # Derivatives with respect to the momenta, as in `rates_vjp`.
    e_Pu = q * fz - r * fy + v * mz - w * my
    e_Pv = r * fx - p * fz + w * mx - u * mz
    e_Pw = p * fy - q * fx + u * my - v * mx
    e_Lp = q * mz - r * my
    e_Lq = r * mx - p * mz
    e_Lr = p * my - q * mx
    e_buoyancy = fx * kx + fy * ky + fz * kz
    return (
        u * e_Pu - rate[4] * fx,
        v * e_Pv - rate[5] * fy,
        w * e_Pw - rate[6] * fz,
        -rate[7] * mx,
        -rate[8] * my,
        -rate[9] * mz,
        p * e_Lp,
        q * e_Lq,
        r * e_Lr,
        -Z * e_buoyancy,
        -V2 * a1,
        -(V2 * alpha * alpha) * a1,
        V2 * beta * a2,
        -V2 * a3,
        -(V2 * alpha) * a3,
        V2 * beta * b1,
        W2 * p * b1,
        V2 * b2,
        V2 * alpha * b2,
        W2 * q * b2,
        V2 * beta * b3,
        W2 * r * b3,
        V2 * body.rudder * b3,
        hull.K_p * p * b1 + hull.K_q * q * b2 + hull.K_r * r * b3,
        r * e_Pv - q * e_Pw + v * e_Lr - w * e_Lq + gy * mz - gz * my,
        p * e_Pw - r * e_Pu + w * e_Lp - u * e_Lr + gz * mx - gx * mz,
        q * e_Pu - p * e_Pv + u * e_Lq - v * e_Lp + gx * my - gy * mx,
        p * e_Lp,
        q * e_Lq,
        r * e_Lr,
        q * e_Lp + p * e_Lq,
        r * e_Lp + p * e_Lr,
        r * e_Lq + q * e_Lr,
        e_buoyancy,
        V2 * hull.K_delta * b3,
    )
