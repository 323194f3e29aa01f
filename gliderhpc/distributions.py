"""Quantiles and tail probabilities of the usual distributions, as functions of `scipy.special`.

Those of `scipy.stats` are the same, but importing it takes as long as all other imports of the estimation together.
"""

from typing import Any, overload

import numpy as np
import scipy
from numpy.typing import NDArray


def normal_quantile(probability: float) -> float:
    """Return the value below which a standard normal variable lies with a probability."""
    return float(scipy.special.ndtri(probability))


def student_quantile(probability: float, freedom: float) -> float:
    """Return the value below which Student's t with degrees of freedom lies with a probability."""
    return float(scipy.special.stdtrit(freedom, probability))


@overload
def chi_square_quantile(probability: float, freedom: float) -> float: ...
@overload
def chi_square_quantile(probability: float, freedom: NDArray[Any]) -> NDArray[np.float64]: ...
def chi_square_quantile(probability: float, freedom: float | NDArray[Any]) -> float | NDArray[np.float64]:
    """Return the value below which chi-square with degrees of freedom lies with a probability."""
    quantile: float | NDArray[np.float64] = np.float64(scipy.special.chdtri(freedom, 1.0 - probability))
    return quantile


def chi_square_tail(value: float, freedom: float) -> float:
    """Return the probability that chi-square with degrees of freedom is above a value."""
    return float(scipy.special.chdtrc(freedom, value))


def f_quantile(probability: float, above: float, below: float) -> float:
    """Return the value below which F with degrees of freedom above and below the line lies with a probability."""
    return float(scipy.special.fdtri(above, below, probability))


def gamma_tail(value: float, shape: float, scale: float) -> float:
    """Return the probability that a gamma variable is above a value."""
    return float(scipy.special.gammaincc(shape, value / scale))
