"""Study ``reanalysis``: the depth-averaged current beside ocean models sampled along the same dive (section 5.5).

Workers take runs of profiles: each opens the models once and reads, profile by profile, the box around the track.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from gliderhpc.analysis.archived import about_the_estimate, chosen_profiles, positions
from gliderhpc.analysis.comparison import comparisons_as_json
from gliderhpc.analysis.ellipses import Current, archived_currents, studied
from gliderhpc.analysis.files import as_plain
from gliderhpc.analysis.findings import Findings
from gliderhpc.analysis.reanalysis.agreement import agreement_rows, agreements, comparisons
from gliderhpc.analysis.reanalysis.beside_models import COUNTS, row_of
from gliderhpc.analysis.reanalysis.compared import Compared, compare
from gliderhpc.analysis.reanalysis.figure_8 import figure_8
from gliderhpc.analysis.reanalysis.ocean_model import OceanModel, expanded, open_models
from gliderhpc.analysis.reanalysis.table_4 import table_4, table_4_text
from gliderhpc.analysis.study import Request, Study, archive_findings, begin_study
from gliderhpc.mission.archive import open_for_reading, open_mission
from gliderhpc.mission.profile_data import read_profile_data
from gliderhpc.store_schema import finish_study, write_table_rows

NAME = "reanalysis"

RUNS = 4
"""Runs of profiles a worker takes: few, because each opens every file of every model."""

Rows = dict[int, dict[str, Any]]

_WITHOUT_STUDY = (
    "the ellipses are those of the mission's run; after `gliderhpc analyze ARCHIVE currents --budget` those of that "
    "study are taken"
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
    with open_mission(request.archive) as archive:
        numbers = chosen_profiles(archive, request.profiles, request.quick)
        remarks += about_the_estimate(archive, request.estimate, numbers)
        where = positions(archive)
        currents = dict(zip(numbers, archived_currents(archive, numbers, request.estimate), strict=True))
        if not studied(archive, request.estimate):
            remarks += (_WITHOUT_STUDY,)
    remarks += begin_study(request, NAME, labels={"model": names})
    rows = _rows(request, currents, sources)
    write_table_rows(request.archive, {where[number]: row for number, row in rows.items()}, NAME)
    with open_mission(request.archive) as archive:
        compared = compare(archive, rows, names, request.estimate)
        mission = str(archive.attrs.get("mission") or "mission")
    return _conclude(request, compared, rows, mission, files, (*remarks, *_left_out(rows, names)))


def _rows(request: Request, currents: Mapping[int, Current], sources: tuple[str, ...]) -> Rows:
    rows: Rows = {}
    with request.executor() as opened:
        runs = np.array_split(np.array(list(currents)), min(len(currents), RUNS * opened.workers))
        archive = str(request.archive.resolve())
        jobs = [
            ReanalysisJob({int(number): currents[int(number)] for number in run}, archive, sources, request.estimate)
            for run in runs
        ]
        for found in opened.run(study_profiles, jobs):
            rows |= found
            for number in found:
                request.report(number)
    return dict(sorted(rows.items()))


def _conclude(
    request: Request,
    compared: Compared,
    rows: Rows,
    mission: str,
    files: Mapping[str, list[str]],
    remarks: tuple[str, ...],
) -> Findings:
    """Put the tables, the figure and the facts together, and close the group."""
    found = agreements(compared)
    comparing, places = comparisons(compared, found), compared.panels()
    facts = {
        "profiles": compared.numbers.tolist(),
        "estimate": request.estimate,
        "quick": request.quick,
        "models": files,
        "agreement": agreement_rows(compared, found),
    }
    finish_study(request.archive, NAME, as_plain({**facts, "comparisons": comparisons_as_json(comparing)}))
    nine = table_4(compared, places)
    tables = {"table_4": nine, "agreement": facts["agreement"], "profiles": _by_model(rows, compared.names)}
    findings = archive_findings(
        NAME,
        comparing,
        {stem: pd.DataFrame(table) for stem, table in tables.items()},
        {"figure_8": figure_8(compared, places, mission)} if places else {},
        facts,
        {},
        remarks,
    )
    return replace(findings, documents={"table_4.md": table_4_text(nine)})


def _by_model(rows: Rows, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """One line a profile and model."""
    return [
        {"profile": number, "model": name, **{key: _entry(value, index) for key, value in row.items()}}
        for number, row in rows.items()
        for index, name in enumerate(names)
    ]


def _entry(value: Any, index: int) -> Any:
    return value[index] if isinstance(value, np.ndarray) else value


def _about(model: OceanModel) -> list[str]:
    if not model.daily_at_midnight:
        return []
    return [
        f"{model.name}: its daily fields are labelled 00:00 and taken as of that instant; where they are the mean of "
        "the day that begins there, they are used half a day early"
    ]


def _left_out(rows: Rows, names: tuple[str, ...]) -> list[str]:
    """Say for how many profiles each model has no value, and of what most of their records lie outside."""
    remarks = [f"profile {number}: {row['message']}" for number, row in rows.items() if "message" in row]
    sampled = [row for row in rows.values() if "message" not in row]
    for index, name in enumerate(names):
        without = [row for row in sampled if not np.isfinite(row["north"][index])]
        if without:
            reasons = [_reason(row, index) for row in without]
            told = ", ".join(
                f"{reason.replace('_', ' ')} {reasons.count(reason)}" for reason in COUNTS.values() if reason in reasons
            )
            remarks.append(f"{name} has no value for {len(without)} of {len(sampled)} profiles: {told}")
    return remarks


def _reason(row: Mapping[str, Any], index: int) -> str:
    """Why a model says nothing at most of the records at which it says nothing."""
    return max(COUNTS.values(), key=lambda reason: float(row[reason][index]))


STUDY = Study(NAME, "the depth-averaged current beside ocean models", missing_input, run)
"""What the registry finds."""
