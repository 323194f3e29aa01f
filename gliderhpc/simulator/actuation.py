"""What the glider commands and what its actuators do: ramps, turns, and the lag between the two."""

import math

import numpy as np

from gliderhpc.observations.records import FloatArray
from gliderhpc.simulator.plan import FlightPlan, Leg
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Steering

FIRST_DECISION = 60.0
"""The helm leaves a beginning dive alone for so long (s)."""


class Actuators:
    """Battery translation, battery rotation and ballast, each a ramped command and a first-order lag behind it.

    What is recorded is the command; what acts on the glider lags it, so the estimator's controls are never quite true.

    Attributes
    ----------
    commanded, actual : (3,) arrays
        Battery position (m), battery rotation (rad), ballast volume (m3) at the present time.
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
            What the actuators do at the midpoint of every integration step.

        Notes
        -----
        Exact for ``lag * d(actual)/dt = commanded - actual`` with a command linear over the interval.
        """
        change = np.minimum(np.maximum(targets - self.commanded, -self._largest_change), self._largest_change)
        slope = change / self._interval
        departure = self.actual - self.commanded + slope * self._lag
        path = self.commanded + slope * (self._times - self._lag) + departure * self._decay
        self.commanded = self.commanded + change
        self.actual = path[-1]
        return path[:-1]


class Helm:
    """A discrete heading controller with a dead band (see `Steering`).

    Once an interval it looks at the heading; an error beyond the dead band starts one turn, as long as the hull's turn
    rate asks for, but bounded. So the battery is upright for most of the time.
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
        """Battery rotation (rad) wanted at `time` (s) for a heading (rad) and the leg's turn rate (rad/s)."""
        if time >= self._next_decision:
            self._decide(time, heading, turn_rate)
        return self._commanded if time < self._turn_ends else 0.0

    def postpone(self, time: float) -> None:
        """End the turn, if any, and decide anew one interval after `time` (s); for inflections."""
        self._turn_ends = time
        self._next_decision = time + self._steering.interval

    def _decide(self, time: float, heading: float, turn_rate: float) -> None:
        self._next_decision = time + self._steering.interval
        error = math.remainder(self._course - heading, 2.0 * math.pi)
        if abs(error) <= self._dead_band or turn_rate == 0.0:
            return
        self._commanded = math.copysign(self._rotation, error * turn_rate)
        self._turn_ends = time + min(abs(error / turn_rate), self._steering.longest_turn)


def setting_of(leg: Leg) -> FloatArray:
    """Battery position (m), rotation (rad) and ballast volume (m3) that a leg is flown with."""
    return np.array([leg.glide.battery_position, 0.0, leg.ballast_volume])


def actuator_rates(plan: FlightPlan, scenario: Scenario) -> FloatArray:
    """Largest rates of the commands (m/s, rad/s, m3/s): translation and ballast take the inflection's time."""
    rates: FloatArray = np.abs(setting_of(plan.climb) - setting_of(plan.dive)) / scenario.actuation.inflection_duration
    rates[1] = math.radians(scenario.actuation.rotation_rate)
    return rates
