"""The hull that truly flies: the platform file's, but for its errors and for what has grown on it by then."""

from dataclasses import dataclass

from gliderhpc.flight.coefficients import coefficients_of, with_errors, with_viscous
from gliderhpc.platform import Platform
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Fouling


@dataclass(frozen=True)
class TrueHull:
    """The hull of one profile.

    Attributes
    ----------
    dive, climb : Platform
        With its true coefficients at positive and at negative angle of attack.
    net_mass : float
        That no record tells, kg, positive heavy; it acts at the centre of buoyancy.
    """

    dive: Platform
    climb: Platform
    net_mass: float

    def coefficients(self) -> dict[str, tuple[float, float]]:
        """Give the true coefficients on dive and climb, by the paper's symbol."""
        dive, climb = coefficients_of(self.dive), coefficients_of(self.climb)
        return {name: (dive[name], climb[name]) for name in dive}


def true_hull(platform: Platform, scenario: Scenario, seed: int, number: int) -> TrueHull:
    """Give the hull that flies the profile `number`."""
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
    """Platform after a part of the mission's changes."""
    changes = {"K_D0": settings.drag, "K_L": settings.lift, "K_M": settings.moment}
    if part == 0.0 or not any(changes.values()):
        return platform
    viscous = platform.viscous
    return with_viscous(platform, {name: getattr(viscous, name) * (1.0 + part * c) for name, c in changes.items()})


def _dragged(platform: Platform, change: float) -> Platform:
    """Platform with its K_D0 changed by a part of itself."""
    return with_viscous(platform, {"K_D0": platform.viscous.K_D0 * (1.0 + change)}) if change else platform
