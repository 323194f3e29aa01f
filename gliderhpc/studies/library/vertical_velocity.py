"""Vertical velocity of the water along one profile: rise of the glider in excess of its hull's glide in still water.

With the measured depth rate ``z'`` and the still-water one ``z'_m``, both positive down: ``w = z'_m - z'``, upward.
Its errors are those of the depth sensor (independent from sample to sample), of the attitude's rounding (alike along a
leg) and of the hull's numbers (alike along a mission).

Depth becomes a velocity by the slope of a straight line through the samples of a window. It is a weighted mean of the
rate with parabolic weights, so that anything whose rate is known can be put through the same filter: what a model sinks
at, or what the water does.
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

from gliderhpc.archive.profile import ProfileData
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import PARAMETERS, PARAMETERS_BY_DENSITY, HullParameter, with_values
from gliderhpc.observations.profiles import stretches
from gliderhpc.observations.resample import usual_interval, without_gaps
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import CONTROLS_SI
from gliderhpc.tuning.steady_balance import MeasuredAttitude, StillWaterGlide, still_water_glide

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WINDOW = 60.0
MIN_INTERVALS = 4
"""Length of the window, s, and how many sample intervals it has at least."""

SLOW = 0.9
"""Quantile by time of the distances between samples that counts as the sample interval: the rate may change."""

MAX_PAUSE = 2.5
"""Samples further apart than so many sample intervals do not belong together."""

_TOLERANCE = 1e-6

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
"""The hull's numbers that its depth rate at a given attitude rests on."""

NAMES = tuple(key.rpartition(".")[2] for key in KEYS)
"""Their names in the tables."""

MIN_DEPTH = 5.0
"""Shallower samples (m) are left out: waves, and a tail out of the water."""

SETTLING_TIME = 20.0
"""Seconds after the vibration set that are left out: the hull is still approaching its new glide."""

_DIFFERENCE = 0.02

_PITCH_DIFFERENCE = math.radians(0.05)


@dataclass(frozen=True, eq=False)
class DepthRateFilter:
    """Slopes at n samples.

    Attributes
    ----------
    window : float
        Length of the window, s.
    operator : (n, n) sparse array
        Makes slopes of values.
    whole : (n,) of bool
        Where the window lies within an unbroken stretch of samples; elsewhere the operator's row is that of the part
        that does, and no slope where that has less than three samples.
    time : (n,)
        Of the samples, s.
    """

    window: float
    operator: scipy.sparse.csr_array
    whole: Mask
    time: Array

    @property
    def half_power(self) -> float:
        """Frequency at which half the power passes, Hz."""
        return half_power() / self.window

    def of(self, values: Array) -> Array:
        """Slope a second of values (n,) or (n, k); NaN where the window is cut short."""
        slopes = self.operator @ values
        slopes[~self.whole] = np.nan
        return np.asarray(slopes)

    def cut_short_too(self, values: Array) -> Array:
        """The same, from a shorter window near the ends of a stretch."""
        return np.asarray(self.operator @ values)

    def of_rate(self, rate: Array) -> Array:
        """Filter a rate that is known at the samples (n,) or (n, k), linear in between."""
        steps = np.diff(self.time).reshape(-1, *[1] * (rate.ndim - 1))
        risen = np.cumsum(0.5 * steps * (rate[1:] + rate[:-1]), axis=0)
        return self.of(np.concatenate([np.zeros((1, *rate.shape[1:])), risen]))

    def noise(self, deviation: float) -> Array:
        """Standard deviation (n,) of the slope where every sample has an independent error."""
        return np.asarray(deviation * np.sqrt((self.operator.power(2)).sum(axis=1)))


def depth_rate_filter(time: Array, usable: Mask) -> DepthRateFilter:
    """Lay out the filter for samples at times (s) of which some are not usable.

    Notes
    -----
    The window is `WINDOW` long, or `MIN_INTERVALS` sample intervals where that is longer.
    """
    interval = usual_interval(without_gaps(np.diff(time)), SLOW) if len(time) > 1 else WINDOW
    window = max(WINDOW, MIN_INTERVALS * interval)
    rows, columns, weights = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    whole = np.zeros(len(time), dtype=np.bool_)
    for begin, end in unbroken(time, usable, MAX_PAUSE * interval):
        own = time[begin:end]
        first = np.searchsorted(own, own - 0.5 * window - _TOLERANCE)
        last = np.searchsorted(own, own + 0.5 * window + _TOLERANCE)
        whole[begin:end] = (own - 0.5 * window >= own[0] - _TOLERANCE) & (own + 0.5 * window <= own[-1] + _TOLERANCE)
        for row, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            if b - a > 2:
                lever = own[a:b] - own[a:b].mean()
                rows.append(np.full(b - a, begin + row))
                columns.append(np.arange(begin + a, begin + b))
                weights.append(lever / (lever @ lever))
    operator = scipy.sparse.csr_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(len(time), len(time))
    )
    return DepthRateFilter(window, operator, whole, time)


