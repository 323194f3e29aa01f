"""Small files in the layouts of Seaglider's basestation and of OceanGliders OG1, with their true values."""

from pathlib import Path

import netCDF4
import numpy as np

START = np.datetime64("2023-07-05T10:00:00", "s")
STEP = 10.0
"""Seconds between samples."""

HALF = 60
"""Samples of a dive, and as many of a climb."""

AFLOAT = 6
"""Samples at the surface before a dive, and as many after it."""

PERIOD = np.timedelta64(3600, "s")
"""From one dive's first sample to the next one's."""

PITCH_CNV, ROLL_CNV, VBD_CNV = 0.004, 0.05, -0.25
C_PITCH, C_ROLL, C_VBD = 2400.0, 2300.0, 3000.0
DECLINATION = 15.5
EPOCH = "seconds since 1970-1-1 00:00:00"


def clock(dive: int) -> np.ndarray:
    """Seconds since 1970 of a dive's samples; dives count from 1."""
    begin = float((START + (dive - 1) * PERIOD - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
    return begin + STEP * np.arange(2 * AFLOAT + 2 * HALF)


def depths(maximum: float) -> np.ndarray:
    """Depth (m): 1 m at the surface, down to the greatest depth and up again to the surface."""
    half = np.linspace(5.0, maximum, HALF)
    return np.concatenate([np.ones(AFLOAT), half, half[::-1], np.ones(AFLOAT)])


def pitches() -> np.ndarray:
    """Pitch (degree)."""
    return np.repeat([-60.0, -20.0, 25.0, 5.0], [AFLOAT, HALF, HALF, AFLOAT])


def phases(dive: int) -> dict[str, np.ndarray]:
    """Guidance and control of a dive: start, battery rotation at a quarter of it, and the turn into the climb.

    In the first the battery runs from 430 counts to 2100 in 20 s, then oil from 1000 to 3400 in 30 s, then the battery
    rolls from 2300 to 3900 in 4 s.
    """
    begin = clock(dive)[0]
    at = begin + STEP * np.array([AFLOAT, AFLOAT + HALF / 4, AFLOAT + HALF])
    return {
        "gc_st_secs": at,
        "gc_pitch_ad_start": np.array([430.0, 2100.0, 2100.0]),
        "gc_pitch_ad": np.array([2100.0, 2100.0, 2700.0]),
        "gc_vbd_ad_start": np.array([1000.0, 3400.0, 3400.0]),
        "gc_vbd_ad": np.array([3400.0, 3400.0, 2500.0]),
        "gc_roll_ad_start": np.array([2300.0, 3900.0, 2300.0]),
        "gc_roll_ad": np.array([3900.0, 2300.0, 2300.0]),
        "gc_pitch_secs": np.array([20.0, 0.0, 5.0]),
        # The oil is let in on the way down, which is logged below zero.
        "gc_vbd_secs": np.array([-30.0, 0.0, 90.0]),
        "gc_roll_secs": np.array([4.0, 4.0, 0.0]),
    }


def fixes(dive: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, latitude and longitude of GPS1 and GPS2 before a dive, GPSE after it."""
    samples = clock(dive)
    time = np.array([samples[0] - 300.0, samples[0] - 60.0, samples[-1] + 120.0])
    return time, 47.0 + 0.01 * dive + np.array([0.0, 0.001, 0.005]), np.full(3, -125.0)


def put(file: netCDF4.Dataset, name: str, dimension: str | None, values: object, units: str = "", **attributes: str):
    """Write a variable of doubles, NaN as the fill value that the file declares."""
    variable = file.createVariable(name, "f8", (dimension,) if dimension else (), fill_value=9.96e36)
    variable[...] = np.ma.masked_invalid(np.asarray(values, dtype=float))
    variable.setncatts({**({"units": units} if units else {}), **attributes})


def write_dive(
    folder: Path,
    dive: int,
    *,
    columns: bool,
    maximum: float = 100.0,
    centres=(C_PITCH, C_ROLL, C_VBD),
    **changes: object,
) -> Path:
    """One dive of SG099 as the basestation writes it.

    Parameters
    ----------
    folder : Path
        Where to.
    dive : int
        Its number.
    columns : bool
        The older layout, with columns of the controls, or the newer one with the tables of phases alone.
    maximum : float
        Depth (m).
    centres : three floats
        Counts at which the positions of battery (pitch, roll) and ballast are zero.
    changes : array or None
        In place of a variable of that name; None leaves it out.
    """
    folder.mkdir(exist_ok=True)
    path = folder / f"p099{dive:04d}.nc"
    samples, pitch = clock(dive), pitches()
    time, latitude, longitude = fixes(dive)
    series = {
        "time": (samples, EPOCH), "depth": (depths(maximum), "meters"), "pressure": (1.01 * depths(maximum), "dbar"),
        "eng_pitchAng": (pitch, "degrees"), "eng_rollAng": (0.1 * pitch, "degrees"),
        "eng_head": (np.full(len(samples), 350.0), "degrees"),
        "ctd_time": (samples + 2.0, EPOCH), "temperature": (np.full(len(samples), 8.0), "degrees_Celsius"),
        "salinity": (np.full(len(samples), 34.0), "1e-3"), "speed": (np.full(len(samples), 25.0), "cm/s"),
        "speed_gsm": (np.full(len(samples), 24.0), "cm/s"),
    }  # fmt: skip
    if columns:
        diving = np.repeat([0.0, 1.0, 2.0, 2.0], [AFLOAT, HALF, HALF, AFLOAT]).astype(int)
        series |= {
            "eng_pitchCtl": (PITCH_CNV * (np.array([430.0, 2100.0, 2700.0])[diving] - centres[0]), ""),
            "eng_rollCtl": (ROLL_CNV * (np.array([2300.0, 3900.0, 2300.0])[diving] - centres[1]), ""),
            "eng_vbdCC": (VBD_CNV * (np.array([1000.0, 3400.0, 2500.0])[diving] - centres[2]), ""),
        }
    scalars = {
        "magnetic_variation": (DECLINATION, ""), "log_D_FLARE": (3.0, ""), "log_D_SURF": (2.0, ""),
        "log_PITCH_CNV": (PITCH_CNV, ""), "log_ROLL_CNV": (ROLL_CNV, ""), "log_VBD_CNV": (VBD_CNV, ""),
        "log_C_PITCH": (centres[0], ""), "log_C_ROLL_DIVE": (centres[1], ""), "log_C_VBD": (centres[2], ""),
        "depth_avg_curr_north": (0.05, "m/s"), "depth_avg_curr_east": (-0.1, "m/s"), "sg_cal_vbdbias": (12.0, "cc"),
    }  # fmt: skip
    gps = {"log_gps_time": (time, EPOCH), "log_gps_lat": (latitude, "degrees_north"),
           "log_gps_lon": (longitude, "degrees_east")}  # fmt: skip
    groups = [("sg_data_point", series), ("gps_info", gps), (None, scalars)]
    groups.append(("gc_event", {name: (values, "1") for name, values in phases(dive).items()}))
    with netCDF4.Dataset(path, "w") as file:
        for dimension, group in groups:
            for name, (values, units) in group.items():
                chosen = changes.get(name, values)
                if chosen is not None:
                    if dimension and dimension not in file.dimensions:
                        file.createDimension(dimension, len(np.atleast_1d(chosen)))
                    put(file, name, dimension, chosen, units)
    return path


def write_og1(path: Path, dives: tuple[int, ...] = (1, 2), *, magnetic: bool = True, **changes: object) -> Path:
    """Dives of SG099 as an OG1 trajectory file, with a row for each of the three fixes of a dive.

    The dead reckoning goes 15.5 degrees clockwise of the heading; `changes` as for `write_dive`.
    """
    parts = [og1_rows(dive) for dive in dives]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    units = {
        "TIME": EPOCH, "DEPTH": "m", "ROLL": "degrees", "PITCH": "degrees", "HEADING": "degrees",
        "TEMP": "degrees_Celsius", "NORTH_DISPLACEMENT": "meters", "EAST_DISPLACEMENT": "meters",
        "LATITUDE_GPS": "degrees_north",
        "LONGITUDE_GPS": "degrees_east", "DAVG_CURR_NORTH": "m/s", "DAVG_CURR_EAST": "m/s", "GLIDE_SPEED": "cm/s",
    }  # fmt: skip
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("N_MEASUREMENTS", len(columns["TIME"]))
        for name, values in columns.items():
            chosen = changes.get(name, values)
            if chosen is not None:
                put(file, name, "N_MEASUREMENTS", chosen, units.get(name, ""))
        if magnetic and "HEADING" in file.variables:
            file["HEADING"].comment = "Vehicle heading (magnetic)"
        serial = file.createVariable("PLATFORM_SERIAL_NUMBER", str, ())
        serial[...] = "sg099"
        model = file.createVariable("PLATFORM_MODEL", str, ())
        model[...] = "University of Washington Seaglider M1 glider"
    return path


def og1_depths(maximum: float) -> np.ndarray:
    """Depths of the rows of one dive of `write_og1` to another maximum."""
    samples, time = clock(1), fixes(1)[0]
    order = np.argsort(np.concatenate([samples, time]), kind="stable")
    return np.concatenate([depths(maximum), np.zeros(3)])[order]


def og1_rows(dive: int) -> dict[str, np.ndarray]:
    samples, pitch, maximum = clock(dive), pitches(), 100.0
    time, latitude, longitude = fixes(dive)
    count, course = len(samples), np.radians(350.0 + DECLINATION)
    rows = {
        "TIME": samples, "DEPTH": depths(maximum), "PITCH": pitch, "ROLL": 0.1 * pitch,
        "HEADING": np.full(count, 350.0), "VBD_CC": np.where(pitch < 0.0, -100.0, 150.0),
        "PITCH_CTL": np.where(pitch < 0.0, -1.2, 1.3), "ROLL_CTL": np.full(count, 40.0), "TEMP": np.full(count, 8.0),
        "TEMP_QC": np.where(np.arange(count) == 20, 4.0, 1.0), "divenum": np.full(count, float(dive)),
        "NORTH_DISPLACEMENT": np.full(count, 3.0 * np.cos(course)),
        "EAST_DISPLACEMENT": np.full(count, 3.0 * np.sin(course)), "DAVG_CURR_NORTH": np.full(count, 0.05),
        "DAVG_CURR_EAST": np.full(count, -0.1), "GLIDE_SPEED": np.full(count, 25.0),
        "LATITUDE_GPS": np.full(count, np.nan), "LONGITUDE_GPS": np.full(count, np.nan),
    }  # fmt: skip
    gps = {"TIME": time, "LATITUDE_GPS": latitude, "LONGITUDE_GPS": longitude, "DEPTH": np.zeros(3),
           "divenum": np.full(3, float(dive))}  # fmt: skip
    joined = {name: np.concatenate([values, gps.get(name, np.full(3, np.nan))]) for name, values in rows.items()}
    order = np.argsort(joined["TIME"], kind="stable")
    return {name: values[order] for name, values in joined.items()}
