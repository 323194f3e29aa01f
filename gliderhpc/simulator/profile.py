"""Simulation of one synthetic profile: its record and its truth."""

import math
from dataclasses import dataclass, replace

import numpy as np

from gliderhpc.flight.glider import Glider
from gliderhpc.observations.fixes import Position, moved
from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.seeds import Stream, generator
from gliderhpc.simulator.disturbance import Disturbance, Impulse, draw_disturbance
from gliderhpc.simulator.dive import Flight, fly
from gliderhpc.simulator.hull import TrueHull, true_hull
from gliderhpc.simulator.ocean import ocean_column
from gliderhpc.simulator.plan import courses, plan_flight
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Ocean
from gliderhpc.simulator.sensors import (
    actuators_at,
    carried_at,
    measured_velocity,
    observe,
    states_at,
    with_faults,
)
from gliderhpc.simulator.water import WaterMotion, draw_water

LEVEL_SPACING = 10.0
"""Spacing of the depths at which the true current profile is written (m)."""


@dataclass(frozen=True, eq=False)
class ProfileTruth:
    """Truth of one synthetic profile.

    Attributes
    ----------
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of its first sample (ns, UTC).
    duration : float
        Duration of the dive, s.
    step : float
        Interval over which `disturbances` are averaged, s.
    disturbances : (n, 6) array
        ``B_cu`` ... ``B_cr`` averaged over each step from the epoch on, N and N m: the sum of the additive disturbances
        and of those exerted by changes of the water's velocity.
    time : (m,) array
        Times of the samples, s from the epoch.
    states : (m, 12) array
        State of eq. 16 at the samples: attitude (rad, heading unwrapped), X, Y (m, through the water from the start of
        the profile), depth, velocity through the water and rates (SI).
    actuators : (m, 3) array
        Actual battery position (m), battery rotation (rad) and ballast volume (m3) at the samples.
    water : (m, 3) array
        Current north and east without the gust, and the gust to starboard of the course, at the glider's position, m/s.
    water_up : (m,) array
        Vertical velocity of the water at the samples, upward, m/s.
    levels : (k,) array
        Depths of the current profile, the same for every profile of a mission, m.
    shear : (k, 2) array
        Current north and east at these depths halfway through the dive, m/s.
    current : (2,) array
        Velocity of the water, north and east, averaged over the dive, m/s.
    surface_currents : two (2,) arrays
        Currents at the surface before and after the dive, m/s.
    displacement : (2,) array
        Displacement through the water over the whole dive, north and east, m.
    course : float
        Steered course, rad.
    coefficients : dict of str to tuple
        True coefficients on dive and climb, by the paper's symbol.
    net_mass : float
        Unrecorded net mass, kg.
    impulses : tuple of Impulse
        Impulses that peak within the dive.
    entry, exit : Position
        True latitude and longitude at the start and at the end of the dive, degree.
    surface_until : numpy.datetime64
        End of the time at the surface that belongs to this profile.
    end : Position
        True latitude and longitude at that time, degree.
    """

    number: int
    epoch: np.datetime64
    duration: float
    step: float
    disturbances: FloatArray
    time: FloatArray
    states: FloatArray
    actuators: FloatArray
    water: FloatArray
    water_up: FloatArray
    levels: FloatArray
    shear: FloatArray
    current: FloatArray
    surface_currents: tuple[FloatArray, FloatArray]
    displacement: FloatArray
    course: float
    coefficients: dict[str, tuple[float, float]]
    net_mass: float
    impulses: tuple[Impulse, ...]
    entry: Position
    exit: Position
    surface_until: np.datetime64
    end: Position


def simulate_profile(
    platform: Platform, scenario: Scenario, seed: int, *, number: int = 1
) -> tuple[ProfileRecord, ProfileTruth]:
    """Simulate one profile from the start of the scenario.

    Parameters
    ----------
    platform : Platform
        The hull.
    scenario : Scenario
        The scenario.
    seed : int
        Seed of all random numbers.
    number : int
        Number of the profile; its random numbers are the same as in a whole mission.

    Returns
    -------
    record : ProfileRecord
        Record as returned by :meth:`gliderhpc.observations.Observations.profile`.
    truth : ProfileTruth
        Truth of the profile.

    Raises
    ------
    InputError
        The hull cannot fly the scenario.
    """
    glider = Glider(platform)
    course = courses(scenario, plan_flight(glider, scenario), seed, number)[-1]
    record, truth = fly_profile(glider, scenario, seed, number, course)
    return place_profile(record, truth, scenario, seed, np.datetime64(scenario.start, "ns"), scenario.origin)


def fly_profile(
    glider: Glider, scenario: Scenario, seed: int, number: int, course: float
) -> tuple[ProfileRecord, ProfileTruth]:
    """Simulate the profile `number` on a `course` (degree), without its time and place (see `place_profile`)."""
    levels = level_depths(scenario)
    scenario = scenario.model_copy(update={"depth": _depth(scenario, seed, number)})
    plan = plan_flight(glider, scenario)
    hull = true_hull(glider.platform, scenario, seed, number)
    water = draw_water(scenario, plan, seed, number, math.radians(course), down_to=levels[-1])
    disturbance = draw_disturbance(scenario.disturbances, plan.time_limit, generator(seed, number, Stream.DISTURBANCE))
    flight = fly(
        glider,
        hull,
        plan,
        scenario,
        disturbance,
        water,
        heading=_first_heading(scenario, seed, number, course),
        course=math.radians(course),
    )
    record = _recorded(flight, glider, scenario, seed, number)
    truth = _truth(
        record, flight, scenario, hull=hull, disturbance=disturbance, water=water, levels=levels,
        course=math.radians(course),
    )  # fmt: skip
    return record, truth


