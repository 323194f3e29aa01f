"""Which course every profile steers: courses in turn, or the bearings to waypoints along the planned track.

A glider steers from where it surfaced. Here it steers from where it is planned to surface, dead-reckoned with the
nominal glides and each profile's current, so that a profile's course needs no other profile's flight and profiles can
be simulated in any order; planned and true track stay within the scatter of depth and heading.
"""

import math
from collections.abc import Iterator
from itertools import islice

import numpy as np
from geographiclib.geodesic import Geodesic

from gliderhpc.observations.geodesic import Position, moved
from gliderhpc.observations.records import FloatArray
from gliderhpc.simulator.plan import FlightPlan
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.shear import current_profile


def courses(scenario: Scenario, plan: FlightPlan, seed: int, count: int) -> list[float]:
    """Give the courses of the first `count` profiles, degree."""
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
    """Displacement ``[north, east]`` of one profile as planned, m."""
    current = current_profile(scenario.current, seed, number, depth=scenario.depth, duration=plan.nominal_duration)
    depths = np.linspace(0.0, scenario.depth, 33)
    drift = plan.nominal_duration * current.at(depths, 0.5 * plan.nominal_duration).mean(axis=0)
    drift += sum(scenario.surface.half_interval) * current.at(np.zeros(1), 0.0)[0]
    displacement: FloatArray = drift + plan.nominal_range * np.array([math.cos(course), math.sin(course)])
    return displacement


def _distance(one: Position, other: Position) -> float:
    return float(Geodesic.WGS84.Inverse(*one, *other)["s12"])
