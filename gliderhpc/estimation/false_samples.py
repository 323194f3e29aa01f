"""Isolated false samples of a fast record: single values far from both neighbours, which agree with each other."""

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gliderhpc.estimation.settings import SLOW_SENSORS_PRIOR
from gliderhpc.observations.format import MEASURED
from gliderhpc.observations.records import FloatArray, ProfileRecord

_LEAST = {"roll": np.radians(5.0), "pitch": np.radians(5.0), "heading": np.radians(5.0), "depth": 3.0}
"""Least distance (rad, m) of a false sample from the mean of its neighbours."""
_TIMES = 18.0
"""Least ratio of this distance to its median over the record, about twelve standard deviations of noise."""
_AGREE = 0.5
"""Largest difference of the neighbours, over the distance."""


def without_false_samples(record: ProfileRecord) -> tuple[ProfileRecord, int]:
    """Return a record without its isolated false samples, and their number.

    A glider does not turn by 5 degrees, or sink by 3 m, and come back within two samples of a record at 2 s or faster.
    Such values come from the transmission or the sensors' electronics. They are set to NaN, each in its own variable.
    In slower records, single samples differ where the glider is steered.
    """
    cleaned = {name: _screened(record, name) for name in MEASURED}
    lost: dict[str, Any] = {name: values for name, (values, count) in cleaned.items() if count}
    return (replace(record, **lost) if lost else record), sum(count for _, count in cleaned.values())


def _screened(record: ProfileRecord, name: str) -> tuple[FloatArray, int]:
    values: FloatArray = getattr(record, name)
    present = np.flatnonzero(np.isfinite(values))
    times = record.time[present]
    if len(present) < 3 or np.median(np.diff(times)) > SLOW_SENSORS_PRIOR:
        return values, 0
    before, after = np.diff(values[present])[:-1], np.diff(values[present])[1:]
    if name == "heading":
        before, after = _wrapped(before), _wrapped(after)
    distance = 0.5 * np.abs(before - after)
    false = (
        (distance > max(_LEAST[name], _TIMES * float(np.median(distance))))
        & (np.abs(before + after) < _AGREE * distance)
        & (times[2:] - times[:-2] <= 3.0 * SLOW_SENSORS_PRIOR)
    )
    screened = values.copy()
    screened[present[1:-1][false]] = np.nan
    return screened, int(false.sum())


def _wrapped(angle: FloatArray) -> npt.NDArray[np.float64]:
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)
