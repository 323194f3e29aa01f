"""Jacobian of the twelve rates, derived by hand: 79 of its 144 entries can differ from zero.

The rates of the ten sensed states, ``[phi, theta, psi, Z, u, v, w, p, q, r]``, have 67 of them, in a list whose
positions are in `ENTRY_ROW` and `ENTRY_COLUMN`. The other twelve are in the rows of X and Y, on which no rate depends.
"""

from typing import Any

import numpy as np

from gliderhpc.kernels.dynamics import momenta
from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.elementwise import clear, load, store, zero_like
from gliderhpc.kernels.hydrodynamics import flow_of, load_of, viscous_partials
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import GRAVITY, load_body
from gliderhpc.kernels.window import sensed_of

_COLUMNS = (
    (0, 1, 7, 8, 9),
    (0, 8, 9),
    (0, 1, 8, 9),
    (0, 1, 4, 5, 6),
    (1, 3, 4, 5, 6, 7, 8, 9),
    (0, 1, 3, 4, 5, 6, 7, 8, 9),
    (0, 1, 3, 4, 5, 6, 7, 8, 9),
    (0, 1, 4, 5, 6, 7, 8, 9),
    (0, 1, 4, 5, 6, 7, 8, 9),
    (0, 1, 4, 5, 6, 7, 8, 9),
)
ENTRY_ROW = np.array([row for row, columns in enumerate(_COLUMNS) for _ in columns])
"""Row of each entry among the sensed states."""
ENTRY_COLUMN = np.array([column for columns in _COLUMNS for column in columns])
"""Column of each entry among the sensed states."""
ENTRIES = len(ENTRY_ROW)

_AMONG_TWELVE = np.array([0, 1, 2, 5, 6, 7, 8, 9, 10, 11])


@formula
def _attitude_partials(sp, cp, st, ct, q, r):
    """Return the rows of phi, theta and psi (eq. 4)."""
    inv_ct = 1.0 / ct
    tt = st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    return (
        (tt * nod, turn * inv_ct * inv_ct, 1.0 + zero_like(sp), sp * tt, cp * tt),
        (-turn, cp, -sp),
        (nod * inv_ct, turn * inv_ct * tt, sp * inv_ct, cp * inv_ct),
    )


@formula
def _momentum_partials(hull, body, V, Omega, P, L):
    """Return the velocity derivatives of ``P x Omega`` and ``Pi x Omega + P x V``: rows of six."""
    u, v, w = V
    p, q, r = Omega
    Pu, Pv, Pw = P
    Lp, Lq, Lr = L
    mu, mv, mw = hull.mass_u, hull.mass_v, hull.mass_w
    Sx, Sy, Sz = body.Sx, body.Sy, body.Sz
    J1, J2, J3 = hull.added_p + body.Jxx, hull.added_q + body.Jyy, hull.added_r + body.Jzz
    Jxy, Jxz, Jyz = body.Jxy, body.Jxz, body.Jyz
    return (
        (0.0, mv * r, -mw * q, -Sy * q - Sz * r, Sx * q - Pw, Sx * r + Pv),
        (-mu * r, 0.0, mw * p, Sy * p + Pw, -Sx * p - Sz * r, Sy * r - Pu),
        (mu * q, -mv * p, 0.0, Sz * p - Pv, Sz * q + Pu, -Sx * p - Sy * q),
        (
            Sy * q + Sz * r, mv * w - Pw - Sx * q, Pv - mw * v - Sx * r,
            Jxy * r - Jxz * q - Sy * v - Sz * w, J2 * r - Jyz * q - Lr + Sx * v, Jyz * r - J3 * q + Lq + Sx * w,
        ),
        (
            Pw - mu * w - Sy * p, Sx * p + Sz * r, mw * u - Pu - Sy * r,
            Jxz * p - J1 * r + Lr + Sy * u, Jyz * p - Jxy * r - Sx * u - Sz * w, J3 * p - Jxz * r - Lp + Sy * w,
        ),
        (
            mu * v - Pv - Sz * p, Pu - mv * u - Sz * q, Sx * p + Sy * q,
            J1 * q - Jxy * p - Lq + Sz * u, Jxy * q - J2 * p + Lp + Sz * v, Jxz * q - Jyz * p - Sx * u - Sy * v,
        ),
    )  # fmt: skip


@formula
def _velocity_row(momentum, by_alpha, by_beta, by_V2, directions, scale):
    """Return six entries of a row: momentum and viscous terms for u, v and w; momentum terms for p, q and r."""
    alpha_u, alpha_w, beta_u, beta_v, beta_w, twice_u, twice_v, twice_w = directions
    return (
        scale * (momentum[0] + by_alpha * alpha_u + by_beta * beta_u + by_V2 * twice_u),
        scale * (momentum[1] + by_beta * beta_v + by_V2 * twice_v),
        scale * (momentum[2] + by_alpha * alpha_w + by_beta * beta_w + by_V2 * twice_w),
        scale * momentum[3],
        scale * momentum[4],
        scale * momentum[5],
    )


@formula
def _store_row(entries, at, first, scale, values):
    for i in range(len(values)):
        store(entries, (*at, first + i), scale * values[i])


