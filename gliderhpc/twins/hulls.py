"""Hulls that the estimator believes in: the true one with its hydrodynamic coefficients a little wrong."""

from collections.abc import Mapping

import numpy as np

from gliderhpc.platform import Platform

VISCOUS = ("K_D0", "K_D", "K_beta", "K_L", "K_MR", "K_p", "K_M0", "K_M", "K_q", "K_MY", "K_r")
ADDED_MASS = ("M_f1", "M_f2", "M_f3")
ADDED_INERTIA = ("I_f1", "I_f2", "I_f3")
COEFFICIENTS = (*VISCOUS, *ADDED_MASS, *ADDED_INERTIA)
"""Everything the paper's error of 15 % applies to: viscous and added-mass coefficients."""


def with_factors(platform: Platform, factors: Mapping[str, float]) -> Platform:
    """Give a platform with some coefficients (`COEFFICIENTS`) multiplied."""
    viscous = {name: getattr(platform.viscous, name) * factors.get(name, 1.0) for name in VISCOUS}
    return platform.model_copy(
        update={
            "viscous": platform.viscous.model_copy(update=viscous),
            "added_mass": _scaled(platform.added_mass, ADDED_MASS, factors),
            "added_inertia": _scaled(platform.added_inertia, ADDED_INERTIA, factors),
        }
    )


def with_coefficient_errors(platform: Platform, share: float, rng: np.random.Generator) -> Platform:
    """Draw every coefficient uniformly within `share` of its value, each by itself."""
    factors = rng.uniform(1.0 - share, 1.0 + share, len(COEFFICIENTS))
    return with_factors(platform, dict(zip(COEFFICIENTS, factors.tolist(), strict=True)))


def with_sample_interval(platform: Platform, interval: float) -> Platform:
    """Give a platform whose file states another sample interval (s), as that of a slower recorder would."""
    return platform.model_copy(update={"sensors": platform.sensors.model_copy(update={"sample_interval": interval})})


def _scaled(values: tuple[float, ...], names: tuple[str, ...], factors: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(value * factors.get(name, 1.0) for value, name in zip(values, names, strict=True))
