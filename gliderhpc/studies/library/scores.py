"""How near an estimate comes to what it should be: root mean square error and correlation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Score:
    """Root mean square error in the quantity's unit, and correlation (NaN where either side never changes)."""

    rmse: float
    correlation: float


def score_columns(estimate: Array, true: Array) -> tuple[Score, ...]:
    """Score every column of an estimate ``(n, m)`` against the truth ``(n, m)``."""
    columns = zip(estimate.T, true.T, strict=True)
    return tuple(Score(rms(ours - theirs), correlation(ours, theirs)) for ours, theirs in columns)


def rms(values: Array) -> float:
    """Root mean square of the finite values, NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def correlation(a: Array, b: Array) -> float:
    """Correlation over the samples where both are finite, NaN where either never changes."""
    known = np.isfinite(a) & np.isfinite(b)
    if not known.any() or np.ptp(a[known]) == 0.0 or np.ptp(b[known]) == 0.0:
        return float("nan")
    return float(np.corrcoef(a[known], b[known])[0, 1])
