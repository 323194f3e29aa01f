"""The dive within a record that also holds what the glider did at the surface."""

import numpy as np

from gliderhpc.errors import ProfileError
from gliderhpc.observations.profiles import MINIMUM_DEPTH
from gliderhpc.observations.records import FloatArray

SURFACE_DEPTH = 3.0
"""Above this a glider is taken to float, or to leave the surface or reach it (m)."""


def dive_span(
    depth: FloatArray, *, begin: float = SURFACE_DEPTH, end: float = SURFACE_DEPTH, minimum: float = MINIMUM_DEPTH
) -> tuple[int, int]:
    """First sample of the dive and the one after its last.

    Parameters
    ----------
    depth : (n,) array
        Depth over one dive and the surface around it, positive down (m); NaN is missing.
    begin, end : float
        The dive begins with the first sample below the one, and ends with the last below the other (m).
    minimum : float
        It must reach this depth (m).

    Raises
    ------
    ProfileError
        It is too shallow.
    """
    deepest = float(np.max(depth, where=np.isfinite(depth), initial=-np.inf))
    if not deepest >= minimum:
        reached = f"dives to {deepest:.0f} m" if np.isfinite(deepest) else "has no depth"
        raise ProfileError(f"too shallow: {reached}, at least {minimum:g} m are needed")
    first, last = np.flatnonzero(depth > begin), np.flatnonzero(depth > end)
    if not len(first) or not len(last):
        raise ProfileError(
            f"too shallow: dives to {deepest:.0f} m, and would begin below {begin:g} m and end above {end:g} m"
        )
    return int(first[0]), int(last[-1]) + 1
