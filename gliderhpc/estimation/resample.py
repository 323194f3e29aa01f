"""A profile's record on the integration steps: corrected for the sensors' errors, and interpolated.

Gaps are masked, heading is unwrapped, and controls are taken at the midpoints of the steps.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy
from numpy.typing import ArrayLike

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filled_values import without_filled_values
from gliderhpc.estimation.record_screening import (
    check_sensors,
    jointly_sampled,
    without_false_controls,
    without_false_samples,
)
from gliderhpc.estimation.settings import EstimationSettings, RecordSettings
from gliderhpc.observations.format import CONTROLS, MEASURED
from gliderhpc.observations.intervals import local_intervals, usual_interval, without_gaps
from gliderhpc.observations.nearest import nearest_rows
from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.observations.seawater import with_seawater
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform, Sensors
from gliderhpc.wording import counted

HARMONICS = ("sin", "cos", "sin 2", "cos 2")
"""Harmonics of the heading read, in the order of `RecordSettings.heading_deviation`."""

MIN_STORED = 3
"""Minimum number of stored records of a profile, from which slopes can be computed."""

_LAG_WINDOW = 11
"""Number of samples over which the record is smoothed for shifts by fractions of a sample interval."""

_ROUNDING = 1e-6
"""Tolerance (s) within which two times are equal."""


def on_steps(record: ProfileRecord, settings: EstimationSettings, platform: Platform | None = None) -> ProfileSeries:
    """Interpolate a corrected record to the integration steps, with the seawater along it.

    Attitude and depth in different rows are combined (`jointly_sampled`). Values that were filled in and isolated false
    samples are left out. The errors of the platform's sensors are removed first, then those given by the settings;
    without a platform, only the latter. The gap limit follows the local sample intervals of the record, since the
    sampling rate may change with depth.

    Raises
    ------
    ProfileError
        There is no time with all four measurements, or hardly any sample of one of them; heading or depth have stopped;
        the output interval leaves hardly any record; or the settings require density and the record has none.
    """
    lag = settings.records.actuator_lag + (0.0 if platform is None else platform.sensors.actuator_lag)
    record, filled = without_filled_values(jointly_sampled(record))
    check_sensors(record)
    record, false_samples = without_false_samples(record)
    record, false_controls = without_false_controls(record)
    record = corrected(record if platform is None else corrected(record, platform.sensors), settings.records)
    series = resample(record, settings.step, settings.gap_limit(sampling_intervals(record)), lag)
    series = replace(series, false_samples=false_samples, false_controls=false_controls, filled=filled)
    stored = (len(series.time) - 1) // settings.steps_per_record + 1
    if stored < MIN_STORED:
        raise ProfileError(
            f"profile {record.number}: an output_interval of {settings.output_interval:g} s leaves only "
            f"{counted(stored, 'record')} of the {series.time[-1]:.0f} s, but {MIN_STORED} are needed; make it smaller"
        )
    if settings.seawater == "depth_slope":
        return series
    series = with_seawater(series, record)
    if settings.seawater == "density" and series.seawater is None:
        raise ProfileError(
            f"profile {record.number}: {series.without_seawater}, but seawater=density requires the density; give "
            "`seawater=auto` to use the depth slope here"
        )
    return series


def harmonics(heading: ArrayLike) -> FloatArray:
    """Return sine and cosine ``(n, 4)`` of headings ``(n,)`` (rad) and of twice them, in the order of `HARMONICS`."""
    psi = np.asarray(heading, dtype=np.float64)
    return np.column_stack([np.sin(psi), np.cos(psi), np.sin(2.0 * psi), np.cos(2.0 * psi)])


def corrected(record: ProfileRecord, errors: RecordSettings | Sensors) -> ProfileRecord:
    """Remove the errors given by settings or a platform's sensors from a record; return it unchanged without any.

    The lag of the actuators is left in: `resample` removes it.
    """
    if all(getattr(errors, name) == error for name, error in RecordSettings().model_dump().items()):
        return record
    error = np.radians(errors.heading_offset + harmonics(record.heading) @ np.array(errors.heading_deviation))
    return replace(
        record,
        roll=record.roll - np.radians(errors.roll_offset),
        pitch=errors.pitch_scale * (record.pitch - np.radians(errors.pitch_offset)),
        heading=np.mod(record.heading - error, 2.0 * np.pi),
        depth=_shift_earlier(record.time, record.depth, errors.depth_lag),
    )


def _shift_earlier(time: FloatArray, values: FloatArray, lag: float) -> FloatArray:
    """Shift values to earlier times by a lag; NaN where the nearest sample is missing or outside the record.

    Each value is that of the nearest sample, plus the change of the smoothed record from there to the shifted time. A
    value interpolated between two samples would have less noise than either, and the most likely lag would be half an
    interval.
    """
    known = np.isfinite(values)
    if lag == 0.0 or not known.any():
        return values
    shifted = time + lag
    nearest = nearest_rows(time, shifted)
    # Times are smoothed in the same way, since intervals may be uneven.
    window = min(_LAG_WINDOW, 2 * ((int(known.sum()) - 1) // 2) + 1)
    at, smooth = (scipy.signal.savgol_filter(x[known], window, min(2, window - 1)) for x in (time, values))
    moved = values[nearest] + np.interp(shifted, at, smooth) - np.interp(time[nearest], at, smooth)
    inside = (shifted >= time[0]) & (shifted <= time[-1])
    return np.where(inside, moved, np.nan)


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
        attitude_interval=_attitude_interval(record),
        control_interval=_control_interval(record, present, time[:-1] + 0.5 * step - actuator_lag),
        partial=_partial_samples(record, start, step, steps),
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
        points, group, count = np.unique(nearest[known], return_inverse=True, return_counts=True)
        velocity[points, channel] = np.bincount(group, record.velocity[known, channel]) / count
        velocity_std[points, channel] = np.bincount(group, std[known, channel]) / count
    return velocity, velocity_std


def sampling_intervals(record: ProfileRecord) -> FloatArray:
    """Local interval (s) at each interval between samples with all four measurements (`local_intervals`).

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
        count = counted(len(indices), "sample")
        raise ProfileError(f"profile {record.number}: {name} has {count}, but at least 2 are needed")
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


