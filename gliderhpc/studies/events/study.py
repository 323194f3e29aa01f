"""The study over a mission: a job a profile, the catalogue in the archive's group and as CSV, the strongest drawn."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies import study_called
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.events.peaks import noise_floor, peaks_of
from gliderhpc.studies.events.settings import EventSettings
from gliderhpc.studies.library.anchored_track import estimated_positions
from gliderhpc.studies.library.profile_reconstruction import motions_of
from gliderhpc.studies.library.turbulence.band import missing_band
from gliderhpc.studies.library.turbulence.channel import channel_of
from gliderhpc.studies.library.turbulence.ensembles import NullFloor, null_floor
from gliderhpc.studies.library.turbulence.statistics import fast_part
from gliderhpc.studies.profile_jobs import StudiedProfile, run_jobs
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments, provenance

NAME = "events"


@dataclass(frozen=True)
class EventsJob:
    """One profile to look through."""

    number: int
    index: int
    estimate: str
    settings: EventSettings
    floor: NullFloor | None


@dataclass(frozen=True, eq=False)
class ProfileEvents(StudiedProfile):
    """What a profile gives: its row of the group's table, and its events."""

    events: list[dict[str, Any]]


def find_events(archive: xr.DataTree, job: EventsJob) -> ProfileEvents:
    """Look through one profile; the job of a worker."""
    settings = job.settings
    data, platform = read_profile_data(archive, job.number, job.estimate), platform_of(archive)
    series = channel_of(data, settings.channel, platform)
    part = fast_part(series, settings, actuated=settings.actuated)
    if part.message:
        return ProfileEvents(job.number, job.index, {"message": part.message}, [])
    noise = noise_floor(part.pieces) if job.floor is None else job.floor.noise
    threshold = _threshold(settings, job.floor, noise)
    found = peaks_of(part.pieces, threshold, settings.separation)
    places = _places(archive, data) if len(found.at) else np.full((len(data.record_time), 2), np.nan)
    at_records = np.clip(np.searchsorted(data.record_time, series.time[found.at]), 0, len(data.record_time) - 1)
    events = [
        {
            "source_profile": job.number,
            "time": data.epoch + np.timedelta64(round(float(series.time[sample]) * 1e9), "ns"),
            "depth": float(series.depth[sample]),
            "latitude": float(places[record, 0]),
            "longitude": float(places[record, 1]),
            "channel": settings.channel,
            "amplitude": float(amplitude),
            "width": float(width),
            "sigma": abs(float(amplitude)) / noise if noise > 0.0 else float("nan"),
            "over_ceiling": abs(float(amplitude)) / threshold,
            "quality": int(series.quality[sample]),
        }
        for sample, record, amplitude, width in zip(found.at, at_records, found.amplitude, found.width, strict=True)
    ]
    return ProfileEvents(job.number, job.index, {"noise": noise, "count": len(events)}, events)


def _threshold(settings: EventSettings, floor: NullFloor | None, noise: float) -> float:
    if settings.threshold is not None:
        return settings.threshold
    return settings.sigma * noise if floor is None else floor.ceiling


def _places(archive: xr.DataTree, data: ProfileData) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Latitude and longitude ``(m, 2)`` of the records on the estimate's track, missing without fixes."""
    found = estimated_positions(archive, data, motions_of(data, platform_of(archive)).estimate)
    return np.full((len(data.record_time), 2), np.nan) if found is None else found


def run(request: Request) -> None:
    """Look through the chosen profiles, into the archive's group ``events``.

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
    remarks += chosen.remarks + begin_study(request, NAME, {"event": len(events)})
    write_table_rows(request.archive, {result.index: result.row for result in results}, NAME)
    write_whole(request.archive, NAME, {name: [one[name] for one in events] for name in of_events()})
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    finish_study_group(request.archive, NAME, made, {"floor": None if floor is None else asdict(floor)})


def _settings(request: Request) -> EventSettings:
    return build_settings_of(EventSettings, {}, own_assignments(request, NAME))


def of_events() -> list[str]:
    """Variables of the catalogue."""
    return [v.name for v in study_called(NAME).variables if v.dims == ("event",) and v.name != "event"]


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "the catalogue of impulsive events above what nulls reach", missing, run)
"""What the registry finds."""
