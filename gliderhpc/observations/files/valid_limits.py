"""Limits that a file declares for its values (`valid_min`, `valid_max`, `valid_range`); those outside are missing."""

from collections.abc import Container, Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.files.columns import NamedColumns
from gliderhpc.observations.files.packed import PACKING
from gliderhpc.observations.importing.position_form import may_be_minutes
from gliderhpc.observations.records import FloatArray
from gliderhpc.wording import counted

Mask = npt.NDArray[np.bool_]

LIMITS = ("valid_min", "valid_max", "valid_range")
"""Attributes that declare the limits of a variable's values."""

_NAMES = f"{', '.join(LIMITS[:-1])} or {LIMITS[-1]}"

_MAX_OUTSIDE = 0.5
"""Fraction of the values outside the limits above which the limits, or the unit of the values, are wrong."""

_SLIGHT = 1e-3
"""Excess over a limit, relative to the greatest magnitude of the values, that needs no remark."""

_LATITUDES = (-90.0, 90.0)
"""Limits of a latitude (degree)."""

_ROUNDING = 1e-6
"""Relative rounding of a value or limit in single precision."""


def limits_of(attributes: Mapping[str, Any], packing: Mapping[str, Any], dtype: Any) -> tuple[float, float] | None:
    """Limits of a variable's values after unpacking; None if its attributes declare none that can be used.

    Limits of packed integers are integers and packed in the same way, by the netCDF conventions; other limits are those
    of the unpacked values.

    Parameters
    ----------
    attributes, packing : mapping of str to value
        Attributes of the variable, and those of `PACKING`.
    dtype : dtype
        Type of the stored values.
    """
    pairs = ((attributes.get("valid_min"), None), (None, attributes.get("valid_max")))
    ends = [(low, high) for low, high in pairs if low is not None or high is not None]
    both = np.ravel(attributes.get("valid_range", ()))
    ends += [(both[0], both[1])] if both.size == 2 else []
    low, high = -np.inf, np.inf
    for lower, upper in ends:
        low, high = max(low, _limit(lower, packing, dtype, -np.inf)), min(high, _limit(upper, packing, dtype, np.inf))
    return (low, high) if low < high and (np.isfinite(low) or np.isfinite(high)) else None


def _limit(value: Any, packing: Mapping[str, Any], dtype: Any, without: float) -> float:
    """Return one limit after unpacking; `without` if the attribute is no number."""
    limit = np.ravel(np.asarray(without if value is None else value))
    if limit.size != 1 or limit.dtype.kind not in "fiu" or np.isnan(limit[0]):
        return without
    if value is None or not (np.dtype(dtype).kind in "iu" and limit.dtype.kind in "iu"):
        return float(limit[0])
    factor, offset = (float(np.ravel(packing.get(name, usual))[0]) for name, usual in zip(PACKING, (1, 0), strict=True))
    return float(limit[0]) * factor + offset


def outside(values: FloatArray, limits: tuple[float, float] | None) -> Mask:
    """Mask ``(n,)`` of the values outside some limits."""
    if limits is None:
        return np.zeros(np.shape(values), dtype=bool)
    low, high = (limit - sign * _ROUNDING * abs(limit) for limit, sign in zip(limits, (1.0, -1.0), strict=True))
    with np.errstate(invalid="ignore"):
        return np.asarray((values < low) | (values > high))


def declared_limits(variable: xr.Variable) -> tuple[float, float] | None:
    """Limits of a variable's unpacked values; None if it declares none that can be used."""
    packing = variable.encoding
    return limits_of(variable.attrs, packing, packing.get("dtype", variable.dtype))


def describe_outside(
    name: str, values: FloatArray, limits: tuple[float, float] | None, *, refuse_in: str = "", what: str = "sample"
) -> str:
    """Describe in one sentence the values of a variable outside the limits that it declares; empty without any.

    Values just outside, such as a depth of -0.1 m at the surface, are not worth a remark if there are no others.

    Parameters
    ----------
    name : str
        Name of the variable.
    values : (n,) array
        Its unpacked values, NaN where missing.
    limits : tuple of float or None
        The limits.
    refuse_in : str
        Name of the file if it is of no use without the variable.
    what : str
        Name of one value.

    Raises
    ------
    InputError
        Most values are outside, and the file is of no use without them.
    """
    lost = outside(values, limits)
    if limits is None or not lost.any() or not _exceeds(values, limits).any():
        return ""
    first, found, count = int(np.flatnonzero(lost)[0]), np.count_nonzero(lost), np.count_nonzero(np.isfinite(values))
    text = (
        f"{name} is outside the limits that the file declares, {_describe(limits)}, in "
        f"{found} of {counted(int(count), what)}, the first {values[first]:g} at {what} {first}"
    )
    if refuse_in and found > _MAX_OUTSIDE * count:
        raise InputError(f"{refuse_in}: {text}; correct {_NAMES}, or convert the values to the unit of these")
    if limits == _LATITUDES and may_be_minutes(values, np.zeros(len(values))):
        return f"{text}; these are treated as missing: convert the positions from DDMM.mmm to decimal degrees"
    return f"{text}; these are treated as missing: if they are right, correct {_NAMES}"


def _exceeds(values: FloatArray, limits: tuple[float, float]) -> Mask:
    """Mask ``(n,)`` of the values that are more than slightly outside some limits."""
    margin = _SLIGHT * float(np.nanmax(np.abs(values)))
    return outside(values, (limits[0] - margin, limits[1] + margin))


def _describe(limits: tuple[float, float]) -> str:
    low, high = (f"{limit:g}" for limit in limits)
    return (
        f"{low} to {high}" if np.isfinite(limits).all() else f"at least {low}" if high == "inf" else f"at most {high}"
    )


def check_limits(columns: NamedColumns, names: Iterable[str], needed: Container[str] = ()) -> list[str]:
    """Remarks on the values of some variables outside the limits that their file declares.

    Parameters
    ----------
    columns : NamedColumns
        The file.
    names : iterable of str
        Names of the variables.
    needed : container of str
        Names of those without which the file is of no use.

    Raises
    ------
    InputError
        Most values of a needed variable are outside its limits.
    """
    limits = {name: columns.limits(name) for name in dict.fromkeys(names)}
    remarks = (
        describe_outside(name, columns.unlimited(name), each, refuse_in=columns.source if name in needed else "")
        for name, each in limits.items()
        if each is not None
    )
    return [remark for remark in remarks if remark]
