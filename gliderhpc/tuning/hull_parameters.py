"""Parameters of a hull that its own glides may determine, and their plausible deviations beforehand."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gliderhpc.flight.glider import Glider
from gliderhpc.platform import CUBIC_CENTIMETRE, Platform, ballast_masses


def _zero(_: Platform) -> float:
    return 0.0


@dataclass(frozen=True)
class HullParameter:
    """One number of the platform file.

    Attributes
    ----------
    key : str
        Where it is in the platform file, ``position.hull.2`` for the third of a list.
    unit, meaning : str
        For the tables.
    spread : callable
        Plausible standard deviation about a platform's value: in the file's unit, or relative where `factor`.
    factor : bool
        Whether it varies by factors, so that it never changes its sign: a step adds to its logarithm.
    origin : callable
        What a factor counts from: the value (in the file's unit) at which the quantity behind the number vanishes.
    """

    key: str
    unit: str
    meaning: str
    spread: Callable[[Platform], float]
    factor: bool = False
    origin: Callable[[Platform], float] = _zero

    def value(self, platform: Platform) -> float:
        """Value in the file's unit; zero of what is not in the file."""
        if self is TREND:
            return 0.0
        node: Any = platform
        for part in self.key.split("."):
            node = node[int(part)] if part.isdigit() else getattr(node, part)
        return float(node)

    def moved(self, platform: Platform, steps: float) -> float:
        """Value that lies so many plausible deviations from a platform's."""
        start, spread = self.value(platform), self.spread(platform)
        if not self.factor:
            return start + spread * steps
        origin = self.origin(platform)
        return origin + (start - origin) * math.exp(spread * steps)

    def slope(self, platform: Platform, steps: float) -> float:
        """Derivative of `moved` by the plausible deviations."""
        spread = self.spread(platform)
        return spread * (self.moved(platform, steps) - self.origin(platform)) if self.factor else spread


def with_values(platform: Platform, values: Mapping[str, float | None]) -> Platform:
    """Return a platform with some of its numbers replaced, by key, unchecked."""
    content: dict[str, Any] = {}
    for key, value in values.items():
        section, *rest = key.split(".")
        if not rest:
            content[section] = value
            continue
        before = content.get(section, getattr(platform, section))
        content[section] = before.model_copy(update=_replacement(before, rest, value))
    return platform.model_copy(update=content)


def _replacement(section: Any, rest: list[str], value: float | None) -> dict[str, Any]:
    name, *index = rest
    if not index:
        return {name: value}
    numbers = list(getattr(section, name))
    numbers[int(index[0])] = value
    return {name: tuple(numbers)}


def righting_moment(platform: Platform) -> float:
    """First moment S_z at the neutral point, battery upright, kg m."""
    masses = ballast_masses(platform, platform.buoyancy.neutral_volume_m3)
    return float(Glider(platform).bodies([[0.0, 0.0, float(masses[0]), float(masses[1])]])[0, 2])


def _relative(part: float) -> Callable[[Platform], float]:
    return lambda _: part


def _absolute(value: float) -> Callable[[Platform], float]:
    return lambda _: value


def _of(name: str, part: float) -> Callable[[Platform], float]:
    return lambda platform: part * abs(getattr(platform.viscous, name))


def _volume(platform: Platform) -> float:
    """Half a per cent of the hull's mass in water: operators ballast to less."""
    return 0.005 * platform.mass.total / platform.buoyancy.water_density / CUBIC_CENTIMETRE


def _righting(part: float) -> Callable[[Platform], float]:
    """A part of the righting moment, as a displacement of the hull's mass."""
    return lambda platform: part * abs(righting_moment(platform)) / platform.mass.hull


def _without_righting(platform: Platform) -> float:
    """Height of the hull's mass at which nothing rights it: a righting moment keeps its sign, as a drag does."""
    return platform.position.hull[2] - righting_moment(platform) / platform.mass.hull


TYPICAL_COMPRESSIBILITY, TYPICAL_EXPANSION = 4.5e-6, 6e-5
"""For a hull that states neither, 1/dbar and 1/K: published ones lie from 4e-6 to 6e-6 and from 5e-5 to 7e-5."""

_NEUTRAL_VOLUME = HullParameter("buoyancy.neutral_volume", "cm3", "neutral oil volume", _volume)

_REMAINING: tuple[HullParameter, ...] = (
    HullParameter("viscous.K_D0", "kg/m", "drag at zero angle of attack", _relative(0.4), factor=True),
    HullParameter("viscous.K_D", "kg/m/rad2", "drag over angle of attack squared", _relative(0.3), factor=True),
    HullParameter("viscous.K_L", "kg/m/rad", "lift over angle of attack", _relative(0.3), factor=True),
    HullParameter(
        "position.hull.2",
        "m",
        "height of the hull's mass: righting moment S_z",
        _relative(0.3),
        factor=True,
        origin=_without_righting,
    ),
    HullParameter("position.battery", "m", "battery zero: pitch trim", _absolute(0.03)),
    HullParameter("position.reservoir.0", "m", "reservoir: how the oil moves the trim", _absolute(0.1)),
    HullParameter("viscous.K_M0", "kg", "pitch moment at zero angle of attack", _absolute(0.5)),
    HullParameter("viscous.K_M", "kg/rad", "pitch moment over angle of attack", _of("K_M", 0.2)),
    HullParameter("position.hull.1", "m", "hull's mass to starboard: roll offset", _righting(0.1)),
    HullParameter("battery_eccentricity", "m", "eccentricity of the battery", _relative(0.3), factor=True),
    HullParameter("viscous.K_beta", "kg/m/rad", "side force over sideslip", _relative(0.3), factor=True),
    HullParameter("viscous.K_MR", "kg/rad", "roll moment over sideslip", _of("K_MR", 0.3)),
    HullParameter("viscous.K_MY", "kg/rad", "yaw moment over sideslip", _of("K_MY", 0.3)),
    HullParameter("viscous.K_r", "kg s/rad", "yaw damping", _relative(0.3), factor=True),
    HullParameter("viscous.K_delta", "kg/rad", "yaw moment over rudder angle", _absolute(5.0)),
)

PARAMETERS: tuple[HullParameter, ...] = (
    _NEUTRAL_VOLUME,
    HullParameter("buoyancy.depth_slope", "N/m", "buoyancy gained with depth", _absolute(0.008)),
    *_REMAINING,
)
"""Parameters that `gliderhpc calibrate` fits."""

PARAMETERS_BY_DENSITY: tuple[HullParameter, ...] = (
    _NEUTRAL_VOLUME,
    HullParameter("buoyancy.compressibility", "1/dbar", "compressibility of the hull", _relative(0.35), factor=True),
    HullParameter("buoyancy.thermal_expansion", "1/K", "thermal expansion of the hull", _relative(0.5), factor=True),
    *_REMAINING,
)
"""Parameters that it fits where the buoyancy goes by measured density."""

TREND = HullParameter("trend", "cm3/day", "trend of the neutral volume", _absolute(1.0))
"""Not in the platform file; fitted on request."""
