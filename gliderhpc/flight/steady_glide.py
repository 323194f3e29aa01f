"""Steady glides of a hull: the balance of forces and moments, its stability, and the flattest possible glide.

In the vertical plane without rotation, eqs. 6, 10 and 11 reduce to, along and across the path,

    ``-W sin(xi) = V^2 (K_D0 + K_D alpha^2)``  and  ``W cos(xi) = V^2 (K_L0 + K_L alpha)``,

with the net weight in water ``W = m_x g - k_z Z`` and the path's angle ``xi = theta - alpha`` (negative when diving).
Their ratio gives the angle of attack, either of them gives the speed, and the balance of pitch moments gives the
battery position.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from gliderhpc.platform import GRAVITY, Platform, ballast_masses


class FlightModel(Protocol):
    """Flight model of a platform; thanks to this protocol, listing hulls does not import `gliderhpc.flight.glider`."""

    @property
    def platform(self) -> Platform:
        """The platform."""

    def bodies(self, controls: ArrayLike) -> NDArray[np.float64]:
        """Mass properties ``(n, 11)`` of controls ``(n, 4)``."""

    def jacobian(self, state: ArrayLike, control: ArrayLike) -> NDArray[np.float64]:
        """Jacobian ``(12, 12)`` of the right-hand side."""


LARGEST_ANGLE_OF_ATTACK = math.radians(25.0)
"""Largest angle of attack considered; the lift of eq. 11 is linear and has no stall."""

SCAN_POINTS = 501

MOVING = np.array([0, 1, 6, 7, 8, 9, 10, 11])
"""States that determine stability: phi, theta and the velocities; psi, X and Y are neutral, Z changes in any glide."""

RELATIVE_NET_MASSES = (0.002, 0.0035, 0.005)
"""Net masses that :func:`glides_stably` tries, as fractions of the hull's mass."""

PITCHES = tuple(math.radians(angle) for angle in (20.0, 25.0, 30.0, 35.0))
"""Pitch angles that :func:`glides_stably` tries, rad."""


@dataclass(frozen=True)
class SteadyGlide:
    """One steady glide in the vertical plane.

    Attributes
    ----------
    net_mass : float
        Net mass in water at the surface m_x, kg, positive when diving.
    depth : float
        Depth at which the forces balance, m.
    pitch, angle_of_attack : float
        Pitch theta and angle of attack alpha, rad.
    speed : float
        Speed through the water, m/s.
    battery_position : float
        Translation of the battery r_px that balances the pitch moment, m.
    ballast : tuple of float
        Oil masses outside and inside the hull m_b, m_m, kg.
    """

    net_mass: float
    depth: float
    pitch: float
    angle_of_attack: float
    speed: float
    battery_position: float
    ballast: tuple[float, float]

    @property
    def glide_angle(self) -> float:
        """Angle of the path xi, rad, negative when diving."""
        return self.pitch - self.angle_of_attack

    @property
    def depth_rate(self) -> float:
        """Speed downwards, m/s."""
        return -self.speed * math.sin(self.glide_angle)

    @property
    def control(self) -> NDArray[np.float64]:
        """Control ``[r_px, gamma, m_b, m_m]``, shape (4,)."""
        return np.array([self.battery_position, 0.0, *self.ballast])

    @property
    def state(self) -> NDArray[np.float64]:
        """State of eq. 16, shape (12,), heading north."""
        state = np.zeros(12)
        state[1], state[5] = self.pitch, self.depth
        state[6] = self.speed * math.cos(self.angle_of_attack)
        state[8] = self.speed * math.sin(self.angle_of_attack)
        return state


def steady_glide(glider: FlightModel, net_mass: float, pitch: float, depth: float = 0.0) -> SteadyGlide | None:
    """Find the steady glide of a net mass and a pitch.

    Parameters
    ----------
    glider : FlightModel
        The hull.
    net_mass : float
        Net mass at the surface m_x, kg, positive heavy.
    pitch : float
        Pitch theta, rad, negative nose down.
    depth : float
        Depth Z at which to balance, m; the hull gains ``k_z Z`` of buoyancy there.

    Returns
    -------
    SteadyGlide or None
        The glide, or None if the hull has none: nose up while heavy, a path flatter than its minimum glide angle, or a
        net weight that vanishes at this depth.
    """
    platform = glider.platform
    weight = net_mass * GRAVITY - platform.buoyancy.depth_slope * depth
    alpha = steady_angle_of_attack(platform, pitch, heavy=weight > 0.0) if weight else None
    if alpha is None:
        return None
    drag, _ = drag_and_lift(platform, alpha)
    speed = math.sqrt(-weight * math.sin(pitch - alpha) / drag)
    ballast = _ballast(platform, net_mass)
    position = _battery_position(glider, ballast, pitch, alpha, speed)
    return SteadyGlide(net_mass, depth, pitch, alpha, speed, position, ballast)


