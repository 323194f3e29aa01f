"""A stretch of the yaw moment with the windows' boundaries, for panels (a) and (b) of the figure."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.twins.inversion import TwinCase, invert_twin
from gliderhpc.twins.scoring import YAW
from gliderhpc.twins.windows.sweeps import OPERATING_LENGTH, WindowsSize, window_of
from gliderhpc.twins.worlds import course_of, world

EXCERPT = 160.0
"""Seconds that panels (a) and (b) of the figure show."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """A stretch of the yaw moment for panels (a) and (b): time and seams from its start (s), truth, estimate (N m)."""

    hull: str
    preset: str
    sliding: bool
    time: NDArray[np.float64]
    truth: NDArray[np.float64]
    estimate: NDArray[np.float64]
    boundaries: NDArray[np.float64]


def draw_excerpt(platform: Platform, size: WindowsSize, preset: str, sliding: bool) -> Excerpt:
    """Invert one twin at the operating length and cut a stretch of steady glide around its busiest moment."""
    margin = {} if sliding else {"margin": 0.0}
    settings = EstimationSettings.model_validate({"preset": preset, **window_of(OPERATING_LENGTH, **margin)})
    inversion = invert_twin(TwinCase(platform, world(size.depth), 1, settings, course_of(1)))
    count = round(EXCERPT / inversion.step)
    start = busiest(np.where(inversion.steady, inversion.truth[:, YAW], 0.0), inversion.steady, count)
    part = slice(start, start + count)
    seams = np.flatnonzero(np.diff(inversion.estimate.solution.source)) + 1 - start
    return Excerpt(
        hull=platform.name,
        preset=preset,
        sliding=sliding,
        time=np.arange(count, dtype=np.float64) * inversion.step,
        truth=inversion.truth[part, YAW],
        estimate=inversion.estimate.solution.disturbances[part, YAW],
        boundaries=np.asarray(seams[(seams > 0) & (seams < count)] * inversion.step, dtype=np.float64),
    )


def busiest(signal: NDArray[np.float64], steady: NDArray[np.bool_], count: int) -> int:
    """First sample of the stretch of `count` with most energy, nine tenths as steady as the steadiest."""
    count = min(count, len(signal))
    ones = np.ones(count)
    calm = np.convolve(steady.astype(np.float64), ones, mode="valid")
    energy = np.convolve(signal**2, ones, mode="valid")
    return int(np.argmax(np.where(calm >= 0.9 * calm.max(), energy, -1.0)))
