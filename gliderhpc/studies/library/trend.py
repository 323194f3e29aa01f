"""Monotonic trends without a model: the Mann-Kendall test and the Theil-Sen slope."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

LEAST = 4
"""Fewer values show no trend."""

LEVEL = 0.05
"""Probability of chance below which a trend counts as shown."""


@dataclass(frozen=True)
class Trend:
    """A trend over time.

    Attributes
    ----------
    count : int
        Values that were finite.
    tau, p : float
        Kendall's tau (S over the number of pairs) and the two-sided probability of chance.
    slope, low, high : float
        Theil-Sen slope a unit of time and its 95 % interval.
    first, last : float
        Level of the fitted line at the first and the last time.
    """

    count: int
    tau: float
    p: float
    slope: float
    low: float
    high: float
    first: float
    last: float

    @property
    def change(self) -> float:
        """Change of the fitted line relative to its first level; NaN where that is not told from zero.

        The line turns about the middle of the record, so its first level is as uncertain as half the record makes the
        slope's interval.
        """
        rise = self.last - self.first
        doubt = 0.25 * rise / self.slope * (self.high - self.low) if self.slope else 0.0
        return rise / self.first if self.first > doubt else float("nan")

    @property
    def change_said(self) -> str:
        """That change in per cent, or in the values' own unit where it has none."""
        if np.isfinite(self.change):
            return f"{100.0 * self.change:+.0f} %"
        return f"{self.last - self.first:+.2g}, from a start that is not told from zero,"

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self) | {"change": self.change}


def known_pairs(time: ArrayLike, values: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and values of a series, missing ones left out."""
    t, y = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = np.isfinite(t) & np.isfinite(y)
    return t[known], y[known]


def find_trend(time: ArrayLike, values: ArrayLike) -> Trend:
    """Find the trend of values over time, missing ones left out.

    Parameters
    ----------
    time, values : (n,) array_like
        Increasing times and what was found then.

    Returns
    -------
    Trend
        All NaN with fewer than four values.

    Notes
    -----
    The test is the plain one, normal approximation with continuity correction and ties. Values that are correlated from
    one profile to the next make its p too small, and the interval of the slope too narrow.
    """
    t, y = known_pairs(time, values)
    if len(y) < LEAST:
        return Trend(len(y), *([float("nan")] * 7))
    tau, p = mann_kendall(y)
    slope, intercept, low, high = (float(value) for value in scipy.stats.theilslopes(y, t))
    return Trend(len(y), tau, p, slope, low, high, intercept + slope * t[0], intercept + slope * t[-1])


def mann_kendall(values: NDArray[np.float64]) -> tuple[float, float]:
    """Kendall's tau and the two-sided p of the Mann-Kendall test of values in the order of time."""
    import pymannkendall  # loads scipy.stats

    result = pymannkendall.original_test(values)
    return float(result.Tau), float(result.p)
