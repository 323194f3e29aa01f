"""The import of a mission's own files, from the check of the output to the written observation file.

Each instrument has a module that reads its files into `MissionRecords`, in the variables and units of the observation
format: `seaexplorer`, `slocum`, `seaglider` and `og1`. The remaining steps are the same for all instruments and are
in this module, in the order in which they run (`import_mission`).
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.checks.profile_checks import check_length, check_values, fault_of_pace
from gliderhpc.observations.checks.sign_checks import GLIDE, fault_of_signs
from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.fixes import Fixes
from gliderhpc.observations.format import REQUIRED, VARIABLES
from gliderhpc.observations.importing.clock_steps import ClockStep, screen_clock_steps
from gliderhpc.observations.importing.rows import Columns
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import SECOND
from gliderhpc.observations.writer import Attribute, write_observations
from gliderhpc.output_files import check_netcdf_name, check_output

Parts = tuple[int, ...] | tuple[str, ...]
"""The vehicle's own pieces of a profile, in time order: cycles, segments or dives."""


@dataclass(frozen=True, eq=False)
class CtdSamples:
    """CTD samples on the rows of a mission.

    Attributes
    ----------
    variables : dict of str to (n,) array
        Temperature, pressure and practical salinity, those that were measured; NaN on rows without a CTD sample.
    comment : str
        Origin of the samples, for the file's attribute.
    remarks : tuple of str
        Remarks for the user, one line each.
    """

    variables: Columns
    comment: str
    remarks: tuple[str, ...] = ()


def _no_samples(time: TimeArray, depth: FloatArray, interval: float) -> CtdSamples:
    """Return no samples: there is no CTD, or the flight records already contain its samples."""
    return CtdSamples({}, "")


@dataclass(frozen=True, eq=False)
class MissionRecords:
    """A mission as read from an instrument's files, in the variables and units of the observation format.

    Attributes
    ----------
    platform, vehicle, mission, source : str
        Global attributes of the observation file.
    pieces : str
        Name of the vehicle's own pieces of its mission, in the plural: cycles, segments or dives.
    variables : dict of str to (n,) array
        Time, attitude, depth, controls and number of the profile, and reference quantities along their own axes.
    spans : mapping of int to Span
        Sample range of every profile.
    fixes : Fixes
        GPS fixes at the surface, in time order.
    comments : mapping of str to str or number
        Attributes that describe the origin of the variables.
    rejected : dict of str to str
        Reasons by unusable piece or file.
    parts : mapping of int to tuple
        Pieces of every profile; empty if the vehicle's files are not divided by profiles.
    without_profile : dict of str to str, optional
        Reasons by piece without a profile; None if every piece is part of one.
    rows_dropped : Counter
        Number of rows and values left out as junk, by reason.
    rejected_attribute, dropped_attribute : str
        Names of the attributes that list the rejected pieces and the dropped rows.
    remarks : tuple of str
        Remarks for the user, one line each.
    clock_steps : sequence of ClockStep
        Steps of the clock.
    water : callable
        Function that puts the CTD samples on the rows, given the rows' time, depth (m) and sample interval (s).
    """

    platform: str
    vehicle: str
    mission: str
    source: str
    pieces: str
    variables: Columns
    spans: Mapping[int, Span]
    fixes: Fixes
    comments: Mapping[str, Attribute]
    rejected: dict[str, str]
    parts: Mapping[int, Parts] = field(default_factory=dict)
    without_profile: dict[str, str] | None = None
    rows_dropped: Counter[str] = field(default_factory=Counter)
    rejected_attribute: str = "files_rejected"
    dropped_attribute: str = "rows_dropped"
    remarks: tuple[str, ...] = ()
    clock_steps: Sequence[ClockStep] = ()
    water: Callable[[TimeArray, FloatArray, float], CtdSamples] = _no_samples


