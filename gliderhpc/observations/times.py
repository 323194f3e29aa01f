"""Times of a file: decoded by its CF unit, refused where the unit or the years cannot be right."""

import re
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.records import TimeArray

FIRST_YEAR, LAST_YEAR = 2000, 2099
"""Gliders have flown missions since about 2000; a clock that is not set gives 1970 or 1980, a damaged one anything."""

EARLIEST = np.datetime64(f"{FIRST_YEAR}-01-01", "ns")
LATEST = np.datetime64(f"{LAST_YEAR + 1}-01-01", "ns")

_UNITS = re.compile(r"\s*(?P<unit>[A-Za-z]+)\s+since\s+(?P<reference>.*\S)\s*", re.IGNORECASE)
_REFERENCE = re.compile(
    r"(?P<year>\d{1,4})-(?P<month>\d{1,2})-(?P<day>\d{1,2})(?:[T ]\s*\d+(?::\d+(?::\d+(?:\.\d*)?)?)?)?\s*(?P<zone>.*)",
    re.IGNORECASE,
)
_UTC = re.compile(r"|Z|UTC|GMT|[-+]\d{1,2}(?::?\d{2})?", re.IGNORECASE)
"""Zones that xarray and CF understand alike; it takes any other for UTC without a warning."""

_SECONDS = {
    "d": 86_400.0, "day": 86_400.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "min": 60.0, "minute": 60.0,
    "sec": 1.0, "second": 1.0, "millisecond": 1e-3, "msec": 1e-3, "ms": 1e-3, "microsecond": 1e-6, "us": 1e-6,
    "nanosecond": 1e-9, "ns": 1e-9, "s": 1.0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class DecodedTimes:
    """Times of a file.

    Attributes
    ----------
    time : (n,) array
        UTC (ns), NaT where missing or implausible.
    implausible : (n,) array of bool
        Values that are there, but outside the years of gliders, or no numbers.
    """

    time: TimeArray
    implausible: npt.NDArray[np.bool_]


def decode_times(values: npt.NDArray[np.generic], units: str, calendar: str, where: str) -> DecodedTimes:
    """Decode times by their CF unit.

    Parameters
    ----------
    values : (n,) array
        Values of the file; NaN is missing.
    units, calendar : str
        Attributes of the variable; the calendar may be empty.
    where : str
        File and variable, for messages.

    Raises
    ------
    InputError
        The unit is none of time in the standard calendar, or its reference is in a time zone by name.
    """
    factor, begin = _unit_and_reference(units, where)
    with np.errstate(invalid="ignore", over="ignore"):
        seconds = begin + values.astype(np.float64) * factor
    plausible = (seconds >= _since_1970(EARLIEST)) & (seconds < _since_1970(LATEST))
    implausible = ~plausible & ~np.isnan(seconds)
    usable = values if plausible.all() else np.where(plausible, values.astype(np.float64), np.nan)
    # A day in the years of gliders, so that unit and calendar are tried even where there is no time.
    probe = np.array([(_since_1970(EARLIEST) - begin) / factor + 86_400.0 / factor])
    time = _decoded(usable if plausible.any() else np.append(probe, usable), units, calendar, where)
    return DecodedTimes(time[len(time) - len(values) :], implausible)


def check_time_unit(units: str, calendar: str, where: str) -> None:
    """Refuse a unit that no times can be decoded by.

    Raises
    ------
    InputError
        As `decode_times`.
    """
    decode_times(np.zeros(0), units, calendar, where)


def plausible_times(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the times that are present and in the years of gliders."""
    return np.asarray((time >= EARLIEST) & (time < LATEST))


def _unit_and_reference(units: str, where: str) -> tuple[float, float]:
    """Length of the unit, and the day of its reference since 1970, near enough to judge the years (s)."""
    match = _UNITS.fullmatch(units)
    factor = None if match is None else _SECONDS.get(_singular(match["unit"].lower()))
    if match is None or factor is None:
        raise InputError(
            f"{where} has no CF time unit of the standard calendar ('{units}'); "
            "give it units such as 'seconds since 1970-01-01'"
        )
    reference = _REFERENCE.fullmatch(match["reference"])
    zone = "" if reference is None else reference["zone"].strip()
    if not _UTC.fullmatch(zone):
        raise InputError(
            f"{where} is in '{units}': '{zone}' is no time zone that can be read; convert the times to UTC, or write "
            "the offset, such as -05:00"
        )
    try:
        # Without a match there are no parts, and no day either.
        year, month, day = (int(part) for part in reference.group("year", "month", "day")) if reference else (0, 0, 0)
        midnight = np.datetime64(f"{year:04}-{month:02}-{day:02}", "s")
    except ValueError:
        raise InputError(f"{where} is in '{units}', which names no day; write the reference as 1970-01-01") from None
    return factor, float(midnight.astype(np.int64))


def _singular(unit: str) -> str:
    return unit if unit in _SECONDS else unit.removesuffix("s")


def _decoded(values: npt.NDArray[np.generic], units: str, calendar: str, where: str) -> TimeArray:
    attributes = {"units": " ".join(units.split()), **({"calendar": calendar} if calendar else {})}
    try:
        decoded = xr.conventions.decode_cf_variable("time", xr.Variable(("sample",), values, attributes)).values
    except (ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{where} is in '{units}', which cannot be decoded by the CF conventions ({reason})"
        ) from error
    if not np.issubdtype(decoded.dtype, np.datetime64):
        raise InputError(
            f"{where} has no CF time unit of the standard calendar; give it units such as 'seconds since 1970-01-01'"
        )
    return np.asarray(decoded, dtype="datetime64[ns]")


def _since_1970(time: np.datetime64) -> float:
    return float((time - np.datetime64(0, "ns")) / np.timedelta64(1, "s"))
