"""The mission's hull: errors ``eta`` of a hull and its records, estimated from all profiles (docs/smoother.md).

Each profile gives a score and an information. They are added to the prior, with a random walk from profile to profile
for the errors that can change. No model is exact, and profiles differ from one another by more than their own
covariances state. The ratio of the two variances is estimated from the profiles, and their information is divided by
it. A profile that does not fit the rest has less weight. The assumed noise of the disturbances is common to all
profiles. Where other assumptions give other results, the profiles have less influence on the mean, and the covariance
is larger.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.distributions import gamma_tail
from gliderhpc.mission_hull.gaussian_chain import (
    Array,
    Gaussian,
    Information,
    Transition,
    information_about,
    times_vector,
)
from gliderhpc.mission_hull.turn_test import (
    ProfileCurrent,
    TurnTestSettings,
    changes_with_current,
    extended_information,
    with_current,
)
from gliderhpc.mission_hull.weighted_sum import SumProblem, WeightedSum
from gliderhpc.observations.times import SECOND

ScoreAndInformation = tuple[Array, Array]
"""Gradient (p,) of a log-likelihood and its expected curvature (p, p)."""

_SECONDS_PER_DAY = 86400.0
_MIN_CURRENTS = 2
"""Minimum number of currents; a single one gives no information."""
_UNINFORMED = 1e-9
"""Fraction of the prior's information that is added where the profiles have none."""
MIN_COMPARED = 4
"""Minimum number of profiles for an estimate of their scatter."""


@dataclass(frozen=True, eq=False)
class ProfileTerm:
    """Information of one profile on the hull.

    Attributes
    ----------
    number : int
        Number of the profile.
    time : numpy.datetime64
        Time of the profile.
    point : (p,)
        Value of ``eta`` about which the profile was smoothed, in plausible deviations.
    score : (p,)
        Gradient of the profile's log-likelihood at that point.
    information : (p, p)
        Expected curvature at that point.
    others : tuple of (score, information)
        Score and information under other assumptions of the noise.
    current : ProfileCurrent, optional
        Depth-averaged current, for the turn test.
    """

    number: int
    time: np.datetime64
    point: Array
    score: Array
    information: Array
    others: tuple[ScoreAndInformation, ...] = ()
    current: ProfileCurrent | None = None

    @property
    def term(self) -> Information:
        """Log-likelihood of eta, up to a constant."""
        return information_about(self.score, self.information, self.point)

    def under_assumption(self, other: int) -> "ProfileTerm":
        """Return the profile under one of the other assumptions of the noise."""
        score, information = self.others[other]
        return replace(self, score=score, information=information)

    def weakened(self, divisor: float) -> "ProfileTerm":
        """Return the profile with all its information divided by a number."""
        others = tuple((score / divisor, information / divisor) for score, information in self.others)
        return replace(self, score=self.score / divisor, information=self.information / divisor, others=others)

    @property
    def term_with_current(self) -> Information:
        """Log-likelihood of eta and the current's unknowns, with the information of the current."""
        term = extended_information(self.term)
        return term if self.current is None else term + self.current.information(self.point)


@dataclass(frozen=True, eq=False)
class HullPrior:
    """Prior of the hull's errors, before any profile.

    Attributes
    ----------
    eta : Gaussian
        Mean (p,) and covariance (p, p) at the first profile: ``N(0, 1)`` for a hull that has not been calibrated.
    walk : (p,)
        Standard deviation of the random walk per square root of a day.
    jumps : mapping of int to (p,)
        Variances of abrupt changes, by the position of the first profile after the change.
    """

    eta: Gaussian
    walk: Array
    jumps: Mapping[int, Array] = field(default_factory=dict)

    @classmethod
    def plausible(cls, walk: Array) -> "HullPrior":
        """Prior of a hull that has not been calibrated."""
        return cls(Gaussian(np.zeros(len(walk)), np.eye(len(walk))), walk)


