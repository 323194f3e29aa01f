"""Sign of the depth in an instrument's own files, which declare none: positive down is expected."""

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.profiles import MIN_DEPTH
from gliderhpc.observations.records import FloatArray

MIN_NEGATIVE = 10
"""Least number of depths below -`MIN_DEPTH` that prove a reversed sign; fewer may be junk."""


def refuse_negative_depth(depth: FloatArray, source: str, name: str) -> None:
    """Refuse depths that are negative under water.

    Parameters
    ----------
    depth : (n,) array
        Depths (m); NaN where missing.
    source, name : str
        Names of the file or folder and of the variable in the message.

    Raises
    ------
    InputError
        More depths are far above the surface than far below it; the message gives the remedy.
    """
    negative = np.count_nonzero(depth < -MIN_DEPTH)
    if negative >= MIN_NEGATIVE and negative > np.count_nonzero(depth > MIN_DEPTH):
        raise InputError(
            f"{source}: {name} is negative under water ({np.nanmin(depth):.4g} m at the deepest); make it positive down"
        )
