"""Test of whether steady glides determine a hull's lateral terms, or a second fit should hold them.

Water that rolls and yaws the glider acts on the equations of roll and rate of turn like other lateral terms, and
through these equations it moves drag, lift and neutral volume as well. A second fit therefore holds the lateral terms,
and fits depth rate and pitch apart from roll and rate of turn (`SegmentErrors.with_separate_turns`).
"""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.tuning.calibration_covariance import Fit
from gliderhpc.tuning.calibration_score import score
from gliderhpc.tuning.calibration_search import CalibrationVerdict

Mask = NDArray[np.bool_]

HELD_REASONS = {
    CalibrationVerdict.UNSTABLE: "the hull has no stable steady dive and climb",
    CalibrationVerdict.TOO_STEEP: "the hull cannot glide as flat as the glider did",
    CalibrationVerdict.IMPLAUSIBLE_TURNS: "one of them is far from the platform's value",
    CalibrationVerdict.CONFOUNDED: "a parameter is less well known than the platform states it",
}
"""Reasons for a second fit, with the lateral terms held."""

_MAX_DISTANCE = 3.0
"""Distance from the platform's value, in plausible deviations, beyond which turns must prove a lateral term."""

_MIN_ERROR_RATIO = 2.0
"""Ratio of the errors of depth rate, roll or rate of turn, lateral terms held to free, that proves implausible terms.

On twins with yaw impulses or gusts and the platform's own lateral terms it is at most 1.3; on the missions SEA035 M010
and M012 and SG033, at least 2.5.
"""

_MAX_COST_RATIO = 1.25
"""Ratio of costs above which a fit with the lateral terms held is rejected. On twins whose platform is the true hull,
free lateral terms reduce the cost by 3 to 10 %; on the mission SEA035 M010, by a third."""


def reason_to_hold(fit: Fit, lateral: Mask, *, stable: bool) -> CalibrationVerdict | None:
    """Return why the lateral terms of a finished fit are in doubt; None if they are not."""
    if not stable:
        return CalibrationVerdict.UNSTABLE
    if fit.errors.flatness(fit.search.steps, margin=1.0) > 0.0:
        return CalibrationVerdict.TOO_STEEP
    if np.abs(fit.search.steps[lateral]).max(initial=0.0) > _MAX_DISTANCE:
        return CalibrationVerdict.IMPLAUSIBLE_TURNS
    if (fit.search.free & lateral).any() and fit.largest_variance > 1.0:
        return CalibrationVerdict.CONFOUNDED
    return None


def is_better_held(why: CalibrationVerdict, fit: Fit, held: Fit) -> bool:
    """Return whether the fit with the lateral terms held is the better one."""
    if why in (CalibrationVerdict.UNSTABLE, CalibrationVerdict.TOO_STEEP):
        return True
    if why is CalibrationVerdict.IMPLAUSIBLE_TURNS:
        return bool(np.all(_sizes_of_errors(held) <= _MIN_ERROR_RATIO * _sizes_of_errors(fit)))
    free_cost, held_cost = (fit.search.cost_of(each.search.steps) for each in (fit, held))
    return held_cost <= _MAX_COST_RATIO * free_cost and held.largest_variance < fit.largest_variance


def _sizes_of_errors(fit: Fit) -> NDArray[np.float64]:
    """Trimmed root mean square errors ``(3,)`` of depth rate, roll and rate of turn, SI.

    Pitch is no measure: a hull near neutral stability predicts it exactly, whatever its lateral terms are.
    """
    return score(fit.errors, fit.search.steps).errors_after.trimmed[[0, 2, 3]]
