"""An observation file: checked once when it is opened, then read profile by profile.

The survey of a file (the places of its profiles and their faults) is small and can be pickled. A worker process opens
the file with the survey that the planner made, and reads only the slice of its own profile.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import netCDF4
import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError, ProfileError, first_line
from gliderhpc.observations.checks.control_gaps import stuck_ballast, unlogged_movements
from gliderhpc.observations.checks.profile_checks import constant_values
from gliderhpc.observations.dive_phases import dive_notes
from gliderhpc.observations.files.file_content import describe_failure, describe_missing
from gliderhpc.observations.files.packed import open_dataset
from gliderhpc.observations.fixes import describe_fixes, pair_fault
from gliderhpc.observations.format import (
    ARCHIVE_SCHEMA,
    OPTIONAL,
    PROFILE_VARIABLES,
    SEAWATER,
    VARIABLES,
    VELOCITY,
    VELOCITY_STD,
)
from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord, TimeArray
from gliderhpc.observations.stored_variables import StoredVariables
from gliderhpc.observations.surface_intervals import MAX_FIX_AGE, ProfileSpan
from gliderhpc.observations.survey import Survey, survey_of
from gliderhpc.observations.times import SECOND
from gliderhpc.wording import counted

_AS_STORED: dict[str, Any] = {"decode_times": False, "decode_timedelta": False}
"""Options that leave times undecoded; `gliderhpc.observations.times` decodes and checks them."""


class Observations:
    """An open observation file (a context manager).

    Attributes
    ----------
    path : Path
        The file or Zarr folder.
    survey : Survey
        Places and faults of its profiles; pass it to `open_observations` in another process.
    platform_name, platform_id, mission, source : str
        Values of the global attributes, empty where absent.
    """

    def __init__(self, path: Path, dataset: xr.Dataset, survey: Survey | None, *, in_memory: bool = False):
        self.path = path
        self._stored = StoredVariables(dataset, path, in_memory=in_memory)
        survey = survey or survey_of(self._stored)
        self._stored.leave_out(survey.untimed)
        self.survey = survey
        self._fixes_by_profile: dict[int, tuple[tuple[Fix, ...], tuple[Fix, ...], tuple[str, ...]]] = {}
        self.platform_name = str(dataset.attrs.get("platform", ""))
        self.platform_id = str(dataset.attrs.get("platform_id", ""))
        self.mission = str(dataset.attrs.get("mission", ""))
        self.source = str(dataset.attrs.get("source", ""))
        self._dataset = dataset

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._dataset.close()

    @property
    def profile_numbers(self) -> list[int]:
        """Numbers of all profiles, faulty ones included, in the order of the file."""
        return list(self.survey.spans)

    @property
    def faults(self) -> dict[int, str]:
        """Reasons why profiles cannot be inverted, by number."""
        return self.survey.faults

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the file, to be shown to the user once."""
        return self.survey.warnings

    @property
    def has_seawater(self) -> bool:
        """Return whether the file has temperature and salinity."""
        return all(name in self._dataset.variables for name in ("temperature", "practical_salinity"))

    @property
    def has_velocity(self) -> bool:
        """Return whether the file has a measured velocity relative to the water."""
        return any(name in self._dataset.variables for name in VELOCITY)

    def start_time(self, number: int) -> np.datetime64:
        """Time of the profile's first sample (UTC)."""
        return self._span(number).start_time

    def duration(self, number: int) -> float:
        """Time from the profile's first sample to its last (s)."""
        span = self._span(number)
        return float((span.end_time - span.start_time) / SECOND)

    def sample_count(self, number: int) -> int:
        """Count the profile's samples."""
        span = self._span(number)
        return span.stop - span.start

    def profile(self, number: int) -> ProfileRecord:
        """Read one profile.

        Raises
        ------
        ProfileError
            The file has no such profile, or the profile is faulty.
        """
        span = self._span(number)
        if number in self.faults:
            raise ProfileError(self.faults[number])
        values = {name: self._stored.numbers(name, span.start, span.stop) for name in PROFILE_VARIABLES}
        time = self._stored.times("time", span.start, span.stop).time
        seconds = (time - time[0]) / SECOND
        before, after, reasons = self._fixes(span)
        seawater: dict[str, Any] = {name: self._optional(name, span) for name in SEAWATER}
        measured: dict[str, Any] = {name: values[name] * VARIABLES[name].si_factor for name in PROFILE_VARIABLES}
        return ProfileRecord(
            number=number,
            epoch=time[0],
            time=seconds,
            **measured,
            entry_fix=before[-1] if before else None,
            exit_fix=after[0] if after else None,
            surface_fixes_before=before,
            surface_fixes_after=after,
            notes=(
                *describe_fixes(before, after, reasons, MAX_FIX_AGE),
                *self._notes_untimed(span),
                *self._notes_between_dives(number, time, values["depth"]),
                *dive_notes(seconds, values["depth"], values["roll"] + values["pitch"] + values["heading"]),
                *_actuator_notes(seconds, values),
                *constant_values(values["depth"], {name: seawater[name] for name in SEAWATER[:2]}),
            ),
            **seawater,
            velocity=self._columns(VELOCITY, span),
            velocity_std=self._columns(VELOCITY_STD, span),
        )

    def _notes_untimed(self, span: ProfileSpan) -> list[str]:
        """Describe the samples that are left out because they have no usable time; empty if there are none."""
        rows = self.survey.untimed
        rows = rows[(rows >= span.start) & (rows < span.stop)]
        if not len(rows):
            return []
        lost = counted(len(rows), "sample without a time is", "samples without a time are")
        return [f"{lost} left out, the first at sample {rows[0]}"]

    def _notes_between_dives(self, number: int, time: TimeArray, depth: FloatArray) -> list[str]:
        if number in self.survey.without_fixes:
            return []
        return self.survey.fixes.notes_between_dives(time, depth)

    def _columns(self, names: tuple[str, ...], span: ProfileSpan) -> FloatArray | None:
        """Read variables as columns, NaN for those that are absent; None if all are."""
        columns = [self._optional(name, span) for name in names]
        if all(column is None for column in columns):
            return None
        missing = np.full(span.stop - span.start, np.nan)
        return np.column_stack([missing if column is None else column for column in columns])

    def _optional(self, name: str, span: ProfileSpan) -> FloatArray | None:
        if name not in self._stored:
            return None
        return self._stored.numbers(name, span.start, span.stop)

    def digest(self) -> str:
        """SHA-256 of the file's bytes (of names and bytes, for a Zarr folder), in hexadecimal."""
        sha = hashlib.sha256()
        if self.path.is_file():
            _hash_file(self.path, sha)
            return sha.hexdigest()
        for part in sorted(part for part in self.path.rglob("*") if part.is_file()):
            sha.update(part.relative_to(self.path).as_posix().encode())
            _hash_file(part, sha)
        return sha.hexdigest()

    def profile_digest(self, number: int) -> str:
        """SHA-256 of all that determines a profile's estimate: number, samples, fault and position, in hexadecimal.

        It depends neither on how the file stores them nor on the other profiles. Of the fixes it contains the position
        at which the water's density is computed; `fix_digest` contains all.
        """
        span = self._span(number)
        sha = hashlib.sha256(repr((number, self.faults.get(number))).encode())
        sha.update(self._stored.times("time", span.start, span.stop).time.tobytes())
        for name in (*PROFILE_VARIABLES, *(name for name in OPTIONAL if name in self._stored)):
            sha.update(name.encode())
            sha.update(self._stored.numbers(name, span.start, span.stop).tobytes())
        before, after, _ = self._fixes(span)
        sha.update(repr([(fix.latitude, fix.longitude) for fix in (*before[-1:], *after[:1])[:1]]).encode())
        return sha.hexdigest()

    def fix_digest(self, number: int) -> str:
        """SHA-256 of a profile's fixes, and of the reasons why others are not used, in hexadecimal."""
        span = self._span(number)
        before, after, reasons = self._fixes(span)
        sides = [[(str(fix.time), fix.latitude, fix.longitude) for fix in fixes] for fixes in (before, after)]
        inside = [str(fix.time) for fix in self.survey.fixes.between(span.start_time, span.end_time)]
        return hashlib.sha256(repr((sides, reasons, inside)).encode()).hexdigest()

    def sample_digests(self) -> dict[int, str]:
        """SHA-256 of each profile's samples and fault, by number; it includes neither the number nor the fixes.

        Every variable is read once as a whole, which is faster than reading it profile by profile.
        """
        count = self._stored.size("time")
        names = (*PROFILE_VARIABLES, *(name for name in OPTIONAL if name in self._stored))
        columns: list[npt.NDArray[Any]] = [self._stored.times("time", 0, count).time]
        columns += [self._stored.numbers(name, 0, count) for name in names]
        digests: dict[int, str] = {}
        for number, span in self.survey.spans.items():
            sha = hashlib.sha256(repr(self.faults.get(number)).encode())
            for column in columns:
                sha.update(column[span.start : span.stop].tobytes())
            digests[number] = sha.hexdigest()
        return digests

    def _span(self, number: int) -> ProfileSpan:
        if number not in self.survey.spans:
            raise ProfileError(f"{self.path} has no profile {number}")
        return self.survey.spans[number]

    def _fixes(self, span: ProfileSpan) -> tuple[tuple[Fix, ...], tuple[Fix, ...], tuple[str, ...]]:
        """Find the fixes of the surface intervals before and after a profile, and the reasons why others are unused."""
        if span.number not in self._fixes_by_profile:
            self._fixes_by_profile[span.number] = self._find_fixes(span)
        return self._fixes_by_profile[span.number]

    def _find_fixes(self, span: ProfileSpan) -> tuple[tuple[Fix, ...], tuple[Fix, ...], tuple[str, ...]]:
        doubt = self.survey.without_fixes.get(span.number)
        if doubt is not None:
            return (), (), (doubt,)
        sides = ((span.fixes_from, span.start_time), (span.end_time, span.fixes_until))
        before, after = (self.survey.fixes.between(*side) for side in sides)
        reasons = [reason for side in sides for reason in self.survey.fixes.reasons_between(*side)]
        if not (before and after):
            reasons += self.survey.fixes.notes_inside(span.start_time, span.end_time)
        fault = pair_fault(before[-1], after[0]) if before and after else None
        if fault is None:
            return before, after, tuple(dict.fromkeys(reasons))
        return (), (), tuple(dict.fromkeys([fault, *reasons]))


