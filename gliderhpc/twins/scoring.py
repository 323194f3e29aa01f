"""Scores of one inverted twin: errors, tracking, motion, current, windows, seams, and detection of known impulses.

The *seam artefact* is the trace of the boundaries between windows in the identified yaw moment. Take the error of the
yaw moment (identified minus true), bridge unsteady glide by straight lines, and high-pass it (fourth-order Butterworth,
0.05 Hz, run both ways: the filter of the spectra). The *seam ratio* is its root mean square within one second of a
boundary over that elsewhere, in steady glide; a ratio of one means that the boundaries cannot be located. A boundary is
where the selected solution changes from one window's to the next's. The error is used rather than the signal, because
an impulse at a boundary would look like a seam. Without a truth, only the ratio of the signal is available. The *jump
ratio* compares the step of the identified moment across a boundary with its steps elsewhere (root mean squares). It
detects any discontinuity, however small.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import DepthAveragedCurrent, cycles_of, depth_averaged_current, track_of
from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.outcomes import Outcome
from gliderhpc.simulator import Impulse
from gliderhpc.studies.library.scores import correlation, rms
from gliderhpc.studies.library.turbulence.series import bridge_gaps, high_passed
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.vocabulary import CHANNELS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Row = dict[str, Any]

YAW = list(CHANNELS).index("B_cr")
SENSED = ("roll", "pitch", "heading", "depth")
LONGITUDINAL_AND_YAW = ("B_cu", "B_cw", "B_cq", "B_cr")
"""Channels that the usual twin disturbs."""

SEAM_REACH = 1.0
"""Maximum distance from a boundary of samples that belong to it, s."""

INTERVALS = {"68": 0.9944578832097532, "95": 1.959963984540054}
"""Half widths, in standard deviations, of the intervals whose coverage is computed: 68 % and 95 %."""


def score(inversion: TwinInversion) -> Row:
    """Score one inversion over steady glide.

    Returns
    -------
    dict
        ``rmse_B_cu`` ... and ``correlation_B_cr``; ``bias_dive_B_cu`` ... and ``bias_climb_...`` (mean error);
        ``rms_B_cu`` ... and ``peak_B_cr`` (of the high-passed identified yaw moment); ``tracking_roll`` ... (degree,
        m); ``velocity_along``, ``velocity_across``, ``velocity_error`` (of the mean motion through the water, m/s, as
        it enters the current), ``surge_rmse`` (of u, m/s); ``cost`` (median per window), ``cost_per_30s``,
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


def motion_scores(inversion: TwinInversion) -> Row:
    """Error of the mean velocity through the water along and across the true track, and of u and w, m/s."""
    series = inversion.estimate.series
    motion = model_motion(inversion.estimate.solution.states, inversion.estimate.vibrating, series.step)
    true = inversion.states[-1, 3:5] - inversion.states[0, 3:5]
    elapsed = float(series.time[-1] - series.time[0])
    error = (motion.total - true) / elapsed
    along = true / np.linalg.norm(true)
    speeds = (inversion.estimate.solution.states[:-1] - inversion.states[:-1])[inversion.steady]
    return {
        "velocity_along": float(error @ along),
        "velocity_across": float(error @ np.array([-along[1], along[0]])),
        "velocity_error": float(np.linalg.norm(error)),
        "water_speed": float(np.linalg.norm(true) / elapsed),
        "surge_rmse": rms(speeds[:, 6]),
        "heave_rmse": rms(speeds[:, 8]),
    }


def twin_current(inversion: TwinInversion) -> DepthAveragedCurrent:
    """Compute the depth-averaged current of an inverted twin (eqs. 39 and 40); its truth is ``profile_truth.current``.

    Raises
    ------
    InputError
        The twin has no fixes.
    """
    estimate, record = inversion.estimate, inversion.record
    motion = model_motion(estimate.solution.states, estimate.vibrating, inversion.step)
    track = track_of(estimate.series, motion, cycles_of(estimate.series))
    current = depth_averaged_current(record, track, CurrentErrors())
    if current is None:
        raise InputError("a twin without fixes has no current")
    return current


def along_and_across(error: Array, track: Array) -> tuple[Array, Array]:
    """Components ``(n,)`` of errors ``(n, 2)`` along and to starboard of tracks ``(n, 2)``, north and east."""
    unit = track / np.linalg.norm(track, axis=1)[:, None]
    return (error * unit).sum(axis=1), error[:, 1] * unit[:, 0] - error[:, 0] * unit[:, 1]


def mean(values: Array) -> float:
    """Mean; NaN without values."""
    return float(values.mean()) if values.size else float("nan")


def coverage(error: Array, deviation: Array, width: float) -> float:
    """Share of the errors ``(n,)`` within `width` of their standard deviations ``(n,)``; NaN without errors."""
    return float(np.mean(np.abs(error) <= width * deviation)) if error.size else float("nan")


