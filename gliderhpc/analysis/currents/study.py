"""The study over a mission: a job a profile, the archive's group, the table beside the paper's figures, Figure 7."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, positions, settings_of
from gliderhpc.analysis.comparison import Comparison, comparisons_as_json
from gliderhpc.analysis.currents.beside_reference import beside_reference, opened
from gliderhpc.analysis.currents.depth_bins import bin_count
from gliderhpc.analysis.currents.figure_7 import figure_7
from gliderhpc.analysis.currents.profile_currents import Beliefs, profile_currents
from gliderhpc.analysis.currents.reference_table import reference_rows
from gliderhpc.analysis.currents.settings import DepthResolvedSettings
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.study import (
    Request,
    StudiedProfile,
    Study,
    archive_findings,
    begin_study,
    own_assignments,
    study_profiles,
)
from gliderhpc.analysis.twin.budget import read_budget
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import Platform
from gliderhpc.store_schema import finish_study

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
    found = profile_currents(data, platform_of(archive), job.settings, job.beliefs, job.bins)
    row, bins = found.row, found.bins
    if job.reference is not None:
        more, by_depth = beside_reference(data, opened(job.reference), row, bins, job.settings, job.bins)
        row, bins = {**row, **more}, {**bins, **by_depth}
    return StudiedProfile(job.number, job.index, row, rows={**found.records, **bins})


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is, since the archive alone makes a study."""
    return None


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
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        platform = platform_of(archive)
        beliefs, remarks = _beliefs(request, archive, platform)
        remarks += about_the_estimate(archive, request.estimate, numbers)
        bins = bin_count(float(archive["max_depth"].sel(profile=list(numbers)).max()), settings.bin)
        where = positions(archive)
    jobs = [
        CurrentsJob(number, where[number], request.estimate, settings, beliefs, bins, request.reference)
        for number in numbers
    ]
    remarks += begin_study(request, NAME, {"bin": bins})
    results = study_profiles(request, NAME, study_profile, jobs)
    return _conclude(request, results, settings, remarks)


def _beliefs(request: Request, archive: xr.DataTree, platform: Platform) -> tuple[Beliefs, tuple[str, ...]]:
    """Terms of the uncertainty: the budget's where there is one, else those that the mission was run with."""
    if request.budget is None:
        return Beliefs(settings_of(archive).current, float("nan")), (
            "no --budget given: the ellipses are made with the paper's constants, and the yaw moment's noise floor is "
            "not known; `gliderhpc twin recoverability` and then `twin currents` measure both for a hull",
        )
    budget = read_budget(request.budget)
    remarks: tuple[str, ...] = ()
    if budget.platform != platform.name:
        remarks = (f"{request.budget}: was measured for {budget.platform}, this mission flew {platform.name}",)
    return Beliefs(budget.current, budget.identification_noise), remarks


def _conclude(
    request: Request, results: list[StudiedProfile], settings: DepthResolvedSettings, remarks: tuple[str, ...]
) -> Findings:
    table = pd.DataFrame([{"profile": result.number, **result.row} for result in results])
    refused = table["message"].dropna() if "message" in table else pd.Series(dtype=object)
    if len(refused):
        remarks = (*remarks, f"{len(refused)} of {len(table)} profiles: {refused.iloc[0]}")
    rows = _comparisons(table)
    facts = {
        "profiles": table["profile"].tolist(),
        "estimate": request.estimate,
        "quick": request.quick,
        "settings": settings.model_dump(),
        "medians": as_plain(table.drop(columns="profile").median(numeric_only=True).to_dict()),
    }
    finish_study(request.archive, NAME, {**facts, "comparisons": as_plain(comparisons_as_json(rows))})
    return archive_findings(NAME, rows, {"currents": table}, _figures(request, results, settings), facts, {}, remarks)


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


def _figures(request: Request, results: list[StudiedProfile], settings: DepthResolvedSettings) -> dict[str, Figure]:
    drawn = [result.number for result in results if "shear_rms" in result.row][:DRAWN]
    with open_mission(request.archive) as archive:
        return {
            f"figure_7_profile_{number}": figure_7(
                archive, read_profile_data(archive, number, request.estimate), settings
            )
            for number in drawn
        }


STUDY = Study(NAME, "depth-averaged and depth-resolved currents with their uncertainty", missing_input, run)
