"""Times of a file: decoding with the CF unit, and checks of the unit and the years."""

import re
import warnings
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray, TimeArray

FIRST_YEAR, LAST_YEAR = 2000, 2099
"""Plausible years: gliders have flown missions since about 2000; an unset clock gives 1970 or 1980, a damaged one any
year."""

MAX_RESOLUTION = 10.0
"""Resolution of stored times (s) above which samples have no usable times; seconds since 1970 as float32 have 128 s."""

SECOND = np.timedelta64(1, "s")
"""Unit of elapsed times."""

EARLIEST = np.datetime64(f"{FIRST_YEAR}-01-01", "ns")
LATEST = np.datetime64(f"{LAST_YEAR + 1}-01-01", "ns")

_UNITS = re.compile(r"\s*(?P<unit>[A-Za-z]+)\s+since\s+(?P<reference>.*\S)\s*", re.IGNORECASE)
_REFERENCE = re.compile(
    r"(?P<year>\d{1,4})-(?P<month>\d{1,2})-(?P<day>\d{1,2})(?:[T ]\s*\d+(?::\d+(?::\d+(?:\.\d*)?)?)?)?\s*(?P<zone>.*)",
    re.IGNORECASE,
)
_UTC = re.compile(r"|Z|UTC|GMT|[-+]\d{1,2}(?::?\d{2})?", re.IGNORECASE)
"""Time zones that xarray decodes as CF defines them; it takes any other zone for UTC without a warning."""

_DATE = re.compile(r"\d{4}-\d\d-\d\d")
"""Begin of a time in ISO 8601; numpy takes digits alone for a year."""

_ZERO_OFFSET = re.compile(r"\s*(?:z|utc|gmt)$", re.IGNORECASE)

_SECONDS = {
    "d": 86_400.0, "day": 86_400.0, "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "min": 60.0, "minute": 60.0,
    "sec": 1.0, "second": 1.0, "millisecond": 1e-3, "msec": 1e-3, "ms": 1e-3, "microsecond": 1e-6, "us": 1e-6,
    "nanosecond": 1e-9, "ns": 1e-9, "s": 1.0,
}  # fmt: skip


@overload
def epoch_seconds(time: np.datetime64) -> float: ...


@overload
def epoch_seconds(time: TimeArray) -> FloatArray: ...


def epoch_seconds(time: np.datetime64 | TimeArray) -> float | FloatArray:
    """Seconds since 1970 of one time or of times (n,), both UTC; NaN for NaT."""
    seconds = (time - np.datetime64(0, "s")) / SECOND
    return float(seconds) if np.ndim(time) == 0 else np.asarray(seconds)


NEGATIVE_FILLS = (-999.0, -9999.0, -99999.0, -999999.0)
"""Usual values of missing samples, which some files do not declare."""


@dataclass(frozen=True, eq=False)
class DecodedTimes:
    """Times of a file.

    Attributes
    ----------
    time : (n,) array
        Times (UTC, ns), NaT where missing or implausible.
    implausible : (n,) array of bool
        Mask of the values that are present but outside the years of gliders, or undeclared fill values.
    """

    time: TimeArray
    implausible: npt.NDArray[np.bool_]

    def part(self, start: int, stop: int) -> "DecodedTimes":
        """Return a slice."""
        return DecodedTimes(self.time[start:stop], self.implausible[start:stop])


def decode_times(values: npt.NDArray[np.generic], units: str, calendar: str, where: str) -> DecodedTimes:
    """Decode times with their CF unit.

    Parameters
    ----------
    values : (n,) array
        Values in the file; NaN where missing.
    units, calendar : str
        Attributes of the variable; the calendar may be empty.
    where : str
        Names of the file and the variable in messages.

    Raises
    ------
    InputError
        The unit is not a unit of time in the standard calendar, or its reference names a time zone.
    """
    factor, begin = _unit_and_reference(units, where)
    if (written := _UNITS.fullmatch(units)) is not None:
        # xarray knows the words in lower case only.
        units = f"{written['unit'].lower()} since {written['reference']}"
    with np.errstate(invalid="ignore", over="ignore"):
        seconds = begin + values.astype(np.float64) * factor
    plausible = (seconds >= epoch_seconds(EARLIEST)) & (seconds < epoch_seconds(LATEST)) & ~_negative_fills(values)
    implausible = ~plausible & ~np.isnan(seconds)
    usable = values if plausible.all() else np.where(plausible, values.astype(np.float64), np.nan)
    # A day in the years of gliders, which tests unit and calendar even if there is no plausible time.
    probe = np.array([(epoch_seconds(EARLIEST) - begin) / factor + 86_400.0 / factor])
    time = _decoded(usable if plausible.any() else np.append(probe, usable), units, calendar, where)
    return DecodedTimes(time[len(time) - len(values) :], implausible)


