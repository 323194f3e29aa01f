"""Fit to steady glides: its covariance, and whether it determines the hull's lateral terms or a second fit holds them.

The covariance contains the scatter between profiles, held parameters, and errors that are not fitted.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.calibration.glides.score import score
from gliderhpc.calibration.glides.search import CalibrationSearch, CalibrationVerdict
from gliderhpc.calibration.glides.segment_errors import SegmentErrors, middle_of
from gliderhpc.distributions import few_values_factor
from gliderhpc.estimation.least_squares import sensitivity
from gliderhpc.flight.hull_parameters import TREND, UNFITTED_MOTION
from gliderhpc.mission_hull.estimate import ProfileTerm
from gliderhpc.studies.hull import MissionTerms, in_order_of_time

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEVEL = 0.95
"""Probability of the intervals."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A finished search over some errors; its covariance takes several of their Jacobians and is computed once.

    Attributes
    ----------
    errors, search : SegmentErrors, CalibrationSearch
        The errors and the search.
    start : (p,)
        Steps of the best starting point of the search.
    """

    errors: SegmentErrors
    search: CalibrationSearch
    start: Array

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the fit (`fit_covariance`)."""
        return fit_covariance(self.errors, self.search)

    @property
    def largest_variance(self) -> float:
        """Largest variance of the fitted parameters, in plausible deviations; zero if none is fitted.

        The contribution of `UNFITTED_MOTION` is left out: no steady glide separates moments from the added masses'.
        """
        free = np.flatnonzero(self.search.free)
        motion = len(self.search.free) + np.flatnonzero([p in UNFITTED_MOTION for p in self.errors.unfitted])
        by_motion = np.sum(self.covariance[np.ix_(free, motion)] ** 2, axis=1)
        return float(np.max(np.diag(self.covariance)[free] - by_motion, initial=0.0))

    def information(self) -> MissionTerms:
        """Information of each profile on all parameters and on the errors that are not fitted; a trend stays as fitted.

        Notes
        -----
        With the weighted Jacobian ``J`` and errors ``r`` of a profile, the score is ``-J^T r`` and the information
        ``J^T J``.
        """
        errors, search = self.errors, self.search
        jacobian, residuals = search.weighted()
        jacobian = np.hstack([jacobian, search.weighted_unfitted()])
        every = (*errors.parameters, *errors.unfitted)
        steps = np.concatenate([search.steps, np.zeros(len(errors.unfitted))])
        kept = [i for i, parameter in enumerate(every) if parameter is not TREND]
        terms = []
        for number in np.unique(errors.profile).tolist():
            of_profile = jacobian[errors.profile == number][:, kept]
            score = -of_profile.T @ residuals[errors.profile == number]
            time = middle_of(errors.segments.time[errors.segments.profile == number])
            terms.append(ProfileTerm(number, time, steps[kept], score, of_profile.T @ of_profile))
        parameters = tuple(every[i] for i in kept)
        return MissionTerms(errors.platform, parameters, in_order_of_time(terms), without=())


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
    deviation = np.maximum(1.0, np.abs(search.steps[held]))
    to_held, to_offsets, to_unfitted = (
        sensitivity(jacobian[:, free], derivatives)
        for derivatives in (jacobian[:, held] * deviation, search.weighted_offsets(), search.weighted_unfitted())
    )
    covariance = np.eye(count + len(unfitted))
    covariance[held, held] = deviation**2
    for others, cross in ((held, to_held * deviation), (unfitted, to_unfitted)):
        covariance[np.ix_(free, others)] = cross
        covariance[np.ix_(others, free)] = cross.T
    covariance[np.ix_(free, free)] = search.scatter_covariance() * few_profiles_factor(errors) + sum(
        change @ change.T for change in (to_held, to_offsets, to_unfitted)
    )
    return covariance


def few_profiles_factor(errors: SegmentErrors) -> float:
    """Factor by which few profiles widen a variance: Student's quantile over the normal one, squared."""
    level = 0.5 + 0.5 * LEVEL
    return few_values_factor(level, len(np.unique(errors.profile)) - 1) ** 2


