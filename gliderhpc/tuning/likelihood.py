"""Likelihood of a disturbance prior: how well the filter, given it, foresees each sample from those before.

The prediction-error decomposition: what a record says of a prior is the sum over its samples of the log density of the
innovation, ``-1/2 (e^2 / S + log S + log 2 pi)`` with the variance ``S`` that the filter expected of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.filter import (
    INITIAL_DEVIATION,
    FilterEstimate,
    FilterRequest,
    FilterTrials,
    fed_samples,
    measurement_variance,
)
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import DisturbancePrior

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the records say of one prior.

    Attributes
    ----------
    log_likelihood : float
        Sum over the samples that count and the restarts; comparable between priors on the same records.
    innovations, variances : (m, 4)
        Of the fed samples of all profiles, one after the other (rad, m and their squares); NaN where none counts.
    rejected_fraction : tuple of float
        Each profile's gated, inflated and reset samples over fed ones.
    """

    log_likelihood: float
    innovations: Array
    variances: Array
    rejected_fraction: tuple[float, ...]


class PriorLikelihood:
    """Log-likelihood of disturbance priors on some profiles, as a function to be maximised.

    Samples in the vibration set do not count, nor those soon after it, where what the model missed of the motion is
    still being found out: which ones they are depends on the actuators, not on the prior. An innovation beyond the
    filter's gate counts as one at the gate, with the variance it was held against; a restart counts as four such
    innovations with the variance of the initial state. So a prior never gains by having data rejected. A record fed
    interpolated counts as often as it was sampled: each fed sample by the share of an interval.

    Parameters
    ----------
    requests : sequence of FilterRequest
        The profiles.
    settings : EstimationSettings
        Uses ``step`` and ``filter``.
    recovery : float
        Seconds after the vibration set that do not count.

    Raises
    ------
    ProfileError
        When nothing of a profile could be fed.
    """

    def __init__(
        self, requests: Sequence[FilterRequest], settings: EstimationSettings, *, recovery: float = 0.0
    ) -> None:
        self._trials = FilterTrials(requests, settings)
        self._gate = settings.filter.gate
        self._profiles = [_Weighing.of(request, settings, recovery) for request in requests]
        self.weights = np.concatenate([np.full(len(p.counted), p.weight) for p in self._profiles])
        self.lengths = tuple(len(p.counted) for p in self._profiles)

    def judge(self, priors: Sequence[DisturbancePrior]) -> list[Judgement]:
        """Judge priors side by side."""
        found = {
            (candidate, profile): self._profiles[profile].weigh(estimate, self._gate)
            for profile, candidate, estimate in self._trials.run(priors)
        }
        return [
            _together([found[candidate, profile] for profile in range(len(self._profiles))])
            for candidate in range(len(priors))
        ]

    def information(
        self, middle: Judgement, above: Sequence[Judgement], below: Sequence[Judgement], by: float
    ) -> Array:
        """Expected information on parameters, from judgements with each of them raised and lowered.

        Parameters
        ----------
        middle : Judgement
            At the point.
        above, below : sequence of Judgement
            With parameter i more and less by ``by``.
        by : float
            Half of the difference.

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


def log_density(innovations: Array, variances: Array, gate: float) -> Array:
    """Log density of innovations, those beyond ``gate`` standard deviations as if at the gate."""
    squares = np.minimum(innovations**2 / variances, gate**2)
    return np.asarray(-0.5 * (squares + np.log(2.0 * np.pi * variances)))


@dataclass(frozen=True, eq=False)
class _Found:
    log_likelihood: float
    innovations: Array
    variances: Array
    rejected_fraction: float


@dataclass(frozen=True, eq=False)
class _Weighing:
    """How a profile's samples count: which ones, how much each, and the variance that restarts are charged with."""

    counted: NDArray[np.bool_]
    weight: float
    restart_variance: Array

    @classmethod
    def of(cls, request: FilterRequest, settings: EstimationSettings, recovery: float) -> "_Weighing":
        series = request.series
        fed = fed_samples(series, settings)
        interpolated = series.sample_interval > settings.filter.slow_feed
        variance = measurement_variance(request.glider.platform, series, settings)
        weight = settings.filter.feed_interval / series.sample_interval if interpolated else 1.0
        return cls(_undisturbed(request, recovery)[fed], weight, INITIAL_DEVIATION[:4] ** 2 + variance)

    def weigh(self, estimate: FilterEstimate, gate: float) -> _Found:
        innovations = np.where(self.counted[:, None], estimate.innovations, np.nan)
        variances = np.where(np.isfinite(innovations), estimate.innovation_variances, np.nan)
        charge = log_density(np.full(4, np.inf), self.restart_variance, gate).sum()
        total = np.nansum(log_density(innovations, variances, gate)) + charge * estimate.reset
        return _Found(self.weight * float(total), innovations, variances, estimate.rejected_fraction)


def _undisturbed(request: FilterRequest, recovery: float) -> NDArray[np.bool_]:
    """Rows ``(n+1,)`` outside the vibration set and not within ``recovery`` seconds after it."""
    shaken = np.append(0, np.cumsum(request.shaken))
    reach = round(recovery / request.series.step)
    rows = np.arange(len(request.shaken))
    return np.asarray(shaken[rows + 1] == shaken[np.maximum(rows - reach, 0)])


def _together(parts: Sequence[_Found]) -> Judgement:
    return Judgement(
        float(sum(part.log_likelihood for part in parts)),
        np.concatenate([part.innovations for part in parts]),
        np.concatenate([part.variances for part in parts]),
        tuple(part.rejected_fraction for part in parts),
    )
