"""Medians and quartiles of interleaved runs, so that load or throttling affects all contenders alike."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np
from threadpoolctl import threadpool_limits


@dataclass(frozen=True)
class Spread:
    """Median and quartiles of a quantity, and of how many values."""

    median: float
    lower: float
    upper: float
    count: int

    def row(self) -> dict[str, float]:
        """As plain values."""
        return asdict(self)


def spread_of(values: Sequence[float]) -> Spread:
    """Median and quartiles of some values.

    Raises
    ------
    ValueError
        There is none.
    """
    if not len(values):
        raise ValueError("no value to take a median of")
    lower, median, upper = np.percentile(np.asarray(values, dtype=float), [25, 50, 75])
    return Spread(float(median), float(lower), float(upper), len(values))


def seconds_of(function: Callable[[], object]) -> float:
    """Wall time of one call, s."""
    began = time.perf_counter()
    function()
    return time.perf_counter() - began


def in_turns(functions: Mapping[str, Callable[[], object]], repetitions: int) -> dict[str, list[float]]:
    """Wall times (s) of each function: one call by each in turn, over and over, after one each that does not count."""
    for function in functions.values():
        function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repetitions):
        for name, function in functions.items():
            times[name].append(seconds_of(function))
    return times


def ratios_to(reference: str, medians: Mapping[str, float]) -> dict[str, float]:
    """Divide every median by the reference's."""
    return {name: value / medians[reference] for name, value in medians.items()}


def growth_exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Slope of log time against log size by least squares: 1 where the cost grows in proportion.

    Raises
    ------
    ValueError
        Fewer than two sizes differ.
    """
    if len(set(sizes)) < 2:
        raise ValueError("a growth needs at least two sizes")
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def groups_of(count: int, batch: int) -> list[range]:
    """Cut ``0 .. count - 1`` into runs of at most `batch`."""
    return [range(begin, min(begin + batch, count)) for begin in range(0, count, batch)]


@contextmanager
def one_core() -> Iterator[None]:
    """Hold this thread, and threads it starts, on one core with one linear-algebra thread."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None
    with threadpool_limits(limits=1):
        if allowed is None:
            yield
            return
        os.sched_setaffinity(0, {max(allowed)})
        try:
            yield
        finally:
            os.sched_setaffinity(0, allowed)
