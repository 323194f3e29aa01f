"""Right-hand side for every peer, written from the equations, independently of the kernels.

A peer gives its own sine, cosine, arctangent and square root; numbers, CasADi symbols and JAX tracers all pass. The
hull's constants are plain numbers, so that a compiler folds them. A hull at rest (eq. 13 is singular there) is left to
the project's kernels: no window of a dive holds one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from gliderhpc.kernels.mass import GRAVITY
from gliderhpc.kernels.parameters import Body, Hull


@dataclass(frozen=True)
class Functions:
    """Elementary functions of a peer."""

    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    arctan2: Callable[[Any, Any], Any]
    sqrt: Callable[[Any], Any]


def rates(f: Functions, hull: Hull, body: Body, y: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    """Time derivatives of ``[phi, theta, psi, Z, u, v, w, p, q, r]`` under disturbance `b` (eqs. 1-14, 20)."""
    phi, theta, _, Z, u, v, w, p, q, r = y
    sp, cp, st, ct = f.sin(phi), f.cos(phi), f.sin(theta), f.cos(theta)
    k = (-st, sp * ct, cp * ct)
    V, Omega = (u, v, w), (p, q, r)
    S = (body.Sx, body.Sy, body.Sz)
    force, moment = _viscous(f, hull, body.rudder, V, Omega)
    P = _sum((hull.mass_u * u, hull.mass_v * v, hull.mass_w * w), _cross(Omega, S))
    Pi = _sum(_inertia(hull, body, Omega), _cross(S, V))
    buoyancy = body.net_weight - hull.depth_slope * Z
    F = _sum(_cross(P, Omega), force, tuple(buoyancy * part for part in k), b[:3])
    T = _sum(_cross(Pi, Omega), _cross(P, V), _cross(S, tuple(GRAVITY * part for part in k)), moment, b[3:])
    turn = sp * q + cp * r
    return [
        p + st / ct * turn,
        cp * q - sp * r,
        turn / ct,
        k[0] * u + k[1] * v + k[2] * w,
        F[0] / hull.mass_u,
        F[1] / hull.mass_v,
        F[2] / hull.mass_w,
        T[0] / hull.inertia_p,
        T[1] / hull.inertia_q,
        T[2] / hull.inertia_r,
    ]


def rk4(f: Functions, hull: Hull, body: Body, y: Sequence[Any], b: Sequence[Any], h: float) -> list[Any]:
    """One classical Runge-Kutta step of `rates`, the disturbance constant over it."""
    k1 = rates(f, hull, body, y, b)
    k2 = rates(f, hull, body, _shifted(y, 0.5 * h, k1), b)
    k3 = rates(f, hull, body, _shifted(y, 0.5 * h, k2), b)
    k4 = rates(f, hull, body, _shifted(y, h, k3), b)
    return [
        value + h / 6.0 * (first + 2.0 * (second + third) + fourth)
        for value, first, second, third, fourth in zip(y, k1, k2, k3, k4, strict=True)
    ]


def _viscous(f: Functions, hull: Hull, rudder: Any, V: Sequence[Any], Omega: Sequence[Any]) -> tuple[Any, Any]:
    """Viscous force and moment in the body frame (eqs. 11-14)."""
    u, v, w = V
    p, q, r = Omega
    U2 = u * u + w * w
    V2 = U2 + v * v
    W2 = V2 + hull.rate_floor2
    U, speed = f.sqrt(U2), f.sqrt(V2)
    alpha, beta = f.arctan2(w, u), f.arctan2(v, U)
    rotation = (u / U, w / U, U / speed, v / speed)
    force = (
        -V2 * (hull.K_D0 + hull.K_D * alpha * alpha),
        V2 * hull.K_beta * beta,
        -V2 * (hull.K_L0 + hull.K_L * alpha),
    )
    moment = (
        V2 * hull.K_MR * beta + W2 * hull.K_p * p,
        V2 * (hull.K_M0 + hull.K_M * alpha) + W2 * hull.K_q * q,
        V2 * (hull.K_MY * beta + hull.K_delta * rudder) + W2 * hull.K_r * r,
    )
    return _to_body(rotation, force), _to_body(rotation, moment)


def _to_body(rotation: Sequence[Any], a: Sequence[Any]) -> tuple[Any, Any, Any]:
    ca, sa, cb, sb = rotation
    planar = cb * a[0] - sb * a[1]
    return ca * planar - sa * a[2], sb * a[0] + cb * a[1], sa * planar + ca * a[2]


def _inertia(hull: Hull, body: Body, Omega: Sequence[Any]) -> tuple[Any, Any, Any]:
    """Angular momentum ``(I_f + J_S) Omega`` of eq. 9."""
    p, q, r = Omega
    return (
        (hull.added_p + body.Jxx) * p + body.Jxy * q + body.Jxz * r,
        body.Jxy * p + (hull.added_q + body.Jyy) * q + body.Jyz * r,
        body.Jxz * p + body.Jyz * q + (hull.added_r + body.Jzz) * r,
    )


def _cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, Any, Any]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _sum(*vectors: Sequence[Any]) -> tuple[Any, Any, Any]:
    return sum(v[0] for v in vectors), sum(v[1] for v in vectors), sum(v[2] for v in vectors)


def _shifted(y: Sequence[Any], a: float, k: Sequence[Any]) -> list[Any]:
    return [value + a * slope for value, slope in zip(y, k, strict=True)]
