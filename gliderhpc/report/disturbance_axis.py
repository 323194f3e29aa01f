"""The axis of a disturbance: its limits, and what leaves them."""

from collections.abc import Mapping, Sequence

import numpy as np

from gliderhpc.archive.profile import Array, Mask
from gliderhpc.report.profile_heading import signed

# The axis of a disturbance spans these percentiles of steady glide, or all of it where that is not much more: a rare
# excursion then neither flattens everything else nor, when it is an impulse like its neighbours, gets cut.
PERCENTILES = (0.1, 99.9)
ROOM_FOR_EXTREMES = 2.5
SMALLEST_SPAN = 0.02
"""N or N m: an axis is not narrower, so that rounding and noise do not look like a signal."""


def axis_limits(curves: Sequence[Array], steady: Mask) -> tuple[float, float]:
    """Limits of a disturbance's axis.

    Parameters
    ----------
    curves : sequence of (n,) array
        What is drawn on the axis; NaN is missing.
    steady : (n,) array of bool
        The samples that set the limits.

    Returns
    -------
    tuple of float
        Lower and upper limit: around percentiles 0.1 to 99.9 of the steady samples, or all of these where they span no
        more than 2.5 times as much.
    """
    inside = np.concatenate([curve[steady & np.isfinite(curve)] for curve in curves])
    if not inside.size:
        everything = np.concatenate([curve[np.isfinite(curve)] for curve in curves])
        inside = everything if everything.size else np.zeros(1)
    low, high = (float(value) for value in np.percentile(inside, PERCENTILES))
    if np.ptp(inside) <= ROOM_FOR_EXTREMES * (high - low):
        low, high = float(inside.min()), float(inside.max())
    padding = 0.08 * max(high - low, SMALLEST_SPAN) + max(0.0, SMALLEST_SPAN - (high - low)) / 2.0
    return low - padding, high + padding


def outside_axis(curves: Mapping[str, Array], limits: tuple[float, float], unit: str) -> str:
    """Say which curves leave the axis and how far, or nothing where none does."""
    parts = []
    for name, curve in curves.items():
        below, above = curve[curve < limits[0]], curve[curve > limits[1]]
        ends = ([below.min()] if below.size else []) + ([above.max()] if above.size else [])
        if ends:
            parts.append(f"{name} to {' and '.join(signed(end, '.2g') for end in ends)} {unit}")
    return f"outside the axis: {', '.join(parts)}" if parts else ""
