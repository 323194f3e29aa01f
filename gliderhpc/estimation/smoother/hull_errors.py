"""Errors of a hull and its records as the platform file states them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_tail
from gliderhpc.flight.hull_parameters import HullParameter, stated_covariance
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_UNINFORMATIVE = 1e-3
"""Information of a dive below which a direction is left out of its comparison with what is known of the errors."""

_MIN_PROBABILITY = 0.01
"""Probability of a chi-square below which a dive contradicts what is known of the errors."""


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
        chi_square, freedom = disagreement(score - information @ self.mean, information, self.covariance)
        return chi_square_tail(chi_square, freedom) < _MIN_PROBABILITY

    def after(self, score: Array, information: Array) -> "HullErrors":
        """Errors after a dive's score ``(p,)`` and information ``(p, p)``.

        Their covariance is ``(I + C^-1)^-1``; C, which may be singular, is not inverted.
        """
        smaller = np.linalg.solve(np.eye(len(self.mean)) + self.covariance @ information, self.covariance)
        covariance = 0.5 * (smaller + smaller.T)
        return HullErrors(self.mean + covariance @ (score - information @ self.mean), covariance)


def stated_errors(platform: Platform, parameters: Sequence[HullParameter]) -> HullErrors:
    """Errors from the platform file alone: a calibration's covariance, and plausible deviations of other parameters."""
    return HullErrors(np.zeros(len(parameters)), stated_covariance(platform, parameters))


def disagreement(score: Array, information: Array, covariance: Array) -> tuple[float, int]:
    """Return the chi-square of a dive relative to errors that were estimated without it, and its degrees of freedom.

    Parameters
    ----------
    score, information : (p,), (p, p)
        Score at the mean of the errors, and information.
    covariance : (p, p)
        Covariance of the errors.

    Notes
    -----
    The score has the covariance ``I + I C I``. Directions in which the dive has no information are left out.
    """
    values, vectors = np.linalg.eigh(information)
    known = values > _UNINFORMATIVE
    if not known.any():
        return 0.0, 0
    scaled = vectors[:, known] * np.sqrt(values[known])
    standardised = (vectors[:, known].T @ score) / np.sqrt(values[known])
    spread = np.eye(len(standardised)) + scaled.T @ covariance @ scaled
    return float(standardised @ np.linalg.solve(spread, standardised)), len(standardised)
