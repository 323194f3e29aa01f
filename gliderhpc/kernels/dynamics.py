"""Right-hand side of the flight model (eqs. 1-14, 20) and its vector-Jacobian product.

No measured quantity depends on X and Y, and psi enters no other rate of the ten *sensed* states,
``[phi, theta, psi, Z, u, v, w, p, q, r]``. The window problem integrates only these; `horizontal_velocity` gives the
rates of X and Y where they are needed.
"""

from typing import NamedTuple

from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.hydrodynamics import bearing_of, flow_along, load_of, to_body, viscous_vjp
from gliderhpc.kernels.jit import formula
from gliderhpc.kernels.mass import GRAVITY


@formula
def momenta(hull, body, u, v, w, p, q, r):
    """Return linear and angular momentum P and Pi of eq. 9, body frame."""
    return (
        hull.mass_u * u + q * body.Sz - r * body.Sy,
        hull.mass_v * v + r * body.Sx - p * body.Sz,
        hull.mass_w * w + p * body.Sy - q * body.Sx,
        (hull.added_p + body.Jxx) * p + body.Jxy * q + body.Jxz * r + body.Sy * w - body.Sz * v,
        body.Jxy * p + (hull.added_q + body.Jyy) * q + body.Jyz * r + body.Sz * u - body.Sx * w,
        body.Jxz * p + body.Jyz * q + (hull.added_r + body.Jzz) * r + body.Sx * v - body.Sy * u,
    )


class Attitude(NamedTuple):
    """Sines and cosines of roll and pitch."""

    sp: float
    cp: float
    st: float
    ct: float


@formula
def geometry_of(y):
    """Return the costly parts of the rates, which their transpose reuses: the attitude and the flow's bearing."""
    sp, cp = sincos(y[0])
    st, ct = sincos(y[1])
    return Attitude(sp, cp, st, ct), bearing_of(y[4], y[5], y[6])


@formula
def rates(hull, body, y, b):
    """Return the time derivatives of the ten sensed states under disturbance ``b`` (N, N m), as a tuple."""
    return rates_at(hull, body, y, geometry_of(y), b)


@formula
def rates_at(hull, body, y, geometry, b):
    """Return `rates` of a state whose geometry is known."""
    _, _, _, Z, u, v, w, p, q, r = y
    (sp, cp, st, ct), bearing = geometry
    kx, ky, kz = -st, sp * ct, cp * ct
    flow = flow_along(bearing, u, v, w)
    load = load_of(hull, body.rudder, flow, p, q, r)
    Fx, Fy, Fz = to_body(flow, load.f1, load.f2, load.f3)
    Mx, My, Mz = to_body(flow, load.m1, load.m2, load.m3)
    Pu, Pv, Pw, Lp, Lq, Lr = momenta(hull, body, u, v, w, p, q, r)
    buoyancy = body.net_weight - hull.depth_slope * Z
    gx, gy, gz = GRAVITY * kx, GRAVITY * ky, GRAVITY * kz
    turn = sp * q + cp * r
    inv_ct = 1.0 / ct
    return (
        p + st * inv_ct * turn,
        cp * q - sp * r,
        turn * inv_ct,
        kx * u + ky * v + kz * w,
        (Pv * r - Pw * q + buoyancy * kx + Fx + b[0]) / hull.mass_u,
        (Pw * p - Pu * r + buoyancy * ky + Fy + b[1]) / hull.mass_v,
        (Pu * q - Pv * p + buoyancy * kz + Fz + b[2]) / hull.mass_w,
        (Lq * r - Lr * q + Pv * w - Pw * v + body.Sy * gz - body.Sz * gy + Mx + b[3]) / hull.inertia_p,
        (Lr * p - Lp * r + Pw * u - Pu * w + body.Sz * gx - body.Sx * gz + My + b[4]) / hull.inertia_q,
        (Lp * q - Lq * p + Pu * v - Pv * u + body.Sx * gy - body.Sy * gx + Mz + b[5]) / hull.inertia_r,
    )


