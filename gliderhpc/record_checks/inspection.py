"""All checks of a mission's records, and the lag of the depth behind the attitude from the filter's likelihood."""

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.distributions import student_quantile
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.filter import FilterEstimate, filter_with_priors
from gliderhpc.estimation.innovations import log_density
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR, default_prior
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.steady_segments import SegmentSettings, SteadySegments, join_segments, segments_of
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import Fix, Observations, ProfileRecord, ProfileSeries
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.platform import Platform
from gliderhpc.record_checks.compass import Leg, compass_findings, leg_of, sense_finding
from gliderhpc.record_checks.compass_change import change_finding
from gliderhpc.record_checks.finding import (
    CheckSettings,
    Finding,
    judge_size,
    undetermined,
    undetermined_if_insensitive,
)
from gliderhpc.record_checks.fixes import fix_finding, surfacings_of
from gliderhpc.record_checks.pitch import pitch_findings
from gliderhpc.record_checks.turns import TurnStretches, turn_information, turn_stretches
from gliderhpc.wording import counted

Array = NDArray[np.float64]

LAG = "lag of depth behind attitude"
_LAG = ("lag", LAG, "s")
"""Check, quantity and unit."""

REACH = 4
"""Maximum lag tried, in sample intervals, in either direction."""

_LAG_ERROR, _SLOW_LAG_ERROR = 0.25, 0.6
"""Error of the lag in sample intervals, for fast and for slow sensors."""

MIN_PROFILES = 3
MIN_LENGTH = 30
"""Minimum length of a profile, in sample intervals, without the ends that the lags cut off."""


def lag_finding(
    platform: Platform, series: Sequence[ProfileSeries], settings: EstimationSettings, checks: CheckSettings
) -> Finding:
    """Estimate the lag of the depth behind the attitude.

    Parameters
    ----------
    platform : Platform
        The hull.
    series : sequence of ProfileSeries
        Profiles on the steps.
    settings, checks : EstimationSettings, CheckSettings
        Settings of the filter and of the checks.

    Notes
    -----
    The filter predicts depth from the attitude through the hull's dynamics. The depth is shifted in time by whole
    sample intervals, and the prediction-error likelihood shows which shift fits. The variances of the innovations are
    those without a shift: the filter's own depend on the speed that it estimates, and where the records are calmer than
    the prior, their logarithm would decide instead of the innovations. A parabola through the best lag and
    its two neighbours gives the lag between them. The shifts are whole intervals because interpolation between samples
    averages their noise, which the likelihood would take for a better fit. Since records may be unevenly sampled, the
    depth is first smoothed over an interval, in the same way for all lags. Each profile is one observation of the slope
    of the likelihood, and the standard error comes from the scatter of the profiles, ``sqrt(sum g_i^2) / |sum h_i|``.
    The error of the actuators' recorded times is added in quadrature, or a share of the sample interval if that is
    larger: a slow record is interpolated for the filter, which moves the best lag by up to 0.8 intervals on simulated
    records without a lag (sampled every 4 and 10 s, three scenarios). Where only inflections change the pitch, a lag of
    the depth cannot be distinguished from an error of these times. With a threshold above the largest lag that has
    neighbours on both sides, no lag would be found; it is then not determined.
    """
    series = [
        profile
        for profile in series
        if _rows_inside(profile)[1] - _rows_inside(profile)[0] > MIN_LENGTH * profile.sample_interval / profile.step
    ]
    if len(series) < MIN_PROFILES:
        return undetermined(*_LAG, f"{counted(len(series), 'profile')}, but at least {MIN_PROFILES} are needed")
    interval = float(np.median([profile.sample_interval for profile in series]))
    lags = interval * np.arange(-REACH, REACH + 1, dtype=np.float64)
    try:
        curve = _log_likelihood(platform, series, lags, settings)
    except ProfileError as failure:
        return undetermined(*_LAG, str(failure))
    best = int(np.argmax(curve.sum(axis=0)))
    if best in (0, len(lags) - 1):
        return undetermined(*_LAG, f"no lag within {REACH} sample intervals fits; calibrate the hull")
    lag, error = _vertex(curve[:, best - 1 : best + 2], float(lags[best]), interval)
    if not np.isfinite(error):
        return undetermined(*_LAG, "the filter's likelihood has no maximum; calibrate the hull")
    quantile = student_quantile(1.0 - 0.5 * checks.level, len(series) - 1)
    lag_error = _LAG_ERROR if interval <= SLOW_SENSORS_PRIOR else _SLOW_LAG_ERROR
    error = float(np.hypot(error, max(checks.timing_error, lag_error * interval)))
    threshold = quantile * error
    finding = Finding(
        *_LAG,
        lag,
        error,
        threshold,
        judge_size(lag, threshold),
        _lag_correction(platform, settings.records.depth_lag + lag),
        f"{counted(len(series), 'profile')}, a sample every {interval:.3g} s; depends on the hull's coefficients",
    )
    limit = max((REACH - 1) * interval, (REACH - 1) * checks.timing_error)
    return undetermined_if_insensitive(finding, limit, f"{counted(len(series), 'profile')}, but more are needed")


