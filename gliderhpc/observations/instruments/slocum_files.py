"""Files of a Slocum mission, native sensors and their units, and netCDF files of native sensors.

A mission has one file of the flight computer and one of the science computer for every segment, or netCDF files of
native sensors. Sensors have the vehicle's own names (its `masterdata`). A positive ``m_roll`` is starboard down, a
positive ``m_pitch`` nose up, and a positive ``m_battpos`` forward of the middle (nose down). A positive ``m_fin`` turns
the vehicle to starboard. Positive volumes make the vehicle buoyant.
"""

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from filecmp import cmp
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError, first_line
from gliderhpc.observations.checks.heading_values import RANGE
from gliderhpc.observations.files.columns import DEFAULT_UNITS, FACTORS, UnitError
from gliderhpc.observations.files.file_content import describe_failure
from gliderhpc.observations.files.foreign import IN_THE_FORMAT, is_in_the_format, name_compressed, refuse_compressed
from gliderhpc.observations.files.packed import open_dataset
from gliderhpc.observations.files.valid_limits import declared_limits, describe_outside, outside
from gliderhpc.observations.fixes import decimal_degrees
from gliderhpc.observations.importing.position_form import NEAR_ZERO, are_not_decimal, may_be_decimal, typical_position
from gliderhpc.observations.importing.rows import Rows, join_rows
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import EARLIEST, LATEST, NEGATIVE_FILLS, check_resolution, decode_times, epoch_seconds

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Sensor:
    """One native sensor.

    Attributes
    ----------
    name : str
        The vehicle's name of the sensor.
    quantity : str
        Quantity and unit, for example ``length in m``; values are converted to that unit when the file is read.
    low, high : float
        Plausible range; a value outside is junk and is treated as missing.
    required : str or None
        Quantity that is lost without the sensor; None if the import does not require it.
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
    Sensor("m_heading", _ANGLE, *RANGE, "attitude"),
    Sensor("m_battpos", _LENGTH, -0.5, 0.5, "battery position"),
    Sensor("m_ballast_pumped", _VOLUME, -2000.0, 2000.0),
    Sensor("m_de_oil_vol", _VOLUME, -2000.0, 2000.0),
    Sensor("m_fin", _ANGLE, -90.0, 90.0),
    Sensor("m_gps_lat", _POSITION, -90.0, 90.0),
    Sensor("m_gps_lon", _POSITION, -180.0, 360.0),
    Sensor("m_gps_status", "state", 0.0, 255.0),
    Sensor("m_gps_mag_var", _ANGLE, -180.0, 180.0),
)
"""Sensors of the flight computer. The shallow vehicle has ``m_ballast_pumped``, the deep vehicle ``m_de_oil_vol``."""

SCIENCE_SENSORS = (
    Sensor("sci_water_temp", "temperature in degC", -5.0, 45.0),
    Sensor("sci_water_pressure", "pressure in dbar", -20.0, 2100.0),
    Sensor("sci_water_cond", "conductivity in mS/cm", 0.02, 90.0),
)
"""Sensors of the science computer: the CTD. It is turned off, or logs zeros, while the vehicle is out of the water."""

BALLAST_SENSORS = ("m_ballast_pumped", "m_de_oil_vol")

Conversion = Callable[[FloatArray], FloatArray]


def _times(factor: float, values: FloatArray) -> FloatArray:
    return values * factor


def _accepted(quantity: str) -> Mapping[str, Conversion]:
    """Conversions of a quantity by the spelling of the declared unit, in lower case."""
    if quantity == "state":
        return {unit: partial(_times, 1.0) for unit in ("enum", "nodim", "1", "bool")}
    what, _, wanted = quantity.partition(" in ")
    scales: dict[str, Conversion] = {unit: partial(_times, factor) for unit, factor in FACTORS[wanted].items()}
    return dict.fromkeys(("lat", "lon", "ddmm.mmmm"), decimal_degrees) | scales if what == "position" else scales


def conversion(quantity: str, unit: str | None, where: str) -> Conversion:
    """Return the conversion from a declared unit to the unit of the observation format.

    Parameters
    ----------
    quantity : str
        Quantity and wanted unit, for example ``length in m``.
    unit : str or None
        Unit declared in the file; None if there is none. A state needs no unit.
    where : str
        Names of the file and the sensor in the message.

    Raises
    ------
    InputError
        No unit is declared, or the declared unit does not measure this quantity.
    """
    accepted = _accepted(quantity)
    known = ", ".join(accepted)
    if unit is None and quantity != "state":
        raise InputError(f"{where} declares no unit; set its units attribute to one of {known}")
    found = accepted.get((unit or "1").strip().lower())
    if found is None:
        raise UnitError(
            f"{where} is in '{unit}', which is not a unit of {quantity.partition(' ')[0]}; it must be in one of {known}"
        )
    return found


_EARLIEST, _LATEST = (epoch_seconds(time) for time in (EARLIEST, LATEST))
"""Limits of plausible times (s since 1970); an unset clock gives 1970."""


def rows_of_seconds(seconds: FloatArray, part: int, columns: dict[str, FloatArray]) -> Rows:
    """Rows of one file from its clock and columns; a time outside the years of gliders becomes NaT."""
    plausible = (seconds > _EARLIEST) & (seconds < _LATEST)
    nanoseconds = np.rint(np.where(plausible, seconds, 0.0) * 1e9).astype(np.int64).astype("datetime64[ns]")
    nanoseconds[~plausible] = np.datetime64("NaT", "ns")
    return Rows(nanoseconds, np.full(len(seconds), part, dtype=np.int64), columns)


FLIGHT = ("dbd", "dcd", "mbd", "mcd", "sbd", "scd")
"""Endings of the flight computer's files, the fullest record first; the middle letter c marks compressed files."""

