"""Discovery attributes (ACDD 1.3), by which data centres find and describe a file, from the file's own content."""

import datetime
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.observations.regions import bounding_polygon, longitude_range
from gliderhpc.observations.times import SECOND

CONVENTIONS = "CF-1.11, ACDD-1.3"

_KEYWORDS = "EARTH SCIENCE > OCEANS > OCEAN CIRCULATION > OCEAN CURRENTS, underwater glider, depth-averaged current"
"""Keywords: terms of NASA's GCMD and plain terms."""

SHARED_ATTRIBUTES = {
    "keywords": _KEYWORDS,
    "standard_name_vocabulary": "CF Standard Name Table v90",
    "processing_level": "derived from the glider's records by a flight model",
}
"""Global attributes that all files of estimates share."""

COORDINATE, ESTIMATE, QUALITY, AUXILIARY = "coordinate", "modelResult", "qualityInformation", "auxiliaryInformation"
MEASUREMENT = "physicalMeasurement"
"""Values of the attribute coverage_content_type (ISO 19115)."""


def content_type(name: str, *, coordinates: frozenset[str]) -> str:
    """Classify a variable of a file of estimates by its name: coordinate, quality, auxiliary or estimate."""
    lower = name.lower()
    if name in coordinates:
        return COORDINATE
    if lower.endswith(("_std", "_error", "_covariance", "_qc")):
        return QUALITY
    return AUXILIARY if lower.endswith(("_count", "_number", "_bounds", "_method", "_estimate")) else ESTIMATE


def discovery_attributes(
    summary: str, time: np.ndarray, latitude: np.ndarray, longitude: np.ndarray, depth: np.ndarray, identifier: str
) -> dict[str, Any]:
    """Return the global attributes for discovery.

    Parameters
    ----------
    summary : str
        Paragraph on the content.
    time : (n,) datetime64
        Times; NaT where missing.
    latitude, longitude, depth : (n,), (n,), (m,)
        Positions (degrees) and depths (m, positive down); NaN where missing.
    identifier : str
        Identifier of the file.
    """
    attributes: dict[str, Any] = {
        "summary": summary,
        "id": identifier,
        **SHARED_ATTRIBUTES,
        "date_created": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }
    known = time[~np.isnat(time)]
    if len(known):
        first, last = (value.astype("datetime64[s]") for value in (known.min(), known.max()))
        seconds = int((last - first) / SECOND)
        attributes |= {
            "time_coverage_start": f"{first}Z", "time_coverage_end": f"{last}Z",
            "time_coverage_duration": f"PT{seconds}S",
            "time_coverage_resolution": f"PT{seconds // max(1, len(known) - 1)}S",
        }  # fmt: skip
    latitudes, longitudes, down = _range(latitude), longitude_range(longitude), _range(depth)
    if latitudes and longitudes:
        (south, north), (west, east) = latitudes, longitudes
        attributes |= {
            "geospatial_lat_min": south, "geospatial_lat_max": north, "geospatial_lat_units": "degrees_north",
            "geospatial_lon_min": west, "geospatial_lon_max": east, "geospatial_lon_units": "degrees_east",
            "geospatial_bounds": bounding_polygon(latitudes, longitudes),
            "geospatial_bounds_crs": "EPSG:4326",
        }  # fmt: skip
    if down:
        attributes |= {
            "geospatial_vertical_min": down[0], "geospatial_vertical_max": down[1],
            "geospatial_vertical_positive": "down", "geospatial_vertical_units": "m",
            "geospatial_bounds_vertical_crs": "EPSG:5831",
        }  # fmt: skip
    return attributes


def _range(values: np.ndarray) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if len(known) else None


def with_content_types(content: xr.Dataset) -> xr.Dataset:
    """Add the content type to every variable of a Dataset of estimates, and the note on leap seconds to every time."""
    coordinates = frozenset(map(str, content.coords))
    for name, variable in content.variables.items():
        # Bounds have the attributes of their coordinate (CF 7.1).
        if not str(name).endswith("_bounds"):
            variable.attrs.setdefault("coverage_content_type", content_type(str(name), coordinates=coordinates))
        if np.issubdtype(variable.dtype, np.datetime64) or "calendar" in variable.attrs:
            variable.attrs.setdefault("units_metadata", "leap_seconds: none")
    return content
