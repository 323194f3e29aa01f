"""Vertical velocity of the water along one profile: rise of the glider in excess of its hull's glide in still water.

With the measured depth rate ``z'`` and the still-water depth rate ``z'_m``, both positive down, the upward velocity is
``w = z'_m - z'``. Its errors come from the depth sensor (independent from sample to sample), from the rounding of the
attitude (common to a leg) and from the hull's parameters (common to a mission).

The depth rate is the slope of a straight line fitted to the samples in a window. This slope is a weighted mean of the
rate with parabolic weights. The same filter can therefore be applied to any known rate, such as that of the model or
of the water.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.archive.profile import RecordedProfile
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.estimation.smoother.vertical_motion import MIN_DEPTH, SETTLING_TIME
from gliderhpc.estimation.steady_balance import MeasuredAttitude
from gliderhpc.estimation.still_water_glide import StillWaterGlide, still_water_glide
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import (
    ATTITUDE_PARAMETERS,
    PARAMETERS,
    PARAMETERS_BY_DENSITY,
    HullParameter,
    stated_covariance,
    with_values,
)
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import CONTROLS_SI

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 60.0
MIN_INTERVALS = 4
"""Length of the window, s, and its least number of sample intervals."""

SLOW = 0.9
"""Quantile, by time, of the distances between samples that is used as the sample interval: the rate may change."""

MAX_PAUSE = 2.5
"""Longest pause within a stretch of samples, in sample intervals."""

_TOLERANCE = 1e-6
_MIN_LINE_SAMPLES = 3
"""Minimum number of samples of a straight line."""

KEYS = (
    "buoyancy.neutral_volume",
    "buoyancy.depth_slope",
    "buoyancy.compressibility",
    "buoyancy.thermal_expansion",
    "viscous.K_D0",
    "viscous.K_D",
    "viscous.K_L",
    "viscous.K_beta",
)
"""Hull parameters on which the depth rate at a given attitude depends."""

NAMES = tuple(key.rpartition(".")[2] for key in KEYS)
"""Names of these parameters in the tables."""

_DIFFERENCE = 0.02

_PITCH_DIFFERENCE = math.radians(0.05)


@dataclass(frozen=True, eq=False)
class DepthRateFilter:
    """Filter that computes slopes at n samples.

    Attributes
    ----------
    window : float
        Length of the window, s.
    operator : (n, n) sparse array
        Matrix that computes slopes from values.
    full_window : (n,) of bool
        True where the entire window lies within an unbroken stretch of samples. Elsewhere the operator uses the part
        within the stretch; the row is zero if that part has fewer than three samples.
    time : (n,)
        Times of the samples, s.
    """

    window: float
    operator: scipy.sparse.csr_array
    full_window: Mask
    time: Array

    def slopes(self, values: Array) -> Array:
        """Slope per second of values (n,) or (n, k); NaN where the window is cut short."""
        values_per_second = self.operator @ values
        values_per_second[~self.full_window] = np.nan
        return np.asarray(values_per_second)

    def with_truncated_windows(self, values: Array) -> Array:
        """Slope per second of values (n,) or (n, k), from a shorter window near the ends of a stretch."""
        return np.asarray(self.operator @ values)

    def filtered(self, rate: Array) -> Array:
        """Filter a rate that is given at the samples (n,) or (n, k) and linear in between."""
        steps = np.diff(self.time).reshape(-1, *[1] * (rate.ndim - 1))
        integral = np.cumsum(0.5 * steps * (rate[1:] + rate[:-1]), axis=0)
        return self.slopes(np.concatenate([np.zeros((1, *rate.shape[1:])), integral]))

    def noise(self, deviation: float) -> Array:
        """Standard deviation (n,) of the slope if every sample has an independent error."""
        return np.asarray(deviation * np.sqrt((self.operator.power(2)).sum(axis=1)))


def depth_rate_filter(time: Array, usable: Mask) -> DepthRateFilter:
    """Construct the filter for samples at times (s), some of which may not be usable.

    Notes
    -----
    The length of the window is `WINDOW`, or `MIN_INTERVALS` sample intervals if that is longer.
    """
    interval = usual_interval(without_gaps(np.diff(time)), SLOW) if len(time) > 1 else WINDOW
    window = max(WINDOW, MIN_INTERVALS * interval)
    first, count = np.zeros((2, len(time)), dtype=np.int64)
    full_window = np.zeros(len(time), dtype=np.bool_)
    for begin, end in unbroken(time, usable, MAX_PAUSE * interval):
        times = time[begin:end]
        first[begin:end] = begin + np.searchsorted(times, times - 0.5 * window - _TOLERANCE)
        count[begin:end] = begin + np.searchsorted(times, times + 0.5 * window + _TOLERANCE) - first[begin:end]
        full_window[begin:end] = (times - 0.5 * window >= times[0] - _TOLERANCE) & (
            times + 0.5 * window <= times[-1] + _TOLERANCE
        )
    count[count < _MIN_LINE_SAMPLES] = 0
    edges = np.append(0, np.cumsum(count))
    columns = np.arange(edges[-1]) + np.repeat(first - edges[:-1], count)
    operator = scipy.sparse.csr_array((_slope_weights(time[columns], count), columns, edges), shape=(len(time),) * 2)
    return DepthRateFilter(window, operator, full_window, time)


def _slope_weights(times: Array, count: NDArray[np.int64]) -> Array:
    """Weights of values in the slopes of straight lines, given the times of one window of ``count`` after the other.

    They are ``(t - m) / sum (t - m)^2`` with the mean ``m`` of a window's times.
    """
    filled = count[count > 0]
    begins = np.cumsum(filled) - filled
    # From the window's first time: the sums of large times would lose digits.
    lever = times - np.repeat(times[begins], filled)
    lever -= np.repeat(np.add.reduceat(lever, begins) / filled, filled) if len(filled) else 0.0
    squares = np.add.reduceat(lever**2, begins) if len(filled) else filled
    return np.asarray(lever / np.repeat(squares, filled))


def unbroken(time: Array, usable: Mask, longest: float) -> list[tuple[int, int]]:
    """Find the stretches of usable samples without a pause longer than `longest` (s)."""
    parts: list[tuple[int, int]] = []
    for begin, end in stretches(usable):
        breaks = begin + 1 + np.flatnonzero(np.diff(time[begin:end]) > longest)
        edges = [begin, *breaks.tolist(), end]
        parts += pairwise(edges)
    return parts


def transfer(cycles: float) -> float:
    """Response of the filter to a finely sampled sinusoidal velocity with a given number of cycles in the window."""
    x = np.pi * cycles
    return float(3.0 * (np.sin(x) - x * np.cos(x)) / x**3)


@cache
def half_power() -> float:
    """Number of cycles in the window at which half the power passes."""
    return float(scipy.optimize.brentq(lambda cycles: transfer(cycles) - np.sqrt(0.5), 0.1, 1.0))


def glide_parameters(*, by_density: bool) -> tuple[HullParameter, ...]:
    """Parameters among `KEYS` that act, with their plausible deviations: with depth slope or with measured density."""
    return tuple(p for p in (PARAMETERS_BY_DENSITY if by_density else PARAMETERS) if p.key in KEYS)


@dataclass(frozen=True, eq=False)
class ParameterErrors:
    """Errors of a hull's parameters.

    Attributes
    ----------
    parameters : tuple of HullParameter
        Parameters.
    covariance : (p, p) array
        Covariance of the parameters, in units of their plausible deviations.
    calibrated : bool
        True if the covariance is that of a calibration; otherwise each parameter has its plausible deviation, and the
        errors are uncorrelated.
    """

    parameters: tuple[HullParameter, ...]
    covariance: Array
    calibrated: bool


@dataclass(frozen=True, eq=False)
class VerticalVelocity:
    """Vertical velocities at the n samples of a profile; NaN where there is none.

    Attributes
    ----------
    record : (n,) int array
        Indices of the archive's records nearest to the samples.
    attitude : MeasuredAttitude
        Roll, pitch, rate of turn and depth of the samples.
    weight : (n,)
        Net weight in water, N, positive heavy.
    measured, model : (n,)
        Depth rates of the record and of the still-water glide, filtered alike, m/s, positive down.
    speed : (n,)
        Speed of the still-water glide through the water, not filtered, m/s.
    noise : (n,)
        Standard deviation due to the depth sensor's noise, m/s.
    by_pitch : (n,)
        Change of the water's velocity for one standard deviation of the pitch's rounding, m/s.
    by_hull : (n, p)
        Change of the water's velocity for the plausible deviation of each hull parameter, m/s.
    errors : ParameterErrors
        Errors of the hull parameters.
    filter : DepthRateFilter
        Filter from depths to velocities.
    """

    record: NDArray[np.int64]
    attitude: MeasuredAttitude
    weight: Array
    measured: Array
    model: Array
    speed: Array
    noise: Array
    by_pitch: Array
    by_hull: Array
    errors: ParameterErrors
    filter: DepthRateFilter

    @property
    def water(self) -> Array:
        """Vertical velocity of the water (n,), upward, m/s."""
        return self.model - self.measured

    @property
    def diving(self) -> Mask:
        """Mask (n,) of the samples with a velocity in downward glides."""
        return self.model > 0.0

    @property
    def climbing(self) -> Mask:
        """Mask (n,) of the samples with a velocity in upward glides."""
        return self.model < 0.0

    @property
    def hull_std(self) -> Array:
        """Standard deviation (n,) due to the hull's parameters, m/s."""
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", self.by_hull, self.errors.covariance, self.by_hull)))

    @property
    def std(self) -> Array:
        """Total standard deviation (n,), m/s."""
        return np.asarray(np.sqrt(self.noise**2 + self.by_pitch**2 + self.hull_std**2))


