"""A trend test that serial correlation does not fool: Mann-Kendall by the moving-block bootstrap; and testing many."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.studies.drift.slopes import FEWEST
from gliderhpc.studies.library.trend import LEAST

Array = NDArray[np.float64]

UNSEEN = 2.0
"""Times the length of a block over that of the series, by which the spread of S is widened."""

LARGEST_CORRELATION = 0.9
"""Of neighbours, that the length of blocks allows for."""


LONG = 16
"""Values from which on the automatic length can be found: it looks at correlations far apart."""

_ROUNDING = 1e-12


@dataclass(frozen=True)
class RobustTest:
    """Mann-Kendall by the moving-block bootstrap.

    Attributes
    ----------
    score : float
        Kendall's S over what its standard deviation would be without a trend.
    p : float
        Two-sided probability of chance.
    block : int
        Values a block.
    """

    score: float
    p: float
    block: int


def robust_test(time: Array, values: Array, resamples: int, rng: np.random.Generator) -> RobustTest:
    """Test a series, in the order of time and without missing values, for a monotonic trend.

    Parameters
    ----------
    time, values : (n,)
        The series.
    resamples : int
        Bootstrap series.
    rng : numpy.random.Generator
        Where blocks are drawn from.

    Notes
    -----
    Blocks of neighbouring values of what a straight line leaves are drawn with replacement and joined, which keeps
    their correlation (Kunsch 1989); S of the series is held against the spread of S among them. Blocks, and the line
    taken out, miss the slowest changes, a share of the variance that goes with the length of a block over that of the
    series (`UNSEEN`), and the spread is known no better than from the few blocks that there are, so p is Student's with
    their number less one. With the bare percentiles of the bootstrap, short series give false trends three times as
    often as stated (docs/drift.md has the rates).
    """
    n = len(values)
    if n < LEAST:
        return RobustTest(float("nan"), float("nan"), 0)
    block = block_length(time, values)
    score = float(kendall_scores(values[None])[0])
    if score == 0.0:
        return RobustTest(0.0, 1.0, block)
    spread = max(bootstrap_spread(without_line(time, values), block, resamples, rng), independent_spread(n))
    standard = score / (spread * (1.0 + UNSEEN * block / n))
    return RobustTest(standard, float(2.0 * scipy.stats.t.sf(abs(standard), n / block - 1.0)), block)


def bootstrap_spread(rest: Array, block: int, resamples: int, rng: np.random.Generator) -> float:
    """Standard deviation of Kendall's S among series put together from blocks."""
    return float(kendall_scores(moving_blocks(rest, block, resamples, rng)).std())


def independent_spread(n: int) -> float:
    """Standard deviation of Kendall's S of n independent values: correlation that is seen never makes it less."""
    return float(np.sqrt(n * (n - 1) * (2 * n + 5) / 18.0))


def without_line(time: Array, values: Array) -> Array:
    """What the Theil-Sen line leaves, without its mean."""
    rest = values - scipy.stats.theilslopes(values, time).slope * time
    return np.asarray(rest - rest.mean())


def block_length(time: Array, values: Array) -> int:
    """Values a block: the larger of two automatic choices, both from what a straight line leaves.

    Notes
    -----
    The choice of Politis and White (2004, as corrected 2009) for the circular bootstrap, and the same for a
    first-order autoregression, ``(6 n)^(1/3) (rho / (1 - rho^2))^(2/3)``, whose correlation is corrected for the bias
    of a short series from which a line was taken. In short series the first sees too little of the correlation.
    """
    from arch.bootstrap import optimal_block_length

    n, rest = len(values), without_line(time, values)
    power = float(rest @ rest)
    if power <= _ROUNDING**2 * float(values @ values):
        return 1
    automatic = float(optimal_block_length(rest)["circular"].iloc[0]) if n >= LONG else 1.0
    correlation = float(rest[1:] @ rest[:-1]) / power
    corrected = min(max((n * correlation + 2.0) / max(n - 4.0, 1.0), 0.0), LARGEST_CORRELATION)
    autoregressive = (6.0 * n) ** (1.0 / 3.0) * (corrected / (1.0 - corrected**2)) ** (2.0 / 3.0)
    return min(max(int(np.ceil(np.nanmax([automatic, autoregressive]))), 1), max(n // FEWEST, 1))


def moving_blocks(values: Array, block: int, resamples: int, rng: np.random.Generator) -> Array:
    """Series ``(resamples, n)`` put together from blocks of neighbouring values of a series ``(n,)``."""
    n = len(values)
    starts = rng.integers(0, n - block + 1, (resamples, -(-n // block)))
    taken = (starts[:, :, None] + np.arange(block)).reshape(resamples, -1)[:, :n]
    return np.asarray(values[taken])


def kendall_scores(series: Array) -> Array:
    """Kendall's S of each of some series ``(m, n)``: pairs that rise less pairs that fall."""
    n = series.shape[1]
    scores = np.zeros(len(series))
    for apart in range(1, n):
        scores += np.sign(series[:, apart:] - series[:, :-apart]).sum(axis=1)
    return scores


def holm(p: Sequence[float]) -> list[float]:
    """Adjust probabilities of chance for their number (Holm 1979); missing ones stay missing and are not counted.

    Holm's is valid however the tests depend on each other, and these share profiles and forces.
    """
    values = np.asarray(p, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    adjusted = np.full(len(values), np.nan)
    order = known[np.argsort(values[known])]
    running = 0.0
    for rank, place in enumerate(order):
        running = max(running, (len(order) - rank) * float(values[place]))
        adjusted[place] = min(running, 1.0)
    return [float(value) for value in adjusted]
