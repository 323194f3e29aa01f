"""The study over a mission: a job a profile, the archive's group, the table beside the paper's figures, Figure 7."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import column_medians, failed_profiles, platform_of, settings_of, study_table
from gliderhpc.analysis.comparison import Comparison
from gliderhpc.analysis.currents.beside_reference import beside_reference, opened
from gliderhpc.analysis.currents.captions import captions
from gliderhpc.analysis.currents.depth_bins import bin_count
from gliderhpc.analysis.currents.figure_7 import figure_7
from gliderhpc.analysis.currents.profile_currents import Beliefs, profile_currents
from gliderhpc.analysis.currents.reference_table import reference_rows
from gliderhpc.analysis.currents.settings import DepthResolvedSettings
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.analysis.provenance import provenance_of
from gliderhpc.analysis.study import (
    Request,
    Study,
    archive_findings,
    begin_study,
    choose,
    conclude_study,
    nothing_missing,
    own_assignments,
    provenance,
)
from gliderhpc.analysis.twin.budget import read_budget
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import Platform

NAME = "currents"
DRAWN = 3
"""Profiles that get a figure."""

PAPER_COEFFICIENT_SHARE, PAPER_ABSOLUTE_SHARE = 0.30, 0.015
"""Effect of 15 % on the moment coefficients on shear and on the absolute current, by the paper."""


@dataclass(frozen=True)
class CurrentsJob:
    """One profile to study."""

    number: int
    index: int
    estimate: str
    settings: DepthResolvedSettings
    beliefs: Beliefs
    bins: int
    reference: Path | None


def study_profile(archive: xr.DataTree, job: CurrentsJob) -> StudiedProfile:
    """Study one profile: its records, bins and row; the job of a worker."""
    data = read_profile_data(archive, job.number, job.estimate)
    found = profile_currents(archive, data, job.settings, job.beliefs, job.bins)
    row, bins = found.row, found.bins
    if job.reference is not None:
        more, by_depth = beside_reference(data, opened(job.reference), row, bins, job.settings, job.bins)
        row, bins = {**row, **more}, {**bins, **by_depth}
    return StudiedProfile(job.number, job.index, row, rows={**found.records, **bins})


def run(request: Request) -> Findings:
    """Study the chosen profiles, into the archive's group ``currents``.

    Raises
    ------
    InputError
        No such profile is done, the budget or the reference is none, or a setting is wrong.
    """
    if request.reference is not None:
        opened(request.reference)
    settings = build_settings_of(DepthResolvedSettings, {}, own_assignments(request, NAME))
    with open_for_reading(request.archive) as archive:
        chosen, platform = choose(archive, request), platform_of(archive)
        beliefs, remarks = _beliefs(request, archive, platform)
        deepest = float(archive["max_depth"].sel(profile=list(chosen.numbers)).max())
    bins = bin_count(deepest, settings.bin)
    jobs = [
        CurrentsJob(number, chosen.where[number], request.estimate, settings, beliefs, bins, request.reference)
        for number in chosen.numbers
    ]
    remarks += chosen.remarks + begin_study(request, NAME, {"bin": bins})
    rows = {result.number: result.row for result in study_profiles(request, NAME, study_profile, jobs)}
    made = provenance(request, rows, settings.model_dump(), remarks)
    return conclude_study(request.archive, STUDY, made, {"errors": beliefs.current.model_dump()})


def _beliefs(request: Request, archive: xr.DataTree, platform: Platform) -> tuple[Beliefs, tuple[str, ...]]:
    """Terms of the uncertainty: the budget's where there is one, else those that the mission was run with."""
    if request.budget is None:
        return Beliefs(settings_of(archive).current.errors(platform), float("nan")), (
            f"no --budget given: the ellipses are the run's own ({_origin(platform)}), and the yaw moment's noise "
            "floor is not known; `gliderhpc twin recoverability` and then `twin currents` measure both for a hull",
        )
    budget = read_budget(request.budget)
    remarks: tuple[str, ...] = ()
    if budget.platform != platform.name:
        remarks = (f"{request.budget}: was measured for {budget.platform}, this mission flew {platform.name}",)
    return Beliefs(budget.current, budget.identification_noise), remarks


def _origin(platform: Platform) -> str:
    return "the publication's terms" if platform.calibration is None else "terms measured with calibrated hulls"


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    settings = DepthResolvedSettings.model_validate(made.settings)
    refused, retrieved = failed_profiles(table)
    remarks = made.remarks
    if refused:
        remarks = (*remarks, f"{len(refused)} of {len(table)} profiles: {next(iter(refused.values()))}")
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "settings": settings.model_dump(),
        "medians": column_medians(table),
    }
    drawn = {f"figure_7_profile_{number}": number for number in retrieved["profile"][:DRAWN].tolist()}
    figures = {
        stem: figure_7(archive, read_profile_data(archive, number, made.estimate), settings)
        for stem, number in drawn.items()
    }
    return archive_findings(
        NAME, _comparisons(table), {"currents": table}, figures, facts, {}, remarks,
        captions=captions(made, table, settings, drawn),
    )  # fmt: skip


def _comparisons(table: pd.DataFrame) -> tuple[Comparison, ...]:
    def median(name: str) -> float:
        return float(table[name].median()) if name in table and table[name].notna().any() else float("nan")

    return (
        Comparison("speed of the depth-averaged current, median", "m/s", median("speed"), (0.04, 0.42)),
        Comparison("longer semi-axis of the 1-sigma ellipse, median", "m/s", median("ellipse_major")),
        Comparison("shorter semi-axis of the 1-sigma ellipse, median", "m/s", median("ellipse_minor")),
        Comparison(
            "lateral current, root mean square, median", "m/s", median("shear_rms"),
            remark="shear-sensitive part, a lower bound: the hull follows slow changes",
        ),
        Comparison(
            "its scatter under 15 % on the moment coefficients", "1", median("coefficient_share"),
            PAPER_COEFFICIENT_SHARE,
        ),
        Comparison(
            "the same over the absolute current", "1", median("coefficient_share_absolute"), PAPER_ABSOLUTE_SHARE,
            paper_said="< 0.015",
        ),
        Comparison("share of records beyond twice the noise floor", "1", median("significant_fraction")),
        Comparison("share of the steady glide with a lateral current", "1", median("retrieved_fraction")),
        *reference_rows(table),
    )  # fmt: skip


STUDY = Study(
    NAME, "depth-averaged and depth-resolved currents with their uncertainty", show, nothing_missing, run
)  # fmt: skip
