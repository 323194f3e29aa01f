"""Test of intermittency with the nominal level: measured profiles against Gaussian nulls of the same pipeline.

The rank test of the paper compares a profile with surrogates of its own series. It cannot distinguish impulses
that the pipeline itself makes from intermittency, and even records without any disturbance pass it. Nulls with
Gaussian disturbances of the measured spectra go through the same instrument and the same inversion. If the measured
disturbance is Gaussian too, profiles and nulls are draws from one distribution, whatever the pipeline does to them, and
a rank-sum test over the whole mission has its nominal level.
"""

from dataclasses import dataclass
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.05
POWER = 0.9
"""Level and power for which the number of profiles needed is computed."""


@dataclass(frozen=True)
class Contrast:
    """Comparison of the flatness of measured profiles with that of Gaussian nulls.

    Attributes
    ----------
    profiles, nulls : int
        Numbers of values compared.
    larger : float
        Share of pairs in which the profile's value is the larger; one half if the distributions are the same.
    p_value : float
        One-sided p of the rank-sum test (Mann and Whitney 1947).
    """

    profiles: int
    nulls: int
    larger: float
    p_value: float

    @property
    def can_decide(self) -> bool:
        """Return whether a test with these numbers of values could reach the level at all."""
        return 1.0 / comb(self.profiles + self.nulls, self.profiles) <= LEVEL

    @property
    def profiles_needed(self) -> float:
        """Number of profiles, with as many nulls, for which this share of pairs is significant at `LEVEL` with `POWER`.

        Infinite unless the profiles' flatness is the larger in more than half of the pairs.

        Notes
        -----
        Noether (1987): the total number is ``N = (z_level + z_power)^2 / (12 c (1 - c) (larger - 1/2)^2)``, of which a
        share c are profiles; here c is one half.
        """
        if not self.larger > 0.5:
            return float("inf")
        z = scipy.stats.norm.isf(LEVEL) + scipy.stats.norm.isf(1.0 - POWER)
        return float(np.ceil(z**2 / (3.0 * (self.larger - 0.5) ** 2) / 2.0))


def contrast_of(measured: Array, nulls: Array) -> Contrast | None:
    """Compare a statistic of profiles ``(n,)`` with that of nulls ``(m,)``; None if either has no values."""
    measured, nulls = measured[np.isfinite(measured)], nulls[np.isfinite(nulls)]
    if not len(measured) or not len(nulls):
        return None
    rank_sum = scipy.stats.mannwhitneyu(measured, nulls, alternative="greater")
    larger = float(rank_sum.statistic) / (len(measured) * len(nulls))
    return Contrast(len(measured), len(nulls), larger, float(rank_sum.pvalue))


@dataclass(frozen=True)
class FalsePositives:
    """Number of false positives among the nulls tested, number of nulls tested, and level of the test."""

    passed: int
    count: int
    level: float

    @property
    def holds(self) -> bool:
        """Return whether this number is compatible with the test's level (one-sided binomial test at 5 %)."""
        return bool(scipy.stats.binomtest(self.passed, self.count, self.level, "greater").pvalue > LEVEL)
