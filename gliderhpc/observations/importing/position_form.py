"""Form of positions in a glider's own files: degrees and minutes (DDMM.mmm), or decimal degrees.

Read in the wrong form, a position is far off but plausible: 27.5 degrees north, read as DDMM.mmm, is 27.5 minutes.
"""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray

_MAX_DEGREE_MINUTES = (9060.0, 18_060.0)
"""Limits of latitude and longitude as DDMM.mmm; larger values are junk."""

_DECIMALS = 1e-4
"""Last decimal in which a glider writes DDMM.mmm, at most."""

NEAR_ZERO = "within 2 degrees of 0 N, 0 E"
"""Region in which every number that is a position in decimal degrees lies if it is read as DDMM.mmm."""


def typical_position(latitude: FloatArray, longitude: FloatArray) -> tuple[float, float] | None:
    """Return the medians of the magnitudes of positions in either form, without junk; None if there is no position.

    Parameters
    ----------
    latitude, longitude : (n,) arrays
        Positions, NaN where missing; 0 N, 0 E is a missing position too.
    """
    known = _known(latitude, longitude)
    if not known.any():
        return None
    return float(np.median(np.abs(latitude[known]))), float(np.median(np.abs(longitude[known])))


def may_be_decimal(latitude: FloatArray, longitude: FloatArray) -> bool:
    """Return whether positions ``(n,)`` that should be DDMM.mmm could also be in decimal degrees."""
    typical = typical_position(latitude, longitude)
    return typical is not None and typical[0] <= 90.0 and typical[1] <= 180.0


def are_not_minutes(latitude: FloatArray, longitude: FloatArray) -> bool:
    """Return whether numbers ``(n,)`` cannot be DDMM.mmm: more than 60 minutes, or more than four decimals."""
    known = _known(latitude, longitude)
    values = np.abs(np.concatenate([latitude[known], longitude[known]]))
    finer = np.abs(values - np.round(values / _DECIMALS) * _DECIMALS) > 0.01 * _DECIMALS
    return bool(np.any(np.mod(values, 100.0) >= 60.0) or np.any(finer))


def may_be_minutes(latitude: FloatArray, longitude: FloatArray) -> bool:
    """Return whether positions ``(n,)`` that should be in decimal degrees are off the globe and may be DDMM.mmm."""
    known = _known(latitude, longitude)
    minutes = np.mod(np.abs(np.concatenate([latitude[known], longitude[known]])), 100.0)
    return are_not_decimal(latitude, longitude) and bool((minutes < 60.0).all())


def are_not_decimal(latitude: FloatArray, longitude: FloatArray) -> bool:
    """Return whether positions ``(n,)`` that should be in decimal degrees lie off the globe, as DDMM.mmm does."""
    typical = typical_position(latitude, longitude)
    return typical is not None and (typical[0] > 90.0 or typical[1] > 180.0)


def _known(latitude: FloatArray, longitude: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the positions that are present and not junk."""
    with np.errstate(invalid="ignore"):
        known = (np.abs(latitude) <= _MAX_DEGREE_MINUTES[0]) & (np.abs(longitude) <= _MAX_DEGREE_MINUTES[1])
    return np.asarray(known & ((latitude != 0.0) | (longitude != 0.0)))
