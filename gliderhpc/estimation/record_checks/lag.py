"""Lag of the depth's record behind the attitude's, by the likelihood of the filter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.stats import t as student

from gliderhpc.estimation.filter import FilterRequest, run_filters
from gliderhpc.estimation.likelihood import log_density
from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.record_checks.finding import CheckSettings, Finding, judged, undetermined
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.vibration import vibration_set
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

CHECK, QUANTITY, UNIT = "lag", "lag of depth behind attitude", "s"

REACH = 4
"""Lags up to so many sample intervals are tried, either way."""

LEAST_PROFILES = 3


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
    intervals, then by halves about the best of them, and the prediction-error likelihood says where it fits; a parabola
    through the last three finds the lag. Each profile is one observation of the slope there, so that the standard error
    is that of the profiles' scatter, ``sqrt(sum g_i^2) / |sum h_i|``, and what is wrong with the hull's coefficients
    enters it as far as it differs from profile to profile. The depth is smoothed over a sample interval first, whatever
    the lag: interpolation between samples averages their noise, and would otherwise draw the lag to half an interval.
    """
    if len(series) < LEAST_PROFILES:
        return undetermined(CHECK, QUANTITY, UNIT, f"{len(series)} profiles, at least {LEAST_PROFILES} are needed")
    interval = float(np.median([one.sample_interval for one in series]))
    coarse = interval * np.arange(-REACH, REACH + 1, dtype=np.float64)
    best = float(coarse[np.argmax(_log_likelihood(platform, series, coarse, settings).sum(axis=0))])
    if abs(best) == REACH * interval:
        return undetermined(CHECK, QUANTITY, UNIT, f"no lag within {REACH} sample intervals fits; calibrate the hull")
    near = best + 0.5 * interval * np.arange(-2, 3, dtype=np.float64)
    curve = _log_likelihood(platform, series, near, settings)
    middle = int(np.clip(np.argmax(curve.sum(axis=0)), 1, 3))
    lag, error = _vertex(curve[:, middle - 1 : middle + 2], float(near[middle]), 0.5 * interval)
    if not np.isfinite(error):
        return undetermined(CHECK, QUANTITY, UNIT, "the filter's likelihood has no maximum; calibrate the hull")
    quantile = float(student.ppf(1.0 - 0.5 * checks.level, len(series) - 1))
    threshold = max(quantile * error, checks.least_lag * interval)
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
        bodies, shaken = glider.bodies(controls_of(platform, one)), vibration_set(platform, one)
        requests += [FilterRequest(glider, _with_depth_earlier(one, lag), bodies, shaken) for lag in lags]
    gate = settings.filter.gate
    found = [
        np.nansum(log_density(estimate.innovations, estimate.innovation_variances, gate))
        for estimate in run_filters(requests, settings)
    ]
    return np.reshape(found, (len(series), len(lags)))


def _with_depth_earlier(series: ProfileSeries, lag: float) -> ProfileSeries:
    width = max(1, round(series.sample_interval / series.step))
    depth = series.measurements[:, 3]
    for _ in range(2):
        depth = uniform_filter1d(depth, width | 1, mode="nearest")
    measurements = series.measurements.copy()
    measurements[:, 3] = np.interp(series.time + lag, series.time, depth)
    return replace(series, measurements=measurements)