def _control_interval(record: ProfileRecord, present: dict[str, npt.NDArray[np.int64]], at: FloatArray) -> FloatArray:
    """Longest interval (s) between the actuators' samples before and after each time; the rudder does not count."""
    intervals = np.zeros((len(CONTROLS), len(at)))
    for row, name in zip(intervals, CONTROLS, strict=True):
        sampled = record.time[present[name]]
        row[:] = np.diff(sampled)[np.clip(np.searchsorted(sampled, at) - 1, 0, len(sampled) - 2)]
    return np.asarray(intervals.max(axis=0))


def _in_gap(at: FloatArray, sampled: FloatArray, complete: FloatArray, limits: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask of the times strictly between two samples that are further apart than the local limit.

    No complete sample lies between two neighbouring samples of one measurement, so a single limit applies between them.
    """
    interval = np.clip(np.searchsorted(complete, sampled[:-1] + _ROUNDING) - 1, 0, len(limits) - 1)
    masked = np.zeros(len(at), dtype=bool)
    for index in np.flatnonzero(np.diff(sampled) > limits[interval] + _ROUNDING):
        masked |= (at > sampled[index] + _ROUNDING) & (at < sampled[index + 1] - _ROUNDING)
    return masked


def _bridged(intervals: FloatArray, limits: FloatArray) -> FloatArray:
    """Select the intervals that are not gaps; all intervals if every one is a gap."""
    bridged = intervals[intervals <= limits[: len(intervals)] + _ROUNDING]
    return bridged if len(bridged) else intervals


def _attitude_interval(record: ProfileRecord) -> float:
    """Usual interval (s) between samples that hold roll, pitch and heading, without gaps."""
    return usual_interval(without_gaps(np.diff(record.time[_known(record)[:, :3].all(axis=1)])))


def _complete_samples(record: ProfileRecord) -> FloatArray:
    """Find the times of the samples with all four measurements."""
    return record.time[_known(record).all(axis=1)]


def _partial_samples(record: ProfileRecord, start: float, step: float, steps: int) -> npt.NDArray[np.int64] | None:
    """Find points and columns of the measurements in samples that lack another one; None if there are none."""
    known = _known(record)
    partial = known & ~known.all(axis=1, keepdims=True)
    if not partial.any():
        return None
    points = [_nearest_points(record.time[column], start, step, steps) for column in partial.T]
    return np.column_stack([np.concatenate(points), np.repeat(np.arange(len(points)), list(map(len, points)))])


def _known(record: ProfileRecord) -> npt.NDArray[np.bool_]:
    return np.column_stack([np.isfinite(getattr(record, name)) for name in MEASURED])


def _nearest_points(sampled: FloatArray, start: float, step: float, steps: int) -> npt.NDArray[np.int64]:
    nearest = np.rint((sampled - start) / step).astype(np.int64)
    return np.unique(nearest[(nearest >= 0) & (nearest <= steps)])
