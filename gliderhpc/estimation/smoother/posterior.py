"""Errors of the hull from the platform file and one dive, and the smoothed estimate with these errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.information import DiveInformation, Sensitivity, WithVelocityErrors
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

    def of(self, chosen: NDArray[np.bool_]) -> "HullErrors":
        """Return the distribution of the chosen errors."""
        return HullErrors(self.mean[chosen], self.covariance[np.ix_(chosen, chosen)])


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


def after_dive(errors: HullErrors, information: DiveInformation | WithVelocityErrors) -> HullErrors:
    """Errors after a dive, with covariance ``(I + C^-1)^-1``; C, which may be singular, is not inverted."""
    smaller = np.linalg.solve(np.eye(len(errors.mean)) + errors.covariance @ information.information, errors.covariance)
    covariance = 0.5 * (smaller + smaller.T)
    return HullErrors(
        errors.mean + covariance @ (information.score - information.information @ errors.mean), covariance
    )


@dataclass(frozen=True, eq=False)
class HullPart:
    """Errors of a hull in a dive, and their part in its smoothed estimate.

    Attributes
    ----------
    information : DiveInformation
        Information of the dive.
    errors : HullErrors
        Errors of the platform file's hull, after the dive.
    displacement_covariance : (2, 2)
        The hull's part in the covariance of the displacement, m2.
    share : (18,)
        The hull's share in the variance of twelve states (eq. 16) and six disturbances, median over the records.
    """

    information: DiveInformation
    errors: HullErrors
    displacement_covariance: Array
    share: Array


def with_hull_errors(
    smoothed: SmoothedEstimate, information: DiveInformation, errors: HullErrors, *, corrected: bool = False
) -> tuple[SmoothedEstimate, HullPart]:
    """Add the hull's part to the uncertainty of a smoothed estimate at the records.

    Parameters
    ----------
    smoothed : SmoothedEstimate
        Estimate at the records (`SmoothedEstimate.thinned`), for the platform's values.
    information : DiveInformation
        Information of the dive, with sensitivities at the same records.
    errors : HullErrors
        The hull's errors after the dive, and those of a measured velocity after them (`errors_after`).
    corrected : bool
        Whether the estimate moves to the mean of the hull's errors; otherwise it remains that for the platform's
        values. It always moves to the mean of the errors of a measured velocity.

    Notes
    -----
    The corrected estimate is ``x + V m`` with covariance ``P + V C V'``, where ``m`` and ``C`` are the mean and the
    covariance of the errors (docs/smoother.md). The estimate for the platform's values has the expected squared error
    ``P + V (C + m m') V'``. On average over all dives, the hull's part of the latter is that of the errors before the
    dive, since a dive increases ``m m'`` by as much as it decreases ``C``. Both are exact if the problem is linear in
    the errors.
    """
    hull = np.arange(len(errors.mean)) < len(information.parameters)
    held = hull & (not corrected)
    mean, left = np.where(held, 0.0, errors.mean), np.where(held, errors.mean, 0.0)
    square = errors.covariance + np.outer(left, left)
    by = _sensitivity(information)
    of_states, of_disturbances = _variance(by.states, square), _variance(by.disturbances, square)
    of_displacement = by.displacement @ square @ by.displacement.T
    result = replace(
        smoothed,
        states=smoothed.states + by.states @ mean,
        states_std=np.sqrt(smoothed.states_std**2 + of_states),
        disturbances=smoothed.disturbances + by.disturbances @ mean,
        disturbances_std=np.sqrt(smoothed.disturbances_std**2 + of_disturbances),
        displacement=smoothed.displacement + by.displacement @ mean,
        displacement_covariance=smoothed.displacement_covariance + of_displacement,
    )
    if information.with_velocity is not None:
        errors, square, V = errors.of(hull), square[np.ix_(hull, hull)], information.displacement
        of_states, of_disturbances = (_variance(x, square) for x in (information.states, information.disturbances))
        of_displacement = V @ square @ V.T
    shares = [_share(of_states, result.states_std), _share(of_disturbances, result.disturbances_std)]
    return result, HullPart(information, errors, of_displacement, np.concatenate(shares))


def _sensitivity(information: DiveInformation) -> Sensitivity:
    """Sensitivities to the errors of the hull, and to those of a measured velocity if there is one."""
    if information.with_velocity is not None:
        return information.with_velocity.sensitivity
    return Sensitivity(information.displacement, information.states, information.disturbances)


def errors_after(errors: HullErrors, information: DiveInformation) -> HullErrors:
    """Errors of hull and measured velocity after a dive, from those of the hull before it.

    A dive whose information is not sound leaves them as they were.
    """
    together = information.with_velocity
    if together is None:
        return after_dive(errors, information) if information.narrows_errors else errors
    hull, count = len(errors.mean), len(together.score)
    covariance = np.eye(count)
    covariance[:hull, :hull] = errors.covariance
    before = HullErrors(np.concatenate([errors.mean, np.zeros(count - hull)]), covariance)
    return after_dive(before, together) if information.narrows_errors else before


def _variance(sensitivity: Array, covariance: Array) -> Array:
    """Variance ``(m, k)`` of sensitivities ``(m, k, p)``."""
    return np.asarray(np.maximum(np.sum((sensitivity @ covariance) * sensitivity, axis=2), 0.0))


def _share(part: Array, deviation: Array) -> Array:
    """Median share ``(k,)`` of a part ``(m, k)`` in the variance; zero where there is none, as for X at the start."""
    share = np.divide(part, deviation**2, out=np.zeros_like(part), where=deviation > 0.0)
    return np.asarray(np.median(share, axis=0))
