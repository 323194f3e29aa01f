"""Theil-Sen slopes and their intervals, by drawing whole epochs."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

INTERVAL = (2.5, 97.5)
"""Percentiles of a 95 % interval."""

FEWEST = 5
"""Blocks to draw from, at least, where there are as many values."""


PAIRS_AT_A_TIME = 4_000_000
"""Pairs of values whose weights are held in memory at a time."""


def theil_sen(time: Array, values: Array) -> float:
    """Median of the slopes of all pairs at different times."""
    return float(slope_draws(time, values, [np.arange(len(time))])[0])


def epoch_draws(blocks: Index, resamples: int, rng: np.random.Generator) -> list[Index]:
    """Places of the values in each bootstrap series: as many blocks as there are, drawn with replacement.

    Parameters
    ----------
    blocks : (n,)
        Block of each value.
    resamples : int
        Bootstrap series.
    rng : numpy.random.Generator
        Where blocks are drawn from.
    """
    members = [np.flatnonzero(blocks == number) for number in np.unique(blocks)]
    drawn = rng.integers(0, len(members), (resamples, len(members)))
    return [np.concatenate([members[number] for number in row]) for row in drawn]


def slope_draws(time: Array, values: Array, draws: list[Index]) -> Array:
    """Theil-Sen slope of every bootstrap series, each value at its own time; NaN where all fell on one time.

    Notes
    -----
    A pair of values counts as often as both were drawn, so the slopes are sorted once and a weighted median is taken of
    each series; that is the median of all pairs of the series, to the last bit.
    """
    slopes, first, second = _sorted_slopes(time, values)
    counts = np.array([np.bincount(drawn, minlength=len(time)) for drawn in draws])
    at_a_time = max(1, PAIRS_AT_A_TIME // max(len(slopes), 1))
    parts = [
        _weighted_medians(slopes, part[:, first] * part[:, second])
        for part in np.array_split(counts, range(at_a_time, len(counts), at_a_time))
    ]
    return np.concatenate(parts)


def interval(draws: Array) -> tuple[float, float]:
    """Return the 95 % interval of draws; NaN where there are none."""
    known = draws[np.isfinite(draws)]
    if not known.size:
        return float("nan"), float("nan")
    low, high = np.percentile(known, INTERVAL)
    return float(low), float(high)


def blocks_of(epoch: Index, length: int) -> Index:
    """Blocks (n,) to draw: whole epochs (n,), as many to a block as make up `length` values.

    Where that leaves too few to draw from, neighbouring values whatever their epoch.
    """
    blocks = np.zeros(len(epoch), dtype=np.int64)
    block, size = 0, 0
    for place in range(len(epoch)):
        if place and epoch[place] != epoch[place - 1] and size >= length:
            block, size = block + 1, 0
        blocks[place] = block
        size += 1
    if block + 1 >= FEWEST:
        return blocks
    return np.arange(len(epoch)) // max(len(epoch) // FEWEST, 1)


def pair_slopes(time: Array, values: Array) -> Array:
    """Slopes (n, n) of all pairs, NaN for those at one time."""
    apart = time[:, None] - time[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(apart != 0.0, (values[:, None] - values[None]) / apart, np.nan)


def _sorted_slopes(time: Array, values: Array) -> tuple[Array, Index, Index]:
    """Slopes of the pairs at different times, ascending, with the places of either value of each pair."""
    first, second = np.triu_indices(len(time), 1)
    slopes = pair_slopes(time, values)[first, second]
    order = np.argsort(slopes)[: np.isfinite(slopes).sum()]
    return slopes[order], first[order], second[order]


def _weighted_medians(ascending: Array, weights: Index) -> Array:
    """Median (series,) of values (pairs,) that count ``weights (series, pairs)`` times; NaN where none counts."""
    if not ascending.size:
        return np.full(len(weights), np.nan)
    upto = np.cumsum(weights, axis=1)
    total = upto[:, -1:]
    lower, upper = (ascending[np.argmax(upto > place, axis=1)] for place in ((total - 1) // 2, total // 2))
    return np.where(total[:, 0] > 0, 0.5 * (lower + upper), np.nan)
