"""Flight plan of a hull in a scenario: trim of dive and climb, turn rate, limits of time and path, and courses."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from geographiclib.geodesic import Geodesic

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import (
    SteadyGlide,
    is_stable,
    least_glide_angle,
    retrimmed,
    stall_depth,
    steady_glide,
)
from gliderhpc.observations.fixes import Position, moved
from gliderhpc.observations.records import FloatArray
from gliderhpc.platform import GRAVITY, Platform
from gliderhpc.simulator.hull import FloatingHull
from gliderhpc.simulator.ocean import current_profile, ocean_column
from gliderhpc.simulator.scenario import Scenario

RELATIVE_NET_MASS = 0.0035
"""Net mass at half the depth, as a fraction of the hull's mass."""

MIN_RELATIVE_NET_MASS = 0.0025
"""Minimum net mass at any depth, as a fraction of the hull's mass."""

SETTLING_TIME = 60.0
"""Time after which a turn is steady (s)."""

PATIENCE = 1.5
"""Time limit of a profile relative to the duration of its steady glides; `GRACE` is added."""

GRACE = 600.0
"""Constant part of the time limit of a profile (s)."""

RESERVE = 1.25
"""Maximum path length of a profile relative to that of its steady glides."""


@dataclass(frozen=True)
class PlannedLeg:
    """Dive or climb.

    Attributes
    ----------
    glide : SteadyGlide
        Steady glide at half the depth; its battery position and ballast apply to the whole leg.
    entry : SteadyGlide
        Steady glide at the depth where the leg begins.
    ballast_volume : float
        Oil in the external bladder, m3.
    turn_rate : float
        Steady rate of the heading under the scenario's battery rotation to starboard, rad/s.
    """

    glide: SteadyGlide
    entry: SteadyGlide
    ballast_volume: float
    turn_rate: float


@dataclass(frozen=True)
class FlightPlan:
    """Flight plan of a profile.

    Attributes
    ----------
    dive, climb : Leg
        Trim of dive and climb.
    nominal_duration, nominal_range, nominal_path : float
        Duration (s), horizontal distance and path length (m) of the two steady glides.
    """

    dive: PlannedLeg
    climb: PlannedLeg
    nominal_duration: float
    nominal_range: float
    nominal_path: float

    @property
    def time_limit(self) -> float:
        """Time after which a profile is given up, s."""
        return PATIENCE * self.nominal_duration + GRACE

    @property
    def longest_path(self) -> float:
        """Path length through the water for which gusts are drawn, m; the last one acts beyond it."""
        return RESERVE * self.nominal_path


def plan_flight(glider: Glider, scenario: Scenario) -> FlightPlan:
    """Trim a hull for a scenario.

    Raises
    ------
    InputError
        The hull stalls above the depth, cannot glide at that pitch, or does not glide stably.
    """
    floating = floating_hull(glider.platform, scenario)
    if floating is not None:
        glider = Glider(_with_slope_of(floating, glider.platform, scenario))
    dive_mass, climb_mass = net_masses(glider.platform, scenario)
    dive = _leg(glider, scenario, dive_mass, scenario.start_depth, floating)
    climb = _leg(glider, scenario, climb_mass, scenario.depth, floating)
    glides = (dive.glide, climb.glide)
    return FlightPlan(
        dive,
        climb,
        nominal_duration=sum(scenario.depth / abs(glide.depth_rate) for glide in glides),
        nominal_range=sum(scenario.depth / abs(math.tan(glide.glide_angle)) for glide in glides),
        nominal_path=sum(scenario.depth / abs(math.sin(glide.glide_angle)) for glide in glides),
    )


def floating_hull(platform: Platform, scenario: Scenario) -> FloatingHull | None:
    """Return the net mass of a hull in the scenario's ocean; None if the scenario has no ocean."""
    if scenario.ocean is None:
        return None
    return FloatingHull(platform, ocean_column(scenario.ocean, scenario.origin, scenario.depth + scenario.depth_spread))


def _with_slope_of(floating: FloatingHull, platform: Platform, scenario: Scenario) -> Platform:
    """Hull for planning, with the mean depth slope between the surface and the turning point."""
    half = 0.5 * scenario.depth
    slope = floating.depth_slope(half, platform.buoyancy.neutral_volume_m3, half)
    return platform.model_copy(update={"buoyancy": platform.buoyancy.model_copy(update={"depth_slope": slope})})


