"""How far the unobserved part of the motion strays: axial offset, velocity and current of a dive and of an ensemble."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gliderhpc.estimation.current_budget import CurrentError, FittedBudget
from gliderhpc.studies.library.scores import rms
from gliderhpc.twins.depth_averaged import twin_current
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.runs import Row
from gliderhpc.twins.scoring import mean, motion_scores


def motion_row(inversion: TwinInversion) -> Row:
    """Axial offset, velocity error and current of one dive."""
    truth, current = inversion.profile_truth, twin_current(inversion)
    error = inversion.error[:, 0]
    steady = inversion.steady
    wrong = current.error
    return {
        **motion_scores(inversion),
        "axial_dive": mean(error[steady & inversion.diving]),
        "axial_climb": mean(error[steady & ~inversion.diving]),
        "current_north": float(truth.current[0]),
        "current_east": float(truth.current[1]),
        "error_north": float(wrong[0]),
        "error_east": float(wrong[1]),
        "track_north": float(truth.displacement[0]),
        "track_east": float(truth.displacement[1]),
        "duration": truth.duration,
    }


def error_row(motions: Sequence[Row], preset: str, model: str, fitted: FittedBudget) -> Row:
    """Axial offset, velocity error and fitted terms of one ensemble."""
    frame = pd.DataFrame([row for row in motions if row["preset"] == preset and row["model"] == model])
    axial = frame[["axial_dive", "axial_climb"]].to_numpy(dtype=np.float64)
    error = np.hypot(frame["error_north"].to_numpy(), frame["error_east"].to_numpy())
    return {
        "preset": preset,
        "model": model,
        "twins": len(frame),
        "axial_dive": float(frame["axial_dive"].mean()),
        "axial_climb": float(frame["axial_climb"].mean()),
        "axial_rms": rms(axial),
        "axial_least": float(axial.min()),
        "axial_most": float(axial.max()),
        "along_mean": float(frame["velocity_along"].mean()),
        "along_rms": rms(frame["velocity_along"].to_numpy()),
        "across_rms": rms(frame["velocity_across"].to_numpy()),
        "velocity_error": rms(frame["velocity_error"].to_numpy()),
        "relative_speed_error": rms((frame["velocity_along"] / frame["water_speed"]).to_numpy()),
        "current_error": rms(error),
        "current_error_median": float(np.median(error)),
        **fitted.settings.model_dump(),
        "median_distance": fitted.median_distance,
    }


def current_errors(motions: Sequence[Row], preset: str, model: str) -> list[CurrentError]:
    """Errors of the current in one ensemble."""
    return [
        CurrentError(
            (row["current_north"], row["current_east"]),
            (row["error_north"], row["error_east"]),
            (row["track_north"], row["track_east"]),
            row["duration"],
        )
        for row in motions
        if row["preset"] == preset and row["model"] == model
    ]
