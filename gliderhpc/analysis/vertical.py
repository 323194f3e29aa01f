"""Study ``vertical``: the vertical velocity of the water, and how far it is a matter of the hull's numbers.

The model is the hull's steady glide at the measured attitude and ballast in still water, as the community has it
(Merckelbach et al. 2010, 2019; Frajka-Williams et al. 2011), and not the reconstructed motion, whose disturbances have
taken up what the water did.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.analysis.archived import (
    chosen_profiles,
    column_medians,
    failed_profiles,
    platform_of,
    positions,
    study_table,
)
from gliderhpc.analysis.captions import data_said
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.profile_jobs import StudiedProfile, study_profiles
from gliderhpc.analysis.provenance import Provenance, provenance_of
from gliderhpc.analysis.study import Request, Study, archive_findings, begin_study, conclude_study, provenance
from gliderhpc.analysis.vertical_figure import vertical_figure
from gliderhpc.analysis.vertical_profile import LEVELS, difference_row, legs_row, record_rows, truth_row
from gliderhpc.analysis.vertical_table import comparisons, remarks_on
from gliderhpc.analysis.vertical_velocity import HullErrors, hull_errors, vertical_velocity
from gliderhpc.errors import InputError
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import ADJOINT, goes_by_density, read_profile_data
from gliderhpc.observations.synthetic import read_profile_truth

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


def run(request: Request) -> Findings:
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
    return conclude_study(request.archive, STUDY, provenance(request, rows, None, remarks, ("elapsed_days",)))


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made, table = provenance_of(archive, NAME), study_table(archive, NAME)
    failed, known = failed_profiles(table)
    by_density = any(goes_by_density(archive, number) for number in made.profiles)
    errors = hull_errors(platform_of(archive), by_density=by_density)
    facts = {
        "profiles": list(made.profiles),
        "quick": made.quick,
        "hull_errors": "of the calibration" if errors.calibrated else "plausible deviations",
        "medians": column_medians(known),
    }
    return archive_findings(
        NAME, comparisons(known, errors), {"profiles": table}, {"vertical": vertical_figure(archive, known)}, facts,
        failed, made.remarks + remarks_on(known, errors),
        captions=_captions(made, known, errors, by_density=by_density),
    )  # fmt: skip


def _captions(made: Provenance, known: pd.DataFrame, errors: HullErrors, *, by_density: bool) -> dict[str, str]:
    """Say what figure and table are made from, and how far either is the hull's."""
    data = data_said(made, known["profile"].tolist())
    buoyancy = "by measured density" if by_density else "by its depth slope"
    window, share = float(known["window"].median()), float(known["share"].median())
    whose = "as its calibration states them" if errors.calibrated else "plausible ones, as no calibration states them"
    deviations = [float(known[name].median()) for name in ("mean_std_dive", "mean_std_climb") if name in known]
    sure = (
        f"Deviations hold the depth sensor's noise, rounded pitch and errors of the hull's numbers ({whose}): the "
        f"latter shift the mean of a leg by {100.0 * max(deviations, default=float('nan')):.2g} cm/s (median)."
    )
    return {
        "vertical": (
            f"Vertical velocity of the water: measured depth rate less that of the hull's glide in still water, its "
            f"buoyancy {buoyancy}, over windows of {window:.0f} s. Panels (a) and (b): profile "
            f"{int(known['profile'].iloc[0])}; (c) and (d): {data}. {sure}"
        ),
        "profiles": (
            f"A row a profile: {data}; {share:.0%} of the samples have a velocity (median), the others lie in the "
            f"vibration set, in gaps or near the surface. Dives less climbs are taken at the same {LEVELS} levels, and "
            f"water that is the same on both leaves nothing. {sure}"
        ),
    }


STUDY = Study(NAME, "vertical velocity of the water, and what it owes to the hull's numbers", show, missing_input, run)
"""What the registry finds."""