def _lag_correction(platform: Platform, lag: float) -> str:
    """Return the setting for a calibrated hull only; errors of any other hull may look like a lag."""
    calibrated = platform.calibration is not None
    return f"`records.depth_lag={lag:.2f}`" if calibrated else "calibrate the hull, then inspect again"


def _vertex(curve: Array, middle: float, spacing: float) -> tuple[float, float]:
    """Vertex of the parabola through the sum of the profiles' curves ``(n, 3)``, and its error from their scatter."""
    slope = 0.5 * (curve[:, 2] - curve[:, 0]) / spacing
    curvature = (curve[:, 2] - 2.0 * curve[:, 1] + curve[:, 0]) / spacing**2
    if curvature.sum() >= 0.0:
        return float("nan"), float("nan")
    shift = -slope.sum() / curvature.sum()
    slope_there = slope + curvature * shift
    count = len(curve)
    error = np.sqrt(count / (count - 1) * np.sum(slope_there**2)) / abs(curvature.sum())
    return middle + float(shift), float(error)


def _log_likelihood(
    platform: Platform, series: Sequence[ProfileSeries], lags: Array, settings: EstimationSettings
) -> Array:
    """Log-likelihood ``(n, k)`` of n profiles, with the depth assumed to be late by each of k lags."""
    glider = Glider(platform)
    profiles, priors = [], []
    for profile in series:
        first, last = _rows_inside(profile)
        prepared = prepare_profile(glider, profile)
        bodies, vibrating = prepared.bodies[first:last], prepared.vibrating[first : last + 1]
        profiles += [PreparedProfile(glider, _with_depth_earlier(profile, lag), bodies, vibrating) for lag in lags]
        priors += [default_prior(platform, profile.attitude_interval)] * len(lags)
    estimates = list(filter_with_priors(profiles, priors, settings))
    rows = [estimates[first : first + len(lags)] for first in range(0, len(estimates), len(lags))]
    middle = int(np.argmin(np.abs(lags)))
    return np.array([_row_of_likelihoods(row, row[middle].innovation_variances, settings.filter.gate) for row in rows])


def _row_of_likelihoods(row: Sequence[FilterEstimate], variances: Array, gate: float) -> list[float]:
    """Log-likelihoods of one profile by lag, with the variances expected without a lag."""
    return [float(np.nansum(log_density(estimate.innovations, variances, gate))) for estimate in row]


def _with_depth_earlier(series: ProfileSeries, lag: float) -> ProfileSeries:
    """Shift the depth to earlier times, and cut off both ends, where some lag within reach has no data."""
    width = max(1, round(series.sample_interval / series.step)) | 1
    depth = series.measurements[:, 3]
    for _ in range(2):
        depth = scipy.ndimage.uniform_filter1d(depth, width, mode="nearest")
    measurements = series.measurements.copy()
    measurements[:, 3] = np.interp(series.time + lag, series.time, depth)
    first, last = _rows_inside(series)
    index = series.sample_index[(series.sample_index >= first) & (series.sample_index <= last)]
    return replace(
        series,
        time=series.time[first : last + 1],
        measurements=measurements[first : last + 1],
        weights=series.weights[first : last + 1],
        controls=series.controls[first:last],
        sample_index=index - first,
        partial=None,
        control_interval=None,
        velocity=None,
        velocity_std=None,
    )


