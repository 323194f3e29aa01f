"""Lag of the depth's record behind the attitude's, by the likelihood of the filter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import FilterRequest, run_filters
from gliderhpc.estimation.measurements import vibration_set
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform
from gliderhpc.tuning.likelihood import log_density
from gliderhpc.tuning.record_checks.finding import CheckSettings, Finding, judged, undetermined

Array = NDArray[np.float64]

CHECK, QUANTITY, UNIT = "lag", "lag of depth behind attitude", "s"

REACH = 4
"""Lags up to so many sample intervals are tried, either way."""

MIN_PROFILES = 3
MIN_LENGTH = 30
"""Shorter profiles (sample intervals, what the lags take off left out) are passed over."""


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
        Of the filter, and when a lag counts.

    Notes
    -----
    The filter foresees depth from the attitude through the hull's dynamics. The depth is moved in time by whole sample
    intervals, and the prediction-error likelihood says where it fits; the parabola through the best lag and its two
    neighbours finds the lag between them. Whole intervals, because interpolation between samples averages their noise,
    which the likelihood takes for a better fit; for records that are not evenly sampled the depth is smoothed over an
    interval first, whatever the lag. Each profile is one observation of the slope of the likelihood, so that the
    standard error includes that of the profiles' scatter, ``sqrt(sum g_i^2) / |sum h_i|``. The error of the actuators'
    recorded times is added: where only inflections change the pitch, a lag of the depth cannot be distinguished from
    one of theirs.
    """
    series = [one for one in series if _inside(one)[1] - _inside(one)[0] > MIN_LENGTH * one.sample_interval / one.step]
    if len(series) < MIN_PROFILES:
        return undetermined(CHECK, QUANTITY, UNIT, f"{len(series)} profiles, at least {MIN_PROFILES} are needed")
    interval = float(np.median([one.sample_interval for one in series]))
    lags = interval * np.arange(-REACH, REACH + 1, dtype=np.float64)
    try:
        curve = _log_likelihood(platform, series, lags, settings)
    except ProfileError as failure:
        return undetermined(CHECK, QUANTITY, UNIT, str(failure))
    best = int(np.argmax(curve.sum(axis=0)))
    if best in (0, len(lags) - 1):
        return undetermined(CHECK, QUANTITY, UNIT, f"no lag within {REACH} sample intervals fits; calibrate the hull")
    lag, error = _vertex(curve[:, best - 1 : best + 2], float(lags[best]), interval)
    if not np.isfinite(error):
        return undetermined(CHECK, QUANTITY, UNIT, "the filter's likelihood has no maximum; calibrate the hull")
    quantile = float(scipy.stats.t.ppf(1.0 - 0.5 * checks.level, len(series) - 1))
    error = float(np.hypot(error, max(checks.timing_error, 0.25 * interval)))
    threshold = quantile * error
    return Finding(
        CHECK, QUANTITY, UNIT, lag, error, threshold, judged(lag, threshold), f"--set records.depth_lag={lag:.2f}",
        f"{len(series)} profiles, a sample in {interval:.3g} s; rests on the hull's coefficients",
    )  # fmt: skip


def _vertex(curve: Array, middle: float, spacing: float) -> tuple[float, float]:
    """Vertex of the parabola through the profiles' summed curve ``(n, 3)``, and its standard error by their scatter."""
    slope = 0.5 * (curve[:, 2] - curve[:, 0]) / spacing
    bend = (curve[:, 2] - 2.0 * curve[:, 1] + curve[:, 0]) / spacing**2
    if bend.sum() >= 0.0:
        return float("nan"), float("nan")
    shift = -slope.sum() / bend.sum()
    left = slope + bend * shift
    count = len(curve)
    error = np.sqrt(count / (count - 1) * np.sum(left**2)) / abs(bend.sum())
    return middle + float(shift), float(error)


def _log_likelihood(
    platform: Platform, series: Sequence[ProfileSeries], lags: Array, settings: EstimationSettings
) -> Array:
    """Log-likelihood ``(n, k)`` of n profiles whose depth is taken to be late by each of k lags."""
    glider = Glider(platform)
    requests = []
    for one in series:
        first, last = _inside(one)
        bodies = glider.bodies(controls_of(platform, one))[first:last]
        vibrating = vibration_set(platform, one)[first : last + 1]
        requests += [FilterRequest(glider, _with_depth_earlier(one, lag), bodies, vibrating) for lag in lags]
    gate = settings.filter.gate
    found = [
        np.nansum(log_density(estimate.innovations, estimate.innovation_variances, gate))
        for estimate in run_filters(requests, settings)
    ]
    return np.reshape(found, (len(series), len(lags)))


def _with_depth_earlier(series: ProfileSeries, lag: float) -> ProfileSeries:
    """Move the depth, and cut what no lag within reach would know off both ends."""
    width = max(1, round(series.sample_interval / series.step)) | 1
    depth = series.measurements[:, 3]
    for _ in range(2):
        depth = scipy.ndimage.uniform_filter1d(depth, width, mode="nearest")
    measurements = series.measurements.copy()
    measurements[:, 3] = np.interp(series.time + lag, series.time, depth)
    first, last = _inside(series)
    index = series.sample_index[(series.sample_index >= first) & (series.sample_index <= last)]
    return replace(
        series, time=series.time[first : last + 1], measurements=measurements[first : last + 1],
        weights=series.weights[first : last + 1], controls=series.controls[first:last], sample_index=index - first,
    )  # fmt: skip


def _inside(series: ProfileSeries) -> tuple[int, int]:
    """First and last row of a series that all lags tried, and the smoothing, leave inside the record."""
    off = round((REACH + 2) * series.sample_interval / series.step)
    return off, len(series.time) - 1 - off
