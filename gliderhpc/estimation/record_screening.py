"""Screening of a record before it is put on steps: stopped sensors, false samples, and attitude apart from depth."""

from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.angles import wrap
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.priors import SLOW_SENSORS_PRIOR
from gliderhpc.observations.checks.heading_values import frozen_profiles, is_still
from gliderhpc.observations.format import CONTROLS, MEASURED, VARIABLES
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.nearest import onto_nearest, rarely_together
from gliderhpc.observations.profiles import equal_runs
from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.wording import counted

# Sensors that have stopped

_STUCK_TIME, _STUCK_SAMPLES = 120.0, 10
"""Duration (s) and number of samples beyond which a constant depth is not that of a glide."""
_SURFACE_DEPTH, _WHOLE_RECORD = 3.0, 0.9
"""A constant depth shallower than this (m) is accepted as time at the surface, unless it covers this fraction of the
record."""
_MIN_PITCH = np.radians(8.0)
"""Median magnitude of the pitch above which a glider moves up or down, rad."""


def check_sensors(record: ProfileRecord) -> None:
    """Refuse a record whose heading or depth stays the same to the last digit while the glider moves.

    Values of a steady glide that are only rounded are accepted. A heading that does not change would cause errors of
    the current of 0.1 to 0.16 m/s on twins, and a depth that does not, errors of the speed of 0.37 m/s, with stated
    deviations of 0.02 to 0.06 m/s.

    Raises
    ------
    ProfileError
        The heading stays the same to the last digit as in `frozen_profiles`, or the depth for two minutes of flight.
    """
    number = np.full(len(record.time), record.number, dtype=np.int64)
    reason = frozen_profiles(record.time, record.heading, record.pitch, record.roll, number).get(record.number)
    # A simulated glide without noise in a vertical plane keeps heading and roll.
    if reason is not None and not is_still(record.roll):
        raise ProfileError(reason)
    known = np.flatnonzero(np.isfinite(record.depth) & np.isfinite(record.pitch))
    time, depth, pitch = record.time[known], record.depth[known], record.pitch[known]
    for start, stop in equal_runs(depth, _STUCK_SAMPLES):
        duration = time[stop - 1] - time[start]
        angle = float(np.median(np.abs(pitch[start:stop])))
        is_below = depth[start] > _SURFACE_DEPTH or stop - start > _WHOLE_RECORD * len(depth)
        if duration >= _STUCK_TIME and angle > _MIN_PITCH and is_below:
            raise ProfileError(
                f"profile {record.number}: the depth stays at {depth[start]:.6g} m for {duration / 60.0:.0f} minutes, "
                f"from {time[start]:.0f} s on, at a pitch of {np.degrees(angle):.0f} degrees: the sensor had stopped, "
                "or the glider lay on the bottom; mark the depth missing (NaN) there, or end the profile before"
            )


# Isolated false samples of a fast record

_MIN_DISTANCE = {"roll": np.radians(5.0), "pitch": np.radians(5.0), "heading": np.radians(5.0), "depth": 3.0}
"""Minimum distance (rad, m) of a false sample from the mean of its neighbours."""
_MIN_RATIO = 18.0
"""Minimum ratio of this distance to its median over the record, about twelve standard deviations of noise."""
_MAX_DISAGREEMENT = 0.5
"""Maximum difference of the neighbours, as a fraction of this distance."""


def without_false_samples(record: ProfileRecord) -> tuple[ProfileRecord, int]:
    """Return a record without its isolated false samples, and their number.

    A false sample is a single value far from both neighbours, which agree with each other. A glider does not turn by 5
    degrees, or sink by 3 m, and come back within two samples of a record at 2 s or faster. Such values come from the
    transmission or the sensors' electronics. They are set to NaN, each in its own variable. In slower records, single
    samples differ where the glider is steered.
    """
    cleaned = {name: _screened(record, name) for name in MEASURED}
    changed: dict[str, Any] = {name: values for name, (values, count) in cleaned.items() if count}
    return (replace(record, **changed) if changed else record), sum(count for _, count in cleaned.values())


def _screened(record: ProfileRecord, name: str) -> tuple[FloatArray, int]:
    values: FloatArray = getattr(record, name)
    present = np.flatnonzero(np.isfinite(values))
    times = record.time[present]
    if len(present) < 3 or np.median(np.diff(times)) > SLOW_SENSORS_PRIOR:
        return values, 0
    before, after = np.diff(values[present])[:-1], np.diff(values[present])[1:]
    if name == "heading":
        before, after = wrap(before, 2.0 * np.pi), wrap(after, 2.0 * np.pi)
    distance = 0.5 * np.abs(before - after)
    false = (
        (distance > max(_MIN_DISTANCE[name], _MIN_RATIO * float(np.median(distance))))
        & (np.abs(before + after) < _MAX_DISAGREEMENT * distance)
        & (times[2:] - times[:-2] <= 3.0 * SLOW_SENSORS_PRIOR)
    )
    screened = values.copy()
    screened[present[1:-1][false]] = np.nan
    return screened, int(false.sum())