def unbroken(time: Array, usable: Mask, longest: float) -> list[tuple[int, int]]:
    """Find the stretches of usable samples that no pause longer than `longest` (s) interrupts."""
    parts: list[tuple[int, int]] = []
    for begin, end in stretches(usable):
        breaks = begin + 1 + np.flatnonzero(np.diff(time[begin:end]) > longest)
        edges = [begin, *breaks.tolist(), end]
        parts += pairwise(edges)
    return parts


def transfer(cycles: float) -> float:
    """Share that the filter leaves of a sinusoidal velocity of so many cycles in the window (finely sampled)."""
    x = np.pi * cycles
    return float(3.0 * (np.sin(x) - x * np.cos(x)) / x**3)


@cache
def half_power() -> float:
    """Cycles in the window at which half the power is left."""
    return float(scipy.optimize.brentq(lambda cycles: transfer(cycles) - np.sqrt(0.5), 0.1, 1.0))


def suspects_of(*, by_density: bool) -> tuple[HullParameter, ...]:
    """Those of them that count, with their plausible deviations: by depth slope or by measured density."""
    return tuple(p for p in (PARAMETERS_BY_DENSITY if by_density else PARAMETERS) if p.key in KEYS)


@dataclass(frozen=True, eq=False)
class HullErrors:
    """Errors of a hull's parameters.

    Attributes
    ----------
    suspects : tuple of HullParameter
        The numbers.
    covariance : (p, p) array
        Of these, in their plausible deviations.
    calibrated : bool
        True for a calibration's; else each number has its plausible deviation, and none goes with another.
    """

    suspects: tuple[HullParameter, ...]
    covariance: Array
    calibrated: bool


@dataclass(frozen=True, eq=False)
class VerticalVelocity:
    """Vertical velocities at the n samples of a profile; NaN where there is none.

    Attributes
    ----------
    record : (n,) int array
        Of the archive's records, those nearest to samples.
    attitude : MeasuredAttitude
        Roll, pitch, rate of turn and depth of the samples.
    weight : (n,)
        Net weight in water, N, positive heavy.
    measured, model : (n,)
        Depth rate of the record and of the still-water glide, filtered alike, m/s, positive down.
    speed : (n,)
        Of the still-water glide through the water, not filtered, m/s.
    noise : (n,)
        Standard deviation by the depth sensor's noise, m/s.
    by_pitch : (n,)
        Change of the water's velocity by the standard deviation of rounded pitch, m/s.
    by_hull : (n, p)
        The same by the plausible deviation of each of the hull's numbers, m/s.
    errors : HullErrors
        Errors of these parameters.
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
    errors: HullErrors
    filter: DepthRateFilter

    @property
    def water(self) -> Array:
        """Vertical velocity of the water (n,), upward, m/s."""
        return self.model - self.measured

    @property
    def diving(self) -> Mask:
        """Samples (n,) with a velocity, of glides downwards."""
        return self.model > 0.0

    @property
    def climbing(self) -> Mask:
        """Samples (n,) with a velocity, of glides upwards."""
        return self.model < 0.0

    @property
    def hull_std(self) -> Array:
        """Standard deviation (n,) by the hull's numbers, m/s."""
        return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", self.by_hull, self.errors.covariance, self.by_hull)))

    @property
    def std(self) -> Array:
        """Standard deviation (n,) in all, m/s."""
        return np.asarray(np.sqrt(self.noise**2 + self.by_pitch**2 + self.hull_std**2))


def hull_errors(platform: Platform, *, by_density: bool = False) -> HullErrors:
    """Errors of the hull's numbers: what its calibration states, and plausible ones of what that did not look at."""
    suspects, stated = suspects_of(by_density=by_density), platform.calibration
    covariance = np.eye(len(suspects))
    if stated is None:
        return HullErrors(suspects, covariance, calibrated=False)
    shared = [
        (i, stated.parameters.index(p.key))
        for i, p in enumerate(suspects)
        # A factor of nothing, such as a thermal expansion of zero, has no deviation to count in.
        if p.key in stated.parameters and p.slope(platform, 0.0) != 0.0
    ]
    ours, theirs = [i for i, _ in shared], [j for _, j in shared]
    units = np.array([abs(suspects[i].slope(platform, 0.0)) for i in ours])
    covariance[np.ix_(ours, ours)] = stated.covariance[np.ix_(theirs, theirs)] / np.outer(units, units)
    return HullErrors(suspects, covariance, calibrated=True)


