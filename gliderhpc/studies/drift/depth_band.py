"""The depths that the medians are taken over."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

USUAL = (150.0, 500.0)
"""Depth band of section 5.6, m."""

SHALLOW = (0.3, 0.95)
"""Band of a mission that does not reach it, in parts of the depth that nine of ten profiles reach."""

_REACHED = 0.1


@dataclass(frozen=True)
class DepthBand:
    """Depths that count (m), and what to say of them."""

    low: float
    high: float
    remark: str = ""

    def holds(self, depth: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Samples inside."""
        return np.asarray((depth >= self.low) & (depth <= self.high), dtype=np.bool_)


def depth_band(max_depths: NDArray[np.float64], wanted: tuple[float, float] | None) -> DepthBand:
    """Give the band asked for, the usual one, or the like part of dives too shallow for it."""
    if wanted is not None:
        return DepthBand(*wanted)
    reached = float(np.nanquantile(max_depths, _REACHED))
    if reached >= USUAL[1]:
        return DepthBand(*USUAL)
    low, high = min(USUAL[0], SHALLOW[0] * reached), SHALLOW[1] * reached
    return DepthBand(
        low, high,
        f"one profile in ten is shallower than {reached:.0f} m, so the medians are taken over {low:.0f} to {high:.0f} "
        f"m in place of {USUAL[0]:.0f} to {USUAL[1]:.0f} m; --set drift.depth_band=[LOW,HIGH] chooses otherwise",
    )  # fmt: skip
