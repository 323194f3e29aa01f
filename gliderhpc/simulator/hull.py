"""True hull of a profile: the platform file's hull with its errors and its fouling, and its weight in the ocean."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.flight.buoyancy import REFERENCE_TEMPERATURE
from gliderhpc.flight.coefficients import coefficients_of, with_errors, with_viscous
from gliderhpc.flight.hull_parameters import compressible
from gliderhpc.observations.records import FloatArray
from gliderhpc.platform import GRAVITY, Platform
from gliderhpc.simulator.ocean import OceanColumn
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Fouling


@dataclass(frozen=True)
class TrueHull:
    """True hull of one profile.

    Attributes
    ----------
    dive, climb : Platform
        Platforms with the true coefficients at positive and at negative angle of attack.
    net_mass : float
        Unrecorded net mass, kg, positive heavy; it acts at the centre of buoyancy.
    """

    dive: Platform
    climb: Platform
    net_mass: float

    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Return the true coefficients on dive and climb, by the paper's symbol."""
        dive, climb = coefficients_of(self.dive), coefficients_of(self.climb)
        return {name: (dive[name], climb[name]) for name in dive}


def true_hull(platform: Platform, scenario: Scenario, seed: int, number: int) -> TrueHull:
    """Return the true hull of the profile `number`."""
    drawn = with_errors(platform, scenario.coefficients.spread, seed)
    settings, episode = scenario.fouling, scenario.episode
    part = episode.part(number)
    progress = min((number - 1) / settings.profiles, 1.0) ** settings.exponent
    return TrueHull(
        dive=_dragged(_fouled(drawn, settings, progress), part * episode.dive_drag),
        climb=_dragged(_fouled(drawn, settings, progress * settings.climb_share), part * episode.climb_drag),
        net_mass=progress * settings.net_mass,
    )


def _fouled(platform: Platform, settings: Fouling, part: float) -> Platform:
    """Platform after a fraction of the changes due to fouling."""
    changes = {"K_D0": settings.drag, "K_L": settings.lift, "K_M": settings.moment}
    if part == 0.0 or not any(changes.values()):
        return platform
    viscous = platform.viscous
    return with_viscous(platform, {name: getattr(viscous, name) * (1.0 + part * c) for name, c in changes.items()})


def _dragged(platform: Platform, change: float) -> Platform:
    """Platform with a relative change of its K_D0."""
    return with_viscous(platform, {"K_D0": platform.viscous.K_D0 * (1.0 + change)}) if change else platform


class FloatingHull:
    """Net mass of a hull in an ocean.

    Parameters
    ----------
    platform : Platform
        The hull. If it has no compressibility, typical values replace it, and also an absent thermal expansion.
    column : OceanColumn
        The ocean.
    """

    def __init__(self, platform: Platform, column: OceanColumn) -> None:
        if platform.buoyancy.compressibility is None:
            platform = compressible(platform)
        buoyancy = platform.buoyancy
        warmth = column.temperature - REFERENCE_TEMPERATURE
        strain = buoyancy.thermal_expansion * warmth - (buoyancy.compressibility or 0.0) * column.pressure
        volume = (platform.mass.total / buoyancy.water_density - buoyancy.neutral_volume_m3) * (1.0 + strain)
        self._mass, self._column = platform.mass.total, column
        self._displaced = column.density * volume

    def net_mass(self, depth: float, oil_volume: FloatArray | float) -> FloatArray:
        """Net mass (kg) at a depth (m) with a volume of oil in the external bladder (m3)."""
        depths, density = self._column.depth, self._column.density
        displaced = np.interp(depth, depths, self._displaced) + np.interp(depth, depths, density) * oil_volume
        return np.asarray(self._mass - displaced)

    def oil_volume(self, net_mass: float) -> float:
        """Volume of oil in the external bladder (m3) that gives a net mass (kg) at the surface."""
        return float((self._mass - self._displaced[0] - net_mass) / self._column.density[0])

    def depth_slope(self, depth: float, oil_volume: float, reach: float) -> float:
        """Gain in buoyancy with depth (N/m), over the interval from `reach` (m) above a depth to `reach` below it."""
        above, below = max(depth - reach, 0.0), depth + reach
        lost = self.net_mass(above, oil_volume) - self.net_mass(below, oil_volume)
        return float(GRAVITY * lost / (below - above))
