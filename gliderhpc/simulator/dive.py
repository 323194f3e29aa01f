"""Simulated flight of one dive: commands, actuators and helm, and the integration through the water."""

import math
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import NET_WEIGHT, Glider
from gliderhpc.kernels import current
from gliderhpc.kernels.mass import bodies_of_controls
from gliderhpc.kernels.parameters import Hull
from gliderhpc.observations.records import FloatArray
from gliderhpc.platform import GRAVITY, ballast_masses
from gliderhpc.simulator.disturbance import Disturbance
from gliderhpc.simulator.hull import FloatingHull, TrueHull
from gliderhpc.simulator.plan import FlightPlan, PlannedLeg, floating_hull
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Steering
from gliderhpc.simulator.water import WaterMotion

FIRST_DECISION = 60.0
"""Time of the first decision of the helm after the start of a dive (s)."""


class Actuators:
    """Battery translation, battery rotation and ballast, each with a ramped command and a first-order lag.

    The record contains the commands, but the actual positions lag behind. The estimator's controls are therefore always
    slightly in error.

    Attributes
    ----------
    commanded, actual : (3,) arrays
        Battery position (m), battery rotation (rad) and ballast volume (m3) at the present time.
    """

    def __init__(self, start: FloatArray, rates: FloatArray, scenario: Scenario) -> None:
        steps, step = scenario.integration.steps_per_control, scenario.integration.step
        self.commanded = start.copy()
        self.actual = start.copy()
        self._interval = scenario.integration.control_interval
        self._largest_change = rates * self._interval
        self._lag = scenario.actuation.lag
        # Midpoints of the steps, and the end of the interval as a last row.
        self._times = np.append((np.arange(steps) + 0.5) * step, self._interval)[:, None]
        self._decay = np.exp(-self._times / self._lag)

    def advance(self, targets: FloatArray) -> FloatArray:
        """Move the commands towards their targets for one control interval.

        Returns
        -------
        (steps, 3) array
            Actual positions at the midpoint of every integration step.

        Notes
        -----
        The positions are the exact solution of ``lag * d(actual)/dt = commanded - actual`` for a command that is linear
        over the interval.
        """
        change = np.minimum(np.maximum(targets - self.commanded, -self._largest_change), self._largest_change)
        slope = change / self._interval
        departure = self.actual - self.commanded + slope * self._lag
        path = self.commanded + slope * (self._times - self._lag) + departure * self._decay
        self.commanded = self.commanded + change
        self.actual = path[-1]
        return path[:-1]


class Helm:
    """Discrete heading controller with a dead band (see `Steering`).

    The heading is checked once per interval. An error beyond the dead band starts one turn. Its length follows from the
    hull's turn rate, but is limited. The battery is therefore upright most of the time.
    """

    def __init__(self, steering: Steering, course: float) -> None:
        self._steering = steering
        self._course = course
        self._rotation = math.radians(steering.rotation)
        self._dead_band = math.radians(steering.dead_band)
        self._next_decision = FIRST_DECISION
        self._turn_ends = 0.0
        self._commanded = 0.0

    def rotation(self, time: float, heading: float, turn_rate: float) -> float:
        """Commanded battery rotation (rad) at `time` (s), from the heading (rad) and the leg's turn rate (rad/s)."""
        if time >= self._next_decision:
            self._decide(time, heading, turn_rate)
        return self._commanded if time < self._turn_ends else 0.0

    def postpone(self, time: float) -> None:
        """End any turn, and set the next decision to one interval after `time` (s); used at inflections."""
        self._turn_ends = time
        self._next_decision = time + self._steering.interval

    def _decide(self, time: float, heading: float, turn_rate: float) -> None:
        self._next_decision = time + self._steering.interval
        error = math.remainder(self._course - heading, 2.0 * math.pi)
        if abs(error) <= self._dead_band or turn_rate == 0.0:
            return
        self._commanded = math.copysign(self._rotation, error * turn_rate)
        self._turn_ends = time + min(abs(error / turn_rate), self._steering.longest_turn)


def setting_of(leg: PlannedLeg) -> FloatArray:
    """Battery position (m), battery rotation (rad) and ballast volume (m3) of a leg."""
    return np.array([leg.glide.battery_position, 0.0, leg.ballast_volume])


