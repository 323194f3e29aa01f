"""Derivatives of a profile's problem with respect to errors of the hull and of its records, in plausible deviations.

These errors change the hull's constants, the mass properties along the profile, the corrected samples, and the prior of
the initial state, which is guessed from the first samples and the hull's steady glide.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import PreparedProfile, controls_of
from gliderhpc.estimation.resample import harmonics
from gliderhpc.estimation.self_motion import depth_rate, first_guess, smoothing_time
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, HullParameter, with_values
from gliderhpc.flight.packing import hull_of, masses_of
from gliderhpc.flight.steady_glide import glide_coefficients
from gliderhpc.kernels.sensitivity_memory import Forcing
from gliderhpc.kernels.smoother_memory import SmootherProblem
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform, Sensors

Array = NDArray[np.float64]

_RECORDS = "sensors."
_DIFFERENCE_STEP = 1e-3
"""Step, in plausible deviations, of the finite differences of the initial state's guess."""


def hull_forcing(
    profile: PreparedProfile,
    problem: SmootherProblem,
    records: RecordSettings,
    parameters: Sequence[HullParameter],
    attitude_and_depth: Array,
) -> Forcing:
    """Differentiate the problem of one profile by its parameters.

    Parameters
    ----------
    profile : PreparedProfile
        Profile on its ``n`` steps, with the hull about which the derivatives are taken.
    problem : SmootherProblem
        Problem of the profile.
    records : RecordSettings
        Corrections of the records, made after those of the hull's sensors.
    parameters : sequence of HullParameter
        The ``p`` parameters (`hull_parameters`).
    attitude_and_depth : (n+1, 4)
        Roll, pitch, heading (rad) and depth (m) at which the samples' derivatives are taken. Measured values would
        contain the samples' own errors, which would bias the scale of the pitch by ten of its deviations.
    """
    platform = profile.glider.platform
    constant, parameter, slope = _constants(platform, parameters)
    moving = [j for j, p in enumerate(parameters) if _may_change_bodies(platform, p)]
    reading = [j for j, p in enumerate(parameters) if _shifts_measurements(p)]
    bodies, row = _body_slopes(profile, [parameters[j] for j in moving])
    fed = np.flatnonzero(problem.fed)
    number = np.zeros(len(problem.fed), dtype=np.int64)
    number[fed] = np.arange(len(fed))
    return Forcing(
        constant=constant,
        parameter=parameter,
        slope=slope,
        moving=np.array(moving, dtype=np.int64),
        bodies=bodies,
        row=row,
        reading=np.array(reading, dtype=np.int64),
        samples=fed_sample_slopes(profile, problem, records, parameters, attitude_and_depth),
        number=number,
        start=_start_slopes(profile, records, parameters),
    )


def fed_sample_slopes(
    profile: PreparedProfile,
    problem: SmootherProblem,
    records: RecordSettings,
    parameters: Sequence[HullParameter],
    attitude_and_depth: Array,
) -> Array:
    """Differentiate the fed samples ``(f, 4, r)`` by the errors of the records, with arguments as in `hull_forcing`."""
    fed, rates = np.flatnonzero(problem.fed), depth_rate(profile.series)
    slopes = [
        sample_slopes(profile.glider.platform, records, p, attitude_and_depth[fed], rates[fed])
        for p in parameters
        if _shifts_measurements(p)
    ]
    return np.ascontiguousarray(np.stack(slopes, axis=2)) if slopes else np.zeros((len(fed), 4, 0))


def velocity_offsets(samples: int, deviation: float) -> Array:
    """Differentiate samples ``(f, 7, 3)`` by constant errors of the measured velocity relative to the water.

    Parameters
    ----------
    samples : int
        Number of samples.
    deviation : float
        Plausible deviation of the velocity's error, m/s.
    """
    slopes = np.zeros((samples, 7, 3))
    slopes[:, 4:] = -deviation * np.eye(3)
    return slopes


def vertical_motion_slopes(displacement: Array, channels: int) -> Array:
    """Differentiate samples ``(f, channels, k)`` by the water's displacements ``(f, k)`` downwards, m."""
    slopes = np.zeros((len(displacement), channels, displacement.shape[1]))
    slopes[:, 3] = -displacement
    return slopes


