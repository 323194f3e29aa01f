"""Sensors of a simulated glider: samples, noise and quantisation, gaps and false samples."""

from dataclasses import replace

import numpy as np

from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.platform import Sensors
from gliderhpc.simulator.dive import Flight
from gliderhpc.simulator.sections import SensorErrors

_TURN = 2.0 * np.pi
_ROUNDING = 1e-6


def sample_times(flight: Flight, sensors: Sensors) -> FloatArray:
    """Return the times of the samples, s from the start of the profile."""
    count = int(np.floor(flight.duration / sensors.sample_interval + _ROUNDING)) + 1
    return np.arange(count, dtype=np.float64) * sensors.sample_interval


def states_at(flight: Flight, time: FloatArray) -> FloatArray:
    """Interpolate the true states ``(n, 12)`` linearly at times (s)."""
    grid = np.arange(len(flight.states), dtype=np.float64) * flight.step
    return _columns_at(time, grid, flight.states)


def carried_at(flight: Flight, time: FloatArray) -> FloatArray:
    """Interpolate the displacement by the water and the path length ``(n, 3)`` linearly at times (s)."""
    grid = np.arange(len(flight.carried), dtype=np.float64) * flight.step
    return _columns_at(time, grid, flight.carried)


def actuators_at(flight: Flight, time: FloatArray) -> FloatArray:
    """Interpolate the actual positions of the actuators ``(n, 3)`` linearly at times (s)."""
    midpoints = (np.arange(len(flight.actuators), dtype=np.float64) + 0.5) * flight.step
    return _columns_at(time, midpoints, flight.actuators)


def commands_at(flight: Flight, time: FloatArray) -> FloatArray:
    """Interpolate the actuators' commands ``(n, 3)`` linearly at times (s)."""
    grid = np.arange(len(flight.commands), dtype=np.float64) * flight.control_interval
    return _columns_at(time, grid, flight.commands)


def observe(
    flight: Flight,
    sensors: Sensors,
    errors: SensorErrors,
    rng: np.random.Generator,
    *,
    number: int,
    epoch: np.datetime64,
) -> ProfileRecord:
    """Record a flight, without its fixes.

    Parameters
    ----------
    flight : Flight
        True flight.
    sensors : Sensors
        Sample interval, attitude quantum and depth noise of the platform.
    errors : SensorErrors
        Factor of quantum and noise, kind of the attitude's errors, and its offsets.
    rng : numpy.random.Generator
        Random generator of the depth noise and, after it, of white errors of the attitude.
    number : int
        Number of the profile.
    epoch : numpy.datetime64
        Time of the first sample (ns, UTC).

    Returns
    -------
    ProfileRecord
        Record with quantised attitude including its offsets (or with white errors instead of quantisation), depth with
        noise, and the commands of the actuators.
    """
    time = sample_times(flight, sensors)
    states = states_at(flight, time)
    commands = commands_at(flight, time)
    depth_noise = errors.factor * sensors.depth_noise * rng.standard_normal(len(time))
    attitude = states[:, :3] + np.radians([errors.roll_offset, errors.pitch_offset, errors.heading_offset])
    quantum = errors.factor * sensors.attitude_resolution_rad
    if errors.attitude == "white":
        attitude += quantum / np.sqrt(12.0) * rng.standard_normal(attitude.shape)
    else:
        attitude = quantised(attitude, quantum)
    return ProfileRecord(
        number=number,
        epoch=epoch,
        time=time,
        roll=attitude[:, 0].copy(),
        pitch=attitude[:, 1].copy(),
        heading=np.mod(attitude[:, 2], _TURN),
        depth=states[:, 5] + depth_noise,
        battery_position=commands[:, 0],
        battery_rotation=commands[:, 1],
        ballast_volume=commands[:, 2],
        rudder=np.zeros(len(time)),
    )


def measured_velocity(
    states: FloatArray, errors: SensorErrors, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Velocity relative to the water as measured ``(n, 3)``, and its standard deviation, along states ``(n, 12)``."""
    deviation = errors.velocity_deviation or 0.0
    noise = deviation * rng.standard_normal((len(states), 3))
    return states[:, 6:9] + np.array(errors.velocity_offset) + noise, np.full((len(states), 3), deviation)


def quantised(values: FloatArray, quantum: float) -> FloatArray:
    """Round values to multiples of a quantum; a quantum of zero leaves them unchanged."""
    return np.rint(values / quantum) * quantum if quantum > 0.0 else values.copy()


def _columns_at(time: FloatArray, grid: FloatArray, columns: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(time, grid, column) for column in columns.T])


_ANGLES = ("roll", "pitch", "heading")
_CHANNELS = (*_ANGLES, "depth")
_STEEPEST = np.radians(89.0)
_SHALLOWEST = -9.0


def with_faults(record: ProfileRecord, errors: SensorErrors, rng: np.random.Generator) -> ProfileRecord:
    """Add false samples and then gaps (NaN) to a record."""
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
    """Nearest value in the valid range of a channel."""
    if name == "depth":
        return max(value, _SHALLOWEST)
    if name == "heading":
        return value % _TURN
    limit = _STEEPEST if name == "pitch" else np.pi
    return float(min(max(value, -limit), limit))


def _silence(
    channels: dict[str, FloatArray], time: FloatArray, errors: SensorErrors, count: int, rng: np.random.Generator
) -> None:
    """Make gaps, each either in all three angles or in the depth."""
    for _ in range(count):
        begin, length = rng.uniform(time[0], time[-1]), rng.exponential(errors.dropout_length)
        names = _ANGLES if rng.random() < 0.5 else ("depth",)
        gap = (time >= begin) & (time <= begin + length)
        for name in names:
            channels[name][gap] = np.nan
