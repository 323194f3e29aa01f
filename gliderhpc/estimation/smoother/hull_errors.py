"""Errors of a hull and its records as the platform file states them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.flight.hull_parameters import HullParameter, stated_covariance
from gliderhpc.platform import Platform

Array = NDArray[np.float64]


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
