"""Change of one error of the hull during a mission: a step or a ramp from some dive on, with its probability.

Each candidate adds one unknown, the size of the change, to a chain of dives in which that error is otherwise constant.
A constant unknown enters a Kalman filter in the separate-bias form (Friedland 1969), here in one pass for all
candidates: the derivatives of the means with respect to the size are propagated with the filter, and the log evidence
of the dives is quadratic in the size.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
    dives: Sequence[DiveTerm],
    found: MissionHull,
    parameter: int,
    prior: HullPrior,
    size: float = 1.0,
    companion: int | None = None,
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
    companion : int, optional
        Index of an error that may change at the same time, with the same course and a size of its own. It is
        considered in the size and onset of the change, but not in its probability.

    Notes
    -----
    Every dive but the first may be the onset, either of a step or of a ramp that reaches its whole size at the last
    dive; all have the same prior probability. With score g and information I of the size about zero, the ratio of a
    candidate's evidence to that of no change is ``exp(g**2 / (I + 1 / size**2) / 2) / sqrt(1 + I * size**2)``. With a
    companion, g and I are those of both sizes, and the candidates with and without it are averaged by their evidence.
    """
    if len(dives) < _MIN_DIVES:
        return None
    shapes = np.concatenate([_shapes(dives, form) for form in FORMS])
    terms = [
        dive.term.weighted(weight / found.inflation) for dive, weight in zip(dives, found.weight.tolist(), strict=True)
    ]
    walk = prior.walk.copy()
    walk[parameter] = 0.0
    changing = (parameter,) if companion is None else (parameter, companion)
    score, information = size_likelihood(prior.eta, changes_of(dives, walk), terms, changing, shapes)
    candidates = [
        _candidates(score[:, :count], information[:, :count, :count], size) for count in range(1, len(changing) + 1)
    ]
    return _mixture(candidates, len(dives) - 1)


class _Candidates(NamedTuple):
    """Log evidence of candidates ``(m,)`` relative to no change, and mean and variance of the size ``(m,)``."""

    log_ratio: Array
    size: Array
    variance: Array

    @property
    def log_evidence(self) -> float:
        """Log evidence of a change, each candidate having the same prior probability."""
        return float(np.logaddexp.reduce(self.log_ratio) - np.log(len(self.log_ratio)))


def _candidates(score: Array, information: Array, size: float) -> _Candidates:
    """Evidence and first size of candidates, from score ``(m, k)`` and information ``(m, k, k)`` of their k sizes."""
    count = score.shape[1]
    covariance = np.linalg.inv(information + np.eye(count) / size**2)
    mean = np.einsum("mkl,ml->mk", covariance, score)
    log_ratio = np.asarray(0.5 * np.sum(score * mean, axis=1) + 0.5 * np.linalg.slogdet(covariance / size**2)[1])
    return _Candidates(log_ratio, mean[:, 0], np.asarray(covariance[:, 0, 0]))


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
    prior: Gaussian, changes: Sequence[Change], terms: Sequence[Information], parameters: Sequence[int], shapes: Array
) -> tuple[Array, Array]:
    """Score ``(m, k)`` and information ``(m, k, k)`` of the sizes of candidates about zero.

    Parameters
    ----------
    prior : Gaussian
        Prior of the unknowns at the first dive.
    changes : sequence of Change
        Changes before the second dive, the third ...
    terms : sequence of Information
        Information of the dives.
    parameters : sequence of int
        Indices of the k unknowns that change, each by a size of its own.
    shapes : (m, n)
        Course of the change over the dives.
    """
    belief = prior
    candidates, sizes = len(shapes), len(parameters)
    sensitivity = np.zeros((len(prior.mean), candidates, sizes))
    score, information = np.zeros((candidates, sizes)), np.zeros((candidates, sizes, sizes))
    for number, term in enumerate(terms):
        if number:
            belief = changes[number - 1].applied(belief)
            sensitivity = changes[number - 1].decay[:, None, None] * sensitivity
        # Derivative of the unknowns at this dive with respect to the sizes, relative to that of the filter's mean.
        seen = sensitivity.copy()
        for k, parameter in enumerate(parameters):
            seen[parameter, :, k] += shapes[:, number]
        missing = term.vector - term.matrix @ belief.mean
        after, _ = belief.updated(term)
        believed = term.matrix - term.matrix @ after.covariance @ term.matrix
        score += np.tensordot(missing - term.matrix @ (after.covariance @ missing), seen, axes=1)
        information += np.einsum("pmk,pml->mkl", seen, np.tensordot(believed, seen, axes=1))
        sensitivity -= np.tensordot(after.covariance @ term.matrix, seen, axes=1)
        belief = after
    return score, information


def _mixture(candidates: Sequence[_Candidates], onsets: int) -> HullChange:
    """Average over the candidates, the steps first, weighted by their evidence; without companion, they come first."""
    log_ratio, size, variance = (np.concatenate(column) for column in zip(*candidates, strict=True))
    weight = np.exp(log_ratio - log_ratio.max())
    weight /= weight.sum()
    total = float(weight @ size)
    spread = float(np.sqrt(weight @ (variance + (size - total) ** 2)))
    by_form = weight.reshape(len(candidates), len(FORMS), onsets).sum(axis=0)
    by_onset = by_form.sum(axis=0).cumsum()
    low, middle, high = (1 + int(np.searchsorted(by_onset, level)) for level in _INTERVAL)
    odds = np.exp(min(candidates[0].log_evidence, 700.0)) * (1.0 - _UNCHANGED) / _UNCHANGED
    return HullChange(
        float(odds / (1.0 + odds)), total, spread, (low, min(middle, onsets), min(high, onsets)),
        float(by_form[FORMS.index("step")].sum()),
    )  # fmt: skip