SCIENCE = ("ebd", "ecd", "nbd", "ncd", "tbd", "tcd")
"""Endings of the science computer's files, in the same order."""

_DECODED = "nc"


@dataclass(frozen=True)
class SlocumFiles:
    """The files of one glider's mission.

    Attributes
    ----------
    flight, science : tuple of Path
        Binary files, one per segment.
    decoded : tuple of Path
        netCDF files of native sensors.
    """

    flight: tuple[Path, ...]
    science: tuple[Path, ...]
    decoded: tuple[Path, ...]


def is_binary(path: Path) -> bool:
    """Return whether a file is named like a binary record of the glider."""
    return _ending(path) in (*FLIGHT, *SCIENCE)


def is_compressed(path: Path) -> bool:
    """Return whether a file is named like a compressed record of the glider."""
    return is_binary(path) and _ending(path)[1] == "c"


def find_files(sources: Sequence[Path], out: Path) -> SlocumFiles:
    """Collect the files of a mission.

    Parameters
    ----------
    sources : sequence of Path
        Files, or folders that hold them. From a folder the binary files are taken, or its netCDF files if it has none.
    out : Path
        The file to be written, which is not a source.

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
            f"{', '.join(map(str, sources))}: no flight record found (*.dbd, *.sbd, their compressed forms, or "
            "netCDF); give the folder that contains them"
        )
    return SlocumFiles(flight, science, decoded)


def _ending(path: Path) -> str:
    return path.suffix.removeprefix(".").lower()


def _expand(source: Path, out: Path) -> list[Path]:
    if source.is_dir():
        held = sorted(path for path in source.iterdir() if path.is_file() and path.resolve() != out.resolve())
        found = [path for path in held if is_binary(path)] or [path for path in held if _ending(path) == _DECODED]
        name_compressed(found, held, is_binary if found and is_binary(found[0]) else _is_record)
        return found
    if not source.is_file():
        raise InputError(f"{source}: no such file or folder")
    if not _is_record(source):
        refuse_compressed([source])
        raise InputError(f"{source}: is neither a Slocum record (*.dbd, *.ebd and the like) nor a netCDF file")
    return [source]


def _is_record(path: Path) -> bool:
    return is_binary(path) or _ending(path) == _DECODED


def _fullest(files: list[Path], endings: tuple[str, ...]) -> tuple[Path, ...]:
    """One file per segment: the fullest available record.

    Raises
    ------
    InputError
        Two different files have the same name.
    """
    best: dict[str, Path] = {}
    for path in sorted(files, key=lambda path: endings.index(_ending(path))):
        other = best.setdefault(path.stem.lower(), path)
        if _ending(other) == _ending(path) and not cmp(other, path, shallow=False):
            raise InputError(
                f"{path}: has the name of {other} and another content; import one glider at a time, and give each "
                "segment once"
            )
    return tuple(sorted(best.values(), key=_segment_order))


def _segment_order(path: Path) -> list[str | tuple[int, str]]:
    """Sort key of file names by their numbers, which puts segment 10 after segment 9."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


