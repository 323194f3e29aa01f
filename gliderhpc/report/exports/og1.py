"""Export to OG1, written profile by profile into a file that appears only when it is complete."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from gliderhpc.archive.mission import archive_errors, open_for_reading
from gliderhpc.archive.profile import ADJOINT, SMOOTHED, done_profiles, read_profile_data
from gliderhpc.archive.reader import Archive
from gliderhpc.errors import InputError
from gliderhpc.observations.files.appended import AppendedFile
from gliderhpc.observations.files.discovery import CONVENTIONS
from gliderhpc.report.exports import check_export_path, unfit_profiles
from gliderhpc.report.exports import og1_dives as dives
from gliderhpc.report.exports.og1_forms import FULL, STRICT, Og1Form
from gliderhpc.report.exports.og1_metadata import Extent, describe_file
from gliderhpc.report.exports.og1_rows import Counter, ground_track, profile_rows
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.vertical import NAME as VERTICAL


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
        Number of rows of the file, and number of those with a fix.
    unknown : tuple of str
        Entries required by OG1 that neither archive nor user provides.
    """

    path: Path
    profiles: list[int] = field(default_factory=list)
    left_out: dict[int, str] = field(default_factory=dict)
    rows: int = 0
    fixes: int = 0
    unknown: tuple[str, ...] = ()


def export_og1(
    archive: str | Path,
    out: str | Path,
    *,
    described: Mapping[str, str] | None = None,
    community: bool = False,
    overwrite: bool = False,
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
    community : bool
        Write a strict file for data centres: only the variables of the OG1 manual, each with its term.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    InputError
        The archive does not exist, is not finished or has no profile that is done, or the file cannot be written.
    OSError
        The disk is full.
    """
    out, described = Path(out), dict(described or {})
    check_export_path(archive, out, overwrite)
    with archive_errors(archive) as check_unchanged, open_for_reading(archive) as tree:
        summary = ExportSummary(out)
        summary.left_out = unfit_profiles(archive, tree)
        starts = tree.to_dataset()["start_time"]
        numbers = sorted(done_profiles(tree), key=lambda number: starts.sel(profile=number).values)
        if not numbers:
            raise InputError(f"{archive}: no profile of the archive is done, so there is nothing to export")
        form = STRICT if community else FULL
        with _appended_file(summary.path, overwrite) as file:
            _export(file, tree, numbers, described, summary, form)
            check_unchanged()
    return summary


def _appended_file(out: Path, overwrite: bool) -> AppendedFile:
    conventions = {"Conventions": f"{CONVENTIONS}, OG-1.0"}
    return AppendedFile(out, conventions, {dives.AXIS: dives.CHUNK}, overwrite=overwrite)


def _export(
    file: AppendedFile,
    tree: Archive,
    numbers: list[int],
    described: Mapping[str, str],
    summary: ExportSummary,
    form: Og1Form,
) -> None:
    platform, counter, extent = platform_of(tree), Counter(), Extent()
    for number in numbers:
        data = read_profile_data(tree, number, ADJOINT)
        smoothed, vertical = (_row(tree, group, number) for group in (SMOOTHED, VERTICAL))
        rows = profile_rows(data, smoothed, vertical, ground_track(tree, data, platform), counter)
        if not summary.rows:
            summary.unknown = describe_file(file, tree, platform.name, rows, described, form)
        file.append(form.columns(data, rows))
        extent.update(rows)
        summary.profiles.append(number)
        summary.rows += len(rows["TIME"])
        summary.fixes += int(np.isfinite(rows["LATITUDE_GPS"].astype(np.float64)).sum())
    file.describe(extent.attributes())


def _row(tree: Archive, group: str, number: int) -> xr.Dataset | None:
    return tree[group].to_dataset().sel(profile=number).load() if group in tree.children else None
