"""The disturbance-augmented extended Kalman filter of section 4.1: the prior."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.initial_state import flight_guesses
from gliderhpc.estimation.settings import EstimationSettings, default_prior
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels import filter as kernel
from gliderhpc.observations.resample import ProfileSeries
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

INITIAL_DEVIATION = np.array([0.01, 0.01, 0.01, 0.0, 0.0, 0.2, 0.1, 0.02, 0.03, 0.02, 0.02, 0.02])
"""Standard deviation of the initial state: rad, m, m/s, rad/s; X and Y are zero by definition."""


@dataclass(frozen=True, eq=False)
class FilterEstimate:
    """What the filter leaves of one profile.

    Attributes
    ----------
    states : (n+1, 12)
        Filtered states (eq. 16), SI and rad.
    disturbances : (n+1, 6)
        Filtered disturbances, N and N m.
    gated, inflated, reset : int
        Samples with a rejected channel, with a widened variance inside the vibration set, and restarts.
    fed : int
        Samples the filter was fed.
    events : (n+1,) uint8
        What happened to each sample, as bits of `gliderhpc.kernels.filter`.
    """

    states: Array
    disturbances: Array
    gated: int
    inflated: int
    reset: int
    fed: int
    events: NDArray[np.uint8]

    @property
    def rejected_fraction(self) -> float:
        """Gated, inflated and reset samples over fed ones."""
        return (self.gated + self.inflated + self.reset) / max(self.fed, 1)

    def describe(self) -> str:
        """One clause with the counts."""
        return f"filter: {self.gated} gated, {self.inflated} inflated, {self.reset} reset of {self.fed} samples"


def run_filter(
    glider: Glider,
    series: ProfileSeries,
    bodies: Array,
    shaken: NDArray[np.bool_],
    settings: EstimationSettings,
    *,
    initial_error: Array | None = None,
) -> FilterEstimate:
    """Filter one profile (eqs. 19-27).

    Parameters
    ----------
    glider, series : Glider, ProfileSeries
        The hull and the resampled record, ``n`` steps.
    bodies : (n, 11)
        Mass properties from `Glider.bodies`.
    shaken : (n+1,)
        The vibration set.
    settings : EstimationSettings
        Uses ``step`` and ``filter``.
    initial_error : (12,) array, optional
        Added to the first guess of the state.

    Raises
    ------
    ProfileError
        When nothing could be fed.
    """
    platform, options = glider.platform, settings.filter
    n = len(bodies)
    measured = feed(series, settings)
    fed = int(np.isfinite(measured).any(axis=1).sum())
    if fed == 0:
        raise ProfileError("no sample of roll, pitch, heading and depth together is left to filter")
    guesses = flight_guesses(platform, series)
    if initial_error is not None:
        guesses[0] += initial_error
    prior = default_prior(platform)
    deviation = np.array(prior.deviation)
    decay = np.exp(-settings.step / np.array(prior.correlation_time))
    x0 = np.concatenate([guesses[0], np.zeros(6)])
    spread = np.concatenate([INITIAL_DEVIATION, deviation])
    patience = max(3, round(max(options.patience, 3.0 * series.sample_interval) / _feed_interval(series, settings)))
    states, disturbances, events = np.empty((n + 1, 12)), np.empty((n + 1, 6)), np.empty(n + 1, dtype=np.uint8)
    kernel.run_filter(
        glider.hull, bodies, x0, spread, settings.step, decay, deviation**2 * (1.0 - decay**2),
        options.vibration_noise_factor, measured, measurement_variance(platform, series, settings), guesses, shaken,
        options.gate, patience, states, disturbances, events,
    )  # fmt: skip
    gated, inflated, reset = (int((events & bit > 0).sum()) for bit in (kernel.GATED, kernel.INFLATED, kernel.RESET))
    return FilterEstimate(states, disturbances, gated, inflated, reset, fed, events)


def measurement_variance(platform: Platform, series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Variance ``(4,)`` of one fed sample: quantum squared over 12, depth noise squared (rad2, m2).

    A slow record is fed interpolated, at shorter intervals; its variance grows in proportion, so that no information is
    made up (model.md 5).
    """
    attitude = platform.sensors.attitude_resolution_rad**2 / 12.0
    variance = np.array([attitude, attitude, attitude, platform.sensors.depth_noise**2])
    if series.sample_interval > settings.filter.slow_feed:
        variance *= series.sample_interval / settings.filter.feed_interval
    return variance


def _feed_interval(series: ProfileSeries, settings: EstimationSettings) -> float:
    slow = series.sample_interval > settings.filter.slow_feed
    return settings.filter.feed_interval if slow else series.sample_interval


def feed(series: ProfileSeries, settings: EstimationSettings) -> Array:
    """Measurements where the filter is fed, NaN elsewhere: the samples themselves, or every second of a slow record."""
    measured = np.full_like(series.measurements, np.nan)
    if series.sample_interval > settings.filter.slow_feed:
        rows = np.arange(0, len(measured), max(1, round(settings.filter.feed_interval / series.step)))
    else:
        rows = np.unique(series.sample_index)
    rows = rows[series.weights[rows] > 0.0]
    measured[rows] = series.measurements[rows]
    return measured