def _rows_inside(series: ProfileSeries) -> tuple[int, int]:
    """First and last row of a series that stay inside the record for all lags tried and for the smoothing."""
    margin = round((REACH + 2) * series.sample_interval / series.step)
    return margin, len(series.time) - 1 - margin


@dataclass(frozen=True)
class Inspection:
    """Results of the checks.

    Attributes
    ----------
    findings : tuple of Finding
        Findings, one or more for each check.
    profiles : tuple of int
        Profiles that were checked.
    left_out : dict of int to str
        Profiles that could not be checked, with the reason.
    """

    findings: tuple[Finding, ...]
    profiles: tuple[int, ...]
    left_out: dict[int, str]

    @property
    def found(self) -> tuple[Finding, ...]:
        """Findings beyond their threshold."""
        return tuple(finding for finding in self.findings if finding.found)

    def as_json(self) -> dict[str, Any]:
        """Return the profiles and the findings as plain values for JSON."""
        return {"profiles": list(self.profiles), "findings": [finding.as_json() for finding in self.findings]}


@dataclass
class _CheckInputs:
    """Input of the checks from the profiles read so far."""

    legs: list[Leg]
    turns: list[TurnStretches]
    segments: list[SteadySegments]
    series: dict[int, ProfileSeries]
    numbers: list[int]
    surfacings: list[tuple[Fix, ...]]

    def add(
        self,
        platform: Platform,
        record: ProfileRecord,
        settings: EstimationSettings,
        current: CurrentSettings,
        *,
        with_series: bool,
    ) -> None:
        """Add a profile to the input of the checks, with its series, which is large, only if the lag needs it."""
        series = on_steps(record, settings, platform)
        self.numbers.append(record.number)
        self.surfacings += surfacings_of(record)
        if with_series:
            self.series[record.number] = series
        leg = leg_of(platform, record, series, current.errors(platform))
        if leg is not None:
            self.legs.append(leg)
        self.turns.append(turn_stretches(platform, series))
        with contextlib.suppress(ProfileError):  # A profile without steady flight is left out of the pitch check only.
            self.segments.append(segments_of(series, platform, SegmentSettings()))


def inspect_records(
    observations: Observations,
    platform: Platform,
    numbers: Sequence[int],
    settings: EstimationSettings,
    checks: CheckSettings,
    current: CurrentSettings,
) -> Inspection:
    """Check records for a lag, errors of pitch and compass, and the error of the fixes; nothing is corrected.

    Parameters
    ----------
    observations, platform : Observations, Platform
        Open file and hull.
    numbers : sequence of int
        Profiles to choose from; faulty ones are skipped.
    settings, checks, current : EstimationSettings, CheckSettings, CurrentSettings
        Settings of the records' preparation (with any corrections requested), of the checks and of the currents.
    """
    usable = [number for number in numbers if number not in observations.faults]
    chosen = evenly_spaced(usable, checks.profiles)
    records = (observations.profile(number) for number in chosen)
    lag_profiles = evenly_spaced(chosen, checks.lag_profiles)
    inspection = inspect_profiles(records, platform, settings, checks, current, lag_profiles)
    faults = {number: observations.faults[number] for number in numbers if number in observations.faults}
    return replace(inspection, left_out=faults | inspection.left_out)


def inspect_profiles(
    records: Iterable[ProfileRecord],
    platform: Platform,
    settings: EstimationSettings,
    checks: CheckSettings,
    current: CurrentSettings,
    for_lag: Sequence[int],
) -> Inspection:
    """Check records one at a time, as `inspect_records` does; the lag is estimated on the profiles `for_lag`."""
    inputs, left_out = _CheckInputs([], [], [], {}, [], []), {}
    for record in records:
        try:
            inputs.add(platform, record, settings, current, with_series=record.number in for_lag)
        except ProfileError as error:
            left_out[record.number] = str(error)
    segments = join_segments(inputs.segments) if inputs.segments else None
    turns = turn_information(inputs.turns, np.radians(checks.plausible_deviation))
    findings = [
        lag_finding(platform, list(inputs.series.values()), settings, checks),
        *pitch_findings(platform, segments, checks, settings.records),
        *compass_findings(inputs.legs, turns, checks, settings.records),
        change_finding(inputs.legs, checks),
        sense_finding(inputs.legs, checks),
        fix_finding(inputs.surfacings, current),
    ]
    return Inspection(tuple(findings), tuple(inputs.numbers), left_out)
