"""Global attributes and single-valued variables of an OG1 file: platform, deployment, people, origin."""

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gliderhpc.archive.reader import Archive
from gliderhpc.observations.files.appended import AppendedFile, Column
from gliderhpc.observations.files.discovery import SHARED_ATTRIBUTES
from gliderhpc.observations.regions import bounding_polygon, longitude_range
from gliderhpc.report.exports.og1_forms import Og1Form
from gliderhpc.report.exports.og1_rows import Rows
from gliderhpc.report.exports.og1_vocabulary import REQUIRED, SINGLE
from gliderhpc.version import __version__

UNKNOWN = "unknown"


@dataclass
class Extent:
    """Minimum and maximum of the written values, by name, and number of rows.

    The limits of the longitude are the western and the eastern end (`gliderhpc.observations.regions.longitude_range`).
    """

    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    rows: int = 0

    def update(self, rows: Rows) -> None:
        """Extend the limits by the rows of a profile."""
        self.rows += len(rows["TIME"])
        longitudes = longitude_range(np.append(rows["LONGITUDE"], self.limits.get("LONGITUDE", ())))
        if longitudes:
            self.limits["LONGITUDE"] = longitudes
        for name in ("TIME", "LATITUDE", "DEPTH"):
            known = rows[name][np.isfinite(rows[name].astype(np.float64))].astype(np.float64)
            if len(known):
                low, high = self.limits.get(name, (np.inf, -np.inf))
                self.limits[name] = min(low, float(known.min())), max(high, float(known.max()))

    def attributes(self) -> dict[str, str | float]:
        """Return the global attributes for the extent in time and space."""
        names = {"LATITUDE": "geospatial_lat", "LONGITUDE": "geospatial_lon", "DEPTH": "geospatial_vertical"}
        attributes: dict[str, str | float] = {}
        for name, prefix in names.items():
            if name in self.limits:
                attributes |= zip((f"{prefix}_min", f"{prefix}_max"), self.limits[name], strict=True)
        first, last = self.limits["TIME"]
        attributes |= {"time_coverage_start": _stamp(first), "time_coverage_end": _stamp(last)}
        if {"LATITUDE", "LONGITUDE"} <= set(self.limits):
            attributes["geospatial_bounds"] = bounding_polygon(self.limits["LATITUDE"], self.limits["LONGITUDE"])
        return attributes | {
            "time_coverage_duration": f"PT{last - first:.0f}S",
            "time_coverage_resolution": f"PT{(last - first) / max(1, self.rows - 1):.0f}S",
        }


def describe_file(
    file: AppendedFile, tree: Archive, hull: str, rows: Rows, described: Mapping[str, str], form: Og1Form
) -> tuple[str, ...]:
    """Write the global attributes and the single-valued variables, and return the names of the unknown ones.

    Parameters
    ----------
    file : AppendedFile
        The file under construction.
    tree : Archive
        The archive.
    hull : str
        Name of the platform.
    rows : dict of str to array
        Rows of the first profile.
    described : mapping of str to str
        Attributes and texts from the operator.
    form : Og1Form
        Full or strict form of the file.
    """
    start = _stamp(float(rows["TIME"][0]))
    texts = _texts(tree, hull, start, described)
    _write_single(file, texts, rows, described)
    attributes = _global_attributes(tree, texts["TRAJECTORY"], start, form)
    attributes |= {name: text for name, text in form.described(described).items() if name not in _OF_VARIABLES}
    file.describe(attributes)
    missing = [name for name in REQUIRED if name not in attributes]
    return (*missing, *(name for name, value in texts.items() if value == UNKNOWN))


_OF_VARIABLES = frozenset({*SINGLE, *(f"{name.lower()}_vocabulary" for name in SINGLE)})
"""Entries of the operator that describe variables instead of the file."""


def _texts(tree: Archive, hull: str, start: str, described: Mapping[str, str]) -> dict[str, str]:
    serial = described.get("PLATFORM_SERIAL_NUMBER") or str(tree.attrs.get("platform_id") or hull).lower()
    return {
        "TRAJECTORY": f"{serial}_{start}",
        "WMO_IDENTIFIER": UNKNOWN,
        "PLATFORM_MODEL": hull,
        "PLATFORM_SERIAL_NUMBER": serial,
        **{name: value for name, value in described.items() if name in SINGLE},
    }


def _write_single(file: AppendedFile, texts: Mapping[str, str], rows: Rows, described: Mapping[str, str]) -> None:
    deployed = zip(("TIME", "LATITUDE", "LONGITUDE"), _deployment(rows), strict=True)
    values: dict[str, Any] = {**texts, **{f"DEPLOYMENT_{name}": value for name, value in deployed}}
    columns = {}
    for name in filter(values.__contains__, SINGLE):
        key = f"{name.lower()}_vocabulary"
        vocabulary = {key: described[key]} if key in described else {}
        columns[name] = Column((), np.array(values[name]), {**SINGLE[name], **vocabulary})
    file.append(columns)


def _global_attributes(tree: Archive, trajectory: str, start: str, form: Og1Form) -> dict[str, Any]:
    known = tree.attrs
    return {
        "title": "OceanGliders trajectory file",
        "platform": "sub-surface gliders",
        "platform_vocabulary": "http://vocab.nerc.ac.uk/collection/L06/current/27/",
        "id": f"{trajectory}_delayed",
        "internal_mission_identifier": str(known.get("mission") or UNKNOWN),
        "start_date": start,
        "date_created": datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%S"),
        "summary": form.summary,
        **SHARED_ATTRIBUTES,
        "geospatial_vertical_positive": "down",
        "geospatial_bounds_crs": "EPSG:4326",
        "geospatial_bounds_vertical_crs": "EPSG:5831",
        "featureType": "trajectory",
        "rtqc_method": "No QC applied",
        "rtqc_method_doi": "n/a",
        "source": f"gliderhpc {known.get('software_version', UNKNOWN)} on {known.get('observations', UNKNOWN)}, sha256 "
        f"{known.get('observations_digest', UNKNOWN)}",
        "history": f"exported by gliderhpc {__version__}",
        "comment": form.comment,
        **form.settings(tree),
    }


def _deployment(rows: Rows) -> tuple[float, float, float]:
    """Return time and position of the first row with a position, else of the first row."""
    known = np.flatnonzero(np.isfinite(rows["LATITUDE"].astype(np.float64)))
    row = int(known[0]) if len(known) else 0
    return tuple(float(rows[name][row]) for name in ("TIME", "LATITUDE", "LONGITUDE"))  # type: ignore[return-value]


def _stamp(seconds: float) -> str:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).strftime("%Y%m%dT%H%M%S")
