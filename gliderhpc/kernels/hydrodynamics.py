"""Viscous forces and moments (eqs. 11-14) and their derivatives.

The rotation R_bf needs no trigonometry: with U = hypot(u, w) and V = |velocity|, ``cos(alpha) = u/U``,
``sin(alpha) = w/U``, ``cos(beta) = U/V`` and ``sin(beta) = v/V``. Below ``_REST`` (m2/s2) the hull is treated as at
rest: the angles are zero, and all forces and derivatives vanish.
"""

from typing import NamedTuple

from gliderhpc.kernels.elementary import arctan2
from gliderhpc.kernels.elementwise import select, square_root
from gliderhpc.kernels.jit import formula

_REST = 1e-200


class Flow(NamedTuple):
    """Direction of the flow: squared speed, angles (eq. 13), their cosines and sines, reciprocal squared speeds."""

    V2: float
    alpha: float
    beta: float
    ca: float
    sa: float
    cb: float
    sb: float
    U: float
    inv_U2: float
    inv_V2: float


class Load(NamedTuple):
    """Viscous force and moment in the flow frame: [-D, SF, -L] and [M_DL1, M_DL2, M_DL3] of eqs. 11 and 12."""

    f1: float
    f2: float
    f3: float
    m1: float
    m2: float
    m3: float


class Bearing(NamedTuple):
    """Costly quantities of a flow: its angles (eq. 13), the reciprocal speed in the x-z plane and in total."""

    alpha: float
    beta: float
    inv_U: float
    inv_V: float


@formula
def bearing_of(u, v, w):
    """Return angle of attack, sideslip (eq. 13) and reciprocal speeds; zero where there is no flow."""
    U2 = u * u + w * w
    V2 = U2 + v * v
    moving = V2 > _REST
    planar = U2 > _REST
    # Both sides of a selection are computed; the unused one must not divide by zero.
    inv_U = square_root(select(planar, 1.0 / select(planar, U2, 1.0), 0.0))
    inv_V = square_root(select(moving, 1.0 / select(moving, V2, 1.0), 0.0))
    return Bearing(arctan2(w, u), arctan2(v, U2 * inv_U), inv_U, inv_V)


@formula
def flow_along(bearing, u, v, w):
    """Return all quantities of the flow, given its bearing."""
    U2 = u * u + w * w
    V2 = U2 + v * v
    inv_U, inv_V = bearing.inv_U, bearing.inv_V
    U = U2 * inv_U
    ca = select(inv_U > 0.0, u * inv_U, 1.0)
    cb = select(inv_V > 0.0, U * inv_V, 1.0)
    return Flow(V2, bearing.alpha, bearing.beta, ca, w * inv_U, cb, v * inv_V, U, inv_U * inv_U, inv_V * inv_V)


@formula
def flow_of(u, v, w):
    """Return the flow of a velocity: speed, angle of attack, sideslip (eq. 13)."""
    return flow_along(bearing_of(u, v, w), u, v, w)


@formula
def load_of(hull, rudder, flow, p, q, r):
    """Return forces and moments in the flow frame (eqs. 11, 12), including the rudder's yaw moment."""
    alpha, beta, V2 = flow.alpha, flow.beta, flow.V2
    W2 = V2 + hull.rate_floor2
    return Load(
        -V2 * (hull.K_D0 + hull.K_D * alpha * alpha),
        V2 * hull.K_beta * beta,
        -V2 * (hull.K_L0 + hull.K_L * alpha),
        V2 * hull.K_MR * beta + W2 * hull.K_p * p,
        V2 * (hull.K_M0 + hull.K_M * alpha) + W2 * hull.K_q * q,
        V2 * (hull.K_MY * beta + hull.K_delta * rudder) + W2 * hull.K_r * r,
    )


@formula
def to_body(flow, a1, a2, a3):
    """Rotate a vector from the flow frame to the body frame: R_bf of eq. 14."""
    ca, sa, cb, sb = flow.ca, flow.sa, flow.cb, flow.sb
    planar = cb * a1 - sb * a2
    return ca * planar - sa * a3, sb * a1 + cb * a2, sa * planar + ca * a3


@formula
def to_flow(flow, a1, a2, a3):
    """Rotate a vector from the body frame to the flow frame: the transpose of R_bf."""
    ca, sa, cb, sb = flow.ca, flow.sa, flow.cb, flow.sb
    planar = ca * a1 + sa * a3
    return cb * planar + sb * a2, cb * a2 - sb * planar, ca * a3 - sa * a1


