"""Constant and slowly changing unknowns of a sequence of profiles: a Kalman filter and smoother in information form.

A profile enters through its log-likelihood of the unknowns x, ``log p(profile | x) = c + h'x - x'Lx / 2``, which may
have no information in some directions. From profile to profile each unknown is constant, walks randomly, or decays.
There are only a few tens of unknowns, and plain dense algebra suffices.

All arrays may have leading axes: several problems of the same size are then solved at once, which for such small
matrices takes little longer than one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.hull_errors import InformedDirections

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Information:
    """Log-likelihood ``c + h'x - x'Lx / 2`` of one profile.

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
    constant: Array | float = 0.0

    @classmethod
    def stacked(cls, parts: Sequence["Information"]) -> "Information":
        """Return several pieces of information along a new axis, the last but those of the unknowns."""
        return cls(
            np.stack([part.vector for part in parts], axis=-2),
            np.stack([part.matrix for part in parts], axis=-3),
            np.stack([part.constant for part in parts], axis=-1),
        )

    def __add__(self, other: "Information") -> "Information":
        """Return the sum of two independent pieces of information."""
        return Information(self.vector + other.vector, self.matrix + other.matrix, self.constant + other.constant)

    def weighted(self, weight: Array | float) -> "Information":
        """Return the information times a weight."""
        factor = np.asarray(weight)
        return Information(
            factor[..., None] * self.vector, factor[..., None, None] * self.matrix, factor * self.constant
        )


