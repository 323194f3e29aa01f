"""Units that Slocum files declare, and the way from each to that of the observation format."""

from collections.abc import Callable, Mapping
from functools import partial

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import decimal_degrees
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.units import FACTORS

Conversion = Callable[[FloatArray], FloatArray]


def _times(factor: float, values: FloatArray) -> FloatArray:
    return values * factor


def _accepted(quantity: str) -> Mapping[str, Conversion]:
    """Conversions of a quantity by the spelling of the unit declared, in small letters."""
    if quantity == "state":
        return {unit: partial(_times, 1.0) for unit in ("enum", "nodim", "1", "bool")}
    what, _, wanted = quantity.partition(" in ")
    scales: dict[str, Conversion] = {unit: partial(_times, factor) for unit, factor in FACTORS[wanted].items()}
    return dict.fromkeys(("lat", "lon", "ddmm.mmmm"), decimal_degrees) | scales if what == "position" else scales


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
    accepted = _accepted(quantity)
    known = ", ".join(accepted)
    if unit is None and quantity != "state":
        raise InputError(f"{where} declares no unit; give it a units attribute, one of {known}")
    found = accepted.get((unit or "1").strip().lower())
    if found is None:
        raise InputError(
            f"{where} is in '{unit}', which is no {quantity.partition(' ')[0]}; it must be in one of {known}"
        )
    return found
