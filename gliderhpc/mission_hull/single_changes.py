"""Changes of the hull's errors during a mission: steps or ramps from some profile on, with their probabilities.

Each candidate adds one unknown, the size of the change, to a chain of profiles in which that error is otherwise
constant. A constant unknown enters a Kalman filter in the separate-bias form (Friedland 1969), here in one pass for all
candidates: the derivatives of the means with respect to the size are propagated with the filter, and the log evidence
of the profiles is quadratic in the size.

Different errors of the hull can look alike: lost weight changes the depth rates as a pitch offset does. Changes are
therefore accepted one at a time, the most probable first, and the others are judged with the accepted ones among the
unknowns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gliderhpc.mission_hull.change_scatter import (
    LEVELS,
    LOG_PRIOR,
    MIN_VARIANCE_RATIO,
    averaged_over_levels,
    variance_ratio,
    with_scatter,
)
from gliderhpc.mission_hull.estimate import HullPrior, ProfileTerm, transitions_between
from gliderhpc.mission_hull.gaussian_chain import Array, Gaussian, Information, Transition
from gliderhpc.mission_hull.weighted_sum import SumProblem, WeightedSum

FORMS = ("step", "ramp")

_PROBABILITY_OF_NO_CHANGE = 0.5
"""Prior probability that nothing changes."""
INTERVAL = (0.05, 0.5, 0.95)
"""Levels of the onset's interval and median."""
PROBABLE = 0.95
"""Minimum probability of a change that counts as found."""
POSSIBLE = 0.8
"""Minimum probability of a change that is reported as possible."""
_MIN_SCATTER = 0.3
"""Minimum ratio of the variance between profiles to their stated one; a few profiles can agree by chance."""
_MIN_FREEDOM = 60
"""Degrees of freedom of all profiles at or above which a smaller scatter than stated is taken into account."""
MIN_PROFILES = 4
"""Minimum number of profiles; with fewer, a change cannot be distinguished from their scatter."""


@dataclass(frozen=True, eq=False)
class ErrorChange:
    """Change of one error of the hull.

    Attributes
    ----------
    probability : float
        Probability of a change; its prior is one half.
    total, total_std : float
        Change from the first profile to the last, given that there is one, and its standard deviation, in plausible
        deviations.
    onset : (int, int, int)
        Positions of the first changed profile: lower end of the 90 % interval, median, upper end.
    step_probability : float
        Probability of a step, given a change.
    """

    probability: float
    total: float
    total_std: float
    onset: tuple[int, int, int]
    step_probability: float


def change_chains(
    profiles: Sequence[ProfileTerm],
    suspects: Sequence[int],
    prior: HullPrior,
    size: float = 1.0,
    *,
    robust: bool = True,
) -> list["ChangeChain"]:
    """Return a chain of the profiles for each assumption of the noise (`find_hull_changes` describes the arguments).

    Notes
    -----
    A change shows in the differences between profiles, in which errors that all profiles have in common cancel. If all
    profiles contradict the platform file, the hull has not changed. The levels of the suspects are therefore as
    uncertain as a change is large; otherwise a change after the first profile would excuse all later profiles from the
    prior.

    The profiles' covariances include common errors too. They are therefore scaled by the scatter between profiles, also
    where this is smaller than they state, down to `_MIN_SCATTER`, and further if the suspects alone vary less between
    successive profiles (`change_scatter.variance_ratio`).
    """
    assumptions = _assumptions(profiles)
    free = _with_free_levels(prior, suspects, size)
    parts = np.ones((len(assumptions), len(profiles)))
    if robust:
        parts = _raised(_parts(assumptions, prior), assumptions, free.eta, suspects)
    return [ChangeChain(free, each, part.tolist(), size) for each, part in zip(assumptions, parts, strict=True)]


