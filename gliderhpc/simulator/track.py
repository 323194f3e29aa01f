"""Course and track of a profile: the course it steers, its drift with the current, and the fixes around it.

A glider steers from where it surfaced. Here it steers from where it is planned to surface, dead-reckoned with the
nominal glides and each profile's current, so that a profile's course needs no other profile's flight and profiles can
be simulated in any order; planned and true track stay within the scatter of depth and heading. A profile owns half of
the surface interval on either side and drifts with its own surface current all that time.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from geographiclib.geodesic import Geodesic

from gliderhpc.observations.fixes import Position, moved
from gliderhpc.observations.records import Fix, FloatArray
from gliderhpc.simulator.ocean import current_profile
from gliderhpc.simulator.plan import FlightPlan
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import SensorErrors, Surface


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


@dataclass(frozen=True)
class SurfaceTimes:
    """Time at the surface that belongs to a profile, before and after its dive, whole seconds."""

    before: int
    after: int


@dataclass(frozen=True)
class Track:
    """One profile on the Earth.

    Attributes
    ----------
    entry, exit : Position
        True position at the first and the last state of the dive.
    end : Position
        True position at the end of its surface time, where the next profile takes over.
    fixes_before, fixes_after : tuple of Fix
        With their errors, in time order.
    """

    entry: Position
    exit: Position
    end: Position
    fixes_before: tuple[Fix, ...]
    fixes_after: tuple[Fix, ...]


def draw_surface_times(settings: Surface, rng: np.random.Generator) -> SurfaceTimes:
    """Draw the time at the surface on both sides of a dive."""
    before, after = rng.uniform(*settings.half_interval, size=2)
    return SurfaceTimes(math.ceil(before), math.ceil(after))


def lay_track(
    start: Position,
    epoch: np.datetime64,
    duration: float,
    displacement: FloatArray,
    currents: tuple[FloatArray, FloatArray],
    times: SurfaceTimes,
    settings: Surface,
    errors: SensorErrors,
    rng: np.random.Generator,
) -> Track:
    """Lay a profile onto the Earth.

    Parameters
    ----------
    start : Position
        Where its time at the surface begins.
    epoch : numpy.datetime64
        Time of its first sample.
    duration : float
        Of the dive, s.
    displacement : (2,) array
        North and east, over the ground from the first state of the dive to the last, m.
    currents : two (2,) arrays
        North and east, at the surface before and after the dive, m/s.
    times : SurfaceTimes
        Time at the surface before and after.
    settings, errors : Surface, SensorErrors
        When fixes are taken, and how good they are.
    rng : numpy.random.Generator
        Of the fixes' errors.
    """
    before, after = currents
    entry = moved(start, times.before * before)
    leave = moved(entry, displacement)
    delays = settings.fix_delay + settings.fix_spacing * np.arange(settings.fixes)

    def fix(origin: Position, drift: FloatArray, time: float) -> Fix:
        position = moved(moved(origin, drift), errors.fix_deviation * rng.standard_normal(2))
        return Fix(later(epoch, time), *position)

    return Track(
        entry=entry,
        exit=leave,
        end=moved(leave, times.after * after),
        fixes_before=tuple(fix(entry, -delay * before, -delay) for delay in delays[::-1].tolist()),
        fixes_after=tuple(fix(leave, delay * after, duration + delay) for delay in delays.tolist()),
    )


def later(time: np.datetime64, seconds: float) -> np.datetime64:
    """Add seconds to a time, to the nanosecond."""
    return time + np.timedelta64(round(seconds * 1e9), "ns")