def actuator_rates(plan: FlightPlan, scenario: Scenario) -> FloatArray:
    """Largest rates of the commands (m/s, rad/s, m3/s); translation and ballast take the duration of the inflection."""
    rates: FloatArray = np.abs(setting_of(plan.climb) - setting_of(plan.dive)) / scenario.actuation.inflection_duration
    rates[1] = math.radians(scenario.actuation.rotation_rate)
    return rates


DEPTH = 5
"""Index of depth in the state of eq. 16."""
_SLOPE_HALF_RANGE = 0.5
"""Distance (m) above and below a depth over which the slope of the buoyancy is computed."""


@dataclass(frozen=True, eq=False)
class Flight:
    """True flight of one profile on the simulator's own steps.

    Attributes
    ----------
    step : float
        Integration step, s.
    control_interval : float
        Interval of the control loop, s.
    states : (n + 1, 12) array
        State of eq. 16 relative to the water, with X and Y from the start of the profile (SI, rad).
    actuators : (n, 3) array
        Actual battery position (m), battery rotation (rad) and ballast volume (m3) at the midpoint of every step.
    commands : (m + 1, 3) array
        Commands of the same quantities at the ends of the control intervals; linear in between.
    carried : (n + 1, 3) array
        Displacement by the water to the north and east, and path length flown through the water, m.
    disturbances : (n, 6) array
        Disturbances over every step, N and N m: the sum of the scenario's additive ones and of those exerted by changes
        of the water's velocity.
    """

    step: float
    control_interval: float
    states: FloatArray
    actuators: FloatArray
    commands: FloatArray
    carried: FloatArray
    disturbances: FloatArray

    @property
    def duration(self) -> float:
        """Time from the first to the last state, s."""
        return (len(self.states) - 1) * self.step


class _Autopilot:
    """Working arrays of one flight, and the integration of single control intervals."""

    def __init__(
        self,
        glider: Glider,
        hull: TrueHull,
        plan: FlightPlan,
        scenario: Scenario,
        water: WaterMotion,
        additive: FloatArray,
    ) -> None:
        steps = len(additive)
        self.glider = glider
        self._hulls = (Glider(hull.dive).hull, Glider(hull.climb).hull)
        self._floating = floating_hull(glider.platform, scenario)
        self._extra_weight = GRAVITY * hull.net_mass
        self._water = water
        self._field = water.field(glider.platform.mass.total)
        self._additive = additive
        self.step = scenario.integration.step
        self.chunk = scenario.integration.steps_per_control
        self.intervals = steps // self.chunk
        self.disturbances = np.empty((steps, 6))
        self.states = np.empty((steps + 1, 12))
        self.carried = np.empty((steps + 1, 3))
        self.carried[0] = 0.0
        self.positions = np.empty((steps, 3))
        self.commands = np.empty((self.intervals + 1, 3))
        self.actuators = Actuators(setting_of(plan.dive), actuator_rates(plan, scenario), scenario)
        self.commands[0] = self.actuators.commanded
        self._controls = np.zeros((self.chunk, 5))
        self._bodies = np.empty((self.chunk, 11))

    def fly(self, interval: int, targets: FloatArray, *, climbing: bool) -> None:
        """Integrate one control interval; kernels are called directly, as this runs thousands of times per dive."""
        first = interval * self.chunk
        now, edges = slice(first, first + self.chunk), slice(first, first + self.chunk + 1)
        positions = self.actuators.advance(targets)
        self.positions[now] = positions
        self.commands[interval + 1] = self.actuators.commanded
        self._controls[:, :2] = positions[:, :2]
        self._controls[:, 2], self._controls[:, 3] = ballast_masses(self.glider.platform, positions[:, 2])
        bodies_of_controls(self.glider.masses, self._controls, self._bodies)
        hull = self._hulls[climbing]
        if self._floating is not None:
            hull = self._weigh(hull, self._floating, float(self.states[first, 5]), positions[:, 2])
        self._bodies[:, NET_WEIGHT] += self._extra_weight
        current.simulate(
            hull, self._field, self._bodies, self._water.current.table, self._water.gusts,
            self.states[first], self.carried[first], first * self.step, self._additive[now], self.step,
            self.states[edges], self.carried[edges], self.disturbances[now],
        )  # fmt: skip
        # The water rises by centimetres in a control interval, which does not change the hull's buoyancy noticeably.
        begin, ends = first * self.step, self.step * (first + 1.0 + np.arange(self.chunk, dtype=np.float64))
        self.states[first + 1 : first + self.chunk + 1, DEPTH] -= self._water.vertical.rise(begin, ends)

    def _weigh(self, hull: Hull, floating: FloatingHull, depth: float, oil_volume: FloatArray) -> Hull:
        """Set the net weight in the ocean in the mass properties, and return the hull with its slope at this depth.

        Over a control interval the glider sinks by a fraction of a metre, within which the net weight is linear.
        """
        slope = floating.depth_slope(depth, float(oil_volume[0]), _SLOPE_HALF_RANGE)
        self._bodies[:, NET_WEIGHT] = GRAVITY * floating.net_mass(depth, oil_volume) + slope * depth
        return hull._replace(depth_slope=slope)

    def flight(self, intervals: int) -> Flight:
        """Return the flight over the first `intervals` control intervals."""
        steps = intervals * self.chunk
        return Flight(
            step=self.step,
            control_interval=self.chunk * self.step,
            states=self.states[: steps + 1].copy(),
            actuators=self.positions[:steps].copy(),
            commands=self.commands[: intervals + 1].copy(),
            carried=self.carried[: steps + 1].copy(),
            disturbances=self.disturbances[:steps].copy(),
        )


