"""One profile flown: the glider's own control loop closed around the flight model, dive, inflection and climb."""

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
from gliderhpc.simulator.actuation import Actuators, Helm, actuator_rates, setting_of
from gliderhpc.simulator.disturbance import Disturbance
from gliderhpc.simulator.fouling import TrueHull
from gliderhpc.simulator.ocean import HullAfloat
from gliderhpc.simulator.plan import FlightPlan, hull_afloat
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.water import Water

DEPTH = 5
"""Where depth lies in the state of eq. 16."""
_ABOUT = 0.5
"""Over so much (m) above and below is the ocean's slope taken."""


@dataclass(frozen=True, eq=False)
class Flight:
    """What truly happened in one profile, on the simulator's own steps.

    Attributes
    ----------
    step : float
        Integration step, s.
    control_interval : float
        Interval of the control loop, s.
    states : (n + 1, 12) array
        State of eq. 16 relative to the water, X and Y from the start of the profile (SI, rad).
    actuators : (n, 3) array
        Battery position (m), battery rotation (rad), ballast volume (m3) at the midpoint of every step.
    commands : (m + 1, 3) array
        The same as commanded, at the ends of the control intervals; linear in between.
    carried : (n + 1, 3) array
        How far the water has carried the glider north and east, and the path length flown through the water, m.
    disturbances : (n, 6) array
        Over every step, N and N m: the scenario's additive ones and what the water's changes exert.
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
        """Time from the first state to the last, s."""
        return (len(self.states) - 1) * self.step


class _Cockpit:
    """The working arrays of one flight, and the integration of one control interval within them."""

    def __init__(
        self, glider: Glider, hull: TrueHull, plan: FlightPlan, scenario: Scenario, water: Water, additive: FloatArray
    ) -> None:
        steps = len(additive)
        self.glider = glider
        self._hulls = (Glider(hull.dive).hull, Glider(hull.climb).hull)
        self._afloat = hull_afloat(glider.platform, scenario)
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
        """Integrate one control interval; the kernels are called directly, for this runs thousands of times a dive."""
        first = interval * self.chunk
        now, edges = slice(first, first + self.chunk), slice(first, first + self.chunk + 1)
        positions = self.actuators.advance(targets)
        self.positions[now] = positions
        self.commands[interval + 1] = self.actuators.commanded
        self._controls[:, :2] = positions[:, :2]
        self._controls[:, 2], self._controls[:, 3] = ballast_masses(self.glider.platform, positions[:, 2])
        bodies_of_controls(self.glider.masses, self._controls, self._bodies)
        hull = self._hulls[climbing]
        if self._afloat is not None:
            hull = self._weigh(hull, self._afloat, float(self.states[first, 5]), positions[:, 2])
        self._bodies[:, NET_WEIGHT] += self._extra_weight
        current.simulate(
            hull, self._field, self._bodies, self._water.current.table, self._water.gusts,
            self.states[first], self.carried[first], first * self.step, self._additive[now], self.step,
            self.states[edges], self.carried[edges], self.disturbances[now],
        )  # fmt: skip
        # Within a control interval the water rises by centimetres, too few to change the hull's buoyancy there.
        begin, ends = first * self.step, self.step * (first + 1.0 + np.arange(self.chunk, dtype=np.float64))
        self.states[first + 1 : first + self.chunk + 1, DEPTH] -= self._water.vertical.rise(begin, ends)

    def _weigh(self, hull: Hull, afloat: HullAfloat, depth: float, oil_volume: FloatArray) -> Hull:
        """Put the weight in the ocean into the mass properties, and its slope about this depth into the hull.

        A control interval is a fraction of a metre long, over which the ocean is a straight line.
        """
        slope = afloat.depth_slope(depth, float(oil_volume[0]), _ABOUT)
        self._bodies[:, NET_WEIGHT] = GRAVITY * afloat.net_mass(depth, oil_volume) + slope * depth
        return hull._replace(depth_slope=slope)

    def flight(self, intervals: int) -> Flight:
        """Give what the first `intervals` control intervals hold."""
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
    water: Water,
    *,
    heading: float,
    course: float,
) -> Flight:
    """Fly one profile, from `Scenario.start_depth` down to `Scenario.depth` and back.

    Parameters
    ----------
    glider : Glider
        The hull that its pilots know.
    hull : TrueHull
        The hull that flies.
    plan : FlightPlan
        Its trim.
    scenario : Scenario
        Depths, actuation, steering and steps.
    disturbance : Disturbance
        What acts on it besides the water.
    water : Water
        What it flies through.
    heading, course : float
        Heading at the start and the one to steer, rad.

    Raises
    ------
    InputError
        The hull does not reach the depth, or does not come back, within the plan's time.
    """
    interval = scenario.integration.control_interval
    limit = math.ceil(plan.time_limit / interval)
    chunk = scenario.integration.steps_per_control
    additive = disturbance.sampled(limit * chunk, scenario.integration.step)
    cockpit = _Cockpit(glider, hull, plan, scenario, water, additive)
    cockpit.states[0] = plan.dive.entry.state
    cockpit.states[0, 2] = heading
    helm = Helm(scenario.steering, course)
    leg, targets = plan.dive, setting_of(plan.dive)
    for index in range(limit):
        time, (psi, depth) = index * interval, cockpit.states[index * chunk, [2, 5]].tolist()
        if leg is plan.dive and depth >= scenario.depth:
            leg, targets = plan.climb, setting_of(plan.climb)
            helm.postpone(time)
        elif leg is plan.climb and depth <= scenario.start_depth:
            return cockpit.flight(index)
        targets[1] = helm.rotation(time, psi, leg.turn_rate)
        cockpit.fly(index, targets, climbing=leg is plan.climb)
    raise InputError(_failure(glider, cockpit.states[:, 5], scenario, plan))


def _failure(glider: Glider, depths: FloatArray, scenario: Scenario, plan: FlightPlan) -> str:
    minutes = plan.time_limit / 60.0
    if not np.isfinite(depths).all():
        return (
            f"{glider.platform.name} loses stable flight in this scenario; weaken its disturbances or shorten its step"
        )
    if depths.max() < scenario.depth:
        return (
            f"{glider.platform.name} does not reach {scenario.depth:g} m within {minutes:.0f} minutes, "
            f"only {depths.max():.0f} m; "
            "choose a smaller depth, a larger actuation.dive_net_mass or weaker disturbances"
        )
    return (
        f"{glider.platform.name} is not back at the surface after {minutes:.0f} minutes; "
        "give actuation.climb_net_mass a larger magnitude or weaken the disturbances"
    )