def _negative_fills(values: npt.NDArray[np.generic]) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the usual fill values among times, unless there are other negative ones.

    Since a recent day, -999 s is a plausible time.
    """
    numbers = values.astype(np.float64)
    fills = np.isin(numbers, NEGATIVE_FILLS)
    with np.errstate(invalid="ignore"):
        return fills & ~(numbers[~fills] < 0.0).any()


def parse_times(texts: npt.NDArray[np.generic], where: str) -> TimeArray:
    """Read times that are written in ISO 8601, in UTC or with an offset from it.

    Parameters
    ----------
    texts : (n,) array
        Texts in the file; empty, ``nan``, ``NaT``, ``NA`` or ``null`` where missing.
    where : str
        Names of the file and the variable in messages.

    Returns
    -------
    (n,) array
        Times (UTC, ns), NaT where missing.

    Raises
    ------
    InputError
        A text is in another format; the message gives it.
    """
    stripped = np.char.strip(texts.astype("U"))
    absent = np.isin(np.char.lower(stripped), ("", "nan", "nat", "na", "null"))
    odd = next((text for text in stripped[~absent].tolist() if not _DATE.match(text)), None)
    if odd is not None:
        raise InputError(
            f"{where} has a time that is not in ISO 8601 format ('{odd}'); write it as 2024-05-01T12:00:00Z"
        )
    plain = np.where(absent, "NaT", [_ZERO_OFFSET.sub("", text) for text in stripped.tolist()])
    try:
        with warnings.catch_warnings():
            # Offsets from UTC are taken into account; the warning says that the result has no time zone.
            warnings.filterwarnings("ignore", "no explicit representation of timezones", UserWarning)
            return plain.astype("datetime64[ns]")
    except ValueError as error:
        raise InputError(f"{where} has a time that is not in ISO 8601 format ({error})") from error


def texts_in(values: npt.NDArray[Any]) -> npt.NDArray[np.str_] | None:
    """Texts in an array of strings, bytes or objects; None if it has other values, as times of an unusual calendar."""
    if values.dtype.kind == "S":
        return np.char.decode(values, "utf-8", "replace")
    if values.dtype.kind not in "OUT" or not all(isinstance(value, str) for value in values.ravel()):
        return None
    return np.asarray(values.astype("U"))


def decode_texts(texts: npt.NDArray[np.str_], where: str) -> DecodedTimes:
    """Decode times that are written in ISO 8601, as `decode_times` does numbers; for errors see `parse_times`."""
    time = parse_times(texts, where)
    implausible = ~plausible_times(time) & ~np.isnat(time)
    return DecodedTimes(np.where(implausible, np.datetime64("NaT", "ns"), time), implausible)


def check_time_unit(units: str, calendar: str, where: str) -> None:
    """Refuse a unit with which times cannot be decoded.

    Raises
    ------
    InputError
        As for `decode_times`.
    """
    decode_times(np.zeros(0), units, calendar, where)


def time_resolution(values: npt.NDArray[np.generic], units: str, where: str) -> float:
    """Distance (s) between neighbouring numbers of the type of stored times, at their median; 0 for integers.

    Parameters
    ----------
    values : (n,) array
        Values in the file.
    units : str
        Their CF unit.
    where : str
        Names of the file and the variable in messages.

    Raises
    ------
    InputError
        The unit is not a unit of time.
    """
    if not np.issubdtype(values.dtype, np.floating) or not np.isfinite(values).any():
        return 0.0
    typical = np.median(np.abs(values[np.isfinite(values)]))
    return float(np.spacing(typical.astype(values.dtype))) * _unit_and_reference(units, where)[0]


def check_resolution(values: npt.NDArray[np.generic], units: str, where: str) -> None:
    """Refuse times whose type does not resolve them (`time_resolution`).

    Raises
    ------
    InputError
        Neighbouring numbers of the type are more than `MAX_RESOLUTION` apart.
    """
    if values.dtype.itemsize >= 8:
        return
    step = time_resolution(values, units, where)
    if step > MAX_RESOLUTION:
        raise InputError(
            f"{where} is stored as {values.dtype}, which resolves '{units}' to {step:.3g} s only; store it as float64"
        )


def plausible_times(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the times that are present and in the years of gliders."""
    return np.asarray((time >= EARLIEST) & (time < LATEST))


_DAY_COUNT = re.compile(r"(?P<julian>-4713\b|-4712\b)|(?P<datenum>0{1,4}-)")
_DAY_COUNTS = {
    "julian": "Julian days: subtract 2440587.5, and write 'days since 1970-01-01'",
    "datenum": "days of MATLAB's datenum: subtract 719529, and write 'days since 1970-01-01'",
}
"""References in the years of day counts that the standard calendar lacks, and remedies."""


def _unit_and_reference(units: str, where: str) -> tuple[float, float]:
    """Length of the unit (s), and midnight of its reference day (s since 1970), accurate enough to check the years."""
    match = _UNITS.fullmatch(units)
    factor = None if match is None else _SECONDS.get(_singular(match["unit"].lower()))
    if match is not None and (counted := _DAY_COUNT.match(match["reference"])) is not None:
        raise InputError(f"{where} counts {_DAY_COUNTS[counted.lastgroup or '']} (it is in '{units}')")
    if match is None or factor is None:
        raise InputError(
            f"{where} has no CF time unit of the standard calendar ('{units}'); "
            "give it units such as 'seconds since 1970-01-01'"
        )
    reference = _REFERENCE.fullmatch(match["reference"])
    zone = "" if reference is None else reference["zone"].strip()
    if not _UTC.fullmatch(zone):
        raise InputError(
            f"{where} is in '{units}': '{zone}' is not a readable time zone; convert the times to UTC, or write "
            "the offset, such as -05:00"
        )
    try:
        # Without a match the date is 0-0-0, which is no day and raises ValueError.
        year, month, day = (int(part) for part in reference.group("year", "month", "day")) if reference else (0, 0, 0)
        midnight = np.datetime64(f"{year:04}-{month:02}-{day:02}", "s")
    except ValueError:
        raise InputError(
            f"{where} is in '{units}', which has no valid reference date; write it as 1970-01-01"
        ) from None
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
