"""Vertical velocity of the water along one profile: rise of the glider in excess of its hull's glide in still water.

With the measured depth rate ``z'`` and the still-water one ``z'_m``, both positive down: ``w = z'_m - z'``, upward.
Its errors are those of the depth sensor (independent from sample to sample), of the attitude's rounding (alike along a
leg) and of the hull's numbers (alike along a mission).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.profiles import stretches
from gliderhpc.platform import Platform
from gliderhpc.studies.archived import CONTROLS_SI
from gliderhpc.studies.library.depth_rate import DepthRateFilter, depth_rate_filter
from gliderhpc.tuning.hull_parameters import PARAMETERS, PARAMETERS_BY_DENSITY, HullParameter, with_values
from gliderhpc.tuning.steady_balance import MeasuredAttitude, StillWaterGlide, still_water_glide

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

KEYS = (
    "buoyancy.neutral_volume", "buoyancy.depth_slope", "buoyancy.compressibility", "buoyancy.thermal_expansion",
    "viscous.K_D0", "viscous.K_D", "viscous.K_L", "viscous.K_beta",
)  # fmt: skip
"""The hull's numbers that its depth rate at a given attitude rests on."""

NAMES = tuple(key.rpartition(".")[2] for key in KEYS)
"""Their names in the tables."""


def suspects_of(*, by_density: bool) -> tuple[HullParameter, ...]:
    """Those of them that count, with their plausible deviations: by depth slope or by measured density."""
    return tuple(p for p in (PARAMETERS_BY_DENSITY if by_density else PARAMETERS) if p.key in KEYS)


MIN_DEPTH = 5.0
"""Shallower samples (m) are left out: waves, and a tail out of the water."""

SETTLING_TIME = 20.0
"""Seconds after the vibration set that are left out: the hull is still approaching its new glide."""

_DIFFERENCE = 0.02
_PITCH_DIFFERENCE = math.radians(0.05)


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
        Whether it is a calibration's; else each number has its plausible deviation, and none goes with another.
    """

    suspects: tuple[HullParameter, ...]
    covariance: Array
    calibrated: bool


@dataclass(frozen=True, eq=False)
class VerticalVelocity:
    """Vertical velocities at the n samples of a profile; NaN where there is none to be had.

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