def with_sample_errors(forcing: Forcing, slopes: Array) -> Forcing:
    """Add parameters, after all others, that change nothing but the samples.

    Parameters
    ----------
    forcing : Forcing
        Derivatives by ``p`` parameters.
    slopes : (f, c, k)
        Derivatives of the samples by the ``k`` further parameters, for at least as many channels as so far.
    """
    (fed, channels, reading), (_, all_channels, added) = forcing.samples.shape, slopes.shape
    samples = np.zeros((fed, all_channels, reading + added))
    samples[:, :channels, :reading] = forcing.samples
    samples[:, :, reading:] = slopes
    return forcing._replace(
        reading=np.append(forcing.reading, len(forcing.start) + np.arange(added)),
        samples=samples,
        start=np.vstack([forcing.start, np.zeros((added, 16))]),
    )


def _moved(platform: Platform, parameter: HullParameter, deviations: float) -> Platform:
    """Return the platform moved along the parameter's tangent, which makes central differences of quadratics exact."""
    value = parameter.value(platform) + deviations * parameter.slope(platform, 0.0)
    return with_values(platform, {parameter.key: value})


def _constants(
    platform: Platform, parameters: Sequence[HullParameter]
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Nonzero derivatives of the hull's constants: constant, parameter, slope. The constants are linear."""
    slopes = np.array([
        0.5 * (np.array(hull_of(_moved(platform, p, 1.0))) - np.array(hull_of(_moved(platform, p, -1.0))))
        for p in parameters
    ])  # fmt: skip
    parameter, constant = np.nonzero(slopes)
    return constant.astype(np.int64), parameter.astype(np.int64), np.ascontiguousarray(slopes[parameter, constant])


def _shifts_measurements(parameter: HullParameter) -> bool:
    """Return whether a parameter is an error of the measured attitude or depth."""
    return parameter.key.startswith(_RECORDS) and parameter.key != ACTUATOR_LAG


def _may_change_bodies(platform: Platform, parameter: HullParameter) -> bool:
    moved = _moved(platform, parameter, 1.0)
    return masses_of(moved) != masses_of(platform) or parameter.key.startswith(("buoyancy.", ACTUATOR_LAG))


def _body_slopes(profile: PreparedProfile, moving: Sequence[HullParameter]) -> tuple[Array, NDArray[np.int64]]:
    """Derivatives ``(b, m, 11)`` of the mass properties, of second degree in the hull's numbers, and the steps' rows.

    They are computed where the controls change; in between they are constant. A lag acts where the controls are about
    to change, or have just changed.
    """
    platform, series = profile.glider.platform, profile.series
    controls = controls_of(platform, series)
    changes = np.append(True, (controls[1:] != controls[:-1]).any(axis=1))
    computed = changes | np.append(changes[1:], False) | np.append(False, changes[:-1])
    steps = np.flatnonzero(computed)
    series_there = _at_steps(series, steps)
    slopes = np.empty((len(steps), len(moving), 11))
    for j, parameter in enumerate(moving):
        if parameter.key == ACTUATOR_LAG:
            slopes[:, j] = -parameter.slope(platform, 0.0) * _body_rates(profile, steps)
            continue
        above, below = (_bodies(_moved(platform, parameter, sign), series_there) for sign in (1.0, -1.0))
        slopes[:, j] = 0.5 * (above - below)
    return slopes, np.cumsum(computed) - 1


def _body_rates(profile: PreparedProfile, steps: NDArray[np.int64]) -> Array:
    """Rates ``(s, 11)``, 1/s, at which the actuators change the mass properties at some steps."""
    series, platform = profile.series, profile.glider.platform
    later, earlier = (
        replace(_at_steps(series, steps), controls=_shifted_rows(series.controls, shift)[steps]) for shift in (1, -1)
    )
    return (_bodies(platform, later) - _bodies(platform, earlier)) / (2.0 * series.step)


def _at_steps(series: ProfileSeries, steps: NDArray[np.int64]) -> ProfileSeries:
    """Return the series with controls and seawater at some steps only."""
    seawater = None if series.seawater is None else series.seawater[steps]
    return replace(series, controls=series.controls[steps], seawater=seawater)


def _shifted_rows(rows: Array, shift: int) -> Array:
    """Return for each row the one ``shift`` rows later, or the last or first one beyond the ends."""
    return rows[np.clip(np.arange(len(rows)) + shift, 0, len(rows) - 1)]


def _bodies(platform: Platform, series: ProfileSeries) -> Array:
    return Glider(platform).bodies(controls_of(platform, series))


def sample_slopes(
    platform: Platform, records: RecordSettings, parameter: HullParameter, measurements: Array, rates: Array
) -> Array:
    """Derivative ``(n, 4)`` of corrected samples by an error of the records, per plausible deviation.

    Parameters
    ----------
    platform, records : Platform, RecordSettings
        Corrections in the order in which they were made (`corrected`).
    parameter : HullParameter
        Error of one of the platform's sensors.
    measurements, rates : (n, 4), (n,)
        Corrected roll, pitch, heading (rad) and depth (m), and the rate of the depth (m/s).
    """
    sensors = platform.sensors
    out = np.zeros(measurements.shape)
    name, *index = parameter.key.removeprefix(_RECORDS).split(".")
    degree = np.radians(parameter.slope(platform, 0.0))
    if name == "roll_offset":
        out[:, 0] = -degree
    elif name == "pitch_offset":
        out[:, 1] = -degree * sensors.pitch_scale * records.pitch_scale
    elif name == "pitch_scale":
        pitch = measurements[:, 1] + records.pitch_scale * np.radians(records.pitch_offset)
        out[:, 1] = parameter.slope(platform, 0.0) * pitch / sensors.pitch_scale
    elif name in ("heading_offset", "heading_deviation"):
        after_sensors = _heading_before(measurements[:, 2], records)
        harmonic = harmonics(_heading_before(after_sensors, sensors))[:, int(index[0])] if index else 1.0
        out[:, 2] = -degree * harmonic * _correction_slope(after_sensors, records)
    elif name == "depth_lag":
        out[:, 3] = parameter.slope(platform, 0.0) * rates
    else:
        raise ValueError(f"{parameter.key}: not an error of the records")
    return out


def _correction_slope(read: Array, errors: RecordSettings) -> Array:
    """Derivative ``(n,)`` of a corrected heading by the heading read."""
    sine, cosine, sine_twice, cosine_twice = np.radians(errors.heading_deviation)
    return np.asarray(
        1.0 - sine * np.cos(read) + cosine * np.sin(read)
        - 2.0 * (sine_twice * np.cos(2.0 * read) - cosine_twice * np.sin(2.0 * read))
    )  # fmt: skip


def _heading_before(heading: Array, errors: RecordSettings | Sensors) -> Array:
    """Heading before a correction, by fixed-point iteration, which converges since the correction's slope is small."""
    if not any(errors.heading_deviation):
        return np.asarray(heading + np.radians(errors.heading_offset))
    read = heading
    for _ in range(6):
        read = heading + np.radians(errors.heading_offset + harmonics(read) @ np.array(errors.heading_deviation))
    return read


def _start_slopes(profile: PreparedProfile, records: RecordSettings, parameters: Sequence[HullParameter]) -> Array:
    """Derivative ``(p, 16)`` of the guess of the initial state; the disturbances' prior mean is zero for any hull."""
    series, platform = profile.series, profile.glider.platform
    first = replace(series, measurements=series.measurements[: round(2.0 * smoothing_time(series) / series.step) + 2])
    rates = depth_rate(first)
    out = np.zeros((len(parameters), 16))
    for j, parameter in enumerate(parameters):
        above, below = (_moved(platform, parameter, sign * _DIFFERENCE_STEP) for sign in (1.0, -1.0))
        if _shifts_measurements(parameter):
            change = _DIFFERENCE_STEP * sample_slopes(platform, records, parameter, first.measurements, rates)
        elif glide_coefficients(above) != glide_coefficients(below):
            change = np.zeros_like(first.measurements)
        else:
            continue
        out[j, :10] = (_first_guess(above, first, change) - _first_guess(below, first, -change)) / (
            2.0 * _DIFFERENCE_STEP
        )
    return out


def _first_guess(platform: Platform, series: ProfileSeries, change: Array) -> Array:
    """Guess of the initial state ``(10,)`` from changed measurements."""
    changed = replace(series, measurements=series.measurements + change)
    return first_guess(platform, changed)