def open_observations(path: str | Path, *, survey: Survey | None = None, in_memory: bool = False) -> Observations:
    """Open an observation file and check it.

    Parameters
    ----------
    path : str or Path
        A netCDF-4 file or a Zarr folder in the observation format.
    survey : Survey, optional
        Result of an earlier check of the same file; if given, the file is not checked again.
    in_memory : bool
        Read all values now, which is faster if every profile is used.

    Returns
    -------
    Observations
        The open file; its profiles are read on demand.

    Raises
    ------
    InputError
        The file cannot be read, lacks a required variable, has a variable in a wrong unit, or its time runs
        backwards. Faults of single profiles are collected in `Observations.faults` instead.
    """
    path = Path(path)
    dataset = open_stored(path)
    try:
        return Observations(path, _loaded(dataset, path) if in_memory else dataset, survey, in_memory=in_memory)
    except BaseException:
        dataset.close()
        raise


def _loaded(dataset: xr.Dataset, path: Path) -> xr.Dataset:
    try:
        return dataset.load()
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        raise InputError(f"{path}: the file is damaged ({first_line(error)}); copy it again") from error


def open_stored(path: Path, *, cache: bool = False) -> xr.Dataset:
    """Open a file with undecoded times and with values read on demand; `InputError` if it cannot be read.

    With `cache`, values that have been read stay in memory, where they can be changed.
    """
    if not path.exists():
        raise InputError(f"{path}: {describe_missing(path)}")
    if not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: is a device or a pipe; give observations as netCDF-4 or Zarr")
    try:
        if path.is_dir():
            return _records(open_dataset(path, engine="zarr", consolidated=False, cache=cache, **_AS_STORED), path)
        dataset = open_dataset(path, engine="netcdf4", cache=cache, **_AS_STORED)
    except (OSError, KeyError, RuntimeError, TypeError, AttributeError, UnicodeEncodeError) as error:
        content = describe_failure(path, error) if path.is_file() else ""
        if content:
            raise InputError(f"{path}: {content}") from error
        kind = "a Zarr group" if path.is_dir() else "a netCDF file"
        raise InputError(
            f"{path}: is not {kind} that can be read; give observations as netCDF-4 or Zarr (see `gliderhpc import`)"
        ) from error
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: cannot be decoded by the CF conventions ({reason})") from error
    if not dataset.variables:
        _refuse_groups(dataset, path)
    return dataset


