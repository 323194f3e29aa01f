"""What the operator's own processing found, carried beside the observations for comparison.

These variables are optional. The reader of observations ignores them, and no estimate ever sees them.
"""

from pathlib import Path

import xarray as xr

from gliderhpc.observations.format import Variable

PROFILE = "reference_profile"
SAMPLE = "reference_sample"

_TABLE = (
    Variable("reference_profile", PROFILE, "1", "number of the profile that the reference quantities belong to"),
    Variable("reference_current_north", PROFILE, "m s-1", "depth-averaged current to the north, by the source"),
    Variable("reference_current_east", PROFILE, "m s-1", "depth-averaged current to the east, by the source"),
    Variable("reference_current_error", PROFILE, "m s-1", "error of the depth-averaged current, by the source"),
    Variable("reference_flight_north", PROFILE, "m s-1", "mean velocity through the water to the north, by the source"),
    Variable("reference_flight_east", PROFILE, "m s-1", "mean velocity through the water to the east, by the source"),
    Variable("reference_lift", PROFILE, "degree-1", "lift coefficient hd_a of the source's flight model"),
    Variable("reference_drag", PROFILE, "1", "drag coefficient hd_b of the source's flight model"),
    Variable("reference_induced_drag", PROFILE, "degree-2", "induced drag coefficient hd_c of the source's model"),
    Variable("reference_drag_exponent", PROFILE, "1", "exponent hd_s of the dynamic pressure in the source's drag"),
    Variable("reference_mass", PROFILE, "kg", "mass of the vehicle, by the source"),
    Variable("reference_maximum_volume", PROFILE, "cm3", "volume of the vehicle at full bladder, by the source"),
    Variable("reference_volume_bias", PROFILE, "cm3", "bias of the ballast volume that the source removes"),
    Variable("reference_compressibility", PROFILE, "dbar-1", "compressibility of the hull, by the source"),
    Variable("reference_thermal_expansion", PROFILE, "K-1", "thermal expansion of the hull, by the source"),
    Variable("reference_density", PROFILE, "kg m-3", "density that the source's flight model refers to"),
    Variable("reference_declination", PROFILE, "degree", "declination that was added to the magnetic heading"),
    Variable("reference_time", SAMPLE, "", "time of the reference speeds"),
    Variable("reference_speed", SAMPLE, "m s-1", "speed through the water by the source's flight model"),
    Variable("reference_horizontal_speed", SAMPLE, "m s-1", "horizontal part of reference_speed"),
    Variable("reference_vertical_speed", SAMPLE, "m s-1", "vertical part of reference_speed, upward"),
    Variable(
        "reference_slope_speed", SAMPLE, "m s-1", "speed by the source's lift and drag and the measured depth rate"
    ),
)

REFERENCE: dict[str, Variable] = {variable.name: variable for variable in _TABLE}
"""Every reference variable by name."""


def read_reference(path: str | Path) -> xr.Dataset:
    """Read the reference quantities of an observation file, none of which need be there.

    Parameters
    ----------
    path : str or Path
        An observation file in netCDF.

    Returns
    -------
    xarray.Dataset
        Along ``reference_profile`` (its coordinate is the profile's number) and ``reference_sample``; loaded.
    """
    with xr.open_dataset(path, decode_timedelta=False) as dataset:
        found = [name for name in REFERENCE if name in dataset.variables]
        return dataset[found].load()
