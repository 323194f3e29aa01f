"""The study over a mission: a job a profile, the archive's group, Figure 6, and Table 3 with its verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import write_table_rows, write_whole
from gliderhpc.studies.archived import platform_of
from gliderhpc.studies.intermittency.profile_intermittency import profile_intermittency
from gliderhpc.studies.library.turbulence.band import missing_band
from gliderhpc.studies.library.turbulence.channel import channel_of, series_step
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings
from gliderhpc.studies.library.turbulence.structure import ORDERS, lag_samples
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, own_assignments, provenance

NAME = "intermittency"
QUICK_SURROGATES = 9

OF_RANGE = ("zeta_ratio", "zeta_ratio_low", "zeta_ratio_high")
"""What a profile has over each range of lags."""


@dataclass(frozen=True)
class IntermittencyJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    settings: IntermittencySettings


@dataclass(frozen=True)
class Intermittent(StudiedProfile):
    """What a profile gives: its row, and its values by range of lags, none where it has no statistics."""

    ranges: Mapping[str, Any]


def study_profile(archive: xr.DataTree, job: IntermittencyJob) -> Intermittent:
    """Study one profile: its rows on lags and orders, and of the table; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    series = channel_of(data, job.settings.channel, platform_of(archive))
    found = profile_intermittency(series, job.settings, job.number)
    row, rows = {"nyquist": series.nyquist, **found.row}, {**found.on_lags, **found.on_orders}
    return Intermittent(job.number, job.index, row, _by_range(found.ranges), rows=rows)


def _by_range(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    return {f"range_{name}": np.array([row[name] for row in rows]) for name in OF_RANGE} if rows else {}


def run(request: Request) -> None:
    """Study the chosen profiles, into the archive's group ``intermittency``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen, step = choose(archive, request), series_step(archive, request.estimate)
    interval = max(1, int(settings.interval / step + 1e-9)) * step
    jobs = [IntermittencyJob(number, chosen.where[number], request.estimate, settings) for number in chosen.numbers]
    ranges = np.array([settings.scaling, *settings.scaling_varied])
    sizes = {"lag": len(lag_samples(settings.every_lag, interval)), "order": len(ORDERS), "range": len(ranges)}
    remarks = chosen.remarks + begin_study(request, NAME, sizes)
    results = study_profiles(request, NAME, study_profile, jobs)
    write_table_rows(request.archive, {result.index: result.ranges for result in results}, NAME)
    write_whole(request.archive, NAME, {"range_from": ranges[:, 0], "range_to": ranges[:, 1]})
    rows = {result.number: result.row for result in results}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    finish_study_group(request.archive, NAME, made)


def _settings(request: Request) -> IntermittencySettings:
    base = {"surrogates": QUICK_SURROGATES} if request.quick else {}
    return build_settings_of(IntermittencySettings, base, own_assignments(request, NAME))


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "increments of a disturbance's fast part beside surrogates", missing, run)
"""What the registry finds."""
