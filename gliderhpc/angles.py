"""Angles: wrapped, unwrapped, and on the branch of others."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def wrap(angle: Array, turn: float = 360.0) -> Array:
    """Wrap angles to half a turn on either side of zero, the lower end included; a turn is 360 degrees or 2 pi."""
    return np.asarray(np.mod(angle + 0.5 * turn, turn) - 0.5 * turn)


def principal_angle(radians: Array) -> Array:
    """Wrap angles to [-pi, pi] by their sine and cosine."""
    return np.asarray(np.arctan2(np.sin(radians), np.cos(radians)))


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
