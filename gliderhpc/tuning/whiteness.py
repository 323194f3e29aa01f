"""Whiteness of the filter's innovations: what a filter whose model is true leaves is white noise of unit variance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

SENSORS = ("roll", "pitch", "heading", "depth")


@dataclass(frozen=True, eq=False)
class Whiteness:
    """What is left in one sensor's innovations, each over its expected standard deviation.

    Attributes
    ----------
    count : int
        Innovations.
    mean, variance : float
        Should be 0 and 1.
    autocorrelation : (k,)
        At lags of 1 to k samples; should be 0 within about ``2 / sqrt(count)``.
    portmanteau : float
        Ljung and Box's statistic over the number of lags; should be about 1.
    p : float
        Probability of a larger one from white noise.
    """

    count: int
    mean: float
    variance: float
    autocorrelation: Array
    portmanteau: float
    p: float


def whiteness(normalised: Sequence[Array], lags: int) -> Whiteness:
    """Test one sensor's normalised innovations of several profiles, NaN where there is none.

    Parameters
    ----------
    normalised : sequence of (m,) arrays
        One a profile, on the fed samples; pairs across a missing one do not count, nor from one profile to the next.
    lags : int
        Number of lags k.

    Notes
    -----
    ``Q = n (n + 2) sum over lags of r^2 / (number of pairs)`` is chi-squared with k degrees of freedom for white noise
    (Ljung and Box 1978).
    """
    known = np.concatenate([part[np.isfinite(part)] for part in normalised])
    if len(known) <= lags:
        return Whiteness(len(known), np.nan, np.nan, np.full(lags, np.nan), np.nan, np.nan)
    mean, variance = float(known.mean()), float(known.var())
    correlation, pairs = np.zeros(lags), np.zeros(lags)
    for lag in range(1, lags + 1):
        products = np.concatenate([(part[lag:] - mean) * (part[:-lag] - mean) for part in normalised])
        together = np.isfinite(products)
        pairs[lag - 1] = max(together.sum(), 1)
        correlation[lag - 1] = products[together].sum() / (len(known) * variance)
    statistic = len(known) * (len(known) + 2.0) * float(np.sum(correlation**2 / pairs))
    return Whiteness(
        len(known), mean, variance, correlation, statistic / lags, float(scipy.stats.chi2.sf(statistic, lags))
    )
