"""Second implementation of the model from the paper: matrices and cross products, eqs. 1-14, 20 and 28, classical RK4.

Nothing here is shared with ``gliderhpc.kernels``. Every function takes complex numbers, so that the imaginary part of
``f(x + 1e-30j d)`` is its derivative along ``d`` free of cancellation (the complex step).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gliderhpc.platform import Platform

GRAVITY = 9.81
STEP = 1e-30
"""Imaginary step of the complex-step derivatives; its square vanishes against 1."""

SENSED = [0, 1, 2, 5, 6, 7, 8, 9, 10, 11]
MEASURED = [0, 1, 2, 5]


def arctan2(y: Any, x: Any) -> Any:
    """Angle of (x, y) with its derivative in the imaginary part, for the quadrants that `numpy.arctan2` knows."""
    angle = np.arctan2(np.real(y), np.real(x))
    if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
        return angle
    radius2 = np.real(x) ** 2 + np.real(y) ** 2
    if radius2 == 0.0:
        return angle + 0j
    return angle + 1j * (np.real(x) * np.imag(y) - np.real(y) * np.imag(x)) / radius2


def cross(a: Any, b: Any) -> Any:
    """Vector product of two vectors of three; `numpy.cross` takes fifteen times as long for single vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def body_to_earth(phi: Any, theta: Any, psi: Any) -> Any:
    """R_eb of eq. 3."""
    sphi, cphi = np.sin(phi), np.cos(phi)
    sth, cth = np.sin(theta), np.cos(theta)
    spsi, cpsi = np.sin(psi), np.cos(psi)
    return np.array(
        [
            [cth * cpsi, sphi * sth * cpsi - cphi * spsi, cphi * sth * cpsi + sphi * spsi],
            [cth * spsi, sphi * sth * spsi + cphi * cpsi, cphi * sth * spsi - sphi * cpsi],
            [-sth, sphi * cth, cphi * cth],
        ]
    )


def rates_to_euler(phi: Any, theta: Any) -> Any:
    """I_eb of eq. 4."""
    sphi, cphi = np.sin(phi), np.cos(phi)
    return np.array(
        [
            [1.0, sphi * np.tan(theta), cphi * np.tan(theta)],
            [0.0, cphi, -sphi],
            [0.0, sphi / np.cos(theta), cphi / np.cos(theta)],
        ]
    )


def point_masses(platform: Platform, control: Any) -> list[tuple[Any, Any]]:
    """Mass and position of hull, battery (eq. 5), bladder and reservoir."""
    shift, gamma, m_b, m_m = control[:4]
    position, radius = platform.position, platform.battery_eccentricity
    battery = np.array([position.battery + shift, radius * np.sin(gamma), radius * np.cos(gamma)])
    return [
        (platform.mass.hull, np.array(position.hull)),
        (platform.mass.battery, battery),
        (m_b, np.array(position.bladder)),
        (m_m, np.array(position.reservoir)),
    ]


def first_moment(platform: Platform, control: Any) -> Any:
    """Sum of ``m_i r_i`` (eq. 10)."""
    return sum(mass * r for mass, r in point_masses(platform, control))


def point_inertia(platform: Platform, control: Any) -> Any:
    """J_S of docs/theory/model.md: the inertia tensor of the point masses."""
    return sum(mass * ((r @ r) * np.eye(3) - np.outer(r, r)) for mass, r in point_masses(platform, control))


def inertia(platform: Platform) -> Any:
    """M of eqs. 6-8, its diagonal."""
    rigid = np.array([platform.mass.total] * 3 + list(platform.inertia))
    return rigid + np.array(list(platform.added_mass) + list(platform.added_inertia))


def momenta(platform: Platform, control: Any, V: Any, Omega: Any) -> tuple[Any, Any]:
    """P and Pi of eq. 9; the masses of the sum float, so that the total mass stands for their bare sum."""
    P = np.array(platform.added_mass) * V + platform.mass.total * V
    Pi = np.array(platform.added_inertia) * Omega
    for mass, r in point_masses(platform, control):
        P = P + mass * cross(Omega, r)
        Pi = Pi + mass * cross(r, V + cross(Omega, r))
    return P, Pi


def flow_to_body(alpha: Any, beta: Any) -> Any:
    """R_bf of eq. 14."""
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    return np.array([[ca * cb, -ca * sb, -sa], [sb, cb, 0.0], [sa * cb, -sa * sb, ca]])


