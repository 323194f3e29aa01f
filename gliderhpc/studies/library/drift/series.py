"""Twelve series of an estimate, six disturbances on dive and climb: epochs, trends and the paper's grades.

An epoch is a run of consecutive profiles. It is too short for a drift, so the scatter within it is the repeatability of
a profile.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.store_schema.columns import median_column
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
from gliderhpc.vocabulary import PHASES

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LONGITUDINAL = ("B_cu", "B_cw", "B_cq")

LATERAL = ("B_cv", "B_cp", "B_cr")

NEGLIGIBLE = 0.1
"""Ratio to the largest longitudinal drift of the same unit below which a lateral drift is negligible (section 5.6)."""

Key = tuple[str, str]
"""Channel and phase."""


def choose_epochs(numbers: Sequence[int], count: int | None, size: int) -> list[tuple[int, ...]]:
    """Choose epochs among the profiles of a mission.

    Parameters
    ----------
    numbers : sequence of int
        Numbers of the profiles that can be studied, in order.
    count : int, optional
        Number of epochs, spread evenly; all profiles are used if None, or if the mission is too short for this number.
    size : int
        Number of consecutive profiles in an epoch; if all profiles are used, the last epoch may be smaller.
    """
    if count is None or len(numbers) <= count * size:
        return [tuple(numbers[start : start + size]) for start in range(0, len(numbers), size)]
    starts = np.rint(np.linspace(0, len(numbers) - size, count)).astype(int)
    return [tuple(numbers[start : start + size]) for start in starts]


def epoch_of_profiles(epochs: Sequence[Sequence[int]]) -> Index:
    """Return the number (from 0) of each profile's epoch, one epoch after the other."""
    return np.repeat(np.arange(len(epochs)), [len(epoch) for epoch in epochs]).astype(np.int64)


def noise_floor(values: Array, epoch: Index) -> float:
    """Pooled standard deviation of a series (n,) within its epochs (n,); NaN if no epoch has two values."""
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
        Plain test and slope, with the bootstrap's interval.
    robust : RobustTest
        Test that accounts for serial correlation.
    floor : float
        Standard deviation within epochs.
    span : float
        Days from the first to the last value.
    draws : (resamples,) array
        Slopes of the bootstrap series.
    corrected : float
        Robust p, adjusted for the number of series tested together, if there are several.
    """

    trend: Trend
    robust: RobustTest
    floor: float
    span: float
    draws: Array
    corrected: float

    @property
    def drift(self) -> float:
        """Change over the span of the series."""
        return self.trend.slope * self.span

    @property
    def ratio(self) -> float:
        """Ratio of the change's magnitude to the noise floor."""
        return abs(self.drift) / self.floor if self.floor > 0.0 else float("nan")

    @property
    def excludes_zero(self) -> bool:
        """Return whether the slope's interval lies on one side of zero."""
        return bool(self.trend.low > 0.0 or self.trend.high < 0.0)

    @property
    def primary(self) -> bool:
        """Return whether plain test and slope's interval both show a trend: the paper's grade ``primary``."""
        return bool(self.trend.p < SIGNIFICANCE) and self.excludes_zero

    @property
    def is_significant(self) -> bool:
        """Return whether the robust test, with its adjusted p, and the slope's interval both show a drift."""
        return bool(self.corrected < SIGNIFICANCE) and self.excludes_zero

    def as_json(self) -> dict[str, Any]:
        """Return the trend as plain values."""
        return {
            **self.trend.as_json(),
            "robust": asdict(self.robust),
            "corrected_p": self.corrected,
            "floor": self.floor,
            "drift": self.drift,
            "ratio": self.ratio,
            "shown": self.is_significant,
        }


def series_trend(time: Array, values: Array, epoch: Index, resamples: int, seed: int) -> SeriesTrend:
    """Find the trend of a series, without its missing values.

    Parameters
    ----------
    time, values : (n,)
        Days and medians.
    epoch : (n,)
        Epochs of the values.
    resamples, seed : int
        Number of bootstrap series, and seed.

    Notes
    -----
    The slope's interval is that of Theil-Sen slopes of series of whole epochs drawn with replacement. If values are
    correlated over more than one epoch, blocks of several epochs are drawn.
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
    adjusted = holm([trend.robust.p for trend in trends])
    return [replace(trend, corrected=p) for trend, p in zip(trends, adjusted, strict=True)]


@dataclass(frozen=True, eq=False)
class EstimateTrends:
    """Trends of the twelve series of an estimate.

    Attributes
    ----------
    estimate : str
        Estimate of the medians.
    trends : mapping of (channel, phase) to SeriesTrend
        Trends in the order of the paper's table.
    """

    estimate: str
    trends: Mapping[Key, SeriesTrend]

    def tier(self, key: Key) -> str:
        """Return the paper's grade of a series: primary, supporting, negligible or none."""
        trend = self.trends[key]
        if not trend.trend.p < SIGNIFICANCE:
            return "none"
        if key[0] in LATERAL and abs(trend.drift) < NEGLIGIBLE * self._largest_longitudinal(UNITS[key[0]]):
            return "negligible"
        return "primary" if trend.primary else "supporting"

    @property
    def drifting(self) -> tuple[Key, ...]:
        """Series that drift according to the robust test."""
        return tuple(key for key, trend in self.trends.items() if trend.is_significant)

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
        Table of medians, one row for each profile, with ``elapsed_days`` and ``epoch``.
    estimate : str
        Name of an estimate with medians.
    resamples, seed : int
        Number of bootstrap series, and seed.
    """
    keys = [(channel, phase) for channel in (*LONGITUDINAL, *LATERAL) for phase in PHASES]
    trends = [trend_of(table, median_column(*key, estimate), resamples, seed) for key in keys]
    return EstimateTrends(estimate, dict(zip(keys, corrected_for_number(trends), strict=True)))


def trend_of(table: pd.DataFrame, name: str, resamples: int, seed: int) -> SeriesTrend:
    """Find the trend of a column over the days; NaN if the table lacks the column."""
    return series_trend(days_of(table), values_of(table, name), epochs_of(table), resamples, seed)


def values_of(table: pd.DataFrame, name: str) -> Array:
    """Return a column as an array; NaN if the table lacks it."""
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64)


def of_epochs(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the profiles in an epoch, which are those used for trends."""
    return table[table["epoch"].notna()].reset_index(drop=True)


def days_of(table: pd.DataFrame) -> Array:
    """Days from the first observation to each profile."""
    return values_of(table, "elapsed_days")


def epochs_of(table: pd.DataFrame) -> NDArray[np.int64]:
    """Epoch of each profile."""
    return table["epoch"].to_numpy(np.int64)
