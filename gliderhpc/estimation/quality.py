"""Quality of an estimate: flags of its samples, and remarks on the profile."""

from collections import Counter

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import by_density, describe_unexpected_density
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.rests import describe_rests
from gliderhpc.estimation.sensor_noise import noisier_than_stated
from gliderhpc.estimation.windows import WindowRecord
from gliderhpc.observations.dive_phases import stationary_points
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.series import ProfileSeries, describe_false_samples
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import Platform
from gliderhpc.vocabulary import QUALITY
from gliderhpc.wording import counted

MAX_ANGLE_OF_ATTACK = np.radians(15.0)
SPEED_RANGE = (0.05, 1.5)
STEADY_MINUTE = 60.0
"""Time (s) with self-motion outside these limits in steady glide beyond which the profile gets a message."""
ROTATED = np.radians(1.0)
"""Rotation (rad) beyond which the battery is flagged as rotated: more than the jitter of real actuators at rest."""
_CLIMB_SMOOTHING = 20.0

USUALLY_CONVERGED = 0.9
"""Share of converged windows below which a profile gets a message."""
_MIN_CAUSE_SHARE = 0.3
"""Share of a window's samples above which a condition is named as the reason why the window did not converge."""
SEGMENT = 600.0
"""Length of a segment of steady glide, s."""
SLOPE_BIAS = "the neutral volume was fitted with measured density, so heave, speed and current are biased"
"""Effect of the depth slope on a hull whose neutral volume was fitted by density."""

Mask = NDArray[np.bool_]

MAX_REJECTED_SHARE = 0.02
"""Share of gated and inflated samples above which a remark is added; a few belong to every inflection."""


def implausible_motion(estimate: ProfileEstimate) -> Mask:
    """Mask ``(n+1,)`` of samples whose reconstructed angle of attack or speed lies outside the plausible range."""
    u, v, w = estimate.solution.states[:, 6:9].T
    speed = np.sqrt(u * u + v * v + w * w)
    plausible = (
        (np.abs(np.arctan2(w, u)) <= MAX_ANGLE_OF_ATTACK) & (speed >= SPEED_RANGE[0]) & (speed <= SPEED_RANGE[1])
    )
    return np.asarray(~plausible, dtype=bool)


def longest_run(mask: Mask, step: float) -> float:
    """Duration (s) of the longest unbroken stretch of a mask."""
    return max((end - begin for begin, end in stretches(mask)), default=0) * step


def quality_flags(estimate: ProfileEstimate) -> NDArray[np.uint8]:
    """CF flag masks ``(n+1,)`` of the archive's ``series/quality``."""
    series, solution = estimate.series, estimate.solution
    outcomes = np.array([window.outcome for window in solution.windows])[solution.source]
    outcomes = np.append(outcomes, outcomes[-1])
    width = max(1, round(_CLIMB_SMOOTHING / series.step))
    depth_rate = np.gradient(scipy.ndimage.uniform_filter1d(solution.states[:, 5], width, mode="nearest"), series.step)
    rotated = np.abs(series.controls[:, 1]) > ROTATED
    masks = {
        "vibration": estimate.vibrating,
        "gap_in_the_record": series.weights == 0.0,
        "prior_used_because_the_window_failed": ~np.isin(outcomes, [o for o in Outcome if o.usable]),
        "implausible_self_motion": implausible_motion(estimate),
        "battery_rotated": np.append(rotated, rotated[-1]),
        "climbing": depth_rate < 0.0,
        "window_not_converged": outcomes != Outcome.CONVERGED,
    }
    flags = np.zeros(len(series.time), dtype=np.uint8)
    for name, mask in masks.items():
        flags |= np.where(mask, QUALITY.meanings[name], 0).astype(np.uint8)
    return flags


def buoyancy_remarks(platform: Platform, series: ProfileSeries) -> list[str]:
    """Explain why buoyancy does not use density although the hull has a compressibility, and the effect on the profile.

    The neutral volume of a hull with a compressibility was fitted in water of a known density. With the depth slope the
    same hull floats at another volume (23 cm3, or 0.2 N, on mission 12 of SEA035), and the profile is biased.
    """
    if platform.buoyancy.compressibility is None or by_density(platform, series):
        return []
    reason = series.without_seawater or "by the setting seawater"
    return [f"buoyancy from the depth slope, not from density: {reason}, and {SLOPE_BIAS}"]


def _remedy(platform: Platform) -> str:
    """Remedy against implausible self-motion."""
    if platform.calibration is None:
        return "calibrate the hull"
    return "hull or disturbance prior does not fit here; calibrate on profiles like this one, then tune the prior"


def _unconverged(platform: Platform, estimate: ProfileEstimate) -> list[str]:
    """State the number of windows that did not converge and the reasons, if more than `USUALLY_CONVERGED` allows."""
    windows = estimate.solution.windows
    unfinished = [window for window in windows if window.outcome.unfinished]
    if len(unfinished) <= (1.0 - USUALLY_CONVERGED) * len(windows):
        return []
    implausible = implausible_motion(estimate)
    reasons = Counter(_why_unconverged(window, platform, estimate, implausible) for window in unfinished)
    listed = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
    return [
        f"{len(unfinished)} of {counted(len(windows), 'window')} did not converge ({listed}): flagged in `quality`; "
        "prefer the smoothed estimate there"
    ]


def _single_window(estimate: ProfileEstimate) -> list[str]:
    """State that a window was as long as the profile, which the usual lengths never are."""
    if len(estimate.solution.windows) != 1:
        return []
    duration = estimate.series.time[-1] - estimate.series.time[0]
    return [
        f"the profile, of {duration:.0f} s, is shorter than a window and is a single one: give a shorter window.length"
    ]


