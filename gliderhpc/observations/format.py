"""The observation format as data: every variable with its unit, its plausible range and its CF names.

Reader, validator and writer all use this table, so the format is defined once. Files may also hold reference
quantities (the source's own current, speed and flight model), which no estimate uses.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from gliderhpc.observations.files.columns import bare_unit

CONVENTIONS = "CF-1.11"

ARCHIVE_SCHEMA = "gliderhpc-mission"
"""Attribute `schema` of an archive of results, by which it is recognised where records are expected."""

_SPELLINGS: dict[str, frozenset[str]] = {
    "m": frozenset({"m", "meter", "meters", "metre", "metres"}),
    "degree": frozenset(
        {"degree", "degrees", "deg", "arc_degree", "arc_degrees", "°", "degree_true", "degrees_true", "degrees true"}
        | {"degree_T", "degrees_T", "degreeT", "degreesT"}
    ),
    "degrees_north": frozenset(
        {"degrees_north", "degree_north", "degree_N", "degrees_N", "degreeN", "degreesN", "degree", "degrees", "deg"}
    ),
    "degrees_east": frozenset(
        {"degrees_east", "degree_east", "degree_E", "degrees_E", "degreeE", "degreesE", "degree", "degrees", "deg"}
    ),
    "cm3": frozenset({"cm3", "cc", "ml", "mL", "milliliter", "milliliters", "millilitre", "millilitres"}),
    "1": frozenset({"1", ""}),
    "salinity": frozenset({"1", "", "1e-3", "0.001", "psu", "PSU"}),
    "degC": frozenset({"degC", "celsius", "Celsius", "degree_C", "degree_Celsius", "degrees_C", "degrees_Celsius"}),
    "dbar": frozenset({"dbar", "decibar", "decibars"}),
    "m s-1": frozenset({"m s-1", "m/s", "m.s-1", "m*s-1", "meter second-1", "metre second-1", "meters per second"}),
}

_SI_FACTORS = {"degree": math.pi / 180.0, "cm3": 1e-6}


@dataclass(frozen=True)
class Variable:
    """One variable of the observation format.

    Attributes
    ----------
    name, dimension, unit, long_name : str
        Name, dimension and attributes in a file.
    standard_name : str or None
        Its CF standard name, if it has one.
    required : bool
        True if a file without it is refused.
    low, high : float
        Plausible range; values outside are faults.
    open_ended : bool
        True if the limits themselves are outside the range.
    quantity : str or None
        Key of the accepted unit spellings, if it differs from `unit`.
    """

    name: str
    dimension: str
    unit: str
    long_name: str
    standard_name: str | None = None
    required: bool = False
    low: float = float("-inf")
    high: float = float("inf")
    open_ended: bool = False
    quantity: str | None = None

    def accepts_unit(self, text: str) -> bool:
        """Return whether `text` is a CF spelling of this variable's unit."""
        bare = bare_unit(text).replace("**", "").replace("^", "")
        return not {bare, bare.lower()}.isdisjoint(_SPELLINGS[self.quantity or self.unit])

    @property
    def dimensionless(self) -> bool:
        """Return whether a missing ``units`` attribute means the unit 1."""
        return "" in _SPELLINGS[self.quantity or self.unit]

    @property
    def si_factor(self) -> float:
        """Factor from the unit in the file to that of a `ProfileRecord`: radians and m3 for degrees and cm3."""
        return _SI_FACTORS.get(self.unit, 1.0)


_TABLE = (
    Variable("depth", "time", "m", "depth below the surface", "depth", True, -10.0, 11_000.0),
    Variable("roll", "time", "degree", "roll, starboard down", "platform_roll_starboard_down", True, -180.0, 180.0),
    Variable("pitch", "time", "degree", "pitch, nose up", "platform_pitch_fore_up", True, -90.0, 90.0, open_ended=True),
    Variable(
        "heading", "time", "degree", "heading, clockwise from true north", "platform_orientation", True, -180.0, 360.0
    ),
    Variable("battery_position", "time", "m", "translation of the moving battery, forward", None, True, -1.0, 1.0),
    Variable("battery_rotation", "time", "degree", "rotation of the moving battery", None, True, -180.0, 180.0),
    Variable("ballast_volume", "time", "cm3", "oil in the external bladder", None, True, -10_000.0, 10_000.0),
    Variable("rudder", "time", "degree", "rudder angle", None, False, -90.0, 90.0),
    Variable("profile", "time", "1", "number of the profile, 0 outside any"),
    Variable("temperature", "time", "degC", "temperature of the water", "sea_water_temperature"),
    Variable(
        "practical_salinity",
        "time",
        "1",
        "practical salinity of the water",
        "sea_water_practical_salinity",
        quantity="salinity",
    ),
    Variable("pressure", "time", "dbar", "pressure of the water", "sea_water_pressure"),
    Variable("relative_velocity_u", "time", "m s-1", "velocity relative to the water, forward"),
    Variable("relative_velocity_v", "time", "m s-1", "velocity relative to the water, starboard"),
    Variable("relative_velocity_w", "time", "m s-1", "velocity relative to the water, downward in the body frame"),
    Variable("relative_velocity_u_std", "time", "m s-1", "standard deviation of relative_velocity_u"),
    Variable("relative_velocity_v_std", "time", "m s-1", "standard deviation of relative_velocity_v"),
    Variable("relative_velocity_w_std", "time", "m s-1", "standard deviation of relative_velocity_w"),
    Variable("fix_latitude", "fix", "degrees_north", "latitude of the GPS fix", "latitude", False, -90.0, 90.0),
    Variable("fix_longitude", "fix", "degrees_east", "longitude of the GPS fix", "longitude", False, -180.0, 360.0),
)