def fly(
    glider: Glider,
    hull: TrueHull,
    plan: FlightPlan,
    scenario: Scenario,
    disturbance: Disturbance,
    water: WaterMotion,
    *,
    heading: float,
    course: float,
) -> Flight:
    """Fly one profile, from `Scenario.start_depth` down to `Scenario.depth` and back.

    Parameters
    ----------
    glider : Glider
        Glider with the nominal hull, for which the flight is planned.
    hull : TrueHull
        True hull, which is flown.
    plan : FlightPlan
        Trim of dive and climb.
    scenario : Scenario
        Depths, actuation, steering and steps.
    disturbance : Disturbance
        Disturbance that acts in addition to the water.
    water : Water
        Motion of the water.
    heading, course : float
        Heading at the start, and course to steer, rad.

    Raises
    ------
    InputError
        The hull does not reach the depth, or does not come back, within the plan's time limit, or its flight is
        unstable.
    """
    interval = scenario.integration.control_interval
    limit = math.ceil(plan.time_limit / interval)
    chunk = scenario.integration.steps_per_control
    additive = disturbance.sampled(limit * chunk, scenario.integration.step)
    autopilot = _Autopilot(glider, hull, plan, scenario, water, additive)
    autopilot.states[0] = plan.dive.entry.state
    autopilot.states[0, 2] = heading
    helm = Helm(scenario.steering, course)
    leg, targets = plan.dive, setting_of(plan.dive)
    for index in range(limit):
        time, (psi, depth) = index * interval, autopilot.states[index * chunk, [2, 5]].tolist()
        if leg is plan.dive and depth >= scenario.depth:
            leg, targets = plan.climb, setting_of(plan.climb)
            helm.postpone(time)
        elif leg is plan.climb and depth <= scenario.start_depth:
            return autopilot.flight(index)
        targets[1] = helm.rotation(time, psi, leg.turn_rate)
        autopilot.fly(index, targets, climbing=leg is plan.climb)
    raise InputError(_failure(glider, autopilot.states[:, 5], scenario, plan))


def _failure(glider: Glider, depths: FloatArray, scenario: Scenario, plan: FlightPlan) -> str:
    minutes = plan.time_limit / 60.0
    if not np.isfinite(depths).all():
        return (
            f"{glider.platform.name} loses stable flight in this scenario; weaken its disturbances or shorten "
            "integration.step"
        )
    if depths.max() < scenario.depth:
        return (
            f"{glider.platform.name} does not reach {scenario.depth:g} m within {minutes:.0f} minutes, "
            f"only {depths.max():.0f} m; "
            "choose a smaller depth, a larger actuation.dive_net_mass or weaker disturbances"
        )
    return (
        f"{glider.platform.name} does not return to the surface within {minutes:.0f} minutes; "
        "give actuation.climb_net_mass a larger magnitude or weaken the disturbances"
    )
