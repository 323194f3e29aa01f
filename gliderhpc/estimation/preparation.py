"""Preparation of a profile: its corrected record on the steps, with the hull's masses and the vibration set.

`prepare_profile` makes the common input of filter, smoother and windows. The other functions give properties of the
samples: the mask of those used, the interval at which they are fed, and their variance.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.errors import InputError
from gliderhpc.estimation.priors import is_slow
from gliderhpc.estimation.relative_velocity import RelativeVelocity, measured_velocity
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.buoyancy import DENSITY, PRESSURE, excess_weight
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import TYPICAL_COMPRESSIBILITY
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform, ballast_masses

Array = NDArray[np.float64]

_WEIGHT_QUANTILES = (0.1, 0.5, 0.9)
"""Quantiles of the weight in water over a profile that represent ascent, typical weight and descent."""


@dataclass(frozen=True, eq=False)
class PreparedProfile:
    """A profile on its ``n`` steps, the input of filter, smoother and windows.

    Attributes
    ----------
    glider, series : Glider, ProfileSeries
        Hull, and record on the steps.
    bodies : (n, 11)
        Mass properties from `Glider.bodies`.
    vibrating : (n+1,) array of bool
        Mask of the vibration set.
    initial_error : (12,) array, optional
        Error added to the first guess of the state (eq. 16, SI), to study its influence.
    velocity : RelativeVelocity, optional
        Measured velocity relative to the water, where the record has it.
    """

    glider: Glider
    series: ProfileSeries
    bodies: Array
    vibrating: NDArray[np.bool_]
    initial_error: Array | None = None
    velocity: RelativeVelocity | None = None

    @property
    def is_slow(self) -> bool:
        """Return whether the hull has slow sensors, or the record's attitude a long interval."""
        return is_slow(self.glider.platform, self.series.attitude_interval)

    @property
    def driving_weight(self) -> float:
        """Weight in water that drives the glider, N.

        It is half the difference between descent and ascent, on which an error of the neutral volume has no influence,
        or the typical weight if the profile has one leg only.
        """
        weight = self.glider.net_weight(self.bodies, self.series.measurements[:-1, 3])
        low, typical, high = np.nanquantile(weight, _WEIGHT_QUANTILES).tolist()
        half_difference = 0.5 * float(high - low)
        return half_difference if low < 0.0 < high else max(half_difference, abs(float(typical)))


def prepare_profile(glider: Glider, series: ProfileSeries, initial_error: Array | None = None) -> PreparedProfile:
    """Add the hull's mass properties and the vibration set to a record on the steps (`on_steps`)."""
    platform = glider.platform
    bodies = glider.bodies(controls_of(platform, series))
    vibrating = vibration_set(platform, series)
    velocity = measured_velocity(platform, series, ~vibrating)
    return PreparedProfile(glider, series, bodies, vibrating, initial_error, velocity)


def controls_of(platform: Platform, series: ProfileSeries) -> Array:
    """Controls ``(n, 5)`` = [r_px, gamma, m_b, m_m, rudder] from the actuators' records (docs/theory/model.md).

    Where the buoyancy uses measured density (`by_density`), a sixth control is the resulting additional weight.
    """
    return model_controls(platform, series.controls, series.seawater if by_density(platform, series) else None)


def by_density(platform: Platform, series: ProfileSeries) -> bool:
    """Return whether buoyancy uses measured density: the record has it, and the platform has a compressibility."""
    return series.seawater is not None and platform.buoyancy.compressibility is not None


def model_controls(platform: Platform, actuators: Array, seawater: Array | None = None) -> Array:
    """Controls as in `controls_of` from ``(n, 4)`` = [r_px, gamma, oil volume, rudder] and seawater ``(n, 4)``."""
    position, rotation, volume, rudder = actuators.T
    m_b, m_m = ballast_masses(platform, volume)
    columns = [position, rotation, m_b, m_m, rudder]
    if seawater is not None:
        columns.append(excess_weight(platform, volume, seawater))
    return np.column_stack(columns)


def check_seawater(platform: Platform, settings: EstimationSettings) -> None:
    """Refuse buoyancy by density for a hull without a compressibility.

    Raises
    ------
    InputError
        The settings require density, and the platform has no compressibility.
    """
    if settings.seawater == "density" and platform.buoyancy.compressibility is None:
        raise InputError(
            f"`seawater=density`: the platform {platform.name} states no buoyancy.compressibility; add it "
            "(1/dbar, as `gliderhpc calibrate` estimates it), or give `seawater=depth_slope`"
        )


