"""A stratified ocean: what a CTD would measure in it, and what it weighs a hull.

The truth goes its own way to the density: by the exact Gibbs function, at the true depth. The estimator goes by the
75-term equation and what was recorded.
"""

import math
from dataclasses import dataclass

import gsw
import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.flight.buoyancy import REFERENCE_TEMPERATURE
from gliderhpc.observations.records import FloatArray
from gliderhpc.platform import GRAVITY, Platform
from gliderhpc.simulator.sections import Latitude, Longitude, Ocean

SPACING = 0.25
"""Of the nodes in depth, m."""

_BELOW = 100.0


@dataclass(frozen=True, eq=False)
class OceanColumn:
    """The ocean as a function of depth, linear between nodes.

    Attributes
    ----------
    depth : (n,) array
        Nodes, m.
    temperature, practical_salinity, pressure : (n,) arrays
        In situ, degC, 1 and dbar.
    density : (n,) array
        In situ, kg/m3.
    """

    depth: FloatArray
    temperature: FloatArray
    practical_salinity: FloatArray
    pressure: FloatArray
    density: FloatArray

    def measured(self, depth: FloatArray, settings: Ocean, interval: float, rng: np.random.Generator) -> FloatArray:
        """Temperature, practical salinity and pressure (m, 3) of a CTD at depths (m), samples so many seconds apart."""
        columns = (self.temperature, self.practical_salinity, self.pressure)
        true = np.column_stack([np.interp(depth, self.depth, column) for column in columns])
        noise = np.array([settings.temperature_noise, settings.salinity_noise, settings.pressure_noise])
        measured: FloatArray = true + noise * rng.standard_normal(true.shape)
        spiked = rng.random(len(depth)) < settings.spikes * interval / 3600.0
        measured[spiked, 1] += settings.spike_size * rng.standard_normal(int(spiked.sum()))
        return measured


class HullAfloat:
    """What a hull weighs in an ocean.

    Parameters
    ----------
    platform : Platform
        The hull, with its compressibility.
    column : OceanColumn
        The ocean.

    Raises
    ------
    InputError
        The platform states no compressibility.
    """

    def __init__(self, platform: Platform, column: OceanColumn) -> None:
        buoyancy = platform.buoyancy
        if buoyancy.compressibility is None:
            raise InputError(
                f"{platform.name}: the scenario has an ocean, and the platform states no buoyancy.compressibility; "
                "add it to the platform file (1/dbar; 4.5e-6 is usual)"
            )
        warmth = column.temperature - REFERENCE_TEMPERATURE
        strain = buoyancy.thermal_expansion * warmth - buoyancy.compressibility * column.pressure
        volume = (platform.mass.total / buoyancy.water_density - buoyancy.neutral_volume_m3) * (1.0 + strain)
        self._mass, self._column = platform.mass.total, column
        self._displaced = column.density * volume

    def net_mass(self, depth: float, oil_volume: FloatArray | float) -> FloatArray:
        """Net mass (kg) at a depth (m) with so much oil outside (m3)."""
        depths, density = self._column.depth, self._column.density
        displaced = np.interp(depth, depths, self._displaced) + np.interp(depth, depths, density) * oil_volume
        return np.asarray(self._mass - displaced)

    def oil_volume(self, net_mass: float) -> float:
        """Oil outside (m3) that gives a net mass (kg) at the surface."""
        return float((self._mass - self._displaced[0] - net_mass) / self._column.density[0])

    def depth_slope(self, depth: float, oil_volume: float, reach: float) -> float:
        """Buoyancy gained with depth about a depth, from `reach` (m) above to as much below, N/m."""
        above, below = max(depth - reach, 0.0), depth + reach
        lost = self.net_mass(above, oil_volume) - self.net_mass(below, oil_volume)
        return float(GRAVITY * lost / (below - above))


def ocean_column(settings: Ocean, position: tuple[Latitude, Longitude], deepest: float) -> OceanColumn:
    """Lay out a scenario's ocean down to some way below `deepest` (m) at a latitude and longitude (degree)."""
    depth = SPACING * np.arange(math.ceil((deepest + _BELOW) / SPACING) + 1, dtype=np.float64)
    above = _above(settings, depth)
    temperature = settings.deep_temperature + (settings.surface_temperature - settings.deep_temperature) * above
    salinity = settings.deep_salinity + (settings.surface_salinity - settings.deep_salinity) * above
    pressure = np.asarray(gsw.p_from_z(-depth, position[0]))
    absolute = gsw.SA_from_SP(salinity, pressure, position[1], position[0])
    return OceanColumn(depth, temperature, salinity, pressure, gsw.rho_t_exact(absolute, temperature, pressure))


def _above(settings: Ocean, depth: FloatArray) -> FloatArray:
    """Part of the surface water: 1 at the surface, a half about the thermocline, 0 far below."""
    place = settings.thermocline / settings.thickness
    return np.asarray((1.0 + math.exp(-place)) / (1.0 + np.exp(depth / settings.thickness - place)))
