"""Probability that any parameter of the hull has changed, and the most probable combination of changes.

Two changes that begin together, such as fouling and a leak, can each be uncertain while the dives leave no doubt that
something has changed: their effects resemble one another. Every combination of the suspected errors is therefore
compared with no change, with one onset and one course for all of them, but a size for each.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gliderhpc.mission_hull.change_scatter import averaged_over_levels
from gliderhpc.mission_hull.estimate import HullPrior, ProfileTerm
from gliderhpc.mission_hull.gaussian_chain import Array
from gliderhpc.mission_hull.single_changes import (
    FORMS,
    INTERVAL,
    MIN_PROFILES,
    POSSIBLE,
    PROBABLE,
    ChangeChain,
    ErrorChange,
    change_chains,
    probability_of_evidence,
    single_changes,
    size_posterior,
)

_INCLUDED = 0.25
"""Prior probability that an error is one of those that change, given that any changes."""

_SCATTER_FACTORS = (0.0, 0.5, 1.0, 2.0)
"""Factors tried on the scatter of the errors from dive to dive."""


@dataclass(frozen=True)
class JointChange:
    """Change of any of the suspected errors.

    Attributes
    ----------
    probability : float
        Probability that at least one of the errors has changed; its prior is one half.
    onset : (int, int, int)
        Positions of the first changed profile: lower end of the 90 % interval, median, upper end.
    step_probability : float
        Probability of a step, given a change.
    combination : tuple of int
        Errors of the most probable combination.
    combination_probability : float
        Probability of this combination, given a change.
    total, total_std : tuple of float
        Changes of these errors from the first profile to the last, and their standard deviations, in plausible
        deviations, given that this combination changed.
    included : dict of int to float
        Probability that each of the suspected errors is among those that changed, given a change.
    """

    probability: float
    onset: tuple[int, int, int]
    step_probability: float
    combination: tuple[int, ...]
    combination_probability: float
    total: tuple[float, ...]
    total_std: tuple[float, ...]
    included: dict[int, float]


def find_hull_changes(
    profiles: Sequence[ProfileTerm],
    suspects: Sequence[int],
    prior: HullPrior,
    size: float = 1.0,
    companions: Mapping[int, int] | None = None,
    *,
    robust: bool = True,
) -> tuple[dict[int, ErrorChange | None], JointChange | None]:
    """Estimate the probability, size and onset of a change of each suspected error, and of any of them.

    Parameters
    ----------
    profiles : sequence of ProfileTerm
        Profiles in the order of time.
    suspects : sequence of int
        Indices of the errors that may change.
    prior : HullPrior
        Prior of the sum; the random walk of an error is left out where its change is sought.
    size : float
        Prior standard deviation of a whole change, and of the suspects' levels in addition to that of the prior, in
        plausible deviations.
    companions : mapping of int to int, optional
        Index of an error that may change at the same time as a suspect, with the same course but another size. It
        is considered in the size and onset of the change, but not in its probability.
    robust : bool
        Whether the profiles' covariances are scaled by the scatter between profiles, and outlying profiles have less
        weight.

    Returns
    -------
    changes : dict
        Change of each suspect, given the probable changes of others (`single_changes`); None with fewer than four
        profiles.
    joint : JointChange or None
        Change of any of the suspects; None with fewer than four profiles, or without suspects.

    Notes
    -----
    Given that anything changes, each error changes with a prior probability of one quarter. The evidence of a
    combination is that of the sizes of all its errors, averaged over onsets and forms; one with a companion is averaged
    with and without it. A random walk of the suspects is left out.

    If the probability is high enough to be reported and no single error is probable, it is computed again with errors
    that also scatter from dive to dive (`change_scatter`), by the scatter that each of them shows alone, times unknown
    factors. The probability that something has changed is at least that of each single error, which has fewer
    alternatives than the combinations.
    """
    if len(profiles) < MIN_PROFILES or not suspects:
        return dict.fromkeys(suspects), None
    companions = companions or {}
    chains = change_chains(profiles, suspects, prior, size, robust=robust)
    changes = single_changes([copy(chain) for chain in chains], suspects, companions)
    most = max(change.probability for change in changes.values())
    combined, members = _combinations(suspects, companions)
    found = [_evidence(chain, combined, members, size) for chain in chains]
    if most < PROBABLE and _probability(found) >= POSSIBLE:
        found = [_evidence_with_scatter(chain, combined, members, suspects, size) for chain in chains]
    joint = _summary(found, combined, chains[0].onsets)
    # Without the scatter, that of a single error is the better probability.
    probability = most if most >= PROBABLE else max(most, joint.probability)
    return dict(changes), replace(joint, probability=probability)


class _Combination(NamedTuple):
    """Errors that change together, their positions among all that may, and the log of their prior probability."""

    errors: tuple[int, ...]
    positions: list[int]
    log_prior: float


class _Evidence(NamedTuple):
    """Log evidence ``(combination, candidate)`` relative to no change, and means and variances of the sizes."""

    log_ratio: Array
    size: Array
    variance: Array


def _combinations(suspects: Sequence[int], companions: Mapping[int, int]) -> tuple[list[_Combination], list[int]]:
    """Combinations of the suspects, with and without companions, and all errors that may change."""
    members = [*suspects, *(companion for i, companion in companions.items() if i in suspects)]
    found = []
    any_included = 1.0 - (1.0 - _INCLUDED) ** len(suspects)
    for count in range(1, len(suspects) + 1):
        probability = _INCLUDED**count * (1.0 - _INCLUDED) ** (len(suspects) - count) / any_included
        for errors in combinations(suspects, count):
            added = tuple(companions[i] for i in errors if i in companions)
            for each in {errors, errors + added}:
                share = probability / (2.0 if added else 1.0)
                found.append(_Combination(errors, [members.index(i) for i in each], float(np.log(share))))
    return found, members


def _evidence(
    chain: ChangeChain,
    combined: Sequence[_Combination],
    members: Sequence[int],
    size: float,
    scatter: Mapping[int, float] | None = None,
) -> _Evidence:
    score, information, _ = chain.joint_likelihood(members, scatter)
    return _evidence_of(score, information, combined, size)


def _evidence_of(score: Array, information: Array, combined: Sequence[_Combination], size: float) -> _Evidence:
    """Evidence of the combinations, the candidates of each being equally probable, from the sizes' likelihood."""
    shape = (len(combined), *score.shape)
    ratio, means, variances = np.zeros(shape[:2]), np.zeros(shape), np.zeros(shape)
    for row, each in enumerate(combined):
        place = each.positions
        gain, mean, covariance = size_posterior(score[:, place], information[:, place][:, :, place], size)
        means[row][:, place], variances[row][:, place] = mean, np.diagonal(covariance, axis1=1, axis2=2)
        ratio[row] = gain + each.log_prior - np.log(len(score))
    return _Evidence(ratio, means, variances)


