"""An observation file: checked once when it is opened, then read profile by profile.

The survey of a file (where its profiles lie, what is wrong with them) is small and can be pickled: a worker process
opens the file with the survey that the planner made and reads its own profile's slice and nothing else.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.observations import validation
from gliderhpc.observations.content import describe_content
from gliderhpc.observations.format import CONTROLS, MEASURED, SEAWATER, VARIABLES
from gliderhpc.observations.profiles import detect_profiles
from gliderhpc.observations.records import Fix, FloatArray, ProfileRecord, TimeArray

MAXIMUM_FIX_AGE = np.timedelta64(1800, "s")
"""A fix further than this from a profile's end says nothing about where the profile began or ended."""

_SECOND = np.timedelta64(1, "s")
_READ = (*MEASURED, *CONTROLS, "rudder")


@dataclass(frozen=True)
class ProfileSpan:
    """Where one profile lies in its file.

    Attributes
    ----------
    number : int
        Number of the profile.
    start, stop : int
        Its first sample and the one after its last.
    start_time, end_time : numpy.datetime64
        Time of its first and its last sample.
    fixes_from, fixes_until : numpy.datetime64
        The surface intervals on either side reach back and on to here.
    """

    number: int
    start: int
    stop: int
    start_time: np.datetime64
    end_time: np.datetime64
    fixes_from: np.datetime64
    fixes_until: np.datetime64


@dataclass(frozen=True)
class Survey:
    """What a look through the whole file found.

    Attributes
    ----------
    spans : dict of int to ProfileSpan
        Every profile in the order of the file.
    faults : dict of int to str
        Why a profile cannot be inverted.
    warnings : tuple of str
        What the user should hear about the file, once.
    """

    spans: dict[int, ProfileSpan]
    faults: dict[int, str]
    warnings: tuple[str, ...]

    def only(self, numbers: Iterable[int]) -> "Survey":
        """Cut the survey down to some profiles, for a worker that does these."""
        wanted = set(numbers)
        return replace(
            self,
            spans={number: span for number, span in self.spans.items() if number in wanted},
            faults={number: fault for number, fault in self.faults.items() if number in wanted},
        )


class Observations:
    """An open observation file (a context manager).

    Attributes
    ----------
    path : Path
        The file or Zarr folder.
    survey : Survey
        Where its profiles lie and what is wrong with them; hand it to `open_observations` in another process.
    platform_name, platform_id, mission, source : str
        From the global attributes, empty where absent.
    """

    def __init__(self, path: Path, dataset: xr.Dataset, survey: Survey):
        self.path = path
        self.survey = survey
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
        """Why a profile cannot be inverted, by its number."""
        return self.survey.faults

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should hear about the file, once."""
        return self.survey.warnings

    @property
    def has_seawater(self) -> bool:
        """Whether the file has temperature and salinity."""
        return all(name in self._dataset.variables for name in ("temperature", "practical_salinity"))

    def start_time(self, number: int) -> np.datetime64:
        """Time of the profile's first sample (UTC)."""
        return self._span(number).start_time

    def duration(self, number: int) -> float:
        """Time from the profile's first sample to its last (s)."""
        span = self._span(number)
        return float((span.end_time - span.start_time) / _SECOND)

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
        values = {name: _read(self._dataset, name, span.start, span.stop) for name in _READ}
        time = _read_time(self._dataset, "time", span.start, span.stop)
        before, after = self._fixes(span)
        return ProfileRecord(
            number=number,
            epoch=time[0],
            time=(time - time[0]) / _SECOND,
            roll=np.radians(values["roll"]),
            pitch=np.radians(values["pitch"]),
            heading=np.radians(values["heading"]),
            depth=values["depth"],
            battery_position=values["battery_position"],
            battery_rotation=np.radians(values["battery_rotation"]),
            ballast_volume=values["ballast_volume"] * 1e-6,
            rudder=np.radians(values["rudder"]),
            entry_fix=before[-1] if before else None,
            exit_fix=after[0] if after else None,
            surface_fixes_before=before,
            surface_fixes_after=after,
            notes=_notes(before, after),
            **{name: self._seawater(name, span) for name in SEAWATER},
        )

    def _seawater(self, name: str, span: ProfileSpan) -> FloatArray | None:
        if name not in self._dataset.variables:
            return None
        return _read(self._dataset, name, span.start, span.stop)

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
        """SHA-256 of all that the file says of a profile, in hexadecimal: samples, fixes, and what is wrong with it.

        It does not depend on how the file stores them, nor on its other profiles.
        """
        span = self._span(number)
        sha = hashlib.sha256(repr((number, self.faults.get(number))).encode())
        sha.update(_read_time(self._dataset, "time", span.start, span.stop).tobytes())
        for name in (*_READ, *(name for name in SEAWATER if name in self._dataset.variables)):
            sha.update(name.encode())
            sha.update(_read(self._dataset, name, span.start, span.stop).tobytes())
        for fixes in self._fixes(span):
            sha.update(repr([(str(fix.time), fix.latitude, fix.longitude) for fix in fixes]).encode())
        return sha.hexdigest()

    def _span(self, number: int) -> ProfileSpan:
        if number not in self.survey.spans:
            raise ProfileError(f"{self.path} has no profile {number}")
        return self.survey.spans[number]

    def _fixes(self, span: ProfileSpan) -> tuple[tuple[Fix, ...], tuple[Fix, ...]]:
        """Find the fixes of the surface intervals before and after a profile."""
        time, latitude, longitude = _read_fixes(self._dataset)
        usable, _ = validation.check_fixes(latitude, longitude)

        def between(first: np.datetime64, last: np.datetime64) -> tuple[Fix, ...]:
            chosen = np.flatnonzero(usable & (time >= first) & (time <= last))
            chosen = chosen[np.argsort(time[chosen], kind="stable")]
            return tuple(Fix(time[i], float(latitude[i]), float(longitude[i])) for i in chosen)

        return between(span.fixes_from, span.start_time), between(span.end_time, span.fixes_until)


