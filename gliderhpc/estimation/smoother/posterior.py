"""Errors of the hull after one profile, and the posterior of smoothed and adjoint estimates with these errors."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.glide_sensitivity import GlideSensitivity
from gliderhpc.estimation.smoother.hull_errors import HullErrors
from gliderhpc.estimation.smoother.information import HullInformation, RecordErrors
from gliderhpc.estimation.windows import ProfileSolution

Array = NDArray[np.float64]


def posterior_errors(errors: HullErrors, information: HullInformation) -> HullErrors:
    """Return the hull's errors after a profile.

    Notes
    -----
    A profile that contradicts the stated errors, at a probability of 1 %, updates their mean but does not narrow them.
    Either the errors are larger than stated, or the water moved in a way that the smoother does not assume and that
    acts like errors of the hull (such as yaw impulses in slow records). One profile cannot distinguish between the two.
    """
    score, matrix = information.score, information.information
    posterior = errors.updated(score, matrix)
    return replace(posterior, covariance=errors.covariance) if errors.contradicted_by(score, matrix) else posterior


class HullVariance(NamedTuple):
    """Contribution of the hull's errors to the uncertainty of a profile's smoothed estimate.

    Attributes
    ----------
    displacement_covariance : (2, 2)
        Contribution to the covariance of the displacement, m2.
    share : (18,)
        Share of the variance of twelve states (eq. 16) and six disturbances, median over the records.
    """

    displacement_covariance: Array
    share: Array


@dataclass(frozen=True, eq=False)
class HullContribution:
    """Errors of a hull in a profile, and their contribution to its smoothed estimate.

    Attributes
    ----------
    information : HullInformation
        Information of the profile, without the sensitivities at the records.
    errors : HullErrors
        Errors of the platform file's hull after the profile.
    displacement_covariance, share : (2, 2), (18,)
        As in `HullVariance`.
    glide : GlideSensitivity
        Effect of the errors on steady glide.
    """

    information: HullInformation
    errors: HullErrors
    displacement_covariance: Array
    share: Array
    glide: GlideSensitivity


def with_hull_errors(
    smoothed: SmoothedEstimate, information: HullInformation, errors: HullErrors, *, corrected: bool = False
) -> tuple[SmoothedEstimate, HullVariance]:
    """Add the contribution of the hull's errors to the uncertainty of a smoothed estimate at the records.

    Parameters
    ----------
    smoothed : SmoothedEstimate
        Estimate at the records (`SmoothedEstimate.thinned`), for the platform's values.
    information : HullInformation
        Information of the profile, with sensitivities at the same records.
    errors : HullErrors
        The hull's errors after the profile.
    corrected : bool
        Whether the estimate is corrected by the mean of the errors; otherwise it is that for the platform's values.

    Notes
    -----
    The corrected estimate is ``x + V m`` with covariance ``P + V C V'``, where ``m`` and ``C`` are the mean and the
    covariance of the errors (docs/smoother.md). The estimate for the platform's values has the expected squared error
    ``P + V (C + m m') V'``. On average over all profiles, the hull's part of the latter is that of the errors before
    the profile, since a profile increases ``m m'`` by as much as it decreases ``C``. Both are exact if the problem is
    linear in the errors.
    """
    mean = errors.mean if corrected else np.zeros_like(errors.mean)
    square = errors.covariance if corrected else errors.covariance + np.outer(errors.mean, errors.mean)
    V, V_states, V_disturbances = information.displacement, information.states, information.disturbances
    states_variance, disturbances_variance = _variance(V_states, square), _variance(V_disturbances, square)
    displacement_covariance = V @ square @ V.T
    result = replace(
        smoothed,
        states=smoothed.states + V_states @ mean,
        states_std=np.sqrt(smoothed.states_std**2 + states_variance),
        disturbances=smoothed.disturbances + V_disturbances @ mean,
        disturbances_std=np.sqrt(smoothed.disturbances_std**2 + disturbances_variance),
        displacement=smoothed.displacement + V @ mean,
        displacement_covariance=smoothed.displacement_covariance + displacement_covariance,
    )
    shares = [
        _median_share(states_variance, result.states_std),
        _median_share(disturbances_variance, result.disturbances_std),
    ]
    return result, HullVariance(displacement_covariance, np.concatenate(shares))


def with_record_errors(smoothed: SmoothedEstimate, record: RecordErrors) -> SmoothedEstimate:
    """Move an estimate at the records to the mean of the record's errors, and add their uncertainty.

    Parameters
    ----------
    smoothed : SmoothedEstimate
        Estimate at the records (`SmoothedEstimate.thinned`), for a record without these errors.
    record : RecordErrors
        These errors after the profile, with sensitivities at the same records.

    Returns
    -------
    SmoothedEstimate
        The estimate ``x + V m`` with the variance ``P + V C V'``.
    """
    by, mean, covariance = record.sensitivity, record.mean, record.covariance
    displacement, displacement_covariance = displacement_with_errors(smoothed, record)
    return replace(
        smoothed,
        states=smoothed.states + by.states @ mean,
        states_std=np.sqrt(smoothed.states_std**2 + _variance(by.states, covariance)),
        disturbances=smoothed.disturbances + by.disturbances @ mean,
        disturbances_std=np.sqrt(smoothed.disturbances_std**2 + _variance(by.disturbances, covariance)),
        displacement=displacement,
        displacement_covariance=displacement_covariance,
    )


def displacement_with_errors(smoothed: SmoothedEstimate, record: RecordErrors | None) -> tuple[Array, Array]:
    """Displacement ``(2,)``, m, and its covariance, m2, with the errors of the record if there are any."""
    if record is None:
        return smoothed.displacement, smoothed.displacement_covariance
    V = record.sensitivity.displacement
    return smoothed.displacement + V @ record.mean, smoothed.displacement_covariance + V @ record.covariance @ V.T


def _variance(sensitivity: Array, covariance: Array) -> Array:
    """Variance ``(m, k)`` of sensitivities ``(m, k, p)``."""
    return np.asarray(np.maximum(np.einsum("mkp,mkp->mk", sensitivity @ covariance, sensitivity), 0.0))


def _median_share(contribution: Array, deviation: Array) -> Array:
    """Median share ``(k,)`` of a contribution ``(m, k)`` in the variance; zero where the variance is zero."""
    share = np.divide(contribution, deviation**2, out=np.zeros_like(contribution), where=deviation > 0.0)
    return np.asarray(np.median(share, axis=0))


# Standard deviation of the windows' disturbances, from the smoother's posterior

AVERAGED = 30.0
"""Interval over which the squared difference from the smoother's estimate is averaged, s; the length of a window."""


def adjoint_deviation(solution: ProfileSolution, smoothed: SmoothedEstimate, every: int, interval: float) -> Array:
    """Standard deviation of the windows' disturbances at the records.

    Parameters
    ----------
    solution : ProfileSolution
        Solution of the windows, on the steps.
    smoothed : SmoothedEstimate
        Estimate of the smoother at the records, with the hull's part in its uncertainty.
    every : int
        Steps from record to record.
    interval : float
        Time from record to record, s.

    Returns
    -------
    (m, 6) array
        Standard deviation of the disturbance of the step that starts at each record, N and N m; NaN if the smoother
        has no estimate.
    """
    width = 2 * round(0.5 * AVERAGED / interval) + 1
    return deviation_about(solution.disturbances[::every], smoothed.disturbances, smoothed.disturbances_std, width)


def deviation_about(estimate: Array, mean: Array, std: Array, width: int) -> Array:
    """Standard deviation of an estimate, given only the posterior of another method.

    Parameters
    ----------
    estimate : (m, k)
        The estimate.
    mean, std : (m, k)
        Mean and standard deviation of the posterior at the same times.
    width : int
        Odd number of entries over which the squared difference is averaged; fewer are available at both ends.

    Returns
    -------
    (m, k) array
        Root of the expected squared error; NaN where the posterior's standard deviation is.

    Notes
    -----
    If the truth has the posterior ``N(mean, std^2)``, the expected squared error of any other estimate is ``std^2 +
    (estimate - mean)^2``. The second term is averaged over `width` entries, since a single difference may be small by
    chance, where the estimate crosses the mean.
    """
    square = scipy.ndimage.uniform_filter1d((estimate - mean) ** 2, width, axis=0)
    # The running sum may leave a negative rounding error after large differences.
    return np.asarray(np.sqrt(std**2 + np.maximum(square, 0.0)))
