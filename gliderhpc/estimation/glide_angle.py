"""The glide-angle relation (eq. 15; Zhou et al.): angle of attack and horizontal speed from pitch and depth rate."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_ITERATIONS = 60
_CONVERGED = 1e-10


def angle_of_attack(platform: Platform, pitch: ArrayLike) -> Array:
    """Steady angle of attack (rad) at a pitch (rad); NaN below the hull's least glide angle.

    Notes
    -----
    With glide angle ``xi = theta - alpha`` the steady balance ``D = -L tan(xi)`` is quadratic in alpha; its small root
    is eq. 15, with ``K_D0 + K_L0 tan(xi)`` for ``K_D0`` where the hull lifts at zero angle of attack. Its sign gives
    lift against the glide, on dive and climb alike. ``xi`` depends on alpha, hence the fixed point. ``K_M0`` trims the hull
    and does not enter the force balance.
    """
    theta = np.asarray(pitch, dtype=np.float64)
    viscous = platform.viscous
    alpha = np.zeros_like(theta)
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_ITERATIONS):
            slope = np.tan(theta - alpha)
            drag = viscous.K_D0 + viscous.K_L0 * slope
            lift = viscous.K_L * slope
            root = np.sqrt(1.0 - 4.0 * viscous.K_D * drag / lift**2)
            # The small root in the form that does not cancel; K_D = 0 is its limit.
            new = -2.0 * drag / (lift * (1.0 + root))
            change = np.nanmax(np.abs(new - alpha), initial=0.0)
            alpha = new
            if change < _CONVERGED:
                break
    return alpha


def horizontal_speed(platform: Platform, pitch: ArrayLike, depth_rate: ArrayLike) -> Array:
    """Horizontal speed (m/s) ``|v_z / tan(xi)|`` through the water, from pitch (rad) and depth rate (m/s)."""
    theta = np.asarray(pitch, dtype=np.float64)
    xi = theta - angle_of_attack(platform, theta)
    return np.abs(np.asarray(depth_rate, dtype=np.float64) / np.tan(xi))