def viscous(platform: Platform, V: Any, Omega: Any, rudder: Any = 0.0) -> tuple[Any, Any]:
    """F_v and M_v of eqs. 11-13, with lift offset, rudder and damping floor; at rest nothing but the last."""
    K = platform.viscous
    if not np.any(np.real(V)):
        V = np.zeros(3)
    speed = np.sqrt(V[0] ** 2 + V[1] ** 2 + V[2] ** 2)
    alpha = arctan2(V[2], V[0])
    beta = np.arcsin(V[1] / speed) if np.any(V) else 0.0
    damping = (speed**2 + K.rate_damping_floor**2) * np.array([K.K_p, K.K_q, K.K_r]) * Omega
    force = speed**2 * np.array([-K.K_D0 - K.K_D * alpha**2, K.K_beta * beta, -K.K_L0 - K.K_L * alpha])
    moment = speed**2 * np.array([K.K_MR * beta, K.K_M0 + K.K_M * alpha, K.K_MY * beta + K.K_delta * rudder])
    R = flow_to_body(alpha, beta)
    return R @ force, R @ (moment + damping)


def rhs(platform: Platform, y: Any, control: Any, b: Any) -> Any:
    """Time derivative of the twelve states (eqs. 1, 2, 6, 10, 20)."""
    phi, theta, psi, _, _, Z = y[:6]
    V, Omega = y[6:9], y[9:12]
    rudder = control[4] if len(control) > 4 else 0.0
    R = body_to_earth(phi, theta, psi)
    k = R.T @ np.array([0.0, 0.0, 1.0])
    P, Pi = momenta(platform, control, V, Omega)
    F_v, M_v = viscous(platform, V, Omega, rudder)
    buoyancy = (control[2] + control[3]) * GRAVITY - platform.buoyancy.depth_slope * Z
    F = buoyancy * k + F_v
    M = cross(first_moment(platform, control), GRAVITY * k) + M_v
    push = np.concatenate([cross(P, Omega) + F, cross(Pi, Omega) + cross(P, V) + M])
    accelerations = (push + b) / inertia(platform)
    return np.concatenate([rates_to_euler(phi, theta) @ Omega, R @ V, accelerations])


def rk4_step(platform: Platform, y: Any, control: Any, b: Any, h: float) -> Any:
    """One classical Runge-Kutta step."""
    k1 = rhs(platform, y, control, b)
    k2 = rhs(platform, y + 0.5 * h * k1, control, b)
    k3 = rhs(platform, y + 0.5 * h * k2, control, b)
    k4 = rhs(platform, y + h * k3, control, b)
    return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def trajectory(platform: Platform, y0: Any, controls: Any, b: Any, h: float) -> Any:
    """States (n+1, 12) under controls and disturbances held over each step."""
    states = [np.asarray(y0)]
    for control, disturbance in zip(controls, b, strict=True):
        states.append(rk4_step(platform, states[-1], control, disturbance, h))
    return np.array(states)


def carried_rhs(
    platform: Platform, y: Any, control: Any, b: Any, shear: Callable[[float], Any], gust_slope: Any
) -> tuple[Any, float]:
    """Rates of the state in moving water (docs/theory/model.md) and the speed: ``shear(Z)`` is dU/dZ, north and east.

    ``gust_slope`` is the gust's slope along the path times its direction, north and east.
    """
    R = body_to_earth(*y[:3])
    speed = float(np.linalg.norm(y[6:9]))
    change = (R @ y[6:9])[2] * shear(y[5]) + speed * gust_slope
    in_body = R.T @ np.array([change[0], change[1], 0.0])
    force = -platform.mass.total * in_body
    moment = -cross(first_moment(platform, control), in_body)
    return rhs(platform, y, control, b + np.concatenate([force, moment])), speed


def tracking_cost(
    platform: Platform, y0: Any, controls: Any, b: Any, measurements: Any, h: float, weights: Any = None
) -> Any:
    """Eq. 28 made discrete: h times the sum over samples 1..n, heading differences wrapped."""
    error = trajectory(platform, y0, controls, b, h)[1:, MEASURED] - np.asarray(measurements)[1:]
    error[:, 2] -= 2.0 * np.pi * np.round(np.real(error[:, 2]) / (2.0 * np.pi))
    included = np.ones(len(error)) if weights is None else np.asarray(weights)[1:]
    return h * np.sum(included[:, None] * error**2)


def along(function: Callable[[Any], Any], x: Any, direction: Any) -> Any:
    """Differentiate ``function`` at ``x`` along ``direction``, by the complex step."""
    return np.imag(function(np.asarray(x) + 1j * STEP * np.asarray(direction))) / STEP


def jacobian(function: Callable[[Any], Any], x: Any) -> Any:
    """Matrix of derivatives of a vector function, by the complex step."""
    return np.column_stack([along(function, x, e) for e in np.eye(len(x))])
