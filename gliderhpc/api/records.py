"""Observations: opened from a file, made from an instrument's own records, or checked before they are inverted."""

import logging
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.api.arguments import HullArgument, Profiles, platform_of, profiles_text, settings_of
from gliderhpc.api.import_options import check_option_names, check_option_values
from gliderhpc.archive.mission import check_is_path
from gliderhpc.errors import InputError
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.observations.checks.suitability import describe_suitability
from gliderhpc.observations.files.file_content import describe_missing
from gliderhpc.observations.files.foreign import ForeignFile, importer_of, refuse_compressed
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.files.tables import is_table, read_table
from gliderhpc.observations.importing.workflow import ImportSummary
from gliderhpc.observations.in_memory import Records, opened_records, read_records
from gliderhpc.observations.instruments.og1 import import_og1
from gliderhpc.observations.instruments.seaexplorer import import_seaexplorer
from gliderhpc.observations.instruments.seaexplorer_files import is_seaexplorer_file
from gliderhpc.observations.instruments.seaglider import import_seaglider, is_seaglider_file, refuse_raw_files
from gliderhpc.observations.instruments.slocum import import_slocum
from gliderhpc.observations.instruments.slocum_files import is_binary
from gliderhpc.observations.navigation.columns import NavigationColumns
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.record_checks import Inspection, inspect_records
from gliderhpc.wording import most_frequent_reason

log = logging.getLogger("gliderhpc.import")

IMPORTERS: Mapping[str, Callable[..., ImportSummary]] = {
    "seaexplorer": import_seaexplorer,
    "slocum": import_slocum,
    "seaglider": import_seaglider,
    "og1": import_og1,
}
"""Importers by kind of records."""

_MAX_OPENED_FILES = 20
"""Number of netCDF files in a folder that are opened to detect their kind: all files of a mission are of one kind."""


def open_records(path: str | Path) -> xr.Dataset:
    """Open and check an observation file; import records of another kind that can be inverted.

    Parameters
    ----------
    path : str or Path
        A netCDF-4 file or a Zarr folder in the observation format; or records that `import_records` reads: a folder of
        a glider's own files, a Seaglider's dive, sensors of a Slocum, OG1 with controls.

    Returns
    -------
    xarray.Dataset
        The variables of the format along ``time`` and ``fix``, with units and CF attributes; values are read when they
        are used. The Dataset may be edited before it is passed to other functions.

    Raises
    ------
    InputError
        The file cannot be read, lacks a required variable, has one in a wrong unit, or its time runs backwards; the
        message names the variable and the first bad sample. Faults of single profiles raise no error here.
    """
    check_is_path(path, "records")
    path = Path(path)
    return import_records(path) if _can_be_imported(path) else read_records(path)


def _can_be_imported(path: Path) -> bool:
    """Return whether a path contains an instrument's records; false if unreadable, which the reader reports later."""
    if not path.exists():
        return False
    try:
        return any(kind_of_file(file) is not None for file in _files(path))
    except InputError:
        return False


