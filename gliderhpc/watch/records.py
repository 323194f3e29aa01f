"""Records of a watch: one observation file made from all arriving files, and truncated copies for a replay."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.api.import_options import check_option_names, check_option_values
from gliderhpc.api.records import IMPORTERS, import_as, kind_by_name, kind_of_file
from gliderhpc.errors import InputError
from gliderhpc.observations import open_observations
from gliderhpc.observations.files.foreign import ForeignFile, is_in_the_format
from gliderhpc.observations.files.stored_reads import Reads, read_directly
from gliderhpc.observations.format import REFERENCE
from gliderhpc.observations.in_memory import read_records, write_records
from gliderhpc.observations.instruments.slocum_binary import cache_files
from gliderhpc.observations.joined import join_observations

OBSERVATIONS = "observations"
"""Kind of files that are already in the observation format."""

KINDS = (OBSERVATIONS, *IMPORTERS)

_UNNAMED_NETCDF = ("og1", "slocum")
"""Instruments whose netCDF files are not recognised by name."""

_OWN_OPTIONS = ("overwrite", "reads")
"""Options of the importers that a watch sets itself."""


@dataclass(frozen=True)
class FileImport:
    """Import of the arriving files: their kind, and the options of the importer.

    Attributes
    ----------
    kind : str, optional
        Kind of the files; by default detected from name and content.
    options : mapping
        Options of the importer.
    folder : Path, optional
        Folder in which the files arrive; a Slocum's cache files are expected there, unless an option names another.
    """

    kind: str | None
    options: Mapping[str, Any]
    folder: Path | None = None

    def __post_init__(self) -> None:
        if self.kind not in (None, *KINDS):
            raise InputError(f"kind={self.kind!r}: give one of {', '.join(KINDS)}")
        for name in _OWN_OPTIONS:
            if name in self.options:
                raise InputError(f"{name!r} cannot be set as an option of the importer, because a watch sets it")
        check_option_names(self.kind, self.options)
        check_option_values(self.options)

    def digest(self, files: Mapping[str, str]) -> str:
        """Return a digest of the options and of `files`, a mapping from names to digests of content."""
        options = sorted((key, str(value)) for key, value in self.options.items())
        # A file without its cache file is tried again once the cache file has arrived.
        content = [self.kind, options, sorted(files.items()), list(map(str, self._cache_files()))]
        return sha256(json.dumps(content).encode()).hexdigest()

    def _cache_files(self) -> list[Path]:
        return [] if self.folder is None else cache_files(self.folder)

    def _options(self, kind: str) -> dict[str, Any]:
        """Options of the user, and the folder of a Slocum's cache files."""
        cached = self._cache_files() if kind == "slocum" else []
        return ({"cache": cached[0].parent} if cached else {}) | dict(self.options)

    def import_files(self, paths: Sequence[Path], out: Path, reads: Reads = read_directly) -> dict[str, str]:
        """Turn files into one observation file, which replaces `out`; unusable ones are left out.

        Parameters
        ----------
        paths : sequence of Path
            The files; of two in the observation format that contradict each other, the first one is used, unless the
            other contains it with more samples.
        out : Path
            The observation file.
        reads : Reads
            Function that reads each file.

        Returns
        -------
        dict of str to str
            Reason for each file or piece left out, by name.

        Raises
        ------
        InputError
            The files are of several kinds, or an option of the importer cannot be used.
        """
        kind, chosen, faults = _sorted_by_kind(paths, self.kind, reads)
        if kind == OBSERVATIONS and chosen:
            try:
                return faults | join_observations(chosen, out, reads)
            except InputError as error:
                return faults | {_named_file(error, chosen).name: str(error)}
        chosen.sort()
        while chosen:
            try:
                summary = import_as(kind, chosen, out, self._options(kind), overwrite=True, reads=reads)
            except InputError as error:
                culprit = _named_file(error, chosen)
                faults[culprit.name] = str(error)
                chosen.remove(culprit)
            else:
                return faults | dict(summary.rejected)
        return faults


def is_candidate(path: Path, kind: str | None, named: bool) -> bool:
    """Return whether a file may be a record; if any file is `named` like an instrument's, accept only such files."""
    netcdf, own = path.suffix.lower() == ".nc", kind_by_name(path)
    if kind is None:
        return own is not None if named else netcdf
    return own == kind or (netcdf and (kind == OBSERVATIONS or (own is None and kind in _UNNAMED_NETCDF)))


def _sorted_by_kind(paths: Sequence[Path], kind: str | None, reads: Reads) -> tuple[str, list[Path], dict[str, str]]:
    """Return the kind of the files, the files of that kind, and those that cannot be opened with the reason."""
    if kind is not None:
        return kind, list(paths), {}
    kinds: dict[str, list[Path]] = {}
    faults: dict[str, str] = {}
    for path in paths:
        try:
            kinds.setdefault(reads(kind_of_file, path) or OBSERVATIONS, []).append(path)
        except InputError as error:
            faults[path.name] = str(error)
    if len(kinds) > 1:
        faults |= _remove_foreign(kinds)
    if len(kinds) > 1:
        (first, (first_path, *_)), (second, (second_path, *_)), *_ = kinds.items()
        raise InputError(
            f"{first_path.name} is of kind {first}, {second_path.name} of kind {second}; give one of them, such as "
            f"`kind={first}`"
        )
    chosen_kind, chosen = next(iter(kinds.items()), (OBSERVATIONS, []))
    return chosen_kind, chosen, faults


def _remove_foreign(kinds: dict[str, list[Path]]) -> dict[str, str]:
    """Remove the files that are neither an instrument's nor in the observation format; return why, by name."""
    foreign = {}
    for path in kinds.pop(OBSERVATIONS, []):
        with ForeignFile(path) as file:
            if is_in_the_format(file.names):
                kinds.setdefault(OBSERVATIONS, []).append(path)
            else:
                foreign[path.name] = f"{path}: is neither a record like the others nor in the observation format"
    return foreign


def _named_file(error: InputError, paths: Sequence[Path]) -> Path:
    """Return the file that an error names; raise the error again if it names none."""
    named = [path for path in paths if str(error).startswith(f"{path}:")]
    if not named:
        raise error
    return named[0]


def truncated_missions(path: Path, folder: Path) -> Iterator[Path]:
    """Yield the records of a mission as they were after each dive, in order, and finally `path` itself.

    Each truncated file contains all samples up to the end of the dive and the first fix after it, but nothing later.
    """
    with open_observations(path) as observations:
        survey = observations.survey
    with read_records(path) as records:
        mission = records.load()
    mission = mission.drop_vars([name for name in REFERENCE if name in mission.variables])
    if "profile" not in mission:
        mission["profile"] = ("time", np.zeros(mission.sizes["time"], dtype=np.int64))
        for number, span in survey.spans.items():
            mission["profile"].values[span.start : span.stop] = number
    for span in survey.spans.values():
        truncated = mission.isel(time=slice(0, span.stop))
        if "fix" in truncated.dims:
            truncated = truncated.isel(fix=slice(0, _fixes_until(mission, span.end_time, span.fixes_until)))
        out = folder / "replayed.nc"
        out.unlink(missing_ok=True)
        truncated.encoding["source"] = str(path)
        yield write_records(truncated, out)
    yield path


def _fixes_until(records: xr.Dataset, end: np.datetime64, until: np.datetime64) -> int:
    """Count the fixes up to the first one after a dive."""
    times = records["fix_time"].values
    count = int(np.searchsorted(times, end, side="right"))
    return count + 1 if count < len(times) and times[count] <= until else count