def mahalanobis(error: Array, covariance: Array) -> float:
    """Length of an error ``(k,)`` in standard deviations; 1.2 is the usual median for two components."""
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))


def boundaries_of(source: NDArray[np.int64]) -> NDArray[np.int64]:
    """Steps ``(k,)`` at which another window's solution begins, from the window's number at every step ``(n,)``."""
    return np.flatnonzero(np.diff(source)) + 1


def near_boundaries(boundaries: NDArray[np.int64], count: int, step: float) -> Mask:
    """Mask ``(count,)`` of the steps within `SEAM_REACH` of a boundary."""
    reach = round(SEAM_REACH / step)
    near = np.zeros(count, dtype=np.bool_)
    for boundary in boundaries:
        near[max(0, boundary - reach) : boundary + reach] = True
    return near


def seam_ratio(signal: Array, boundaries: NDArray[np.int64], usable: Mask, step: float) -> float:
    """Ratio of the high-passed signal's root mean square near the boundaries to that elsewhere.

    Parameters
    ----------
    signal : (n,) array
        Error of the yaw moment, or the moment itself, N m.
    boundaries : (k,) array
        Steps at which a window's solution begins.
    usable : (n,) mask
        Steps in steady glide.
    step : float
        Time step, s.

    Returns
    -------
    float
        Ratio; NaN if either part has no samples, or if the signal is zero away from the boundaries.
    """
    near = near_boundaries(boundaries, len(signal), step)
    return _rms_ratio(high_passed(bridge_gaps(signal, usable), step), near, usable)


def jump_ratio(signal: Array, boundaries: NDArray[np.int64], usable: Mask) -> float:
    """Ratio of the root mean square step of a signal across the boundaries to that of its steps elsewhere."""
    steps = np.diff(signal)
    across = np.zeros(len(steps), dtype=np.bool_)
    across[boundaries - 1] = True
    return _rms_ratio(steps, across, usable[1:] & usable[:-1])


def _rms_ratio(values: Array, selected: Mask, usable: Mask) -> float:
    elsewhere = rms(values[usable & ~selected])
    return rms(values[usable & selected]) / elsewhere if elsewhere > 0.0 else float("nan")


def _channel_scores(inversion: TwinInversion) -> Row:
    steady, error = inversion.steady, inversion.error
    estimate = inversion.estimate.solution.disturbances
    row: Row = {}
    for i, name in enumerate(CHANNELS):
        row[f"rmse_{name}"] = rms(error[steady, i])
        row[f"rms_{name}"] = rms(estimate[steady, i])
        row[f"truth_{name}"] = rms(inversion.truth[steady, i])
        for phase, mask in inversion.phases.items():
            row[f"bias_{phase}_{name}"] = mean(error[mask, i])
    row["correlation_B_cr"] = correlation(estimate[steady, YAW], inversion.truth[steady, YAW])
    row["correlation_B_cu"] = correlation(estimate[steady, 0], inversion.truth[steady, 0])
    high = high_passed(bridge_gaps(estimate[:, YAW], steady), inversion.step)[steady]
    row["peak_B_cr"] = float(np.abs(high).max()) if high.size else float("nan")
    row["noise_B_cr"] = rms(high)
    return row


def _tracking(inversion: TwinInversion) -> Row:
    residual = inversion.estimate.residuals[:-1]
    return {f"tracking_{name}": rms(residual[inversion.steady, i]) for i, name in enumerate(SENSED)}


def _window_scores(inversion: TwinInversion) -> Row:
    windows = inversion.estimate.solution.windows
    costs = np.array([window.cost for window in windows])
    lengths = np.array([window.stop - window.start for window in windows]) * inversion.step
    iterations = np.array([window.iterations for window in windows])
    shares = {"capped": Outcome.ITERATION_LIMIT, "stalled": Outcome.STALLED, "diverged": Outcome.DIVERGED}
    return {
        "windows": len(windows),
        "cost": float(np.nanmedian(costs)) if np.isfinite(costs).any() else float("nan"),
        "cost_per_30s": float(np.nansum(costs) / lengths.sum() * 30.0),
        "iterations": float(np.median(iterations)),
        "iterations_max": int(iterations.max()),
        **{name: float(np.mean([window.outcome == outcome for window in windows])) for name, outcome in shares.items()},
        "retracted": float(np.mean([window.retracted for window in windows])),
    }


def _seam_scores(inversion: TwinInversion) -> Row:
    solution = inversion.estimate.solution
    boundaries = boundaries_of(solution.source)
    moment, error = solution.disturbances[:, YAW], inversion.error[:, YAW]
    return {
        "seam_ratio": seam_ratio(error, boundaries, inversion.steady, inversion.step),
        "seam_ratio_signal": seam_ratio(moment, boundaries, inversion.steady, inversion.step),
        "jump_ratio": jump_ratio(moment, boundaries, inversion.steady),
    }


