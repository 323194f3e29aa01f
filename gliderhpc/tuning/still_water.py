"""The glide that a hull makes in still water at the attitude and ballast that were measured (section 3 without time).

Nothing here looks at how fast the glider sank: what it did beyond this glide, the water did to it or the hull is not as
assumed. That is how vertical water velocities are found from gliders (Merckelbach et al. 2010; Frajka-Williams et al.
2011).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.glide_angle import angle_of_attack
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import drag_and_lift
from gliderhpc.tuning.steady_balance import MeasuredAttitude, SteadyMotion, steady_balance

Array = NDArray[np.float64]

LEAST_SPEED = 0.05
"""Slower than this (m/s) a hull does not glide: it is near neutral, and its balance says nothing."""

ROUNDS = 6
CONVERGED = 1e-7
"""Rounds of the balance, and the change of the depth rate (m/s) in the last of them that ends them."""


@dataclass(frozen=True, eq=False)
class StillWaterGlide:
    """The hull's glide at n samples, NaN where it does not glide so.

    Attributes
    ----------
    depth_rate : (n,)
        Speed downwards, m/s.
    speed : (n,)
        Speed through the water, m/s.
    """

    depth_rate: Array
    speed: Array


def still_water_glide(glider: Glider, bodies: Array, attitude: MeasuredAttitude) -> StillWaterGlide:
    """Find the steady glide at every sample, straight or turning.

    Parameters
    ----------
    glider : Glider
        The hull.
    bodies : (n, 11)
        Mass properties of the controls (`Glider.bodies`).
    attitude : MeasuredAttitude
        What was measured; NaN is missing.

    Notes
    -----
    First the straight glide with wings level: the angle of attack of eq. 15 and the speed at which
    ``V^2 (K_D0 + K_D alpha^2) = -W sin(theta - alpha)``. Then roll and rate of turn come in: the depth rate is brought
    to where `steady_balance`, which takes it as given, has no vertical force left over.
    """
    level = _level_glide(glider, bodies, attitude)
    found = StillWaterGlide(np.full_like(level.depth_rate, np.nan), np.full_like(level.speed, np.nan))
    flying = np.isfinite(level.depth_rate + attitude.roll + attitude.turn_rate) & (level.speed > LEAST_SPEED)
    if flying.any():
        found.depth_rate[flying], found.speed[flying] = _balanced(
            glider, bodies[flying], attitude.of(flying), level.depth_rate[flying]
        )
    return found


def _level_glide(glider: Glider, bodies: Array, attitude: MeasuredAttitude) -> StillWaterGlide:
    """Straight glide with wings level; NaN flatter than the least glide angle, and nose up while heavy."""
    alpha = angle_of_attack(glider.platform, attitude.pitch)
    path = np.sin(attitude.pitch - alpha)
    weight = glider.net_weight(bodies, attitude.depth)
    drag, _ = drag_and_lift(glider.platform, alpha)
    power = -weight * path / drag
    speed = np.sqrt(np.where(power > 0.0, power, np.nan))
    return StillWaterGlide(-speed * path, speed)


def _balanced(glider: Glider, bodies: Array, attitude: MeasuredAttitude, depth_rate: Array) -> tuple[Array, Array]:
    """Depth rate and speed at which nothing is left over; NaN where that is not reached."""
    for _ in range(ROUNDS):
        motion = SteadyMotion(attitude.roll, attitude.pitch, attitude.turn_rate, attitude.depth, depth_rate)
        balance = steady_balance(glider, bodies, motion)
        change = balance.errors[:, 0]
        depth_rate = depth_rate + change
        if np.abs(change).max() < CONVERGED:
            break
    reached = np.abs(change) < CONVERGED
    speed = np.linalg.norm(balance.velocity, axis=1)
    return np.where(reached, depth_rate, np.nan), np.where(reached, speed, np.nan)
