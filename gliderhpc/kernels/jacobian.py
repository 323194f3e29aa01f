"""The dense Jacobian df/dy of the twelve rates, by hand: 79 of its 144 entries can differ from zero.

State order ``[phi, theta, psi, X, Y, Z, u, v, w, p, q, r]`` (eq. 16).
"""

from typing import NamedTuple

from gliderhpc.kernels.dynamics import momenta
from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.hydrodynamics import flow_of, load_of, viscous_partials
from gliderhpc.kernels.jit import formula
from gliderhpc.kernels.mass import GRAVITY


@formula
def _acceleration_column(V, Omega, P, L, dV, dOmega, dP, dL):
    """Momentum terms' derivative along one velocity direction: d(P x Omega), d(Pi x Omega + P x V)."""
    u, v, w = V
    p, q, r = Omega
    Pu, Pv, Pw = P
    Lp, Lq, Lr = L
    du, dv, dw = dV
    dp, dq, dr = dOmega
    dPu, dPv, dPw = dP
    dLp, dLq, dLr = dL
    return (
        dPv * r - dPw * q + Pv * dr - Pw * dq,
        dPw * p - dPu * r + Pw * dp - Pu * dr,
        dPu * q - dPv * p + Pu * dq - Pv * dp,
        dLq * r - dLr * q + Lq * dr - Lr * dq + dPv * w - dPw * v + Pv * dw - Pw * dv,
        dLr * p - dLp * r + Lr * dp - Lp * dr + dPw * u - dPu * w + Pw * du - Pu * dw,
        dLp * q - dLq * p + Lp * dq - Lq * dp + dPu * v - dPv * u + Pu * dv - Pv * du,
    )


class Attitude(NamedTuple):
    """Sines and cosines of roll, pitch and heading, and the direction k of gravity in the body frame."""

    sp: float
    cp: float
    st: float
    ct: float
    ss: float
    cs: float
    kx: float
    ky: float
    kz: float


@formula
def _attitude_of(phi, theta, psi):
    sp, cp = sincos(phi)
    st, ct = sincos(theta)
    ss, cs = sincos(psi)
    return Attitude(sp, cp, st, ct, ss, cs, -st, sp * ct, cp * ct)


@formula
def _attitude_rows(at, q, r, out):
    """Rows of the attitude (eq. 4): by the attitude and by the angular rates."""
    sp, cp = at.sp, at.cp
    inv_ct = 1.0 / at.ct
    tt = at.st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    out[0, 0] = tt * nod
    out[0, 1] = turn * inv_ct * inv_ct
    out[0, 9] = 1.0
    out[0, 10] = sp * tt
    out[0, 11] = cp * tt
    out[1, 0] = -turn
    out[1, 10] = cp
    out[1, 11] = -sp
    out[2, 0] = nod * inv_ct
    out[2, 1] = turn * inv_ct * tt
    out[2, 10] = sp * inv_ct
    out[2, 11] = cp * inv_ct


@formula
def _position_rows(at, u, v, w, out):
    """Rows of the position (eq. 3); the horizontal velocity is (ahead, across) turned by the heading."""
    sp, cp, st, ct, ss, cs = at.sp, at.cp, at.st, at.ct, at.ss, at.cs
    ahead = ct * u + st * (sp * v + cp * w)
    across = cp * v - sp * w
    ahead_phi = st * across
    across_phi = -(sp * v + cp * w)
    ahead_theta = -st * u + ct * (sp * v + cp * w)
    out[3, 0] = cs * ahead_phi - ss * across_phi
    out[4, 0] = ss * ahead_phi + cs * across_phi
    out[3, 1] = cs * ahead_theta
    out[4, 1] = ss * ahead_theta
    out[3, 2] = -ss * ahead - cs * across
    out[4, 2] = cs * ahead - ss * across
    out[3, 6] = cs * ct
    out[4, 6] = ss * ct
    out[3, 7] = cs * st * sp - ss * cp
    out[4, 7] = ss * st * sp + cs * cp
    out[3, 8] = cs * st * cp + ss * sp
    out[4, 8] = ss * st * cp - cs * sp
    out[5, 0] = at.kz * v - at.ky * w
    out[5, 1] = -ct * u - st * (sp * v + cp * w)
    out[5, 6] = at.kx
    out[5, 7] = at.ky
    out[5, 8] = at.kz


@formula
def _weight_columns(hull, body, at, Z, inverse, out):
    """Rates of the velocities by attitude and depth: gravity's direction and the depth slope of the buoyancy."""
    buoyancy = body.net_weight - hull.depth_slope * Z
    Sx, Sy, Sz = body.Sx, body.Sy, body.Sz
    m1, m2, m3, i1, i2, i3 = inverse
    for column, dk in ((0, (0.0, at.kz, -at.ky)), (1, (-at.ct, -at.st * at.sp, -at.st * at.cp))):
        out[6, column] = buoyancy * dk[0] * m1
        out[7, column] = buoyancy * dk[1] * m2
        out[8, column] = buoyancy * dk[2] * m3
        out[9, column] = GRAVITY * (Sy * dk[2] - Sz * dk[1]) * i1
        out[10, column] = GRAVITY * (Sz * dk[0] - Sx * dk[2]) * i2
        out[11, column] = GRAVITY * (Sx * dk[1] - Sy * dk[0]) * i3
    out[6, 5] = -hull.depth_slope * at.kx * m1
    out[7, 5] = -hull.depth_slope * at.ky * m2
    out[8, 5] = -hull.depth_slope * at.kz * m3


