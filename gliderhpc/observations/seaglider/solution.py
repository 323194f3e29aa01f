"""The basestation's own solution of a dive, carried along as reference quantities."""

import numpy as np

from gliderhpc.observations.columns import Columns
from gliderhpc.observations.foreign import ForeignFile

_SCALARS = {
    "reference_current_north": ("depth_avg_curr_north", "m s-1"),
    "reference_current_east": ("depth_avg_curr_east", "m s-1"),
    "reference_current_error": ("depth_avg_curr_error", "m s-1"),
    "reference_flight_north": ("flight_avg_speed_north", "m s-1"),
    "reference_flight_east": ("flight_avg_speed_east", "m s-1"),
    "reference_mass": ("sg_cal_mass", "kg"),
}
_CONSTANTS = {
    "reference_lift": "sg_cal_hd_a",
    "reference_drag": "sg_cal_hd_b",
    "reference_induced_drag": "sg_cal_hd_c",
    "reference_drag_exponent": "sg_cal_hd_s",
    # In cm3, whatever the file calls their units.
    "reference_maximum_volume": "sg_cal_volmax",
    "reference_volume_bias": "sg_cal_vbdbias",
    "reference_compressibility": "sg_cal_abs_compress",
    "reference_thermal_expansion": "sg_cal_therm_expan",
    "reference_density": "sg_cal_rho0",
}
_SERIES = {
    "reference_speed": "speed",
    "reference_horizontal_speed": "horz_speed",
    "reference_vertical_speed": "vert_speed",
    "reference_slope_speed": "speed_gsm",
}


def read_solution(file: ForeignFile, number: int, declination: float) -> Columns:
    """Reference quantities of one dive, NaN where the file has none.

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    number : int
        Number of the dive.
    declination : float
        Added to its magnetic heading (degree).
    """
    found: Columns = {
        "reference_profile": np.array([number]),
        "reference_declination": np.array([declination]),
    }
    for name, (source, unit) in _SCALARS.items():
        values = file.converted(source, unit)[:1] if source in file else np.zeros(0)
        found[name] = values if len(values) else np.array([np.nan])
    found |= {name: np.array([file.number(source)]) for name, source in _CONSTANTS.items()}
    return found | _series(file)


def _series(file: ForeignFile) -> Columns:
    """Speeds of the flight model at the times that have one."""
    if "ctd_time" not in file or "speed" not in file:
        empty: Columns = {name: np.zeros(0) for name in _SERIES}
        return empty | {"reference_time": np.zeros(0, "datetime64[ns]")}
    file.check_lengths(("ctd_time", *_SERIES.values()))
    time = file.times("ctd_time")
    speeds = {
        name: file.converted(source, "m s-1") if source in file else np.full(len(time), np.nan)
        for name, source in _SERIES.items()
    }
    known = ~np.isnat(time) & np.isfinite(speeds["reference_speed"])
    return {"reference_time": time[known], **{name: values[known] for name, values in speeds.items()}}