def import_records(files: str | Path | Iterable[str | Path], kind: str | None = None, **options: Any) -> xr.Dataset:
    """Make observations from an instrument's own records.

    Parameters
    ----------
    files : str, Path or iterable of these
        The glider's files, or the folders that contain them.
    kind : str, optional
        ``"seaexplorer"``, ``"slocum"``, ``"seaglider"`` or ``"og1"``; detected from the files by default.
    **options
        Options of the importer, such as ``linear_scale=5e-4`` (SeaExplorer), ``declination=-9.2``.

    Returns
    -------
    xarray.Dataset
        Observations like those of `open_records`, in memory; ``.to_netcdf("m12.nc")`` saves them. Anything left out is
        named in the attributes or the log.

    Raises
    ------
    InputError
        The files cannot be used, are of an unknown kind, or are of several kinds.
    """
    if isinstance(files, Mapping | xr.Dataset) or hasattr(files, "columns"):
        raise InputError(f"files: give the instrument's files or folders, not a {type(files).__name__}")
    sources = [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
    if not sources:
        raise InputError("files: none given; give the glider's files, or the folder that holds them")
    if kind is None:
        kind = kind_of(sources)
    with tempfile.TemporaryDirectory(prefix="gliderhpc-import-") as folder:
        out = Path(folder) / "records.nc"
        summary = import_as(kind, sources, out, options)
        with read_records(out) as records:
            loaded = records.load()
    loaded.encoding.pop("source")
    for remark in summary.remarks:
        log.info(remark)
    for what, why in summary.rejected.items():
        log.warning("%s: left out: %s", what, why)
    return loaded


def import_as(
    kind: str,
    sources: Sequence[Path],
    out: Path,
    options: Mapping[str, Any],
    *,
    overwrite: bool = False,
    reads: Reads = read_directly,
) -> ImportSummary:
    """Import an instrument's files of one kind into a file, with options of the importer.

    Raises
    ------
    InputError
        There is no such kind or option, an option's value cannot be used, or the files cannot be used.
    """
    if kind not in IMPORTERS:
        raise InputError(f"kind={kind!r}: give one of {', '.join(IMPORTERS)}")
    check_option_names(kind, options)
    check_option_values(options)
    converted = {name: Path(value) if name == "cache" and value else value for name, value in options.items()}
    return IMPORTERS[kind](sources, out, **converted, overwrite=overwrite, reads=reads)


def kind_of(sources: Sequence[Path]) -> str:
    """Find the kind of an instrument's records from the names of its files and the content of netCDF files.

    Raises
    ------
    InputError
        There is no such file, its kind is unknown, or the files are of several kinds.
    """
    kinds: dict[str, Path] = {}
    for source in sources:
        if not source.exists():
            raise InputError(f"{source}: {describe_missing(source)}")
        for path in _files(source):
            kind = kind_of_file(path)
            if kind is not None:
                kinds.setdefault(kind, path)
    if len(kinds) > 1:
        (first, first_path), (second, second_path), *_ = kinds.items()
        raise InputError(
            f"{first_path} is of kind {first}, and {second_path} of kind {second}; give the files of one kind, or set "
            "kind"
        )
    if not kinds:
        _refuse_with_needs(sources)
        refuse_compressed(path for source in sources for path in _files(source))
        refuse_raw_files(sources)
        raise InputError(
            f"{', '.join(map(str, sources))}: not recognised as a glider's records by name or content; "
            f"give their kind, one of {', '.join(IMPORTERS)} (`gliderhpc import KIND`)"
        )
    return next(iter(kinds))


def _refuse_with_needs(sources: Sequence[Path]) -> None:
    """Raise an error that names the variables missing from the first netCDF file or table."""
    for path in (file for source in sources for file in _files(source)):
        if is_table(path):
            raise InputError(describe_suitability(NavigationColumns(read_table(path), str(path))))
        if path.suffix.lower() == ".nc":
            with ForeignFile(path) as file:
                raise InputError(describe_suitability(file))


def is_instrument_file(path: Path) -> bool:
    """Return whether a file, or anything in a folder, is an instrument's own record that has to be imported first.

    Raises
    ------
    InputError
        There is no such file.
    """
    if not path.exists():
        raise InputError(f"{path}: {describe_missing(path)}")
    if path.is_dir():
        return any(is_instrument_file(file) for file in _files(path))
    if kind_by_name(path) is not None:
        return True
    if path.suffix.lower() != ".nc":
        return False
    with ForeignFile(path) as file:
        importer = importer_of(file.names)
    # OG1 needs no import: its variables are read by name.
    return importer is not None and importer[0] != "og1"


def _files(source: Path) -> list[Path]:
    if not source.is_dir():
        return [source]
    files = sorted(path for path in source.iterdir() if path.is_file())
    named = [path for path in files if kind_by_name(path) is not None]
    # Files of other programs are opened only if no name is conclusive.
    return named or [path for path in files if path.suffix.lower() == ".nc"][:_MAX_OPENED_FILES]


def kind_by_name(path: Path) -> str | None:
    """Return the kind of an instrument's file by its name alone, None if that is not conclusive."""
    if is_seaexplorer_file(path):
        return "seaexplorer"
    if is_binary(path):
        return "slocum"
    return "seaglider" if is_seaglider_file(path) else None


def kind_of_file(path: Path) -> str | None:
    """Return the kind of an instrument's file by its name or its contents, None if the kind is unknown.

    Raises
    ------
    InputError
        The file has a netCDF name and cannot be read.
    """
    named = kind_by_name(path)
    if named is not None or path.suffix.lower() != ".nc":
        return named
    with ForeignFile(path) as file:
        importer = importer_of(file.names)
    return None if importer is None else importer[0]


@dataclass(frozen=True, eq=False)
class InspectedRecords:
    """Findings of the record checks.

    Attributes
    ----------
    inspection : Inspection
        Findings, examined profiles, and excluded profiles with the reason.
    """

    inspection: Inspection

    @property
    def table(self) -> pd.DataFrame:
        """One row per finding: check, quantity, unit, size, standard error, threshold, verdict, suggestion, remark."""
        rows = self.inspection.as_json()["findings"]
        rows = [row | {"suggestion": _setting(row["suggestion"])} for row in rows]
        return pd.DataFrame(rows).astype(dict.fromkeys(("size", "standard_error", "threshold"), float))

    @property
    def suggestions(self) -> dict[str, str]:
        """Settings that would correct the detected errors, by quantity."""
        return {finding.quantity: _setting(finding.suggestion) for finding in self.inspection.found}

    @property
    def left_out(self) -> dict[int, str]:
        """Profiles that could not be inspected, with the reason."""
        return self.inspection.left_out


def _setting(suggestion: str) -> str:
    """Return a suggested setting without the backquotes that mark it in a message."""
    return suggestion.replace("`", "")


def inspect(
    records: Records,
    hull: HullArgument,
    *,
    profiles: Profiles = None,
    settings: MissionSettings | None = None,
    **named: Any,
) -> InspectedRecords:
    """Check records before they are inverted: lag of depth behind attitude, offset and scale of the pitch, compass.

    Parameters
    ----------
    records : xarray.Dataset, str or Path
        Observations.
    hull : Platform, str or Path
        The hull, calibrated.
    profiles : int, iterable of int, or str, optional
        Profiles to choose among; all by default.
    settings : MissionSettings, optional
        Settings; ``inspect`` and ``records`` are the relevant sections.
    **named
        Settings by name, which override those of `settings`: ``inspect={"profiles": 200}``.

    Returns
    -------
    InspectedRecords
        Findings, with ``.table``, ``.suggestions`` and ``.left_out``. Nothing is corrected.

    Raises
    ------
    InputError
        An argument cannot be used, or no profile can be inspected.
    """
    chosen, platform = settings_of(MissionSettings, settings, named), platform_of(hull)
    with opened_records(records) as observations:
        return InspectedRecords(inspect_open(observations, platform, chosen, profiles_text(profiles)))


def inspect_open(
    observations: Observations, platform: Platform, settings: MissionSettings, profiles: str | None
) -> Inspection:
    """Inspect an open file, as `inspect` does."""
    with threadpool_limits(limits=1):
        numbers = select_profiles(observations.profile_numbers, profiles)
        inspection = inspect_records(observations, platform, numbers, settings, settings.inspect, settings.current)
    if not inspection.profiles:
        raise InputError(
            f"{observations.path}: no profile can be inspected; {most_frequent_reason(inspection.left_out.values())}"
        )
    return inspection
