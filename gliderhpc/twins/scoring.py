"""One inverted twin as a row of numbers: every score that the studies use, named once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.outcomes import Outcome
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.studies.library.turbulence.high_pass import bridged, high_passed
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.seams import boundaries_of, jump_ratio, seam_ratio
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Row = dict[str, Any]

YAW = list(CHANNELS).index("B_cr")
SENSED = ("roll", "pitch", "heading", "depth")


def score(inversion: TwinInversion) -> Row:
    """Score one inversion over steady glide.

    Returns
    -------
    dict
        ``rmse_B_cu`` ... and ``correlation_B_cr``; ``bias_dive_B_cu`` ... and ``bias_climb_...`` (mean error);
        ``rms_B_cu`` ... and ``peak_B_cr`` (of the high-passed identified yaw moment); ``tracking_roll`` ... (degree,
        m); ``velocity_along``, ``velocity_across``, ``velocity_error`` (of the mean motion through the water, m/s, as
        the current sees it), ``surge_rmse`` (of u, m/s); ``cost`` (median a window over its length, relative to 30 s),
        ``iterations``, ``capped``, ``retracted``, ``windows``; ``seam_ratio``, ``seam_ratio_signal``, ``jump_ratio``;
        ``seconds``.
    """
    return {
        **_channel_scores(inversion),
        **_tracking(inversion),
        **motion_scores(inversion),
        **_window_scores(inversion),
        **_seam_scores(inversion),
        "duration": inversion.profile_truth.duration,
        "seconds": inversion.seconds,
    }


def _channel_scores(inversion: TwinInversion) -> Row:
    steady, error = inversion.steady, inversion.error
    estimate = inversion.estimate.solution.disturbances
    row: Row = {}
    for i, name in enumerate(CHANNELS):
        row[f"rmse_{name}"] = rms(error[steady, i])
        row[f"rms_{name}"] = rms(estimate[steady, i])
        row[f"truth_{name}"] = rms(inversion.truth[steady, i])
        for phase, mask in (("dive", inversion.diving), ("climb", ~inversion.diving)):
            row[f"bias_{phase}_{name}"] = mean(error[steady & mask, i])
    row["correlation_B_cr"] = correlation(estimate[steady, YAW], inversion.truth[steady, YAW])
    row["correlation_B_cu"] = correlation(estimate[steady, 0], inversion.truth[steady, 0])
    high = high_passed(bridged(estimate[:, YAW], steady), inversion.step)[steady]
    row["peak_B_cr"] = float(np.abs(high).max()) if high.size else float("nan")
    row["noise_B_cr"] = rms(high)
    return row


def _tracking(inversion: TwinInversion) -> Row:
    residual = inversion.estimate.residuals[:-1]
    return {f"tracking_{name}": rms(residual[inversion.steady, i]) for i, name in enumerate(SENSED)}


def motion_scores(inversion: TwinInversion) -> Row:
    """Error of the mean velocity through the water along and across the true track, and of u and w, m/s."""
    series = inversion.estimate.series
    motion = model_motion(inversion.estimate.solution.states, inversion.estimate.shaken, series.step)
    true = inversion.states[-1, 3:5] - inversion.states[0, 3:5]
    elapsed = float(series.time[-1] - series.time[0])
    wrong = (motion.total - true) / elapsed
    along = true / np.linalg.norm(true)
    speeds = (inversion.estimate.solution.states[:-1] - inversion.states[:-1])[inversion.steady]
    return {
        "velocity_along": float(wrong @ along),
        "velocity_across": float(wrong @ np.array([-along[1], along[0]])),
        "velocity_error": float(np.linalg.norm(wrong)),
        "water_speed": float(np.linalg.norm(true) / elapsed),
        "surge_rmse": rms(speeds[:, 6]),
        "heave_rmse": rms(speeds[:, 8]),
    }


def _window_scores(inversion: TwinInversion) -> Row:
    windows = inversion.estimate.solution.windows
    costs = np.array([window.cost for window in windows])
    lengths = np.array([window.stop - window.start for window in windows]) * inversion.step
    iterations = np.array([window.iterations for window in windows])
    return {
        "windows": len(windows),
        "cost": float(np.nanmedian(costs)) if np.isfinite(costs).any() else float("nan"),
        "cost_per_30s": float(np.nansum(costs) / lengths.sum() * 30.0),
        "iterations": float(np.median(iterations)),
        "iterations_max": int(iterations.max()),
        "capped": _share(inversion, Outcome.ITERATION_LIMIT),
        "stalled": _share(inversion, Outcome.STALLED),
        "diverged": _share(inversion, Outcome.DIVERGED),
        "retracted": float(np.mean([window.retracted for window in windows])),
    }


def _share(inversion: TwinInversion, outcome: Outcome) -> float:
    return float(np.mean([window.outcome == outcome for window in inversion.estimate.solution.windows]))


def _seam_scores(inversion: TwinInversion) -> Row:
    solution = inversion.estimate.solution
    boundaries = boundaries_of(solution.source)
    moment, error = solution.disturbances[:, YAW], inversion.error[:, YAW]
    return {
        "seam_ratio": seam_ratio(error, boundaries, inversion.steady, inversion.step),
        "seam_ratio_signal": seam_ratio(moment, boundaries, inversion.steady, inversion.step),
        "jump_ratio": jump_ratio(moment, boundaries, inversion.steady),
    }


def mean(values: Array) -> float:
    """Mean, NaN where there is nothing."""
    return float(values.mean()) if values.size else float("nan")