@formula
def _momentum_columns(hull, body, u, v, w, p, q, r):
    """Momentum terms of eq. 9's rates by each of the six velocities: six columns of six, not yet over the inertia."""
    Pu, Pv, Pw, Lp, Lq, Lr = momenta(hull, body, u, v, w, p, q, r)
    V, Omega, P, L = (u, v, w), (p, q, r), (Pu, Pv, Pw), (Lp, Lq, Lr)
    Sx, Sy, Sz = body.Sx, body.Sy, body.Sz
    J1, J2, J3 = hull.added_p + body.Jxx, hull.added_q + body.Jyy, hull.added_r + body.Jzz
    x, y, z, zero = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    return (
        _acceleration_column(V, Omega, P, L, x, zero, (hull.mass_u, 0.0, 0.0), (0.0, Sz, -Sy)),
        _acceleration_column(V, Omega, P, L, y, zero, (0.0, hull.mass_v, 0.0), (-Sz, 0.0, Sx)),
        _acceleration_column(V, Omega, P, L, z, zero, (0.0, 0.0, hull.mass_w), (Sy, -Sx, 0.0)),
        _acceleration_column(V, Omega, P, L, zero, x, (0.0, -Sz, Sy), (J1, body.Jxy, body.Jxz)),
        _acceleration_column(V, Omega, P, L, zero, y, (Sz, 0.0, -Sx), (body.Jxy, J2, body.Jyz)),
        _acceleration_column(V, Omega, P, L, zero, z, (-Sy, Sx, 0.0), (body.Jxz, body.Jyz, J3)),
    )


@formula
def _damping_columns(hull, flow):
    """Moment of the viscous damping, body frame, by p, q and r (eqs. 12, 14): three columns of three."""
    W2 = flow.V2 + hull.rate_floor2
    return (
        (flow.ca * flow.cb * W2 * hull.K_p, flow.sb * W2 * hull.K_p, flow.sa * flow.cb * W2 * hull.K_p),
        (-flow.ca * flow.sb * W2 * hull.K_q, flow.cb * W2 * hull.K_q, -flow.sa * flow.sb * W2 * hull.K_q),
        (-flow.sa * W2 * hull.K_r, 0.0, flow.ca * W2 * hull.K_r),
    )


@formula
def _velocity_columns(hull, body, u, v, w, p, q, r, inverse, out):
    """Rates of the velocities by the velocities: momenta, viscous loads by the flow, and damping."""
    flow = flow_of(u, v, w)
    load = load_of(hull, body.rudder, flow, p, q, r)
    by_alpha, by_beta, by_V2 = viscous_partials(hull, body.rudder, flow, load, p, q, r)
    alpha_u, alpha_w = -w * flow.inv_U2, u * flow.inv_U2
    beta_u, beta_v, beta_w = -v * flow.ca * flow.inv_V2, flow.U * flow.inv_V2, -v * flow.sa * flow.inv_V2
    by_u, by_v, by_w, by_p, by_q, by_r = _momentum_columns(hull, body, u, v, w, p, q, r)
    damping_p, damping_q, damping_r = _damping_columns(hull, flow)
    for i in range(6):
        out[6 + i, 6] = inverse[i] * (by_u[i] + by_alpha[i] * alpha_u + by_beta[i] * beta_u + by_V2[i] * 2.0 * u)
        out[6 + i, 7] = inverse[i] * (by_v[i] + by_beta[i] * beta_v + by_V2[i] * 2.0 * v)
        out[6 + i, 8] = inverse[i] * (by_w[i] + by_alpha[i] * alpha_w + by_beta[i] * beta_w + by_V2[i] * 2.0 * w)
        out[6 + i, 9] = inverse[i] * by_p[i]
        out[6 + i, 10] = inverse[i] * by_q[i]
        out[6 + i, 11] = inverse[i] * by_r[i]
    for i in range(3):
        out[9 + i, 9] += inverse[3 + i] * damping_p[i]
        out[9 + i, 10] += inverse[3 + i] * damping_q[i]
        out[9 + i, 11] += inverse[3 + i] * damping_r[i]


@formula
def rhs_jacobian(hull, body, y, out):
    """Fill ``out (12, 12)`` with df/dy at the twelve-state ``y``; the disturbance does not enter it."""
    phi, theta, psi, _, _, Z, u, v, w, p, q, r = y
    at = _attitude_of(phi, theta, psi)
    inverse = (
        1.0 / hull.mass_u, 1.0 / hull.mass_v, 1.0 / hull.mass_w,
        1.0 / hull.inertia_p, 1.0 / hull.inertia_q, 1.0 / hull.inertia_r,
    )  # fmt: skip
    for i in range(12):
        for j in range(12):
            out[i, j] = 0.0
    _attitude_rows(at, q, r, out)
    _position_rows(at, u, v, w, out)
    _weight_columns(hull, body, at, Z, inverse, out)
    _velocity_columns(hull, body, u, v, w, p, q, r, inverse, out)