@dataclass(frozen=True)
class ImportedProfile:
    """One imported profile.

    Attributes
    ----------
    number : int
        Its number in the observation file.
    parts : tuple of int or of str
        The vehicle's own pieces that make up the profile, in time order: cycles, segments or dives.
    start_time : numpy.datetime64
        Time of its first sample (UTC).
    duration : float
        Time from its first to its last sample (s).
    samples : int
        Number of samples.
    max_depth : float
        Greatest depth (m).
    fault : str or None
        Reason why it cannot be inverted; None if it can.
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
    """Summary of an import.

    Attributes
    ----------
    path : Path
        The written file.
    vehicle, mission : str
        Names of the glider and of its mission.
    pieces : str
        Name of the vehicle's own pieces of its mission, in the plural: cycles, segments or dives.
    profiles : tuple of ImportedProfile
        All profiles in the file, including those that cannot be inverted.
    without_profile : dict of str to str
        Pieces without a profile, with the reason.
    rejected : dict of str to str
        Pieces or files that could not be used, with the reason.
    remarks : tuple of str
        Further remarks for the user, one line each.
    sample_interval : float
        Sample interval within the profiles: the time-weighted median, without gaps (s).
    fixes, fixes_dropped : int
        Numbers of GPS fixes in the file and of implausible ones left out.
    rows, ctd_samples : int
        Numbers of samples and of samples with CTD data in the file.
    rows_dropped : dict of str to int
        Number of rows and values left out as junk, by reason.
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


def import_mission(
    read: Callable[[list[Path]], MissionRecords],
    is_record: Callable[[Path], bool],
    sources: Sequence[Path],
    out: Path,
    *,
    overwrite: bool,
) -> ImportSummary:
    """Turn the files of a mission into an observation file.

    Parameters
    ----------
    read : callable
        Function that reads the instrument's files.
    is_record : callable
        Whether a file is one of the instrument's own, which must not be overwritten.
    sources : sequence of Path
        Files, or folders of files.
    out : Path
        The netCDF file to write.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    InputError
        The sources cannot be used, or `out` may not be replaced or cannot be written.
    """
    sources, out = [Path(source) for source in sources], Path(out)
    check_import_path(out, sources, is_record, overwrite=overwrite)
    mission = _without_doubtful_profiles(read(sources))
    time: TimeArray = mission.variables["time"].astype("datetime64[ns]")
    depth: FloatArray = mission.variables["depth"].astype(np.float64)
    interval = median_interval(time, list(mission.spans.values()))
    water = mission.water(time, depth, interval)
    variables: Columns = {
        **mission.variables,
        **water.variables,
        "fix_time": mission.fixes.time,
        "fix_latitude": mission.fixes.latitude,
        "fix_longitude": mission.fixes.longitude,
    }
    write_observations(variables, out, attributes=_attributes(mission, water), overwrite=overwrite)
    return ImportSummary(
        path=out,
        vehicle=mission.vehicle,
        mission=mission.mission,
        pieces=mission.pieces,
        profiles=tuple(
            _profile(number, mission.parts.get(number, ()), *span, variables) for number, span in mission.spans.items()
        ),
        without_profile=mission.without_profile or {},
        rejected=mission.rejected,
        remarks=(*mission.remarks, *water.remarks),
        sample_interval=interval,
        fixes=len(mission.fixes.time),
        fixes_dropped=mission.fixes.outliers,
        rows=len(time),
        ctd_samples=int(np.count_nonzero(np.isfinite(variables.get("temperature", np.zeros(0))))),
        rows_dropped=dict(sorted(mission.rows_dropped.items())),
    )


