"""Sum of the profiles' information, with an inflation of their covariances and weights that make the profiles agree."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_quantile
from gliderhpc.estimation.smoother.hull_errors import InformedDirections
from gliderhpc.mission_hull.gaussian_chain import Array, Chain, Gaussian, Information, Transition, solve_chain

_FIT_LEVEL = 0.99
"""Probability of the quantile of chi-square up to which a profile has its full weight."""
_ROUNDS = 4
"""Rounds in which inflation and weights are computed in turn."""


@dataclass(frozen=True, eq=False)
class SumProblem:
    """Prior of the unknowns, their changes between the profiles, and the profiles' information.

    The information may have leading axes: several sums are then computed at once.
    """

    prior: Gaussian
    changes: list[Transition]
    terms: list[Information]

    @cached_property
    def stacked(self) -> Information:
        """Information of all profiles."""
        return Information.stacked(self.terms)

    @cached_property
    def informed(self) -> InformedDirections:
        """Directions in which each profile has information."""
        return InformedDirections.of(self.stacked.matrix)


@dataclass(frozen=True, eq=False)
class WeightedSum:
    """Sum over ``n`` profiles; derived quantities are computed once, when needed.

    Attributes
    ----------
    problem : SumProblem
        The profiles.
    inflation : ()
        Factor on the covariances of all profiles.
    weight : (n,)
        Weight of each profile.
    """

    problem: SumProblem
    inflation: Array
    weight: Array

    @classmethod
    def plain(cls, problem: SumProblem) -> "WeightedSum":
        """Return the sum with each profile's stated covariance, without inflation or weights."""
        leading = problem.terms[0].vector.shape[:-1]
        return cls(problem, np.ones(leading), np.ones((*leading, len(problem.terms))))

    def agreeing(self, least: float = 1.0) -> "WeightedSum":
        """Return the sum with the inflation and the weights that make the profiles agree, computed in turn.

        Parameters
        ----------
        least : float
            Minimum inflation. Below one, covariances are also reduced if the profiles scatter less than stated.
        """
        total = self
        for _ in range(_ROUNDS):
            inflated = total._with_inflation(np.maximum(least, total.inflation * _excess(*total.disagreements)))
            previous, total = total, inflated._with_weight(_weights(*inflated.disagreements))
            if total is previous:
                break
        return total

    def _with_inflation(self, inflation: Array) -> "WeightedSum":
        return self if np.array_equal(inflation, self.inflation) else replace(self, inflation=inflation)

    def _with_weight(self, weight: Array) -> "WeightedSum":
        return self if np.array_equal(weight, self.weight) else replace(self, weight=weight)

    @property
    def part(self) -> Array:
        """Part (n,) of each profile's information that enters the sum."""
        return self.weight / self.inflation[..., None]

    @cached_property
    def chain(self) -> Chain:
        """Distributions of the unknowns at every profile."""
        parts = np.moveaxis(self.part, -1, 0)
        terms = [term.weighted(part) for term, part in zip(self.problem.terms, parts, strict=True)]
        return solve_chain(self.problem.prior, self.problem.changes, terms)

    @cached_property
    def disagreements(self) -> tuple[Array, NDArray[np.int64]]:
        """Chi-square and degrees of freedom of every profile, with full weight, relative to the rest."""
        information, full_weight = self.problem.stacked, 1.0 / self.inflation[..., None]
        others = Gaussian.stacked(self.chain.smoothed).without(information.weighted(self.part))
        return others.disagreement(information.weighted(full_weight), self.problem.informed.weighted(full_weight))


def _excess(chi_square: Array, freedom: NDArray[np.int64]) -> Array:
    """Median over the profiles of chi-square over the median of its distribution; one if no profile has information."""
    informative = freedom > 0
    ratio = chi_square / chi_square_quantile(0.5, np.maximum(freedom, 1))
    uninformed = ~informative.any(axis=-1, keepdims=True)
    return np.asarray(np.nanmedian(np.where(informative, ratio, np.where(uninformed, 1.0, np.nan)), axis=-1))


def _weights(chi_square: Array, freedom: NDArray[np.int64]) -> Array:
    limit = chi_square_quantile(_FIT_LEVEL, np.maximum(freedom, 1))
    return np.asarray(limit / np.maximum(chi_square, limit))
