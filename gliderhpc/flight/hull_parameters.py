"""Catalogue of the parameters of a hull that may be in error: numbers of the platform file, with plausible deviations.

The errors of a hull are a vector ``eta`` over some of these parameters, in units of their plausible deviations
(docs/smoother.md). They include the errors of the records, which are numbers of the platform's sensors.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.flight.packing import mass_properties, masses_of
from gliderhpc.platform import CUBIC_CENTIMETRE, Platform, ballast_masses
from gliderhpc.platform_sections import CalibrationErrors, Uncertainty, number_at
from gliderhpc.shipped import nearest
from gliderhpc.vocabulary import HULL_PARAMETERS

Array = NDArray[np.float64]

_DIGITS = 6
"""Digits of numbers in a platform file."""


def _zero(_: Platform) -> float:
    return 0.0


@dataclass(frozen=True)
class HullParameter:
    """One number of the platform file.

    Attributes
    ----------
    key : str
        Key in the platform file; ``position.hull.2`` is the third number of a list.
    unit, meaning : str
        Unit and description for the tables.
    spread : callable
        Plausible standard deviation about a platform's value where its file states none: in the file's unit, or
        relative if `factor` is true.
    factor : bool
        Whether the number varies by factors and hence keeps its sign: a step adds to its logarithm.
    origin : callable
        Value (in the file's unit) at which the quantity behind the number vanishes; a factor multiplies the difference
        from it.
    usual_walk : float
        Random walk where the platform file states none, in the unit of the deviation per square root of a day.
    """

    key: str
    unit: str
    meaning: str
    spread: Callable[[Platform], float]
    factor: bool = False
    origin: Callable[[Platform], float] = _zero
    usual_walk: float = 0.0

    def value(self, platform: Platform) -> float:
        """Return the value in the file's unit; zero for `TREND`, which is not in the file."""
        return 0.0 if self is TREND else float(number_at(platform, self.key))

    def deviation(self, platform: Platform) -> float:
        """Return the plausible deviation, the platform file's or the usual one; relative if `factor` is true.

        Otherwise it is in the file's unit.
        """
        stated = {} if platform.uncertainty is None else platform.uncertainty.deviation
        return stated[self.key] if self.key in stated else self.spread(platform)

    def walk(self, platform: Platform) -> float:
        """Return the random walk, the platform file's or the usual one, in plausible deviations per root of a day."""
        stated = {} if platform.uncertainty is None else platform.uncertainty.walk
        return stated.get(self.key, self.usual_walk) / self.deviation(platform)

    def moved(self, platform: Platform, steps: float) -> float:
        """Return the value that lies `steps` plausible deviations from a platform's; infinite beyond all numbers."""
        start, deviation = self.value(platform), self.deviation(platform)
        if not self.factor:
            return start + deviation * steps
        origin = self.origin(platform)
        exponent = deviation * steps
        return origin + (start - origin) * (math.inf if exponent > 700.0 else math.exp(exponent))

    def slope(self, platform: Platform, steps: float) -> float:
        """Return the derivative of `moved` with respect to `steps`."""
        deviation = self.deviation(platform)
        return deviation * (self.moved(platform, steps) - self.origin(platform)) if self.factor else deviation

    def steps(self, platform: Platform, value: float) -> float:
        """Return the plausible deviations between a platform's value and another: the inverse of `moved`."""
        start, deviation = self.value(platform), self.deviation(platform)
        if not self.factor:
            return (value - start) / deviation
        origin = self.origin(platform)
        return math.log((value - origin) / (start - origin)) / deviation


def with_values(platform: Platform, values: Mapping[str, float | None]) -> Platform:
    """Return a platform with some of its numbers replaced, by key and without checks."""
    content: dict[str, Any] = {}
    for key, value in values.items():
        section, *rest = key.split(".")
        content[section] = _replaced(content.get(section, getattr(platform, section)), rest, value)
    return platform.model_copy(update=content)


def _replaced(node: Any, rest: list[str], value: float | None) -> Any:
    """Return a section, list or number with the number at the remaining parts of a key replaced."""
    if not rest:
        return value
    name, *deeper = rest
    if isinstance(node, tuple):
        return tuple(value if str(i) == name else number for i, number in enumerate(node))
    return node.model_copy(update={name: _replaced(getattr(node, name), deeper, value)})


def with_covariance(platform: Platform, errors: CalibrationErrors) -> Platform:
    """Return a platform with the errors that remain after a calibration; its plausible deviations are unchanged."""
    uncertainty = Uncertainty() if platform.uncertainty is None else platform.uncertainty
    return platform.model_copy(update={"uncertainty": uncertainty.model_copy(update={"covariance": errors})})


def errors_in_units(
    platform: Platform, parameters: Sequence[HullParameter], steps: Array, covariance: Array
) -> CalibrationErrors:
    """Errors of parameters in the units of the platform file.

    Parameters
    ----------
    platform : Platform
        Hull from which the steps are measured.
    parameters : sequence of HullParameter
        Parameters whose errors are known.
    steps, covariance : (p,), (p, p)
        Estimates and their covariance, in plausible deviations.

    Notes
    -----
    A number that varies by factors and is negative falls as its step grows, which reverses its correlations.
    """
    slope = np.array([p.slope(platform, float(x)) for p, x in zip(parameters, steps, strict=True)])
    deviation, sign = np.sqrt(np.diag(covariance)), np.where(slope < 0.0, -1.0, 1.0)
    correlation = covariance / np.outer(sign * deviation, sign * deviation)
    return CalibrationErrors(
        parameters=tuple(p.key for p in parameters),
        deviation=tuple(round_number(value) for value in (deviation * np.abs(slope)).tolist()),
        correlation=tuple(tuple(round_number(x) for x in row[:i]) for i, row in enumerate(correlation.tolist())),
    )


def round_number(value: float) -> float:
    """Round to the digits of a platform file."""
    return float(f"{value:.{_DIGITS}g}") + 0.0  # Without the sign of a zero.


def stated_covariance(platform: Platform, parameters: Sequence[HullParameter]) -> Array:
    """Covariance ``(p, p)`` of a hull's errors, in plausible deviations, from the platform file.

    It is that of its calibration, the inverse of `errors_in_units`, and one for parameters without a calibration.
    """
    covariance, names = np.eye(len(parameters)), [p.key for p in parameters]
    stated = None if platform.uncertainty is None else platform.uncertainty.covariance
    if stated is None:
        return covariance
    # A zero that varies by factors, such as thermal expansion, has no deviation to scale by.
    slopes = {key: parameters[names.index(key)].slope(platform, 0.0) for key in stated.parameters if key in names}
    theirs = [i for i, key in enumerate(stated.parameters) if slopes.get(key, 0.0) != 0.0]
    mine = [names.index(stated.parameters[i]) for i in theirs]
    slope = np.array([slopes[stated.parameters[i]] for i in theirs])
    covariance[np.ix_(mine, mine)] = stated.covariance[np.ix_(theirs, theirs)] / np.outer(slope, slope)
    return covariance


def with_deviations_of(platform: Platform, found: Platform) -> Platform:
    """Return a hull found with the plausible deviations that the platform file states."""
    stated = {} if platform.uncertainty is None else platform.uncertainty.deviation
    if found.uncertainty is None or found.uncertainty.deviation == stated:
        return found
    entries = {name: getattr(found.uncertainty, name) for name in found.uncertainty.model_fields_set - {"deviation"}}
    if stated:
        entries["deviation"] = stated
    return found.model_copy(update={"uncertainty": Uncertainty(**entries)})


def righting_moment(platform: Platform) -> float:
    """Return the first moment S_z at the neutral oil volume with the battery upright, kg m."""
    outside, inside = ballast_masses(platform, platform.buoyancy.neutral_volume_m3)
    neutral = np.array([[0.0, 0.0, float(outside), float(inside), 0.0, 0.0]])
    return float(mass_properties(masses_of(platform), neutral)[0, 2])


def _relative(part: float) -> Callable[[Platform], float]:
    return lambda _: part


def _absolute(value: float) -> Callable[[Platform], float]:
    return lambda _: value


def _of(name: str, part: float) -> Callable[[Platform], float]:
    return lambda platform: part * abs(getattr(platform.viscous, name))


def _volume(platform: Platform) -> float:
    """Return the volume of water of 0.5 % of the hull's mass, cm3; operators ballast more accurately than that."""
    return 0.005 * platform.mass.total / platform.buoyancy.water_density / CUBIC_CENTIMETRE


def _righting(part: float) -> Callable[[Platform], float]:
    """Return the displacement of the hull's mass that changes the righting moment by a given fraction, m."""
    return lambda platform: part * abs(righting_moment(platform)) / platform.mass.hull


def _without_righting(platform: Platform) -> float:
    """Return the z of the hull's mass at which the righting moment, which keeps its sign as drag does, vanishes, m."""
    return platform.position.hull[2] - righting_moment(platform) / platform.mass.hull


def _lag_deviation(platform: Platform) -> float:
    """Return a second, or half a sample interval if that is longer, s."""
    return max(1.0, 0.5 * platform.sensors.sample_interval)


ACTUATOR_LAG = "sensors.actuator_lag"
"""Key of the only error of the records that does not change the measured attitude or depth: it delays the controls."""

TYPICAL_COMPRESSIBILITY, TYPICAL_EXPANSION = 4.5e-6, 6e-5
"""Values for a hull that states none, 1/dbar and 1/K; published ones range from 4e-6 to 6e-6 and from 5e-5 to 7e-5."""


def compressible(platform: Platform) -> Platform:
    """Give a hull the typical compressibility and thermal expansion where it states none."""
    missing: dict[str, float | None] = {}
    if platform.buoyancy.compressibility is None:
        missing["buoyancy.compressibility"] = TYPICAL_COMPRESSIBILITY
    if "thermal_expansion" not in platform.buoyancy.model_fields_set:
        missing["buoyancy.thermal_expansion"] = TYPICAL_EXPANSION
    return with_values(platform, missing)


_NEUTRAL_VOLUME = HullParameter("buoyancy.neutral_volume", "cm3", "neutral oil volume", _volume, usual_walk=2.0)

_REMAINING: tuple[HullParameter, ...] = (
    HullParameter("viscous.K_D0", "kg/m", "drag at zero angle of attack", _relative(0.4), factor=True, usual_walk=0.02),
    HullParameter("viscous.K_D", "kg/m/rad2", "drag over angle of attack squared", _relative(0.3), factor=True),
    HullParameter(
        "viscous.K_L", "kg/m/rad", "lift over angle of attack", _relative(0.3), factor=True, usual_walk=0.005
    ),
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
    HullParameter("position.hull.1", "m", "roll trim (hull's mass to starboard)", _righting(0.1), usual_walk=2e-5),
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
"""Parameters that steady glides may determine."""

PARAMETERS_BY_DENSITY: tuple[HullParameter, ...] = (
    _NEUTRAL_VOLUME,
    HullParameter("buoyancy.compressibility", "1/dbar", "compressibility of the hull", _relative(0.35), factor=True),
    HullParameter("buoyancy.thermal_expansion", "1/K", "thermal expansion of the hull", _relative(0.5), factor=True),
    *_REMAINING,
)
"""Parameters that steady glides may determine if the buoyancy is computed from measured density."""

_OF_MOTION: tuple[HullParameter, ...] = (
    HullParameter("viscous.K_p", "kg s/rad", "roll damping", _relative(0.3), factor=True),
    HullParameter("viscous.K_q", "kg s/rad", "pitch damping", _relative(0.3), factor=True),
    HullParameter("added_mass.1", "kg", "added mass in sway", _relative(0.2), factor=True),
    HullParameter("added_mass.2", "kg", "added mass in heave", _relative(0.2), factor=True),
    # These represent the whole inertia: hardly any motion separates the added inertia from the hull's own.
    HullParameter("added_inertia.0", "kg m2", "added inertia in roll", _relative(0.3), factor=True),
    HullParameter("added_inertia.1", "kg m2", "added inertia in pitch", _relative(0.3), factor=True),
    HullParameter("added_inertia.2", "kg m2", "added inertia in yaw", _relative(0.3), factor=True),
)
"""Parameters that steady glides do not determine, although `UNFITTED_MOTION` acts on them."""

_LIFT_OFFSET = HullParameter("viscous.K_L0", "kg/m", "lift at zero angle of attack", _of("K_L", 0.02))

_RUDDER = "viscous.K_delta"

_HARMONICS = ("sine", "cosine", "sine of twice the heading", "cosine of twice the heading")

RECORD_PARAMETERS: tuple[HullParameter, ...] = (
    HullParameter("sensors.roll_offset", "degree", "offset of the roll", _absolute(1.0)),
    HullParameter("sensors.pitch_offset", "degree", "offset of the pitch", _absolute(1.0), usual_walk=0.05),
    HullParameter("sensors.pitch_scale", "1", "scale of the pitch", _relative(0.02), factor=True),
    HullParameter("sensors.heading_offset", "degree", "offset of the heading", _absolute(1.5)),
    *(
        HullParameter(f"sensors.heading_deviation.{i}", "degree", f"deviation of the heading, {name}", _absolute(size))
        for i, (name, size) in enumerate(zip(_HARMONICS, (1.0, 1.0, 0.5, 0.5), strict=True))
    ),
    HullParameter("sensors.depth_lag", "s", "lag of the depth behind the attitude", _absolute(0.5)),
    HullParameter(ACTUATOR_LAG, "s", "lag of the actuators behind their records", _lag_deviation),
)
"""Errors of the records, which the section `sensors` of a platform corrects."""

ATTITUDE_PARAMETERS = RECORD_PARAMETERS[:3]
"""Errors of the measured roll and pitch, to which steady glides respond."""

UNFITTED_MOTION = _OF_MOTION[:4]
"""Parameters of the motion that act in steady glides like others: damping of roll and pitch in turns, and the added
masses, whose moment over angle of attack and sideslip (the Munk moment) adds to that of `K_M` and `K_MY`."""

ONLY_IN_MANOEUVRES = frozenset({
    "viscous.K_beta", "viscous.K_MR", "viscous.K_MY", "viscous.K_r", "viscous.K_delta", "viscous.K_p", "viscous.K_q",
    "added_mass.1", "added_inertia.0", "added_inertia.1", "added_inertia.2",
})  # fmt: skip
"""Parameters without effect on straight steady glide, so that ballast and trim in pitch do not depend on them."""

ROLL_OFFSET = ATTITUDE_PARAMETERS[0]
"""The one of them that steady glides determine, by turns."""

TREND = HullParameter("trend", "cm3/day", "trend of the neutral volume", _absolute(1.0))
"""Not in the platform file; fitted on request."""


def hull_parameters(platform: Platform) -> tuple[HullParameter, ...]:
    """Return the parameters of a hull and its records that may be in error and have an effect.

    A coefficient of zero that varies by factors has none. Lift at zero angle of attack and the rudder's moment are
    included if the platform file states them. If it states a compressibility, the buoyancy is computed from that
    instead of the depth slope.
    """
    steady = PARAMETERS if platform.buoyancy.compressibility is None else PARAMETERS_BY_DENSITY
    stated = platform.viscous.model_fields_set
    catalogue = [p for p in steady if p.key != _RUDDER or "K_delta" in stated]
    catalogue += [_LIFT_OFFSET] if "K_L0" in stated else []
    return tuple(p for p in (*catalogue, *_OF_MOTION, *RECORD_PARAMETERS) if _acts(p, platform))


def _acts(parameter: HullParameter, platform: Platform) -> bool:
    return parameter.deviation(platform) > 0.0 and parameter.slope(platform, 0.0) != 0.0


def moved_platform(platform: Platform, parameters: Sequence[HullParameter], eta: Array) -> Platform:
    """Return the hull, including its sensors' errors, that differs by ``eta`` from a platform.

    Parameters
    ----------
    platform : Platform
        The reference hull, at which ``eta`` is zero.
    parameters : sequence of HullParameter
        Numbers to change.
    eta : (p,)
        Changes in plausible deviations; a number whose change is zero keeps its exact value.
    """
    return with_values(
        platform, {p.key: p.moved(platform, x) for p, x in zip(parameters, eta.tolist(), strict=True) if x != 0.0}
    )


def among_parameters(values: Array, keys: Sequence[str], labels: Sequence[str] = HULL_PARAMETERS) -> Array:
    """Put values ``(..., p)`` of parameters at their places among all ``(..., n)``, with NaN for the others.

    Parameters
    ----------
    values : (..., p) array
        Values, one for each of the parameters `keys` along the last axis.
    keys, labels : sequence of str
        Keys of these parameters, and of all.
    """
    out = np.full((*values.shape[:-1], len(labels)), np.nan)
    out[..., [labels.index(key) for key in keys]] = values
    return out


def check_uncertainty(platform: Platform) -> None:
    """Refuse a plausible deviation or a walk of a number that is not in the catalogue.

    Raises
    ------
    InputError
        There is such a number; the message names its key.
    """
    if platform.uncertainty is None:
        return
    steady = (*PARAMETERS, *PARAMETERS_BY_DENSITY)
    known = dict.fromkeys(p.key for p in (*steady, _LIFT_OFFSET, *_OF_MOTION, *RECORD_PARAMETERS))
    for entry in ("deviation", "walk"):
        for key in platform.uncertainty.keys[entry]:
            if key not in known:
                raise InputError(
                    f"platform {platform.name}: uncertainty.{entry} names '{key}', which is not a parameter with an "
                    f"uncertainty{nearest(key, known)}; the parameters are {', '.join(known)}"
                )
