"""The study over a mission: a job a profile, the archive's group, Table 1 and Figure 4."""

from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, positions
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.spectra.figure_4 import figure_4
from gliderhpc.analysis.spectra.groups import groups_by_speed, speeds
from gliderhpc.analysis.spectra.profile_spectra import profile_spectra
from gliderhpc.analysis.spectra.table_1 import comparisons, table_1
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
from gliderhpc.analysis.turbulence.remarks import about_the_band, without_statistics
from gliderhpc.analysis.turbulence.settings import SpectraSettings
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.store_schema import finish_study

NAME = "spectra"


@dataclass(frozen=True)
class SpectraJob:
    """One profile to study, and what is known of it beforehand."""

    number: int
    index: int
    estimate: str
    settings: SpectraSettings
    speed: float
    group: str


def study_profile(archive: xr.DataTree, job: SpectraJob) -> StudiedProfile:
    """Study one profile: its spectra and row; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    found = profile_spectra(channel_of(data, job.settings.channel, platform_of(archive)), job.settings)
    row = {"group": job.group, "speed": job.speed, **found.row}
    return StudiedProfile(job.number, job.index, row, rows=found.on_frequencies)


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is, since the archive alone makes a study."""
    return None


def run(request: Request) -> Findings:
    """Study the chosen profiles, into the archive's group ``spectra``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = build_settings_of(SpectraSettings, {}, own_assignments(request, NAME))
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        where = positions(archive)
        remarks = about_the_estimate(archive, request.estimate, numbers)
        speed = speeds(archive, numbers, request.estimate)
        step = series_step(archive, request.estimate)
    groups = groups_by_speed(speed, settings.groups)
    jobs = [
        SpectraJob(number, where[number], request.estimate, settings, speed[number], groups[number])
        for number in numbers
    ]
    remarks += begin_study(request, NAME, {"frequency": max(2, round(settings.segment / step)) // 2 + 1})
    results = study_profiles(request, NAME, study_profile, jobs)
    table = pd.DataFrame([{"profile": result.number, **result.row} for result in results])
    return _conclude(request, table, settings, remarks + about_the_band(table, settings, step))


def _conclude(request: Request, table: pd.DataFrame, settings: SpectraSettings, remarks: tuple[str, ...]) -> Findings:
    failed, studied = without_statistics(table)
    rows = comparisons(studied)
    facts = {
        "profiles": table["profile"].tolist(),
        "estimate": request.estimate,
        "quick": request.quick,
        "settings": settings.model_dump(mode="json"),
        "group_means": as_plain(_group_means(studied)),
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(rows)}))
    figures = {}
    if len(studied):
        with open_mission(request.archive) as archive:
            figures["figure_4"] = figure_4(archive, studied, settings)
    findings = archive_findings(NAME, rows, {"profiles": table}, figures, facts, failed, remarks)
    return replace(findings, documents={"table_1.md": table_1(studied)} if len(studied) else {})


def _group_means(table: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Mean exponents of each group."""
    names = [name for name in ("whole_beta", "whole_beta_resolved", "speed") if name in table]
    return {str(group): own[names].mean().to_dict() for group, own in table.groupby("group")} if len(table) else {}


STUDY = Study(NAME, "spectra of a disturbance's fast part and their exponents", missing_input, run)
"""What the registry finds."""
