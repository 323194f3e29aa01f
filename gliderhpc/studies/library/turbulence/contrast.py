"""A test of intermittency that has its nominal level: measured profiles against Gaussian nulls of the same pipeline.

The rank test of the publication compares a profile with surrogates of its own series. What the pipeline itself makes
impulsive counts against the surrogates as intermittency does, so that records without any disturbance pass it. Nulls
with a Gaussian disturbance of the measured spectrum go through the same instrument and the same inversion; if the
measured disturbance is Gaussian too, profiles and nulls are draws of one distribution, whatever the pipeline makes of
it, and a rank-sum test over the whole mission has its level.
"""

from dataclasses import dataclass
from math import comb

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVEL = 0.05
POWER = 0.9
"""Level and power for which the profiles that are needed are counted."""


@dataclass(frozen=True)
class Contrast:
    """Flatness of measured profiles against that of Gaussian nulls.

    Attributes
    ----------
    profiles, nulls : int
        Values compared.
    larger : float
        Share of pairs in which the profile's is the larger; one half where nothing distinguishes them.
    p_value : float
        One-sided, of the rank-sum test (Mann and Whitney 1947).
    """

    profiles: int
    nulls: int
    larger: float
    p_value: float

    @property
    def can_decide(self) -> bool:
        """Whether these numbers could reach the level at all."""
        return 1.0 / comb(self.profiles + self.nulls, self.profiles) <= LEVEL

    @property
    def profiles_needed(self) -> float:
        """Profiles, with as many nulls, among which this share of pairs is found at `LEVEL` with `POWER`.

        Infinite where the profiles' flatness is not the larger in more than half of the pairs.

        Notes
        -----
        Noether (1987): ``N = (z_level + z_power)^2 / (12 c (1 - c) (larger - 1/2)^2)`` in all, a part c of them
        profiles; here c is one half.
        """
        if not self.larger > 0.5:
            return float("inf")
        z = scipy.stats.norm.isf(LEVEL) + scipy.stats.norm.isf(1.0 - POWER)
        return float(np.ceil(z**2 / (3.0 * (self.larger - 0.5) ** 2) / 2.0))


def contrast_of(measured: Array, nulls: Array) -> Contrast | None:
    """Compare a statistic of profiles ``(n,)`` with that of nulls ``(m,)``; None where either has no value."""
    measured, nulls = measured[np.isfinite(measured)], nulls[np.isfinite(nulls)]
    if not len(measured) or not len(nulls):
        return None
    found = scipy.stats.mannwhitneyu(measured, nulls, alternative="greater")
    larger = float(found.statistic) / (len(measured) * len(nulls))
    return Contrast(len(measured), len(nulls), larger, float(found.pvalue))


@dataclass(frozen=True)
class NullPasses:
    """How many nulls without any disturbance pass a test, of how many, and the share that its level allows."""

    passed: int
    count: int
    level: float

    @property
    def holds(self) -> bool:
        """Whether so many are expected of a test that has its level (binomial, one-sided, 5 %)."""
        return bool(scipy.stats.binomtest(self.passed, self.count, self.level, "greater").pvalue > LEVEL)