def open_observations(path: str | Path, *, survey: Survey | None = None) -> Observations:
    """Open an observation file and check it.

    Parameters
    ----------
    path : str or Path
        A netCDF-4 file or a Zarr folder in the observation format.
    survey : Survey, optional
        What an earlier look through the same file found; with it nothing is checked again.

    Returns
    -------
    Observations
        Open; profiles are read on demand.

    Raises
    ------
    InputError
        The file cannot be read, lacks a required variable, has one in a wrong unit, or its time runs backwards.
        Faults that concern single profiles are collected in `Observations.faults` instead.
    """
    path = Path(path)
    dataset = _open(path)
    try:
        return Observations(path, dataset, survey or _survey(dataset, path))
    except BaseException:
        dataset.close()
        raise


def _open(path: Path) -> xr.Dataset:
    if not path.exists():
        raise InputError(f"{path}: no such file")
    try:
        if path.is_dir():
            return xr.open_dataset(path, engine="zarr", consolidated=False, cache=False, decode_timedelta=False)
        return xr.open_dataset(path, engine="netcdf4", cache=False, decode_timedelta=False)
    except (OSError, KeyError) as error:
        content = describe_content(path) if path.is_file() else ""
        if content:
            raise InputError(f"{path}: {content}") from error
        kind = "a Zarr group" if path.is_dir() else "a netCDF file"
        raise InputError(
            f"{path}: is not {kind} that can be read; give observations as netCDF-4 or Zarr (see `gliderhpc import`)"
        ) from error
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: cannot be decoded by the CF conventions ({reason}); check the units of time"
        ) from error


def _survey(dataset: xr.Dataset, path: Path) -> Survey:
    validation.check_variables(dataset, str(path))
    time = _read_time(dataset, "time", 0, dataset.sizes["time"])
    places, faults = _locate(dataset, time, path)
    faults |= {n: text for n, text in validation.check_clock(time, places, str(path)).items() if n not in faults}
    for number, (start, stop) in places.items():
        if number not in faults and (fault := validation.check_length(number, time[start:stop])):
            faults[number] = fault
    for name in _READ:
        values = _read(dataset, name, 0, len(time))
        for number, (start, stop) in places.items():
            if number not in faults:
                fault = validation.check_values(VARIABLES[name], values[start:stop], number, start)
                faults |= {number: fault} if fault else {}
    faults = {number: faults[number] for number in places if number in faults}
    return Survey(_spans(time, places), faults, _warnings(dataset))


