"""Filter against adjoint or smoother (section 5.2): yaw moments by regime, and lag and attenuation of a known truth.

As in the paper there are two regimes: with the battery at rest, sparse impulses stand out; with the battery rotated,
slow model error dominates. Both are steady glide, and exclude the vibration set.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData, truth_on_samples
from gliderhpc.archive.reader import Archive
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.times import SECOND
from gliderhpc.store_schema.columns import impulse_column, regime_column, truth_column
from gliderhpc.studies.library.scores import correlation
from gliderhpc.studies.library.turbulence.series import high_passed
from gliderhpc.vocabulary import CHANNELS

Row = Mapping[str, Any]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

YAW = list(CHANNELS).index("B_cr")
FAST = 0.05
"""Frequency above which the paper searches for turbulence, Hz."""
LAG_REACH = 30.0
"""Maximum lag that is tried in either direction, s."""
IMPULSE_REACH = 10.0
"""Time (s) after an impulse within which its peak is searched, from three widths before it.

An impulse is used if no other lies within twice this time.
"""
_MIN_SAMPLES = 100
_COARSE = 1.0

PRIOR = "prior"

TRUE_YAW = "B_cr_truth"
"""Variable of the true yaw moment."""

_BY_CHANNEL = ("lag", "correlation", "gain")

_OF_IMPULSE, _AS_SEEN = ("time", "amplitude", "width"), ("delay", "ratio")

_GROUP = "reconstruction"


@dataclass(frozen=True)
class Lag:
    """Delay of one series behind another (s), and correlation and regression slope (1: no attenuation) at that delay.

    If the correlation has no maximum within `LAG_REACH`, the delay is NaN, and correlation and slope are for no delay.
    """

    seconds: float
    correlation: float
    gain: float


def regime_row(data: ProfileData) -> dict[str, Any]:
    """Statistics of both yaw moments, with battery at rest and rotated, and the filter's lag behind the estimate."""
    rotated, steady = data.flagged("battery_rotated"), data.steady & data.converged
    regimes = {"resting": steady & ~rotated, "rotated": steady & rotated}
    row: dict[str, Any] = {
        "rotated_fraction": float(regimes["rotated"].sum() / steady.sum()) if steady.any() else float("nan")
    }
    for estimator, values in ((data.estimate, data.disturbances[:, YAW]), ("prior", data.prior[:, YAW])):
        for regime, mask in regimes.items():
            row |= {regime_column(estimator, regime, k): v for k, v in _statistics(values, mask, data.step).items()}
    lag = find_lag(data.prior[:, YAW], data.disturbances[:, YAW], steady, data.step)
    return row | {"yaw_correlation": lag.correlation, "yaw_lag": lag.seconds}


def find_lag(follower: Array, leader: Array, mask: Mask, step: float) -> Lag:
    """Find the delay of `follower` behind `leader` with the largest correlation, over the samples of a mask.

    Parameters
    ----------
    follower, leader : (n,) arrays
        Two series, which may have missing values.
    mask : (n,) array of bool
        Samples of the leader that are used.
    step : float
        Time between samples, s.
    """
    counted = mask & np.isfinite(leader)
    if counted.sum() < _MIN_SAMPLES or np.ptp(leader[counted]) == 0.0:
        return Lag(float("nan"), float("nan"), float("nan"))
    reach, coarse = round(LAG_REACH / step), max(1, round(_COARSE / step))
    best, samples = 0, np.flatnonzero(counted)
    # A coarse search, then a fine one around its best lag: disturbances change little within a second.
    for lags in (range(-reach, reach + 1, coarse), range(-coarse, coarse + 1)):
        correlations = [_correlation(*_align(follower, leader, samples, best + lag)) for lag in lags]
        if not np.isfinite(correlations).any():
            return Lag(float("nan"), float("nan"), float("nan"))
        best += lags[int(np.nanargmax(correlations))]
    if abs(best) >= reach:
        return _without_delay(follower, leader, samples)
    behind, ahead = _align(follower, leader, samples, best)
    return Lag(best * step, correlation(behind, ahead), _slope(behind, ahead))


