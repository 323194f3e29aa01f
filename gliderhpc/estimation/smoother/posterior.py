"""Errors of the hull by the platform file and by one dive, and the smoothed estimate with them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.information import DiveInformation
from gliderhpc.estimation.smoother.iterate import SmoothedEstimate
from gliderhpc.platform import Platform

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HullErrors:
    """Distribution of the errors ``eta`` of a hull and its records, in plausible deviations.

    Attributes
    ----------
    mean, covariance : (p,), (p, p)
        From the platform's values.
    """

    mean: Array
    covariance: Array


def stated_errors(platform: Platform, information: DiveInformation) -> HullErrors:
    """Errors by the platform file alone: a calibration's covariance, and plausible deviations of what it leaves out."""
    covariance = np.eye(len(information.parameters))
    stated = None if platform.uncertainty is None else platform.uncertainty.covariance
    if stated is not None:
        names = [p.key for p in information.parameters]
        pairs = [(names.index(key), i) for i, key in enumerate(stated.parameters) if key in names]
        mine, theirs = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True)) if pairs else ([], [])
        slope = np.array([p.slope(platform, 0.0) for p in information.parameters])[mine]
        covariance[np.ix_(mine, mine)] = stated.covariance[np.ix_(theirs, theirs)] / np.outer(slope, slope)
    return HullErrors(np.zeros(len(covariance)), covariance)


def after_dive(errors: HullErrors, information: DiveInformation) -> HullErrors:
    """Errors after a dive: ``(I + C^-1)^-1``, without inverting a covariance, which may be singular."""
    smaller = np.linalg.solve(np.eye(len(errors.mean)) + errors.covariance @ information.information, errors.covariance)
    covariance = 0.5 * (smaller + smaller.T)
    return HullErrors(
        errors.mean + covariance @ (information.score - information.information @ errors.mean), covariance
    )


def with_hull_errors(smoothed: SmoothedEstimate, information: DiveInformation, errors: HullErrors) -> SmoothedEstimate:
    """Return a smoothed estimate moved to the mean of the hull's errors, with their part in every deviation.

    Parameters
    ----------
    smoothed : SmoothedEstimate
        At the records (`SmoothedEstimate.thinned`), of the platform's values.
    information : DiveInformation
        Of the same records.
    errors : HullErrors
        The hull's errors.

    Notes
    -----
    ``x + V E(eta)`` and ``P + V Cov(eta) V'`` (model.md 12): exact where the problem is linear in ``eta``.
    """
    V, C = information.displacement, errors.covariance
    return replace(
        smoothed,
        states=smoothed.states + information.states @ errors.mean,
        states_std=np.sqrt(smoothed.states_std**2 + _variance(information.states, C)),
        disturbances=smoothed.disturbances + information.disturbances @ errors.mean,
        disturbances_std=np.sqrt(smoothed.disturbances_std**2 + _variance(information.disturbances, C)),
        displacement=smoothed.displacement + V @ errors.mean,
        displacement_covariance=smoothed.displacement_covariance + V @ C @ V.T,
    )


def _variance(sensitivity: Array, covariance: Array) -> Array:
    """Variance ``(m, k)`` of sensitivities ``(m, k, p)``."""
    return np.asarray(np.maximum(np.sum((sensitivity @ covariance) * sensitivity, axis=2), 0.0))