ISOLATION = 8.0
"""Minimum distance of an isolated impulse, s (or `ISOLATION_WIDTHS` widths), from others and from unsteady glide."""

ISOLATION_WIDTHS = 4.0
SEARCH = 2.0
"""Maximum distance from the true time at which a peak is searched, s (or one width, if longer)."""

QUIET_DISTANCE = 12.0
"""Distance from every impulse, s (or six widths, if longer), beyond which a peak is a false alarm."""


@dataclass(frozen=True)
class DetectedImpulse:
    """One true impulse and the highest peak of its sign near it.

    Attributes
    ----------
    amplitude : float
        True peak with its sign, N m.
    width : float
        Width (standard deviation), s.
    peak : float
        Identified peak, high-passed, positive in the direction of the true one, N m.
    delay : float
        Delay of the identified peak, s.
    gain : float
        Ratio of the identified to the true peak, both high-passed.
    """

    amplitude: float
    width: float
    peak: float
    delay: float
    gain: float


def find_impulses(inversion: TwinInversion, moment: Array | None = None) -> list[DetectedImpulse]:
    """Search for every isolated impulse of steady glide in the high-passed identified yaw moment.

    The high-pass removes the slow part from both estimate and truth, so the threshold applies to the impulse.

    Parameters
    ----------
    inversion : TwinInversion
        The twin.
    moment : (n,) array, optional
        Yaw moment of another estimator, N m; the adjoint's by default.
    """
    estimate, truth = high_passed_moments(inversion, moment)
    time = inversion.estimate.series.time[:-1]
    impulses = inversion.profile_truth.impulses
    return [
        _match_peak(impulse, estimate, truth, time)
        for index, impulse in enumerate(impulses)
        if _is_isolated(index, impulses, time, inversion.steady)
    ]


def high_passed_moments(inversion: TwinInversion, moment: Array | None = None) -> tuple[Array, Array]:
    """High-passed yaw moments ``(n,)``, identified (by default the adjoint's) and true, N m, unsteady glide bridged."""
    identified = inversion.estimate.solution.disturbances[:, YAW] if moment is None else moment
    return (
        high_passed(bridge_gaps(identified, inversion.steady), inversion.step),
        high_passed(bridge_gaps(inversion.truth[:, YAW], inversion.steady), inversion.step),
    )


def quiet_peaks(inversion: TwinInversion, spacing: float) -> Array:
    """Peak magnitude of the high-passed identified moment in every quiet block of `spacing` s, for false alarms."""
    estimate, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    count = round(spacing / inversion.step)
    blocks = len(estimate) // count
    sizes = np.abs(estimate[: blocks * count]).reshape(blocks, count)
    return np.asarray(sizes[quiet[: blocks * count].reshape(blocks, count).all(axis=1)].max(axis=1))


def quiet_samples(inversion: TwinInversion) -> NDArray[np.bool_]:
    """Mask ``(n,)`` of the steps in steady glide away from every impulse."""
    time, quiet = inversion.estimate.series.time[:-1], inversion.steady.copy()
    for impulse in inversion.profile_truth.impulses:
        quiet &= np.abs(time - impulse.time) > max(QUIET_DISTANCE, 6.0 * impulse.width)
    return quiet


def _is_isolated(index: int, impulses: tuple[Impulse, ...], time: Array, steady: NDArray[np.bool_]) -> bool:
    impulse = impulses[index]
    reach = max(ISOLATION, ISOLATION_WIDTHS * impulse.width)
    others = impulses[:index] + impulses[index + 1 :]
    if any(abs(other.time - impulse.time) < reach + ISOLATION_WIDTHS * other.width for other in others):
        return False
    if impulse.time - reach < time[0] or impulse.time + reach > time[-1]:
        return False
    return bool(steady[np.abs(time - impulse.time) <= reach].all())


def _match_peak(impulse: Impulse, estimate: Array, truth: Array, time: Array) -> DetectedImpulse:
    near = np.flatnonzero(np.abs(time - impulse.time) <= max(SEARCH, impulse.width))
    sign = 1.0 if impulse.amplitude > 0.0 else -1.0
    best = near[int(np.argmax(sign * estimate[near]))]
    true = float((sign * truth[near]).max())
    peak = float(sign * estimate[best])
    # The value of a step is the mean over its length, so its time is the middle of the step.
    step = float(time[1] - time[0])
    return DetectedImpulse(
        impulse.amplitude, impulse.width, peak, float(time[best]) + 0.5 * step - impulse.time, peak / true
    )
