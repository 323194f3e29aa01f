"""netCDF files of native sensors: what a decoder has made of the binary files, names and units as they were."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.content import describe_content
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Rows, join_rows
from gliderhpc.observations.slocum.clock import rows_of_seconds
from gliderhpc.observations.slocum.sensors import Sensor
from gliderhpc.observations.slocum.units import conversion
from gliderhpc.observations.times import decode_times

FLIGHT_CLOCK, SCIENCE_CLOCK = "m_present_time", "sci_m_present_time"
_BARE_SECONDS = ("timestamp", "s", "sec", "second", "seconds")
"""Units that mean seconds since 1970 where no epoch is named."""


def is_decoded(path: Path) -> bool:
    """Whether a file is a netCDF of native sensors."""
    if not path.is_file() or path.suffix.lower() != ".nc":
        return False
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
            return FLIGHT_CLOCK in dataset.variables
    except (OSError, RuntimeError, ValueError):
        return False


def read_decoded(path: Path, part: int, flight: Sequence[Sensor], science: Sequence[Sensor]) -> tuple[Rows, Rows]:
    """Read the rows of the flight and of the science computer.

    Parameters
    ----------
    path : Path
        The file: one-dimensional variables with the native names and a ``units`` attribute each, those of the flight
        computer along the dimension of ``m_present_time``, those of the science computer along the dimension of
        ``sci_m_present_time``, or all of them along the former.
    part : int
        Number that its rows are given.
    flight, science : sequence of Sensor
        What to read; a sensor that the file does not have is missing (NaN).

    Raises
    ------
    InputError
        The file cannot be read, lacks a clock or a required sensor, or declares a unit that cannot be right.
    """
    try:
        # Loaded at once: sensors are read by name below, and one that does not decompress is found here.
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as stored:
            names = {FLIGHT_CLOCK, SCIENCE_CLOCK, *(sensor.name for sensor in (*flight, *science))}
            dataset = stored[[name for name in stored.variables if name in names]].load()
    except (OSError, RuntimeError, ValueError) as error:
        content = describe_content(path) or "is not a netCDF file that can be read; is it cut short?"
        raise InputError(f"{path}: {content}") from error
    if FLIGHT_CLOCK not in dataset.variables:
        raise InputError(f"{path}: has no {FLIGHT_CLOCK}; it must hold native sensors with the time of each record")
    held = [sensor.name for sensor in science if sensor.name in dataset.variables]
    clock = SCIENCE_CLOCK if SCIENCE_CLOCK in dataset.variables else FLIGHT_CLOCK
    return (
        _rows(dataset, path, part, FLIGHT_CLOCK, flight),
        _rows(dataset, path, part, clock, science) if held else join_rows([], [sensor.name for sensor in science]),
    )


def _rows(dataset: xr.Dataset, path: Path, part: int, clock: str, sensors: Sequence[Sensor]) -> Rows:
    seconds = _seconds(dataset[clock], path)
    columns = {sensor.name: _column(dataset, path, clock, sensor) for sensor in sensors}
    return rows_of_seconds(seconds, part, columns)


def _column(dataset: xr.Dataset, path: Path, clock: str, sensor: Sensor) -> FloatArray:
    if sensor.name not in dataset.variables:
        if sensor.required:
            raise InputError(
                f"{path}: has no {sensor.name} ({sensor.required}); decode the mission again with that sensor"
            )
        return np.full(dataset[clock].shape, np.nan)
    array = dataset[sensor.name]
    if array.dims != dataset[clock].dims:
        raise InputError(
            f"{path}: {sensor.name} has dimensions ({', '.join(map(str, array.dims))}); it must have those of {clock} "
            f"({', '.join(map(str, dataset[clock].dims))})"
        )
    if not np.issubdtype(array.dtype, np.number):
        raise InputError(f"{path}: {sensor.name} holds no numbers")
    unit = array.attrs.get("units")
    convert = conversion(sensor.quantity, None if unit is None else str(unit), f"{path}: {sensor.name}")
    values = np.asarray(array.values, dtype=np.float64)
    return convert(np.where(np.isfinite(values), values, np.nan))


def _seconds(clock: xr.DataArray, path: Path) -> FloatArray:
    """Seconds since 1970 from what the file declares."""
    if clock.ndim != 1:
        raise InputError(f"{path}: {clock.name} has {clock.ndim} dimensions; it must have one")
    if not np.issubdtype(clock.dtype, np.number):
        raise InputError(f"{path}: {clock.name} holds no numbers")
    unit = str(clock.attrs.get("units", "")).strip()
    if unit.lower() in _BARE_SECONDS:
        return np.asarray(clock.values, dtype=np.float64)
    if " since " not in unit.lower():
        raise InputError(
            f"{path}: {clock.name} is in '{unit}'; it must be in seconds since 1970, or in a CF unit of time"
        )
    calendar = str(clock.attrs.get("calendar", ""))
    nanoseconds = decode_times(clock.values, unit, calendar, f"{path}: {clock.name}").time
    seconds: FloatArray = np.where(np.isnat(nanoseconds), np.nan, nanoseconds.astype(np.int64) * 1e-9)
    return seconds
