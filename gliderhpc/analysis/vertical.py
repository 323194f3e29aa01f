"""Study ``vertical``: the vertical velocity of the water, and how far it is a matter of the hull's numbers.

The model is the hull's steady glide at the measured attitude and ballast in still water, as the community has it
(Merckelbach et al. 2010, 2019; Frajka-Williams et al. 2011), and not the reconstructed motion, whose disturbances have
taken up what the water did.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import chosen_profiles, platform_of, positions
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.study import Request, StudiedProfile, Study, archive_findings, begin_study, study_profiles
from gliderhpc.analysis.vertical_figure import vertical_figure
from gliderhpc.analysis.vertical_profile import difference_row, legs_row, record_rows, truth_row
from gliderhpc.analysis.vertical_table import comparisons, remarks_on
from gliderhpc.analysis.vertical_velocity import HullErrors, hull_errors, vertical_velocity
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_mission
from gliderhpc.mission.profile_data import ADJOINT, goes_by_density, read_profile_data
from gliderhpc.observations.synthetic import read_profile_truth
from gliderhpc.store_schema import finish_study

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
    with open_mission(request.archive) as archive:
        if "sampled" in archive["observed"].to_dataset():
            return None
    return "the archive does not tell samples from what was interpolated between them; run the mission anew"


def run(request: Request) -> Findings:
    """Study the chosen profiles and leave velocities and one row each in the archive's group ``vertical``.

    Raises
    ------
    InputError
        No such profile is done, or none has a vertical velocity.
    """
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        where = positions(archive)
        by_density = any(goes_by_density(archive, number) for number in numbers)
        errors = hull_errors(platform_of(archive), by_density=by_density)
        days = archive.to_dataset()["elapsed_days"].sel(profile=list(numbers)).values
    truth = None if request.truth is None else str(request.truth.resolve())
    jobs = [VerticalJob(number, where[number], truth) for number in numbers]
    remarks = begin_study(request, NAME)
    if request.estimate != ADJOINT:
        remarks = (*remarks, "no estimate enters this study, so --estimate changes nothing")
    results = study_profiles(request, NAME, study_profile, jobs)
    table = pd.DataFrame(
        [{"profile": r.number, "elapsed_days": day, **r.row} for r, day in zip(results, days, strict=True)]
    )
    return _conclude(request, table, errors, remarks)


def _conclude(request: Request, table: pd.DataFrame, errors: HullErrors, remarks: tuple[str, ...]) -> Findings:
    """Put the table, the figure and the facts together, and close the group."""
    messages = table["message"] if "message" in table else pd.Series(np.nan, index=table.index)
    failed = {int(n): str(text) for n, text in zip(table["profile"], messages, strict=True) if isinstance(text, str)}
    known = table[[not isinstance(text, str) for text in messages]]
    if known.empty:
        raise InputError(f"{request.archive}: {next(iter(failed.values()))}, in any profile")
    rows = comparisons(known, errors)
    facts = {
        "profiles": table["profile"].tolist(),
        "quick": request.quick,
        "hull_errors": "of the calibration" if errors.calibrated else "plausible deviations",
        "medians": as_plain(known.drop(columns=["profile", "elapsed_days"]).median(numeric_only=True).to_dict()),
    }
    finish_study(request.archive, NAME, {**facts, "comparisons": as_plain(comparisons_as_json(rows))})
    with open_mission(request.archive) as archive:
        figure = vertical_figure(archive, known)
    return archive_findings(
        NAME, rows, {"profiles": table}, {"vertical": figure}, facts, failed, remarks + remarks_on(known, errors)
    )


STUDY = Study(NAME, "vertical velocity of the water, and what it owes to the hull's numbers", missing_input, run)
"""What the registry finds."""
