"""Study ``reanalysis``: the depth-averaged current beside ocean models sampled along the same dive (section 5.5).

Workers take runs of profiles: each opens the models once and reads, profile by profile, the box around the track.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from threadpoolctl import threadpool_limits

from gliderhpc.analysis.archived import as_cells, failed_profiles, mission_of
from gliderhpc.analysis.ellipses import Current, archived_currents, studied
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.provenance import Provenance, kept, provenance_of
from gliderhpc.analysis.reanalysis.agreement import agreement_rows, agreements, comparisons
from gliderhpc.analysis.reanalysis.beside_models import COUNTS, row_of
from gliderhpc.analysis.reanalysis.captions import captions
from gliderhpc.analysis.reanalysis.compared import compare
from gliderhpc.analysis.reanalysis.figure_8 import figure_8
from gliderhpc.analysis.reanalysis.ocean_model import OceanModel, expanded, open_models
from gliderhpc.analysis.reanalysis.table_4 import table_4, table_4_text
from gliderhpc.analysis.study import (
    Request,
    Study,
    archive_findings,
    begin_study,
    choose,
    conclude_study,
    provenance,
)
from gliderhpc.mission.archive import open_for_reading
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.store_schema import write_table_rows

NAME = "reanalysis"

RUNS = 4
"""Runs of profiles a worker takes: few, because each opens every file of every model."""

Rows = dict[int, dict[str, Any]]

_WITHOUT_STUDY = (
    "the ellipses are those of the mission's run; after `gliderhpc analyze ARCHIVE currents --budget` those of that "
    "study are taken"
)

_OTHER_ELLIPSES = (
    "the ellipses are drawn by the study currents as it stands, the distances were found before it was run; run "
    "reanalysis again"
)


@dataclass(frozen=True)
class ReanalysisJob:
    """A run of profiles, with their currents, to put beside the models."""

    currents: Mapping[int, Current]
    archive: str
    sources: tuple[str, ...]
    estimate: str


def study_profiles(job: ReanalysisJob) -> Rows:
    """Put a run of profiles beside the models, a row a profile by its number; the job of a worker."""
    with threadpool_limits(limits=1), open_for_reading(job.archive) as archive, open_models(job.sources) as models:
        return {
            number: row_of(archive, read_profile_data(archive, number, job.estimate), current, models)
            for number, current in job.currents.items()
        }


def missing_input(request: Request) -> str | None:
    """Say what is lacking: a model."""
    return None if request.models else "needs --model FILE_OR_URL, an ocean model's file (repeatable)"


def run(request: Request) -> Findings:
    """Study the chosen profiles and leave one row each in the archive's group ``reanalysis``.

    Raises
    ------
    InputError
        No such profile is done, or a model cannot be read.
    """
    sources = tuple(path for source in request.models for path in expanded(source))
    with open_models(sources) as models:
        names = tuple(model.name for model in models)
        files = {model.name: model.labels for model in models}
        remarks = tuple(remark for model in models for remark in _about(model))
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request)
        own = archived_currents(archive, chosen.numbers, request.estimate)
        by_study = studied(archive, request.estimate)
    remarks += chosen.remarks + (() if by_study else (_WITHOUT_STUDY,))
    remarks += begin_study(request, NAME, labels={"model": names})
    rows = _rows(request, dict(zip(chosen.numbers, own, strict=True)), sources)
    write_table_rows(request.archive, {chosen.where[number]: row for number, row in rows.items()}, NAME)
    made = provenance(request, rows, None, remarks)
    return conclude_study(request.archive, STUDY, made, {"models": files, "ellipses_of_study": by_study})


def _rows(request: Request, currents: Mapping[int, Current], sources: tuple[str, ...]) -> Rows:
    rows: Rows = {}
    with request.executor() as opened:
        runs = np.array_split(np.array(list(currents)), min(len(currents), RUNS * opened.workers))
        jobs = [
            ReanalysisJob(
                {int(number): currents[int(number)] for number in run}, request.path, sources, request.estimate
            )
            for run in runs
        ]
        for found in opened.run(study_profiles, jobs):
            rows |= found
            for number in found:
                request.report(number)
    return dict(sorted(rows.items()))


def show(archive: xr.DataTree) -> Findings:
    """Show the study of an archive."""
    made = provenance_of(archive, NAME)
    compared = compare(archive, made.profiles, made.estimate)
    found, places = agreements(compared), compared.panels()
    table = _by_model(archive, made)
    agreement, nine = agreement_rows(compared, found), table_4(compared, places)
    facts = {
        "profiles": list(made.profiles),
        "estimate": made.estimate,
        "quick": made.quick,
        "models": kept(archive, NAME, "models"),
        "agreement": agreement,
    }
    by_study = studied(archive, made.estimate)
    other = () if by_study == kept(archive, NAME, "ellipses_of_study") else (_OTHER_ELLIPSES,)
    findings = archive_findings(
        NAME, comparisons(compared, found),
        {"table_4": pd.DataFrame(nine), "agreement": pd.DataFrame(agreement), "profiles": table},
        {"figure_8": figure_8(compared, places, mission_of(archive))} if places else {}, facts, {},
        (*made.remarks, *other, *_left_out(table)), captions=captions(made, compared, places, by_study=by_study),
    )  # fmt: skip
    return replace(findings, documents={"table_4.md": table_4_text(nine)})


def _by_model(archive: xr.DataTree, made: Provenance) -> pd.DataFrame:
    """One line a profile and model."""
    group = archive[NAME].to_dataset().sel(profile=list(made.profiles)).load()
    names = [str(name) for name in group["model"].values]
    shape = (len(made.profiles), len(names))
    columns = {"profile": np.array(made.profiles)[:, None], "model": np.array(names, dtype=object)[None]}
    columns |= {name: as_cells(group[name].values).reshape(len(made.profiles), -1) for name in made.columns[1:]}
    return pd.DataFrame({name: np.broadcast_to(values, shape).ravel() for name, values in columns.items()})


def _about(model: OceanModel) -> list[str]:
    if not model.daily_at_midnight:
        return []
    return [
        f"{model.name}: its daily fields are labelled 00:00 and taken as of that instant; where they are the mean of "
        "the day that begins there, they are used half a day early"
    ]


def _left_out(table: pd.DataFrame) -> list[str]:
    """Say for how many profiles each model has no value, and of what most of their records lie outside."""
    failed, sampled = failed_profiles(table)
    remarks = [f"profile {number}: {message}" for number, message in failed.items()]
    for name in dict.fromkeys(sampled["model"]):
        own = sampled[sampled["model"] == name]
        without = own[own["north"].isna()]
        if len(without):
            # Why a model says nothing at most of the records at which it says nothing.
            reasons = without[list(COUNTS.values())].idxmax(axis=1).tolist()
            told = ", ".join(
                f"{reason.replace('_', ' ')} {reasons.count(reason)}" for reason in COUNTS.values() if reason in reasons
            )
            remarks.append(f"{name} has no value for {len(without)} of {len(own)} profiles: {told}")
    return remarks


STUDY = Study(NAME, "the depth-averaged current beside ocean models", show, missing_input, run)
"""What the registry finds."""
