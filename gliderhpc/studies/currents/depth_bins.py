"""Means over bins of depth, of the dive, the climb and both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Bins:
    """Which records fall into which bin.

    Attributes
    ----------
    weights : (bins, m) sparse
        Average the records of each bin; the rows of empty bins are zero.
    count : (bins,)
        Records a bin.
    """

    weights: scipy.sparse.csr_array
    count: NDArray[np.int64]

    def mean(self, values: Array) -> Array:
        """Mean a bin of ``values (m, ...)``, NaN where the bin is empty; what is missing must not be in a bin."""
        mean = np.asarray(self.weights @ np.nan_to_num(values))
        mean[self.count == 0] = np.nan
        return mean

    def spread(self, values: Array) -> Array:
        """Standard deviation within each bin."""
        return np.asarray(np.sqrt(np.maximum(self.mean(values**2) - self.mean(values) ** 2, 0.0)))


def bin_count(deepest: float, height: float) -> int:
    """Bins of a height that reach from the surface to below a depth (m)."""
    return int(deepest // height) + 1


def bins_of(depth: Array, chosen: Mask, height: float, bins: int) -> Bins:
    """Sort the chosen records ``(m,)`` into bins.

    Parameters
    ----------
    depth : (m,)
        m; what lies above the surface falls into the first bin, what lies deeper than the last one into that.
    chosen : (m,) mask
        Records that count.
    height : float
        Of a bin, m.
    bins : int
        Their number.
    """
    rows = np.flatnonzero(chosen & np.isfinite(depth))
    where = np.clip((depth[rows] // height).astype(np.int64), 0, bins - 1)
    count = np.bincount(where, minlength=bins)
    weights = scipy.sparse.csr_array((1.0 / count[where], (where, rows)), shape=(bins, len(depth)))
    return Bins(weights, count)
