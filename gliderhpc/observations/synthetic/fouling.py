"""The hull that truly flies: the platform file's, but for its errors and for what has grown on it by then."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.observations.synthetic.scenario import Scenario
from gliderhpc.observations.synthetic.sections import Coefficients, Fouling
from gliderhpc.observations.synthetic.seeds import MISSION, Stream, generator
from gliderhpc.platform import Platform

COEFFICIENTS = ("K_D0", "K_D", "K_beta", "K_L0", "K_L", "K_MR", "K_p", "K_M0", "K_M", "K_q", "K_MY", "K_r")
ADDED = ("M_f1", "M_f2", "M_f3", "I_f1", "I_f2", "I_f3")

_DRAWS = 100


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
        legs = (self.dive, self.climb)
        values = {name: tuple(float(getattr(leg.viscous, name)) for leg in legs) for name in COEFFICIENTS}
        for i in range(3):
            values[ADDED[i]] = tuple(float(leg.added_mass[i]) for leg in legs)
            values[ADDED[i + 3]] = tuple(float(leg.added_inertia[i]) for leg in legs)
        return {name: (pair[0], pair[1]) for name, pair in values.items()}


def true_hull(platform: Platform, scenario: Scenario, seed: int, number: int) -> TrueHull:
    """Give the hull that flies the profile `number`."""
    drawn = with_errors(platform, scenario.coefficients, seed)
    settings, episode = scenario.fouling, scenario.episode
    part = episode.part(number)
    progress = min((number - 1) / settings.profiles, 1.0) ** settings.exponent
    return TrueHull(
        dive=_dragged(_fouled(drawn, settings, progress), part * episode.dive_drag),
        climb=_dragged(_fouled(drawn, settings, progress * settings.climb_share), part * episode.climb_drag),
        net_mass=progress * settings.net_mass,
    )


def with_errors(platform: Platform, settings: Coefficients, seed: int) -> Platform:
    """Draw the coefficients of a mission's hull; a hull that would not glide stably is drawn again.

    Raises
    ------
    InputError
        No draw glides stably.
    """
    if settings.spread == 0.0:
        return platform
    rng = generator(seed, MISSION, Stream.COEFFICIENTS)
    for _ in range(_DRAWS):
        drawn = _drawn(platform, settings.spread, rng)
        if glides_stably(Glider(drawn)):
            return drawn
    raise InputError(
        f"{platform.name}: no draw of its coefficients within {settings.spread:.0%} glides stably; "
        "give a smaller coefficients.spread"
    )


def _drawn(platform: Platform, spread: float, rng: np.random.Generator) -> Platform:
    factors = rng.uniform(1.0 - spread, 1.0 + spread, len(COEFFICIENTS) + 6)
    viscous = {name: getattr(platform.viscous, name) * f for name, f in zip(COEFFICIENTS, factors[:-6], strict=True)}
    added = np.array([*platform.added_mass, *platform.added_inertia]) * factors[-6:]
    drawn = _with_viscous(platform, viscous)
    return drawn.model_copy(
        update={"added_mass": tuple(added[:3].tolist()), "added_inertia": tuple(added[3:].tolist())}
    )


def _fouled(platform: Platform, settings: Fouling, part: float) -> Platform:
    """Platform after a part of the mission's changes."""
    changes = {"K_D0": settings.drag, "K_L": settings.lift, "K_M": settings.moment}
    if part == 0.0 or not any(changes.values()):
        return platform
    viscous = platform.viscous
    return _with_viscous(platform, {name: getattr(viscous, name) * (1.0 + part * c) for name, c in changes.items()})


def _dragged(platform: Platform, change: float) -> Platform:
    """Platform with its K_D0 changed by a part of itself."""
    return _with_viscous(platform, {"K_D0": platform.viscous.K_D0 * (1.0 + change)}) if change else platform


def _with_viscous(platform: Platform, values: Mapping[str, float]) -> Platform:
    return platform.model_copy(update={"viscous": platform.viscous.model_copy(update=dict(values))})
