"""Scaling of velocity increments in intermittent turbulence."""

import math


def she_leveque(order: float) -> float:
    """Return the scaling exponent zeta_p of She and Leveque (1994)."""
    return order / 9.0 + 2.0 * (1.0 - math.pow(2.0 / 3.0, order / 3.0))