def _without_doubtful_profiles(mission: MissionRecords) -> MissionRecords:
    """Leave out the profiles that lost rows to a clock step, and the fixes around such a step."""
    certain = screen_clock_steps(
        mission.clock_steps,
        mission.variables["profile"].astype(np.int64),
        mission.variables["time"].astype("datetime64[ns]"),
        mission.fixes,
    )
    piece = mission.pieces.removesuffix("s")
    rejected = mission.rejected | {
        f"{piece} {part}": why
        for number, why in certain.left_out.items()
        for part in mission.parts.get(number) or (number,)
    }
    without = mission.without_profile
    return replace(
        mission,
        variables={**mission.variables, "profile": certain.profile},
        spans={number: span for number, span in mission.spans.items() if number not in certain.left_out},
        fixes=certain.fixes,
        rejected=rejected,
        without_profile=without and {name: why for name, why in without.items() if name not in rejected},
        remarks=(*certain.remarks, *mission.remarks),
    )


def check_import_path(
    out: Path, sources: Sequence[Path], is_record: Callable[[Path], bool], *, overwrite: bool
) -> None:
    """Refuse to write over a record, which a missing last argument would destroy.

    Raises
    ------
    InputError
        `out` is a folder, or is named like the instrument's files; or as for `check_output`.
    """
    if out.is_dir() or is_record(out):
        raise InputError(
            f"{out}: is not an output file; the last argument must be the netCDF file to write, for example mission.nc"
        )
    check_netcdf_name(out)
    check_output(out, overwrite=overwrite, inputs=sources)


def median_interval(time: TimeArray, spans: Sequence[Span]) -> float:
    """Sample interval (s) within the spans (first, after last), or in the whole record if there are no spans.

    It is the time-weighted median, without gaps.
    """
    steps = [np.diff(time[start:stop]) / SECOND for start, stop in spans or [(0, len(time))]]
    return usual_interval(np.concatenate([without_gaps(part) for part in steps]))


def _attributes(mission: MissionRecords, water: CtdSamples) -> dict[str, Attribute]:
    """Return the global attributes of the observation file."""
    left_out: dict[str, Mapping[str, str] | Mapping[str, int]] = {
        mission.rejected_attribute: mission.rejected,
        mission.dropped_attribute: dict(sorted(mission.rows_dropped.items())),
    }
    if mission.without_profile is not None:
        left_out = {f"{mission.pieces}_without_profile": mission.without_profile, **left_out}
    return {
        "platform": mission.platform,
        "platform_id": mission.vehicle,
        "mission": mission.mission,
        "source": mission.source,
        **mission.comments,
        **({"ctd_comment": water.comment} if water.comment else {}),
        **{name: describe_reasons(reasons) for name, reasons in left_out.items()},
    }


def describe_reasons(reasons: Mapping[str, str] | Mapping[str, int]) -> str:
    """List omitted items with their reasons, or reasons with their counts, in one line."""
    return "; ".join(f"{what}: {why}" for what, why in reasons.items()) or "none"


def _profile(number: int, parts: Parts, start: int, stop: int, variables: Columns) -> ImportedProfile:
    """Summarise the profile in the samples from `start` to before `stop` of an observation file's variables."""
    time: TimeArray = np.asarray(variables["time"][start:stop], dtype="datetime64[ns]")
    depth: FloatArray = np.asarray(variables["depth"][start:stop], dtype=np.float64)
    return ImportedProfile(
        number=number,
        parts=parts,
        start_time=time[0],
        duration=float((time[-1] - time[0]) / SECOND),
        samples=len(time),
        max_depth=float(np.max(depth, where=np.isfinite(depth), initial=-np.inf)),
        fault=_fault(number, start, time, variables),
    )


def _fault(number: int, start: int, time: TimeArray, variables: Columns) -> str | None:
    """Return the fault of length, values, pace or signs that the file's reader will find in this profile, or None."""
    fault = check_length(number, time)
    for name in REQUIRED:
        if fault is None:
            values: FloatArray = np.asarray(variables[name][start : start + len(time)], dtype=np.float64)
            fault = check_values(VARIABLES[name], values, number, start)
    if fault is None:
        glide = {name: np.asarray(variables[name][start : start + len(time)], dtype=np.float64) for name in GLIDE}
        fault = fault_of_pace(number, time, glide["depth"]) or fault_of_signs(number, time, glide)
    return fault
