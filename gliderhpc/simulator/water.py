"""The water that one profile is flown through: its current and its gusts, laid out for the kernel."""

import math
from dataclasses import dataclass

import numpy as np

from gliderhpc.kernels.current import Field, water_along
from gliderhpc.observations.records import FloatArray
from gliderhpc.seeds import Stream, generator
from gliderhpc.simulator.gusts import gust_field, node_spacing, with_slopes
from gliderhpc.simulator.plan import FlightPlan
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.shear import CurrentProfile, current_profile
from gliderhpc.simulator.vertical import VerticalMotion, draw_vertical_motion

OVERSHOOT = 50.0
"""How far below its turning point a dive's current is laid out (m)."""

_STILL = np.zeros((2, 2))


@dataclass(frozen=True, eq=False)
class Water:
    """What the water does along one profile.

    Attributes
    ----------
    current : CurrentProfile
        As a function of depth and time.
    gusts : (n, 2) array
        Gust (m/s) and its slope (1/s) at nodes of path length.
    gust_spacing : float
        Distance of these nodes, m.
    bearing : float
        Direction of a positive gust: to starboard of the course, rad clockwise from north.
    vertical : VerticalMotion
        Its motion up and down.
    """

    current: CurrentProfile
    gusts: FloatArray
    gust_spacing: float
    bearing: float
    vertical: VerticalMotion

    def field(self, mass: float) -> Field:
        """Pack for the kernel, with the mass (kg) of the hull that is carried."""
        return Field(mass, self.current.spacing, self.gust_spacing, math.cos(self.bearing), math.sin(self.bearing))

    def along(self, depth: FloatArray, path: FloatArray, time: FloatArray) -> FloatArray:
        """Current north and east without the gust, and the gust ``(n, 3)``, m/s, at depths, path lengths and times."""
        out = np.empty((len(depth), 3))
        water_along(self.field(0.0), self.current.table, self.gusts, depth, path, time, out)
        return out


def still_water() -> Water:
    """Water at rest."""
    return Water(
        CurrentProfile(1.0, np.zeros((2, 8))), _STILL, 1.0, 0.0, VerticalMotion(np.zeros(1), np.ones(1), np.zeros(1))
    )


def draw_water(scenario: Scenario, plan: FlightPlan, seed: int, number: int, course: float) -> Water:
    """Draw the water of the profile `number`, flown on a `course` (rad)."""
    current = current_profile(
        scenario.current, seed, number, depth=scenario.depth + OVERSHOOT, duration=plan.nominal_duration
    )
    bearing = course + 0.5 * math.pi
    vertical = draw_vertical_motion(scenario.vertical, generator(seed, number, Stream.VERTICAL))
    settings = scenario.gusts
    if settings.kind == "none" or settings.rms == 0.0:
        return Water(current, _STILL, 1.0, bearing, vertical)
    values = gust_field(settings, plan.longest_path, generator(seed, number, Stream.GUSTS))
    spacing = node_spacing(settings)
    return Water(current, with_slopes(values, spacing), spacing, bearing, vertical)