def hull_errors(platform: Platform, *, by_density: bool = False) -> ParameterErrors:
    """Errors of the hull's parameters: those of its calibration, and plausible ones for uncalibrated parameters.

    They are those for the attitude as measured. An error of the pitch shifts the calibrated hull so that its depth rate
    remains that of the glides; such errors of both therefore cancel.
    """
    parameters = glide_parameters(by_density=by_density)
    hull, attitude = slice(len(parameters)), slice(len(parameters), None)
    both = stated_covariance(platform, (*parameters, *ATTITUDE_PARAMETERS))
    through = np.linalg.lstsq(both[attitude, attitude], both[attitude, hull], rcond=None)[0]
    covariance = both[hull, hull] - both[hull, attitude] @ through
    return ParameterErrors(parameters, covariance, calibrated=platform.calibration is not None)


def vertical_velocity(data: RecordedProfile, platform: Platform) -> VerticalVelocity:
    """Find the vertical velocity of the water along a profile.

    Parameters
    ----------
    data : RecordedProfile
        The profile.
    platform : Platform
        The hull.

    Notes
    -----
    Values interpolated between samples are not used. Samples are used if they lie outside the vibration set and
    `SETTLING_TIME` after it, deeper than `MIN_DEPTH`, and if the hull has a steady glide there.
    """
    record = np.flatnonzero(data.sampled & np.isfinite(data.measured).all(axis=1))
    time, measured = data.record_time[record], data.measured[record]
    in_record = depth_rate_filter(time, np.ones(len(record), dtype=np.bool_))
    roll, pitch, turn_rate = np.radians([*measured[:, :2].T, in_record.with_truncated_windows(measured[:, 2])])
    attitude = MeasuredAttitude(roll, pitch, turn_rate, measured[:, 3])
    water = None if data.seawater is None else np.column_stack([measured[:, 3], data.seawater[record]])
    errors = hull_errors(platform, by_density=water is not None)
    hull = _Hull(platform, data.controls[record], attitude, water)
    glide, by_pitch, by_hull = hull.glide(), hull.by_pitch(), hull.by_numbers(errors.parameters)
    # A glide that would end after a small change of pitch or of a parameter is not used.
    glides = np.isfinite(glide.depth_rate + by_pitch + by_hull.sum(axis=1))
    usable = undisturbed(data)[record] & (measured[:, 3] > MIN_DEPTH) & glides
    rates = depth_rate_filter(time, usable)
    return VerticalVelocity(
        record,
        attitude,
        hull.weight(),
        rates.slopes(measured[:, 3]),
        rates.filtered(np.nan_to_num(glide.depth_rate)),
        np.where(usable, glide.speed, np.nan),
        rates.noise(platform.sensors.depth_noise),
        rates.filtered(np.nan_to_num(by_pitch)),
        rates.filtered(np.nan_to_num(by_hull)),
        errors,
        rates,
    )


