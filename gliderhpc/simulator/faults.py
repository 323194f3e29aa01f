"""What goes wrong with a record: gaps and false samples."""

from dataclasses import replace

import numpy as np

from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.simulator.sections import SensorErrors

_ANGLES = ("roll", "pitch", "heading")
_CHANNELS = (*_ANGLES, "depth")
_STEEPEST = np.radians(89.0)
_SHALLOWEST = -9.0
_TURN = 2.0 * np.pi


def with_faults(record: ProfileRecord, errors: SensorErrors, rng: np.random.Generator) -> ProfileRecord:
    """Put false samples and then gaps (NaN) into a record."""
    channels = {name: getattr(record, name).copy() for name in _CHANNELS}
    hours = float(record.time[-1] - record.time[0]) / 3600.0
    _falsify(channels, errors, rng.poisson(errors.outliers * hours), rng)
    _silence(channels, record.time, errors, rng.poisson(errors.dropouts * hours), rng)
    return replace(record, **channels)


def _falsify(channels: dict[str, FloatArray], errors: SensorErrors, count: int, rng: np.random.Generator) -> None:
    for _ in range(count):
        name, sample = _CHANNELS[rng.integers(4)], rng.integers(len(channels["depth"]))
        size = errors.outlier_depth if name == "depth" else np.radians(errors.outlier_angle)
        channels[name][sample] = _possible(name, channels[name][sample] + size * rng.standard_normal())


def _possible(name: str, value: float) -> float:
    """Nearest value that a file may hold."""
    if name == "depth":
        return max(value, _SHALLOWEST)
    if name == "heading":
        return value % _TURN
    limit = _STEEPEST if name == "pitch" else np.pi
    return float(min(max(value, -limit), limit))


def _silence(
    channels: dict[str, FloatArray], time: FloatArray, errors: SensorErrors, count: int, rng: np.random.Generator
) -> None:
    """Make gaps; compass and depth sensor fail apart."""
    for _ in range(count):
        begin, length = rng.uniform(time[0], time[-1]), rng.exponential(errors.dropout_length)
        names = _ANGLES if rng.random() < 0.5 else ("depth",)
        gap = (time >= begin) & (time <= begin + length)
        for name in names:
            channels[name][gap] = np.nan