def _correlation(a: Array, b: Array) -> float:
    """Correlation of finite values: the same as `correlation` to rounding, in a third of the time."""
    if a.size == 0 or a.min() == a.max() or b.min() == b.max():
        return float("nan")
    first, second = a - a.mean(), b - b.mean()
    return float(first @ second / np.sqrt((first @ first) * (second @ second)))


def _without_delay(follower: Array, leader: Array, samples: NDArray[np.intp]) -> Lag:
    """Correlation and slope without delay: a channel that changes over minutes has no best delay within the reach."""
    behind, ahead = _align(follower, leader, samples, 0)
    return Lag(float("nan"), correlation(behind, ahead), _slope(behind, ahead))


def _slope(behind: Array, ahead: Array) -> float:
    return float(np.cov(behind, ahead)[0, 1] / np.var(ahead, ddof=1))


def truth_rows(data: ProfileData, truth: xr.Dataset) -> list[dict[str, Any]]:
    """Lag, correlation and gain of both estimators relative to the truth, a row for each channel that was not zero."""
    true = truth_on_samples(data, truth)
    rows = []
    for channel, name in enumerate(CHANNELS):
        for estimator, values in ((data.estimate, data.disturbances), ("prior", data.prior)):
            lag = find_lag(values[:, channel], true[:, channel], data.steady, data.step)
            if np.isfinite(lag.gain):
                rows.append(
                    {
                        "profile": data.number,
                        "channel": name,
                        "estimator": estimator,
                        "lag": lag.seconds,
                        "correlation": lag.correlation,
                        "gain": lag.gain,
                    }
                )
    return rows


def impulse_rows(data: ProfileData, truth: xr.Dataset) -> list[dict[str, Any]]:
    """Delay and height, in both estimators, of each isolated true impulse of the yaw moment in steady glide."""
    times = np.asarray((truth["impulse_time"].values - data.epoch) / SECOND, dtype=np.float64)
    rows = []
    for time, amplitude, width in zip(
        times, truth["impulse_amplitude"].values, truth["impulse_width"].values, strict=True
    ):
        first, last = np.searchsorted(data.time, [time - 3.0 * width, time + IMPULSE_REACH])
        alone = (np.abs(times - time) < 2.0 * IMPULSE_REACH).sum() == 1
        if alone and 0 < first < last < len(data.time) and data.steady[first:last].all():
            rows.append(
                {"profile": data.number, "time": time, "amplitude": float(amplitude), "width": float(width)}
                | _peak_after(data.estimate, data, data.disturbances[first:last, YAW], first, time, amplitude)
                | _peak_after("prior", data, data.prior[first:last, YAW], first, time, amplitude)
            )
    return rows


def _peak_after(
    estimator: str, data: ProfileData, values: Array, first: int, time: float, amplitude: float
) -> dict[str, float]:
    """Delay of the peak (s), and ratio of its height to the true one."""
    peak = int(np.argmax(np.sign(amplitude) * values))
    # A disturbance acts over a whole step, so its time is the middle of the step.
    delay = float(data.time[first + peak] + 0.5 * data.step - time)
    return {f"{estimator}_delay": delay, f"{estimator}_ratio": float(values[peak] / amplitude)}


def _align(follower: Array, leader: Array, samples: NDArray[np.intp], lag: int) -> tuple[Array, Array]:
    """Values of both series at given samples of the leader (in order), the follower's taken `lag` samples later."""
    at = samples[np.searchsorted(samples, -lag) : np.searchsorted(samples, len(follower) - lag)]
    behind, ahead = follower[at + lag], leader[at]
    known = np.isfinite(behind)
    return behind[known], ahead[known]