def _refuse_groups(dataset: xr.Dataset, path: Path) -> None:
    """Refuse a netCDF file, open without any variable, if it has groups, and close it."""
    with netCDF4.Dataset(path) as content:
        groups = list(content.groups)
    if groups:
        dataset.close()
        raise InputError(
            f"{path}: has no variable outside its groups ({', '.join(groups)}); write them to a file without groups: "
            f"xarray.open_dataset('{path.name}', group='{groups[0]}').to_netcdf(...)"
        )


def _records(dataset: xr.Dataset, path: Path) -> xr.Dataset:
    """Return a Zarr folder's dataset; refuse an archive of results."""
    if dataset.attrs.get("schema") == ARCHIVE_SCHEMA:
        source = dataset.attrs.get("observations", "")
        dataset.close()
        raise InputError(
            f"{path}: is an archive of results, not a file of records; give the observations that it was made from"
            + (f" ({source})" if source else "")
        )
    return dataset


def _actuator_notes(seconds: FloatArray, values: Mapping[str, FloatArray]) -> tuple[str, ...]:
    attitude = np.isfinite(values["roll"] + values["pitch"] + values["heading"])
    text = unlogged_movements(seconds, attitude, values)
    return (*([text] if text else []), *stuck_ballast(values["depth"], values["ballast_volume"]))


def _hash_file(path: Path, sha: "hashlib._Hash") -> None:
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            sha.update(block)
