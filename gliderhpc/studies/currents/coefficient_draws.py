"""What the moment coefficients leave open: draws of them, and the current that each would have led to.

To first order in v_c eq. 41 is ``-bracket u v_c = B`` (model.md 7), so draws of the bracket's four coefficients scale
the solution by the ratio of the brackets; nothing is inverted or solved anew.
"""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.platform import Platform
from gliderhpc.studies.currents.lateral_flow import bracket_terms

Array = NDArray[np.float64]


def scale_draws(platform: Platform, angle_of_attack: Array, error: float, draws: int, seed: int) -> Array:
    """Factors ``(m, draws)`` on the lateral current under draws of the coefficients.

    Parameters
    ----------
    platform : Platform
        The hull.
    angle_of_attack : (m,)
        rad.
    error : float
        Relative: K_MY, K_MR, M_f1 and M_f2 are drawn uniformly and independently within it.
    draws, seed : int
        Their number, and the seed they come from.
    """
    factors = np.random.default_rng(seed).uniform(1.0 - error, 1.0 + error, (draws, 4))
    terms = bracket_terms(platform, angle_of_attack)
    return np.asarray(terms.sum(axis=0)[:, None] / (terms.T @ factors.T))


def half_width(draws: Array, axis: int) -> Array:
    """Half the range of the central 68 % along an axis: the standard deviation, were the draws normal.

    Draws in which the bracket nearly vanishes have no bound, so there is no standard deviation to be had.
    """
    low, high = np.quantile(draws, [0.16, 0.84], axis=axis)
    return np.asarray(0.5 * (high - low))
