"""Sum of the dives' information, with an inflation of their covariances and weights that make the dives agree."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_quantile
from gliderhpc.tuning.gaussian_chain import Array, Chain, Change, Gaussian, Information, solve_chain

_FIT_LEVEL = 0.99
"""Probability of the quantile of chi-square up to which a dive has its full weight."""
_ROUNDS = 4
"""Rounds in which inflation and weights are computed in turn."""


@dataclass(frozen=True, eq=False)
class SumProblem:
    """Prior of the unknowns, their changes between the dives, and the dives' information."""

    prior: Gaussian
    changes: list[Change]
    terms: list[Information]


@dataclass(frozen=True, eq=False)
class WeightedSum:
    """Sum over ``n`` dives; what follows from it is computed once, when it is needed.

    Attributes
    ----------
    problem : SumProblem
        The dives.
    inflation : float
        Factor on the covariances of all dives.
    weight : (n,)
        Weight of each dive.
    """

    problem: SumProblem
    inflation: float
    weight: Array

    def agreeing(self, least: float = 1.0) -> "WeightedSum":
        """Return the sum with the inflation and the weights that make the dives agree, computed in turn.

        Parameters
        ----------
        least : float
            Smallest inflation. Below one, dives that agree better than they state are taken to be more accurate.
        """
        total = self
        for _ in range(_ROUNDS):
            inflated = total._with_inflation(max(least, total.inflation * _excess(*total.disagreements)))
            before, total = total, inflated._with_weight(_weights(*inflated.disagreements))
            if total is before:
                break
        return total

    def _with_inflation(self, inflation: float) -> "WeightedSum":
        return self if inflation == self.inflation else replace(self, inflation=inflation)

    def _with_weight(self, weight: Array) -> "WeightedSum":
        return self if np.array_equal(weight, self.weight) else replace(self, weight=weight)

    @cached_property
    def chain(self) -> Chain:
        """Distributions of the unknowns at every dive."""
        return solve_chain(self.problem.prior, self.problem.changes, self._parts)

    @cached_property
    def disagreements(self) -> tuple[Array, NDArray[np.int64]]:
        """Chi-square and degrees of freedom of every dive, with full weight, relative to the rest."""
        found = [
            each.without(part).disagreement(term.weighted(1.0 / self.inflation))
            for each, part, term in zip(self.chain.smoothed, self._parts, self.problem.terms, strict=True)
        ]
        return np.array([value for value, _ in found]), np.array([freedom for _, freedom in found], dtype=np.int64)

    @cached_property
    def _parts(self) -> list[Information]:
        parts = (self.weight / self.inflation).tolist()
        return [term.weighted(part) for term, part in zip(self.problem.terms, parts, strict=True)]


def _excess(chi_square: Array, freedom: NDArray[np.int64]) -> float:
    """Median over the dives of chi-square over the median of its distribution; one if no dive has information."""
    informative = freedom > 0
    if not informative.any():
        return 1.0
    return float(np.median(chi_square[informative] / chi_square_quantile(0.5, freedom[informative])))


def _weights(chi_square: Array, freedom: NDArray[np.int64]) -> Array:
    limit = chi_square_quantile(_FIT_LEVEL, np.maximum(freedom, 1))
    return np.asarray(limit / np.maximum(chi_square, limit))
