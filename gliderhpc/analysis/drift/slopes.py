"""Theil-Sen slopes and their intervals, by drawing whole epochs."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

INTERVAL = (2.5, 97.5)
"""Percentiles of a 95 % interval."""

FEWEST = 5
"""Blocks to draw from, at least, where there are as many values."""


def theil_sen(time: Array, values: Array) -> float:
    """Median of the slopes of all pairs at different times."""
    return _median_slope(pair_slopes(time, values), np.arange(len(time)))


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
    """Theil-Sen slope of every bootstrap series, each value at its own time; NaN where all fell on one time."""
    slopes = pair_slopes(time, values)
    return np.array([_median_slope(slopes, drawn) for drawn in draws])


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


def _median_slope(slopes: Array, chosen: Index) -> float:
    # Every pair is there twice, which leaves the median as it is.
    of_pairs = slopes[np.ix_(chosen, chosen)].ravel()
    known = of_pairs[np.isfinite(of_pairs)]
    return float(np.median(known)) if known.size else float("nan")
