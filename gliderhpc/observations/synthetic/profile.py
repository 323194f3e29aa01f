"""One synthetic profile: what was recorded of it, and what was true."""

from dataclasses import dataclass, replace

import numpy as np

from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.observations.synthetic.disturbance import Disturbance, Impulse, draw_disturbance
from gliderhpc.observations.synthetic.dive import Flight, fly
from gliderhpc.observations.synthetic.plan import FlightPlan, plan_flight
from gliderhpc.observations.synthetic.scenario import Scenario
from gliderhpc.observations.synthetic.seeds import Stream, generator
from gliderhpc.observations.synthetic.sensors import actuators_at, observe, states_at
from gliderhpc.observations.synthetic.track import Position, Track, draw_current, draw_surface_times, later, lay_track
from gliderhpc.platform import Platform


@dataclass(frozen=True, eq=False)
class ProfileTruth:
    """What was true of one synthetic profile.

    Attributes
    ----------
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of its first sample (ns, UTC).
    duration : float
        Of the dive, s.
    step : float
        Interval over which `disturbances` are averaged: the estimator's step, s.
    disturbances : (n, 6) array
        ``B_cu`` ... ``B_cr`` averaged over each step from the epoch on, N and N m.
    time : (m,) array
        Times of the samples, s from the epoch.
    states : (m, 12) array
        State of eq. 16 at the samples: attitude (rad, heading unwrapped), X, Y (m, through the water from the start of
        the profile), depth, velocity through the water and rates (SI).
    actuators : (m, 3) array
        Where the actuators were: battery position (m), battery rotation (rad), ballast volume (m3).
    current : (2,) array
        Of the water, north and east, m/s.
    displacement : (2,) array
        Through the water over the whole dive, north and east, m.
    impulses : tuple of Impulse
        Those that peak within the dive.
    entry, exit : Position
        True latitude and longitude at the start and at the end of the dive, degree.
    surface_until : numpy.datetime64
        End of the time at the surface that belongs to this profile.
    end : Position
        True latitude and longitude then.
    """

    number: int
    epoch: np.datetime64
    duration: float
    step: float
    disturbances: FloatArray
    time: FloatArray
    states: FloatArray
    actuators: FloatArray
    current: FloatArray
    displacement: FloatArray
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
        What happens.
    seed : int
        Of all random numbers.
    number : int
        Number of the profile; its random numbers are those that it has in a whole mission.

    Returns
    -------
    record : ProfileRecord
        As :meth:`gliderhpc.observations.Observations.profile` gives it.
    truth : ProfileTruth

    Raises
    ------
    InputError
        The hull cannot fly the scenario.
    """
    glider = Glider(platform)
    start = np.datetime64(scenario.start, "ns")
    return fly_profile(glider, plan_flight(glider, scenario), scenario, seed, number, start, scenario.origin)


def fly_profile(
    glider: Glider,
    plan: FlightPlan,
    scenario: Scenario,
    seed: int,
    number: int,
    start: np.datetime64,
    position: Position,
) -> tuple[ProfileRecord, ProfileTruth]:
    """Simulate the profile `number` whose time at the surface begins at `start` and `position`."""
    times = draw_surface_times(scenario.surface, surface := generator(seed, number, Stream.SURFACE))
    current = draw_current(scenario.current, generator(seed, number, Stream.CURRENT))
    disturbance = draw_disturbance(scenario.disturbances, plan.time_limit, generator(seed, number, Stream.DISTURBANCE))
    heading, course = _headings(scenario, seed, number)
    flight = fly(glider, plan, scenario, disturbance, heading=heading, course=course)
    epoch = later(start, times.before)
    sensors, noise = glider.platform.sensors, generator(seed, number, Stream.SENSORS)
    record = observe(flight, sensors, scenario.sensors, noise, number=number, epoch=epoch)
    displacement = flight.states[-1, 3:5] - flight.states[0, 3:5]
    track = lay_track(
        position, epoch, flight.duration, displacement, current, times, scenario.surface, scenario.sensors, surface
    )
    until = later(epoch, flight.duration + times.after)
    return _with_fixes(record, track), _truth(record, flight, scenario, disturbance, current, track, until)


def _headings(scenario: Scenario, seed: int, number: int) -> tuple[float, float]:
    """Heading at the start, and course, rad."""
    steering = scenario.steering
    course = steering.courses[(number - 1) % len(steering.courses)]
    error = generator(seed, number, Stream.HEADING).uniform(-steering.initial_error, steering.initial_error)
    return float(np.radians(course + error)), float(np.radians(course))


def _with_fixes(record: ProfileRecord, track: Track) -> ProfileRecord:
    return replace(
        record,
        entry_fix=track.fixes_before[-1],
        exit_fix=track.fixes_after[0],
        surface_fixes_before=track.fixes_before,
        surface_fixes_after=track.fixes_after,
    )


def _truth(
    record: ProfileRecord,
    flight: Flight,
    scenario: Scenario,
    disturbance: Disturbance,
    current: FloatArray,
    track: Track,
    until: np.datetime64,
) -> ProfileTruth:
    averaged = flight.disturbances.reshape(-1, scenario.integration.steps_per_truth, 6).mean(axis=1)
    return ProfileTruth(
        number=record.number,
        epoch=record.epoch,
        duration=flight.duration,
        step=scenario.integration.truth_step,
        disturbances=averaged,
        time=record.time,
        states=states_at(flight, record.time),
        actuators=actuators_at(flight, record.time),
        current=current,
        displacement=flight.states[-1, 3:5] - flight.states[0, 3:5],
        impulses=tuple(impulse for impulse in disturbance.impulses if impulse.time < flight.duration),
        entry=track.entry,
        exit=track.exit,
        surface_until=until,
        end=track.end,
    )