def vibration_set(platform: Platform, series: ProfileSeries) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of the samples within the platform's guard time of an actuator that exceeds its threshold.

    The rates of battery translation, battery rotation and ballast are compared with `Platform.vibration`.
    """
    limits = platform.vibration
    thresholds = np.array([limits.battery_position_rate, limits.battery_rotation_rate_rad, limits.ballast_rate_m3])
    moving = np.zeros(len(series.time), dtype=np.uint8)
    for actuator, threshold in zip(series.controls[:, :3].T, thresholds, strict=True):
        moving[1:-1][np.abs(np.diff(actuator)) / series.step > threshold] = 1
    reach = 2 * round(limits.guard / series.step) + 1
    return np.asarray(scipy.ndimage.maximum_filter1d(moving, size=reach, mode="constant"), dtype=bool)


def steps_in(seconds: float, step: float) -> int:
    """Number of steps in a time (s), at least one."""
    return max(1, round(seconds / step))


def stated_variance(platform: Platform) -> Array:
    """Variance ``(4,)`` of one sample by the platform file: quantum squared over 12, depth noise squared (rad2, m2)."""
    attitude = platform.sensors.attitude_resolution_rad**2 / 12.0
    return np.array([attitude, attitude, attitude, platform.sensors.depth_noise**2])


def feed_interval(series: ProfileSeries, settings: EstimationSettings) -> float:
    """Interval (s) at which the filter is fed."""
    slow = series.sample_interval > settings.filter.slow_feed
    return settings.filter.feed_interval if slow else series.sample_interval


def fed_samples(series: ProfileSeries, settings: EstimationSettings) -> NDArray[np.bool_]:
    """Mask ``(n+1,)`` of the rows fed to the filter: the samples, or one row each feed interval of a slow record.

    All feeds have the same weight. Where a slow record is sampled several times as often as usual, it is therefore fed
    more often by the same factor, as far as the steps allow.
    """
    if series.sample_interval <= settings.filter.slow_feed:
        return recorded_samples(series)
    interval = steps_in(settings.filter.feed_interval, series.step)
    feeds = np.minimum(_relative_sampling_rate(series), interval)
    progress = np.arange(len(feeds)) * feeds
    return np.asarray(progress // interval > (progress - feeds) // interval) & _measured(series)


def _relative_sampling_rate(series: ProfileSeries) -> NDArray[np.int64]:
    """Sampling rate at each row ``(n+1,)`` relative to the usual one, a whole number, at least one."""
    rows = np.arange(len(series.measurements))
    if len(series.sample_index) < 2:
        return np.ones(len(rows), dtype=np.int64)
    intervals = np.diff(series.sample_index) * series.step
    interval = np.clip(np.searchsorted(series.sample_index, rows, side="right") - 1, 0, len(intervals) - 1)
    return np.maximum(1, np.rint(series.sample_interval / intervals[interval])).astype(np.int64)


def recorded_samples(series: ProfileSeries) -> NDArray[np.bool_]:
    """Rows ``(n+1,)`` that are samples of the record, none interpolated."""
    recorded = np.zeros(len(series.measurements), dtype=bool)
    recorded[series.sample_index] = True
    return recorded & _measured(series)


def recorded_values(series: ProfileSeries) -> NDArray[np.bool_]:
    """Mask ``(n+1, 4)`` of the measurements that are samples of the record, also where others were not measured."""
    recorded = np.repeat(recorded_samples(series)[:, None], 4, axis=1)
    if series.partial is not None:
        recorded[series.partial[:, 0], series.partial[:, 1]] = True
    return recorded & np.isfinite(series.measurements)


def _measured(series: ProfileSeries) -> NDArray[np.bool_]:
    # Column by column: a reduction along rows of four values takes ten times as long.
    has_value = np.logical_or.reduce([np.isfinite(column) for column in series.measurements.T])
    return np.asarray((series.weights > 0.0) & has_value)


_EQUAL_ANGLES = 1e-9
"""Largest difference (rad) of values that are considered equal."""


def repetitions(values: Array) -> NDArray[np.int64]:
    """Length ``(m,)`` of the run of equal values around each of ``values (m,)``; a NaN is a run of its own."""
    new = ~(np.abs(np.diff(values)) <= _EQUAL_ANGLES)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1]).astype(np.int64)
    counts = np.diff(np.append(starts, len(values)))
    return np.repeat(counts, counts)


# Measured density against the platform file's: the CTD's record or the neutral volume may be wrong

UNEXPECTED_DIFFERENCE = 5.0
"""Difference from the platform file's density, kg/m3, that is reported: a plausible deviation of the neutral volume."""


def surface_density(seawater: NDArray[np.float64]) -> float:
    """Median density (kg/m3) at surface pressure of seawater ``(n, 4)``, as in `gliderhpc.flight.buoyancy`."""
    return float(np.median(seawater[:, DENSITY] * (1.0 - TYPICAL_COMPRESSIBILITY * seawater[:, PRESSURE])))


def is_unexpected_density(platform: Platform, density: float) -> bool:
    """Return whether a density at the surface (kg/m3) is far from that of the platform file."""
    return abs(density - platform.buoyancy.water_density) >= UNEXPECTED_DIFFERENCE


def describe_unexpected_density(platform: Platform, series: ProfileSeries) -> str | None:
    """Describe a density far from the platform file's, with the remedy; None if it is near or not used.

    A hull that seems to be too heavy or too light may be right, and the record of temperature or salinity wrong.
    """
    if series.seawater is None or not by_density(platform, series):
        return None
    density = surface_density(series.seawater)
    if not is_unexpected_density(platform, density):
        return None
    return (
        f"the water has {density:.1f} kg/m3 (median, at surface pressure) and the platform file "
        f"{platform.buoyancy.water_density:g} (buoyancy.water_density): check the record's practical_salinity and "
        "temperature"
    )