def single_changes(
    chains: Sequence["ChangeChain"], suspects: Sequence[int], companions: Mapping[int, int] | None = None
) -> dict[int, ErrorChange]:
    """Accept changes one at a time, and judge the remaining suspects given those.

    The chains have the sizes of the accepted changes among their unknowns afterwards.

    Notes
    -----
    Every profile but the first may be the onset, either of a step or of a ramp that reaches its whole size at the last
    profile; all have the same prior probability. With score g and information I of the size about zero, the ratio of a
    candidate's evidence to that of no change is ``exp(g**2 / (I + 1 / size**2) / 2) / sqrt(1 + I * size**2)``. With a
    companion, g and I are those of both sizes, and the candidates with and without it are averaged by their evidence.

    Probabilities, sizes and onsets are means over the assumptions of the noise under which the profiles were smoothed,
    which are equally plausible: a change that only some of them show is not certain.

    While the suspect with the largest evidence is probable, it is accepted: the sizes of its most probable course, and
    of the same course of its companion, join the unknowns, and the remaining suspects are judged given them.
    """
    companions, onsets = companions or {}, chains[0].onsets
    changes: dict[int, ErrorChange] = {}
    remaining = list(suspects)
    while remaining:
        sought = {i: [chain.candidates(i, companions.get(i)) for chain in chains] for i in remaining}
        sought |= {
            i: [chain.candidates_with_scatter(i, companions.get(i)) for chain in chains]
            for i, each in sought.items()
            if _probability_of(each) >= POSSIBLE
        }
        changes |= {i: _mixture(each, onsets) for i, each in sought.items()}
        best = max(remaining, key=lambda i: float(np.mean([first.log_evidence for first, *_ in sought[i]])))
        if changes[best].probability < PROBABLE:
            break
        remaining.remove(best)
        changing = (best, companions[best]) if best in companions else (best,)
        for chain, (first, *_) in zip(chains, sought[best], strict=True):
            chain.accept(changing, int(np.argmax(first.log_ratio)))
    return {i: changes[i] for i in suspects}


def _with_free_levels(prior: HullPrior, suspects: Sequence[int], size: float) -> HullPrior:
    """Return the prior with the variance of a change added to that of the suspects' levels."""
    variance = np.zeros(len(prior.eta.mean))
    variance[list(suspects)] = size**2
    return replace(prior, eta=Gaussian(prior.eta.mean, prior.eta.covariance + np.diag(variance)))


def _assumptions(profiles: Sequence[ProfileTerm]) -> list[Sequence[ProfileTerm]]:
    """Profiles under each assumption of the noise that all of them have."""
    count = min(len(profile.others) for profile in profiles)
    return [
        profiles,
        *([profile.under_assumption(i) for profile in profiles] for i in range(count)),
    ]


def _parts(assumptions: Sequence[Sequence[ProfileTerm]], prior: HullPrior) -> Array:
    """Factors on the information of the profiles ``(assumption, profile)`` that bring it to their scatter."""
    terms = [Information.stacked([profile.term for profile in same]) for same in zip(*assumptions, strict=True)]

    def total(walk: Array) -> WeightedSum:
        return WeightedSum.plain(SumProblem(prior.eta, transitions_between(assumptions[0], walk), terms))

    # A random walk that is too large would pass for profiles that agree, so that smaller scatter is judged without it.
    constant = total(np.zeros(len(prior.walk))).agreeing(_MIN_SCATTER)
    walks = (constant.inflation >= 1.0) | (constant.disagreements[1].sum(axis=-1) < _MIN_FREEDOM)
    return np.where(walks[:, None], total(prior.walk).agreeing().part, constant.part) if walks.any() else constant.part


def _raised(
    part: Array, assumptions: Sequence[Sequence[ProfileTerm]], prior: Gaussian, suspects: Sequence[int]
) -> Array:
    """Factors on the information, raised where the suspects vary less between successive profiles than stated."""
    ratio = [variance_ratio([profile.term for profile in same], prior, suspects) for same in assumptions]
    # The largest factor is that of a profile with full weight, the reciprocal of the profiles' inflation.
    raised = 1.0 / np.maximum(ratio, MIN_VARIANCE_RATIO) / part.max(axis=1)
    return np.asarray(part * np.maximum(1.0, raised)[:, None])


