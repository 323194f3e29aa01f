"""The steady glide of a hull in still water, straight or turning, at a measured attitude."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.estimation.steady_balance import VELOCITY, MeasuredAttitude, SteadyFlight, SteadyMotion
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import drag_and_lift

Array = NDArray[np.float64]

MIN_SPEED = 0.05
"""Minimum speed (m/s) of a glide; a slower hull is nearly neutral, and its balance is not informative."""

GLIDE_ROUNDS = 6
GLIDE_CONVERGED = 1e-7
"""Maximum number of rounds of the balance, and the change of the depth rate (m/s) that ends them."""


@dataclass(frozen=True, eq=False)
class StillWaterGlide:
    """The hull's glide at n samples, NaN where there is no such glide.

    Attributes
    ----------
    depth_rate : (n,)
        Speed downwards, m/s.
    velocity : (n, 3)
        Velocity through the water u, v, w, m/s.
    """

    depth_rate: Array
    velocity: Array

    @property
    def speed(self) -> Array:
        """Speed through the water (n,), m/s."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1))


def still_water_glide(
    glider: Glider, bodies: Array, attitude: MeasuredAttitude, near: StillWaterGlide | None = None
) -> StillWaterGlide:
    """Find the steady glide at every sample, straight or turning.

    Parameters
    ----------
    glider : Glider
        The hull.
    bodies : (n, 11)
        Mass properties of the controls (`Glider.bodies`).
    attitude : MeasuredAttitude
        Measured attitude; NaN where missing.
    near : StillWaterGlide, optional
        Glide of a similar hull, from which fewer rounds are needed.

    Notes
    -----
    The first step is the straight glide with wings level: the angle of attack of eq. 15 and the speed at which
    ``V^2 (K_D0 + K_D alpha^2) = -W sin(theta - alpha)``. The second step includes roll and rate of turn: the depth
    rate, an input of `steady_balances`, is adjusted until no vertical force remains.
    """
    start = _level_glide(glider, bodies, attitude)
    found = StillWaterGlide(np.full_like(start.depth_rate, np.nan), np.full_like(start.velocity, np.nan))
    flying = np.isfinite(start.depth_rate + attitude.roll + attitude.turn_rate) & (start.speed > MIN_SPEED)
    if near is not None:
        known = np.isfinite(near.depth_rate)
        start.depth_rate[known], start.velocity[known] = near.depth_rate[known], near.velocity[known]
    if flying.any():
        found.depth_rate[flying], found.velocity[flying] = _balance_depth_rate(
            glider, bodies[flying], attitude.select(flying), start.depth_rate[flying], start.velocity[flying]
        )
    return found


def _level_glide(glider: Glider, bodies: Array, attitude: MeasuredAttitude) -> StillWaterGlide:
    """Straight glide with wings level; NaN on too flat paths, nose up while heavy, or nose down while light."""
    alpha = angle_of_attack(glider.platform, attitude.pitch)
    path = np.sin(attitude.pitch - alpha)
    weight = glider.net_weight(bodies, attitude.depth)
    drag, _ = drag_and_lift(glider.platform, alpha)
    power = -weight * path / drag
    speed = np.sqrt(np.where(power > 0.0, power, np.nan))
    velocity = speed[:, None] * np.column_stack([np.cos(alpha), np.zeros_like(alpha), np.sin(alpha)])
    return StillWaterGlide(-speed * path, velocity)


def _balance_depth_rate(
    glider: Glider, bodies: Array, attitude: MeasuredAttitude, depth_rate: Array, velocity: Array
) -> tuple[Array, Array]:
    """Depth rate and velocity at which no vertical force remains; NaN where the rounds do not converge."""
    for _ in range(GLIDE_ROUNDS):
        motion = SteadyMotion(attitude.roll, attitude.pitch, attitude.turn_rate, attitude.depth, depth_rate)
        flight = SteadyFlight([glider], [bodies], motion, velocity)
        flight.solve_velocity()
        velocity = flight.states[:, VELOCITY]
        change = flight.depth_rate_error()
        depth_rate = depth_rate + change
        if np.abs(change).max() < GLIDE_CONVERGED:
            break
    reached = np.abs(change) < GLIDE_CONVERGED
    return np.where(reached, depth_rate, np.nan), np.where(reached[:, None], velocity, np.nan)
