"""Intervals between samples, and resampling of a profile's records to the integration step.

The sampling rate of a real glider changes with depth. A median over samples would be dominated by the most densely
sampled part of the record, however short it is. Intervals are therefore weighted by their duration. In resampling,
gaps are masked, heading is unwrapped, and controls are taken at the midpoints of the steps.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import ProfileError
from gliderhpc.observations.format import CONTROLS, MEASURED
from gliderhpc.observations.records import FloatArray, ProfileRecord

NEIGHBOURS = 10
"""Number of intervals on either side from which the local interval is taken."""

_QUANTILE = 0.85
"""Quantile of the neighbours: the fourth longest of twenty."""

MIN_GAP, GAP = 10.0, 3.5
"""Least length of a gap, in seconds and in local intervals; a gap exceeds both."""

_BLOCK = 65_536
"""Number of intervals whose neighbours are processed together."""

_RESOLUTION = 6
"""Decimals to which intervals (s) are rounded (microseconds), which gives a uniform record a single interval."""


def usual_interval(intervals: npt.ArrayLike, share: float = 0.5) -> float:
    """Time-weighted median of the intervals, or another quantile.

    The fraction `share` of the total time passes in intervals no longer than the result.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s), without gaps.
    share : float
        Quantile, between 0 and 1.

    Returns
    -------
    float
        Quantile (s); NaN without any interval. For a uniform record the median equals the median over samples.
    """
    known = np.sort(np.round(np.asarray(intervals, dtype=np.float64), _RESOLUTION))
    if not len(known):
        return float("nan")
    passed = np.cumsum(known)
    return float(known[np.searchsorted(passed, share * passed[-1])])


def local_intervals(intervals: npt.ArrayLike) -> FloatArray:
    """Local sampling interval: the fourth longest of each interval's twenty neighbours.

    The interval itself is excluded. Near the ends of the record, with fewer neighbours, the same quantile is used. At a
    change of the sampling rate the result is the slower rate, because half of the neighbours have it. In bursts of up
    to five samples the result is the pause between the bursts. Up to three gaps close together have no effect.

    Parameters
    ----------
    intervals : (m,) array
        Times between neighbouring samples (s).

    Returns
    -------
    (m,) array
        Local intervals (s); a single interval is its own neighbour.
    """
    known = np.asarray(intervals, dtype=np.float64)
    if len(known) < 2:
        return known.copy()
    padded = np.pad(known, NEIGHBOURS, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * NEIGHBOURS + 1)
    # The neighbours take twenty times the memory of the record, so they are processed in blocks.
    return np.concatenate([_local_interval(around[start : start + _BLOCK]) for start in range(0, len(known), _BLOCK)])


def _local_interval(around: FloatArray) -> FloatArray:
    """Local interval of each interval, from the intervals with their neighbours ``(m, 21)``."""
    neighbours = np.sort(np.delete(around, NEIGHBOURS, axis=1), axis=1)
    count = np.isfinite(neighbours).sum(axis=1)
    place = np.ceil(_QUANTILE * count).astype(np.int64) - 1
    return np.take_along_axis(neighbours, place[:, None], axis=1)[:, 0]


def longest_bridged(local: npt.ArrayLike) -> FloatArray:
    """Longest time between samples (s) that is not a gap, from the local intervals of the record (s)."""
    return np.maximum(MIN_GAP, GAP * np.asarray(local, dtype=np.float64))


def without_gaps(intervals: npt.ArrayLike) -> FloatArray:
    """Select the intervals (s) that are not gaps."""
    known = np.asarray(intervals, dtype=np.float64)
    return known[known <= longest_bridged(local_intervals(known))]


_ROUNDING = 1e-6
"""Tolerance (s) within which two times are equal."""


@dataclass(frozen=True, eq=False)
class ProfileSeries:
    """One profile on a uniform grid of n steps (n + 1 points).

    Attributes
    ----------
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of the record's first sample (ns, UTC).
    step : float
        Spacing of the grid points (s).
    time : (n + 1,) array
        Seconds since `epoch`; the first is not 0 if the start of the record was unusable.
    measurements : (n + 1, 4) array
        Roll, pitch, heading (rad, heading unwrapped) and depth (m).
    weights : (n + 1,) array
        0 inside gaps of any of the four measurements, 1 elsewhere.
    controls : (n, 4) array
        Battery position (m), battery rotation (rad), ballast volume (m3), rudder (rad) at the midpoint of each step.
    sample_interval : float
        Interval between samples that hold all four measurements: the time-weighted median without gaps (s).
    gap_seconds : float
        Time with zero weight (s).
    sample_index : (m,) int array
        Grid points nearest to the samples that hold all four measurements.
    seawater : (n, 4) array or None
        Depth (m), in-situ density (kg/m3), in-situ temperature (degC) and pressure (dbar) at the midpoint of each step;
        None if they are unknown (`gliderhpc.observations.seawater`).
    without_seawater : str
        Reason why they are unknown; empty if they are known or were not requested.
    velocity, velocity_std : (n + 1, 3) arrays or None
        Measured velocity relative to the water and its standard deviation (m/s), means over the samples nearest to each
        point, NaN elsewhere; None if the record has none.
    """

    number: int
    epoch: np.datetime64
    step: float
    time: FloatArray
    measurements: FloatArray
    weights: FloatArray
    controls: FloatArray
    sample_interval: float
    gap_seconds: float
    sample_index: npt.NDArray[np.int64]
    seawater: FloatArray | None = None
    without_seawater: str = ""
    velocity: FloatArray | None = None
    velocity_std: FloatArray | None = None

    def sampled_records(self, every: int) -> npt.NDArray[np.bool_]:
        """Mask ``(n // every + 1,)`` of the records, `every` steps apart, that are nearest to samples."""
        sampled = np.zeros((len(self.time) - 1) // every + 1, dtype=np.bool_)
        nearest = np.rint(self.sample_index / every).astype(np.int64)
        sampled[nearest[nearest < len(sampled)]] = True
        return sampled


def resample(
    record: ProfileRecord, step: float, max_gap: float | FloatArray, actuator_lag: float = 0.0
) -> ProfileSeries:
    """Interpolate a profile linearly onto a uniform grid.

    The grid spans the time in which all four measurements exist. Missing samples are bridged variable by variable. If
    two neighbouring samples of any measurement are more than `max_gap` apart, the grid points between them have zero
    weight. Weights do not depend on the distance to the nearest sample: interpolation onto the step acts as a mild
    regularisation of the inversion, and weighting only the measured samples instead doubles the surge error.

    Parameters
    ----------
    record : ProfileRecord
        The record as measured.
    step : float
        Spacing of the grid points (s), positive.
    max_gap : float or (m - 1,) array
        Longest time between samples that is bridged (s), everywhere or in each interval between the ``m`` samples that
        hold all four measurements (`sampling_intervals`).
    actuator_lag : float
        Delay of the actuators behind their records (s): the controls at a time are those recorded this much earlier.
        Before the first sample they are the first.

    Returns
    -------
    ProfileSeries
        Profile with ``n = floor(duration / step)`` steps.

    Raises
    ------
    ProfileError
        A variable has fewer than two samples, or the measurements have no common time.
    """
    if not step > 0.0:
        raise ValueError(f"step must be positive, not {step}")
    present = {name: _present(record, name) for name in (*MEASURED, *CONTROLS)}
    start = max(record.time[present[name][0]] for name in MEASURED)
    end = min(record.time[present[name][-1]] for name in MEASURED)
    steps = int(np.floor((end - start) / step + _ROUNDING))
    if steps < 1:
        raise ProfileError(f"profile {record.number}: roll, pitch, heading and depth have no time in common")
    time = start + step * np.arange(steps + 1)
    complete = _complete_samples(record)
    velocity, velocity_std = _velocity_at_points(record, start, step, steps)
    intervals = np.diff(complete)
    limits = np.broadcast_to(max_gap, intervals.shape) if len(intervals) else np.full(1, np.max(max_gap))
    weights = np.ones(steps + 1)
    for name in MEASURED:
        weights[_in_gap(time, record.time[present[name]], complete, limits)] = 0.0
    return ProfileSeries(
        number=record.number,
        epoch=record.epoch,
        step=step,
        time=time,
        measurements=np.column_stack([_interpolate(record, name, present[name], time) for name in MEASURED]),
        weights=weights,
        controls=_controls(record, present, time[:-1] + 0.5 * step - actuator_lag),
        sample_interval=usual_interval(_bridged(intervals, limits)),
        gap_seconds=float(np.count_nonzero(weights == 0.0)) * step,
        sample_index=_nearest_points(complete, start, step, steps),
        velocity=velocity,
        velocity_std=velocity_std,
    )


def _velocity_at_points(
    record: ProfileRecord, start: float, step: float, steps: int
) -> tuple[FloatArray | None, FloatArray | None]:
    """Means of velocity and standard deviation ``(n + 1, 3)`` over the samples nearest to each point."""
    if record.velocity is None or not np.isfinite(record.velocity).any():
        return None, None
    nearest = np.rint((record.time - start) / step).astype(np.int64)
    std = np.full_like(record.velocity, np.nan) if record.velocity_std is None else record.velocity_std
    velocity, velocity_std = np.full((2, steps + 1, 3), np.nan)
    for channel in range(3):
        known = np.isfinite(record.velocity[:, channel]) & (nearest >= 0) & (nearest <= steps)
        points, place, count = np.unique(nearest[known], return_inverse=True, return_counts=True)
        velocity[points, channel] = np.bincount(place, record.velocity[known, channel]) / count
        velocity_std[points, channel] = np.bincount(place, std[known, channel]) / count
    return velocity, velocity_std


def sampling_intervals(record: ProfileRecord) -> FloatArray:
    """Local interval (s) at each interval between samples that hold all four measurements (`local_intervals`).

    Raises
    ------
    ProfileError
        There are fewer than two such samples.
    """
    times = _complete_samples(record)
    if len(times) < 2:
        raise ProfileError(f"profile {record.number}: roll, pitch, heading and depth are never measured together")
    return local_intervals(np.diff(times))


def _present(record: ProfileRecord, name: str) -> npt.NDArray[np.int64]:
    """Find the samples in which the variable `name` is present."""
    indices = np.flatnonzero(np.isfinite(getattr(record, name)))
    if len(indices) < 2:
        raise ProfileError(f"profile {record.number}: {name} has {len(indices)} samples, but at least 2 are needed")
    return indices


def _interpolate(record: ProfileRecord, name: str, present: npt.NDArray[np.int64], at: FloatArray) -> FloatArray:
    values: FloatArray = getattr(record, name)[present]
    if name == "heading":
        values = np.unwrap(values)
    return np.interp(at, record.time[present], values)


def _controls(record: ProfileRecord, present: dict[str, npt.NDArray[np.int64]], at: FloatArray) -> FloatArray:
    rudder = np.flatnonzero(np.isfinite(record.rudder))
    columns = [_interpolate(record, name, present[name], at) for name in CONTROLS]
    columns.append(np.interp(at, record.time[rudder], record.rudder[rudder]) if len(rudder) else np.zeros(len(at)))
    return np.column_stack(columns)


def _in_gap(at: FloatArray, sampled: FloatArray, complete: FloatArray, limits: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the times strictly between two samples that are further apart than the local limit.

    No complete sample lies between two neighbouring samples of one measurement, so a single limit applies between them.
    """
    there = np.clip(np.searchsorted(complete, sampled[:-1] + _ROUNDING) - 1, 0, len(limits) - 1)
    masked = np.zeros(len(at), dtype=bool)
    for index in np.flatnonzero(np.diff(sampled) > limits[there] + _ROUNDING):
        masked |= (at > sampled[index] + _ROUNDING) & (at < sampled[index + 1] - _ROUNDING)
    return masked


def _bridged(intervals: FloatArray, limits: FloatArray) -> FloatArray:
    """Select the intervals that are not gaps; all intervals if every one is a gap."""
    bridged = intervals[intervals <= limits[: len(intervals)] + _ROUNDING]
    return bridged if len(bridged) else intervals


def _complete_samples(record: ProfileRecord) -> FloatArray:
    """Find the times of the samples that hold all four measurements."""
    complete = np.all([np.isfinite(getattr(record, name)) for name in MEASURED], axis=0)
    return record.time[complete]


def _nearest_points(sampled: FloatArray, start: float, step: float, steps: int) -> npt.NDArray[np.int64]:
    nearest = np.rint((sampled - start) / step).astype(np.int64)
    return np.unique(nearest[nearest <= steps])


def averages_between(values: FloatArray, edges: FloatArray, wanted: FloatArray) -> FloatArray:
    """Average piecewise-constant columns over other steps, exactly.

    Parameters
    ----------
    values : (n, k) array
        Columns; row i applies from ``edges[i]`` to ``edges[i + 1]``.
    edges : (n + 1,) array
        Edges of the steps of `values`, increasing.
    wanted : (m + 1,) array
        Edges of the steps to average over, increasing; beyond `edges` the values are taken as zero.

    Returns
    -------
    (m, k) array
    """
    integral = np.vstack([np.zeros(values.shape[1]), np.cumsum(values * np.diff(edges)[:, None], axis=0)])
    at_wanted = np.column_stack([np.interp(wanted, edges, column) for column in integral.T])
    return np.asarray(np.diff(at_wanted, axis=0) / np.diff(wanted)[:, None])
