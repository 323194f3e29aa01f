"""Drag and lift of a glider without a platform file: those of its make, with their uncertainty.

Pitch and depth rate give the speed through the water once the angle of attack is known, and the angle of attack depends
only on the ratio of drag to lift.
"""

import math
import re
from dataclasses import dataclass

from gliderhpc.platform import Platform, read_platform

MAKE_DEVIATION = 0.35
"""Standard deviation of the log drag-to-lift ratio among vehicles of one make: fouling, sensors and wings."""

UNKNOWN_DEVIATION = 0.5
"""Standard deviation of the same logarithm if the make of the vehicle is not known."""

HULL_DEVIATION = 0.1
"""Standard deviation of the same logarithm for a hull that the user gives."""

_MAKES = (
    ("slocum", r"slocum|teledyne|webb|\bunit ?\d+|\bru ?\d\d\b|dbdreader"),
    ("seaglider", r"seaglider|kongsberg|hydroid|\bsg ?\d{3}\b"),
    ("seaexplorer", r"seaexplorer|alseamar|\bsea ?\d{3}\b|\beva ?\d{3}\b"),
    ("petrel-l", r"petrel"),
    ("seawing", r"sea[- ]?wing|haiyi"),
)
_FALLBACK = "slocum"


@dataclass(frozen=True, eq=False)
class GlidePolar:
    """Drag and lift from which the speed follows, given pitch and depth rate.

    Attributes
    ----------
    platform : Platform
        A shipped hull of the make, or the hull given; only its drag and lift are used.
    deviation : float
        Standard deviation of the logarithm of the drag-to-lift ratio.
    make : str
        Name of the make or of the hull given.
    """

    platform: Platform
    deviation: float
    make: str

    @property
    def hulls(self) -> tuple[Platform, Platform, Platform]:
        """The hull, then the hull with its drag one standard deviation larger, then one standard deviation smaller."""
        factor = math.exp(self.deviation)
        return self.platform, with_drag(self.platform, factor), with_drag(self.platform, 1.0 / factor)


def with_drag(platform: Platform, factor: float) -> Platform:
    """Return a hull with its drag multiplied by a factor, at the same lift."""
    viscous = platform.viscous
    scaled = viscous.model_copy(update={"K_D0": viscous.K_D0 * factor, "K_D": viscous.K_D * factor})
    return platform.model_copy(update={"viscous": scaled})


def polar_of_make(vehicle: str) -> GlidePolar:
    """Return the drag and lift of a vehicle's make, recognised in a file's description of its glider."""
    make = next((make for make, pattern in _MAKES if re.search(pattern, vehicle.lower().replace("_", " "))), None)
    if make is None:
        return GlidePolar(read_platform(_FALLBACK), UNKNOWN_DEVIATION, f"unknown, as {_FALLBACK}")
    return GlidePolar(read_platform(make), MAKE_DEVIATION, make)


def polar_of_hull(platform: Platform) -> GlidePolar:
    """Return the drag and lift of a hull that the user gives."""
    return GlidePolar(platform, HULL_DEVIATION, platform.name)