@formula
def store_partials(hull, body, y, scale, entries, at):
    """Write ``scale`` times the sensed states' Jacobian at ``y`` into the list ``entries[at]``."""
    phi, theta, _, Z, u, v, w, p, q, r = y
    sp, cp = sincos(phi)
    st, ct = sincos(theta)
    kx, ky, kz = -st, sp * ct, cp * ct
    by_phi, by_theta, by_psi = _attitude_partials(sp, cp, st, ct, q, r)
    _store_row(entries, at, 0, scale, by_phi)
    _store_row(entries, at, 5, scale, by_theta)
    _store_row(entries, at, 8, scale, by_psi)
    _store_row(entries, at, 12, scale, (kz * v - ky * w, -ct * u - st * (sp * v + cp * w), kx, ky, kz))

    # Rates of the velocities, differentiated by the velocities: momenta and viscous loads.
    flow = flow_of(u, v, w)
    load_flow = load_of(hull, body.rudder, flow, p, q, r)
    by_alpha, by_beta, by_V2 = viscous_partials(hull, body.rudder, flow, load_flow, p, q, r)
    Pu, Pv, Pw, Lp, Lq, Lr = momenta(hull, body, u, v, w, p, q, r)
    momentum = _momentum_partials(hull, body, (u, v, w), (p, q, r), (Pu, Pv, Pw), (Lp, Lq, Lr))
    directions = (
        -w * flow.inv_U2, u * flow.inv_U2,
        -v * flow.ca * flow.inv_V2, flow.U * flow.inv_V2, -v * flow.sa * flow.inv_V2,
        2.0 * u, 2.0 * v, 2.0 * w,
    )  # fmt: skip
    a1, a2, a3 = scale / hull.mass_u, scale / hull.mass_v, scale / hull.mass_w
    a4, a5, a6 = scale / hull.inertia_p, scale / hull.inertia_q, scale / hull.inertia_r
    of_u = _velocity_row(momentum[0], by_alpha[0], by_beta[0], by_V2[0], directions, a1)
    of_v = _velocity_row(momentum[1], by_alpha[1], by_beta[1], by_V2[1], directions, a2)
    of_w = _velocity_row(momentum[2], by_alpha[2], by_beta[2], by_V2[2], directions, a3)
    of_p = _velocity_row(momentum[3], by_alpha[3], by_beta[3], by_V2[3], directions, a4)
    of_q = _velocity_row(momentum[4], by_alpha[4], by_beta[4], by_V2[4], directions, a5)
    of_r = _velocity_row(momentum[5], by_alpha[5], by_beta[5], by_V2[5], directions, a6)
    W2 = flow.V2 + hull.rate_floor2
    dp, dq, dr = W2 * hull.K_p, W2 * hull.K_q, W2 * hull.K_r
    planar_p, planar_q = flow.cb * dp, flow.sb * dq

    # The same rates, differentiated by attitude and depth: direction of gravity and depth slope of the buoyancy.
    buoyancy = body.net_weight - hull.depth_slope * Z
    Sx, Sy, Sz = GRAVITY * body.Sx, GRAVITY * body.Sy, GRAVITY * body.Sz
    tx, ty, tz = -ct, -st * sp, -st * cp
    lift, slope = buoyancy, -hull.depth_slope
    _store_row(entries, at, 17, 1.0, (a1 * (lift * tx), a1 * (slope * kx), *of_u))
    _store_row(entries, at, 25, 1.0, (a2 * (lift * kz), a2 * (lift * ty), a2 * (slope * ky), *of_v))
    _store_row(entries, at, 34, 1.0, (-a3 * (lift * ky), a3 * (lift * tz), a3 * (slope * kz), *of_w))
    _store_row(
        entries, at, 43, 1.0,
        (-a4 * (Sy * ky + Sz * kz), a4 * (Sy * tz - Sz * ty), of_p[0], of_p[1], of_p[2],
         of_p[3] + a4 * (flow.ca * planar_p), of_p[4] - a4 * (flow.ca * planar_q), of_p[5] - a4 * (flow.sa * dr)),
    )  # fmt: skip
    _store_row(
        entries, at, 51, 1.0,
        (a5 * (Sx * ky), a5 * (Sz * tx - Sx * tz), of_q[0], of_q[1], of_q[2],
         of_q[3] + a5 * (flow.sb * dp), of_q[4] + a5 * (flow.cb * dq), of_q[5]),
    )  # fmt: skip
    _store_row(
        entries, at, 59, 1.0,
        (a6 * (Sx * kz), a6 * (Sx * ty - Sy * tx), of_r[0], of_r[1], of_r[2],
         of_r[3] + a6 * (flow.sa * planar_p), of_r[4] - a6 * (flow.sa * planar_q), of_r[5] + a6 * (flow.ca * dr)),
    )  # fmt: skip


