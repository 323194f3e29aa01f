"""Plausible ranges of a platform file's numbers, which follow from the glider's mass.

The ranges are a factor of 30 around the values of the shipped hulls, scaled to the mass of the glider at the same
shape: lengths with its cube root, areas with the square of a length, and so on.
"""

from collections.abc import Mapping

from gliderhpc.errors import InputError
from gliderhpc.platform_sections import Section, number_at

_FACTOR = 30.0
"""Factor around a typical value within which a number is plausible."""

_TYPICAL_MASS, _MASSES = 63.0, (1.0, 15_000.0)
"""Mass (kg) of the typical values, and range of plausible masses; gliders have 20 to 850 kg."""

_LENGTH, _AREA, _VOLUME, _MOMENT, _DAMPING = 1.0, 2.0, 3.0, 5.0, 4.0
"""Powers of a length with which numbers grow: the last two are moments of inertia, and damping by the rate."""

_TWO_SIDED: Mapping[str, tuple[float, float, str]] = {
    "inertia.0": (0.6, _MOMENT, "kg m2"),
    "inertia.1": (15.0, _MOMENT, "kg m2"),
    "inertia.2": (15.0, _MOMENT, "kg m2"),
    "viscous.K_D0": (7.0, _AREA, "kg/m"),
    "viscous.K_L": (370.0, _AREA, "kg/m/rad"),
    "viscous.K_beta": (100.0, _AREA, "kg/m/rad"),
}
"""Typical magnitude, power of a length and unit of the numbers that are neither much larger nor much smaller."""

_ONE_SIDED: Mapping[str, tuple[float, float, str]] = {
    "added_mass.0": (2.5, _VOLUME, "kg"),
    "added_mass.1": (60.0, _VOLUME, "kg"),
    "added_mass.2": (70.0, _VOLUME, "kg"),
    "added_inertia.0": (0.4, _MOMENT, "kg m2"),
    "added_inertia.1": (10.0, _MOMENT, "kg m2"),
    "added_inertia.2": (10.0, _MOMENT, "kg m2"),
    "buoyancy.neutral_volume": (500.0, _VOLUME, "cm3"),
    "battery_eccentricity": (0.02, _LENGTH, "m"),
    "position.battery": (0.3, _LENGTH, "m"),
    "position.bladder.0": (0.7, _LENGTH, "m"),
    "position.reservoir.0": (0.5, _LENGTH, "m"),
    "position.hull.0": (0.1, _LENGTH, "m"),
    "position.hull.2": (0.02, _LENGTH, "m"),
    "viscous.K_D": (350.0, _AREA, "kg/m/rad2"),
    "viscous.K_M": (70.0, _VOLUME, "kg/rad"),
    "viscous.K_MR": (50.0, _VOLUME, "kg/rad"),
    "viscous.K_MY": (50.0, _VOLUME, "kg/rad"),
    "viscous.K_p": (20.0, _DAMPING, "kg s/rad"),
    "viscous.K_q": (200.0, _DAMPING, "kg s/rad"),
    "viscous.K_r": (300.0, _DAMPING, "kg s/rad"),
    "sensors.depth_noise": (0.04, 0.0, "m"),
}
"""The same of those that may be small or zero: a calibration may leave a coefficient without effect, and a pressure
sensor may resolve a millimetre."""


def check_plausible(label: str, platform: Section) -> None:
    """Refuse numbers that no glider has.

    Parameters
    ----------
    label : str
        Name of the platform in the message.
    platform : gliderhpc.platform.Platform
        The platform, valid key by key.

    Raises
    ------
    InputError
        There is such a number; the message names the key, its value, the plausible range and the remedy.
    """
    mass = float(number_at(platform, "mass.total"))
    if not _MASSES[0] <= mass <= _MASSES[1]:
        raise InputError(
            f"{label}: mass.total is {mass:g} kg, but gliders have {_MASSES[0]:g} to {_MASSES[1]:g} kg; correct it"
        )
    scale = (mass / _TYPICAL_MASS) ** (1.0 / 3.0)
    for key, (typical, power, unit) in {**_TWO_SIDED, **_ONE_SIDED}.items():
        value = float(number_at(platform, key))
        high = _FACTOR * typical * scale**power
        low = typical * scale**power / _FACTOR if key in _TWO_SIDED else 0.0
        if not low <= abs(value) <= high:
            of = f" for a glider of {mass:g} kg" if power else ""
            raise InputError(
                f"{label}: {key} is {value:g} {unit}, but plausible{of} is a magnitude of {low:.2g} to {high:.2g} "
                f"{unit}; correct it, or convert it to {unit}"
            )
