"""Viscous and added-mass coefficients of a hull by the paper's symbols, and hulls with errors in their coefficients."""

from collections.abc import Mapping

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.platform import Platform
from gliderhpc.seeds import MISSION, Stream, generator

COEFFICIENTS = ("K_D0", "K_D", "K_beta", "K_L0", "K_L", "K_MR", "K_p", "K_M0", "K_M", "K_q", "K_MY", "K_r")
ADDED_MASS, ADDED_INERTIA = ("M_f1", "M_f2", "M_f3"), ("I_f1", "I_f2", "I_f3")
ADDED = (*ADDED_MASS, *ADDED_INERTIA)

MAX_DRAWS = 100
"""Largest number of draws of a hull's coefficients."""


def coefficients_of(platform: Platform) -> dict[str, float]:
    """Return a hull's coefficients by the paper's symbols: viscous ones, then added mass and inertia axis by axis."""
    values = {name: float(getattr(platform.viscous, name)) for name in COEFFICIENTS}
    for axis in range(3):
        values[ADDED_MASS[axis]] = float(platform.added_mass[axis])
        values[ADDED_INERTIA[axis]] = float(platform.added_inertia[axis])
    return values


def with_viscous(platform: Platform, values: Mapping[str, float]) -> Platform:
    """Return a hull with some viscous coefficients replaced."""
    return platform.model_copy(update={"viscous": platform.viscous.model_copy(update=dict(values))})


def with_errors(platform: Platform, spread: float, seed: int) -> Platform:
    """Draw every coefficient of a hull uniformly within a relative error.

    A hull that would not glide stably is drawn again.

    Parameters
    ----------
    platform : Platform
        The hull.
    spread : float
        Largest relative error; 0 leaves the hull unchanged.
    seed : int
        Seed of the draws.

    Raises
    ------
    InputError
        No draw glides stably.
    """
    if spread == 0.0:
        return platform
    rng = generator(seed, MISSION, Stream.COEFFICIENTS)
    for _ in range(MAX_DRAWS):
        drawn = _drawn(platform, spread, rng)
        if glides_stably(Glider(drawn)):
            return drawn
    raise InputError(
        f"{platform.name}: no draw of its coefficients within {spread:.0%} glides stably; "
        "give a smaller coefficients.spread"
    )


def _drawn(platform: Platform, spread: float, rng: np.random.Generator) -> Platform:
    factors = rng.uniform(1.0 - spread, 1.0 + spread, len(COEFFICIENTS) + len(ADDED))
    viscous = {name: getattr(platform.viscous, name) * f for name, f in zip(COEFFICIENTS, factors[:-6], strict=True)}
    added = np.array([*platform.added_mass, *platform.added_inertia]) * factors[-6:]
    drawn = with_viscous(platform, viscous)
    return drawn.model_copy(
        update={"added_mass": tuple(added[:3].tolist()), "added_inertia": tuple(added[3:].tolist())}
    )
