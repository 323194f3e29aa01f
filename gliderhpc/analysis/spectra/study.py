"""The study over a mission: a job a profile, the archive's group, Table 1 and Figure 4."""

from dataclasses import dataclass, replace
from typing import Any

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import failed_profiles, platform_of, study_table
from gliderhpc.analysis.captions import data_said
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.analysis.provenance import Provenance, provenance_of
from gliderhpc.analysis.spectra.figure_4 import figure_4
from gliderhpc.analysis.spectra.groups import groups_by_speed, speeds
from gliderhpc.analysis.spectra.profile_spectra import profile_spectra
from gliderhpc.analysis.spectra.table_1 import comparisons, table_1, table_1_text
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
from gliderhpc.analysis.turbulence.captions import resolved_said, series_said
from gliderhpc.analysis.turbulence.channel import channel_of, series_step
from gliderhpc.analysis.turbulence.remarks import about_the_band
from gliderhpc.analysis.turbulence.settings import SpectraSettings
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of

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


def run(request: Request) -> Findings:
    """Study the chosen profiles, into the archive's group ``spectra``.

    Raises
    ------
    InputError
        No such profile is done, the archive has no such estimate, or a setting is wrong.
    """
    settings = _settings(request)
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request)
        speed = speeds(archive, chosen.numbers, request.estimate)
        step = series_step(archive, request.estimate)
    groups = groups_by_speed(speed, settings.groups)
    jobs = [
        SpectraJob(number, chosen.where[number], request.estimate, settings, speed[number], groups[number])
        for number in chosen.numbers
    ]
    frequencies = max(2, round(settings.segment / step)) // 2 + 1
    remarks = chosen.remarks + begin_study(request, NAME, {"frequency": frequencies})
    rows = {result.number: result.row for result in study_profiles(request, NAME, study_profile, jobs)}
    made = provenance(request, rows, settings.model_dump(mode="json"), remarks)
    return conclude_study(request.archive, STUDY, made)


def _settings(request: Request) -> SpectraSettings:
    return build_settings_of(SpectraSettings, {}, own_assignments(request, NAME))


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = SpectraSettings.model_validate(made.settings)
    failed, studied = failed_profiles(table)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(mode="json"),
        "group_means": as_plain(_group_means(studied)),
    }
    by_depth = table_1(studied)
    findings = archive_findings(
        NAME, comparisons(studied), {"table_1": pd.DataFrame(by_depth), "profiles": table},
        {"figure_4": figure_4(archive, studied, settings)} if len(studied) else {}, facts, failed,
        made.remarks + about_the_band(table, settings, series_step(archive, made.estimate)),
        captions=_captions(made, table, studied, settings),
    )  # fmt: skip
    return replace(findings, documents={"table_1.md": table_1_text(by_depth)} if by_depth else {})


def _exponents(series: str, data: str, settings: SpectraSettings) -> str:
    return (
        f"Exponents of the spectrum of {series}, of each profile and of its thirds by depth: {data}. Intervals are of "
        f"95 % by {settings.draws} draws of Welch's segments and hold scatter alone, no error of the estimate's own "
        "response."
    )


def _captions(
    made: Provenance, table: pd.DataFrame, studied: pd.DataFrame, settings: SpectraSettings
) -> dict[str, str]:
    """Say what figure and table are made from, and how far up the records carry them."""
    low, high = settings.band
    series, data = series_said(made, settings), data_said(made, studied["profile"].tolist())
    resolved = resolved_said(table, settings)
    return {
        "figure_4": (
            f"Power spectra of {series}: {data}, in groups by the speed of their depth-averaged current, each spectrum "
            f"over the variance that it holds; Welch's segments of {settings.segment:g} s. Exponents are fitted over "
            f"{low:g} to {high:g} Hz (dotted) and over what of it the records resolve. {resolved}"
        ),
        "table_1": f"{_exponents(series, data, settings)} {resolved}",
        "profiles": f"A row a profile. {_exponents(series, data, settings)} {resolved}",
    }


def _group_means(table: pd.DataFrame) -> dict[str, dict[Any, Any]]:
    """Mean exponents of each group."""
    names = [name for name in ("whole_beta", "whole_beta_resolved", "speed") if name in table]
    return {str(group): own[names].mean().to_dict() for group, own in table.groupby("group")} if len(table) else {}


def missing(request: Request) -> str | None:
    """Say why the records are sampled too rarely for this study, None where they are not."""
    return missing_band(request, _settings(request))


STUDY = Study(NAME, "spectra of a disturbance's fast part and their exponents", show, missing, run)
"""What the registry finds."""