def _locate(dataset: xr.Dataset, time: TimeArray, path: Path) -> tuple[dict[int, validation.Span], dict[int, str]]:
    """Where the profiles lie, by their numbers or, where these are absent, by depth."""
    if "profile" in dataset.variables:
        numbers = np.nan_to_num(_read(dataset, "profile", 0, len(time)))
        odd = np.flatnonzero((numbers != np.rint(numbers)) | (numbers < 0))
        if len(odd):
            raise InputError(
                f"{path}: profile is {numbers[odd[0]]:g} at sample {odd[0]}; "
                "it must be a whole number, 0 outside any profile"
            )
        places, faults = validation.profile_spans(numbers.astype(np.int64))
    else:
        validation.check_clock(time, {}, str(path))
        seconds = (time - time[0]) / _SECOND if len(time) else np.zeros(0)
        depth = _read(dataset, "depth", 0, len(time))
        places, faults = validation.profile_spans(detect_profiles(seconds, depth))
    if not places:
        raise InputError(f"{path}: holds no profile; depth never leaves the surface, or profile is 0 everywhere")
    return places, faults


def _spans(time: TimeArray, places: dict[int, validation.Span]) -> dict[int, ProfileSpan]:
    """Spans with their times; the surface interval ends where the next profile begins, or when a fix gets too old."""
    spans: dict[int, ProfileSpan] = {}
    ordered = sorted(places.items(), key=lambda item: item[1])
    for index, (number, (start, stop)) in enumerate(ordered):
        first, last = time[start], time[stop - 1]
        since, until = first - MAXIMUM_FIX_AGE, last + MAXIMUM_FIX_AGE
        if index > 0:
            since = max(since, time[ordered[index - 1][1][1] - 1])
        if index + 1 < len(ordered):
            until = min(until, time[ordered[index + 1][1][0]])
        spans[number] = ProfileSpan(number, start, stop, first, last, since, until)
    return spans


def _warnings(dataset: xr.Dataset) -> tuple[str, ...]:
    _, latitude, longitude = _read_fixes(dataset)
    usable, warnings = validation.check_fixes(latitude, longitude)
    if not usable.any():
        return ("there is no usable GPS fix in the file: profiles are inverted, but their currents will be NaN",)
    return tuple(warnings)


def _notes(before: tuple[Fix, ...], after: tuple[Fix, ...]) -> tuple[str, ...]:
    missing = [side for side, fixes in (("before", before), ("after", after)) if not fixes]
    return (f"no GPS fix {' or '.join(missing)} the profile",) if missing else ()


def _read(dataset: xr.Dataset, name: str, start: int, stop: int) -> FloatArray:
    """One variable's slice as doubles; zeros for an optional one that is absent."""
    if name not in dataset.variables:
        return np.zeros(stop - start)
    return np.asarray(dataset[name][start:stop].values, dtype=np.float64)


def _read_time(dataset: xr.Dataset, name: str, start: int, stop: int) -> TimeArray:
    values: TimeArray = np.asarray(dataset[name][start:stop].values, dtype="datetime64[ns]")
    return values


def _read_fixes(dataset: xr.Dataset) -> tuple[TimeArray, FloatArray, FloatArray]:
    """Time, latitude and longitude of all fixes; empty where the file has none."""
    count = dataset.sizes.get("fix", 0)
    if not all(name in dataset.variables for name in ("fix_time", "fix_latitude", "fix_longitude")):
        count = 0
    if count == 0:
        return np.zeros(0, dtype="datetime64[ns]"), np.zeros(0), np.zeros(0)
    time = _read_time(dataset, "fix_time", 0, count)
    return time, _read(dataset, "fix_latitude", 0, count), _read(dataset, "fix_longitude", 0, count)


def _hash_file(path: Path, sha: "hashlib._Hash") -> None:
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            sha.update(block)