VARIABLES: dict[str, Variable] = {variable.name: variable for variable in _TABLE}
"""All variables except the two times, by name."""

MEASURED = ("roll", "pitch", "heading", "depth")
SEAWATER = ("temperature", "practical_salinity", "pressure")
VELOCITY = ("relative_velocity_u", "relative_velocity_v", "relative_velocity_w")
VELOCITY_STD = tuple(f"{name}_std" for name in VELOCITY)
MAX_VELOCITY = 3.0
"""Magnitude of a velocity relative to the water (m/s) beyond which a sample is treated as missing."""
OPTIONAL = (*SEAWATER, *VELOCITY, *VELOCITY_STD)
"""Variables along ``time`` that are used where a file has them."""
CONTROLS = ("battery_position", "battery_rotation", "ballast_volume")
"""Actuators that every glider has; the rudder is optional."""
PROFILE_VARIABLES = (*MEASURED, *CONTROLS, "rudder")
"""Variables that are read for every profile."""
REQUIRED = tuple(variable.name for variable in _TABLE if variable.required)

PROFILE = "reference_profile"
SAMPLE = "reference_sample"

_REFERENCE_TABLE = (
    Variable("reference_profile", PROFILE, "1", "number of the profile that the reference quantities belong to"),
    Variable("reference_current_north", PROFILE, "m s-1", "depth-averaged current to the north, from the source"),
    Variable("reference_current_east", PROFILE, "m s-1", "depth-averaged current to the east, from the source"),
    Variable("reference_current_error", PROFILE, "m s-1", "error of the depth-averaged current, from the source"),
    Variable("reference_flight_north", PROFILE, "m s-1", "mean velocity through the water, north, from the source"),
    Variable("reference_flight_east", PROFILE, "m s-1", "mean velocity through the water, east, from the source"),
    Variable("reference_lift", PROFILE, "degree-1", "lift coefficient hd_a of the source's flight model"),
    Variable("reference_drag", PROFILE, "1", "drag coefficient hd_b of the source's flight model"),
    Variable("reference_induced_drag", PROFILE, "degree-2", "induced drag coefficient hd_c of the source's model"),
    Variable("reference_drag_exponent", PROFILE, "1", "exponent hd_s of the dynamic pressure in the source's drag"),
    Variable("reference_mass", PROFILE, "kg", "mass of the vehicle, from the source"),
    Variable("reference_maximum_volume", PROFILE, "cm3", "volume of the vehicle at full bladder, from the source"),
    Variable("reference_volume_bias", PROFILE, "cm3", "bias of the ballast volume that the source removes"),
    Variable("reference_compressibility", PROFILE, "dbar-1", "compressibility of the hull, from the source"),
    Variable("reference_thermal_expansion", PROFILE, "K-1", "thermal expansion of the hull, from the source"),
    Variable("reference_density", PROFILE, "kg m-3", "density that the source's flight model refers to"),
    Variable("reference_declination", PROFILE, "degree", "declination that was added to the magnetic heading"),
    Variable("reference_time", SAMPLE, "", "time of the reference speeds"),
    Variable("reference_speed", SAMPLE, "m s-1", "speed through the water from the source's flight model"),
    Variable("reference_horizontal_speed", SAMPLE, "m s-1", "horizontal part of reference_speed"),
    Variable("reference_vertical_speed", SAMPLE, "m s-1", "vertical part of reference_speed, upward"),
    Variable("reference_depth_rate", SAMPLE, "m s-1", "vertical velocity of the vehicle from its depth, upward"),
    Variable("reference_vertical_current", SAMPLE, "m s-1", "vertical velocity of the water from the source, upward"),
    Variable(
        "reference_slope_speed", SAMPLE, "m s-1", "speed from the source's lift and drag and the measured depth rate"
    ),
)

REFERENCE: dict[str, Variable] = {variable.name: variable for variable in _REFERENCE_TABLE}
"""All reference variables by name."""


def read_reference(path: str | Path) -> xr.Dataset:
    """Read the reference quantities of an observation file; any may be absent.

    Parameters
    ----------
    path : str or Path
        An observation file in netCDF.

    Returns
    -------
    xarray.Dataset
        Reference quantities along ``reference_profile`` (its coordinate is the profile's number) and
        ``reference_sample``, in memory.
    """
    with xr.open_dataset(path, decode_timedelta=False) as dataset:
        found = [name for name in REFERENCE if name in dataset.variables]
        return dataset[found].load()