FLIGHT_CLOCK, SCIENCE_CLOCK = "m_present_time", "sci_m_present_time"
_BARE_SECONDS = ("timestamp", "s", "sec", "second", "seconds")
"""Units without an epoch that mean seconds since 1970."""


def is_decoded(path: Path) -> bool:
    """Return whether a file is a netCDF file of native sensors, of either computer."""
    if not path.is_file() or path.suffix.lower() != ".nc":
        return False
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_times=False) as dataset:
            return not {FLIGHT_CLOCK, SCIENCE_CLOCK}.isdisjoint(dataset.variables)
    except (OSError, RuntimeError, ValueError):
        return False


def read_decoded(path: Path, part: int, flight: Sequence[Sensor], science: Sequence[Sensor]) -> tuple[Rows, Rows]:
    """Read the rows of the flight computer and of the science computer from a netCDF file.

    Parameters
    ----------
    path : Path
        File of one-dimensional variables with native names and ``units`` attributes. Variables of the flight computer
        are along the dimension of ``m_present_time``. Those of the science computer are along the dimension of
        ``sci_m_present_time``, or of ``m_present_time`` if the former is absent. A file of the science computer alone
        has no flight rows.
    part : int
        Number assigned to its rows.
    flight, science : sequence of Sensor
        Sensors to read; a sensor that the file does not have is NaN.

    Raises
    ------
    InputError
        The file cannot be read, lacks both clocks or a required sensor, or declares an impossible unit.
    """
    try:
        # The variables are loaded here, where an error of decompression is caught.
        with open_dataset(path, engine="netcdf4", decode_times=False) as stored:
            names = {FLIGHT_CLOCK, SCIENCE_CLOCK, *(sensor.name for sensor in (*flight, *science))}
            dataset = stored[[name for name in stored.variables if name in names]].load()
            is_observations = is_in_the_format(map(str, stored.variables))
    except (OSError, RuntimeError, ValueError) as error:
        content = describe_failure(path, error) or f"cannot be read as netCDF ({first_line(error)})"
        raise InputError(f"{path}: {content}") from error
    clocks = [name for name in (SCIENCE_CLOCK, FLIGHT_CLOCK) if name in dataset.variables]
    held = any(sensor.name in dataset.variables for sensor in science)
    only_science = held and not any(sensor.required and sensor.name in dataset.variables for sensor in flight)
    if is_observations:
        raise InputError(f"{path}: {IN_THE_FORMAT}")
    if not clocks or not (FLIGHT_CLOCK in clocks or only_science):
        raise InputError(f"{path}: has no {FLIGHT_CLOCK}; it must contain native sensors with the time of each record")
    return (
        _no_rows(flight) if only_science else _rows(dataset, path, part, FLIGHT_CLOCK, flight),
        _rows(dataset, path, part, clocks[0], science) if held else _no_rows(science),
    )


def _no_rows(sensors: Sequence[Sensor]) -> Rows:
    return join_rows([], [sensor.name for sensor in sensors])


def _unit(variable: xr.DataArray) -> str | None:
    """Declared unit of a variable, None without one; pyglider's raw files have it in ``unit`` instead of ``units``."""
    declared = variable.attrs.get("units", variable.attrs.get("unit"))
    return None if declared is None else str(declared)


def _rows(dataset: xr.Dataset, path: Path, part: int, clock: str, sensors: Sequence[Sensor]) -> Rows:
    seconds = _seconds(dataset[clock], path)
    columns = {sensor.name: _column(dataset, path, clock, sensor) for sensor in sensors}
    _check_positions(dataset, path)
    return rows_of_seconds(seconds, part, columns)


