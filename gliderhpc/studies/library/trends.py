"""Non-parametric monotonic trends: Mann-Kendall tests, plain and robust to serial correlation; Theil-Sen slopes."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MIN_VALUES = 4
"""Minimum number of values for a trend."""

SIGNIFICANCE = 0.05
"""Probability of chance below which a trend is significant."""

INTERVAL = (2.5, 97.5)
"""Percentiles of a 95 % interval."""

MIN_BLOCKS = 5
"""Minimum number of blocks to draw from, if there are that many values."""

PAIRS_AT_A_TIME = 4_000_000
"""Number of pairs of values whose weights are in memory at a time."""

SPREAD_WIDENING = 2.0
"""Relative widening of the spread of S, per ratio of a block's length to that of the series."""

MAX_CORRELATION = 0.9
"""Largest correlation of neighbours that the length of blocks accounts for."""

MIN_AUTOMATIC = 16
"""Minimum number of values for the automatic block length, which uses correlations at large lags."""

_ROUNDING = 1e-12


@dataclass(frozen=True)
class Trend:
    """A trend over time.

    Attributes
    ----------
    count : int
        Number of finite values.
    tau, p : float
        Kendall's tau (S over the number of pairs) and the two-sided probability of chance.
    slope, low, high : float
        Theil-Sen slope per unit of time and its 95 % interval.
    first, last : float
        Level of the fitted line at the first and the last time with a value.
    begin, end : float
        These two times.
    """

    count: int
    tau: float
    p: float
    slope: float
    low: float
    high: float
    first: float
    last: float
    begin: float
    end: float

    @property
    def change(self) -> float:
        """Change of the fitted line relative to its first level; NaN if that level is not distinguishable from zero.

        The line pivots about the middle of the record. The half width of the first level's interval is therefore that
        of the slope times half the length of the record.
        """
        rise = self.last - self.first
        doubt = 0.25 * rise / self.slope * (self.high - self.low) if self.slope else 0.0
        return rise / self.first if self.first > doubt else float("nan")

    @property
    def change_text(self) -> str:
        """Change in per cent, or in the values' own unit if the relative change is undefined."""
        if np.isfinite(self.change):
            return f"{100.0 * self.change:+.0f} %"
        return f"{self.last - self.first:+.2g}, starting level not distinguishable from zero,"

    def as_json(self) -> dict[str, Any]:
        """Return the trend as plain values."""
        return asdict(self) | {"change": self.change}


