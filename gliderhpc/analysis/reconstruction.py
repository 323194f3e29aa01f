"""Study ``reconstruction``: how the estimated motion follows the records (sections 5.1.1, 5.2, Table 2, Figures 2, 3).

Everything but the inversion with ``k_z = 0`` comes from the archive alone; that one needs the observation file, and is
left out with a remark where it is not given. A synthetic mission's truth adds lag and attenuation of both estimators.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, platform_of, positions, settings_of
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.estimator_comparison import impulse_rows, regime_row, truth_rows
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_reconstruction import (
    cost_row,
    motions_of,
    open_loop_row,
    self_motion_row,
    tracking_row,
    vibration_row,
)
from gliderhpc.analysis.reconstruction_figures import figure_2, figure_3, recovery_figure
from gliderhpc.analysis.reconstruction_table import comparisons
from gliderhpc.analysis.study import Request, StudiedProfile, Study, archive_findings, begin_study, study_profiles
from gliderhpc.analysis.without_depth_slope import without_depth_slope_row
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import ADJOINT, goes_by_density, read_profile_data
from gliderhpc.observations import Survey, open_observations
from gliderhpc.observations.synthetic import read_profile_truth
from gliderhpc.platform import Platform
from gliderhpc.store_schema import finish_study

NAME = "reconstruction"
FIGURE_3_PROFILES = 3


@dataclass(frozen=True)
class Source:
    """Where a profile's record lies, for the inversion with ``k_z = 0``."""

    path: str
    survey: Survey


@dataclass(frozen=True)
class ReconstructionJob:
    """One profile to study."""

    number: int
    index: int
    source: Source | None
    truth: str | None
    estimate: str


@dataclass(frozen=True)
class ReconstructionResult(StudiedProfile):
    """The profile's row of the group's table, and its rows against the truth."""

    channels: list[dict[str, Any]]
    impulses: list[dict[str, Any]]


def study_profile(archive: xr.DataTree, job: ReconstructionJob) -> ReconstructionResult:
    """Study one profile; the job of a worker."""
    platform = platform_of(archive)
    data = read_profile_data(archive, job.number, job.estimate)
    motions = motions_of(data, platform)
    row: dict[str, Any] = {
        **tracking_row(data),
        **open_loop_row(data, Glider(platform)),
        **self_motion_row(data, motions),
        **vibration_row(data),
        **cost_row(archive, data),
        **regime_row(data),
    }
    if job.source is not None:
        with open_observations(job.source.path, survey=job.source.survey) as observations:
            try:
                record = observations.profile(job.number)
                row |= without_depth_slope_row(data, motions.estimate, record, platform, settings_of(archive))
            except ProfileError as error:
                row["message"] = f"not inverted with k_z = 0: {error}"
    if job.truth is None:
        return ReconstructionResult(job.number, job.index, row, [], [])
    truth = read_profile_truth(job.truth, job.number)
    return ReconstructionResult(job.number, job.index, row, truth_rows(data, truth), impulse_rows(data, truth))


def missing_input(request: Request) -> str | None:
    """Say what is lacking: nothing ever is, since the archive alone makes a study."""
    return None


def run(request: Request) -> Findings:
    """Study the chosen profiles and leave one row each in the archive's group ``reconstruction``.

    Raises
    ------
    InputError
        No such profile is done, or the observation file or the truth is not the archive's.
    """
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        platform = platform_of(archive)
        sources, remarks = _sources(request, archive, platform, numbers)
        remarks += about_the_estimate(archive, request.estimate, numbers)
        where = positions(archive)
    jobs = [
        ReconstructionJob(
            number, where[number], sources.get(number),
            None if request.truth is None else str(request.truth.resolve()), request.estimate,
        )
        for number in numbers
    ]  # fmt: skip
    remarks += begin_study(request, NAME)
    results = study_profiles(request, NAME, study_profile, jobs)
    return _conclude(request, results, platform, remarks)


def _sources(
    request: Request, archive: xr.DataTree, platform: Platform, numbers: tuple[int, ...]
) -> tuple[dict[int, Source], tuple[str, ...]]:
    """Where the profiles' records lie, those that are to be inverted with k_z = 0, and why others are not."""
    if request.estimate != ADJOINT:
        return {}, ("the inversion with k_z = 0 is held against the adjoint, so there is none here",)
    if platform.buoyancy.depth_slope == 0.0:
        return {}, ("the hull's k_z is zero already, so there is no second inversion",)
    by_slope = tuple(number for number in numbers if not goes_by_density(archive, number))
    remarks = () if by_slope == numbers else (
        "where the buoyancy goes by measured density there is no inversion with k_z = 0, for k_z compensates nothing",
    )  # fmt: skip
    if not by_slope:
        return {}, remarks
    if request.observations is None:
        return {}, ("no --observations given: the inversion with k_z = 0 and the filter's time are left out",)
    with open_observations(request.observations) as opened:
        if opened.digest() != archive.attrs.get("observations_digest"):
            raise InputError(
                f"{request.observations}: is not the file that the archive was made from "
                f"({archive.attrs.get('observations')})"
            )
        path = str(Path(request.observations).resolve())
        chosen = by_slope[:1] if request.quick else by_slope
        return {number: Source(path, opened.survey.only([number])) for number in chosen}, remarks


def _conclude(
    request: Request, results: list[ReconstructionResult], platform: Platform, remarks: tuple[str, ...]
) -> Findings:
    """Put the table, the figures and the facts together, and close the group."""
    table = pd.DataFrame([{"profile": result.number, **result.row} for result in results])
    channels = pd.DataFrame([row for result in results for row in result.channels])
    impulses = pd.DataFrame([row for result in results for row in result.impulses])
    if f"open_loop_{request.estimate}_roll" not in table:
        remarks = (*remarks, "no profile has 600 s of steady glide on end: there is no open-loop comparison")
    tables = {"profiles": table}
    if request.truth is not None:
        tables |= {"channels": channels, "impulses": impulses}
    numbers = table["profile"].tolist()
    rows = comparisons(table, channels, impulses, platform, request.estimate)
    facts = {
        "profiles": numbers,
        "estimate": request.estimate,
        "quick": request.quick,
        "medians": as_plain(table.drop(columns="profile").median(numeric_only=True).to_dict()),
    }
    finish_study(request.archive, NAME, {**facts, "comparisons": as_plain(comparisons_as_json(rows))})
    messages = table["message"] if "message" in table else pd.Series(np.nan, index=table.index)
    failed = {
        int(number): str(text) for number, text in zip(table["profile"], messages, strict=True) if isinstance(text, str)
    }
    figures = _figures(request, platform, numbers, channels, impulses)
    return archive_findings(NAME, rows, tables, figures, facts, failed, remarks)


def _figures(
    request: Request, platform: Platform, numbers: list[int], channels: pd.DataFrame, impulses: pd.DataFrame
) -> dict[str, Figure]:
    with open_mission(request.archive) as archive:
        figures = {
            "figure_2": figure_2(archive, numbers[0], platform, request.estimate),
            "figure_3": figure_3(archive, numbers[:FIGURE_3_PROFILES], request.truth, request.estimate),
        }
    if not channels.empty:
        figures["recovery"] = recovery_figure(channels, impulses, request.estimate)
    return figures


STUDY = Study(NAME, "how the estimated motion follows the records; filter against adjoint", missing_input, run)
"""What the registry finds."""
