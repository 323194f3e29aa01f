"""The last steps of every import, whatever the instrument: observation file written, profiles summarised."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.format import REQUIRED, VARIABLES
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.profile_checks import check_length, check_values
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.validation import Span
from gliderhpc.observations.writer import Attribute, write_observations
from gliderhpc.output_files import check_output

Variables = Mapping[str, npt.NDArray[np.generic]]
"""Variables of the observation format by name, in its units."""


@dataclass(frozen=True)
class ImportedProfile:
    """One imported profile.

    Attributes
    ----------
    number : int
        Its number in the observation file.
    parts : tuple of int or of str
        The vehicle's own pieces that it consists of, in time order: cycles, segments or dives.
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
    parts: tuple[int, ...] | tuple[str, ...]
    start_time: np.datetime64
    duration: float
    samples: int
    max_depth: float
    fault: str | None


@dataclass(frozen=True)
class ImportSummary:
    """Summary of an import.

    Attributes
    ----------
    path : Path
        The file written.
    vehicle, mission : str
        Whose records these are.
    pieces : str
        What the vehicle's own pieces of its mission are called, in the plural: cycles, segments or dives.
    profiles : tuple of ImportedProfile
        All profiles in the file, those that cannot be inverted among them.
    without_profile : dict of str to str
        The pieces that hold no profile, and why.
    rejected : dict of str to str
        The pieces or files that could not be used, and why.
    remarks : tuple of str
        Further remarks for the user, a line each.
    sample_interval : float
        Distance of samples within the profiles, the median by time without gaps (s).
    fixes, fixes_dropped : int
        Numbers of GPS fixes in the file and of implausible ones left out.
    rows, ctd_samples : int
        Numbers of samples and of samples with CTD data in the file.
    rows_dropped : dict of str to int
        Rows and values left out as junk, by reason.
    """

    path: Path
    vehicle: str
    mission: str
    pieces: str
    profiles: tuple[ImportedProfile, ...]
    without_profile: dict[str, str]
    rejected: dict[str, str]
    remarks: tuple[str, ...]
    sample_interval: float
    fixes: int
    fixes_dropped: int
    rows: int
    ctd_samples: int
    rows_dropped: dict[str, int]

    @property
    def complete(self) -> tuple[ImportedProfile, ...]:
        """The profiles that can be inverted."""
        return tuple(profile for profile in self.profiles if profile.fault is None)


def write_import(
    out: Path,
    variables: Variables,
    fixes: Fixes,
    attributes: Mapping[str, Attribute],
    *,
    overwrite: bool,
    vehicle: str,
    mission: str,
    pieces: str,
    spans: Mapping[int, Span],
    parts: Mapping[int, tuple[int, ...] | tuple[str, ...]],
    sample_interval: float,
    without_profile: dict[str, str],
    rejected: dict[str, str],
    remarks: tuple[str, ...],
    rows_dropped: dict[str, int],
) -> ImportSummary:
    """Write the observation file of an import and summarise it.

    Parameters
    ----------
    out : Path
        The netCDF file to write, replaced if `overwrite`.
    variables, fixes, attributes : mapping, Fixes, mapping
        Content of the file: samples, fixes, global attributes.
    vehicle, mission, pieces, sample_interval, without_profile, rejected, remarks, rows_dropped
        As in `ImportSummary`.
    spans : mapping of int to Span
        First sample of every profile and the one after its last.
    parts : mapping of int to tuple
        Pieces of the vehicle's mission that a profile consists of.
    """
    variables = {
        **variables, "fix_time": fixes.time, "fix_latitude": fixes.latitude, "fix_longitude": fixes.longitude
    }  # fmt: skip
    write_observations(variables, out, attributes=attributes, overwrite=overwrite)
    return ImportSummary(
        path=out,
        vehicle=vehicle,
        mission=mission,
        pieces=pieces,
        profiles=tuple(_imported_profile(number, parts[number], *span, variables) for number, span in spans.items()),
        without_profile=without_profile,
        rejected=rejected,
        remarks=remarks,
        sample_interval=sample_interval,
        fixes=len(fixes.time),
        fixes_dropped=fixes.outliers,
        rows=len(variables["time"]),
        ctd_samples=_ctd_samples(variables),
        rows_dropped=rows_dropped,
    )


def _imported_profile(
    number: int, parts: tuple[int, ...] | tuple[str, ...], start: int, stop: int, variables: Variables
) -> ImportedProfile:
    """Summarise the profile in the samples from `start` to before `stop` of the variables of an observation file."""
    time: TimeArray = np.asarray(variables["time"][start:stop], dtype="datetime64[ns]")
    depth: FloatArray = np.asarray(variables["depth"][start:stop], dtype=np.float64)
    return ImportedProfile(
        number=number,
        parts=parts,
        start_time=time[0],
        duration=float((time[-1] - time[0]) / np.timedelta64(1, "s")),
        samples=len(time),
        max_depth=float(np.max(depth, where=np.isfinite(depth), initial=-np.inf)),
        fault=_fault(number, start, time, variables),
    )


def median_interval(time: TimeArray, spans: Sequence[tuple[int, int]]) -> float:
    """Distance of samples within the spans (first, after last), or anywhere where there is none (s).

    It is the median by time, without gaps.
    """
    steps = [np.diff(time[start:stop]) / np.timedelta64(1, "s") for start, stop in spans or [(0, len(time))]]
    return usual_interval(np.concatenate([without_gaps(part) for part in steps]))


def describe_reasons(reasons: Mapping[str, str] | Mapping[str, int]) -> str:
    """Put what was left out and why, or reasons and how often, into an attribute."""
    return "; ".join(f"{what}: {why}" for what, why in reasons.items()) or "none"


def _ctd_samples(variables: Variables) -> int:
    """Count the samples with a temperature."""
    return int(np.count_nonzero(np.isfinite(variables["temperature"]))) if "temperature" in variables else 0


def check_place(out: Path, sources: Sequence[Path], is_record: Callable[[Path], bool], *, overwrite: bool) -> None:
    """Refuse to write over a record: a forgotten last argument must not cost one.

    Raises
    ------
    InputError
        `out` is a folder, or named as the instrument names its files; or as `check_output`.
    """
    if out.is_dir() or is_record(out):
        raise InputError(f"{out}: is no file to write to; the last argument is the netCDF file, for example mission.nc")
    check_output(out, overwrite=overwrite, inputs=sources)


def _fault(number: int, start: int, time: TimeArray, variables: Variables) -> str | None:
    """Say what the reader of the file will say of this profile."""
    fault = check_length(number, time)
    for name in REQUIRED:
        if fault is None:
            values: FloatArray = np.asarray(variables[name][start : start + len(time)], dtype=np.float64)
            fault = check_values(VARIABLES[name], values, number, start)
    return fault
