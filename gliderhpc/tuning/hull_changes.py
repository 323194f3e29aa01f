"""Change of one error of the hull during a mission: a step or a ramp from some dive on, with its probability.

Each candidate adds one unknown, the size of the change, to a chain of dives in which that error is otherwise constant.
A constant unknown enters a Kalman filter in the separate-bias form (Friedland 1969), here in one pass for all
candidates: the derivatives of the means with respect to the size are propagated with the filter, and the log evidence
of the dives is quadratic in the size.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.tuning.gaussian_chain import Array, Change, Gaussian, Information
from gliderhpc.tuning.mission_hull import DiveTerm, HullPrior, MissionHull, changes_of

FORMS = ("step", "ramp")

_UNCHANGED = 0.5
"""Prior probability that nothing changes."""
_INTERVAL = (0.05, 0.5, 0.95)
_MIN_DIVES = 4
"""Smallest number of dives; with fewer, a change cannot be distinguished from their scatter."""


@dataclass(frozen=True, eq=False)
class HullChange:
    """Change of one error of the hull.

    Attributes
    ----------
    probability : float
        Probability of a change; its prior is one half.
    total, total_std : float
        Change from the first dive to the last, given that there is one, and its standard deviation, in plausible
        deviations.
    onset : (int, int, int)
        Positions of the first changed dive: lower end of the 90 % interval, median, upper end.
    step_probability : float
        Probability of a step, given a change.
    """

    probability: float
    total: float
    total_std: float
    onset: tuple[int, int, int]
    step_probability: float


def find_change(
    dives: Sequence[DiveTerm], found: MissionHull, parameter: int, prior: HullPrior, size: float = 1.0
) -> HullChange | None:
    """Estimate the probability, size and onset of a change of one error; None with fewer than four dives.

    Parameters
    ----------
    dives : sequence of DiveTerm
        Dives in the order of time.
    found : MissionHull
        Result of the sum over these dives, whose weights and inflation are used.
    parameter : int
        Index of the error.
    prior : HullPrior
        Prior of the sum; the random walk of this error is left out here.
    size : float
        Prior standard deviation of the whole change, in plausible deviations.

    Notes
    -----
    Every dive but the first may be the onset, either of a step or of a ramp that reaches its whole size at the last
    dive; all have the same prior probability. With score g and information I of the size about zero, the ratio of a
    candidate's evidence to that of no change is ``exp(g**2 / (I + 1 / size**2) / 2) / sqrt(1 + I * size**2)``.
    """
    if len(dives) < _MIN_DIVES:
        return None
    shapes = np.concatenate([_shapes(dives, form) for form in FORMS])
    terms = [
        dive.term.weighted(weight / found.inflation) for dive, weight in zip(dives, found.weight.tolist(), strict=True)
    ]
    walk = prior.walk.copy()
    walk[parameter] = 0.0
    score, information = size_likelihood(prior.eta, changes_of(dives, walk), terms, parameter, shapes)
    precision = information + 1.0 / size**2
    log_ratio = 0.5 * score**2 / precision - 0.5 * np.log(precision * size**2)
    return _mixture(log_ratio, score / precision, 1.0 / precision, len(dives) - 1)


def _shapes(dives: Sequence[DiveTerm], form: str) -> Array:
    """Course of the change over the dives ``(onset, dive)``, from zero to one, for every onset but the first dive."""
    day = (np.array([dive.time for dive in dives]) - dives[0].time) / np.timedelta64(1, "D")
    index = np.arange(len(dives))
    changed = index >= index[1:, None]
    if form == "step":
        return changed.astype(np.float64)
    # The ramp starts from zero at the dive before the onset.
    start = day[:-1, None]
    return np.asarray(np.where(changed, (day - start) / np.maximum(day[-1] - start, 1e-9), 0.0))


def size_likelihood(
    prior: Gaussian, changes: Sequence[Change], terms: Sequence[Information], parameter: int, shapes: Array
) -> tuple[Array, Array]:
    """Score and information ``(m,)`` of the sizes of candidates about zero.

    Parameters
    ----------
    prior : Gaussian
        Prior of the unknowns at the first dive.
    changes : sequence of Change
        Changes before the second dive, the third ...
    terms : sequence of Information
        Information of the dives.
    parameter : int
        Index of the unknown that changes.
    shapes : (m, n)
        Course of the change over the dives.
    """
    belief = prior
    sensitivity = np.zeros((len(prior.mean), len(shapes)))
    score, information = np.zeros(len(shapes)), np.zeros(len(shapes))
    for number, term in enumerate(terms):
        if number:
            belief = changes[number - 1].applied(belief)
            sensitivity = changes[number - 1].decay[:, None] * sensitivity
        # Derivative of the unknowns at this dive with respect to the size, relative to that of the filter's mean.
        seen = sensitivity.copy()
        seen[parameter] += shapes[:, number]
        missing = term.vector - term.matrix @ belief.mean
        after, _ = belief.updated(term)
        believed = term.matrix - term.matrix @ after.covariance @ term.matrix
        score += seen.T @ (missing - term.matrix @ (after.covariance @ missing))
        information += np.einsum("pm,pm->m", seen, believed @ seen)
        sensitivity -= after.covariance @ (term.matrix @ seen)
        belief = after
    return score, information


def _mixture(log_ratio: Array, size: Array, variance: Array, onsets: int) -> HullChange:
    """Average over the candidates, the steps first, weighted by their evidence."""
    highest = float(log_ratio.max())
    weight = np.exp(log_ratio - highest)
    evidence = highest + np.log(weight.mean())
    weight /= weight.sum()
    total = float(weight @ size)
    spread = float(np.sqrt(weight @ (variance + (size - total) ** 2)))
    by_onset = weight.reshape(len(FORMS), onsets).sum(axis=0).cumsum()
    low, middle, high = (1 + int(np.searchsorted(by_onset, level)) for level in _INTERVAL)
    odds = np.exp(min(evidence, 700.0)) * (1.0 - _UNCHANGED) / _UNCHANGED
    return HullChange(
        float(odds / (1.0 + odds)), total, spread, (low, min(middle, onsets), min(high, onsets)),
        float(weight[:onsets].sum()),
    )  # fmt: skip
