"""Units as other programs' files spell them, and the factor from each to the unit that is wanted."""

from collections.abc import Mapping

import numpy as np


def _scales(*groups: tuple[float, str]) -> dict[str, float]:
    """Factors from groups of spellings, parted by commas, that mean one scale."""
    return {spelling: factor for factor, spellings in groups for spelling in spellings.split(", ")}


FACTORS: Mapping[str, Mapping[str, float]] = {
    "m": _scales(
        (1.0, "m, meter, meters, metre, metres"), (0.01, "cm, centimeter, centimeters"), (1e-3, "mm"),
        (0.0254, "in, inch, inches"),
    ),
    "degree": _scales(
        (1.0, "deg, degree, degrees, degrees_north, degree_north, degrees_east, degree_east"),
        (float(np.degrees(1.0)), "rad, radian, radians"),
    ),
    "m s-1": _scales((1.0, "m s-1, m/s, m.s-1"), (0.01, "cm/s, cm s-1")),
    "dbar": _scales((1.0, "dbar, decibar"), (10.0, "bar"), (0.01, "mbar, hpa"), (0.1, "kpa"), (1e-4, "pa")),
    "degC": _scales((1.0, "degc, c, celsius, degree_c, degrees_c, deg_c, degree_celsius, degrees_celsius")),
    "mS/cm": _scales((1.0, "ms/cm, ms.cm-1"), (10.0, "s/m, s.m-1")),
    "1": _scales((1.0, "1, 1e-3, 0.001, psu")),
    "cm3": _scales((1.0, "cm3, cm^3, cc, ml"), (1e3, "l, liter, litre"), (1e6, "m3, m^3")),
    "s": _scales((1.0, "s, sec, secs, second, seconds")),
    "kg": _scales((1.0, "kg"), (1e-3, "g")),
}  # fmt: skip
"""Factors by the unit wanted and the spelling of the unit declared, in small letters."""
