"""Structure functions, flatness and relative scaling exponents, with intervals by a block bootstrap.

Increments ``dx(tau) = x(t + tau) - x(t)`` have the structure functions ``S_p = <|dx|^p>`` and the flatness ``F = S_4 /
S_2^2``. In extended self-similarity (Benzi et al. 1993) ``zeta_p / zeta_3`` is the slope of ``log S_p`` on ``log S_3``
over a range of tau.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.library.turbulence.pieces import Pieces

Array = NDArray[np.float64]

ORDERS = (1, 2, 3, 4, 5, 6)
LEAST_LAGS = 4
"""An exponent is fitted to at least so many lags."""

COVERAGE = (2.5, 97.5)
"""Percentiles of the intervals."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Structure functions at some lags.

    Attributes
    ----------
    lags : (m,) array
        s; multiples of the sample's step.
    functions : (..., m, 6) array
        ``S_1`` to ``S_6``; NaN where no two samples of a stretch lie so far apart.
    """

    lags: Array
    functions: Array

    @property
    def flatness(self) -> Array:
        """Flatness ``(..., m)``."""
        return np.asarray(self.functions[..., 3] / self.functions[..., 1] ** 2)

    def flatness_at(self, lag: float) -> Array:
        """Flatness ``(...)`` at one of the lags (s)."""
        return np.asarray(self.flatness[..., int(np.argmin(np.abs(self.lags - lag)))])

    def exponents(self, scaling: tuple[float, float]) -> Array:
        """Relative exponents ``zeta_p / zeta_3 (..., 6)`` over a range of lags (s); NaN over too few of them."""
        inside = (self.lags >= scaling[0] - 1e-9) & (self.lags <= scaling[1] + 1e-9)
        logs = np.log(self.functions[..., inside, :])
        if np.count_nonzero(inside) < LEAST_LAGS:
            return np.full((*self.functions.shape[:-2], len(ORDERS)), np.nan)
        third = logs[..., 2] - logs[..., 2].mean(axis=-1, keepdims=True)
        return np.asarray(np.einsum("...l,...lp->...p", third, logs) / np.sum(third**2, axis=-1)[..., None])

    def ratio(self, scaling: tuple[float, float]) -> Array:
        """Relative exponent of the sixth order ``zeta_6 / zeta_3 (...)``."""
        return np.asarray(self.exponents(scaling)[..., 5])


def lag_samples(lags: Sequence[float], step: float) -> NDArray[np.int64]:
    """Lags (s) as numbers of samples, each once and at least one."""
    return np.unique(np.maximum(1, np.rint(np.asarray(lags) / step).astype(np.int64)))


def structure(pieces: Pieces, lags: NDArray[np.int64]) -> Structure:
    """Structure functions of a series at lags in samples."""
    sums, counts = block_sums(pieces, lags, len(pieces.values))
    return _structure(pieces, lags, sums[0], counts[0])


def bootstrapped(
    pieces: Pieces, lags: NDArray[np.int64], block: float, draws: int, rng: np.random.Generator
) -> Structure:
    """Structure functions ``(draws, m, 6)`` of blocks of so many seconds, drawn with replacement."""
    sums, counts = block_sums(pieces, lags, max(1, round(block / pieces.step)))
    held = np.flatnonzero(counts.sum(axis=1) > 0.0)
    weights = rng.multinomial(len(held), np.full(len(held), 1.0 / len(held)), draws).astype(np.float64)
    drawn = np.einsum("db,blp->dlp", weights, sums[held], optimize=True)
    return _structure(pieces, lags, drawn, weights @ counts[held])


def block_sums(pieces: Pieces, lags: NDArray[np.int64], block: int) -> tuple[Array, Array]:
    """Sums ``(b, m, 6)`` of the increments' powers by the block of `block` samples they begin in, and their numbers."""
    blocks = -(-len(pieces.values) // block)
    sums, counts = np.zeros((blocks, len(lags), len(ORDERS))), np.zeros((blocks, len(lags)))
    for at, lag in enumerate(lags):
        increments, first = pieces.increments(int(lag))
        place, magnitude = first // block, np.abs(increments)
        counts[:, at] = np.bincount(place, minlength=blocks)
        power = np.ones_like(magnitude)
        for column in range(len(ORDERS)):
            power = power * magnitude
            sums[:, at, column] = np.bincount(place, power, minlength=blocks)
    return sums, counts


def _structure(pieces: Pieces, lags: NDArray[np.int64], sums: Array, counts: Array) -> Structure:
    with np.errstate(invalid="ignore", divide="ignore"):
        return Structure(np.asarray(lags * pieces.step, dtype=np.float64), sums / counts[..., None])
