"""Study ``events``: the catalogue of impulsive events above what nulls reach, with time and place (section 5.3)."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies.events import CATALOGUE, EVENT
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.library.profile_reconstruction import motions_of
from gliderhpc.studies.library.tracks import estimated_positions
from gliderhpc.studies.library.turbulence.series import (
    ChannelSeries,
    GappySeries,
    channel_of,
    describe_missing_band,
    fast_part,
)
from gliderhpc.studies.library.turbulence.settings import FastSettings
from gliderhpc.studies.library.turbulence.verdict import NullFloor, null_floor
from gliderhpc.studies.profile_jobs import StudiedProfile, run_jobs
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments, provenance

NAME = "events"

MEDIAN_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian series over its median magnitude."""

Array = NDArray[np.float64]


class EventSettings(FastSettings):
    """Threshold and separation of events, and where to look for them."""

    threshold: float | None = Field(
        None, gt=0, description="least magnitude, N or N m; null for the nulls' ceiling, or without nulls for sigma"
    )
    sigma: float = Field(6.0, gt=0, description="least magnitude in noise floors, where there are no nulls")
    separation: float = Field(5.0, gt=0, description="of two peaks that lie nearer only the larger counts, s")
    actuated: bool = Field(False, description="whether to look where actuators move or the battery is rotated, too")
    strongest: int = Field(12, ge=1, description="events of the view of the strongest")


# Peaks


@dataclass(frozen=True, eq=False)
class Peaks:
    """Peaks of the magnitude of a series.

    Attributes
    ----------
    at : (k,) int array
        Their samples.
    amplitude : (k,) array
        Values there, with their sign.
    width : (k,) array
        Time over which the series is at least half as large, with the same sign, s.
    """

    at: NDArray[np.int64]
    amplitude: Array
    width: Array


def find_peaks(series: GappySeries, threshold: float, separation: float) -> Peaks:
    """Find the peaks of what counts that reach a threshold and are the largest within `separation` (s)."""
    magnitude = np.where(series.counted, np.abs(series.values), 0.0)
    # A peak may be the first or last sample that counts.
    padded = np.concatenate([[0.0], magnitude, [0.0]])
    distance = max(1, round(separation / series.step))
    at = np.asarray(scipy.signal.find_peaks(padded, height=threshold, distance=distance)[0] - 1, dtype=np.int64)
    widths = [_half_width(series.values, int(sample)) * series.step for sample in at]
    return Peaks(at, series.values[at], np.array(widths))


def _half_width(values: Array, at: int) -> int:
    """Samples in a row about a peak that have at least half its value."""
    below = values * np.sign(values[at]) < 0.5 * abs(values[at])
    before, after = below[:at][::-1], below[at:]
    left = int(np.argmax(before)) if before.any() else at
    right = int(np.argmax(after)) if after.any() else len(after)
    return left + right


def noise_floor(series: GappySeries) -> float:
    """Standard deviation of a Gaussian series with the same median magnitude: impulses hardly change it."""
    values = series.values[series.counted]
    return float(MEDIAN_TO_SIGMA * np.median(np.abs(values))) if values.size else float("nan")


# One profile


@dataclass(frozen=True)
class EventsJob:
    """One profile to search."""

    number: int
    index: int
    estimate: str
    settings: EventSettings
    floor: NullFloor | None


@dataclass(frozen=True, eq=False)
class ProfileEvents(StudiedProfile):
    """Result of a job: the profile's row of the group's table, and its events."""

    events: list[dict[str, Any]]


def find_events(archive: xr.DataTree, job: EventsJob) -> ProfileEvents:
    """Search one profile; the job of a worker."""
    settings = job.settings
    data, platform = read_profile_data(archive, job.number, job.estimate), platform_of(archive)
    channel = channel_of(data, settings.channel, platform)
    part = fast_part(channel, settings, actuated=settings.actuated)
    if part.message:
        return ProfileEvents(job.number, job.index, {"message": part.message}, [])
    noise = noise_floor(part.series) if job.floor is None else job.floor.noise
    threshold = _threshold(settings, job.floor, noise)
    peaks = find_peaks(part.series, threshold, settings.separation)
    positions = _positions(archive, data, channel.time[peaks.at])
    events = [
        {
            "source_profile": job.number,
            **_sample_columns(data, channel, int(sample)),
            "latitude": float(position[0]),
            "longitude": float(position[1]),
            "channel": settings.channel,
            "amplitude": float(amplitude),
            "width": float(width),
            "sigma": abs(float(amplitude)) / noise if noise > 0.0 else float("nan"),
            "over_ceiling": abs(float(amplitude)) / threshold,
        }
        for sample, position, amplitude, width in zip(peaks.at, positions, peaks.amplitude, peaks.width, strict=True)
    ]
    return ProfileEvents(job.number, job.index, {"noise": noise, "count": len(events)}, events)


def _sample_columns(data: ProfileData, channel: ChannelSeries, sample: int) -> dict[str, Any]:
    return {
        "time": data.epoch + np.timedelta64(round(float(channel.time[sample]) * 1e9), "ns"),
        "depth": float(channel.depth[sample]),
        "quality": int(channel.quality[sample]),
    }


def _threshold(settings: EventSettings, floor: NullFloor | None, noise: float) -> float:
    if settings.threshold is not None:
        return settings.threshold
    return settings.sigma * noise if floor is None else floor.ceiling


def _positions(archive: xr.DataTree, data: ProfileData, times: Array) -> Array:
    """Latitude and longitude ``(k, 2)`` on the estimate's track at times (s), missing without fixes."""
    missing_positions = np.full((len(times), 2), np.nan)
    if not len(times):
        return missing_positions
    positions = estimated_positions(archive, data, motions_of(data, platform_of(archive)).estimate)
    if positions is None:
        return missing_positions
    return positions[np.clip(np.searchsorted(data.record_time, times), 0, len(data.record_time) - 1)]


# The mission


def run(request: Request) -> None:
    """Search the chosen profiles, into the archive's group ``events``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        floor, remarks = null_floor(archive, request.estimate, settings)
        chosen = choose(archive, request)
    jobs = [EventsJob(number, chosen.where[number], request.estimate, settings, floor) for number in chosen.numbers]
    results, _ = run_jobs(request, NAME, find_events, jobs)
    events = sorted((one for result in results for one in result.events), key=lambda one: -abs(one["amplitude"]))
    remarks += chosen.remarks + begin_study(request, NAME, {EVENT: len(events)})
    write_table_rows(request.archive, {result.index: result.row for result in results}, NAME)
    columns = {variable.name: [event[variable.name] for event in events] for variable in CATALOGUE}
    write_whole(request.archive, NAME, columns)
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    finish_study_group(request.archive, NAME, made, {"floor": None if floor is None else asdict(floor)})


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return describe_missing_band(request, _settings(request))


def _settings(request: Request) -> EventSettings:
    return build_settings_of(EventSettings, {}, own_assignments(request, NAME))


STUDY = Study(NAME, "the catalogue of impulsive events above what nulls reach", missing, run)
"""The study that the registry finds."""