# Lateral terms. Water that rolls and yaws the glider acts on the equations of roll and rate of turn like other lateral
# terms, and through these equations it moves drag, lift and neutral volume as well. A second fit therefore holds the
# lateral terms, and fits depth rate and pitch apart from roll and rate of turn (`SegmentErrors.with_separate_turns`).

HELD_REASONS = {
    CalibrationVerdict.UNSTABLE: "the hull has no stable steady dive and climb",
    CalibrationVerdict.TOO_STEEP: "the hull cannot glide as flat as the glider did",
    CalibrationVerdict.GLIDE_MISSED: "the fit does not reproduce the depth rate or the pitch",
    CalibrationVerdict.IMPLAUSIBLE_TURNS: "one of them is far from the platform's value",
    CalibrationVerdict.CONFOUNDED: "a parameter is known less well than the platform file states",
}
"""Reasons for a second fit, with the lateral terms held."""

_MAX_DISTANCE = 3.0
"""Distance from the platform's value, in plausible deviations, beyond which turns must prove a lateral term."""

_MIN_ERROR_RATIO = 2.0
"""Ratio of the errors of depth rate, roll or rate of turn, lateral terms held to free, that proves implausible terms.

On twins with yaw impulses or gusts and the platform's own lateral terms it is at most 1.3; on the missions SEA035 M010
and M012 and SG033, at least 2.5.
"""

_MISSED = 3.0
"""Ratio of the errors of depth rate or pitch to those at the start of the search beyond which the fit misses them.

Rates of turn in disturbed water, to which the lateral terms are fitted, have then led the search away from the glides.
"""

_MAX_COST_RATIO = 1.25
"""Ratio of costs above which a fit with the lateral terms held is rejected. On twins whose platform is the true hull,
free lateral terms reduce the cost by 3 to 10 %; on the mission SEA035 M010, by a third."""


def reason_to_hold(fit: Fit, lateral: Mask, *, stable: bool) -> CalibrationVerdict | None:
    """Return why the lateral terms of a finished fit are unreliable; None if they are not."""
    if not stable:
        return CalibrationVerdict.UNSTABLE
    if (_sizes_of_errors(fit, fit.search.steps) > _MISSED * _sizes_of_errors(fit, fit.start))[:2].any():
        return CalibrationVerdict.GLIDE_MISSED
    if fit.errors.flatness(fit.search.steps, margin=1.0) > 0.0:
        return CalibrationVerdict.TOO_STEEP
    if np.abs(fit.search.steps[lateral]).max(initial=0.0) > _MAX_DISTANCE:
        return CalibrationVerdict.IMPLAUSIBLE_TURNS
    if (fit.search.free & lateral).any() and fit.largest_variance > 1.0:
        return CalibrationVerdict.CONFOUNDED
    return None


def is_better_held(reason: CalibrationVerdict, fit: Fit, held: Fit) -> bool:
    """Return whether the fit with the lateral terms held is the better one, given the reason for holding them."""
    if reason in (CalibrationVerdict.UNSTABLE, CalibrationVerdict.TOO_STEEP):
        return True
    sizes_held, sizes_free = (_sizes_of_errors(each, each.search.steps) for each in (held, fit))
    if reason is CalibrationVerdict.GLIDE_MISSED:
        return bool(np.all(sizes_held[:2] <= sizes_free[:2]))
    if reason is CalibrationVerdict.IMPLAUSIBLE_TURNS:
        # Pitch is no measure: a hull near neutral stability predicts it exactly, whatever its lateral terms are.
        return bool(np.all((sizes_held <= _MIN_ERROR_RATIO * sizes_free)[[0, 2, 3]]))
    free_cost, held_cost = (fit.search.cost_of(each.search.steps) for each in (fit, held))
    return held_cost <= _MAX_COST_RATIO * free_cost and held.largest_variance < fit.largest_variance


def _sizes_of_errors(fit: Fit, steps: Array) -> Array:
    """Trimmed root mean square errors ``(4,)`` of depth rate, pitch, roll and rate of turn, SI."""
    return score(fit.errors, steps).errors_after.trimmed