def known_pairs(time: ArrayLike, values: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and values of a series without the missing ones."""
    t, y = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = np.isfinite(t) & np.isfinite(y)
    return t[known], y[known]


def find_trend(time: ArrayLike, values: ArrayLike) -> Trend:
    """Find the trend of values over time, without the missing ones.

    Parameters
    ----------
    time, values : (n,) array_like
        Increasing times, and the values at these times.

    Returns
    -------
    Trend
        Trend; all NaN, except for the count, with fewer than four values.

    Notes
    -----
    The test is the plain one, a normal approximation with corrections for continuity and ties. If values are correlated
    from one profile to the next, its p is too small and the interval of the slope too narrow.
    """
    t, y = known_pairs(time, values)
    if len(y) < MIN_VALUES:
        return Trend(len(y), *([float("nan")] * 9))
    tau, p = mann_kendall(y)
    slope, intercept, low, high = (float(value) for value in scipy.stats.theilslopes(y, t))
    return Trend(len(y), tau, p, slope, low, high, intercept + slope * t[0], intercept + slope * t[-1], t[0], t[-1])


def mann_kendall(values: NDArray[np.float64]) -> tuple[float, float]:
    """Kendall's tau and the two-sided p of the Mann-Kendall test, for values in time order."""
    import pymannkendall  # loads scipy.stats

    result = pymannkendall.original_test(values)
    return float(result.Tau), float(result.p)


def theil_sen(time: Array, values: Array) -> float:
    """Median of the slopes of all pairs at different times."""
    return float(slope_draws(time, values, [np.arange(len(time))])[0])


def epoch_draws(blocks: Index, resamples: int, rng: np.random.Generator) -> list[Index]:
    """Draw bootstrap series of whole blocks with replacement; returns the indices of each series' values.

    Parameters
    ----------
    blocks : (n,)
        Block number of each value; each series has as many blocks as there are.
    resamples : int
        Number of bootstrap series.
    rng : numpy.random.Generator
        Generator of the draws.
    """
    members = [np.flatnonzero(blocks == number) for number in np.unique(blocks)]
    drawn = rng.integers(0, len(members), (resamples, len(members)))
    if len({len(own) for own in members}) == 1:
        return list(np.stack(members)[drawn].reshape(resamples, -1))
    return [np.concatenate([members[number] for number in row]) for row in drawn]


def slope_draws(time: Array, values: Array, draws: list[Index]) -> Array:
    """Theil-Sen slope of every bootstrap series, each value at its own time; NaN if all values have the same time.

    Notes
    -----
    The weight of a pair of values is the product of the numbers of times that they were drawn. The slopes are sorted
    once, and each series' slope is a weighted median. It equals the median of all pairs of the series to the last bit.
    """
    slopes, first, second = _sorted_slopes(time, values)
    counts = _counts(draws, len(time))
    at_a_time = max(1, PAIRS_AT_A_TIME // max(len(slopes), 1))
    parts = [
        _weighted_medians(slopes, part[:, first] * part[:, second])
        for part in np.array_split(counts, range(at_a_time, len(counts), at_a_time))
    ]
    return np.concatenate(parts)


def _counts(draws: list[Index], size: int) -> Index:
    """Count how often each of `size` values is in each bootstrap series, ``(draws, size)``."""
    series = np.repeat(np.arange(len(draws)), [len(drawn) for drawn in draws])
    return np.bincount(series * size + np.concatenate(draws), minlength=len(draws) * size).reshape(-1, size)


def interval(draws: Array) -> tuple[float, float]:
    """Return the 95 % interval of draws; NaN if there are none."""
    known = draws[np.isfinite(draws)]
    if not known.size:
        return float("nan"), float("nan")
    low, high = np.percentile(known, INTERVAL)
    return float(low), float(high)


def blocks_of(epoch: Index, length: int) -> Index:
    """Block numbers (n,): whole epochs (n,), joined until a block has at least `length` values.

    If there are fewer than `MIN_BLOCKS` of these, blocks are neighbouring values regardless of their epochs.
    """
    blocks = np.zeros(len(epoch), dtype=np.int64)
    block, size = 0, 0
    for index in range(len(epoch)):
        if index and epoch[index] != epoch[index - 1] and size >= length:
            block, size = block + 1, 0
        blocks[index] = block
        size += 1
    if block + 1 >= MIN_BLOCKS:
        return blocks
    return np.arange(len(epoch)) // max(len(epoch) // MIN_BLOCKS, 1)


def pair_slopes(time: Array, values: Array) -> Array:
    """Slopes (n, n) of all pairs; NaN for pairs at the same time."""
    apart = time[:, None] - time[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(apart != 0.0, (values[:, None] - values[None]) / apart, np.nan)


def _sorted_slopes(time: Array, values: Array) -> tuple[Array, Index, Index]:
    """Slopes of the pairs at different times, ascending, with the indices of both values of each pair."""
    first, second = np.triu_indices(len(time), 1)
    slopes = pair_slopes(time, values)[first, second]
    order = np.argsort(slopes)[: np.isfinite(slopes).sum()]
    return slopes[order], first[order], second[order]


def _weighted_medians(ascending: Array, weights: Index) -> Array:
    """Medians (series,) of ascending values (pairs,) with weights (series, pairs); NaN if all weights are zero."""
    if not ascending.size:
        return np.full(len(weights), np.nan)
    upto = np.cumsum(weights, axis=1)
    total = upto[:, -1:]
    lower, upper = (ascending[np.argmax(upto > rank, axis=1)] for rank in ((total - 1) // 2, total // 2))
    return np.where(total[:, 0] > 0, 0.5 * (lower + upper), np.nan)


@dataclass(frozen=True)
class RobustTest:
    """Result of the Mann-Kendall test with a moving-block bootstrap.

    Attributes
    ----------
    score : float
        Kendall's S over its standard deviation without a trend.
    p : float
        Two-sided probability of chance.
    block : int
        Number of values in a block.
    """

    score: float
    p: float
    block: int


def robust_test(time: Array, values: Array, resamples: int, rng: np.random.Generator) -> RobustTest:
    """Test a series in time order, without missing values, for a monotonic trend.

    Parameters
    ----------
    time, values : (n,)
        The series.
    resamples : int
        Number of bootstrap series.
    rng : numpy.random.Generator
        Generator of the draws.

    Notes
    -----
    Residuals from a straight line are drawn with replacement in blocks of neighbouring values and joined, which
    preserves their correlation (Kunsch 1989). S of the series is compared with the spread of S among these series. The
    blocks and the removal of the line suppress the slowest changes. The missing share of the variance grows with the
    ratio of a block's length to that of the series, so the spread is widened (`SPREAD_WIDENING`). The spread is
    estimated from few blocks, so p is from Student's distribution, with the number of blocks minus one degrees of
    freedom. With percentiles of the bootstrap alone, short series give false trends three times as often as stated
    (docs/drift.md has the rates).
    """
    n = len(values)
    if n < MIN_VALUES:
        return RobustTest(float("nan"), float("nan"), 0)
    block = block_length(time, values)
    score = float(kendall_scores(values[None])[0])
    if score == 0.0:
        return RobustTest(0.0, 1.0, block)
    spread = max(bootstrap_spread(without_line(time, values), block, resamples, rng), independent_spread(n))
    standard = score / (spread * (1.0 + SPREAD_WIDENING * block / n))
    return RobustTest(standard, float(2.0 * scipy.stats.t.sf(abs(standard), n / block - 1.0)), block)


def bootstrap_spread(rest: Array, block: int, resamples: int, rng: np.random.Generator) -> float:
    """Standard deviation of Kendall's S among series joined from blocks of the residuals."""
    return float(kendall_scores(moving_blocks(rest, block, resamples, rng)).std())


def independent_spread(n: int) -> float:
    """Standard deviation of Kendall's S of n independent values: the lower limit of the bootstrap's spread."""
    return float(np.sqrt(n * (n - 1) * (2 * n + 5) / 18.0))


def without_line(time: Array, values: Array) -> Array:
    """Residuals from the Theil-Sen line, minus their mean."""
    rest = values - scipy.stats.theilslopes(values, time).slope * time
    return np.asarray(rest - rest.mean())


def block_length(time: Array, values: Array) -> int:
    """Number of values in a block: the larger of two automatic choices from the residuals of a straight line.

    Notes
    -----
    The first is the choice of Politis and White (2004, as corrected 2009) for the circular bootstrap. In short series
    it underestimates the correlation. The second is the choice for a first-order autoregression,
    ``(6 n)^(1/3) (rho / (1 - rho^2))^(2/3)``, with a correlation corrected for the bias of a short detrended series.
    """
    from arch.bootstrap import optimal_block_length

    n, rest = len(values), without_line(time, values)
    power = float(rest @ rest)
    if power <= _ROUNDING**2 * float(values @ values):
        return 1
    automatic = float(optimal_block_length(rest)["circular"].iloc[0]) if n >= MIN_AUTOMATIC else 1.0
    correlation = float(rest[1:] @ rest[:-1]) / power
    corrected = min(max((n * correlation + 2.0) / max(n - 4.0, 1.0), 0.0), MAX_CORRELATION)
    autoregressive = (6.0 * n) ** (1.0 / 3.0) * (corrected / (1.0 - corrected**2)) ** (2.0 / 3.0)
    return min(max(int(np.ceil(np.nanmax([automatic, autoregressive]))), 1), max(n // MIN_BLOCKS, 1))


def moving_blocks(values: Array, block: int, resamples: int, rng: np.random.Generator) -> Array:
    """Join series ``(resamples, n)`` from blocks of neighbouring values of a series ``(n,)``."""
    n = len(values)
    starts = rng.integers(0, n - block + 1, (resamples, -(-n // block)))
    taken = (starts[:, :, None] + np.arange(block)).reshape(resamples, -1)[:, :n]
    return np.asarray(values[taken])


def kendall_scores(series: Array) -> Array:
    """Kendall's S of each series ``(m, n)``: number of rising pairs minus number of falling pairs."""
    n = series.shape[1]
    scores = np.zeros(len(series))
    for apart in range(1, n):
        scores += np.sign(series[:, apart:] - series[:, :-apart]).sum(axis=1)
    return scores


def holm(p: Sequence[float]) -> list[float]:
    """Adjust probabilities of chance for their number (Holm 1979); missing ones stay missing and are not counted.

    Holm's method is valid for any dependence between the tests; these share profiles and forces.
    """
    values = np.asarray(p, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    adjusted = np.full(len(values), np.nan)
    order = known[np.argsort(values[known])]
    running = 0.0
    for rank, index in enumerate(order):
        running = max(running, (len(order) - rank) * float(values[index]))
        adjusted[index] = min(running, 1.0)
    return [float(value) for value in adjusted]