def place_profile(
    record: ProfileRecord, truth: ProfileTruth, scenario: Scenario, seed: int, start: np.datetime64, position: Position
) -> tuple[ProfileRecord, ProfileTruth]:
    """Give a flown profile its time and place in a mission: its surface interval begins at `start` and `position`.

    Before and after the dive the glider drifts with the surface current for whole seconds, and fixes are taken.
    """
    settings, rng = scenario.surface, generator(seed, record.number, Stream.SURFACE)
    wait_before, wait_after = (math.ceil(wait) for wait in rng.uniform(*settings.half_interval, size=2))
    (before, after), duration = truth.surface_currents, truth.duration
    epoch = _later(start, wait_before)
    entry = moved(position, wait_before * before)
    leave = moved(entry, truth.displacement + duration * truth.current)
    delays = (settings.fix_delay + settings.fix_spacing * np.arange(settings.fixes)).tolist()

    def fix(origin: Position, drift: FloatArray, time: float) -> Fix:
        place = moved(moved(origin, drift), scenario.sensors.fix_deviation * rng.standard_normal(2))
        return Fix(_later(epoch, time), *place)

    fixes_before = tuple(fix(entry, -delay * before, -delay) for delay in reversed(delays))
    fixes_after = tuple(fix(leave, delay * after, duration + delay) for delay in delays)
    record = replace(
        record,
        epoch=epoch,
        entry_fix=fixes_before[-1],
        exit_fix=fixes_after[0],
        surface_fixes_before=fixes_before,
        surface_fixes_after=fixes_after,
    )
    return record, replace(
        truth,
        epoch=epoch,
        entry=entry,
        exit=leave,
        surface_until=_later(epoch, duration + wait_after),
        end=moved(leave, wait_after * after),
    )


def _later(time: np.datetime64, seconds: float) -> np.datetime64:
    """Add seconds to a time, rounded to a nanosecond."""
    return time + np.timedelta64(round(seconds * 1e9), "ns")


def _depth(scenario: Scenario, seed: int, number: int) -> float:
    """Depth of the turning point of the profile `number`, m."""
    if scenario.depth_spread == 0.0:
        return scenario.depth
    rng = generator(seed, number, Stream.DEPTH)
    return scenario.depth + scenario.depth_spread * float(rng.uniform(-1.0, 1.0))


def _first_heading(scenario: Scenario, seed: int, number: int, course: float) -> float:
    """Heading at the start, rad."""
    largest = scenario.steering.initial_error
    return math.radians(course + generator(seed, number, Stream.HEADING).uniform(-largest, largest))


def _recorded(flight: Flight, glider: Glider, scenario: Scenario, seed: int, number: int) -> ProfileRecord:
    record = observe(
        flight,
        glider.platform.sensors,
        scenario.sensors,
        generator(seed, number, Stream.SENSORS),
        number=number,
        epoch=np.datetime64(scenario.start, "ns"),
    )
    record = with_faults(record, scenario.sensors, generator(seed, number, Stream.FAULTS))
    if scenario.sensors.velocity_deviation is not None:
        rng = generator(seed, number, Stream.VELOCITY)
        velocity, std = measured_velocity(states_at(flight, record.time), scenario.sensors, rng)
        record = replace(record, velocity=velocity, velocity_std=std)
    return record if scenario.ocean is None else _with_ctd(record, flight, scenario, scenario.ocean, seed)


def _with_ctd(record: ProfileRecord, flight: Flight, scenario: Scenario, ocean: Ocean, seed: int) -> ProfileRecord:
    depth = states_at(flight, record.time)[:, 5]
    column = ocean_column(ocean, scenario.origin, scenario.depth)
    rng, interval = generator(seed, record.number, Stream.CTD), float(np.median(np.diff(record.time)))
    temperature, salinity, pressure = column.measured(depth, ocean, interval, rng).T
    return replace(record, temperature=temperature, practical_salinity=salinity, pressure=pressure)


def _truth(
    record: ProfileRecord,
    flight: Flight,
    scenario: Scenario,
    *,
    hull: TrueHull,
    disturbance: Disturbance,
    water: WaterMotion,
    levels: FloatArray,
    course: float,
) -> ProfileTruth:
    states, carried = states_at(flight, record.time), carried_at(flight, record.time)
    surface = tuple(water.current.at(np.zeros(1), time)[0] for time in (0.0, flight.duration))
    nowhere = scenario.origin
    return ProfileTruth(
        number=record.number,
        epoch=record.epoch,
        duration=flight.duration,
        step=scenario.integration.truth_step,
        disturbances=flight.disturbances.reshape(-1, scenario.integration.steps_per_truth, 6).mean(axis=1),
        time=record.time,
        states=states,
        actuators=actuators_at(flight, record.time),
        water=water.along(states[:, 5], carried[:, 2], record.time),
        water_up=water.vertical.velocity(record.time),
        levels=levels,
        shear=water.current.at(levels, 0.5 * flight.duration),
        current=flight.carried[-1, :2] / flight.duration,
        surface_currents=(surface[0], surface[1]),
        displacement=flight.states[-1, 3:5] - flight.states[0, 3:5],
        course=course,
        coefficients=hull.coefficients(),
        net_mass=hull.net_mass,
        impulses=tuple(impulse for impulse in disturbance.impulses if impulse.time < flight.duration),
        entry=nowhere,
        exit=nowhere,
        surface_until=record.epoch,
        end=nowhere,
    )


def level_depths(scenario: Scenario) -> FloatArray:
    """Depths of the true current profile, `LEVEL_SPACING` apart, m."""
    deepest = math.ceil((scenario.depth + scenario.depth_spread) / LEVEL_SPACING)
    return LEVEL_SPACING * np.arange(deepest + 1, dtype=np.float64)
