"""Quantiles and tail probabilities of the usual distributions, as functions of `scipy.special`.

Those of `scipy.stats` are the same, but importing it takes as long as all other imports of the estimation together.
"""

from typing import Any

import scipy
from numpy.typing import NDArray

MAD_TO_STD = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def normal_quantile(probability: float) -> float:
    """Return the quantile of the standard normal distribution at a probability."""
    return float(scipy.special.ndtri(probability))


def student_quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t at a probability, given its degrees of freedom."""
    return float(scipy.special.stdtrit(freedom, probability))


def few_values_factor(probability: float, freedom: float) -> float:
    """Return Student's quantile over the normal one: the factor by which few values widen an interval."""
    return student_quantile(probability, freedom) / normal_quantile(probability)


def chi_square_quantile(probability: float, freedom: float | NDArray[Any]) -> Any:
    """Return the quantile of chi-square at a probability, given its degrees of freedom; an array for several."""
    return scipy.special.chdtri(freedom, 1.0 - probability)


def chi_square_tail(value: float, freedom: float) -> float:
    """Return the probability that a chi-square variable exceeds a value, given its degrees of freedom."""
    return float(scipy.special.chdtrc(freedom, value))


def f_quantile(probability: float, above: float, below: float) -> float:
    """Return the quantile of F at a probability, given the degrees of freedom of numerator and denominator."""
    return float(scipy.special.fdtri(above, below, probability))


def gamma_tail(value: float, shape: float, scale: float) -> float:
    """Return the probability that a gamma variable is above a value."""
    return float(scipy.special.gammaincc(shape, value / scale))