def _statistics(values: Array, mask: Mask, step: float) -> dict[str, float]:
    known = np.isfinite(values)
    inside = values[mask & known]
    if inside.size < _MIN_SAMPLES or np.ptp(inside) == 0.0:
        return dict.fromkeys(("std", "peak", "kurtosis", "fast"), float("nan"))
    centred = inside - inside.mean()
    variance = float(np.mean(centred**2))
    filled = np.interp(np.arange(len(values)), np.flatnonzero(known), values[known])
    # In a stretch shorter than three periods of the cutoff, the filter's response to the neighbours dominates.
    long = _long_stretches(mask & known, round(3.0 / FAST / step))
    fast = high_passed(filled, step, FAST, pad=15)[long]
    return {
        "std": variance**0.5,
        "peak": float(np.max(np.abs(inside - np.median(inside)))),
        "kurtosis": float(np.mean(centred**4) / variance**2),
        "fast": float(np.var(fast) / np.var(values[long])) if long.any() else float("nan"),
    }


def _long_stretches(mask: Mask, least: int) -> Mask:
    """Remove the stretches of a mask that have fewer than `least` samples."""
    long = np.zeros_like(mask)
    for begin, end in stretches(mask):
        long[begin:end] = end - begin >= least
    return long


def estimators(estimate: str) -> tuple[str, str]:
    """Return the names along the group's dimension of estimators."""
    return estimate, PRIOR


def truth_columns(data: ProfileData, truth: xr.Dataset, impulses: int) -> Row:
    """Compare both estimators of a profile with the truth: values by channel, and by impulse, padded to `impulses`."""
    own = estimators(data.estimate)
    by_channel = {name: np.full((len(CHANNELS), len(own)), np.nan) for name in _BY_CHANNEL}
    for row in truth_rows(data, truth):
        position = list(CHANNELS).index(row["channel"]), own.index(row["estimator"])
        for name in _BY_CHANNEL:
            by_channel[name][position] = row[name]
    alone = impulse_rows(data, truth)
    of_impulse = {name: _pad([row[name] for row in alone], impulses) for name in _OF_IMPULSE}
    as_seen = {
        name: np.column_stack([_pad([row[f"{estimator}_{name}"] for row in alone], impulses) for estimator in own])
        for name in _AS_SEEN
    }
    return {truth_column(name): values for name, values in by_channel.items()} | {
        impulse_column(name): values for name, values in (of_impulse | as_seen).items()
    }


def true_yaw(data: ProfileData, truth: xr.Dataset) -> Array:
    """True yaw moment ``(n,)`` on the samples, N m."""
    return truth_on_samples(data, truth)[:, YAW]


def stored_yaw(archive: Archive, data: ProfileData) -> Array | None:
    """True yaw moment ``(n,)`` on a profile's samples, as stored in the group; None if no truth was given."""
    values: Array = archive[_GROUP].to_dataset()[TRUE_YAW].sel(profile=data.number).values[: len(data.time)]
    return values if np.isfinite(values).any() else None


def channel_table(archive: Archive, numbers: list[int]) -> pd.DataFrame:
    """Lag, correlation and gain relative to the truth, one row for each profile, channel and estimator with values."""
    group = archive[_GROUP].to_dataset().sel(profile=numbers)
    values = {name: group[truth_column(name)].values for name in _BY_CHANNEL}
    places = np.argwhere(np.isfinite(values["gain"])).tolist()
    channels, own = group["channel"].values, group["estimator"].values
    return pd.DataFrame(
        [
            {"profile": numbers[profile], "channel": str(channels[channel]), "estimator": str(own[estimator])}
            | {name: float(column[profile, channel, estimator]) for name, column in values.items()}
            for profile, channel, estimator in places
        ]
    )


def impulse_table(archive: Archive, numbers: list[int]) -> pd.DataFrame:
    """Isolated true yaw impulses in steady glide, with delay and height in both estimators, one row per impulse."""
    group = archive[_GROUP].to_dataset().sel(profile=numbers)
    columns = {name: group[impulse_column(name)].values for name in _OF_IMPULSE}
    columns |= {
        f"{own}_{name}": group[impulse_column(name)].values[:, :, index]
        for index, own in enumerate(map(str, group["estimator"].values))
        for name in _AS_SEEN
    }
    known = np.isfinite(columns["time"])
    profiles = np.repeat(numbers, known.sum(axis=1))
    return pd.DataFrame({"profile": profiles} | {name: values[known] for name, values in columns.items()})


def _pad(values: list[float], length: int) -> Array:
    return np.array(values + [np.nan] * (length - len(values)), dtype=np.float64)
