"""Study ``reanalysis``: depth-averaged currents and ocean models along the dives (section 5.5, Table 4, Figure 8).

Workers process runs of profiles. For each run a worker opens the models once, and reads the box around each profile's
track. `gliderhpc.report.studies.reanalysis_comparisons` compares the currents over the mission.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.store_schema.columns import MODEL
from gliderhpc.studies.archived import outdated_input_remarks
from gliderhpc.studies.library.ocean_model import Coverage, OceanModel, expand_source, open_models
from gliderhpc.studies.library.scores import (
    MIN_COVERAGE,
    direction_difference,
    sigma_distance,
    speed,
)
from gliderhpc.studies.library.tracks import (
    CURRENTS,
    DivePath,
    UncertainCurrent,
    archived_currents,
    dive_path,
    ellipses_used,
)
from gliderhpc.studies.request import Request
from gliderhpc.studies.study import Preparation, ProfileContext, Row, Study

Array = NDArray[np.float64]

NAME = "reanalysis"


COUNTS = {
    Coverage.BOX: "outside_box",
    Coverage.TIME: "outside_time",
    Coverage.DEPTH: "outside_depth",
    Coverage.LAND: "on_land",
}
"""Columns that count the records without a velocity of the model, by reason."""

_WITHOUT_STUDY = (
    "the ellipses are those of the mission's run; after `gliderhpc analyze ARCHIVE currents --budget` those of that "
    "study are used"
)


def compare_with_models(
    archive: Archive, data: ProfileData, current: UncertainCurrent, models: Sequence[OceanModel]
) -> dict[str, Any]:
    """Return the row of a profile, with a value or ``(model,)`` values in each column.

    If the path of the profile is unknown, the row has only a message.
    """
    path = dive_path(archive, data)
    if path is None:
        return {"message": "a fix before or after the dive is missing, so the position of the dive is not known"}
    middle = len(path.time) // 2
    columns = [_compare_with_model(current, path, model) for model in models]
    return {
        "records": len(path.time),
        "time": path.time[middle],
        "latitude": float(path.latitude[middle]),
        "longitude": wrapped_longitude(float(path.longitude[middle])),
        **{name: np.array([column[name] for column in columns]) for name in columns[0]},
    }


def _compare_with_model(current: UncertainCurrent, path: DivePath, model: OceanModel) -> dict[str, float]:
    """Average one model along the path, with equal weights for all records, and compare the mean with the current.

    The records are evenly spaced in time, and the glider's current is a mean over time too. In both, therefore, each
    depth is weighted by the time spent there.
    """
    samples = model.sample(path)
    covered = samples.coverage == Coverage.VELOCITY
    fraction = float(covered.mean())
    mean = samples.velocity[covered].mean(axis=0) if fraction >= MIN_COVERAGE else np.full(2, np.nan)
    apart = mean - current.velocity
    return {
        "north": float(mean[0]),
        "east": float(mean[1]),
        "covered_fraction": fraction,
        **{name: float((samples.coverage == reason).sum()) for reason, name in COUNTS.items()},
        "vector_difference": float(speed(apart)),
        "speed_difference": float(speed(mean) - speed(current.velocity)),
        "direction_difference": float(direction_difference(mean, current.velocity)),
        "distance": sigma_distance(apart, current.covariance),
    }


@dataclass(frozen=True)
class ReanalysisInputs:
    """Inputs that the profiles share: the glider's currents by number, and the models' files and open models."""

    currents: Mapping[int, UncertainCurrent]
    sources: tuple[str, ...]
    models: tuple[OceanModel, ...] = ()


@contextmanager
def opened(inputs: ReanalysisInputs) -> Iterator[ReanalysisInputs]:
    """Open the models."""
    with open_models(inputs.sources) as models:
        yield replace(inputs, models=models)


def study_profile(data: ProfileData, context: ProfileContext) -> Row:
    """Compare a profile's current with the models' along its path."""
    inputs: ReanalysisInputs = context.inputs
    return compare_with_models(context.archive, data, inputs.currents[data.number], inputs.models)


def missing_input(request: Request, _: object) -> str | None:
    """Require a model."""
    return None if request.models else "needs `models`, files or addresses of ocean models"


def prepare(request: Request, archive: Archive, numbers: tuple[int, ...], settings: None) -> Preparation:
    """Read the glider's currents and the models' names.

    Raises
    ------
    InputError
        A model cannot be read.
    """
    sources = tuple(path for source in request.models for path in expand_source(source))
    currents = dict(zip(numbers, archived_currents(archive, numbers, request.estimate), strict=True))
    ellipses = ellipses_used(archive, request.estimate)
    by_study = ellipses["ellipses_of_study"]
    with open_models(sources) as models:
        return Preparation(
            inputs=ReanalysisInputs(currents, sources),
            labels={MODEL: [model.name for model in models]},
            attributes={"models": {model.name: model.labels for model in models}, **ellipses},
            remarks=(
                *(remark for model in models for remark in _daily_remark(model)),
                *(outdated_input_remarks(archive, CURRENTS) if by_study else ()),
            ),
            caveats=() if by_study else (_WITHOUT_STUDY,),
        )


def _daily_remark(model: OceanModel) -> list[str]:
    if not model.daily_at_midnight:
        return []
    return [
        f"{model.name}: its daily fields are labelled 00:00 and used as values at that time; if they are means of the "
        "day that begins then, they are used half a day early"
    ]


STUDY = Study(
    NAME,
    "the depth-averaged current compared with ocean models",
    profile=study_profile,
    missing=missing_input,
    prepare=prepare,
    opened=opened,
    wide_dims=(MODEL,),
)