def retrimmed(glider: FlightModel, glide: SteadyGlide, oil_volume: float) -> SteadyGlide:
    """Return a steady glide flown with another oil volume (m3), as needed in water of another density."""
    m_b, m_m = ballast_masses(glider.platform, oil_volume)
    ballast = float(m_b), float(m_m)
    position = _battery_position(glider, ballast, glide.pitch, glide.angle_of_attack, glide.speed)
    return replace(glide, ballast=ballast, battery_position=position)


def steady_angle_of_attack(platform: Platform, pitch: float, *, heavy: bool) -> float | None:
    """Return the angle of attack of the steady glide at a pitch, at any speed; None if there is no such glide.

    Parameters
    ----------
    platform : Platform
        The hull.
    pitch : float
        Pitch theta, rad.
    heavy : bool
        Whether the net weight points down.

    Notes
    -----
    A path steeper than the minimum glide angle can be flown at two angles of attack. The one nearer to zero lift is
    returned. The other lies on the back side of the drag curve; a pitch that has only such a root is treated as having
    none.
    """
    scan = np.linspace(zero_lift_angle(platform), best_angle_of_attack(platform, heavy=heavy), SCAN_POINTS)
    found = imbalance(platform, pitch, scan) <= 0.0
    if not found.any() or found[0]:
        return None
    first = int(np.argmax(found))
    alpha = float(
        scipy.optimize.brentq(
            lambda alpha: float(imbalance(platform, pitch, alpha)), scan[first - 1], scan[first], xtol=1e-14
        )
    )
    direction = 1.0 if heavy else -1.0
    return alpha if direction * math.sin(pitch - alpha) < 0.0 else None


def imbalance(platform: Platform, pitch: ArrayLike, angle_of_attack: ArrayLike) -> NDArray[np.float64]:
    """Return the horizontal force of drag and lift over the squared speed, kg/m; zero in a steady glide.

    It is ``D cos(xi) + L sin(xi)``.

    Parameters
    ----------
    platform : Platform
        The hull.
    pitch, angle_of_attack : array
        Pitch theta and angle of attack alpha, rad, of shapes that broadcast; ``xi = theta - alpha``.
    """
    drag, lift = drag_and_lift(platform, angle_of_attack)
    xi = np.subtract(pitch, angle_of_attack)
    return np.asarray(drag * np.cos(xi) + lift * np.sin(xi))


def imbalance_slope(platform: Platform, pitch: ArrayLike, angle_of_attack: ArrayLike) -> NDArray[np.float64]:
    """Return the derivative of `imbalance` with respect to the angle of attack, kg/(m rad)."""
    viscous = platform.viscous
    drag, lift = drag_and_lift(platform, angle_of_attack)
    xi = np.subtract(pitch, angle_of_attack)
    turned = 2.0 * viscous.K_D * np.asarray(angle_of_attack) - lift
    return np.asarray(turned * np.cos(xi) + (drag + viscous.K_L) * np.sin(xi))


def zero_lift_angle(platform: Platform) -> float:
    """Return the angle of attack of zero lift, rad."""
    return -platform.viscous.K_L0 / platform.viscous.K_L


def growth_rate(glider: FlightModel, glide: SteadyGlide) -> float:
    """Return the largest real part of the eigenvalues of the motion about a steady glide, 1/s; negative if stable."""
    jacobian = glider.jacobian(glide.state, glide.control)[np.ix_(MOVING, MOVING)]
    return float(np.linalg.eigvals(jacobian).real.max())


def is_stable(glider: FlightModel, glide: SteadyGlide) -> bool:
    """Return whether small perturbations of a steady glide decay."""
    return growth_rate(glider, glide) < 0.0


def glide_table(
    glider: FlightModel, net_masses: Iterable[float], pitches: Iterable[float], depth: float = 0.0
) -> list[SteadyGlide]:
    """Return the steady glides over net mass and pitch, dives first; combinations without a steady glide are omitted.

    Parameters
    ----------
    glider : FlightModel
        The hull.
    net_masses : iterable of float
        Magnitudes of the net mass, kg.
    pitches : iterable of float
        Magnitudes of the pitch, rad.
    depth : float
        Depth at which the forces balance, m.
    """
    return list(_glides(glider, tuple(net_masses), tuple(pitches), depth))


def glides_stably(glider: FlightModel) -> bool:
    """Return whether a hull has a stable steady dive and climb at usual net masses and pitches."""
    masses = tuple(part * glider.platform.mass.total for part in RELATIVE_NET_MASSES)
    stable = {glide.net_mass > 0.0 for glide in glide_table(glider, masses, PITCHES) if is_stable(glider, glide)}
    return stable == {True, False}


def stall_depth(platform: Platform, net_mass: float) -> float:
    """Return the depth at which the gain in buoyancy cancels a net mass, m; infinite if it never does."""
    slope = platform.buoyancy.depth_slope
    if slope * net_mass <= 0.0:
        return math.inf
    return net_mass * GRAVITY / slope


