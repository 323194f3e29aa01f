"""The study over a mission: a job a profile, the archive's group, Figure 6, and Table 3 with its verdict."""

from dataclasses import dataclass, replace

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, positions
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.intermittency.figure_6 import figure_6
from gliderhpc.analysis.intermittency.profile_intermittency import profile_intermittency
from gliderhpc.analysis.study import (
    Request,
    StudiedProfile,
    Study,
    archive_findings,
    begin_study,
    own_assignments,
    study_profiles,
)
from gliderhpc.analysis.turbulence.channel import channel_of, series_step
from gliderhpc.analysis.turbulence.ensembles import Ensembles, stored_nulls
from gliderhpc.analysis.turbulence.remarks import about_the_band, without_statistics
from gliderhpc.analysis.turbulence.settings import IntermittencySettings
from gliderhpc.analysis.turbulence.structure import ORDERS, lag_samples
from gliderhpc.analysis.turbulence.table_3 import comparisons, table_3, table_3_text
from gliderhpc.analysis.turbulence.verdict import verdict, verdict_text
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import finish_study

NAME = "intermittency"
QUICK_SURROGATES = 9


@dataclass(frozen=True)
class IntermittencyJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    settings: IntermittencySettings


@dataclass(frozen=True)
class Intermittent(StudiedProfile):
    """What a profile gives: its row, the highest frequency of its records, and a row a range of lags."""

    nyquist: float
    ranges: tuple[dict[str, float], ...]


def study_profile(archive: xr.DataTree, job: IntermittencyJob) -> Intermittent:
    """Study one profile: its rows on lags and orders, and of the table; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    series = channel_of(data, job.settings.channel, platform_of(archive))
    found = profile_intermittency(series, job.settings, job.number)
    rows = {**found.on_lags, **found.on_orders}
    return Intermittent(job.number, job.index, found.row, series.nyquist, found.ranges, rows=rows)


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is, since the archive alone makes a study."""
    return None


def run(request: Request) -> Findings:
    """Study the chosen profiles, into the archive's group ``intermittency``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    base = {"surrogates": QUICK_SURROGATES} if request.quick else {}
    settings = build_settings_of(IntermittencySettings, base, own_assignments(request, NAME))
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        where = positions(archive)
        remarks = about_the_estimate(archive, request.estimate, numbers)
        step = series_step(archive, request.estimate)
    interval = max(1, int(settings.interval / step + 1e-9)) * step
    jobs = [IntermittencyJob(number, where[number], request.estimate, settings) for number in numbers]
    sizes = {"lag": len(lag_samples(settings.every_lag, interval)), "order": len(ORDERS)}
    remarks += begin_study(request, NAME, sizes)
    results = study_profiles(request, NAME, study_profile, jobs)
    table = pd.DataFrame([{"profile": r.number, "nyquist": r.nyquist, **r.row} for r in results])
    ranges = pd.DataFrame([{"profile": r.number, **row} for r in results for row in r.ranges])
    return _conclude(request, table, ranges, settings, remarks + about_the_band(table, settings, step))


def _conclude(
    request: Request,
    table: pd.DataFrame,
    ranges: pd.DataFrame,
    settings: IntermittencySettings,
    remarks: tuple[str, ...],
) -> Findings:
    failed, studied = without_statistics(table)
    nulls, about_nulls = stored_nulls(request.archive, request.estimate, settings)
    ensembles = Ensembles(studied, nulls, settings)
    found = verdict(ensembles)
    rows = comparisons(ensembles)
    facts = {
        "profiles": table["profile"].tolist(),
        "estimate": request.estimate,
        "quick": request.quick,
        "settings": settings.model_dump(mode="json"),
        "verdict": found.as_json(),
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(rows)}))
    figures = {}
    if len(studied):
        with open_mission(request.archive) as archive:
            figures["figure_6"] = figure_6(archive, studied, settings)
    tables = {"profiles": table, "ranges": ranges, "table_3": table_3(ensembles)}
    remarks = (*remarks, *about_nulls, found.sentence)
    findings = archive_findings(NAME, rows, tables, figures, facts, failed, remarks)
    return replace(findings, documents={"verdict.md": table_3_text(ensembles) + "\n" + verdict_text(found)})


STUDY = Study(NAME, "increments of a disturbance's fast part beside surrogates", missing_input, run)
"""What the registry finds."""
