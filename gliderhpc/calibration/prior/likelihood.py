"""Likelihood of a disturbance prior on chosen records, and the whiteness of the filter's innovations.

By the prediction-error decomposition, the log-likelihood of a prior is the sum over a record's samples of the log
density of the innovation, ``-1/2 (e^2 / S + log S + log 2 pi)`` with the variance ``S`` that the filter expected. The
innovations of a filter whose model is true are white noise of unit variance.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_tail
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import INITIAL_DEVIATION, FilterEstimate, FilterTrials
from gliderhpc.estimation.innovations import log_density
from gliderhpc.estimation.preparation import (
    PreparedProfile,
    check_seawater,
    fed_samples,
    prepare_profile,
)
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.sensor_noise import measurement_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations import Observations, ProfileSeries
from gliderhpc.platform import DisturbancePrior, Platform
from gliderhpc.wording import most_frequent_reason

log = logging.getLogger("gliderhpc.tune")


def tuning_profiles(
    observations: Observations, platform: Platform, numbers: Sequence[int], longest: float, settings: EstimationSettings
) -> list[PreparedProfile]:
    """Read the profiles that a prior is tuned on; one that cannot be used is left out with a warning in the log.

    Parameters
    ----------
    observations, platform, settings : Observations, Platform, EstimationSettings
        Open file, hull, and settings of the records' preparation.
    numbers : sequence of int
        Profiles to read.
    longest : float
        Time from the start of a profile that is used, s.

    Raises
    ------
    InputError
        No profile can be used, or density is requested with a hull that states no compressibility.
    """
    check_seawater(platform, settings)
    profiles, reasons = [], []
    for number in numbers:
        try:
            profiles.append(_profile(observations, platform, number, longest, settings))
        except ProfileError as error:
            reasons.append(str(error))
            log.warning("profile %d is left out: %s", number, error)
    if not profiles:
        reason = most_frequent_reason(reasons or ["it has no profile"])
        raise InputError(f"{observations.path}: no profile to tune on can be used; {reason}")
    return profiles


def _profile(
    observations: Observations, platform: Platform, number: int, longest: float, settings: EstimationSettings
) -> PreparedProfile:
    series = _cut(on_steps(observations.profile(number), settings, platform), longest)
    profile = prepare_profile(Glider(platform), series)
    if not (fed_samples(series, settings) & ~profile.vibrating).any():
        raise ProfileError(f"profile {number}: no sample outside the vibration set is left to filter")
    return profile


def _cut(series: ProfileSeries, longest: float) -> ProfileSeries:
    n = min(len(series.controls), max(1, round(longest / series.step)))
    return replace(
        series,
        time=series.time[: n + 1],
        measurements=series.measurements[: n + 1],
        weights=series.weights[: n + 1],
        controls=series.controls[:n],
        seawater=None if series.seawater is None else series.seawater[:n],
        # The filter uses neither a measured velocity nor samples that lack one of the four measurements.
        velocity=None,
        velocity_std=None,
        partial=None,
        control_interval=None,
        sample_index=series.sample_index[series.sample_index <= n],
        gap_seconds=float(np.count_nonzero(series.weights[: n + 1] == 0.0)) * series.step,
    )


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PriorEvaluation:
    """Log-likelihood and innovations of the records under one prior.

    Attributes
    ----------
    log_likelihood : float
        Sum over the samples used and the restarts; comparable between priors on the same records.
    innovations, variances : (m, 4)
        Innovations and their variances at the fed samples of all profiles, one profile after another (rad, m and their
        squares); NaN for samples that are not used.
    rejected_fraction : tuple of float
        Ratio of gated, inflated and reset samples to fed ones, for each profile.
    """

    log_likelihood: float
    innovations: Array
    variances: Array
    rejected_fraction: tuple[float, ...]


class PriorLikelihood:
    """Log-likelihood of disturbance priors on some profiles, as a function to be maximised.

    Samples in the vibration set and soon after it are not used, because the filter is still recovering from motion
    that the model does not contain. Their choice depends on the actuators only, never on the prior. An innovation
    beyond the filter's gate is replaced by one at the gate, with the same variance. A restart counts as four such
    innovations with the variance of the initial state and the sensors. A prior therefore never gains by rejecting data.
    In an interpolated record, each fed sample is weighted by the ratio of the feed interval to the sample interval.

    Parameters
    ----------
    profiles : sequence of PreparedProfile
        Prepared profiles.
    settings : EstimationSettings
        Settings of the filter and of its records.
    recovery : float
        Time after the vibration set that is not used, s.

    Raises
    ------
    ProfileError
        No sample of a profile could be fed to the filter.
    """

    def __init__(
        self, profiles: Sequence[PreparedProfile], settings: EstimationSettings, *, recovery: float = 0.0
    ) -> None:
        self._trials = FilterTrials(profiles, settings)
        self._gate = settings.filter.gate
        self._profiles = [_ScoredSamples.of(profile, settings, recovery) for profile in profiles]
        self.weights = np.concatenate([np.full(len(p.counted), p.weight) for p in self._profiles])
        self.lengths = tuple(len(p.counted) for p in self._profiles)

    def evaluate(self, priors: Sequence[DisturbancePrior]) -> list[PriorEvaluation]:
        """Evaluate several priors together."""
        evaluations = {
            (candidate, profile): self._profiles[profile].evaluate(estimate, self._gate)
            for profile, candidate, estimate in self._trials.run(priors)
        }
        return [
            _join_evaluations([evaluations[candidate, profile] for profile in range(len(self._profiles))])
            for candidate in range(len(priors))
        ]

    def information(
        self, middle: PriorEvaluation, above: Sequence[PriorEvaluation], below: Sequence[PriorEvaluation], by: float
    ) -> Array:
        """Expected information on parameters, from the results with each of them raised and lowered.

        Parameters
        ----------
        middle : PriorEvaluation
            Result at the point.
        above, below : sequence of PriorEvaluation
            Results with parameter i raised and lowered by ``by``.
        by : float
            Half of the difference between the two.

        Returns
        -------
        (p, p) array
            ``sum over samples of (de/di de/dj) / S + (dS/di dS/dj) / (2 S^2)``, over samples inside the gate.
        """
        parts = (middle, *above, *below)
        inside = np.logical_and.reduce([p.innovations**2 < self._gate**2 * p.variances for p in parts])
        weights = np.broadcast_to(self.weights[:, None], inside.shape)[inside]
        deviation = np.sqrt(middle.variances[inside])

        def slopes(pairs: list[tuple[Array, Array]]) -> Array:
            rows = [(high[inside] - low[inside]) / (2.0 * by) for high, low in pairs]
            return np.reshape(rows, (len(pairs), inside.sum()))

        pairs = list(zip(above, below, strict=True))
        errors = slopes([(high.innovations, low.innovations) for high, low in pairs]) / deviation
        spreads = slopes([(np.log(high.variances), np.log(low.variances)) for high, low in pairs])
        return np.asarray((errors * weights) @ errors.T + 0.5 * (spreads * weights) @ spreads.T)


@dataclass(frozen=True, eq=False)
class _ScoredSamples:
    """Samples of a profile that are used, their weight, and the variances of the innovations assumed at a restart."""

    counted: NDArray[np.bool_]
    weight: float
    restart_variance: Array

    @classmethod
    def of(cls, profile: PreparedProfile, settings: EstimationSettings, recovery: float) -> "_ScoredSamples":
        series = profile.series
        fed = fed_samples(series, settings)
        interpolated = series.sample_interval > settings.filter.slow_feed
        variance = measurement_variance(profile.glider.platform, series, settings)
        weight = settings.filter.feed_interval / series.sample_interval if interpolated else 1.0
        return cls(_undisturbed(profile, recovery)[fed], weight, INITIAL_DEVIATION[:4] ** 2 + variance)

    def evaluate(self, estimate: FilterEstimate, gate: float) -> PriorEvaluation:
        """Evaluate a prior on one profile, from the filter's estimate with it."""
        innovations = np.where(self.counted[:, None], estimate.innovations, np.nan)
        variances = np.where(np.isfinite(innovations), estimate.innovation_variances, np.nan)
        restart = log_density(np.full(4, np.inf), self.restart_variance, gate).sum()
        total = np.nansum(log_density(innovations, variances, gate)) + restart * estimate.reset
        return PriorEvaluation(self.weight * float(total), innovations, variances, (estimate.rejected_fraction,))