def _evidence_with_scatter(
    chain: ChangeChain, combined: Sequence[_Combination], members: Sequence[int], suspects: Sequence[int], size: float
) -> _Evidence:
    """Evidence averaged over factors on the scatter of the suspects from dive to dive."""
    deviation = {i: chain.scatter(i) for i in suspects}
    by_factor, unchanged = [], []
    for factor in _SCATTER_FACTORS:
        scatter = {i: factor * value for i, value in deviation.items()}
        score, information, log_evidence = chain.joint_likelihood(members, scatter)
        by_factor.append(_evidence_of(score, information, combined, size))
        unchanged.append(log_evidence)
    return _Evidence(*averaged_over_levels(np.array(unchanged), *map(np.array, zip(*by_factor, strict=True))))


def _probability(found: Sequence[_Evidence]) -> float:
    """Probability of any change: the mean over equally plausible assumptions of the noise."""
    return float(np.mean([probability_of_evidence(np.logaddexp.reduce(one.log_ratio, axis=None)) for one in found]))


def _summary(found: Sequence[_Evidence], combined: Sequence[_Combination], onsets: int) -> JointChange:
    """Average over the assumptions, and name the most probable combination, its sizes, and the onset of any."""
    weight = np.mean([np.exp(one.log_ratio - np.logaddexp.reduce(one.log_ratio, axis=None)) for one in found], axis=0)
    by_form = weight.sum(axis=0).reshape(len(FORMS), onsets)
    by_onset = by_form.sum(axis=0).cumsum()
    low, middle, high = (min(1 + int(np.searchsorted(by_onset, level)), onsets) for level in INTERVAL)
    shares: dict[tuple[int, ...], float] = {}
    for each, row in zip(combined, weight, strict=True):
        shares[each.errors] = shares.get(each.errors, 0.0) + float(row.sum())
    best = max(shares, key=lambda errors: shares[errors])
    total, total_std = _sizes_of(best, found, combined)
    return JointChange(
        probability=_probability(found),
        onset=(low, middle, high),
        step_probability=float(by_form[FORMS.index("step")].sum()),
        combination=best,
        combination_probability=shares[best],
        total=total,
        total_std=total_std,
        included={
            i: sum(share for errors, share in shares.items() if i in errors)
            for i in sorted({i for each in combined for i in each.errors})
        },
    )


def _sizes_of(
    errors: tuple[int, ...], found: Sequence[_Evidence], combined: Sequence[_Combination]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and standard deviation of the sizes of a combination's errors, which come first among its positions."""
    rows = [row for row, each in enumerate(combined) if each.errors == errors]
    place = combined[rows[0]].positions[: len(errors)]
    log_weight = np.array([one.log_ratio[rows] for one in found])
    weight = np.exp(log_weight - log_weight.max(axis=(1, 2), keepdims=True))
    weight = (weight / weight.sum(axis=(1, 2), keepdims=True) / len(found))[..., None]
    sizes, variances = (
        np.array([getattr(one, name)[rows][..., place] for one in found]) for name in ("size", "variance")
    )
    mean = np.sum(weight * sizes, axis=(0, 1, 2))
    spread = np.sqrt(np.sum(weight * (variances + (sizes - mean) ** 2), axis=(0, 1, 2)))
    return tuple(mean.tolist()), tuple(spread.tolist())
