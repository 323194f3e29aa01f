"""Study ``reanalysis``: the depth-averaged current beside ocean models sampled along the same dive (section 5.5).

Workers take runs of profiles: each opens the models once and reads, profile by profile, the box around the track.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from gliderhpc.archive.opening import open_for_reading
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.store_schema import write_table_rows
from gliderhpc.studies.library.ellipses import Current, archived_currents, studied
from gliderhpc.studies.library.ocean_model.interpolation import OceanModel, expanded, open_models
from gliderhpc.studies.reanalysis.beside_models import row_of
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, provenance

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


def run(request: Request) -> None:
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
    finish_study_group(request.archive, NAME, made, {"models": files, "ellipses_of_study": by_study})


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


def _about(model: OceanModel) -> list[str]:
    if not model.daily_at_midnight:
        return []
    return [
        f"{model.name}: its daily fields are labelled 00:00 and taken as of that instant; where they are the mean of "
        "the day that begins there, they are used half a day early"
    ]


STUDY = Study(NAME, "the depth-averaged current beside ocean models", missing_input, run)
"""What the registry finds."""
