"""The mission's hull: what all dives together know of the errors ``eta`` of a hull and its records (model.md 12).

A dive leaves score and information; they are added to the prior, with a random walk from dive to dive for what can
change. No model is right, so dives differ from one another by more than each of them states; by how much, they
themselves show, and what they know is taken down by that. A dive that does not fit the rest counts for less. What the
noise of the disturbances is, is an assumption that all dives share; where others lead elsewhere the dives count for
less.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.tuning.gaussian_chain import Array, Chain, Change, Gaussian, Information, about, solve_chain
from gliderhpc.tuning.turn_test import (
    DiveCurrent,
    TurnTestSettings,
    changes_with_current,
    extended_information,
    with_current,
)  # fmt: skip

ScoreAndInformation = tuple[Array, Array]
"""Gradient (p,) of a log-likelihood and its expected curvature (p, p)."""

_SECONDS_PER_DAY = 86400.0
_FIT_LEVEL = 0.99
"""Part of the dives that fit the rest and are believed whole."""
_ROUNDS = 4
"""Rounds of inflation and weights, each by the other."""
_MIN_CURRENTS = 2
"""One current alone tells nothing."""
_UNINFORMED = 1e-9
"""Information, in parts of the prior's, of dives that know nothing."""
MIN_COMPARED = 4
"""Fewer dives do not show by how much they differ."""


@dataclass(frozen=True, eq=False)
class DiveTerm:
    """What one dive knows of the hull.

    Attributes
    ----------
    number : int
        Number of the profile.
    time : numpy.datetime64
        Of the dive.
    point : (p,)
        ``eta`` that the dive was smoothed about, in plausible deviations.
    score : (p,)
        Gradient of its log-likelihood there.
    information : (p, p)
        Its expected curvature there.
    others : tuple of (score, information)
        Both under other assumptions of the noise.
    current : DiveCurrent, optional
        The depth-averaged current, for the turn test.
    """

    number: int
    time: np.datetime64
    point: Array
    score: Array
    information: Array
    others: tuple[ScoreAndInformation, ...] = ()
    current: DiveCurrent | None = None

    @property
    def term(self) -> Information:
        """Its log-likelihood over eta, less a constant."""
        return about(self.score, self.information, self.point)

    def assuming(self, other: int) -> "DiveTerm":
        """Return the dive under one of the other assumptions of the noise."""
        score, information = self.others[other]
        return replace(self, score=score, information=information)

    @property
    def term_with_current(self) -> Information:
        """The same over eta and the current's unknowns, with what the current tells."""
        term = extended_information(self.term)
        return term if self.current is None else term + self.current.information(self.point)


@dataclass(frozen=True, eq=False)
class HullPrior:
    """What is known before any dive.

    Attributes
    ----------
    eta : Gaussian
        Mean (p,) and covariance (p, p) at the first dive: ``N(0, 1)`` where nobody has calibrated.
    walk : (p,)
        Change per square root of a day.
    """

    eta: Gaussian
    walk: Array

    @classmethod
    def plausible(cls, walk: Array) -> "HullPrior":
        """Prior of a hull that nobody has calibrated."""
        return cls(Gaussian(np.zeros(len(walk)), np.eye(len(walk))), walk)


