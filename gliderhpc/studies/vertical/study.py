"""Study ``vertical``: the vertical velocity of the water, and how far it is a matter of the hull's numbers.

The model is the hull's steady glide at the measured attitude and ballast in still water, as the community has it
(Merckelbach et al. 2010, 2019; Frajka-Williams et al. 2011), and not the reconstructed motion, whose disturbances have
taken up what the water did.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import ADJOINT, read_profile_data
from gliderhpc.errors import InputError
from gliderhpc.observations.truth import read_profile_truth
from gliderhpc.studies.archived import (
    chosen_profiles,
    platform_of,
    positions,
)
from gliderhpc.studies.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.studies.study import Request, Study, begin_study, finish_study_group, provenance
from gliderhpc.studies.vertical.profile import difference_row, legs_row, record_rows, truth_row
from gliderhpc.studies.vertical.velocity import vertical_velocity

NAME = "vertical"


@dataclass(frozen=True)
class VerticalJob:
    """One profile to study."""

    number: int
    index: int
    truth: str | None


def study_profile(archive: xr.DataTree, job: VerticalJob) -> StudiedProfile:
    """Study one profile: its records and row; the job of a worker."""
    data = read_profile_data(archive, job.number)
    found = vertical_velocity(data, platform_of(archive))
    if not np.isfinite(found.water).any():
        return StudiedProfile(job.number, job.index, {"message": _without(found.filter.window)})
    row = legs_row(found) | difference_row(found)
    if job.truth is not None:
        row |= truth_row(data, found, read_profile_truth(job.truth, job.number))
    return StudiedProfile(job.number, job.index, row, rows=record_rows(data, found))


def _without(window: float) -> str:
    return f"no {window:.0f} s on end of samples in steady glide, so there is no vertical velocity"


def missing_input(request: Request) -> str | None:
    """Say what is lacking: an archive that tells its samples from what was interpolated between them."""
    with open_for_reading(request.archive) as archive:
        if "sampled" in archive["observed"].to_dataset():
            return None
    return "the archive does not tell samples from what was interpolated between them; run the mission anew"


def run(request: Request) -> None:
    """Study the chosen profiles and leave velocities and one row each in the archive's group ``vertical``.

    Raises
    ------
    InputError
        No such profile is done, or none has a vertical velocity.
    """
    with open_for_reading(request.archive) as archive:
        numbers, where = chosen_profiles(archive, request.profiles, request.quick), positions(archive)
    truth = None if request.truth is None else str(request.truth.resolve())
    jobs = [VerticalJob(number, where[number], truth) for number in numbers]
    remarks = begin_study(request, NAME)
    if request.estimate != ADJOINT:
        remarks = (*remarks, "no estimate enters this study, so --estimate changes nothing")
    rows = {result.number: result.row for result in study_profiles(request, NAME, study_profile, jobs)}
    if all("message" in row for row in rows.values()):
        raise InputError(f"{request.archive}: {next(iter(rows.values()))['message']}, in any profile")
    finish_study_group(request.archive, NAME, provenance(request, rows, None, remarks, ("elapsed_days",)))


STUDY = Study(NAME, "vertical velocity of the water, and what it owes to the hull's numbers", missing_input, run)
"""What the registry finds."""