class ChangeChain:
    """Profiles under one assumption of the noise, with the sizes of the accepted changes among the unknowns."""

    def __init__(
        self, prior: HullPrior, profiles: Sequence[ProfileTerm], weights: Sequence[float], size: float
    ) -> None:
        self._profiles, self._walk, self._size = profiles, prior.walk, size
        self._prior = prior.eta
        self._terms = [profile.term.weighted(weight) for profile, weight in zip(profiles, weights, strict=True)]
        self._shapes = np.concatenate([_shapes(profiles, form) for form in FORMS])

    @property
    def onsets(self) -> int:
        """Number of profiles that may be the first changed one."""
        return len(self._profiles) - 1

    def candidates(self, parameter: int, companion: int | None) -> list["_Candidates"]:
        """Candidates for the change of an error, alone and with its companion."""
        return self._with_and_without(self._likelihood({}, parameter, companion))

    def candidates_with_scatter(self, parameter: int, companion: int | None) -> list["_Candidates"]:
        """Candidates for the change of an error that also scatters from dive to dive, averaged over `LEVELS`."""
        likelihoods = [self._likelihood({parameter: level}, parameter, companion) for level in LEVELS]
        log_weight = LOG_PRIOR + [each.log_evidence for each in likelihoods]
        by_level = [self._with_and_without(each) for each in likelihoods]
        return [
            _Candidates(*averaged_over_levels(log_weight, *map(np.array, zip(*each, strict=True))))
            for each in zip(*by_level, strict=True)
        ]

    def scatter(self, parameter: int) -> float:
        """Standard deviation (root mean square) of an error's scatter from dive to dive, in plausible deviations.

        It is a mean over a changed and an unchanged error, which are equally probable before the dives.
        """
        evidence = []
        for level in LEVELS:
            likelihood = self._likelihood({parameter: level}, parameter, None)
            (candidates,) = self._with_and_without(likelihood)
            evidence.append(likelihood.log_evidence + np.logaddexp(0.0, candidates.log_evidence))
        log_weight = LOG_PRIOR + evidence
        share = np.exp(log_weight - np.logaddexp.reduce(log_weight))
        return float(np.sqrt(share @ np.square(LEVELS)))

    def joint_likelihood(
        self, parameters: Sequence[int], scatter: Mapping[int, float] | None = None
    ) -> "SizeLikelihood":
        """Likelihood of the sizes of errors that change together.

        The errors scatter from dive to dive by the standard deviations given.
        """
        terms, changes = self._scattered(scatter or {}), self._changes(parameters)
        return size_likelihood(self._prior, changes, terms, parameters, self._shapes)

    def _scattered(self, deviations: Mapping[int, float]) -> list[Information]:
        """Information of the dives if some errors scatter from dive to dive, by the errors' standard deviations."""
        deviation = np.zeros(len(self._prior.mean))
        deviation[list(deviations)] = list(deviations.values())
        return [with_scatter(term, deviation) for term in self._terms]

    def _likelihood(self, scatter: Mapping[int, float], parameter: int, companion: int | None) -> "SizeLikelihood":
        """Likelihood of the sizes of an error and of its companion, which keeps its random walk."""
        changing = (parameter,) if companion is None else (parameter, companion)
        changes = self._changes((parameter,))
        return size_likelihood(self._prior, changes, self._scattered(scatter), changing, self._shapes)

    def _with_and_without(self, likelihood: "SizeLikelihood") -> list["_Candidates"]:
        """Candidates for the change of the first error alone, and together with its companion if there is one."""
        score, information = likelihood.score, likelihood.information
        counts = range(1, score.shape[1] + 1)
        return [_candidates(score[:, :count], information[:, :count, :count], self._size) for count in counts]

    def _changes(self, constant: Sequence[int]) -> list[Transition]:
        """Changes between the profiles, without the random walk of some errors."""
        walk = self._walk.copy()
        walk[list(constant)] = 0.0
        return [_with_constants(each, len(self._prior.mean)) for each in transitions_between(self._profiles, walk)]

    def accept(self, parameters: Sequence[int], shape: int) -> None:
        """Add the sizes of a change of these errors, with one course, to the unknowns."""
        before, added = len(self._prior.mean), len(parameters)
        covariance = np.diag(np.append(np.zeros(before), np.full(added, self._size**2)))
        covariance[:before, :before] = self._prior.covariance
        self._prior = Gaussian(np.append(self._prior.mean, np.zeros(added)), covariance)
        self._terms = [
            _with_sizes(term, parameters, part)
            for term, part in zip(self._terms, self._shapes[shape].tolist(), strict=True)
        ]


