"""The study over a mission: a job a profile, the catalogue in the archive's group and as CSV, the strongest drawn."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.anchored_track import estimated_positions
from gliderhpc.analysis.archived import as_cells, failed_profiles, mission_of, platform_of, sample_interval, study_table
from gliderhpc.analysis.comparison import Comparison
from gliderhpc.analysis.events.captions import captions
from gliderhpc.analysis.events.figure import events_figure
from gliderhpc.analysis.events.peaks import noise_floor, peaks_of
from gliderhpc.analysis.events.settings import EventSettings
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_jobs import StudiedProfile, run_jobs
from gliderhpc.analysis.profile_reconstruction import motions_of
from gliderhpc.analysis.provenance import kept, provenance_of
from gliderhpc.analysis.study import (
    Request,
    Study,
    archive_findings,
    begin_study,
    choose,
    conclude_study,
    own_assignments,
    provenance,
)
from gliderhpc.analysis.turbulence.band import missing_band
from gliderhpc.analysis.turbulence.channel import channel_of
from gliderhpc.analysis.turbulence.ensembles import NullFloor, null_floor
from gliderhpc.analysis.turbulence.statistics import fast_part
from gliderhpc.analysis.turbulence.table_3 import unit_of
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import ProfileData, read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.store_schema.studies import study_called

NAME = "events"

PAPER_OVER_CEILING = (1.0, 6.2)
"""The paper's twelve strongest events reach six times its null ceiling."""

PAPER_AMPLITUDES = (0.36, 2.98)


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


def run(request: Request) -> Findings:
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
    write_whole(request.archive, NAME, {name: [one[name] for one in events] for name in _of_events()})
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    return conclude_study(request.archive, STUDY, made, {"floor": None if floor is None else asdict(floor)})


def _settings(request: Request) -> EventSettings:
    return build_settings_of(EventSettings, {}, own_assignments(request, NAME))


def _of_events() -> list[str]:
    """Variables of the catalogue."""
    return [v.name for v in study_called(NAME).variables if v.dims == ("event",) and v.name != "event"]


def catalogue(archive: xr.DataTree) -> pd.DataFrame:
    """Return the events of an archive, strongest first."""
    group = archive[NAME].to_dataset()
    events = pd.DataFrame({name: as_cells(group[name].values) for name in _of_events()})
    # Without any event the group has one missing entry, for an array cannot be empty.
    known = events[events["amplitude"].notna()]
    return known.assign(source_profile=known["source_profile"].astype(int))


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table, events = provenance_of(archive, NAME), study_table(archive, NAME), catalogue(archive)
    settings = EventSettings.model_validate(made.settings)
    stored = kept(archive, NAME, "floor")
    floor = None if stored is None else NullFloor(**stored)
    failed, studied = failed_profiles(table)
    strongest = events.head(settings.strongest)
    ranked_by = "null ceiling" if settings.threshold is None and floor is not None else _otherwise(settings)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "ranked_by": ranked_by,
        "events": len(events),
    }
    remarks = (*made.remarks, *_about_widths(archive, strongest, made.estimate)) if len(strongest) else made.remarks
    shown = events.assign(time=[str(time) for time in events["time"]])
    return archive_findings(
        NAME, _comparisons(studied, strongest, settings, floor),
        {"events": shown, "strongest": shown.head(settings.strongest), "profiles": table},
        {"events": events_figure(events, settings, floor, mission_of(archive))} if len(events) else {}, facts, failed,
        remarks, captions=captions(made, events, settings, floor, ranked_by),
    )  # fmt: skip


def _about_widths(archive: xr.DataTree, strongest: pd.DataFrame, estimate: str) -> tuple[str, ...]:
    """Say how many of the strongest are too narrow for the records to have seen their shape."""
    first = read_profile_data(archive, int(strongest["source_profile"].iloc[0]), estimate)
    interval = sample_interval(first, platform_of(archive))
    narrow = int((strongest["width"] < 2.0 * interval).sum())
    if not narrow:
        return ()
    return (
        f"{narrow} of the {len(strongest)} strongest are narrower than two sample intervals ({2.0 * interval:g} s): a "
        "false sample of the record looks so",
    )


def _otherwise(settings: EventSettings) -> str:
    return "noise floor" if settings.threshold is None else "threshold as set"


def _comparisons(
    studied: pd.DataFrame, strongest: pd.DataFrame, settings: EventSettings, floor: NullFloor | None
) -> tuple[Comparison, ...]:
    unit = unit_of(settings.channel)
    amplitudes = strongest["amplitude"].abs()
    ceiling = float("nan") if floor is None else floor.ceiling
    return (
        Comparison("null ceiling", unit, ceiling, 0.48),
        Comparison("events, all profiles", "1", float(studied["count"].sum()) if len(studied) else float("nan")),
        Comparison(
            "amplitude of the strongest, median", unit, float(amplitudes.median()), PAPER_AMPLITUDES,
            _range(amplitudes), remark=f"{len(strongest)} events, spread is their range",
        ),
        Comparison(
            "the same over the threshold", "1", float(strongest["over_ceiling"].median()), PAPER_OVER_CEILING,
            _range(strongest["over_ceiling"]), paper_said="up to 6", remark="spread is their range",
        ),
        Comparison("their width at half the amplitude, median", "s", float(strongest["width"].median())),
    )  # fmt: skip


def _range(values: pd.Series) -> tuple[float, float] | None:
    return (float(values.min()), float(values.max())) if len(values) else None


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "the catalogue of impulsive events above what nulls reach", show, missing, run)
"""What the registry finds."""
