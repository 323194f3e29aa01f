"""The study over a mission: a job a profile, the catalogue in the archive's group and as CSV, the strongest drawn."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.analysis.anchored_track import estimated_positions
from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, positions
from gliderhpc.analysis.comparison import Comparison, comparisons_as_json
from gliderhpc.analysis.events.figure import events_figure
from gliderhpc.analysis.events.peaks import noise_floor, peaks_of
from gliderhpc.analysis.events.settings import EventSettings
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_reconstruction import motions_of
from gliderhpc.analysis.study import Request, Study, archive_findings, begin_study, own_assignments
from gliderhpc.analysis.turbulence.channel import channel_of, sample_interval
from gliderhpc.analysis.turbulence.ensembles import NullFloor, null_floor
from gliderhpc.analysis.turbulence.remarks import without_statistics
from gliderhpc.analysis.turbulence.statistics import fast_part
from gliderhpc.analysis.turbulence.table_3 import unit_of
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import ProfileData, read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import finish_study, write_table_rows, write_whole
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
    archive: str
    estimate: str
    settings: EventSettings
    floor: NullFloor | None


@dataclass(frozen=True, eq=False)
class ProfileEvents:
    """What a profile gives: its row of the group's table, and its events."""

    number: int
    index: int
    row: dict[str, Any]
    events: list[dict[str, Any]]


def find_events(job: EventsJob) -> ProfileEvents:
    """Look through one profile; the job of a worker."""
    settings = job.settings
    with threadpool_limits(limits=1), open_mission(job.archive) as archive:
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


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is; without nulls events are ranked by the noise floor."""
    return None


def run(request: Request) -> Findings:
    """Look through the chosen profiles, into the archive's group ``events``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = build_settings_of(EventSettings, {}, own_assignments(request, NAME))
    floor, remarks = null_floor(request.archive, request.estimate, settings)
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        remarks += about_the_estimate(archive, request.estimate, numbers)
        where, title = positions(archive), str(archive.attrs.get("mission") or "mission")
    job = partial(
        EventsJob, archive=str(request.archive.resolve()), estimate=request.estimate, settings=settings, floor=floor
    )
    results = []
    with request.executor() as opened:
        for result in opened.run(find_events, [job(number=number, index=where[number]) for number in numbers]):
            results.append(result)
            request.report(result.number)
    results.sort(key=lambda result: result.number)
    events = sorted((one for result in results for one in result.events), key=lambda one: -abs(one["amplitude"]))
    remarks += begin_study(request, NAME, {"event": len(events)})
    write_table_rows(request.archive, {result.index: result.row for result in results}, NAME)
    names = [v.name for v in study_called(NAME).variables if v.dims == ("event",) and v.name != "event"]
    write_whole(request.archive, NAME, {name: [one[name] for one in events] for name in names})
    table = pd.DataFrame([{"profile": result.number, **result.row} for result in results])
    return _conclude(request, table, pd.DataFrame(events, columns=names), settings, floor, title, remarks)


def _conclude(
    request: Request, table: pd.DataFrame, events: pd.DataFrame, settings: EventSettings, floor: NullFloor | None,
    title: str, remarks: tuple[str, ...],
) -> Findings:  # fmt: skip
    failed, studied = without_statistics(table)
    strongest = events.head(settings.strongest)
    rows = _comparisons(studied, strongest, settings, floor)
    facts = {
        "profiles": table["profile"].tolist(),
        "estimate": request.estimate,
        "quick": request.quick,
        "settings": settings.model_dump(mode="json"),
        "ranked_by": "null ceiling" if settings.threshold is None and floor is not None else _otherwise(settings),
        "events": len(events),
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(rows)}))
    if len(strongest):
        remarks = (*remarks, *_about_widths(strongest, request))
    shown = events.assign(time=[str(time) for time in events["time"]])
    figures = {"events": events_figure(events, settings, floor, title)} if len(events) else {}
    tables = {"events": shown, "strongest": shown.head(settings.strongest), "profiles": table}
    return archive_findings(NAME, rows, tables, figures, facts, failed, remarks)


def _about_widths(strongest: pd.DataFrame, request: Request) -> tuple[str, ...]:
    """Say how many of the strongest are too narrow for the records to have seen their shape."""
    with open_mission(request.archive) as archive:
        first = read_profile_data(archive, int(strongest["source_profile"].iloc[0]), request.estimate)
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


STUDY = Study(NAME, "the catalogue of impulsive events above what nulls reach", missing_input, run)
"""What the registry finds."""
