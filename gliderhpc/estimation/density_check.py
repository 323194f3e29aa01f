"""Check of the measured density against the platform file's: the CTD's record or the neutral volume may be wrong."""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.preparation import by_density
from gliderhpc.flight.buoyancy import DENSITY, PRESSURE
from gliderhpc.flight.hull_parameters import TYPICAL_COMPRESSIBILITY
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.platform import Platform

UNEXPECTED_DIFFERENCE = 5.0
"""Difference from the platform file's density, kg/m3, that is reported: a plausible deviation of the neutral volume."""


def surface_density(seawater: NDArray[np.float64]) -> float:
    """Median density (kg/m3) at surface pressure of seawater ``(n, 4)``, as in `gliderhpc.flight.buoyancy`."""
    return float(np.median(seawater[:, DENSITY] * (1.0 - TYPICAL_COMPRESSIBILITY * seawater[:, PRESSURE])))


def is_unexpected_density(platform: Platform, density: float) -> bool:
    """Return whether a density at the surface (kg/m3) is far from that of the platform file."""
    return abs(density - platform.buoyancy.water_density) >= UNEXPECTED_DIFFERENCE


def describe_unexpected_density(platform: Platform, series: ProfileSeries) -> str | None:
    """Describe a density far from the platform file's, with the remedy; None if it is near or not used.

    A hull that seems to be too heavy or too light may be right, and the record of temperature or salinity wrong.
    """
    if series.seawater is None or not by_density(platform, series):
        return None
    density = surface_density(series.seawater)
    if not is_unexpected_density(platform, density):
        return None
    return (
        f"the water has {density:.1f} kg/m3 (median, at surface pressure) and the platform file "
        f"{platform.buoyancy.water_density:g} (buoyancy.water_density): check the record's practical_salinity and "
        "temperature"
    )