@formula
def viscous_vjp(hull, rudder, u, v, w, p, q, r, flow, load, fx, fy, fz, mx, my, mz):
    """Apply the transposed derivative of (F_v, M_v) with respect to (u, v, w, p, q, r) to (f, m)."""
    alpha, beta, V2 = flow.alpha, flow.beta, flow.V2
    W2 = V2 + hull.rate_floor2
    a1, a2, a3 = to_flow(flow, fx, fy, fz)
    b1, b2, b3 = to_flow(flow, mx, my, mz)
    # Turning R_bf by d(alpha) exchanges flow axes 1-2 with 3; by d(beta), 1 with 2.
    planar_f = flow.cb * load.f1 - flow.sb * load.f2
    planar_m = flow.cb * load.m1 - flow.sb * load.m2
    planar_a = flow.cb * a1 - flow.sb * a2
    planar_b = flow.cb * b1 - flow.sb * b2
    d_alpha = (
        a3 * planar_f
        - load.f3 * planar_a
        + b3 * planar_m
        - load.m3 * planar_b
        + V2 * (-2.0 * hull.K_D * alpha * a1 - hull.K_L * a3 + hull.K_M * b2)
    )
    d_beta = (
        a2 * load.f1
        - a1 * load.f2
        + b2 * load.m1
        - b1 * load.m2
        + V2 * (hull.K_beta * a2 + hull.K_MR * b1 + hull.K_MY * b3)
    )
    d_V2 = (
        -(hull.K_D0 + hull.K_D * alpha * alpha) * a1
        + hull.K_beta * beta * a2
        - (hull.K_L0 + hull.K_L * alpha) * a3
        + (hull.K_MR * beta + hull.K_p * p) * b1
        + (hull.K_M0 + hull.K_M * alpha + hull.K_q * q) * b2
        + (hull.K_MY * beta + hull.K_delta * rudder + hull.K_r * r) * b3
    )
    turn = flow.inv_U2 * d_alpha
    slip = flow.inv_V2 * d_beta
    return (
        2.0 * u * d_V2 - w * turn - v * flow.ca * slip,
        2.0 * v * d_V2 + flow.U * slip,
        2.0 * w * d_V2 + u * turn - v * flow.sa * slip,
        W2 * hull.K_p * b1,
        W2 * hull.K_q * b2,
        W2 * hull.K_r * b3,
    )


@formula
def viscous_partials(hull, rudder, flow, load, p, q, r):
    """Return the derivatives of (F_v, M_v), body frame, with respect to alpha, beta and V2: three tuples of six."""
    alpha, beta, V2 = flow.alpha, flow.beta, flow.V2
    planar_f = flow.cb * load.f1 - flow.sb * load.f2
    planar_m = flow.cb * load.m1 - flow.sb * load.m2
    fa = to_body(flow, -2.0 * V2 * hull.K_D * alpha, 0.0, -V2 * hull.K_L)
    ma = to_body(flow, 0.0, V2 * hull.K_M, 0.0)
    by_alpha = (
        fa[0] - flow.sa * planar_f - flow.ca * load.f3,
        fa[1],
        fa[2] + flow.ca * planar_f - flow.sa * load.f3,
        ma[0] - flow.sa * planar_m - flow.ca * load.m3,
        ma[1],
        ma[2] + flow.ca * planar_m - flow.sa * load.m3,
    )
    fb = to_body(flow, -load.f2, load.f1 + V2 * hull.K_beta, 0.0)
    mb = to_body(flow, V2 * hull.K_MR - load.m2, load.m1, V2 * hull.K_MY)
    by_beta = (fb[0], fb[1], fb[2], mb[0], mb[1], mb[2])
    fv = to_body(flow, -(hull.K_D0 + hull.K_D * alpha * alpha), hull.K_beta * beta, -(hull.K_L0 + hull.K_L * alpha))
    mv = to_body(
        flow,
        hull.K_MR * beta + hull.K_p * p,
        hull.K_M0 + hull.K_M * alpha + hull.K_q * q,
        hull.K_MY * beta + hull.K_delta * rudder + hull.K_r * r,
    )
    by_V2 = (fv[0], fv[1], fv[2], mv[0], mv[1], mv[2])
    return by_alpha, by_beta, by_V2