_MIN_EXCESS = {"battery_position": 0.1, "battery_rotation": np.radians(100.0), "ballast_volume": 500e-6}
"""Minimum distance (m, rad, m3) of a false sample of an actuator from the range of its other samples."""
_EXCESS, _RATE = 2.0, 2.0
"""The same as a multiple of that range; and minimum ratio of its rate to that of any other movement."""
_NEIGHBOURHOOD = 5
"""Number of samples whose median no run of one or two false samples reaches."""


def without_false_controls(record: ProfileRecord) -> tuple[ProfileRecord, tuple[str, ...]]:
    """Return a record without the isolated false samples of its actuators, and a sentence on each actuator with any.

    A false sample, alone or with one neighbour, is farther from the range of all others than twice this range, and the
    actuator would have reached it at twice the rate of any other movement. A movement of the actuator that the record
    hardly resolves is neither.
    """
    cleaned: dict[str, Any] = {}
    texts = []
    for name in CONTROLS:
        values: FloatArray = getattr(record, name)
        false = _false_controls(record.time, values, _MIN_EXCESS[name])
        if not len(false):
            continue
        cleaned[name] = values.copy()
        cleaned[name][false] = np.nan
        in_file = VARIABLES[name]
        first = values[false[0]] / in_file.si_factor
        found = counted(len(false), f"isolated false sample of {name} is", f"isolated false samples of {name} are")
        texts.append(
            f"{found} left out, the first {first:.4g} {in_file.unit} after {record.time[false[0]]:.0f} s; the"
            " actuator's other movements never come near this value: mark them missing (NaN)"
        )
    return (replace(record, **cleaned) if cleaned else record), tuple(texts)


def _false_controls(time: FloatArray, values: FloatArray, least: float) -> NDArray[np.int64]:
    """Rows of the false samples among the positions of an actuator, NaN where missing."""
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < 2 * _NEIGHBOURHOOD:
        return present[:0]
    at, known = time[present], values[present]
    usual = scipy.ndimage.median_filter(known, _NEIGHBOURHOOD, mode="mirror")
    excess = np.maximum(usual.min() - known, known - usual.max())
    intervals = np.diff(at)
    fastest = float(np.max(np.abs(np.diff(usual)) / intervals))
    slowest = np.maximum(np.append(intervals, 0.0), np.append(0.0, intervals))
    false = (excess > max(_EXCESS * float(np.ptp(usual)), least)) & (excess > _RATE * fastest * slowest)
    return np.asarray(present[false])


# Attitude and depth in different rows, as where files of two computers were joined by time


def jointly_sampled(record: ProfileRecord) -> ProfileRecord:
    """Move the attitude to the nearest rows with depth if the two are hardly ever in the same row.

    Nothing is interpolated or repeated: a sample is moved by at most half the interval between depths, and samples that
    are not nearest to a depth are not moved. Nor is the depth, which changes more within that time than the attitude.
    Other records are returned unchanged.

    Parameters
    ----------
    record : ProfileRecord
        The record as measured.

    Returns
    -------
    ProfileRecord
        Record with attitude and depth in the same rows.
    """
    if not rarely_together(*(np.isfinite(getattr(record, name)) for name in MEASURED)):
        return record
    deep = np.isfinite(record.depth)
    moved: dict[str, Any] = {
        name: _move_to_depth(record.time, getattr(record, name), deep) for name in MEASURED if name != "depth"
    }
    return replace(record, **moved)


def _move_to_depth(time: FloatArray, values: FloatArray, deep: NDArray[np.bool_]) -> FloatArray:
    """Return values ``(n,)``, each moved to the nearest row with depth if that is within reach."""
    rows, others = np.flatnonzero(deep), np.flatnonzero(np.isfinite(values) & ~deep)
    reach = 0.5 * usual_interval(without_gaps(np.diff(time[rows])))
    source = onto_nearest(time[rows], time[others], others.astype(np.float64), reach)
    is_target = np.isfinite(source) & np.isnan(values[rows])
    moved, result = source[is_target].astype(np.int64), values.copy()
    result[rows[is_target]] = values[moved]
    result[moved] = np.nan
    return result
