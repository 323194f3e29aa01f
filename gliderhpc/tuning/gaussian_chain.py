"""Constant and slowly changing unknowns of a sequence of dives: a Kalman filter and smoother in information form.

A dive enters through its log-likelihood of the unknowns x, ``log p(dive | x) = c + h'x - x'Lx / 2``, which may have no
information in some directions. From dive to dive each unknown is constant, walks randomly, or decays. There are only a
few tens of unknowns, and plain dense algebra suffices.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.hull_errors import disagreement

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Information:
    """Log-likelihood ``c + h'x - x'Lx / 2`` of one dive.

    Attributes
    ----------
    vector : (p,)
        Vector h.
    matrix : (p, p)
        Matrix L, symmetric and positive semi-definite.
    constant : float
        Constant c.
    """

    vector: Array
    matrix: Array
    constant: float = 0.0

    def __add__(self, other: "Information") -> "Information":
        """Return the sum of two independent pieces of information."""
        return Information(self.vector + other.vector, self.matrix + other.matrix, self.constant + other.constant)

    def weighted(self, weight: float) -> "Information":
        """Return the information times a weight."""
        return Information(weight * self.vector, weight * self.matrix, weight * self.constant)


def about(score: Array, information: Array, point: Array) -> Information:
    """Information of a log-likelihood ``g'(x - x0) - (x - x0)'I(x - x0) / 2`` about a point ``x0``."""
    vector = score + information @ point
    return Information(vector, information, -float(score @ point) - 0.5 * float(point @ information @ point))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A normal distribution of the unknowns: mean (p,) and covariance (p, p)."""

    mean: Array
    covariance: Array

    @property
    def std(self) -> Array:
        """Standard deviations (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def part(self, count: int) -> "Gaussian":
        """Return the distribution of the first unknowns."""
        return Gaussian(self.mean[:count], self.covariance[:count, :count])

    def updated(self, term: Information) -> tuple["Gaussian", float]:
        """Return the posterior after a dive, and the log evidence of that dive with this distribution as the prior.

        Notes
        -----
        With the Cholesky factor C of the covariance and ``S = 1 + C'LC``, the posterior covariance is ``C S^-1 C'``.
        This form is stable where a dive has no information, and where it has a million times that of the prior.
        """
        root = np.linalg.cholesky(self.covariance)
        inner = np.linalg.cholesky(np.eye(len(root)) + root.T @ term.matrix @ root)
        # The general solver is faster: on small matrices the triangular one waits for its threads.
        half = np.linalg.solve(inner, root.T)
        covariance = half.T @ half
        missing = term.vector - term.matrix @ self.mean
        gain = covariance @ missing
        evidence = (
            term.constant
            + float(term.vector @ self.mean)
            - 0.5 * float(self.mean @ term.matrix @ self.mean)
            + 0.5 * float(missing @ gain)
            - float(np.log(np.diag(inner)).sum())
        )
        return Gaussian(self.mean + gain, covariance), evidence

    def without(self, term: Information) -> "Gaussian":
        """Return the distribution without one of its dives: the inverse of `updated`."""
        covariance = np.linalg.solve(np.eye(len(self.mean)) - self.covariance @ term.matrix, self.covariance)
        covariance = 0.5 * (covariance + covariance.T)
        return Gaussian(self.mean - covariance @ (term.vector - term.matrix @ self.mean), covariance)

    def disagreement(self, term: Information) -> tuple[float, int]:
        """Return the chi-square of a dive that this distribution does not contain, and its degrees of freedom."""
        return disagreement(term.vector - term.matrix @ self.mean, term.matrix, self.covariance)


@dataclass(frozen=True, eq=False)
class Change:
    """Change of the unknowns before a dive: ``x <- decay x + noise`` with variances, each (p,)."""

    decay: Array
    variance: Array

    def applied(self, before: Gaussian) -> Gaussian:
        """Distribution after the change."""
        covariance = self.decay[:, None] * before.covariance * self.decay + np.diag(self.variance)
        return Gaussian(self.decay * before.mean, covariance)


@dataclass(frozen=True, eq=False)
class Chain:
    """Distributions of the unknowns at every dive.

    Attributes
    ----------
    sequential, smoothed : tuple of Gaussian
        Distributions given the dives up to each one, and given all dives.
    log_evidence : float
        Log evidence of all dives.
    gains : tuple of (p, p)
        Gains of the smoother, from every dive but the last to the next one.
    """

    sequential: tuple[Gaussian, ...]
    smoothed: tuple[Gaussian, ...]
    log_evidence: float
    gains: tuple[Array, ...]

    def since_first(self) -> tuple[Array, Array]:
        """Change (n, p) of the unknowns since the first dive, given all dives, and its standard deviation (n, p).

        Notes
        -----
        The covariance of the unknowns at the first dive and at a later one is the product of the smoother's gains
        between them times the later covariance.
        """
        first = self.smoothed[0]
        across = np.eye(len(first.mean))
        mean, std = [np.zeros_like(first.mean)], [np.zeros_like(first.mean)]
        for gain, here in zip(self.gains, self.smoothed[1:], strict=True):
            across = across @ gain
            variance = np.diag(first.covariance + here.covariance - 2.0 * across @ here.covariance)
            mean.append(here.mean - first.mean)
            std.append(np.sqrt(np.maximum(variance, 0.0)))
        return np.array(mean), np.array(std)


def solve_chain(prior: Gaussian, changes: Sequence[Change], terms: Sequence[Information]) -> Chain:
    """Filter and smooth the unknowns over all dives (Rauch, Tung and Striebel 1965).

    Parameters
    ----------
    prior : Gaussian
        Prior of the unknowns at the first dive.
    changes : sequence of Change
        Changes before the second dive, the third ...
    terms : sequence of Information
        Information of the dives.
    """
    sequential, predicted, evidence, posterior = [], [], 0.0, prior
    for number, term in enumerate(terms):
        posterior = changes[number - 1].applied(posterior) if number else posterior
        predicted.append(posterior)
        posterior, gained = posterior.updated(term)
        sequential.append(posterior)
        evidence += gained
    gains = [_gain(sequential[i], predicted[i + 1], change) for i, change in enumerate(changes[: len(terms) - 1])]
    smoothed = [sequential[-1]]
    for number in range(len(terms) - 2, -1, -1):
        smoothed.append(_smooth_one(sequential[number], predicted[number + 1], gains[number], smoothed[-1]))
    return Chain(tuple(sequential), tuple(reversed(smoothed)), evidence, tuple(gains))


def _gain(here: Gaussian, predicted: Gaussian, change: Change) -> Array:
    factor = scipy.linalg.cho_factor(predicted.covariance, lower=True)
    return np.asarray(scipy.linalg.cho_solve(factor, change.decay[:, None] * here.covariance).T)


def _smooth_one(here: Gaussian, predicted: Gaussian, gain: Array, after: Gaussian) -> Gaussian:
    covariance = here.covariance + gain @ (after.covariance - predicted.covariance) @ gain.T
    return Gaussian(here.mean + gain @ (after.mean - predicted.mean), 0.5 * (covariance + covariance.T))