def _undisturbed(profile: PreparedProfile, recovery: float) -> NDArray[np.bool_]:
    """Rows ``(n+1,)`` outside the vibration set and not within ``recovery`` seconds after it."""
    vibrating = np.append(0, np.cumsum(profile.vibrating))
    reach = round(recovery / profile.series.step)
    rows = np.arange(len(profile.vibrating))
    return np.asarray(vibrating[rows + 1] == vibrating[np.maximum(rows - reach, 0)])


def _join_evaluations(parts: Sequence[PriorEvaluation]) -> PriorEvaluation:
    """Join the evaluations of several profiles."""
    return PriorEvaluation(
        float(sum(part.log_likelihood for part in parts)),
        np.concatenate([part.innovations for part in parts]),
        np.concatenate([part.variances for part in parts]),
        tuple(share for part in parts for share in part.rejected_fraction),
    )


SENSORS = ("roll", "pitch", "heading", "depth")


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Statistics of one sensor's innovations, each over its expected standard deviation.

    Attributes
    ----------
    count : int
        Number of innovations.
    mean, variance : float
        Mean and variance; should be 0 and 1.
    autocorrelation : (k,)
        Autocorrelation at lags of 1 to k samples; should be 0 within about ``2 / sqrt(count)``.
    portmanteau : float
        Ljung and Box's statistic divided by the number of lags; should be about 1.
    p : float
        Probability of a larger statistic from white noise.
    """

    count: int
    mean: float
    variance: float
    autocorrelation: Array
    portmanteau: float
    p: float


def whiteness(normalised: Sequence[Array], lags: int) -> Whiteness:
    """Test the normalised innovations of one sensor in several profiles for whiteness.

    Parameters
    ----------
    normalised : sequence of (m,) arrays
        Innovations of each profile at the fed samples; NaN where missing. Pairs with a missing member, or from two
        profiles, are not used.
    lags : int
        Number of lags k.

    Notes
    -----
    ``Q = n (n + 2) sum over lags of r^2 / (number of pairs)`` is chi-squared with k degrees of freedom for white noise
    (Ljung and Box 1978).
    """
    known = np.concatenate([values[np.isfinite(values)] for values in normalised])
    # Constant innovations, as of a sensor that never changes by more than its resolution, cannot be tested.
    if len(known) <= lags or not known.var() > 0.0:
        return Whiteness(len(known), np.nan, np.nan, np.full(lags, np.nan), np.nan, np.nan)
    mean, variance = float(known.mean()), float(known.var())
    correlation, pairs = np.zeros(lags), np.zeros(lags)
    for lag in range(1, lags + 1):
        products = np.concatenate([(values[lag:] - mean) * (values[:-lag] - mean) for values in normalised])
        has_pair = np.isfinite(products)
        pairs[lag - 1] = max(has_pair.sum(), 1)
        correlation[lag - 1] = products[has_pair].sum() / (len(known) * variance)
    statistic = len(known) * (len(known) + 2.0) * float(np.sum(correlation**2 / pairs))
    return Whiteness(len(known), mean, variance, correlation, statistic / lags, chi_square_tail(statistic, lags))
