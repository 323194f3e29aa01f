"""The inversion without its prior depth compensation, ``k_z = 0``, as the paper runs it in section 5.1.1."""

import time
from typing import Any

import numpy as np

from gliderhpc.archive.profile import SETTLING, ProfileData
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import controls_of, on_steps
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profile
from gliderhpc.estimation.self_motion import SelfMotion, model_motion
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import ProfileRecord, ProfileSeries
from gliderhpc.platform import Platform, with_overrides
from gliderhpc.studies.library.profile_reconstruction import named_rms

HEAVE = 2


def without_depth_slope_row(
    data: ProfileData, nominal: SelfMotion, record: ProfileRecord, platform: Platform, settings: MissionSettings
) -> dict[str, Any]:
    """Invert a profile anew with ``k_z = 0`` and say what that does to tracking, heave disturbance and self-motion.

    Parameters
    ----------
    data, nominal : ProfileData, SelfMotion
        The archive's estimate, with the hull's own ``k_z``, and its self-motion.
    record : ProfileRecord
        What is inverted.
    platform, settings : Platform, MissionSettings
        The archive's.

    Raises
    ------
    ProfileError
        The filter cannot follow the record without the compensation.

    Notes
    -----
    What the model no longer knows, the heave channel has to supply: the slope of the difference with depth should come
    near ``-k_z cos(theta)``.
    """
    glider = Glider(with_overrides(platform, {"buoyancy.depth_slope": "0"}))
    series = on_steps(record, settings)
    estimate = estimate_profile(glider, series, settings)
    residuals = estimate.residuals
    counted = (series.weights > 0.0) & (series.time - series.time[0] >= SETTLING)
    motion = model_motion(estimate.solution.states, estimate.shaken, series.step)
    row = {
        **named_rms("no_slope_steady", residuals[counted & ~estimate.shaken]),
        **named_rms("no_slope_vibration", residuals[counted & estimate.shaken]),
        "no_slope_heave_slope": _heave_slope(data, estimate),
        "filter_seconds": _filter_seconds(glider, series, estimate, settings),
    }
    before = nominal.total
    length = float(np.linalg.norm(before))
    change = float(np.linalg.norm(motion.total - before))
    row["no_slope_self_motion"] = change / length if length > 0.0 else float("nan")
    return row


def _heave_slope(data: ProfileData, estimate: ProfileEstimate) -> float:
    """Slope (N/m) with depth of the heave disturbance without the compensation less that with it, in steady glide."""
    n = min(len(estimate.solution.disturbances), len(data.time))
    steady = data.steady[:n]
    difference = estimate.solution.disturbances[:n, HEAVE][steady] - data.disturbances[:n, HEAVE][steady]
    depth = estimate.series.measurements[:n, 3][steady]
    known = np.isfinite(difference)
    return float(np.polyfit(depth[known], difference[known], 1)[0]) if known.sum() > 1 else float("nan")


def _filter_seconds(
    glider: Glider, series: ProfileSeries, estimate: ProfileEstimate, settings: MissionSettings
) -> float:
    bodies = glider.bodies(controls_of(glider.platform, series))
    began = time.perf_counter()
    run_filter(glider, series, bodies, estimate.shaken, settings)
    return time.perf_counter() - began
