"""Native sensors that an import needs, by the vehicle's own names (its `masterdata`), their units and the clock.

A positive ``m_roll`` is starboard down, a positive ``m_pitch`` nose up, a positive ``m_battpos`` forward of the middle
(nose down), a positive ``m_fin`` turns the vehicle to starboard; the volumes are positive where they make it float.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import decimal_degrees
from gliderhpc.observations.foreign import FACTORS
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Rows
from gliderhpc.observations.times import EARLIEST, LATEST


@dataclass(frozen=True)
class Sensor:
    """One native sensor.

    Attributes
    ----------
    name : str
        The vehicle's name.
    quantity : str
        What is measured and in which unit, as in ``length in m``; values are in that unit from the reading of the file
        on.
    low, high : float
        A value outside is junk and counts as missing.
    required : str or None
        What is lost without it, where the import cannot do without.
    """

    name: str
    quantity: str
    low: float
    high: float
    required: str | None = None


_ANGLE, _LENGTH, _VOLUME, _POSITION = "angle in degree", "length in m", "volume in cm3", "position in degree"

FLIGHT_SENSORS = (
    Sensor("m_depth", _LENGTH, -10.0, 2000.0, "depth"),
    Sensor("m_pitch", _ANGLE, -89.9, 89.9, "attitude"),
    Sensor("m_roll", _ANGLE, -180.0, 180.0, "attitude"),
    Sensor("m_heading", _ANGLE, -180.0, 360.0, "attitude"),
    Sensor("m_battpos", _LENGTH, -0.5, 0.5, "battery position"),
    Sensor("m_ballast_pumped", _VOLUME, -2000.0, 2000.0),
    Sensor("m_de_oil_vol", _VOLUME, -2000.0, 2000.0),
    Sensor("m_fin", _ANGLE, -90.0, 90.0),
    Sensor("m_gps_lat", _POSITION, -90.0, 90.0),
    Sensor("m_gps_lon", _POSITION, -180.0, 180.0),
    Sensor("m_gps_status", "state", 0.0, 255.0),
    Sensor("m_gps_mag_var", _ANGLE, -180.0, 180.0),
)
"""Sensors of the flight computer. The shallow vehicle has ``m_ballast_pumped``, the deep one ``m_de_oil_vol``."""

SCIENCE_SENSORS = (
    Sensor("sci_water_temp", "temperature in degC", -5.0, 45.0),
    Sensor("sci_water_pressure", "pressure in dbar", -20.0, 2100.0),
    Sensor("sci_water_cond", "conductivity in mS/cm", 0.5, 90.0),
)
"""Sensors of the science computer: the CTD. It is turned off, or logs zeros, while the vehicle is out of the water."""

BALLAST_SENSORS = ("m_ballast_pumped", "m_de_oil_vol")

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


_EARLIEST, _LATEST = (float((time - np.datetime64(0, "s")) / np.timedelta64(1, "s")) for time in (EARLIEST, LATEST))
"""A clock that is not set says 1970."""


def rows_of_seconds(seconds: FloatArray, part: int, columns: dict[str, FloatArray]) -> Rows:
    """Rows of one file from its clock; a time that no glider flew at becomes missing (NaT)."""
    plausible = (seconds > _EARLIEST) & (seconds < _LATEST)
    nanoseconds = np.rint(np.where(plausible, seconds, 0.0) * 1e9).astype(np.int64).astype("datetime64[ns]")
    nanoseconds[~plausible] = np.datetime64("NaT", "ns")
    return Rows(nanoseconds, np.full(len(seconds), part, dtype=np.int64), columns)
