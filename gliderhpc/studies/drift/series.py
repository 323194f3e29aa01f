"""The twelve series of an estimate, six disturbances on dive and climb, with their trends and the paper's grades."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gliderhpc.studies.drift.medians import PHASES, UNITS, column
from gliderhpc.studies.drift.trends import SeriesTrend, corrected_for_number, series_trend
from gliderhpc.studies.library.trend import LEVEL

Array = NDArray[np.float64]
Key = tuple[str, str]
"""Channel and phase."""

LONGITUDINAL = ("B_cu", "B_cw", "B_cq")
LATERAL = ("B_cv", "B_cp", "B_cr")

NEGLIGIBLE = 0.1
"""A lateral drift below this part of the largest longitudinal one of its unit is negligible (section 5.6)."""


@dataclass(frozen=True, eq=False)
class EstimateTrends:
    """Trends of the twelve series of an estimate.

    Attributes
    ----------
    estimate : str
        Whose medians they are.
    trends : mapping of (channel, phase) to SeriesTrend
        In the order of the paper's table.
    """

    estimate: str
    trends: Mapping[Key, SeriesTrend]

    def tier(self, key: Key) -> str:
        """Grade a series as the paper does: primary, supporting, negligible or none."""
        one = self.trends[key]
        if not one.trend.p < LEVEL:
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
    found = [trend_of(table, column(*key, estimate), resamples, seed) for key in keys]
    return EstimateTrends(estimate, dict(zip(keys, corrected_for_number(found), strict=True)))


def trend_of(table: pd.DataFrame, name: str, resamples: int, seed: int) -> SeriesTrend:
    """Find the trend of a column over the days; a column that is not there has none."""
    return series_trend(days_of(table), values_of(table, name), epochs_of(table), resamples, seed)


def values_of(table: pd.DataFrame, name: str) -> Array:
    """Give a column as an array, NaN where it is not there."""
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
