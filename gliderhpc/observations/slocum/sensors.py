"""The native sensors that an import needs, by the vehicle's own names (its `masterdata`).

A positive ``m_roll`` is starboard down, a positive ``m_pitch`` nose up, a positive ``m_battpos`` forward of the middle
(nose down), a positive ``m_fin`` turns the vehicle to starboard; the volumes are positive where they make it float.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sensor:
    """One native sensor.

    Attributes
    ----------
    name : str
        The vehicle's name of it.
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
