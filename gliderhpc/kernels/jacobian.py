"""The dense Jacobian df/dy of the twelve rates, by hand: 79 of its 144 entries can differ from zero.

State order ``[phi, theta, psi, X, Y, Z, u, v, w, p, q, r]`` (eq. 16).
"""

from gliderhpc.kernels.dynamics import momenta
from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.hydrodynamics import flow_of, load_of, viscous_partials
from gliderhpc.kernels.jit import formula
from gliderhpc.kernels.mass import GRAVITY


@formula
def _acceleration_column(hull, body, V, Omega, P, L, dV, dOmega, dP, dL):
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


@formula
def rhs_jacobian(hull, body, y, out):
    """Fill ``out (12, 12)`` with df/dy at the twelve-state ``y``; the disturbance does not enter it."""
    phi, theta, psi, _, _, Z, u, v, w, p, q, r = y
    sp, cp = sincos(phi)
    st, ct = sincos(theta)
    ss, cs = sincos(psi)
    kx, ky, kz = -st, sp * ct, cp * ct
    inv_ct = 1.0 / ct
    tt = st * inv_ct
    turn = sp * q + cp * r
    nod = cp * q - sp * r
    for i in range(12):
        for j in range(12):
            out[i, j] = 0.0

    # Attitude (eq. 4).
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

    # Position (eq. 3): the horizontal velocity is (ahead, across) turned by the heading.
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
    out[5, 0] = kz * v - ky * w
    out[5, 1] = -ct * u - st * (sp * v + cp * w)
    out[5, 6] = kx
    out[5, 7] = ky
    out[5, 8] = kz

    # Velocities by attitude and depth: gravity's direction and the depth slope of the buoyancy.
    buoyancy = body.net_weight - hull.depth_slope * Z
    Sx, Sy, Sz = body.Sx, body.Sy, body.Sz
    m1, m2, m3 = 1.0 / hull.mass_u, 1.0 / hull.mass_v, 1.0 / hull.mass_w
    i1, i2, i3 = 1.0 / hull.inertia_p, 1.0 / hull.inertia_q, 1.0 / hull.inertia_r
    for column, dk in ((0, (0.0, kz, -ky)), (1, (-ct, -st * sp, -st * cp))):
        out[6, column] = buoyancy * dk[0] * m1
        out[7, column] = buoyancy * dk[1] * m2
        out[8, column] = buoyancy * dk[2] * m3
        out[9, column] = GRAVITY * (Sy * dk[2] - Sz * dk[1]) * i1
        out[10, column] = GRAVITY * (Sz * dk[0] - Sx * dk[2]) * i2
        out[11, column] = GRAVITY * (Sx * dk[1] - Sy * dk[0]) * i3
    out[6, 5] = -hull.depth_slope * kx * m1
    out[7, 5] = -hull.depth_slope * ky * m2
    out[8, 5] = -hull.depth_slope * kz * m3

    # Velocities by velocities: momenta and viscous loads.
    flow = flow_of(u, v, w)
    load = load_of(hull, body.rudder, flow, p, q, r)
    by_alpha, by_beta, by_V2 = viscous_partials(hull, body.rudder, flow, load, p, q, r)
    Pu, Pv, Pw, Lp, Lq, Lr = momenta(hull, body, u, v, w, p, q, r)
    V, Omega, P, L = (u, v, w), (p, q, r), (Pu, Pv, Pw), (Lp, Lq, Lr)
    zero = (0.0, 0.0, 0.0)
    by_u = _acceleration_column(hull, body, V, Omega, P, L, (1.0, 0.0, 0.0), zero, (hull.mass_u, 0.0, 0.0), (0.0, Sz, -Sy))
    by_v = _acceleration_column(hull, body, V, Omega, P, L, (0.0, 1.0, 0.0), zero, (0.0, hull.mass_v, 0.0), (-Sz, 0.0, Sx))
    by_w = _acceleration_column(hull, body, V, Omega, P, L, (0.0, 0.0, 1.0), zero, (0.0, 0.0, hull.mass_w), (Sy, -Sx, 0.0))
    J1, J2, J3 = hull.added_p + body.Jxx, hull.added_q + body.Jyy, hull.added_r + body.Jzz
    by_p = _acceleration_column(
        hull, body, V, Omega, P, L, zero, (1.0, 0.0, 0.0), (0.0, -Sz, Sy), (J1, body.Jxy, body.Jxz)
    )
    by_q = _acceleration_column(
        hull, body, V, Omega, P, L, zero, (0.0, 1.0, 0.0), (Sz, 0.0, -Sx), (body.Jxy, J2, body.Jyz)
    )
    by_r = _acceleration_column(
        hull, body, V, Omega, P, L, zero, (0.0, 0.0, 1.0), (-Sy, Sx, 0.0), (body.Jxz, body.Jyz, J3)
    )
    alpha_u, alpha_w = -w * flow.inv_U2, u * flow.inv_U2
    beta_u, beta_v, beta_w = -v * flow.ca * flow.inv_V2, flow.U * flow.inv_V2, -v * flow.sa * flow.inv_V2
    inverse = (m1, m2, m3, i1, i2, i3)
    W2 = flow.V2 + hull.rate_floor2
    damping_p = (flow.ca * flow.cb * W2 * hull.K_p, flow.sb * W2 * hull.K_p, flow.sa * flow.cb * W2 * hull.K_p)
    damping_q = (-flow.ca * flow.sb * W2 * hull.K_q, flow.cb * W2 * hull.K_q, -flow.sa * flow.sb * W2 * hull.K_q)
    damping_r = (-flow.sa * W2 * hull.K_r, 0.0, flow.ca * W2 * hull.K_r)
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