def vertical_velocity(data: ProfileData, platform: Platform) -> VerticalVelocity:
    """Find the vertical velocity of the water along a profile.

    Parameters
    ----------
    data : ProfileData
        The profile; its measurements and controls are used, never what was estimated from them.
    platform : Platform
        The hull.

    Notes
    -----
    Only samples count, not values interpolated between them, outside the vibration set and `SETTLING_TIME` after it,
    deeper than `MIN_DEPTH`, where the hull has a steady glide.
    """
    record = np.flatnonzero(data.sampled & np.isfinite(data.measured).all(axis=1))
    time, measured = data.record_time[record], data.measured[record]
    in_record = depth_rate_filter(time, np.ones(len(record), dtype=np.bool_))
    roll, pitch, turn_rate = np.radians([*measured[:, :2].T, in_record.cut_short_too(measured[:, 2])])
    attitude = MeasuredAttitude(roll, pitch, turn_rate, measured[:, 3])
    water = None if data.seawater is None else np.column_stack([measured[:, 3], data.seawater[record]])
    errors = hull_errors(platform, by_density=water is not None)
    hull = _Hull(platform, data.controls[record], attitude, water)
    glide, by_pitch, by_hull = hull.glide(), hull.by_pitch(), hull.by_numbers(errors.suspects)
    # A glide that a small change of pitch or drag would end is not used.
    glides = np.isfinite(glide.depth_rate + by_pitch + by_hull.sum(axis=1))
    usable = _undisturbed(data)[record] & (measured[:, 3] > MIN_DEPTH) & glides
    rates = depth_rate_filter(time, usable)
    return VerticalVelocity(
        record,
        attitude,
        hull.weight(),
        rates.of(measured[:, 3]),
        rates.of_rate(np.nan_to_num(glide.depth_rate)),
        np.where(usable, glide.speed, np.nan),
        rates.noise(platform.sensors.depth_noise),
        rates.of_rate(np.nan_to_num(by_pitch)),
        rates.of_rate(np.nan_to_num(by_hull)),
        errors,
        rates,
    )


class _Hull:
    """A hull at the samples of a profile, and the sensitivity of its depth rate to pitch and parameters."""

    def __init__(self, platform: Platform, controls: Array, attitude: MeasuredAttitude, water: Array | None) -> None:
        self._platform, self._attitude, self._water = platform, attitude, water
        self._actuators = controls * CONTROLS_SI

    def glide(self) -> StillWaterGlide:
        """Its glide in still water."""
        return self._glide(self._platform, self._attitude)

    def weight(self) -> Array:
        """Its weight in water (n,), N."""
        glider = Glider(self._platform)
        return glider.net_weight(self._bodies(glider), self._attitude.depth)

    def by_pitch(self) -> Array:
        """Change (n,) of the depth rate by the standard deviation of rounded pitch, m/s."""
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

    def by_numbers(self, suspects: Sequence[HullParameter]) -> Array:
        """Change (n, p) of the depth rate by the plausible deviation of each number, m/s."""
        return np.column_stack([self._by_number(suspect) for suspect in suspects])

    def _by_number(self, suspect: HullParameter) -> Array:
        rates = [
            self._glide(
                with_values(self._platform, {suspect.key: suspect.moved(self._platform, steps)}), self._attitude
            ).depth_rate
            for steps in (_DIFFERENCE, -_DIFFERENCE)
        ]
        return np.asarray((rates[0] - rates[1]) / (2.0 * _DIFFERENCE))

    def _glide(self, platform: Platform, attitude: MeasuredAttitude) -> StillWaterGlide:
        glider = Glider(platform)
        return still_water_glide(glider, self._bodies(glider), attitude)

    def _bodies(self, glider: Glider) -> Array:
        return glider.bodies(model_controls(glider.platform, self._actuators, self._water))


def _undisturbed(data: ProfileData) -> Mask:
    """Records (m,) of steady glide, settled after the vibration set."""
    steady = data.steady.copy()
    for _, end in stretches(data.flagged("vibration")):
        steady[end : end + round(SETTLING_TIME / data.step)] = False
    return data.on_records(steady)
