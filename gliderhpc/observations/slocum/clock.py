"""The glider's clock: seconds since 1970 that are now and then junk."""

import numpy as np

from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Rows
from gliderhpc.observations.times import EARLIEST, LATEST

_EARLIEST, _LATEST = (float((time - np.datetime64(0, "s")) / np.timedelta64(1, "s")) for time in (EARLIEST, LATEST))
"""A clock that is not set says 1970."""


def rows_of_seconds(seconds: FloatArray, part: int, columns: dict[str, FloatArray]) -> Rows:
    """Rows of one file from its clock; a time that no glider flew at becomes missing (NaT)."""
    plausible = (seconds > _EARLIEST) & (seconds < _LATEST)
    nanoseconds = np.rint(np.where(plausible, seconds, 0.0) * 1e9).astype(np.int64).astype("datetime64[ns]")
    nanoseconds[~plausible] = np.datetime64("NaT", "ns")
    return Rows(nanoseconds, np.full(len(seconds), part, dtype=np.int64), columns)