@dataclass(frozen=True, eq=False)
class MissionHull:
    """Errors of a mission's hull at every profile.

    Attributes
    ----------
    numbers, times : (n,), (n,) of numpy.datetime64
        Numbers and times of the profiles.
    smoothed, sequential : tuple of Gaussian
        Distributions of ``eta`` at every profile, in plausible deviations, given all profiles and given the profiles up
        to each.
    log_evidence : float
        Log evidence of all profiles, with their weights.
    inflation : float
        Ratio of the variance between profiles to their stated variance; at least one.
    weight, chi_square : (n,)
        Weight of each profile, and its chi-square relative to the rest.
    freedom : (n,) of int
        Degrees of freedom of the chi-square.
    prior : HullPrior
        Prior of the errors.
    change, change_std : (n, p)
        Change of ``eta`` since the first profile, given all profiles, and its standard deviation.
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
        """Mean (n, p) at every profile, given all profiles."""
        return np.array([distribution.mean for distribution in self.smoothed])

    @property
    def std(self) -> Array:
        """Standard deviation (n, p) at every profile, given all profiles."""
        return np.array([distribution.std for distribution in self.smoothed])

    @property
    def overall(self) -> Gaussian:
        """Distribution of ``eta`` over all profiles: mean and covariance, including the random walk."""
        departures = self.eta - self.eta.mean(axis=0)
        within = np.mean([distribution.covariance for distribution in self.smoothed], axis=0)
        return Gaussian(self.eta.mean(axis=0), within + departures.T @ departures / len(departures))

    def directions(self) -> tuple[Array, Array]:
        """Deviations (p,) relative to the prior's, and their directions (p, p) in rows, the best determined first.

        Notes
        -----
        Eigenvectors of the posterior covariance at the middle profile, relative to the prior's.
        """
        root = np.linalg.cholesky(self.prior.eta.covariance)
        half = scipy.linalg.solve_triangular(root, self.smoothed[len(self.smoothed) // 2].covariance, lower=True)
        relative = scipy.linalg.solve_triangular(root, half.T, lower=True)
        values, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
        return np.sqrt(np.maximum(values, 0.0)), (root @ vectors).T


def solve_mission(
    profiles: Sequence[ProfileTerm], prior: HullPrior, *, robust: bool = True, turn_test: TurnTestSettings | None = None
) -> MissionHull:
    """Combine the information of a mission's profiles.

    Parameters
    ----------
    profiles : sequence of ProfileTerm
        Profiles in time order, at least one.
    prior : HullPrior
        Prior of the errors.
    robust : bool
        Whether the profiles' covariances are inflated by the scatter between profiles, and outlying profiles have less
        weight.
    turn_test : TurnTestSettings, optional
        Settings of the turn test. Currents are not used without it, or if fewer than two profiles have one.

    Notes
    -----
    The inflation is chosen to bring the median profile's chi-square, relative to the rest, to the median of the
    chi-square distribution; all information is divided by it. If a profile's chi-square then exceeds the 99 % quantile,
    its information is divided by the ratio of the two.

    The result also depends on the assumed noise. Where it moves under the other assumptions, with the same weights and
    inflation, the profiles have less influence on the mean, and the covariance grows (`widen_by_disagreement`).
    """
    total = WeightedSum.plain(_pose_problem(profiles, prior, turn_test))
    if robust and len(profiles) >= MIN_COMPARED:
        total = total.agreeing()
    count = len(prior.walk)
    chain, (chi_square, freedom) = total.chain, total.disagreements
    numbers = np.array([profile.number for profile in profiles], dtype=np.int64)
    times = np.array([profile.time for profile in profiles])
    change, change_std = (each[:, :count] for each in chain.since_first())
    smoothed, sequential = chain.smoothed, chain.sequential
    problems = _pose_other_problems(profiles, prior, turn_test)
    if problems is not None:
        other = replace(total, problem=problems).chain
        smoothed = _widen_by_assumptions(prior, times, smoothed, other.smoothed)
        sequential = _widen_by_assumptions(prior, times, sequential, other.sequential)
        moved = other.since_first()[0][..., :count] - change[:, None]
        change_std = np.sqrt(change_std**2 + np.sum(moved**2, axis=1))
    return MissionHull(
        numbers,
        times,
        Gaussian.stacked(smoothed).part(count).unstacked(),
        Gaussian.stacked(sequential).part(count).unstacked(),
        float(chain.log_evidence),
        float(total.inflation),
        total.weight,
        chi_square,
        freedom,
        prior,
        change,
        change_std,
    )


def _widen_by_assumptions(
    prior: HullPrior, times: NDArray[np.datetime64], posterior: Sequence[Gaussian], others: Sequence[Gaussian]
) -> tuple[Gaussian, ...]:
    """Distributions of the errors at every profile, including the uncertainty from the assumed noise.

    ``others`` are those under the other assumptions, along a leading axis.
    """
    count = len(prior.walk)
    days = (times - times[0]) / SECOND / _SECONDS_PER_DAY
    added = prior.walk**2 * days[:, None] + [_jump_variances(prior, position) for position in range(len(days))]
    before = Gaussian(prior.eta.mean, prior.eta.covariance + added[:, None] * np.eye(count))
    after = Gaussian.stacked(posterior).part(count)
    moved = np.stack([other.mean[:, :count] for other in others]) - after.mean[:, None]
    return widen_by_disagreement(before, after, moved).unstacked()


def _jump_variances(prior: HullPrior, position: int) -> Array:
    """Variances ``(p,)`` of the abrupt changes up to a profile."""
    variances = [variance for first, variance in prior.jumps.items() if first <= position]
    return np.asarray(np.sum(variances, axis=0)) if variances else np.zeros(len(prior.walk))


def widen_by_disagreement(before: Gaussian, after: Gaussian, moved: Array) -> Gaussian:
    """Widen a posterior to include the disagreement of the results under other, equally plausible assumptions.

    Parameters
    ----------
    before, after : Gaussian
        Prior of the unknowns, and posterior given the profiles under one assumption.
    moved : (..., k, p)
        Mean under each of the other assumptions, less that of ``after``.

    Notes
    -----
    Let ``L`` and ``h`` be the information matrix and vector of the profiles. The other assumptions are treated as
    errors of ``h`` that all profiles have in common: ``h = L eta + U c + e``. Each column of ``U`` is the change of the
    vector under one assumption, ``c`` is standard normal and ``e`` has the covariance ``L``. The mean is that of this
    problem, with

        L' = L - U (1 + U' L^-1 U)^-1 U',    h' = h - U (1 + U' L^-1 U)^-1 U' L^-1 h

    In a direction in which the assumptions contradict each other, the mean therefore stays near the prior's. The
    covariance is that under the one assumption, plus the squares of the moves of the mean under the others. The
    covariance that belongs to ``L'`` proved too narrow in tests, since three assumptions are not all possible ones.
    """
    precision, inverse = (np.asarray(np.linalg.inv(each.covariance)) for each in (after, before))
    matrix = precision - inverse
    vector = times_vector(precision, after.mean) - times_vector(inverse, before.mean)
    U = precision @ moved.mT
    # Where the profiles have no information, L is singular; a small part of the prior's information makes it regular.
    solved = np.asarray(np.linalg.solve(matrix + _UNINFORMED * inverse, U))
    right = np.concatenate([U.mT, solved.mT @ vector[..., None]], axis=-1)
    gain = np.asarray(np.linalg.solve(np.eye(moved.shape[-2]) + U.mT @ solved, right))
    reduced, vector = matrix - U @ gain[..., :-1], vector - times_vector(U, gain[..., -1])
    mean = np.linalg.solve(inverse + reduced, (vector + times_vector(inverse, before.mean))[..., None])
    return Gaussian(np.asarray(mean[..., 0]), after.covariance + moved.mT @ moved)


def prior_predictive_test(errors: Gaussian) -> tuple[float, float, float]:
    """Compare the size of the estimated errors, in plausible deviations, with the size expected from the prior.

    Parameters
    ----------
    errors : Gaussian
        Errors ``m`` and their covariance ``C`` after the profiles; before, they had a unit covariance.

    Returns
    -------
    float, float, float
        Sum of squares ``m' m``, its expectation, and the probability of a sum at least as large.

    Notes
    -----
    Over missions, ``m`` has the covariance ``1 - C``. The sum is a weighted sum of chi-squares whose weights are the
    eigenvalues of ``1 - C``; its distribution is that of a gamma variable of the same mean and variance (Satterthwaite
    1946).
    """
    weights = np.clip(1.0 - np.linalg.eigvalsh(errors.covariance), 0.0, 1.0)
    size, expected, variance = float(errors.mean @ errors.mean), float(weights.sum()), 2.0 * float(weights @ weights)
    if expected == 0.0:
        return size, 0.0, 1.0 if size == 0.0 else 0.0
    return size, expected, gamma_tail(size, expected**2 / variance, variance / expected)


def transitions_between(
    profiles: Sequence[ProfileTerm], walk: Array, jumps: Mapping[int, Array] | None = None
) -> list[Transition]:
    """Changes of the errors between profiles, from their random walk ``(p,)`` per square root of a day and jumps."""
    no_decay, no_jump, jumps = np.ones(len(walk)), np.zeros(len(walk)), jumps or {}
    return [
        Transition(no_decay, walk**2 * time / _SECONDS_PER_DAY + jumps.get(position, no_jump))
        for position, time in enumerate(_seconds_between(profiles).tolist(), 1)
    ]


def _seconds_between(profiles: Sequence[ProfileTerm]) -> Array:
    return np.asarray(np.maximum(np.diff([profile.time for profile in profiles]) / SECOND, 0.0))


def _pose_problem(profiles: Sequence[ProfileTerm], prior: HullPrior, turn_test: TurnTestSettings | None) -> SumProblem:
    changes = transitions_between(profiles, prior.walk, prior.jumps)
    currents = sum(profile.current is not None for profile in profiles)
    if turn_test is None or not turn_test.use or currents < _MIN_CURRENTS:
        return SumProblem(prior.eta, changes, [profile.term for profile in profiles])
    return SumProblem(
        with_current(prior.eta, turn_test),
        changes_with_current(changes, _seconds_between(profiles), turn_test),
        [profile.term_with_current for profile in profiles],
    )


def _pose_other_problems(
    profiles: Sequence[ProfileTerm], prior: HullPrior, turn_test: TurnTestSettings | None
) -> SumProblem | None:
    """Pose the problems of all other assumptions of the noise at once; None if the profiles have none."""
    problems = [
        _pose_problem([profile.under_assumption(i) for profile in profiles], prior, turn_test)
        for i in range(min(len(profile.others) for profile in profiles))
    ]
    if not problems:
        return None
    terms = [Information.stacked(same) for same in zip(*(each.terms for each in problems), strict=True)]
    return replace(problems[0], terms=terms)


def predicted_disagreement(found: MissionHull, profile: ProfileTerm) -> tuple[float, int]:
    """Chi-square, and its degrees of freedom, of a held-out profile relative to the hull at the nearest profile."""
    index = int(np.argmin(np.abs(found.numbers - profile.number)))
    chi_square, freedom = found.smoothed[index].disagreement(profile.term.weighted(1.0 / found.inflation))
    return float(chi_square), int(freedom)
