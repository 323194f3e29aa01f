"""The trend of one series of medians: as the paper has it, and with the test that serial correlation does not fool."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.studies.drift.epochs import noise_floor
from gliderhpc.studies.drift.robust import RobustTest, block_length, holm, robust_test
from gliderhpc.studies.drift.slopes import blocks_of, epoch_draws, interval, slope_draws
from gliderhpc.studies.library.trend import LEAST, LEVEL, Trend, find_trend

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SeriesTrend:
    """Trend of a series.

    Attributes
    ----------
    trend : Trend
        Plain test and slope; its interval is the bootstrap's.
    robust : RobustTest
        The test that allows for serial correlation.
    floor : float
        Standard deviation within epochs.
    span : float
        Days from the first to the last value.
    draws : (resamples,) array
        Slopes of the bootstrap series.
    corrected : float
        The robust p, adjusted for the number of series tested beside this one; its own where it was tested alone.
    """

    trend: Trend
    robust: RobustTest
    floor: float
    span: float
    draws: Array
    corrected: float

    @property
    def drift(self) -> float:
        """Change over the span."""
        return self.trend.slope * self.span

    @property
    def ratio(self) -> float:
        """Change over the noise floor."""
        return abs(self.drift) / self.floor if self.floor > 0.0 else float("nan")

    @property
    def excludes_zero(self) -> bool:
        """Whether the slope's interval lies on one side of zero."""
        return bool(self.trend.low > 0.0 or self.trend.high < 0.0)

    @property
    def primary(self) -> bool:
        """Whether plain test and slope's interval agree on a trend, as the paper grades it."""
        return bool(self.trend.p < LEVEL) and self.excludes_zero

    @property
    def shown(self) -> bool:
        """Whether the robust verdict is a drift: its p, adjusted, and the slope's interval agree."""
        return bool(self.corrected < LEVEL) and self.excludes_zero

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            **self.trend.as_json(),
            "robust": asdict(self.robust),
            "corrected_p": self.corrected,
            "floor": self.floor,
            "drift": self.drift,
            "ratio": self.ratio,
            "shown": self.shown,
        }


def series_trend(time: Array, values: Array, epoch: Index, resamples: int, seed: int) -> SeriesTrend:
    """Find the trend of a series; missing values are left out.

    Parameters
    ----------
    time, values : (n,)
        Days and medians.
    epoch : (n,)
        Epoch of each.
    resamples, seed : int
        Of the bootstraps.

    Notes
    -----
    The slope's interval is that of Theil-Sen slopes of whole epochs drawn with replacement, several to a block where
    values are correlated over more than one.
    """
    known = np.isfinite(values) & np.isfinite(time)
    t, y, own = time[known], values[known], epoch[known]
    trend, rng = find_trend(t, y), np.random.default_rng(seed)
    if len(y) < LEAST:
        nothing = RobustTest(float("nan"), float("nan"), 0)
        return SeriesTrend(trend, nothing, noise_floor(y, own), float("nan"), np.empty(0), float("nan"))
    robust = robust_test(t, y, resamples, rng)
    draws = slope_draws(t, y, epoch_draws(blocks_of(own, block_length(t, y)), resamples, rng))
    low, high = interval(draws)
    return SeriesTrend(
        replace(trend, low=low, high=high), robust, noise_floor(y, own), float(t[-1] - t[0]), draws, robust.p
    )


def corrected_for_number(trends: Sequence[SeriesTrend]) -> list[SeriesTrend]:
    """Adjust the robust p of series that are tested beside each other (Holm)."""
    adjusted = holm([one.robust.p for one in trends])
    return [replace(one, corrected=p) for one, p in zip(trends, adjusted, strict=True)]
