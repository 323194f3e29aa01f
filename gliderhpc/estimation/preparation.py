"""Preparation of a profile's windows: vibration set, filter, and the problem that the windows are cut from."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import Filtered, FilterEstimate, FilterRequest, filter_with_candidates
from gliderhpc.estimation.measurements import corrected, vibration_set
from gliderhpc.estimation.settings import USUAL_WINDOW, EstimationSettings, default_prior
from gliderhpc.estimation.windows import DiveProblem, WindowPlan
from gliderhpc.flight.buoyancy import excess_weight
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.resample import ProfileSeries, resample, sampling_intervals
from gliderhpc.observations.seawater import with_seawater
from gliderhpc.platform import DisturbancePrior, Platform, ballast_masses

Array = NDArray[np.float64]

_SPLIT = 1.25
"""Windows longer than so many usual ones are halved where they do not converge."""

LATERAL = np.array([1, 3, 5])
"""Sway, roll and yaw among the six channels."""


@dataclass(frozen=True, eq=False)
class ProfileTask:
    """A profile to be estimated.

    Attributes
    ----------
    glider : Glider
        The hull.
    series : ProfileSeries
        The record on the steps.
    initial_error : (12,) array, optional
        Added to the first guess of the state (eq. 16, SI): for the study of what that guess matters.
    """

    glider: Glider
    series: ProfileSeries
    initial_error: Array | None = None


@dataclass(frozen=True, eq=False)
class PreparedProfile:
    """A profile ready for its windows.

    Attributes
    ----------
    glider : Glider
        The hull.
    series : ProfileSeries
        The record on the steps.
    vibrating : (n+1,) array of bool
        The vibration set.
    prior : FilterEstimate
        The filter's estimate.
    disturbance_prior : str
        Name of the disturbance prior that it took.
    problem : DiveProblem
        What the windows are cut from.
    plan : WindowPlan
        How they are cut.
    seconds : float
        Computing time so far.
    """

    glider: Glider
    series: ProfileSeries
    vibrating: NDArray[np.bool_]
    prior: FilterEstimate
    disturbance_prior: str
    problem: DiveProblem
    plan: WindowPlan
    seconds: float


def on_steps(record: ProfileRecord, settings: EstimationSettings) -> ProfileSeries:
    """Bring a record onto the integration step, corrected as asked, with the seawater along it.

    Gaps are judged by the record's own sample intervals, where they are: the rate may change with depth.

    Raises
    ------
    ProfileError
        The measurements are never there together, or one of them hardly at all; or the density is asked for and the
        record does not tell it.
    """
    record = corrected(record, settings.records)
    series = resample(record, settings.step, settings.gap_limit(sampling_intervals(record)))
    if settings.seawater == "depth_slope":
        return series
    series = with_seawater(series, record)
    if settings.seawater == "density" and series.seawater is None:
        raise ProfileError(
            f"profile {record.number}: {series.without_seawater}, and seawater=density allows nothing else; give "
            "--set seawater=auto to take the depth slope here"
        )
    return series


def prepare_profiles(
    tasks: Sequence[ProfileTask], settings: EstimationSettings
) -> list[PreparedProfile | ProfileError]:
    """Filter profiles side by side and pose their windows (sections 4.1 and 4.2).

    Returns
    -------
    list
        For each profile what is ready, or why it cannot be: the record cannot be filtered, or the filter rejected more
        than the allowed share of it.
    """
    began = time.perf_counter()
    requests = [
        FilterRequest(
            task.glider, task.series, task.glider.bodies(controls_of(task.glider.platform, task.series)),
            vibration_set(task.glider.platform, task.series), task.initial_error,
        )
        for task in tasks
    ]  # fmt: skip
    answers = filter_with_candidates(requests, settings)
    share = (time.perf_counter() - began) / max(len(tasks), 1)
    return [
        answer if isinstance(answer, ProfileError) else _posed(request, answer, settings, share)
        for request, answer in zip(requests, answers, strict=True)
    ]


def _posed(request: FilterRequest, filtered: Filtered, settings: EstimationSettings, seconds: float) -> PreparedProfile:
    """Pose the windows of a profile that was filtered."""
    began = time.perf_counter()
    series, (prior, (name, disturbance_prior)) = request.series, filtered
    platform = request.glider.platform.model_copy(update={"prior": disturbance_prior})
    problem = DiveProblem(
        request.glider.hull, request.bodies, series.measurements, series.weights, settings.step,
        transform_scale(platform, series, settings), starting_disturbance(prior, series, settings),
        prior.disturbances[:-1], prior.states, request.vibrating,
    )  # fmt: skip
    plan = plan_windows(settings, series.sample_interval, disturbance_prior)
    return PreparedProfile(
        request.glider, series, request.vibrating, prior, name, problem, plan, seconds + time.perf_counter() - began
    )


def controls_of(platform: Platform, series: ProfileSeries) -> Array:
    """Controls ``(n, 5)`` = [r_px, gamma, m_b, m_m, rudder] from the actuators' records (docs/theory/model.md).

    Where the buoyancy goes by measured density (`by_density`), a sixth is the weight that this adds.
    """
    return model_controls(platform, series.controls, series.seawater if by_density(platform, series) else None)


def by_density(platform: Platform, series: ProfileSeries) -> bool:
    """Return whether buoyancy goes by measured density: the record has it, and the platform a compressibility."""
    return series.seawater is not None and platform.buoyancy.compressibility is not None


def model_controls(platform: Platform, actuators: Array, seawater: Array | None = None) -> Array:
    """Controls as in `controls_of` from ``(n, 4)`` = [r_px, gamma, oil volume, rudder] and seawater ``(n, 4)``."""
    position, rotation, volume, rudder = actuators.T
    m_b, m_m = ballast_masses(platform, volume)
    columns = [position, rotation, m_b, m_m, rudder]
    if seawater is not None:
        columns.append(excess_weight(platform, volume, seawater))
    return np.column_stack(columns)


def check_seawater(platform: Platform, settings: EstimationSettings) -> None:
    """Refuse to go by density with a hull that does not say how it is compressed.

    Raises
    ------
    InputError
        The settings ask for density, and the platform states no compressibility.
    """
    if settings.seawater == "density" and platform.buoyancy.compressibility is None:
        raise InputError(
            f"--set seawater=density: the platform {platform.name} states no buoyancy.compressibility; add it "
            "(1/dbar, as `gliderhpc calibrate` finds it), or give --set seawater=depth_slope"
        )


def plan_windows(
    settings: EstimationSettings, interval: float, prior: DisturbancePrior | None = None
) -> WindowPlan:  # fmt: skip
    """Window lengths in steps for a record's sample interval (s), with the prior that shorter ones are scaled by.

    Where the length follows the sensors, windows of slow ones may be halved until they are as short as fast ones'.
    """
    lengths = [settings.window_length(interval)]
    while prior is not None and settings.window.length is None and lengths[-1] > _SPLIT * USUAL_WINDOW:
        lengths.append(max(0.5 * lengths[-1], USUAL_WINDOW))
    plan: WindowPlan | None = None
    for length in reversed(lengths):
        share = length / lengths[0]
        steps, margin = _whole_records(length, share * settings.window_margin(interval), settings)
        scale = None if share == 1.0 or prior is None else tuple(scale_of(prior, length, settings).tolist())
        plan = WindowPlan(steps, margin, share * settings.cost_threshold(interval), scale, plan)
    assert plan is not None
    return plan


def _whole_records(length: float, margin: float, settings: EstimationSettings) -> tuple[int, int]:
    """Length and margin (s) in steps that make whole output intervals, so that a window starts at a stored record."""
    records = settings.steps_per_record
    steps = max(records, max(1, round(length / settings.step)) // records * records)
    return steps, min(round(margin / settings.step) // records * records, steps - records)


def transform_scale(platform: Platform, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Scale ``s (6,)`` of the control-variable transform: as set, from the prior, or ones (`paper`)."""
    return scale_of(default_prior(platform), settings.window_length(series.sample_interval), settings)


def scale_of(prior: DisturbancePrior, length: float, settings: EstimationSettings) -> Array:
    """Scale ``s (6,)`` of the transform for windows of a length (s)."""
    if settings.optimizer.scale is not None:
        return np.array(settings.optimizer.scale)
    if not settings.transformed:
        return np.ones(6)
    share = np.minimum(1.0, 2.0 * length / np.array(prior.correlation_time))
    return np.array(prior.deviation) * np.sqrt(share)


def starting_disturbance(prior: FilterEstimate, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Disturbance ``(n, 6)`` that the windows start from: the filter's, its lateral channels zero or slow part only."""
    start = prior.disturbances[:-1].copy()
    if not settings.transformed:
        start[:, LATERAL] = 0.0
        return start
    width = round(max(settings.slow_part, 30.0 * series.sample_interval) / settings.step)
    start[:, LATERAL] = scipy.ndimage.uniform_filter1d(
        start[:, LATERAL], size=min(width, len(start)) | 1, axis=0, mode="nearest"
    )
    return start
