"""Units that Slocum files declare, and the way from each to that of the observation format."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import decimal_degrees
from gliderhpc.observations.records import FloatArray

Conversion = Callable[[FloatArray], FloatArray]


def _times(factor: float, values: FloatArray) -> FloatArray:
    return values * factor


def _scales(*groups: tuple[float, str]) -> dict[str, Conversion]:
    """Conversions from groups of spellings that mean one scale."""
    return {unit: partial(_times, factor) for factor, units in groups for unit in units.split()}


_DEGREE = "deg degree degrees"
_ACCEPTED: Mapping[str, Mapping[str, Conversion]] = {
    "angle in degree": _scales((float(np.degrees(1.0)), "rad radian radians"), (1.0, _DEGREE)),
    "length in m": _scales(
        (1.0, "m meter meters metre metres"), (0.0254, "in inch inches"), (0.01, "cm"), (1e-3, "mm")
    ),
    "volume in cm3": _scales((1.0, "cc cm3 cm^3 ml"), (1e3, "l liter litre"), (1e6, "m3 m^3")),
    "pressure in dbar": _scales((10.0, "bar"), (1.0, "dbar decibar"), (1e-4, "pa"), (0.01, "mbar hpa")),
    "temperature in degC": _scales((1.0, "degc c celsius degree_c degrees_c deg_c degree_celsius degrees_celsius")),
    "conductivity in mS/cm": _scales((10.0, "s/m s.m-1"), (1.0, "ms/cm ms.cm-1")),
    "position in degree": {"lat": decimal_degrees, "lon": decimal_degrees, "ddmm.mmmm": decimal_degrees}
    | _scales((1.0, f"{_DEGREE} degrees_north degree_north degrees_east degree_east")),
    "state": _scales((1.0, "enum nodim 1 bool")),
}
"""Every quantity with the unit it is converted to, and what is accepted; spelling does not mind capitals."""


def conversion(quantity: str, unit: str | None, where: str) -> Conversion:
    """Return the way from a declared unit to that of the observation format.

    Parameters
    ----------
    quantity : str
        What is measured and in which unit it is wanted, as in ``length in m``.
    unit : str or None
        What the file declares; None where it declares nothing. A state needs no unit.
    where : str
        File and sensor, for the message.

    Raises
    ------
    InputError
        No unit is declared, or one that does not measure this quantity.
    """
    accepted = _ACCEPTED[quantity]
    known = ", ".join(accepted)
    if unit is None and quantity != "state":
        raise InputError(f"{where} declares no unit; give it a units attribute, one of {known}")
    found = accepted.get((unit or "1").strip().lower())
    if found is None:
        raise InputError(
            f"{where} is in '{unit}', which is no {quantity.partition(' ')[0]}; it must be in one of {known}"
        )
    return found
