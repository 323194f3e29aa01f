"""The twelve series of an estimate, six disturbances on dive and climb: epochs, trends and the paper's grades.

An epoch is a run of consecutive profiles; the scatter within it is the repeatability of a profile before anything can
have drifted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.store_schema.columns import PHASES, median_column
from gliderhpc.studies.library.drift.medians import UNITS
from gliderhpc.studies.library.trends import (
    MIN_VALUES,
    SIGNIFICANCE,
    RobustTest,
    Trend,
    block_length,
    blocks_of,
    epoch_draws,
    find_trend,
    holm,
    interval,
    robust_test,
    slope_draws,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LONGITUDINAL = ("B_cu", "B_cw", "B_cq")

LATERAL = ("B_cv", "B_cp", "B_cr")

NEGLIGIBLE = 0.1
"""A lateral drift below this part of the largest longitudinal one of its unit is negligible (section 5.6)."""

Key = tuple[str, str]
"""Channel and phase."""


def choose_epochs(numbers: Sequence[int], count: int | None, size: int) -> list[tuple[int, ...]]:
    """Choose epochs among the profiles of a mission.

    Parameters
    ----------
    numbers : sequence of int
        Numbers of the profiles that can be studied, in order.
    count : int, optional
        Epochs to spread evenly over them; None takes all profiles, as does a mission too short for so many.
    size : int
        Consecutive profiles an epoch; the last one of all profiles may be smaller.
    """
    if count is None or len(numbers) <= count * size:
        return [tuple(numbers[start : start + size]) for start in range(0, len(numbers), size)]
    starts = np.rint(np.linspace(0, len(numbers) - size, count)).astype(int)
    return [tuple(numbers[start : start + size]) for start in starts]


def epoch_of_profiles(epochs: Sequence[Sequence[int]]) -> Index:
    """Return the epoch (from 0) of each profile, one epoch after the other."""
    return np.repeat(np.arange(len(epochs)), [len(epoch) for epoch in epochs]).astype(np.int64)


def noise_floor(values: Array, epoch: Index) -> float:
    """Pooled standard deviation of a series (n,) within its epochs (n,); NaN where no epoch has two values."""
    known = np.isfinite(values)
    squares, freedom = 0.0, 0
    for number in np.unique(epoch[known]):
        own = values[known & (epoch == number)]
        squares += float(((own - own.mean()) ** 2).sum())
        freedom += len(own) - 1
    return float(np.sqrt(squares / freedom)) if freedom else float("nan")


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
        The robust p, adjusted for the number of series tested together; its own where it was tested alone.
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
        """True where the slope's interval lies on one side of zero."""
        return bool(self.trend.low > 0.0 or self.trend.high < 0.0)

    @property
    def primary(self) -> bool:
        """True where plain test and slope's interval agree on a trend, as the paper grades it."""
        return bool(self.trend.p < SIGNIFICANCE) and self.excludes_zero

    @property
    def shown(self) -> bool:
        """True where the robust verdict is a drift: its p, adjusted, and the slope's interval agree."""
        return bool(self.corrected < SIGNIFICANCE) and self.excludes_zero

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
    if len(y) < MIN_VALUES:
        nothing = RobustTest(float("nan"), float("nan"), 0)
        return SeriesTrend(trend, nothing, noise_floor(y, own), float("nan"), np.empty(0), float("nan"))
    robust = robust_test(t, y, resamples, rng)
    draws = slope_draws(t, y, epoch_draws(blocks_of(own, block_length(t, y)), resamples, rng))
    low, high = interval(draws)
    return SeriesTrend(
        replace(trend, low=low, high=high), robust, noise_floor(y, own), float(t[-1] - t[0]), draws, robust.p
    )


def corrected_for_number(trends: Sequence[SeriesTrend]) -> list[SeriesTrend]:
    """Adjust the robust p of series that are tested together (Holm)."""
    adjusted = holm([one.robust.p for one in trends])
    return [replace(one, corrected=p) for one, p in zip(trends, adjusted, strict=True)]


@dataclass(frozen=True, eq=False)
class EstimateTrends:
    """Trends of the twelve series of an estimate.

    Attributes
    ----------
    estimate : str
        Estimate of the medians.
    trends : mapping of (channel, phase) to SeriesTrend
        In the order of the paper's table.
    """

    estimate: str
    trends: Mapping[Key, SeriesTrend]

    def tier(self, key: Key) -> str:
        """Grade a series as the paper does: primary, supporting, negligible or none."""
        one = self.trends[key]
        if not one.trend.p < SIGNIFICANCE:
            return "none"
        if key[0] in LATERAL and abs(one.drift) < NEGLIGIBLE * self._largest_longitudinal(UNITS[key[0]]):
            return "negligible"
        return "primary" if one.primary else "supporting"

    @property
    def shown(self) -> tuple[Key, ...]:
        """Series that drift by the robust verdict."""
        return tuple(key for key, one in self.trends.items() if one.shown)

    def _largest_longitudinal(self, unit: str) -> float:
        drifts = [
            abs(self.trends[key].drift) for key in self.trends if key[0] in LONGITUDINAL and UNITS[key[0]] == unit
        ]
        return float(np.nanmax(drifts)) if np.isfinite(drifts).any() else float("nan")


def estimate_trends(table: pd.DataFrame, estimate: str, resamples: int, seed: int) -> EstimateTrends:
    """Find the trends of the twelve series of an estimate.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile, with ``elapsed_days`` and ``epoch``.
    estimate : str
        Of those that the medians were taken of.
    resamples, seed : int
        Of the bootstraps.
    """
    keys = [(channel, phase) for channel in (*LONGITUDINAL, *LATERAL) for phase in PHASES]
    found = [trend_of(table, median_column(*key, estimate), resamples, seed) for key in keys]
    return EstimateTrends(estimate, dict(zip(keys, corrected_for_number(found), strict=True)))


def trend_of(table: pd.DataFrame, name: str, resamples: int, seed: int) -> SeriesTrend:
    """Find the trend of a column over the days; a column that is not there has none."""
    return series_trend(days_of(table), values_of(table, name), epochs_of(table), resamples, seed)


def values_of(table: pd.DataFrame, name: str) -> Array:
    """Return a column as an array; NaN where it is missing."""
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64)


def of_epochs(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the profiles that are in an epoch: those that trends are tested on."""
    return table[table["epoch"].notna()].reset_index(drop=True)


def days_of(table: pd.DataFrame) -> Array:
    """Days since the first observation."""
    return values_of(table, "elapsed_days")


def epochs_of(table: pd.DataFrame) -> NDArray[np.int64]:
    """Epoch of each profile."""
    return table["epoch"].to_numpy(np.int64)
