"""One dive from a Seaglider's per-dive file, and the basestation's own solution as reference quantities."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.intervals import local_intervals
from gliderhpc.observations.profiles import SURFACE_DEPTH, dive_span
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import Columns, increasing, onto_nearest
from gliderhpc.observations.seaglider.controls import BALLAST, PITCH, ROLL, Centres, position
from gliderhpc.observations.validation import clock_set_back

BAD = "4"
"""Flag of a fix that the basestation rejected."""

_CTD = {
    "temperature": ("temperature", "temperature_raw", "degC"),
    "practical_salinity": ("salinity", "salinity_raw", "1"),
}


@dataclass(frozen=True, eq=False)
class Dive:
    """Content of one dive's file.

    Attributes
    ----------
    variables : dict of str to (n,) array
        Samples in the units of the observation format, time and the controls among them.
    start, stop : int
        First sample below the surface and the one after the last.
    fixes : Fixes
        Those of the file, in its order.
    declination : float
        What was added to the magnetic heading (degree).
    rows_dropped : int
        Samples whose time was missing or did not increase.
    """

    variables: Columns
    start: int
    stop: int
    fixes: Fixes
    declination: float
    rows_dropped: int


def read_dive(file: ForeignFile, centres: Centres) -> Dive:
    """Read one dive.

    Parameters
    ----------
    file : ForeignFile
        A per-dive file.
    centres : mapping of Control to float
        To which counts of the sensors the controls are referred.

    Raises
    ------
    InputError
        The file lacks attitude, depth, a control or the declination, or was cut short.
    ProfileError
        It holds no dive, or a shallow one.
    """
    time = file.times("time")
    depth_name = file.first(["depth", "eng_depth"])
    if depth_name is None:
        raise InputError(f"{file.path}: has no depth")
    declination = _declination(file)
    samples: Columns = {
        "time": time,
        "depth": file.converted(depth_name, "m"),
        "roll": file.converted("eng_rollAng", "degree"),
        "pitch": file.converted("eng_pitchAng", "degree"),
        "heading": np.mod(file.converted("eng_head", "degree") + declination, 360.0),
        # Forward is towards low counts: the file's positions grow aft.
        "battery_position": -0.01 * position(file, PITCH, time, centres),
        "battery_rotation": position(file, ROLL, time, centres),
        "ballast_volume": position(file, BALLAST, time, centres),
    }
    if "pressure" in file:
        samples["pressure"] = file.converted("pressure", "dbar")
    _check_sampled(file, samples)
    _check_lengths(file, samples)
    _check_clock(file, time)
    keep = increasing(time)
    samples = {name: values[keep] for name, values in samples.items()}
    samples |= _ctd(file, samples["time"].astype("datetime64[ns]"))
    start, stop = _submerged(file, samples["depth"].astype(np.float64))
    return Dive(samples, start, stop, _fixes(file), declination, int(np.count_nonzero(~keep)))


def _check_clock(file: ForeignFile, time: TimeArray) -> None:
    """Refuse a dive in which the clock was set: which of its rows belong together cannot be known."""
    step = clock_set_back(time)
    if step is not None:
        raise InputError(f"{file.path}: the clock was set back by {step:.0f} s during the dive")


def _check_lengths(file: ForeignFile, samples: Columns) -> None:
    for name in ("roll", "pitch", "heading"):
        if not np.isfinite(samples[name].astype(np.float64)).any():
            raise InputError(f"{file.path}: has no {name}, not one sample of it")


def _check_sampled(file: ForeignFile, samples: Columns) -> None:
    odd = [name for name, values in samples.items() if len(values) != len(samples["time"])]
    if odd:
        raise InputError(f"{file.path}: {odd[0]} is not sampled with time; is it a per-dive file of the basestation?")


def _declination(file: ForeignFile) -> float:
    """Declination in the file: that of the dive, or the one that came with a fix."""
    name = file.first(["magnetic_variation", "log_gps_magvar"])
    values = file.converted(name, "degree") if name else np.zeros(0)
    known = values[np.isfinite(values)]
    if len(known) == 0:
        raise InputError(f"{file.path}: its heading is magnetic and it has no declination (magnetic_variation)")
    return float(np.median(known))


def _submerged(file: ForeignFile, depth: FloatArray) -> tuple[int, int]:
    """Find the dive: from below the depth at which the glider flares out of its plunge to that at which it surfaces.

    Above them it floats, or hangs nose down while the oil is let in: no gliding flight that the model could follow.
    """
    flare, surfacing = (_depth_in_log(file, name) for name in ("log_D_FLARE", "log_D_SURF"))
    return dive_span(depth, begin=flare, end=surfacing)


def _depth_in_log(file: ForeignFile, name: str) -> float:
    depth = file.number(name)
    # Zero turns the manoeuvre off.
    return depth if depth > 0.0 else SURFACE_DEPTH


def _fixes(file: ForeignFile) -> Fixes:
    """The file's fixes that the basestation did not reject."""
    if "log_gps_time" not in file:
        return Fixes(np.zeros(0, "datetime64[ns]"), np.zeros(0), np.zeros(0))
    file.check_lengths(("log_gps_time", "log_gps_lat", "log_gps_lon"))
    time = file.times("log_gps_time")
    latitude, longitude = (file.converted(f"log_gps_{name}", "degree") for name in ("lat", "lon"))
    flags = np.array([*file.text("log_gps_qc").ljust(len(time))])
    good = ~np.isnat(time) & np.isfinite(latitude) & np.isfinite(longitude) & (flags[: len(time)] != BAD)
    return Fixes(time[good], latitude[good], longitude[good])


def _ctd(file: ForeignFile, time: TimeArray) -> Columns:
    """Temperature and salinity on the nearest sample within half an interval."""
    if len(time) < 2 or "ctd_time" not in file:
        return {}
    file.check_lengths(("ctd_time", *(name for corrected, raw, _ in _CTD.values() for name in (corrected, raw))))
    sampled = file.times("ctd_time")
    known = ~np.isnat(sampled)
    within = np.clip(np.searchsorted(time, sampled[known]) - 1, 0, len(time) - 2)
    reach = (local_intervals(np.diff(time) / np.timedelta64(1, "s"))[within] / 2.0 * 1e9).astype("timedelta64[ns]")
    found: Columns = {}
    for name, (corrected, raw, unit) in _CTD.items():
        column = file.first([corrected, raw])
        if column is not None:
            found[name] = onto_nearest(time, sampled[known], file.converted(column, unit)[known], reach)
    return found


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
