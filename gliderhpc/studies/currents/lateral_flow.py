"""The lateral current that explains a yaw moment: eq. 41, sample by sample.

The root is bracketed from zero outwards, as far as the first-order solution suggests, and found by Chandrupatla's
method (scipy). To first order

    v_c = -B / [(K_MY + K_MR sin(alpha) + M_f1 - M_f2) u]

(model.md 7), so draws of the bracket's four coefficients scale the solution by the ratio of the brackets; nothing is
inverted or solved again for them. Where the viscous and the Munk moment nearly cancel, the bracket is a small
difference of large numbers: the condition number, the sum of the terms' magnitudes over the magnitude of their sum,
is the factor by which an error of the coefficients is magnified.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import munk_moment
from gliderhpc.kernels.points import viscous_yaw_moments
from gliderhpc.platform import Platform

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BRACKET_MARGIN = 1.5
"""Half the first bracket's width over the solution to first order."""
_MIN_BRACKET = 1e-6
"""Half the width of the narrowest first bracket, m/s."""
_TOLERANCE = 1e-9
"""To which a root is found, m/s."""


@dataclass(frozen=True, eq=False)
class LateralFlow:
    """Solution of eq. 41.

    Attributes
    ----------
    current : (n,)
        v_c along the body's y axis, m/s, positive to starboard; NaN without a root.
    gain : (n,)
        Yaw moment over -v_c to first order, N s: the bracket times u.
    condition : (n,)
        Magnitudes of the bracket's terms over that of their sum.
    rootless : (n,) mask
        Samples whose equation was posed but has no root within the limit.
    """

    current: Array
    gain: Array
    condition: Array
    rootless: Mask


def bracket_terms(platform: Platform, angle_of_attack: Array) -> Array:
    """Terms ``(4, n)`` of the bracket, kg: ``K_MY``, ``K_MR sin(alpha)``, ``M_f1`` and ``-M_f2``."""
    viscous, added = platform.viscous, platform.added_mass
    sine = np.sin(angle_of_attack)
    constant = np.array([viscous.K_MY, 0.0, added[0], -added[1]])
    return np.asarray(constant[:, None] + np.outer([0.0, viscous.K_MR, 0.0, 0.0], sine))


def left_side(glider: Glider, motion: Array, rudder: Array, current: Array) -> Array:
    """Left side of eq. 41, N m ``(n,)``.

    Parameters
    ----------
    glider : Glider
        The hull.
    motion : (n, 6)
        u, v, w (m/s) and p, q, r (rad/s) through the water.
    rudder : (n,)
        rad.
    current : (n,)
        v_c, m/s.
    """
    return _in_current(glider, motion, rudder, current) - _yaw_moments(glider, motion, rudder)


def solve_lateral_flow(glider: Glider, motion: Array, rudder: Array, moment: Array, limit: float) -> LateralFlow:
    """Solve eq. 41 for the current across the hull.

    Parameters
    ----------
    glider : Glider
        The hull.
    motion : (n, 6)
        u, v, w (m/s) and p, q, r (rad/s) through the water.
    rudder : (n,)
        rad.
    moment : (n,)
        The filtered B_cr, N m; samples that are not finite are not solved.
    limit : float
        Largest |v_c| that counts as a root, m/s.
    """
    terms = bracket_terms(glider.platform, np.arctan2(motion[:, 2], motion[:, 0]))
    bracket = terms.sum(axis=0)
    with np.errstate(divide="ignore"):
        condition = np.abs(terms).sum(axis=0) / np.abs(bracket)
    posed = np.isfinite(moment) & np.isfinite(motion).all(axis=1)
    current = np.full(len(moment), np.nan)
    gain = bracket * motion[:, 0]
    if posed.any():
        current[posed] = _roots(glider, motion[posed], rudder[posed], moment[posed], gain[posed], limit)
    return LateralFlow(current, gain, condition, posed & ~np.isfinite(current))


def _roots(glider: Glider, motion: Array, rudder: Array, moment: Array, gain: Array, limit: float) -> Array:
    from scipy.optimize import elementwise

    # The moment without a current is the same at every trial.
    wanted = moment + _yaw_moments(glider, motion, rudder)

    def left_over(current: Array, row: Array) -> Array:
        rows = row.astype(np.int64)
        return _in_current(glider, motion[rows], rudder[rows], current) - wanted[rows]

    rows = np.arange(len(moment), dtype=np.float64)
    with np.errstate(divide="ignore"):
        reach = np.clip(_BRACKET_MARGIN * np.abs(moment / gain), _MIN_BRACKET, 0.5 * limit)
    bounds = elementwise.bracket_root(left_over, -reach, reach, xmin=-limit, xmax=limit, args=(rows,))
    roots = np.full(len(moment), np.nan)
    found = bounds.success
    if found.any():
        low, high = bounds.bracket
        solution = elementwise.find_root(
            left_over, (low[found], high[found]), args=(rows[found],), tolerances={"xatol": _TOLERANCE}
        )
        roots[found] = np.where(solution.success, solution.x, np.nan)
    return roots


def _in_current(glider: Glider, motion: Array, rudder: Array, current: Array) -> Array:
    """Viscous yaw moment in a lateral current, less Munk's of that current."""
    moved = motion.copy()
    moved[:, 1] -= current
    return _yaw_moments(glider, moved, rudder) - munk_moment(glider.platform) * motion[:, 0] * current


def _yaw_moments(glider: Glider, motion: Array, rudder: Array) -> Array:
    moments = np.empty(len(motion))
    viscous_yaw_moments(glider.hull, np.ascontiguousarray(motion), np.ascontiguousarray(rudder), moments)
    return moments


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
