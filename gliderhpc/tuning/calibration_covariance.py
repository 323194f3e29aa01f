"""Covariance of a fit to steady glides: scatter between profiles, held parameters, and errors that are not fitted."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import few_values_factor
from gliderhpc.flight.hull_parameters import UNFITTED_MOTION
from gliderhpc.tuning.calibration_search import CalibrationSearch
from gliderhpc.tuning.least_squares import sensitivity
from gliderhpc.tuning.segment_errors import SegmentErrors

Array = NDArray[np.float64]

LEVEL = 0.95
"""Probability of the intervals."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A finished search over some errors; its covariance takes several of their Jacobians and is computed once."""

    errors: SegmentErrors
    search: CalibrationSearch

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the fit (`fit_covariance`)."""
        return fit_covariance(self.errors, self.search)

    @property
    def largest_variance(self) -> float:
        """Largest variance of the fitted parameters, in plausible deviations; zero if none is fitted.

        The part of `UNFITTED_MOTION` is left out: no steady glide separates moments from the added masses'.
        """
        free = np.flatnonzero(self.search.free)
        motion = len(self.search.free) + np.flatnonzero([p in UNFITTED_MOTION for p in self.errors.unfitted])
        by_motion = np.sum(self.covariance[np.ix_(free, motion)] ** 2, axis=1)
        return float(np.max(np.diag(self.covariance)[free] - by_motion, initial=0.0))


def fit_covariance(errors: SegmentErrors, search: CalibrationSearch) -> Array:
    """Covariance (p+r, p+r) of all parameters and of the errors that are not fitted, in plausible deviations.

    Held parameters may be wrong by their plausible deviations, or by their distance from the platform's value where
    they are held at another one. Attitude and motion may have the errors `SegmentErrors.unfitted`, which steady glides
    do not determine. Both move the free parameters. These also scatter from profile to profile and depend on the
    rounding of the attitude.
    """
    free, held = np.flatnonzero(search.free), np.flatnonzero(~search.free)
    count = len(search.free)
    unfitted = np.arange(count, count + len(errors.unfitted))
    jacobian, _ = search.weighted()
    wrong = np.maximum(1.0, np.abs(search.steps[held]))
    by_held, by_offsets, by_unfitted = (
        sensitivity(jacobian[:, free], unseen)
        for unseen in (jacobian[:, held] * wrong, search.weighted_offsets(), search.weighted_unfitted())
    )
    covariance = np.eye(count + len(unfitted))
    covariance[held, held] = wrong**2
    for others, by_others in ((held, by_held * wrong), (unfitted, by_unfitted)):
        covariance[np.ix_(free, others)] = by_others
        covariance[np.ix_(others, free)] = by_others.T
    covariance[np.ix_(free, free)] = search.scatter_covariance() * few_profiles_factor(errors) + sum(
        by_others @ by_others.T for by_others in (by_held, by_offsets, by_unfitted)
    )
    return covariance


def few_profiles_factor(errors: SegmentErrors) -> float:
    """Factor by which few profiles widen a variance: Student's quantile over the normal one, squared."""
    level = 0.5 + 0.5 * LEVEL
    return few_values_factor(level, len(np.unique(errors.profile)) - 1) ** 2