def information_about(score: Array, information: Array, point: Array) -> Information:
    """Information of a log-likelihood ``g'(x - x0) - (x - x0)'I(x - x0) / 2`` about a point ``x0``."""
    vector = score + information @ point
    return Information(vector, information, -float(score @ point) - 0.5 * float(point @ information @ point))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A normal distribution of the unknowns: mean (p,) and covariance (p, p)."""

    mean: Array
    covariance: Array

    @classmethod
    def stacked(cls, parts: Sequence["Gaussian"]) -> "Gaussian":
        """Return several distributions along a new axis, the last but those of the unknowns."""
        return cls(
            np.stack([part.mean for part in parts], axis=-2), np.stack([part.covariance for part in parts], axis=-3)
        )

    def unstacked(self) -> tuple["Gaussian", ...]:
        """Return the distributions along the last axis but those of the unknowns."""
        means, covariances = np.moveaxis(self.mean, -2, 0), np.moveaxis(self.covariance, -3, 0)
        return tuple(Gaussian(*each) for each in zip(means, covariances, strict=True))

    @property
    def std(self) -> Array:
        """Standard deviations (p,)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    def part(self, count: int) -> "Gaussian":
        """Return the distribution of the first unknowns."""
        return Gaussian(self.mean[..., :count], self.covariance[..., :count, :count])

    def updated(self, term: Information) -> tuple["Gaussian", Array]:
        """Return the posterior after a profile, and that profile's log evidence with this distribution as the prior.

        Notes
        -----
        With the Cholesky factor C of the covariance and ``S = 1 + C'LC``, the posterior covariance is ``C S^-1 C'``.
        This form is stable where a profile has no information, and where it has a million times that of the prior.
        """
        root = np.linalg.cholesky(self.covariance)
        factor = np.linalg.cholesky(np.eye(root.shape[-1]) + root.mT @ term.matrix @ root)
        # The general solver is faster: on small matrices the triangular one waits for its threads.
        posterior_root = np.linalg.solve(factor, root.mT)
        covariance = posterior_root.mT @ posterior_root
        expected = times_vector(term.matrix, self.mean)
        innovation = term.vector - expected
        change = times_vector(covariance, innovation)
        evidence = (
            term.constant
            + np.sum((term.vector - 0.5 * expected) * self.mean + 0.5 * innovation * change, axis=-1)
            - np.sum(np.log(np.diagonal(factor, axis1=-2, axis2=-1)), axis=-1)
        )
        return Gaussian(self.mean + change, covariance), evidence

    def without(self, term: Information) -> "Gaussian":
        """Return the distribution without one of its profiles: the inverse of `updated`."""
        covariance = np.linalg.solve(np.eye(self.mean.shape[-1]) - self.covariance @ term.matrix, self.covariance)
        covariance = 0.5 * (covariance + covariance.mT)
        innovation = term.vector - times_vector(term.matrix, self.mean)
        return Gaussian(self.mean - times_vector(covariance, innovation), covariance)

    def disagreement(
        self, term: Information, informed: InformedDirections | None = None
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return the chi-square of a profile that this distribution does not contain, and its degrees of freedom.

        The directions in which the profile is informed are computed unless they are given.
        """
        informed = informed or InformedDirections.of(term.matrix)
        return informed.disagreement(term.vector - times_vector(term.matrix, self.mean), self.covariance)


def times_vector(matrix: Array, vector: Array) -> Array:
    """Return matrices times vectors."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class Transition:
    """Transition of the unknowns to the next profile: ``x <- decay x + noise`` with variances, each (p,)."""

    decay: Array
    variance: Array

    def applied(self, before: Gaussian) -> Gaussian:
        """Return the distribution after the transition."""
        covariance = self.decay[:, None] * before.covariance * self.decay + np.diag(self.variance)
        return Gaussian(self.decay * before.mean, covariance)


@dataclass(frozen=True, eq=False)
class Chain:
    """Distributions of the unknowns at every profile.

    Attributes
    ----------
    sequential, smoothed : tuple of Gaussian
        Distributions given the profiles up to each one, and given all profiles.
    log_evidence : float
        Log evidence of all profiles.
    gains : tuple of (p, p)
        Gains of the smoother, from every profile but the last to the next one.
    """

    sequential: tuple[Gaussian, ...]
    smoothed: tuple[Gaussian, ...]
    log_evidence: Array
    gains: tuple[Array, ...]

    def since_first(self) -> tuple[Array, Array]:
        """Change (n, p) of the unknowns since the first profile, given all profiles, and its standard deviation (n, p).

        Notes
        -----
        The covariance of the unknowns at the first profile and at a later one is the product of the smoother's gains
        between them times the later covariance.
        """
        first = self.smoothed[0]
        total_gain = np.eye(first.mean.shape[-1])
        mean, std = [np.zeros_like(first.mean)], [np.zeros_like(first.mean)]
        for gain, later in zip(self.gains, self.smoothed[1:], strict=True):
            total_gain = total_gain @ gain
            covariance = first.covariance + later.covariance - 2.0 * total_gain @ later.covariance
            variance = np.diagonal(covariance, axis1=-2, axis2=-1)
            mean.append(later.mean - first.mean)
            std.append(np.sqrt(np.maximum(variance, 0.0)))
        return np.array(mean), np.array(std)


def solve_chain(prior: Gaussian, changes: Sequence[Transition], terms: Sequence[Information]) -> Chain:
    """Filter and smooth the unknowns over all profiles (Rauch, Tung and Striebel 1965).

    Parameters
    ----------
    prior : Gaussian
        Prior of the unknowns at the first profile.
    changes : sequence of Transition
        Changes before the second profile, the third ...
    terms : sequence of Information
        Information of the profiles.
    """
    sequential, predicted, evidence, posterior = [], [], np.zeros(()), prior
    for number, term in enumerate(terms):
        posterior = changes[number - 1].applied(posterior) if number else posterior
        predicted.append(posterior)
        posterior, term_evidence = posterior.updated(term)
        sequential.append(posterior)
        evidence = evidence + term_evidence
    gains = [_gain(sequential[i], predicted[i + 1], change) for i, change in enumerate(changes[: len(terms) - 1])]
    smoothed = [sequential[-1]]
    for number in range(len(terms) - 2, -1, -1):
        smoothed.append(_smooth(sequential[number], predicted[number + 1], gains[number], smoothed[-1]))
    return Chain(tuple(sequential), tuple(reversed(smoothed)), evidence, tuple(gains))


def _gain(filtered: Gaussian, predicted: Gaussian, change: Transition) -> Array:
    return np.asarray(np.linalg.solve(predicted.covariance, change.decay[:, None] * filtered.covariance).mT)


def _smooth(filtered: Gaussian, predicted: Gaussian, gain: Array, smoothed_next: Gaussian) -> Gaussian:
    covariance = filtered.covariance + gain @ (smoothed_next.covariance - predicted.covariance) @ gain.mT
    mean = filtered.mean + times_vector(gain, smoothed_next.mean - predicted.mean)
    return Gaussian(mean, 0.5 * (covariance + covariance.mT))