def _with_constants(change: Transition, count: int) -> Transition:
    """Return a change between profiles with further unknowns that stay constant, ``count`` in all."""
    added = count - len(change.decay)
    return Transition(np.append(change.decay, np.ones(added)), np.append(change.variance, np.zeros(added)))


def _with_sizes(term: Information, parameters: Sequence[int], part: float) -> Information:
    """Return a profile's information with one further unknown for each parameter, whose part adds to the parameter."""
    count = len(term.vector)
    lift = np.eye(count, count + len(parameters))
    lift[list(parameters), range(count, count + len(parameters))] = part
    return Information(lift.T @ term.vector, lift.T @ term.matrix @ lift, term.constant)


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
    log_ratio, mean, covariance = size_posterior(score, information, size)
    return _Candidates(log_ratio, mean[:, 0], np.asarray(covariance[:, 0, 0]))


def size_posterior(score: Array, information: Array, size: float) -> tuple[Array, Array, Array]:
    """Log evidence ``(m,)`` of candidates relative to no change, and mean ``(m, k)`` and covariance of their k sizes.

    `score` (m, k) and `information` (m, k, k) are those of the sizes about zero, whose prior deviation is `size`.
    """
    covariance = np.linalg.inv(information + np.eye(score.shape[1]) / size**2)
    mean = np.einsum("mkl,ml->mk", covariance, score)
    log_ratio = 0.5 * np.sum(score * mean, axis=1) + 0.5 * np.linalg.slogdet(covariance / size**2)[1]
    return np.asarray(log_ratio), np.asarray(mean), np.asarray(covariance)


def _shapes(profiles: Sequence[ProfileTerm], form: str) -> Array:
    """Course of the change over the profiles ``(onset, profile)``, from zero to one, for every onset but the first."""
    day = (np.array([profile.time for profile in profiles]) - profiles[0].time) / np.timedelta64(1, "D")
    index = np.arange(len(profiles))
    changed = index >= index[1:, None]
    if form == "step":
        return changed.astype(np.float64)
    # The ramp starts from zero at the profile before the onset.
    start = day[:-1, None]
    return np.asarray(np.where(changed, (day - start) / np.maximum(day[-1] - start, 1e-9), 0.0))


class SizeLikelihood(NamedTuple):
    """Likelihood of the sizes of candidates about zero.

    Attributes
    ----------
    score, information : (m, k), (m, k, k)
        Score and information of the k sizes of each of m candidates.
    log_evidence : float
        Log evidence of the profiles without a change.
    """

    score: Array
    information: Array
    log_evidence: float


