"""The glide-angle relation (eq. 15; Zhou et al.): angle of attack and horizontal speed from pitch and depth rate."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.flight.steady_glide import best_angle_of_attack, imbalance, imbalance_slope, zero_lift_angle
from gliderhpc.platform import Platform

Array = NDArray[np.float64]

_ITERATIONS = 30
_CONVERGED = 1e-12


def angle_of_attack(platform: Platform, pitch: ArrayLike) -> Array:
    """Steady angle of attack (rad) at a pitch (rad); NaN where the path would be flatter than the least glide angle.

    Notes
    -----
    With glide angle ``xi = theta - alpha`` the steady balance ``D = -L tan(xi)`` is quadratic in alpha; its small root
    is eq. 15, with ``K_D0 + K_L0 tan(xi)`` for ``K_D0`` where the hull lifts at zero angle of attack. Its sign gives
    lift against the glide, on dive and climb alike. Since ``xi`` depends on alpha, and iterating eq. 15 misses the
    flattest paths, the balance is solved by Newton's method in the distance x from zero lift, starting at the least
    drag over lift: between there and zero lift the small root is the only one. ``K_M0`` trims the hull and does not
    enter the force balance.
    """
    theta = np.asarray(pitch, dtype=np.float64)
    dive = theta < 0.0
    lift_sign = np.where(dive, 1.0, -1.0)
    without_lift = zero_lift_angle(platform)
    best = np.where(dive, *(best_angle_of_attack(platform, heavy=heavy) for heavy in (True, False)))
    reach = lift_sign * (best - without_lift)
    reachable = imbalance(platform, theta, best) <= 0.0
    x = np.where(reachable, reach, np.nan)
    for _ in range(_ITERATIONS):
        alpha = without_lift + lift_sign * x
        rate = lift_sign * imbalance_slope(platform, theta, alpha)
        new = np.clip(x - imbalance(platform, theta, alpha) / rate, 0.0, reach)
        change = np.max(np.abs(new - x), where=reachable, initial=0.0)
        x = new
        if change < _CONVERGED:
            break
    return without_lift + lift_sign * x


def horizontal_speed(platform: Platform, pitch: ArrayLike, depth_rate: ArrayLike) -> Array:
    """Horizontal speed through the water (m/s) ``|v_z / tan(xi)|`` from pitch (rad) and depth rate v_z (m/s)."""
    theta = np.asarray(pitch, dtype=np.float64)
    xi = theta - angle_of_attack(platform, theta)
    return np.abs(np.asarray(depth_rate, dtype=np.float64) / np.tan(xi))
