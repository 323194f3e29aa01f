"""Depth-averaged currents of an OG1 file on a separate axis: one row for each dive between two fixes.

OG1 1.0 has only the axis of measurements. An axis of surfacings (``N_SURFACING``) has been proposed for quantities of a
dive, such as the current between two fixes. The variables are in a separate group, since programs that select rows of a
whole file with xarray would otherwise repeat them for every row.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.current import adopted_current
from gliderhpc.archive.profile import ProfileData
from gliderhpc.observations.files.appended import Column
from gliderhpc.observations.files.discovery import content_type
from gliderhpc.observations.fixes import midpoint
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.report.exports.og1_vocabulary import (
    CURRENT_ESTIMATES,
    LATITUDE_ATTRIBUTES,
    LONGITUDE_ATTRIBUTES,
    TIME_ATTRIBUTES,
)
from gliderhpc.studies.library.tracks import fix_of

AXIS = "N_SURFACING"
GROUP = "surfacings"
CHUNK = 512
"""Number of rows in a chunk along the axis of surfacings."""

_AT = "DAC_TIME DAC_LATITUDE DAC_LONGITUDE"
_COORDINATES = frozenset({"DAC_TIME", "DAC_TIME_START", "DAC_TIME_END", "DAC_LATITUDE", "DAC_LONGITUDE"})


def _component(towards: str) -> dict[str, Any]:
    return {
        "long_name": f"depth-averaged current to the {towards}",
        "standard_name": f"{towards}ward_sea_water_velocity",
        "units": "m s-1",
        "coordinates": _AT,
        "ancillary_variables": f"DAC_{towards.upper()}_STD DAC_COVARIANCE DAC_ESTIMATE",
        "comment": "mean between the fixes before and after the dive over the depths that the glider flew through; the "
        "same as DAVG_CURR_" + towards.upper() + " on the rows of the dive",
    }


def _deviation(towards: str) -> dict[str, Any]:
    return {"long_name": f"standard deviation of DAC_{towards.upper()}", "units": "m s-1", "coordinates": _AT}


_ATTRIBUTES: Mapping[str, Mapping[str, Any]] = {
    "DAC_TIME": {"long_name": "time halfway between the fixes before and after the dive", "standard_name": "time",
                 **TIME_ATTRIBUTES},
    "DAC_TIME_START": {"long_name": "time of the fix before the dive", **TIME_ATTRIBUTES},
    "DAC_TIME_END": {"long_name": "time of the fix after the dive", **TIME_ATTRIBUTES},
    "DAC_LATITUDE": {"long_name": "latitude midway between the two fixes", **LATITUDE_ATTRIBUTES},
    "DAC_LONGITUDE": {"long_name": "longitude midway between the two fixes", **LONGITUDE_ATTRIBUTES},
    "DAC_DIVE_NUMBER": {"long_name": "number of the profile in the archive", "units": "1", "coordinates": _AT},
    "DAC_NORTH": _component("north"),
    "DAC_EAST": _component("east"),
    "DAC_NORTH_STD": _deviation("north"),
    "DAC_EAST_STD": _deviation("east"),
    "DAC_COVARIANCE": {"long_name": "covariance of DAC_NORTH and DAC_EAST", "units": "m2 s-2", "coordinates": _AT},
    "DAC_ESTIMATE": {"long_name": "method that gave DAC_NORTH and DAC_EAST", "units": "1", "coordinates": _AT,
                     "flag_values": np.array(list(CURRENT_ESTIMATES.values()), dtype=np.int8),
                     "flag_meanings": " ".join(CURRENT_ESTIMATES)},
}  # fmt: skip


def dive_columns(data: ProfileData) -> dict[str, Column]:
    """Return the row of one dive; nothing if it has no current, because a fix before or after it is missing."""
    entry, last, current = fix_of(data.table, "entry"), fix_of(data.table, "exit"), adopted_current(data.table)
    if entry is None or last is None or not bool(current.known):
        return {}
    start, end = epoch_seconds(entry.time), epoch_seconds(last.time)
    latitude, longitude = midpoint((entry.latitude, entry.longitude), (last.latitude, last.longitude))
    values = {
        "DAC_TIME": 0.5 * (start + end),
        "DAC_TIME_START": start,
        "DAC_TIME_END": end,
        "DAC_LATITUDE": latitude,
        "DAC_LONGITUDE": wrapped_longitude(longitude),
        "DAC_DIVE_NUMBER": np.int32(data.number),
        "DAC_NORTH": float(current.north),
        "DAC_EAST": float(current.east),
        "DAC_NORTH_STD": float(current.north_std),
        "DAC_EAST_STD": float(current.east_std),
        "DAC_COVARIANCE": float(current.covariance),
        "DAC_ESTIMATE": np.int8(CURRENT_ESTIMATES[str(current.estimate)]),
    }
    return {f"{GROUP}/{name}": _column(name, np.array([value])) for name, value in values.items()}


def _column(name: str, values: NDArray[np.generic]) -> Column:
    kind = content_type(name, coordinates=_COORDINATES)
    return Column((AXIS,), values, {**_ATTRIBUTES[name], "coverage_content_type": kind})