@formula
def rates_vjp(hull, body, y, geometry, a):
    """Apply the transposed derivative of `rates` to ``a`` (ten): parts of the states (ten) and the disturbance (six).

    The parts are the integrands of the adjoint equation (eq. 33) and of the gradient (eqs. 35, 36). ``geometry`` is
    that of ``y`` (`geometry_of`).
    """
    _, _, _, Z, u, v, w, p, q, r = y
    a_phi, a_theta, a_psi, a_Z, a_u, a_v, a_w, a_p, a_q, a_r = a
    (sp, cp, st, ct), bearing = geometry
    kx, ky, kz = -st, sp * ct, cp * ct
    flow = flow_along(bearing, u, v, w)
    load = load_of(hull, body.rudder, flow, p, q, r)
    Pu, Pv, Pw, Lp, Lq, Lr = momenta(hull, body, u, v, w, p, q, r)
    Sx, Sy, Sz = body.Sx, body.Sy, body.Sz
    fx, fy, fz = a_u / hull.mass_u, a_v / hull.mass_v, a_w / hull.mass_w
    mx, my, mz = a_p / hull.inertia_p, a_q / hull.inertia_q, a_r / hull.inertia_r

    d_u, d_v, d_w, d_p, d_q, d_r = viscous_vjp(hull, body.rudder, u, v, w, p, q, r, flow, load, fx, fy, fz, mx, my, mz)

    # Triple products, differentiated: a.(P x Omega) and a.(Pi x Omega) by P, Pi and Omega; a.(P x V) by P and V.
    e_Pu = q * fz - r * fy + v * mz - w * my
    e_Pv = r * fx - p * fz + w * mx - u * mz
    e_Pw = p * fy - q * fx + u * my - v * mx
    e_Lp = q * mz - r * my
    e_Lq = r * mx - p * mz
    e_Lr = p * my - q * mx
    d_p += fy * Pw - fz * Pv + my * Lr - mz * Lq
    d_q += fz * Pu - fx * Pw + mz * Lp - mx * Lr
    d_r += fx * Pv - fy * Pu + mx * Lq - my * Lp
    d_u += my * Pw - mz * Pv
    d_v += mz * Pu - mx * Pw
    d_w += mx * Pv - my * Pu
    # Momenta, differentiated by the velocities: P = mass V + Omega x S, Pi = (I_f + J_S) Omega + S x V.
    d_u += hull.mass_u * e_Pu + e_Lq * Sz - e_Lr * Sy
    d_v += hull.mass_v * e_Pv + e_Lr * Sx - e_Lp * Sz
    d_w += hull.mass_w * e_Pw + e_Lp * Sy - e_Lq * Sx
    d_p += Sy * e_Pw - Sz * e_Pv + (hull.added_p + body.Jxx) * e_Lp + body.Jxy * e_Lq + body.Jxz * e_Lr
    d_q += Sz * e_Pu - Sx * e_Pw + body.Jxy * e_Lp + (hull.added_q + body.Jyy) * e_Lq + body.Jyz * e_Lr
    d_r += Sx * e_Pv - Sy * e_Pu + body.Jxz * e_Lp + body.Jyz * e_Lq + (hull.added_r + body.Jzz) * e_Lr
    # Direction of gravity k: buoyancy, moment of the weight, and depth rate k.V.
    buoyancy = body.net_weight - hull.depth_slope * Z
    e_kx = buoyancy * fx + GRAVITY * (my * Sz - mz * Sy) + a_Z * u
    e_ky = buoyancy * fy + GRAVITY * (mz * Sx - mx * Sz) + a_Z * v
    e_kz = buoyancy * fz + GRAVITY * (mx * Sy - my * Sx) + a_Z * w
    d_u += a_Z * kx
    d_v += a_Z * ky
    d_w += a_Z * kz
    # Kinematics (eq. 4).
    inv_ct = 1.0 / ct
    tt = st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    e_turn = a_phi * tt + a_psi * inv_ct
    d_p += a_phi
    d_q += e_turn * sp + a_theta * cp
    d_r += e_turn * cp - a_theta * sp
    d_phi = e_turn * nod - a_theta * turn + e_ky * kz - e_kz * ky
    d_theta = (a_phi * inv_ct + a_psi * tt) * inv_ct * turn - ct * e_kx - st * (sp * e_ky + cp * e_kz)
    d_Z = -hull.depth_slope * (fx * kx + fy * ky + fz * kz)
    return (d_phi, d_theta, 0.0, d_Z, d_u, d_v, d_w, d_p, d_q, d_r), (fx, fy, fz, mx, my, mz)


@formula
def horizontal_velocity(y):
    """Return the rates of X and Y (rows 1 and 2 of eq. 3 times the velocity) from the ten sensed states."""
    phi, theta, psi, _, u, v, w, _, _, _ = y
    sp, cp = sincos(phi)
    st, ct = sincos(theta)
    ss, cs = sincos(psi)
    ahead = ct * u + st * (sp * v + cp * w)
    across = cp * v - sp * w
    return cs * ahead - ss * across, ss * ahead + cs * across