def best_angle_of_attack(platform: Platform, *, heavy: bool) -> float:
    """Return the angle of attack at minimum drag-to-lift ratio, rad, within the range of eq. 11.

    Notes
    -----
    ``(K_D0 + K_D alpha^2) / (K_L0 + K_L alpha)`` is least at ``K_D (alpha^2 + 2 alpha K_L0 / K_L) = K_D0``.
    """
    viscous = platform.viscous
    without_lift = zero_lift_angle(platform)
    reach = math.sqrt(without_lift**2 + viscous.K_D0 / viscous.K_D) if viscous.K_D else math.inf
    reach = min(reach, LARGEST_ANGLE_OF_ATTACK)
    return without_lift + (reach if heavy else -reach)


def least_glide_angle(platform: Platform, *, heavy: bool = True) -> float:
    """Return the angle of the flattest steady path, rad: the arc tangent at minimum drag-to-lift ratio."""
    drag, lift = drag_and_lift(platform, best_angle_of_attack(platform, heavy=heavy))
    return math.atan(drag / abs(lift))


def munk_moment(platform: Platform) -> float:
    """Return Munk's yaw moment over ``u v``, kg: ``M_f1 - M_f2``."""
    return platform.added_mass[0] - platform.added_mass[1]


def yaw_bracket(platform: Platform, angle_of_attack: float) -> float:
    """Return the sum of the viscous and Munk yaw moments, which oppose each other, kg (docs/theory/currents.md).

    ``K_MY + K_MR sin(alpha) + M_f1 - M_f2``: the gain from sideslip, and hence from a current, to the yaw moment.
    """
    viscous = platform.viscous
    return viscous.K_MY + viscous.K_MR * math.sin(angle_of_attack) + munk_moment(platform)


def sign_in_doubt(platform: Platform, angle_of_attack: float, spread: float = 0.15, draws: int = 20_000) -> float:
    """Return the fraction of coefficient draws in which :func:`yaw_bracket` has the opposite sign.

    The four coefficients are drawn uniformly and independently within a relative `spread`, from a fixed seed. If the
    fraction is near one half, the hull's yaw moment cannot determine a current's direction.
    """
    viscous = platform.viscous
    terms = np.array(
        [
            viscous.K_MY,
            viscous.K_MR * math.sin(angle_of_attack),
            platform.added_mass[0],
            -platform.added_mass[1],
        ]
    )
    factors = np.random.default_rng(0).uniform(1.0 - spread, 1.0 + spread, (draws, terms.size))
    return float(np.mean((factors @ terms) * terms.sum() <= 0.0))


def glide_coefficients(platform: Platform) -> tuple[float, float, float, float]:
    """Return K_D0, K_D, K_L0 and K_L, which alone give a steady glide its angle of attack at a pitch."""
    viscous = platform.viscous
    return viscous.K_D0, viscous.K_D, viscous.K_L0, viscous.K_L


def drag_and_lift(platform: Platform, angle_of_attack: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return drag and lift over the squared speed without sideslip (eq. 11), kg/m."""
    drag, induced, without_angle, lift = glide_coefficients(platform)
    alpha = np.asarray(angle_of_attack, dtype=np.float64)
    return drag + induced * alpha**2, without_angle + lift * alpha


def _glides(
    glider: FlightModel, net_masses: tuple[float, ...], pitches: tuple[float, ...], depth: float
) -> Iterator[SteadyGlide]:
    for direction in (1.0, -1.0):
        for net_mass in net_masses:
            for pitch in pitches:
                glide = steady_glide(glider, direction * net_mass, -direction * pitch, depth)
                if glide is not None:
                    yield glide


def _ballast(platform: Platform, net_mass: float) -> tuple[float, float]:
    volume = platform.buoyancy.neutral_volume_m3 - net_mass / platform.buoyancy.water_density
    m_b, m_m = ballast_masses(platform, volume)
    return float(m_b), float(m_m)


def _battery_position(
    glider: FlightModel, ballast: tuple[float, float], pitch: float, alpha: float, speed: float
) -> float:
    """Solve ``-g (S_x cos(theta) + S_z sin(theta)) + (M_f3 - M_f1) u w + V^2 (K_M0 + K_M alpha) = 0`` for ``S_x``."""
    platform = glider.platform
    viscous, added = platform.viscous, platform.added_mass
    munk = (added[2] - added[0]) * math.sin(alpha) * math.cos(alpha)
    moment = speed**2 * (munk + viscous.K_M0 + viscous.K_M * alpha)
    s_x, _, s_z = glider.bodies([[0.0, 0.0, *ballast]])[0, :3]
    wanted = (moment / GRAVITY - s_z * math.sin(pitch)) / math.cos(pitch)
    return float((wanted - s_x) / platform.mass.battery)