@formula
def pulled(entries, at, n):
    """Apply the transposed Jacobian in the list ``entries[at]`` to a costate ``n`` (ten); psi's entry is left out."""
    e = entries
    return (
        load(e, (*at, 0)) * n[0] + load(e, (*at, 5)) * n[1] + load(e, (*at, 8)) * n[2] + load(e, (*at, 12)) * n[3]
        + load(e, (*at, 25)) * n[5] + load(e, (*at, 34)) * n[6]
        + load(e, (*at, 43)) * n[7] + load(e, (*at, 51)) * n[8] + load(e, (*at, 59)) * n[9],
        load(e, (*at, 1)) * n[0] + load(e, (*at, 9)) * n[2] + load(e, (*at, 13)) * n[3]
        + load(e, (*at, 17)) * n[4] + load(e, (*at, 26)) * n[5] + load(e, (*at, 35)) * n[6]
        + load(e, (*at, 44)) * n[7] + load(e, (*at, 52)) * n[8] + load(e, (*at, 60)) * n[9],
        load(e, (*at, 18)) * n[4] + load(e, (*at, 27)) * n[5] + load(e, (*at, 36)) * n[6],
        load(e, (*at, 14)) * n[3] + load(e, (*at, 19)) * n[4] + load(e, (*at, 28)) * n[5] + load(e, (*at, 37)) * n[6]
        + load(e, (*at, 45)) * n[7] + load(e, (*at, 53)) * n[8] + load(e, (*at, 61)) * n[9],
        load(e, (*at, 15)) * n[3] + load(e, (*at, 20)) * n[4] + load(e, (*at, 29)) * n[5] + load(e, (*at, 38)) * n[6]
        + load(e, (*at, 46)) * n[7] + load(e, (*at, 54)) * n[8] + load(e, (*at, 62)) * n[9],
        load(e, (*at, 16)) * n[3] + load(e, (*at, 21)) * n[4] + load(e, (*at, 30)) * n[5] + load(e, (*at, 39)) * n[6]
        + load(e, (*at, 47)) * n[7] + load(e, (*at, 55)) * n[8] + load(e, (*at, 63)) * n[9],
        load(e, (*at, 2)) * n[0]
        + load(e, (*at, 22)) * n[4] + load(e, (*at, 31)) * n[5] + load(e, (*at, 40)) * n[6]
        + load(e, (*at, 48)) * n[7] + load(e, (*at, 56)) * n[8] + load(e, (*at, 64)) * n[9],
        load(e, (*at, 3)) * n[0] + load(e, (*at, 6)) * n[1] + load(e, (*at, 10)) * n[2]
        + load(e, (*at, 23)) * n[4] + load(e, (*at, 32)) * n[5] + load(e, (*at, 41)) * n[6]
        + load(e, (*at, 49)) * n[7] + load(e, (*at, 57)) * n[8] + load(e, (*at, 65)) * n[9],
        load(e, (*at, 4)) * n[0] + load(e, (*at, 7)) * n[1] + load(e, (*at, 11)) * n[2]
        + load(e, (*at, 24)) * n[4] + load(e, (*at, 33)) * n[5] + load(e, (*at, 42)) * n[6]
        + load(e, (*at, 50)) * n[7] + load(e, (*at, 58)) * n[8] + load(e, (*at, 66)) * n[9],
    )  # fmt: skip


@formula
def track_partials(y):
    """Return the rows of X and Y (eq. 3): derivatives by phi, theta, psi, u, v and w.

    The horizontal velocity is (ahead, across) rotated by the heading.
    """
    phi, theta, psi, _, u, v, w, _, _, _ = y
    sp, cp = sincos(phi)
    st, ct = sincos(theta)
    ss, cs = sincos(psi)
    ahead = ct * u + st * (sp * v + cp * w)
    across = cp * v - sp * w
    ahead_phi = st * across
    across_phi = -(sp * v + cp * w)
    ahead_theta = -st * u + ct * (sp * v + cp * w)
    return (
        (cs * ahead_phi - ss * across_phi, cs * ahead_theta, -ss * ahead - cs * across,
         cs * ct, cs * st * sp - ss * cp, cs * st * cp + ss * sp),
        (ss * ahead_phi + cs * across_phi, ss * ahead_theta, cs * ahead - ss * across,
         ss * ct, ss * st * sp + cs * cp, ss * st * cp - cs * sp),
    )  # fmt: skip


def rhs_jacobian(hull: Any, bodies: Any, state: Any, out: Any) -> None:
    """Fill ``out (12, 12)`` with df/dy at ``state`` (12); it does not depend on the disturbance."""
    fill_jacobian(hull, bodies, state, np.empty((1, ENTRIES)), out)


@kernel
def fill_jacobian(hull, bodies, state, entries, out):
    """Fill ``out`` as `rhs_jacobian` does, with scratch ``entries (1, ENTRIES)``."""
    y = sensed_of(state)
    store_partials(hull, load_body(bodies, 0), y, 1.0, entries, (0,))
    clear(out)
    for i in range(ENTRIES):
        out[_AMONG_TWELVE[ENTRY_ROW[i]], _AMONG_TWELVE[ENTRY_COLUMN[i]]] = entries[0, i]
    track = track_partials(y)
    for row in range(2):
        for i in range(3):
            out[3 + row, i] = track[row][i]
            out[3 + row, 6 + i] = track[row][3 + i]