@dataclass(frozen=True, eq=False)
class MissionHull:
    """The hull of a mission as a function of its dives.

    Attributes
    ----------
    numbers, times : (n,), (n,) of numpy.datetime64
        Of the profiles.
    smoothed, sequential : tuple of Gaussian
        ``eta`` at every dive, in plausible deviations, by all dives and by the dives up to each.
    log_evidence : float
        Of all dives, weights applied.
    inflation : float
        Variance by which the dives differ over what they state; at least one.
    weight, chi_square : (n,)
        Weight of each dive, and its chi-square against the rest.
    freedom : (n,) of int
        Degrees of freedom of the latter.
    prior : HullPrior
        The prior.
    change, change_std : (n, p)
        Change of ``eta`` since the first dive by all dives, and its standard deviation.
    """

    numbers: NDArray[np.int64]
    times: NDArray[np.datetime64]
    smoothed: tuple[Gaussian, ...]
    sequential: tuple[Gaussian, ...]
    log_evidence: float
    inflation: float
    weight: Array
    chi_square: Array
    freedom: NDArray[np.int64]
    prior: HullPrior
    change: Array
    change_std: Array

    @property
    def eta(self) -> Array:
        """Mean (n, p) at every dive, by all."""
        return np.array([each.mean for each in self.smoothed])

    @property
    def std(self) -> Array:
        """Standard deviation (n, p) at every dive, by all."""
        return np.array([each.std for each in self.smoothed])

    @property
    def overall(self) -> Gaussian:
        """Distribution of ``eta`` of any of the dives: mean and covariance, the walk included."""
        apart = self.eta - self.eta.mean(axis=0)
        covariance = np.mean([each.covariance for each in self.smoothed], axis=0) + apart.T @ apart / len(apart)
        return Gaussian(self.eta.mean(axis=0), covariance)

    def directions(self) -> tuple[Array, Array]:
        """Deviations (p,) left over those of the prior, and directions (p, p) in rows, the best determined first.

        Notes
        -----
        Eigenvectors of the posterior covariance at the middle dive, relative to the prior's.
        """
        root = np.linalg.cholesky(self.prior.eta.covariance)
        half = scipy.linalg.solve_triangular(root, self.smoothed[len(self.smoothed) // 2].covariance, lower=True)
        relative = scipy.linalg.solve_triangular(root, half.T, lower=True)
        values, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
        return np.sqrt(np.maximum(values, 0.0)), (root @ vectors).T


def solve_mission(
    dives: Sequence[DiveTerm], prior: HullPrior, *, robust: bool = True, turn_test: TurnTestSettings | None = None
) -> MissionHull:
    """Add up the dives of a mission.

    Parameters
    ----------
    dives : sequence of DiveTerm
        In the order of time, at least one.
    prior : HullPrior
        What was known before.
    robust : bool
        Whether the dives' statements are inflated by how they differ, and those that do not fit count less.
    turn_test : TurnTestSettings, optional
        How alike the dives' currents are; without, or where fewer than two dives have one, they do not count.

    Notes
    -----
    The inflation is that with which the median dive's chi-square against the rest is what chance makes it; all
    information is divided by it. A dive whose chi-square then exceeds the quantile of 99 % has its information divided
    by how many times it does.

    What depends on the assumption of the noise is not known: where the sum moves under the others, weights and
    inflation the same, the dives count for less, and the covariance grows (`with_doubt`).
    """
    weight, inflation = np.ones(len(dives)), 1.0
    problem = _posed(dives, prior, turn_test)
    if robust and len(dives) >= MIN_COMPARED:
        for _ in range(_ROUNDS):
            chi_square, freedom = problem.disagreements(inflation, weight)
            inflation = max(1.0, inflation * _excess(chi_square, freedom))
            weight = _weights(*problem.disagreements(inflation, weight))
    count = len(prior.walk)
    chain = problem.chain(inflation, weight)
    others = [
        _posed([dive.assuming(i) for dive in dives], prior, turn_test).chain(inflation, weight)
        for i in range(min(len(dive.others) for dive in dives))
    ]
    chi_square, freedom = problem.disagreements(inflation, weight)
    numbers = np.array([dive.number for dive in dives], dtype=np.int64)
    times = np.array([dive.time for dive in dives])
    smoothed = _doubted(prior, times, chain.smoothed, [other.smoothed for other in others], count)
    sequential = _doubted(prior, times, chain.sequential, [other.sequential for other in others], count)
    (change, change_std), *by_others = ([each[:, :count] for each in one.since_first()] for one in (chain, *others))
    change_std = np.sqrt(change_std**2 + sum((other - change) ** 2 for other, _ in by_others))
    return MissionHull(
        numbers, times, smoothed, sequential, chain.log_evidence, inflation, weight, chi_square, freedom, prior,
        change, change_std,
    )  # fmt: skip


def _doubted(
    prior: HullPrior, times: NDArray[np.datetime64], found: Sequence[Gaussian], others: Sequence[Sequence[Gaussian]],
    count: int,
) -> tuple[Gaussian, ...]:  # fmt: skip
    """Distributions of the first unknowns at every dive that contain what depends on the assumption of the noise."""
    days = (times - times[0]) / np.timedelta64(1, "s") / _SECONDS_PER_DAY
    return tuple(
        with_doubt(
            Gaussian(prior.eta.mean, prior.eta.covariance + np.diag(prior.walk**2 * day)), each.part(count),
            [other[i].part(count) for other in others],
        )
        for i, (each, day) in enumerate(zip(found, days.tolist(), strict=True))
    )  # fmt: skip


def with_doubt(before: Gaussian, after: Gaussian, others: Sequence[Gaussian]) -> Gaussian:
    """Distribution of unknowns of which other assumptions, as plausible, say otherwise.

    Parameters
    ----------
    before, after : Gaussian
        Of the unknowns before any dive, and by the dives under one assumption.
    others : sequence of Gaussian
        By the dives under the others.

    Notes
    -----
    With ``L`` and ``h`` the dives' information and its vector, the others are errors of ``h`` that all dives have in
    common: ``h = L eta + U c + e``, a column of ``U`` the vector's change under one of them, ``c`` standard normal and
    ``e`` of covariance ``L``. The mean is that of this problem, with

        L' = L - U (1 + U' L^-1 U)^-1 U',    h' = h - U (1 + U' L^-1 U)^-1 U' L^-1 h

    so that in a direction in which the assumptions contradict each other it stays where it was before the dives. The
    covariance is that by the one assumption, grown by the squares of how far the others move the mean: three
    assumptions are not all that are possible, and those of ``L'`` were measured too narrow.
    """
    if not others:
        return after
    precision, inverse = np.linalg.inv(after.covariance), np.linalg.inv(before.covariance)
    matrix = precision - inverse
    vector = precision @ after.mean - inverse @ before.mean
    moved = np.column_stack([other.mean - after.mean for other in others])
    doubt = precision @ moved
    # Of what the dives know nothing a doubt has no size; the small part of the prior gives it one.
    apart = np.linalg.solve(matrix + _UNINFORMED * inverse, doubt)
    gain = np.linalg.solve(np.eye(len(others)) + doubt.T @ apart, np.column_stack([doubt.T, apart.T @ vector]))
    left, vector = matrix - doubt @ gain[:, :-1], vector - doubt @ gain[:, -1]
    mean = np.linalg.solve(inverse + left, vector + inverse @ before.mean)
    return Gaussian(mean, after.covariance + moved @ moved.T)


def changes_of(dives: Sequence[DiveTerm], walk: Array) -> list[Change]:
    """Changes of the errors between dives by their walk ``(p,)`` per square root of a day."""
    still = np.ones(len(walk))
    return [Change(still, walk**2 * time / _SECONDS_PER_DAY) for time in _seconds_between(dives).tolist()]


def _seconds_between(dives: Sequence[DiveTerm]) -> Array:
    return np.asarray(np.maximum(np.diff([dive.time for dive in dives]) / np.timedelta64(1, "s"), 0.0))


def _posed(dives: Sequence[DiveTerm], prior: HullPrior, turn_test: TurnTestSettings | None) -> "_Problem":
    changes = changes_of(dives, prior.walk)
    if turn_test is None or not turn_test.use or sum(dive.current is not None for dive in dives) < _MIN_CURRENTS:
        return _Problem(prior.eta, changes, [dive.term for dive in dives])
    return _Problem(
        with_current(prior.eta, turn_test), changes_with_current(changes, _seconds_between(dives), turn_test),
        [dive.term_with_current for dive in dives],
    )  # fmt: skip


def predicted_disagreement(found: MissionHull, dive: DiveTerm) -> tuple[float, int]:
    """Chi-square of a dive that was held out against the mission's hull at the dive next to it, and its freedom."""
    index = int(np.argmin(np.abs(found.numbers - dive.number)))
    return found.smoothed[index].disagreement(dive.term.weighted(1.0 / found.inflation))


@dataclass(frozen=True, eq=False)
class _Problem:
    """The sum as a function of inflation and weights."""

    prior: Gaussian
    changes: list[Change]
    terms: list[Information]

    def chain(self, inflation: float, weight: Array) -> Chain:
        return solve_chain(self.prior, self.changes, self._terms(weight / inflation))

    def disagreements(self, inflation: float, weight: Array) -> tuple[Array, NDArray[np.int64]]:
        """Chi-square and degrees of freedom of every dive, whole, against the rest."""
        parts = self._terms(weight / inflation)
        found = [
            each.without(part).disagreement(term.weighted(1.0 / inflation))
            for each, part, term in zip(self.chain(inflation, weight).smoothed, parts, self.terms, strict=True)
        ]
        return np.array([value for value, _ in found]), np.array([freedom for _, freedom in found], dtype=np.int64)

    def _terms(self, parts: Array) -> list[Information]:
        return [term.weighted(part) for term, part in zip(self.terms, parts.tolist(), strict=True)]


def _excess(chi_square: Array, freedom: NDArray[np.int64]) -> float:
    """Chi-square of the median dive over what chance makes of it; one where no dive knows anything."""
    informative = freedom > 0
    if not informative.any():
        return 1.0
    return float(np.median(chi_square[informative] / scipy.stats.chi2.median(freedom[informative])))


def _weights(chi_square: Array, freedom: NDArray[np.int64]) -> Array:
    limit = scipy.stats.chi2.ppf(_FIT_LEVEL, np.maximum(freedom, 1))
    return np.asarray(limit / np.maximum(chi_square, limit))
