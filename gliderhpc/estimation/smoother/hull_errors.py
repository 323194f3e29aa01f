"""Errors of a hull and its records as the platform file states them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.flight.hull_parameters import HullParameter
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
    covariance, names = np.eye(len(parameters)), [p.key for p in parameters]
    stated = None if platform.uncertainty is None else platform.uncertainty.covariance
    if stated is not None:
        theirs = [i for i, key in enumerate(stated.parameters) if key in names]
        mine = [names.index(stated.parameters[i]) for i in theirs]
        slope = np.array([parameters[j].slope(platform, 0.0) for j in mine])
        covariance[np.ix_(mine, mine)] = stated.covariance[np.ix_(theirs, theirs)] / np.outer(slope, slope)
    return HullErrors(np.zeros(len(covariance)), covariance)
