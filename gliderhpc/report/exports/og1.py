"""Export to OG1, profile by profile into a file that appears only when it is complete."""

import datetime
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.mission import open_for_reading, reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, done_profiles, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.observations.appended import AppendedFile, Column
from gliderhpc.observations.discovery import CONVENTIONS, MEASUREMENT, SHARED_ATTRIBUTES, content_type
from gliderhpc.report.exports import check_place, unfit_profiles
from gliderhpc.report.exports.og1_rows import Counter, Rows, ground_track, names_of, profile_rows
from gliderhpc.report.exports.og1_vocabulary import AXIS, MEASURED_TERMS, REQUIRED, SINGLE, TERMS
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.vertical import NAME as VERTICAL
from gliderhpc.version import __version__

UNKNOWN = "unknown"

_COORDINATES = frozenset({"TIME", "LATITUDE", "LONGITUDE", "DEPTH", "TIME_GPS", "LATITUDE_GPS", "LONGITUDE_GPS"})

_SUMMARY = (
    "Records of an underwater glider with what its flight model makes of them: forces and moments of the water, "
    "motion, speed through the water, currents averaged over the dives, and positions under water"
)


@dataclass
class ExportSummary:
    """Summary of an export.

    Attributes
    ----------
    path : Path
        The file.
    profiles : list of int
        Numbers of the exported profiles.
    left_out : dict of int to str
        Excluded profiles with the reason.
    rows, fixes : int
        Numbers of rows of the file, and of those with a fix.
    unknown : tuple of str
        Entries that OG1 requires and neither archive nor user provides.
    """

    path: Path
    profiles: list[int] = field(default_factory=list)
    left_out: dict[int, str] = field(default_factory=dict)
    rows: int = 0
    fixes: int = 0
    unknown: tuple[str, ...] = ()


@dataclass
class _Extent:
    """Minimum and maximum of the written values, by name."""

    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def update(self, rows: Rows) -> None:
        for name in ("TIME", "LATITUDE", "LONGITUDE", "DEPTH"):
            known = rows[name][np.isfinite(rows[name].astype(np.float64))].astype(np.float64)
            if len(known):
                low, high = self.limits.get(name, (np.inf, -np.inf))
                self.limits[name] = min(low, float(known.min())), max(high, float(known.max()))

    def attributes(self) -> dict[str, str | float]:
        names = {"LATITUDE": "geospatial_lat", "LONGITUDE": "geospatial_lon", "DEPTH": "geospatial_vertical"}
        found: dict[str, str | float] = {}
        for name, prefix in names.items():
            if name in self.limits:
                found |= zip((f"{prefix}_min", f"{prefix}_max"), self.limits[name], strict=True)
        first, last = self.limits["TIME"]
        found |= {"time_coverage_start": _stamp(first), "time_coverage_end": _stamp(last)}
        return found | {"time_coverage_duration": f"PT{last - first:.0f}S"}


def export_og1(
    archive: str | Path, out: str | Path, *, described: Mapping[str, str] | None = None, overwrite: bool = False
) -> ExportSummary:
    """Write an archive's results as an OceanGliders OG1 1.0 trajectory file.

    One profile is read and written at a time. The file appears when it is complete.

    Parameters
    ----------
    archive : str or Path
        A finished archive.
    out : str or Path
        The netCDF file to write.
    described : mapping of str to str, optional
        Global attributes (``contributor_name`` ...) and values of the text variables (``WMO_IDENTIFIER`` ...), which
        take precedence over those of the archive.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    InputError
        There is no archive, it is not finished, none of its profiles is done, or the file cannot be written.
    OSError
        The disk is full.
    """
    out, described = Path(out), dict(described or {})
    check_place(archive, out, overwrite)
    with reading(archive), open_for_reading(archive) as tree:
        summary = ExportSummary(out)
        summary.left_out = unfit_profiles(Path(archive), tree)
        numbers = done_profiles(tree)
        if not numbers:
            raise InputError(f"{archive}: no profile of the archive is done, so there is nothing to export")
        _export(tree, numbers, described, summary, overwrite=overwrite)
    return summary


