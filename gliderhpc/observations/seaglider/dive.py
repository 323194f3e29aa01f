"""One dive, out of its file."""

from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.columns import Columns
from gliderhpc.observations.dives import SURFACE_DEPTH, dive_span
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.foreign import ForeignFile
from gliderhpc.observations.intervals import local_intervals
from gliderhpc.observations.nearest import onto_nearest
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.rows import increasing
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
    """What one file holds of its dive.

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
