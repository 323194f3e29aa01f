"""Files of a Slocum mission: flight and science computer's for every segment, or netCDF of native sensors."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Rows, join_rows
from gliderhpc.observations.slocum.sensors import Sensor, conversion, rows_of_seconds
from gliderhpc.observations.sources import describe_content, refuse_compressed
from gliderhpc.observations.times import decode_times

FLIGHT = ("dbd", "dcd", "mbd", "mcd", "sbd", "scd")
"""Endings of the flight computer's files, the fullest record first; the middle letter c marks the compressed ones."""

SCIENCE = ("ebd", "ecd", "nbd", "ncd", "tbd", "tcd")
"""Endings of the science computer's files, in the same order."""

_DECODED = "nc"


@dataclass(frozen=True)
class MissionFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    flight, science : tuple of Path
        Binary files, one a segment.
    decoded : tuple of Path
        netCDF files of native sensors.
    """

    flight: tuple[Path, ...]
    science: tuple[Path, ...]
    decoded: tuple[Path, ...]


def is_binary(path: Path) -> bool:
    """Return whether a file is named as the glider names its binary records."""
    return _ending(path) in (*FLIGHT, *SCIENCE)


def is_compressed(path: Path) -> bool:
    """Return whether a file is named as the glider names its compressed records."""
    return is_binary(path) and _ending(path)[1] == "c"


def find_files(sources: Sequence[Path], out: Path) -> MissionFiles:
    """Collect the files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them. Of a folder the binary files are taken, the netCDF files where it has none.
    out : Path
        The file to be written, which is no source.

    Raises
    ------
    InputError
        A source does not exist or is neither a binary nor a netCDF file, or no source holds a flight record.
    """
    files = [path for source in sources for path in _expand(source, out)]
    flight = _fullest([path for path in files if _ending(path) in FLIGHT], FLIGHT)
    science = _fullest([path for path in files if _ending(path) in SCIENCE], SCIENCE)
    decoded = tuple(dict.fromkeys(path for path in files if _ending(path) == _DECODED))
    if not flight and not decoded:
        raise InputError(
            f"{', '.join(map(str, sources))}: no flight record there (*.dbd, *.sbd, their compressed forms, or "
            "netCDF); give the folder that holds them"
        )
    return MissionFiles(flight, science, decoded)


def _ending(path: Path) -> str:
    return path.suffix.removeprefix(".").lower()


def _expand(source: Path, out: Path) -> list[Path]:
    if source.is_dir():
        held = sorted(path for path in source.iterdir() if path.is_file() and path.resolve() != out.resolve())
        found = [path for path in held if is_binary(path)] or [path for path in held if _ending(path) == _DECODED]
        if not found:
            refuse_compressed(path for path in held if _is_record(path.with_suffix("")))
        return found
    if not source.is_file():
        raise InputError(f"{source}: no such file or folder")
    if not _is_record(source):
        refuse_compressed([source])
        raise InputError(f"{source}: is neither a Slocum record (*.dbd, *.ebd and their kin) nor a netCDF file")
    return [source]


def _is_record(path: Path) -> bool:
    return is_binary(path) or _ending(path) == _DECODED


def _fullest(files: list[Path], endings: tuple[str, ...]) -> tuple[Path, ...]:
    """One file a segment: the fullest record that is there."""
    best: dict[str, Path] = {}
    for path in sorted(files, key=lambda path: endings.index(_ending(path))):
        best.setdefault(path.stem.lower(), path)
    return tuple(sorted(best.values(), key=_segment_order))


def _segment_order(path: Path) -> list[str | tuple[int, str]]:
    """Order names by their numbers, so that segment 10 comes after segment 9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


FLIGHT_CLOCK, SCIENCE_CLOCK = "m_present_time", "sci_m_present_time"
_BARE_SECONDS = ("timestamp", "s", "sec", "second", "seconds")
"""Units that mean seconds since 1970 where no epoch is named."""


def is_decoded(path: Path) -> bool:
    """Return whether a file is a netCDF of native sensors."""
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
