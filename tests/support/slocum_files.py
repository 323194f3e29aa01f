"""Slocum files made by the tests: a synthetic mission as netCDF of native sensors and as binary records."""

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

Columns = dict[str, np.ndarray]

INTERVAL = 4.0
AFLOAT, DIVE = 75, 150
"""Records of a surface interval and of a dive; a climb is as long as a dive."""

START = 1_435_190_400.0
"""25 June 2015, 00:00 UTC."""

STANDARD_TEMPERATURE = 15.0 / 1.00024
"""At which sea water that conducts 42.914 mS/cm has the practical salinity 35 (15 degC on the scale of 1968)."""

UNITS = {
    "m_present_time": "timestamp", "m_depth": "m", "m_pitch": "rad", "m_roll": "rad", "m_heading": "rad",
    "m_battpos": "in", "m_ballast_pumped": "cc", "m_de_oil_vol": "cc", "m_fin": "rad", "m_gps_lat": "lat",
    "m_gps_lon": "lon", "m_gps_status": "enum", "m_gps_mag_var": "rad",
    "sci_m_present_time": "timestamp", "sci_water_temp": "degc", "sci_water_cond": "s/m", "sci_water_pressure": "bar",
}  # fmt: skip
"""As the vehicle declares them."""


def flight(segment: int = 0, *, levels: tuple[float, float] = (1.5, 1.5)) -> Columns:
    """Record one segment of the flight computer: surface fixes, a dive to 60 m and a climb, surface fixes.

    The pressure sensor reads `levels` (m) at the surface, before and after.
    """
    before, after = levels
    down, up = np.linspace(before, 60.0, DIVE), np.linspace(60.0, after, DIVE)
    depth = np.concatenate([np.full(AFLOAT, before), down, up, np.full(AFLOAT, after)])
    n = len(depth)
    sense = np.concatenate([np.zeros(AFLOAT), -np.ones(DIVE), np.ones(DIVE), np.zeros(AFLOAT)])
    at_surface = sense == 0.0
    drift = 0.002 * np.arange(n)
    return {
        "m_present_time": START + INTERVAL * (segment * n + np.arange(n)),
        "m_depth": depth,
        "m_pitch": 0.4 * sense,
        "m_roll": np.full(n, -0.1),
        "m_heading": np.full(n, 1.0),
        "m_battpos": np.where(sense < 0.0, 1.25, 1.0),
        "m_ballast_pumped": np.where(sense < 0.0, -230.0, 230.0),
        "m_de_oil_vol": np.full(n, np.nan),
        "m_fin": np.full(n, 0.05),
        "m_gps_lat": np.where(at_surface, 2730.0 + drift, np.nan),
        "m_gps_lon": np.where(at_surface, -9030.0, np.nan),
        "m_gps_status": np.where(at_surface, 0.0, np.nan),
        "m_gps_mag_var": np.where(at_surface, np.radians(-2.0), np.nan),
    }


def science(segment: int = 0) -> Columns:
    """Record one segment of the science computer: water of practical salinity 35, and one row without CTD."""
    n = 2 * (AFLOAT + DIVE)
    water = {"sci_water_temp": STANDARD_TEMPERATURE, "sci_water_cond": 4.29140, "sci_water_pressure": 0.0}
    columns = {name: np.full(n, value) for name, value in water.items()}
    for values in columns.values():
        values[AFLOAT + 10] = np.nan
    return {"sci_m_present_time": START + INTERVAL * (segment * n + np.arange(n)) + 1.5, **columns}


def joined(segments: Sequence[Columns]) -> Columns:
    """Several consecutive segments."""
    return {name: np.concatenate([segment[name] for segment in segments]) for name in segments[0]}


def write_netcdf(
    path: Path, flown: Columns, sampled: Columns | None = None, *, units: Mapping[str, str | None] | None = None
) -> Path:
    """Write native sensors; `units` replaces the units declared by the vehicle, None leaves a sensor without."""
    declared = UNITS | dict(units or {})
    data = {}
    for dimension, columns in (("eng", flown), ("sci", sampled or {})):
        for name, values in columns.items():
            attributes = {} if declared[name] is None else {"units": declared[name]}
            data[name] = (dimension, values, attributes)
    xr.Dataset(data).to_netcdf(path)
    return path


def write_binary(path: Path, columns: Columns, *, name: str, factored: bool = False, crc: str = "0badcafe") -> Path:
    """Write the glider's binary format; with `factored` the list of sensors goes to a cache file next to it."""
    path.write_bytes(binary(columns, name=name, factored=factored, crc=crc))
    if factored:
        path.with_name(f"{crc}.cac").write_bytes(_sensor_list(columns))
    return path


def binary(columns: Columns, *, name: str, factored: bool = False, crc: str = "0badcafe") -> bytes:
    """Header text, byte-order marker, then one record per cycle: two state bits per sensor, values."""
    count = len(columns)
    tags = {
        "dbd_label": "DBD(dinkum_binary_data)file", "encoding_ver": 5, "num_ascii_tags": 14, "all_sensors": "T",
        "the8x3_filename": "00010000", "full_filename": name, "filename_extension": "dbd", "mission_name": "TEST.MI",
        "fileopen_time": "Thu_Jun_25_00:00:00_2015", "total_num_sensors": count, "sensors_per_cycle": count,
        "state_bytes_per_cycle": -(-count // 4), "sensor_list_crc": crc.upper(), "sensor_list_factored": int(factored),
    }  # fmt: skip
    header = "".join(f"{tag}:    {value}\n" for tag, value in tags.items()).encode()
    rows = np.column_stack(list(columns.values()))
    known = b"sa" + struct.pack(">hfd", 0x1234, 123.456, 123456789.12345)
    # The first cycle repeats what was known before the file was opened; readers leave it out.
    cycles = [_cycle(row, list(columns)) for row in [rows[0], *rows]]
    return header + (b"" if factored else _sensor_list(columns)) + known + b"".join(cycles) + b"X"


def _sensor_list(columns: Columns) -> bytes:
    lines = [f"s: T {i} {i} {_size(name)} {name} {UNITS[name]}\n" for i, name in enumerate(columns)]
    return "".join(lines).encode()


def _size(name: str) -> int:
    return 8 if name.endswith("time") or name.startswith("m_gps_l") else 4


def _cycle(row: np.ndarray, names: list[str]) -> bytes:
    states, values = bytearray(-(-len(names) // 4)), b""
    for index, (name, value) in enumerate(zip(names, row, strict=True)):
        if np.isfinite(value):
            states[index // 4] |= 2 << (6 - 2 * (index % 4))
            values += struct.pack(">d" if _size(name) == 8 else ">f", value)
    return b"d" + bytes(states) + values