class _Hull:
    """Hull at the samples of a profile, and sensitivity of its depth rate to pitch and parameters."""

    def __init__(self, platform: Platform, controls: Array, attitude: MeasuredAttitude, water: Array | None) -> None:
        self._platform, self._attitude, self._water = platform, attitude, water
        self._actuators = controls * CONTROLS_SI

    def glide(self) -> StillWaterGlide:
        """Glide in still water."""
        return self._glide(self._platform, self._attitude)

    def weight(self) -> Array:
        """Net weight in water (n,), N."""
        glider = Glider(self._platform)
        return glider.net_weight(self._bodies(glider), self._attitude.depth)

    def by_pitch(self) -> Array:
        """Change (n,) of the depth rate for one standard deviation of the pitch's rounding, m/s."""
        rates = [
            self._glide(
                self._platform,
                MeasuredAttitude(
                    self._attitude.roll, self._attitude.pitch + turn, self._attitude.turn_rate, self._attitude.depth
                ),
            ).depth_rate
            for turn in (_PITCH_DIFFERENCE, -_PITCH_DIFFERENCE)
        ]
        rounding = self._platform.sensors.attitude_resolution_rad / math.sqrt(12.0)
        return np.asarray(rounding * (rates[0] - rates[1]) / (2.0 * _PITCH_DIFFERENCE))

    def by_numbers(self, parameters: Sequence[HullParameter]) -> Array:
        """Change (n, p) of the depth rate for the plausible deviation of each parameter, m/s."""
        return np.column_stack([self._by_number(parameter) for parameter in parameters])

    def _by_number(self, parameter: HullParameter) -> Array:
        rates = [
            self._glide(
                with_values(self._platform, {parameter.key: parameter.moved(self._platform, steps)}), self._attitude
            ).depth_rate
            for steps in (_DIFFERENCE, -_DIFFERENCE)
        ]
        return np.asarray((rates[0] - rates[1]) / (2.0 * _DIFFERENCE))

    def _glide(self, platform: Platform, attitude: MeasuredAttitude) -> StillWaterGlide:
        glider = Glider(platform)
        return still_water_glide(glider, self._bodies(glider), attitude)

    def _bodies(self, glider: Glider) -> Array:
        return glider.bodies(model_controls(glider.platform, self._actuators, self._water))


def undisturbed(data: RecordedProfile) -> Mask:
    """Mask (m,) of the records in steady glide, settled after the vibration set."""
    steady = data.steady.copy()
    for _, end in stretches(data.flagged("vibration")):
        steady[end : end + round(SETTLING_TIME / data.step)] = False
    return data.on_records(steady)