def _export(
    tree: Archive, numbers: list[int], described: Mapping[str, str], summary: ExportSummary, *, overwrite: bool
) -> None:
    platform, counter, extent = platform_of(tree), Counter(), _Extent()
    with AppendedFile(summary.path, {"Conventions": f"{CONVENTIONS}, OG-1.0"}, overwrite=overwrite) as file:
        for number in numbers:
            data = read_profile_data(tree, number, ADJOINT)
            smoothed, vertical = (_row(tree, group, number) for group in (SMOOTHED, VERTICAL))
            rows = profile_rows(data, smoothed, vertical, ground_track(tree, data, platform), counter)
            if not summary.rows:
                summary.unknown = _describe(file, tree, platform.name, rows, described)
            file.append({name: _column(name, rows) for name in names_of(rows)})
            extent.update(rows)
            summary.profiles.append(number)
            summary.rows += len(rows["TIME"])
            summary.fixes += int(np.isfinite(rows["LATITUDE_GPS"].astype(np.float64)).sum())
        file.describe(extent.attributes())


def _row(tree: Archive, group: str, number: int) -> xr.Dataset | None:
    return tree[group].to_dataset().sel(profile=number).load() if group in tree.children else None


def _column(name: str, rows: Rows) -> Column:
    term, values = TERMS[name], rows[name]
    if term.fill is not None:
        values = np.where(np.isfinite(values.astype(np.float64)), values, term.fill)
    further = {"coverage_content_type": _content_type(name)}
    ancillary = [f"{name}{suffix}" for suffix in ("_QC", "_STD") if f"{name}{suffix}" in rows]
    if ancillary:
        further["ancillary_variables"] = " ".join(ancillary)
    attributes = {key: _typed(value, term.dtype) for key, value in {**term.attributes, **further}.items()}
    return Column((AXIS,), values, attributes, fill=term.fill)


def _content_type(name: str) -> str:
    if name in MEASURED_TERMS:
        return MEASUREMENT
    return content_type(name, coordinates=_COORDINATES)


def _typed(value: Any, dtype: str) -> Any:
    """Convert flag values to the number type of their variable (CF 3.5)."""
    return np.array(value, dtype=dtype) if isinstance(value, list) else value


def _describe(
    file: AppendedFile, tree: Archive, hull: str, rows: Rows, described: Mapping[str, str]
) -> tuple[str, ...]:
    """Write the global attributes and the variables of one value; return the names of the unknown ones."""
    known = tree.attrs
    serial = described.get("PLATFORM_SERIAL_NUMBER") or str(known.get("platform_id") or hull).lower()
    start = _stamp(float(rows["TIME"][0]))
    texts = {
        "TRAJECTORY": f"{serial}_{start}",
        "WMO_IDENTIFIER": UNKNOWN,
        "PLATFORM_MODEL": hull,
        "PLATFORM_SERIAL_NUMBER": serial,
        **{name: value for name, value in described.items() if name in SINGLE},
    }
    deployed = dict(zip(("TIME", "LATITUDE", "LONGITUDE"), _deployment(rows), strict=True))
    values: dict[str, Any] = {**texts, **{f"DEPLOYMENT_{name}": value for name, value in deployed.items()}}
    file.append({name: Column((), np.array(values[name]), SINGLE[name]) for name in SINGLE if name in values})
    attributes = {
        "title": "OceanGliders trajectory file",
        "platform": "sub-surface gliders",
        "platform_vocabulary": "http://vocab.nerc.ac.uk/collection/L06/current/27/",
        "id": f"{texts['TRAJECTORY']}_delayed",
        "internal_mission_identifier": str(known.get("mission") or UNKNOWN),
        "start_date": start,
        "date_created": datetime.datetime.now(datetime.UTC).strftime("%Y%m%dT%H%M%S"),
        "summary": _SUMMARY,
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
        "comment": "Forces, moments, motion and currents from attitude, depth and actuators. ADJOINT: windowed adjoint "
        "inversion, the method of record; SMOOTHED: fixed-interval smoother, the filter's estimate without deviations "
        "where it has none. HEADING is true.",
        "gliderhpc_platform": json.dumps(known.get("platform", {})),
        "gliderhpc_settings": json.dumps(known.get("settings", {})),
    } | {name: value for name, value in described.items() if name not in SINGLE}
    file.describe(attributes)
    lacking = [name for name in REQUIRED if name not in attributes]
    return (*lacking, *(name for name, value in texts.items() if value == UNKNOWN))


def _deployment(rows: Rows) -> tuple[float, float, float]:
    """Return time and position of the first row with a position, else of the first row."""
    known = np.flatnonzero(np.isfinite(rows["LATITUDE"].astype(np.float64)))
    place = int(known[0]) if len(known) else 0
    return tuple(float(rows[name][place]) for name in ("TIME", "LATITUDE", "LONGITUDE"))  # type: ignore[return-value]


def _stamp(seconds: float) -> str:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).strftime("%Y%m%dT%H%M%S")
