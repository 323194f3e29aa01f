"""What every importer says of a mission that it brought into the observation format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations import validation
from gliderhpc.observations.format import REQUIRED, VARIABLES
from gliderhpc.observations.records import FloatArray, TimeArray

Variables = dict[str, npt.NDArray[np.generic]]

Parts = tuple[int, ...] | tuple[str, ...]
"""The vehicle's own names of what a profile consists of, in time order: cycles, segments, dives."""

_SECOND = np.timedelta64(1, "s")


@dataclass(frozen=True)
class ProfileSummary:
    """What the import found of one profile.

    Attributes
    ----------
    number : int
        Its number in the observation file.
    parts : tuple of int or of str
        What it consists of in the vehicle's own count (cycles, segments, dives): several where the glider yos below
        the surface.
    start_time : numpy.datetime64
        Time of its first sample (UTC).
    duration : float
        Seconds.
    samples : int
        Number of samples.
    max_depth : float
        Metres.
    fault : str or None
        Why it cannot be inverted, if so.
    """

    number: int
    parts: Parts
    start_time: np.datetime64
    duration: float
    samples: int
    max_depth: float
    fault: str | None


@dataclass(frozen=True)
class ImportSummary:
    """What an import did.

    Attributes
    ----------
    path : Path
        The file written.
    vehicle, mission : str
        Whose records these are.
    part : str
        What the vehicle calls the parts of its mission, for example cycle.
    profiles : tuple of ProfileSummary
        All profiles in the file, those that cannot be inverted among them.
    without_profile : dict of str to str
        The parts or files that give no profile, and why.
    remarks : tuple of str
        What else the user should hear, a line each.
    sample_interval : float
        Median distance of samples within the profiles (s).
    fixes, fixes_dropped : int
        Numbers of GPS fixes in the file and of implausible ones left out.
    rows, ctd_samples : int
        Numbers of samples and of samples with CTD data in the file.
    rows_dropped : dict of str to int
        Junk rows by reason.
    """

    path: Path
    vehicle: str
    mission: str
    part: str
    profiles: tuple[ProfileSummary, ...]
    without_profile: dict[str, str]
    remarks: tuple[str, ...]
    sample_interval: float
    fixes: int
    fixes_dropped: int
    rows: int
    ctd_samples: int
    rows_dropped: dict[str, int]

    @property
    def complete(self) -> tuple[ProfileSummary, ...]:
        """The profiles that can be inverted."""
        return tuple(profile for profile in self.profiles if profile.fault is None)


def check_output(out: Path, is_record: Callable[[Path], bool]) -> None:
    """Refuse to write over one of the instrument's records: `import seaglider p1.nc p2.nc` forgets the last argument.

    Raises
    ------
    InputError
        `out` is a folder or is named like a record.
    """
    if out.is_dir() or is_record(out):
        raise InputError(f"{out}: is no file to write to; the last argument is the netCDF file, for example mission.nc")


def summarise_profiles(variables: Variables, parts: Mapping[int, Parts]) -> tuple[ProfileSummary, ...]:
    """Say of every profile what the reader of the file will find in it.

    Parameters
    ----------
    variables : dict of str to array
        As given to `write_observations`, with ``profile``.
    parts : mapping of int to tuple of int or of str
        What each profile consists of, by its number.
    """
    spans, _ = validation.profile_spans(variables["profile"].astype(np.int64))
    return tuple(_summarise(number, span, variables, parts[number]) for number, span in spans.items())


def sample_interval(variables: Variables) -> float:
    """Median distance of samples within the profiles (s), or between all of them where there is no profile."""
    time: TimeArray = variables["time"].astype("datetime64[ns]")
    spans, _ = validation.profile_spans(variables["profile"].astype(np.int64))
    steps = [np.diff(time[start:stop]) for start, stop in spans.values()] or [np.diff(time)]
    joined = np.concatenate(steps) / _SECOND
    return float(np.median(joined)) if len(joined) else float("nan")


def ctd_samples(variables: Variables) -> int:
    """Count the samples with a temperature."""
    if "temperature" not in variables:
        return 0
    return int(np.count_nonzero(np.isfinite(variables["temperature"].astype(np.float64))))


def _summarise(number: int, span: validation.Span, variables: Variables, parts: Parts) -> ProfileSummary:
    time: TimeArray = variables["time"][slice(*span)].astype("datetime64[ns]")
    depth: FloatArray = variables["depth"][slice(*span)].astype(np.float64)
    return ProfileSummary(
        number=number,
        parts=parts,
        start_time=time[0],
        duration=float((time[-1] - time[0]) / _SECOND),
        samples=len(time),
        max_depth=float(np.max(depth, where=np.isfinite(depth), initial=-np.inf)),
        fault=_fault(number, span, time, variables),
    )


def _fault(number: int, span: validation.Span, time: TimeArray, variables: Variables) -> str | None:
    """Say what the reader of the file will say of this profile."""
    fault = validation.check_length(number, time)
    for name in REQUIRED:
        if fault is None:
            values: FloatArray = np.asarray(variables[name][slice(*span)], dtype=np.float64)
            fault = validation.check_values(VARIABLES[name], values, number, span[0])
    return fault
