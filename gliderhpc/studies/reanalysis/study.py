"""Study ``reanalysis``: the depth-averaged current and ocean models sampled along the same dive (section 5.5).

Workers take runs of profiles: each opens the models once and reads, profile by profile, the box around the track.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import ProfileData, read_profile_data
from gliderhpc.store_schema import write_table_rows
from gliderhpc.studies.library.currents import Current, archived_currents, has_currents_study
from gliderhpc.studies.library.ocean_model import Answer, OceanModel, expanded, open_models
from gliderhpc.studies.library.scores import sigma_distance, speed, turn
from gliderhpc.studies.library.tracks import DivePath, dive_path
from gliderhpc.studies.study import Request, Study, begin_study, choose, finish_study_group, provenance

Array = NDArray[np.float64]


MIN_COVERAGE = 0.9
"""Part of the dive's time that a model has to cover: the mean of less is not the dive's mean."""

COUNTS = {
    Answer.BOX: "outside_box",
    Answer.TIME: "outside_time",
    Answer.DEPTH: "outside_depth",
    Answer.LAND: "on_land",
}
"""Column that counts the records for which a model has each reason to say nothing."""


def compare_with_models(
    archive: xr.DataTree, data: ProfileData, current: Current, models: Sequence[OceanModel]
) -> dict[str, Any]:
    """The profile's row: a value, or ``(model,)`` values, a column; only a message where its path is unknown."""
    path = dive_path(archive, data)
    if path is None:
        return {"message": "no fix on either side, so it is not known where the dive was"}
    middle = len(path.time) // 2
    columns = [_compare_with_model(current, path, model) for model in models]
    return {
        "records": len(path.time),
        "time": path.time[middle],
        "latitude": float(path.latitude[middle]),
        "longitude": float((path.longitude[middle] + 180.0) % 360.0 - 180.0),
        **{name: np.array([column[name] for column in columns]) for name in columns[0]},
    }


def _compare_with_model(current: Current, path: DivePath, model: OceanModel) -> dict[str, float]:
    """Average of one model along the path, every record weighing the same, and its distance from the current.

    The records are evenly spaced in time, and the current is the mean over time of what the glider met: so a depth
    weighs as long as the glider was there, in both.
    """
    samples = model.sample(path)
    covered = samples.answer == Answer.VELOCITY
    fraction = float(covered.mean())
    mean = samples.velocity[covered].mean(axis=0) if fraction >= MIN_COVERAGE else np.full(2, np.nan)
    apart = mean - current.velocity
    return {
        "north": float(mean[0]),
        "east": float(mean[1]),
        "covered_fraction": fraction,
        **{name: float((samples.answer == reason).sum()) for reason, name in COUNTS.items()},
        "vector_difference": float(speed(apart)),
        "speed_difference": float(speed(mean) - speed(current.velocity)),
        "direction_difference": float(turn(mean, current.velocity)),
        "distance": sigma_distance(apart, current.covariance),
    }


NAME = "reanalysis"

RUNS_PER_WORKER = 4
"""Runs of profiles a worker takes: few, because each opens every file of every model."""

Rows = dict[int, dict[str, Any]]

_WITHOUT_STUDY = (
    "the ellipses are those of the mission's run; after `gliderhpc analyze ARCHIVE currents --budget` those of that "
    "study are taken"
)


@dataclass(frozen=True)
class ReanalysisJob:
    """A run of profiles, with their currents, to compare with the models."""

    currents: Mapping[int, Current]
    archive: str
    sources: tuple[str, ...]
    estimate: str


def study_profiles(job: ReanalysisJob) -> Rows:
    """Compare a run of profiles with the models, a row a profile by its number; the job of a worker."""
    with threadpool_limits(limits=1), open_for_reading(job.archive) as archive, open_models(job.sources) as models:
        return {
            number: compare_with_models(archive, read_profile_data(archive, number, job.estimate), current, models)
            for number, current in job.currents.items()
        }


def missing_input(request: Request) -> str | None:
    """Require a model."""
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
        remarks = tuple(remark for model in models for remark in _daily_remark(model))
    with open_for_reading(request.archive) as archive:
        chosen = choose(archive, request)
        own = archived_currents(archive, chosen.numbers, request.estimate)
        by_study = has_currents_study(archive, request.estimate)
    remarks += chosen.remarks + (() if by_study else (_WITHOUT_STUDY,))
    remarks += begin_study(request, NAME, labels={"model": names})
    rows = _rows(request, dict(zip(chosen.numbers, own, strict=True)), sources)
    write_table_rows(request.archive, {chosen.where[number]: row for number, row in rows.items()}, NAME)
    made = provenance(request, rows, None, remarks)
    finish_study_group(request.archive, NAME, made, {"models": files, "ellipses_of_study": by_study})


def _rows(request: Request, currents: Mapping[int, Current], sources: tuple[str, ...]) -> Rows:
    rows: Rows = {}
    with request.executor() as opened:
        runs = np.array_split(np.array(list(currents)), min(len(currents), RUNS_PER_WORKER * opened.workers))
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


def _daily_remark(model: OceanModel) -> list[str]:
    if not model.daily_at_midnight:
        return []
    return [
        f"{model.name}: its daily fields are labelled 00:00 and taken as of that instant; where they are the mean of "
        "the day that begins there, they are used half a day early"
    ]


STUDY = Study(NAME, "the depth-averaged current beside ocean models", missing_input, run, takes_settings=False)
