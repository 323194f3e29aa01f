"""One profile's depth-averaged current beside each model's, averaged along the same dive."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.studies.library.current_difference import sigma_distance, speed, turn
from gliderhpc.studies.library.ellipses import Current
from gliderhpc.studies.library.ocean_model.interpolation import Answer, OceanModel
from gliderhpc.studies.reanalysis.dive_path import DivePath, dive_path

Array = NDArray[np.float64]

LEAST_COVERED = 0.9
"""Part of the dive's time that a model has to cover: the mean of less is not the dive's mean."""

COUNTS = {
    Answer.BOX: "outside_box",
    Answer.TIME: "outside_time",
    Answer.DEPTH: "outside_depth",
    Answer.LAND: "on_land",
}
"""Column that counts the records for which a model has each reason to say nothing."""


def row_of(archive: xr.DataTree, data: ProfileData, current: Current, models: Sequence[OceanModel]) -> dict[str, Any]:
    """The profile's row: a value, or ``(model,)`` values, a column; only a message where its path is unknown."""
    path = dive_path(archive, data)
    if path is None:
        return {"message": "no fix on either side, so it is not known where the dive was"}
    middle = len(path.time) // 2
    columns = [_beside(current, path, model) for model in models]
    return {
        "records": len(path.time),
        "time": path.time[middle],
        "latitude": float(path.latitude[middle]),
        "longitude": float((path.longitude[middle] + 180.0) % 360.0 - 180.0),
        **{name: np.array([column[name] for column in columns]) for name in columns[0]},
    }


def _beside(current: Current, path: DivePath, model: OceanModel) -> dict[str, float]:
    """Average of one model along the path, every record weighing the same, and its distance from the current.

    The records are evenly spaced in time, and the current is the mean over time of what the glider met: so a depth
    weighs as long as the glider was there, in both.
    """
    samples = model.sample(path)
    covered = samples.answer == Answer.VELOCITY
    fraction = float(covered.mean())
    mean = samples.velocity[covered].mean(axis=0) if fraction >= LEAST_COVERED else np.full(2, np.nan)
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