def size_likelihood(
    prior: Gaussian,
    changes: Sequence[Transition],
    terms: Sequence[Information],
    parameters: Sequence[int],
    shapes: Array,
) -> SizeLikelihood:
    """Compute the likelihood of the sizes of candidates, in one pass over the profiles.

    Parameters
    ----------
    prior : Gaussian
        Prior of the unknowns at the first profile.
    changes : sequence of Transition
        Changes before the second profile, the third ...
    terms : sequence of Information
        Information of the profiles.
    parameters : sequence of int
        Indices of the k unknowns that change, each by a different size.
    shapes : (m, n)
        Course of the change over the profiles.
    """
    belief, evidence = prior, 0.0
    # Until its change begins, a candidate adds nothing: those that have begun come first.
    begins = np.argmax(shapes != 0.0, axis=1)
    order = np.argsort(begins, kind="stable")
    begun = np.searchsorted(begins[order], np.arange(len(terms)), side="right")
    count, candidates, sizes = len(prior.mean), len(shapes), len(parameters)
    sensitivity, seen = np.zeros((2, candidates, sizes, count))
    score, information = np.zeros((candidates, sizes)), np.zeros((candidates, sizes, sizes))
    for number, (term, active) in enumerate(zip(terms, begun.tolist(), strict=True)):
        if number:
            belief = changes[number - 1].applied(belief)
            sensitivity[:active] *= changes[number - 1].decay
        # Derivative of the unknowns at this profile with respect to the sizes, relative to that of the filter's mean.
        seen[:active] = sensitivity[:active]
        for k, parameter in enumerate(parameters):
            seen[:active, k, parameter] += shapes[order[:active], number]
        missing = term.vector - term.matrix @ belief.mean
        after, gained = belief.updated(term)
        evidence += float(gained)
        gain = after.covariance @ term.matrix
        # One product of matrices, which is much faster than one for every candidate.
        flat = seen[:active].reshape(-1, count)
        score[:active] += (flat @ (missing - gain.T @ missing)).reshape(active, sizes)
        believed = (flat @ (term.matrix - term.matrix @ gain)).reshape(active, sizes, count)
        information[:active] += believed @ seen[:active].mT
        sensitivity[:active] -= (flat @ gain.T).reshape(active, sizes, count)
        belief = after
    place = np.argsort(order)
    return SizeLikelihood(score[place], information[place], evidence)


def _mixture(assumptions: Sequence[Sequence[_Candidates]], onsets: int) -> ErrorChange:
    """Average over the candidates, weighted by their evidence, and over equally plausible assumptions.

    Each assumption has the candidates without companion first, and of each kind the steps first.
    """
    weights = [_weights(candidates) for candidates in assumptions]
    weight = np.concatenate(weights) / len(weights)
    every = [each for candidates in assumptions for each in candidates]
    size, variance = np.concatenate([one.size for one in every]), np.concatenate([one.variance for one in every])
    total = float(weight @ size)
    spread = float(np.sqrt(weight @ (variance + (size - total) ** 2)))
    by_form = weight.reshape(len(every), len(FORMS), onsets).sum(axis=0)
    by_onset = by_form.sum(axis=0).cumsum()
    low, middle, high = (1 + int(np.searchsorted(by_onset, level)) for level in INTERVAL)
    return ErrorChange(
        _probability_of(assumptions),
        total,
        spread,
        (low, min(middle, onsets), min(high, onsets)),
        float(by_form[FORMS.index("step")].sum()),
    )


def _probability_of(assumptions: Sequence[Sequence[_Candidates]]) -> float:
    """Probability of a change, which is the mean over equally plausible assumptions."""
    return float(np.mean([probability_of_evidence(first.log_evidence) for first, *_ in assumptions]))


def _weights(candidates: Sequence[_Candidates]) -> Array:
    """Posterior probabilities of candidates, given that one of them is true."""
    log_ratio = np.concatenate([each.log_ratio for each in candidates])
    weight = np.exp(log_ratio - log_ratio.max())
    return np.asarray(weight / weight.sum())


def probability_of_evidence(log_evidence: float) -> float:
    """Posterior probability of a change with this log evidence relative to none."""
    odds = np.exp(min(log_evidence, 700.0)) * (1.0 - _PROBABILITY_OF_NO_CHANGE) / _PROBABILITY_OF_NO_CHANGE
    return float(odds / (1.0 + odds))
