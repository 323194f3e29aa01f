"""Study ``reconstruction``: how the estimated motion follows the records (sections 5.1.1, 5.2, Table 2, Figures 2, 3).

Everything but the inversion with ``k_z = 0`` comes from the archive alone; that one needs the observation file, and is
left out with a remark where it is not given. A synthetic mission's truth adds lag and attenuation of both estimators.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import ADJOINT, goes_by_density, read_profile_data
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import Survey, open_observations
from gliderhpc.observations.truth import most_impulses, read_profile_truth
from gliderhpc.platform import Platform
from gliderhpc.store_schema import write_table_rows
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.profile_reconstruction import (
    cost_row,
    motions_of,
    open_loop_row,
    self_motion_row,
    tracking_row,
    vibration_row,
)
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.reconstruction.estimator_comparison import regime_row
from gliderhpc.studies.reconstruction.truth import (
    TRUE_YAW,
    estimators,
    true_yaw,
    truth_columns,
)
from gliderhpc.studies.reconstruction.without_depth_slope import without_depth_slope_row
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, nothing_missing, provenance
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    pass

NAME = "reconstruction"


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
    impulses: int
    estimate: str


@dataclass(frozen=True)
class ReconstructionResult(StudiedProfile):
    """The profile's row of the group's table, and what the truth tells of the estimators."""

    against_truth: Mapping[str, Any]


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
        return ReconstructionResult(job.number, job.index, row, {})
    truth = read_profile_truth(job.truth, job.number)
    columns, yaw = truth_columns(data, truth, job.impulses), {TRUE_YAW: true_yaw(data, truth)}
    return ReconstructionResult(job.number, job.index, row, columns, rows=yaw)


def run(request: Request) -> None:
    """Study the chosen profiles and leave one row each in the archive's group ``reconstruction``.

    Raises
    ------
    InputError
        No such profile is done, or the observation file or the truth is not the archive's.
    """
    with open_for_reading(request.archive) as archive:
        chosen, platform = choose(archive, request), platform_of(archive)
        sources, remarks = _sources(request, archive, platform, chosen.numbers)
    truth = None if request.truth is None else str(request.truth.resolve())
    # An axis has one place at least, whether or not there was an impulse.
    impulses = 1 if truth is None else max(1, most_impulses(truth))
    jobs = [
        ReconstructionJob(
            number, chosen.where[number], sources.get(number), truth, impulses, request.estimate
        )
        for number in chosen.numbers
    ]  # fmt: skip
    labels = {"channel": list(CHANNELS), "estimator": estimators(request.estimate)}
    remarks += chosen.remarks + begin_study(request, NAME, {"impulse": impulses}, labels)
    results = study_profiles(request, NAME, study_profile, jobs)
    write_table_rows(request.archive, {result.index: result.against_truth for result in results}, NAME)
    made = provenance(request, {result.number: result.row for result in results}, None, remarks)
    finish_study_group(request.archive, NAME, made, {"with_truth": truth is not None})


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


STUDY = Study(NAME, "how the estimated motion follows the records; filter against adjoint", nothing_missing, run)
"""What the registry finds."""
