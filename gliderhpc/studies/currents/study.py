"""The study over a mission: a job a profile, the archive's group, the table beside the paper's figures, Figure 7."""

from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.estimation.current_budget import read_budget
from gliderhpc.mission.settings import build_settings_of
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.currents.beside_reference import beside_reference, opened
from gliderhpc.studies.currents.depth_bins import bin_count
from gliderhpc.studies.currents.profile_currents import Beliefs, profile_currents
from gliderhpc.studies.currents.settings import DepthResolvedSettings
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.study import (
    Request,
    Study,
    begin_study,
    choose,
    finish_study_group,
    nothing_missing,
    own_assignments,
    provenance,
)

NAME = "currents"


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


def run(request: Request) -> None:
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
    finish_study_group(request.archive, NAME, made, {"errors": beliefs.current.model_dump()})


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


STUDY = Study(
    NAME, "depth-averaged and depth-resolved currents with their uncertainty", nothing_missing, run
)  # fmt: skip
