"""Epochs: runs of consecutive profiles, which tell how well a profile repeats before anything can have drifted."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    """Give the epoch (from 0) of each profile, one epoch after the other."""
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
