"""Angles of an archive, in degrees: wrapped, unwrapped, and on the branch of others."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrap(degrees: Array) -> Array:
    """Wrap angles to [-180, 180) degrees."""
    return np.mod(degrees + 180.0, 360.0) - 180.0


def unwrap(degrees: Array) -> Array:
    """Remove the jumps of 360 degrees from angles (degrees); missing values are bridged and remain missing."""
    unwrapped = degrees.copy()
    known = np.isfinite(degrees)
    unwrapped[known] = np.unwrap(degrees[known], period=360.0)
    return unwrapped


def on_branch_of(reference: Array, degrees: Array) -> Array:
    """Shift angles by whole turns to within 180 degrees of an unwrapped reference, which may have missing values."""
    known = np.isfinite(reference)
    if not known.any():
        return unwrap(degrees)
    index = np.arange(len(reference))
    nearby = np.interp(index, index[known], reference[known])
    return nearby + wrap(degrees - nearby)
