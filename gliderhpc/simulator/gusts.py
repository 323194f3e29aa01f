"""A random velocity field along a line with a prescribed spectrum, intermittent or Gaussian.

The field is a sum of wavelets on a dyadic tree (Benzi et al. 1993): at level j, cells of length ``outer / 2^j`` carry a
Gaussian coefficient times the product of multipliers W along the branch that leads there. With She and Leveque's
log-Poisson multipliers ``W = 2^(-1/9) (2/3)^(N/3)``, N of mean ``2 ln 2``, one finds ``E[W^p] = 2^(-zeta_p)`` with

    ``zeta_p = p/9 + 2 (1 - (2/3)^(p/3))``,

and increments scale accordingly. With the constant ``W = 2^(-zeta_2 / 2)`` the field is Gaussian and has the very same
expected spectrum, of slope ``1 + zeta_2``. A given slope multiplies every W by a power of two more or less.
"""

import math

import numpy as np
import scipy

from gliderhpc.observations.records import FloatArray
from gliderhpc.she_leveque import she_leveque
from gliderhpc.simulator.sections import Gusts

NODES_PER_CELL = 4
"""Grid nodes in a cell of the smallest scale."""

_WIDTH = 0.35
"""Of the wavelet (a Mexican hat's standard deviation), in cells: wide enough for an even variance within a cell."""

_SUPPORT = 5.0
"""Half the wavelet's support, in widths."""

_MARGIN = 3
"""Cells of the largest scale on either side, so that no end is seen."""


def scaling_exponent(settings: Gusts, order: float) -> float:
    """Scaling exponent zeta_p that a field is made with."""
    slope = spectral_slope(settings)
    if settings.kind == "gaussian":
        return 0.5 * order * (slope - 1.0)
    return she_leveque(order) + 0.5 * order * (slope - 1.0 - she_leveque(2.0))


def spectral_slope(settings: Gusts) -> float:
    """Slope of the spectrum between the scales, positive for one that falls."""
    return 1.0 + she_leveque(2.0) if settings.slope is None else settings.slope


def levels(settings: Gusts) -> int:
    """Levels of the tree below the first."""
    return max(1, round(math.log2(settings.outer / settings.inner)))


def node_spacing(settings: Gusts) -> float:
    """Distance of the field's nodes, m."""
    return float(settings.outer / (2 ** levels(settings) * NODES_PER_CELL))


def gust_field(settings: Gusts, length: float, rng: np.random.Generator) -> FloatArray:
    """Draw a field of at least `length` m.

    Parameters
    ----------
    settings : Gusts
        Kind, strength, scales and slope.
    length : float
        Of the line, m.
    rng : numpy.random.Generator
        Of the multipliers and the coefficients.

    Returns
    -------
    (n,) array
        Velocity at nodes `node_spacing` apart, m/s; its expected mean square is that asked for.
    """
    deepest = levels(settings)
    finest = 2**deepest * NODES_PER_CELL
    roots = math.ceil(length / settings.outer) + 1 + 2 * _MARGIN
    field = np.zeros(roots * finest)
    strength = np.ones(roots)
    for level in range(deepest + 1):
        if level:
            strength = _descended(settings, strength, rng)
        coefficients = strength * rng.standard_normal(len(strength))
        _add_wavelets(field, coefficients, finest >> level)
    inner = field[_MARGIN * finest : len(field) - _MARGIN * finest]
    scaled: FloatArray = settings.rms / _expected_rms(settings) * inner
    return scaled


def with_slopes(values: FloatArray, spacing: float) -> FloatArray:
    """Values and their slopes ``(n, 2)`` at uniform nodes, by central differences (a Catmull-Rom spline)."""
    return np.column_stack([values, np.gradient(values, spacing)])


def _descended(settings: Gusts, strength: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Strengths of the next level: each cell's two children, multiplied."""
    children = np.repeat(strength, 2)
    steepened = math.pow(2.0, -0.5 * (spectral_slope(settings) - 1.0))
    if settings.kind == "gaussian":
        return children * steepened
    counts = rng.poisson(2.0 * math.log(2.0), len(children))
    multipliers: FloatArray = 2.0 ** (-1.0 / 9.0) * (2.0 / 3.0) ** (counts / 3.0)
    # The multipliers fall off by 2^(-zeta_2 / 2) a level of their own.
    multipliers *= steepened * math.pow(2.0, 0.5 * she_leveque(2.0))
    return children * multipliers


def _add_wavelets(field: FloatArray, coefficients: FloatArray, stride: int) -> None:
    """Add one wavelet at the middle of each cell of `stride` nodes."""
    width = _WIDTH * stride
    reach = math.ceil(_SUPPORT * width)
    x = np.arange(-reach, reach + 1) / width
    comb = np.zeros(len(field))
    comb[stride // 2 :: stride] = coefficients
    field += scipy.signal.oaconvolve(comb, (1.0 - x**2) * np.exp(-0.5 * x**2), mode="same")


def _expected_rms(settings: Gusts) -> float:
    """Root mean square of the field before scaling: the wavelet's energy times the expected squares of the levels."""
    energy = _WIDTH * 0.75 * math.sqrt(math.pi)
    ratio = 2.0 ** (1.0 - spectral_slope(settings))
    return math.sqrt(energy * sum(ratio**level for level in range(levels(settings) + 1)))