def _column(dataset: xr.Dataset, path: Path, clock: str, sensor: Sensor) -> FloatArray:
    if sensor.name not in dataset.variables:
        if sensor.required:
            raise InputError(
                f"{path}: has no {sensor.name} ({sensor.required}); decode the mission again, with that sensor"
            )
        return np.full(dataset[clock].shape, np.nan)
    array = dataset[sensor.name]
    if array.dims != dataset[clock].dims:
        raise InputError(
            f"{path}: {sensor.name} has dimensions ({', '.join(map(str, array.dims))}); it must have those of {clock} "
            f"({', '.join(map(str, dataset[clock].dims))})"
        )
    if not np.issubdtype(array.dtype, np.number):
        raise InputError(f"{path}: {sensor.name} does not contain numbers")
    try:
        convert = conversion(sensor.quantity, _unit(array), f"{path}: {sensor.name}")
    except UnitError as error:
        if sensor not in SCIENCE_SENSORS:
            raise
        log.warning("%s; it is left out", error)
        return np.full(array.shape, np.nan)
    values, limits = np.asarray(array.values, dtype=np.float64), declared_limits(array.variable)
    limited = describe_outside(sensor.name, values, limits)
    if limited:
        log.warning("%s: %s", path, limited)
    values = np.where(outside(values, limits), np.nan, values)
    return convert(np.where(np.isfinite(values) & ~np.isin(values, NEGATIVE_FILLS), values, np.nan))


_POSITIONS = ("m_gps_lat", "m_gps_lon")


def _check_positions(dataset: xr.Dataset, path: Path) -> None:
    """Refuse positions that are not in the declared form, DDMM.mmmm or decimal degrees.

    Programs that decode binary files convert positions to decimal degrees, and may leave the unit as it was.
    """
    if not all(name in dataset.variables for name in _POSITIONS):
        return
    latitude, longitude = (np.asarray(dataset[name].values, dtype=np.float64) for name in _POSITIONS)
    units = [(_unit(dataset[name]) or "").strip() for name in _POSITIONS]
    accepted, typical = _accepted("position in degree"), typical_position(latitude, longitude)
    if typical is None:
        return
    values = f"{path}: m_gps_lat and m_gps_lon ({typical[0]:.6g} and {typical[1]:.6g} in magnitude), "
    declared = f"in '{units[0]}' and '{units[1]}' as declared, lie"
    if all(accepted[unit.lower()] is decimal_degrees for unit in units):
        if may_be_decimal(latitude, longitude):
            raise InputError(
                f"{values}{declared} {NEAR_ZERO}; if they are decimal degrees, set their units to 'degree'; if they "
                "are DDMM.mmmm, convert them to decimal degrees and do the same"
            )
    elif all(unit.lower().startswith("deg") for unit in units) and are_not_decimal(latitude, longitude):
        raise InputError(f"{values}{declared} off the globe; if they are DDMM.mmmm, set their units to 'lat' and 'lon'")


def _seconds(clock: xr.DataArray, path: Path) -> FloatArray:
    """Times of a clock (s since 1970), decoded with the declared unit."""
    if clock.ndim != 1:
        raise InputError(f"{path}: {clock.name} has {clock.ndim} dimensions; it must have one")
    if not np.issubdtype(clock.dtype, np.number):
        raise InputError(f"{path}: {clock.name} does not contain numbers")
    unit = (_unit(clock) or "").strip()
    is_bare = unit.lower() in _BARE_SECONDS
    if not is_bare and " since " not in unit.lower():
        raise InputError(
            f"{path}: {clock.name} is in '{unit}'; it must be in seconds since 1970, or in a CF unit of time"
        )
    check_resolution(clock.values, DEFAULT_UNITS if is_bare else unit, f"{path}: {clock.name}")
    if is_bare:
        return np.asarray(clock.values, dtype=np.float64)
    calendar = str(clock.attrs.get("calendar", ""))
    nanoseconds = decode_times(clock.values, unit, calendar, f"{path}: {clock.name}").time
    seconds: FloatArray = np.where(np.isnat(nanoseconds), np.nan, nanoseconds.astype(np.int64) * 1e-9)
    return seconds