def net_masses(platform: Platform, scenario: Scenario) -> tuple[float, float]:
    """Net masses of dive and climb at the surface, kg: from the scenario, or chosen for the hull (see `Actuation`)."""
    usual, least = RELATIVE_NET_MASS * platform.mass.total, MIN_RELATIVE_NET_MASS * platform.mass.total
    gain = platform.buoyancy.depth_slope * scenario.depth / GRAVITY
    dive, climb = scenario.actuation.dive_net_mass, scenario.actuation.climb_net_mass
    if dive is None:
        dive = max(usual + 0.5 * gain, least + max(gain, 0.0))
    if climb is None:
        climb = -max(usual - 0.5 * gain, least - min(gain, 0.0))
    return dive, climb


def _leg(
    glider: Glider, scenario: Scenario, net_mass: float, entry_depth: float, floating: FloatingHull | None
) -> PlannedLeg:
    platform = glider.platform
    pitch = -math.copysign(math.radians(scenario.actuation.pitch), net_mass)
    _refuse_stall(platform, scenario, net_mass)
    glide = steady_glide(glider, net_mass, pitch, 0.5 * scenario.depth)
    entry = steady_glide(glider, net_mass, pitch, entry_depth)
    flown = f"at a pitch of {math.degrees(pitch):+.1f} degree and {net_mass:+.3f} kg"
    if glide is None or entry is None:
        least = math.degrees(least_glide_angle(platform, heavy=net_mass > 0.0))
        raise InputError(
            f"{platform.name} has no steady glide {flown}; "
            f"its minimum glide angle is {least:.1f} degree; give the scenario a steeper actuation.pitch"
        )
    if not is_stable(glider, glide):
        raise InputError(
            f"{platform.name} does not glide stably {flown}; "
            "correct the hull (see `gliderhpc platforms`) or choose another actuation.pitch"
        )
    buoyancy = platform.buoyancy
    turn_rate = _turn_rate(glider, glide, math.radians(scenario.steering.rotation))
    if floating is None:
        return PlannedLeg(glide, entry, buoyancy.neutral_volume_m3 - net_mass / buoyancy.water_density, turn_rate)
    volume = floating.oil_volume(net_mass)
    return PlannedLeg(retrimmed(glider, glide, volume), retrimmed(glider, entry, volume), volume, turn_rate)


def _refuse_stall(platform: Platform, scenario: Scenario, net_mass: float) -> None:
    stall = stall_depth(platform, net_mass)
    if stall <= scenario.depth:
        leg = "dive" if net_mass > 0.0 else "climb"
        raise InputError(
            f"{platform.name} stalls at {stall:.0f} m with {net_mass:+.3f} kg and cannot reach {scenario.depth:g} m; "
            f"choose a smaller depth or give actuation.{leg}_net_mass a larger magnitude"
        )


def _turn_rate(glider: Glider, glide: SteadyGlide, rotation: float) -> float:
    """Rate of the heading in a steady turn (rad/s); its sign may differ between dive and climb."""
    step = 0.1
    count = round(SETTLING_TIME / step)
    controls = np.tile(glide.control, (count, 1))
    controls[:, 1] = rotation
    heading = glider.simulate(glide.state, controls, np.zeros((count, 6)), step)[:, 2]
    tail = count // 4
    return float((heading[-1] - heading[-1 - tail]) / (tail * step))


def courses(scenario: Scenario, plan: FlightPlan, seed: int, count: int) -> list[float]:
    """Return the courses of the first `count` profiles, degree."""
    steering = scenario.steering
    if not steering.waypoints:
        return [steering.courses[index % len(steering.courses)] for index in range(count)]
    return list(islice(_bearings(scenario, plan, seed), count))


def _bearings(scenario: Scenario, plan: FlightPlan, seed: int) -> Iterator[float]:
    waypoints, reach = scenario.steering.waypoints, scenario.steering.reach
    position: Position = scenario.origin
    target, number = 0, 1
    while True:
        if _distance(position, waypoints[target]) < reach:
            target = (target + 1) % len(waypoints)
        course: float = Geodesic.WGS84.Inverse(*position, *waypoints[target])["azi1"] % 360.0
        yield course
        position = moved(position, _planned_displacement(scenario, plan, seed, number, math.radians(course)))
        number += 1


def _planned_displacement(scenario: Scenario, plan: FlightPlan, seed: int, number: int, course: float) -> FloatArray:
    """Planned displacement ``[north, east]`` of one profile, m."""
    current = current_profile(scenario.current, seed, number, depth=scenario.depth, duration=plan.nominal_duration)
    depths = np.linspace(0.0, scenario.depth, 33)
    drift = plan.nominal_duration * current.at(depths, 0.5 * plan.nominal_duration).mean(axis=0)
    drift += sum(scenario.surface.half_interval) * current.at(np.zeros(1), 0.0)[0]
    displacement: FloatArray = drift + plan.nominal_range * np.array([math.cos(course), math.sin(course)])
    return displacement


def _distance(one: Position, other: Position) -> float:
    return float(Geodesic.WGS84.Inverse(*one, *other)["s12"])
