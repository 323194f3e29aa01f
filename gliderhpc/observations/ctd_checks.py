"""CTD samples that cannot be measurements of the water: temperatures or salinities that the sea and lakes never have.

A sensor that is switched off, and a fill value that is not declared, give a salinity of exactly zero; rain and melt
water have a few thousandths. Salinities in kg/kg are a thousandth of the practical ones.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

PLAUSIBLE_TEMPERATURE = (-2.6, 45.0)
PLAUSIBLE_SALINITY = (0.0, 42.0)
"""Plausible ranges (degC; practical salinity); samples outside, and a salinity of exactly zero, count as missing."""

MAX_SALINITY_IN_KG = 0.045
"""Practical salinity up to which that of a whole profile is suspected to be in kg/kg: the sea has up to 0.042 kg/kg,
and the lakes in which gliders fly have a practical salinity of 0.05 and more."""

_WHOLE_PROFILE = 0.95
"""Share of the samples that count as the whole profile, since a record contains spikes."""


def plausible_water(temperature: FloatArray, salinity: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask ``(m,)`` of the samples with a plausible temperature (degC) and practical salinity, ``(m,)`` each."""
    return _is_plausible_temperature(temperature) & _is_plausible_salinity(salinity)


def _is_plausible_temperature(temperature: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the temperatures in the plausible range; NaN compares false, as it is missing."""
    low, high = PLAUSIBLE_TEMPERATURE
    return np.asarray((temperature >= low) & (temperature <= high))


def _is_plausible_salinity(salinity: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the practical salinities in the plausible range, without zero."""
    low, high = PLAUSIBLE_SALINITY
    return np.asarray((salinity > low) & (salinity <= high))


def fault_of_water(temperature: FloatArray, salinity: FloatArray) -> str | None:
    """Describe why the samples of a profile cannot be measurements of its water; None if some are.

    Parameters
    ----------
    temperature, salinity : (m,) array
        Temperature (degC) and practical salinity; NaN where missing, each with some value.

    Returns
    -------
    str or None
        Name of the variable, its values and the remedy.
    """
    warm, salty = _is_plausible_temperature(temperature), _is_plausible_salinity(salinity)
    if not warm.any():
        low, high = PLAUSIBLE_TEMPERATURE
        return (
            f"temperature is {_extent(temperature)} degC, outside {low:g} to {high:g} degC; if it is in kelvin, "
            "convert it to degC"
        )
    if not salty.any():
        return _fault_of_salinity(salinity)
    if np.quantile(salinity[salty], _WHOLE_PROFILE) <= MAX_SALINITY_IN_KG:
        return (
            f"practical_salinity is {_extent(salinity[salty])}, fresher than nearly any lake, as if it was in kg/kg; "
            "multiply it by 1000"
        )
    if not (warm & salty).any():
        return "no sample with both temperature and practical_salinity in their plausible range"
    return None


def _fault_of_salinity(salinity: FloatArray) -> str:
    """Describe practical salinities that are all implausible."""
    low, high = PLAUSIBLE_SALINITY
    if not salinity[np.isfinite(salinity)].any():
        return "practical_salinity is 0 in all samples, as if it was not measured; correct it or mark it missing (NaN)"
    return (
        f"practical_salinity is {_extent(salinity)}, outside its plausible range, {low:g} to {high:g}; correct it or "
        "mark it missing (NaN)"
    )


def _extent(values: FloatArray) -> str:
    """Format the least and the greatest of the known values; a single number if they are equal."""
    low, high = (f"{limit:.4g}" for limit in (np.nanmin(values), np.nanmax(values)))
    return low if low == high else f"between {low} and {high}"