def _why_unconverged(window: WindowRecord, platform: Platform, estimate: ProfileEstimate, implausible: Mask) -> str:
    """Describe the prevailing condition in a window that did not converge."""
    rows = slice(window.start, window.stop)
    if implausible[rows].mean() > _MIN_CAUSE_SHARE:
        return f"where the self-motion is implausible: {_remedy(platform)}"
    if estimate.vibrating[rows].mean() > _MIN_CAUSE_SHARE:
        return "where the actuators move between samples"
    if (estimate.series.weights[rows] == 0.0).mean() > _MIN_CAUSE_SHARE:
        return "in gaps of the record"
    return (
        "at the iteration limit"
        if window.outcome == Outcome.ITERATION_LIMIT
        else "where the model does not follow the record"
    )


def remarks(platform: Platform, estimate: ProfileEstimate) -> list[str]:
    """List remarks for the profile's message, on its record and on its estimate."""
    return [
        *_remarks_on_record(platform, estimate),
        *_remarks_on_motion(platform, estimate),
        *_remarks_on_windows(platform, estimate),
        *_remarks_on_samples(estimate),
        *_remarks_on_smoother(estimate),
    ]


def _remarks_on_record(platform: Platform, estimate: ProfileEstimate) -> list[str]:
    """Remark on the disturbance prior, and on filled, false and noisy samples."""
    series, lines = estimate.series, []
    if estimate.filtered.prior_name == "rough_water":
        channels = "the yaw moment" if estimate.profile.is_slow else "sway and roll"
        lines.append(f"the default disturbance prior does not fit this record; gust prior used for {channels}")
    if series.filled:
        interval = series.attitude_interval if "pitch" in series.filled else series.sample_interval
        lines.append(
            f"values of {', '.join(series.filled)} are repeated or interpolated between measurements; only the "
            f"measurements are used, every {interval:.3g} s"
        )
    lines += describe_false_samples(series)
    if deviations := noisier_than_stated(platform, series):
        units = {"depth": "m"}
        listed = ", ".join(f"{name} {value:.2g} {units.get(name, 'degree')}" for name, value in deviations.items())
        lines.append(f"noise taken from the record, since it is larger than the platform file states: {listed}")
    return lines


def _remarks_on_motion(platform: Platform, estimate: ProfileEstimate) -> list[str]:
    """Remark on implausible self-motion in steady glide."""
    series = estimate.series
    gliding = ~estimate.vibrating & ~stationary_points(series)
    duration = longest_run(implausible_motion(estimate) & gliding, series.step)
    if duration < STEADY_MINUTE:
        return []
    line = (
        f"self-motion implausible for {duration:.0f} s of steady glide (|angle of attack| over 15 deg or speed outside "
        f"{SPEED_RANGE[0]}-{SPEED_RANGE[1]} m/s): {_remedy(platform)}"
    )
    return [line, *filter(None, [describe_unexpected_density(platform, series)])]


def _remarks_on_windows(platform: Platform, estimate: ProfileEstimate) -> list[str]:
    """Remark on windows without a usable solution, and on those that did not converge."""
    windows, lines = estimate.solution.windows, []
    for outcome in (Outcome.DIVERGED, Outcome.NO_DATA):
        count = sum(window.outcome == outcome for window in windows)
        if count:
            lines.append(f"{count} of {counted(len(windows), 'window')}: {outcome.sentence}")
    return [*lines, *_unconverged(platform, estimate), *_single_window(estimate)]


def _remarks_on_samples(estimate: ProfileEstimate) -> list[str]:
    """Remark on samples that were not used: gaps, a refused velocity, and samples that the filter rejected."""
    lines = describe_rests(estimate.series)
    if estimate.series.gap_seconds > 0.0:
        lines.append(f"gaps totalling {estimate.series.gap_seconds:.0f} s were ignored")
    if estimate.profile.velocity is not None and estimate.profile.velocity.refusal:
        lines.append(estimate.profile.velocity.refusal)
    if estimate.filtered.reset > 0 or estimate.filtered.rejected_fraction > MAX_REJECTED_SHARE:
        lines.append(estimate.filtered.describe())
    return lines


def _remarks_on_smoother(estimate: ProfileEstimate) -> list[str]:
    """Remark on vertical motion of the water, and on a simplified or failed smoother."""
    lines, smoothed = [], estimate.smoothed
    if estimate.hull is not None and estimate.hull.information.vertical_motion > 0.0:
        lines.append(
            "the depth rate varies as in water that moves vertically by about "
            f"{100.0 * estimate.hull.information.vertical_motion:.1f} cm/s (RMS), which the smoothed estimate includes"
        )
    if smoothed is not None and smoothed.simplified:
        lines.append(f"the smoother did not converge with these settings; simplified: {smoothed.simplified}")
    if smoothed is not None and not smoothed.outcome.usable:
        reason = f" ({smoothed.failure})" if smoothed.failure else ""
        lines.append(
            f"the smoother has no estimate of this profile{reason}: the filter's is used, without standard deviations"
        )
    return lines


def first_stretch(usable: NDArray[np.bool_], steps: int) -> tuple[int, int] | None:
    """First stretch ``(begin, begin + steps)`` of a mask whose samples are all usable, both ends included, or None."""
    run = np.cumsum(np.concatenate([[0], usable]))
    begins = np.flatnonzero(run[steps + 1 :] - run[: -steps - 1] == steps + 1)
    return (int(begins[0]), int(begins[0]) + steps) if len(begins) else None
