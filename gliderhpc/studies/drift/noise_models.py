"""Noise of a series of medians: independent scatter and a slow wander of water and hull, in several mixtures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class NoiseModel:
    """First-order autoregression and independent scatter.

    Attributes
    ----------
    correlation : float
        Of the wander from one profile to the next.
    part : float
        Of the variance that wanders; the rest is independent.
    """

    correlation: float
    part: float

    def covariance(self, positions: Index) -> Array:
        """Covariance ``(n, n)`` at unit variance of profiles at some positions ``(n,)`` along the mission."""
        apart = np.abs(positions[:, None] - positions[None])
        return np.asarray(self.part * self.correlation**apart + (1.0 - self.part) * (apart == 0))


NOISE_MODELS = (
    NoiseModel(0.0, 0.0),
    NoiseModel(0.6, 0.5),
    NoiseModel(0.6, 1.0),
    NoiseModel(0.85, 0.5),
    NoiseModel(0.85, 1.0),
    NoiseModel(0.97, 0.5),
    NoiseModel(0.97, 1.0),
)
"""Candidates, the more persistent the later."""


class WeightedBaseline:
    """Generalised least squares about a baseline, under one noise model.

    Parameters
    ----------
    model : NoiseModel
        The noise.
    positions : (n,)
        Of the values along the mission, in profiles.
    baseline : (n, p)
        Columns that every fit holds, a level and a line among them.

    Attributes
    ----------
    model : NoiseModel
        The noise.
    projected : (n, n)
        Inverse covariance without what the baseline explains: ``y' projected y`` is what the baseline leaves of `y`.
    constant : float
        Part of the restricted loss that does not depend on the values.
    freedom : int
        Values less columns.
    """

    def __init__(self, model: NoiseModel, positions: Index, baseline: Array) -> None:
        self.model = model
        covariance = model.covariance(positions)
        weighted = np.linalg.solve(covariance, baseline)
        normal = baseline.T @ weighted
        self.projected: Array = np.linalg.inv(covariance) - weighted @ np.linalg.solve(normal, weighted.T)
        self.constant = float(np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1])
        self.freedom = baseline.shape[0] - baseline.shape[1]

    def loss(self, left: Array) -> Array:
        """Minus twice the restricted log likelihood, its scale fitted, of weighted sums of squares ``(m,)``."""
        return np.asarray(self.constant + self.freedom * np.log(left))

    def left(self, values: Array) -> Array:
        """Weighted sums of squares ``(m,)`` that the baseline leaves of series ``(n, m)``."""
        return np.asarray(np.einsum("nm,nm->m", values, self.projected @ values))


def best_baseline(positions: Index, baseline: Array, values: Array) -> WeightedBaseline:
    """Give the baseline under the noise model of the least loss for a series ``(n,)``."""
    fits = [WeightedBaseline(model, positions, baseline) for model in NOISE_MODELS]
    return min(fits, key=lambda one: float(one.loss(one.left(values[:, None]))[0]))
