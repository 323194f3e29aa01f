"""Errors of a hull and its records: their distribution, its update by a profile, and a test of the two."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_tail
from gliderhpc.flight.hull_parameters import HullParameter, stated_covariance
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_UNINFORMATIVE = 1e-3
"""Information of a profile on a direction, below which the direction is left out of a comparison with known errors."""

_MIN_PROBABILITY = 0.01
"""Probability of a chi-square below which a profile contradicts the known errors."""


@dataclass(frozen=True, eq=False)
class HullErrors:
    """Distribution of the errors ``eta`` of a hull and its records, in plausible deviations.

    Attributes
    ----------
    mean, covariance : (p,), (p, p)
        Mean, relative to the platform's values, and covariance.
    """

    mean: Array
    covariance: Array

    def contradicted_by(self, score: Array, information: Array) -> bool:
        """Return whether a score ``(p,)`` with information ``(p, p)`` is improbable under these errors."""
        directions = InformedDirections.of(information)
        chi_square, freedom = directions.disagreement(score - information @ self.mean, self.covariance)
        return chi_square_tail(float(chi_square), int(freedom)) < _MIN_PROBABILITY

    def updated(self, score: Array, information: Array) -> "HullErrors":
        """Return the posterior of the errors, given a profile's score ``(p,)`` and information ``(p, p)``.

        Its covariance is ``(I + C^-1)^-1``; C, which may be singular, is not inverted.
        """
        posterior = np.linalg.solve(np.eye(len(self.mean)) + self.covariance @ information, self.covariance)
        covariance = 0.5 * (posterior + posterior.T)
        return HullErrors(self.mean + covariance @ (score - information @ self.mean), covariance)


def stated_errors(platform: Platform, parameters: Sequence[HullParameter]) -> HullErrors:
    """Errors from the platform file alone: a calibration's covariance, and plausible deviations of other parameters."""
    return HullErrors(np.zeros(len(parameters)), stated_covariance(platform, parameters))


@dataclass(frozen=True, eq=False)
class InformedDirections:
    """Directions in which profiles have information on the errors: eigenvectors of their information.

    Attributes
    ----------
    values, vectors : (..., p), (..., p, p)
        Information along each direction, and the directions in columns.
    """

    values: Array
    vectors: Array

    @classmethod
    def of(cls, information: Array) -> "InformedDirections":
        """Return the directions of information matrices ``(..., p, p)``."""
        return cls(*np.linalg.eigh(information))

    def weighted(self, weight: Array) -> "InformedDirections":
        """Return the directions of the information times a weight ``(...)``."""
        return InformedDirections(weight[..., None] * self.values, self.vectors)

    def disagreement(self, score: Array, covariance: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return chi-square of profiles relative to errors that were estimated without them, and degrees of freedom.

        Parameters
        ----------
        score : (..., p)
            Score at the mean of the errors.
        covariance : (..., p, p)
            Covariance of the errors.

        Returns
        -------
        (...), (...) of int
            Chi-square and degrees of freedom.

        Notes
        -----
        The score has the covariance ``I + I C I``. Directions in which a profile has no information are left out.
        """
        known = self.values > _UNINFORMATIVE
        root = np.sqrt(np.where(known, self.values, 1.0))
        standardised = np.where(known, (self.vectors.mT @ score[..., None])[..., 0] / root, 0.0)
        scaled = self.vectors * np.where(known, root, 0.0)[..., None, :]
        spread = np.eye(score.shape[-1]) + scaled.mT @ covariance @ scaled
        solved = np.linalg.solve(spread, standardised[..., None])[..., 0]
        return np.sum(standardised * solved, axis=-1), known.sum(axis=-1)
