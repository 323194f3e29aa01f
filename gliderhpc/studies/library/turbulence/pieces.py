"""A series with stretches left out: what is taken from it never spans one of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.observations.stretches import stretches

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Pieces:
    """A series of which some stretches count.

    Attributes
    ----------
    values : (n,) array
        The whole series.
    label : (n,) int array
        Number of the unbroken stretch that a sample belongs to, -1 where it does not count.
    step : float
        Time between samples, s.
    """

    values: Array
    label: NDArray[np.int64]
    step: float

    @property
    def counted(self) -> Mask:
        """Samples ``(n,)`` that count."""
        return np.asarray(self.label >= 0, dtype=np.bool_)

    @property
    def duration(self) -> float:
        """Time that counts, s."""
        return float(np.count_nonzero(self.counted)) * self.step

    def increments(self, lag: int) -> tuple[Array, NDArray[np.int64]]:
        """Differences ``x[i + lag] - x[i]`` within a stretch, and the samples i at which they begin."""
        begin, end = self.label[:-lag], self.label[lag:]
        first = np.flatnonzero((begin == end) & (begin >= 0))
        return self.values[first + lag] - self.values[first], first

    def thinned(self, every: int) -> "Pieces":
        """Average runs of `every` samples, of which all must be of one stretch; what is over at the end is lost."""
        if every == 1:
            return self
        count = len(self.values) // every
        shape = (count, every)
        values = self.values[: count * every].reshape(shape).mean(axis=1)
        labels = self.label[: count * every].reshape(shape)
        alike = (labels == labels[:, :1]).all(axis=1)
        return Pieces(values, np.where(alike, labels[:, 0], -1), every * self.step)


def pieces_of(values: Array, kept: Mask, step: float, least: float = 0.0) -> Pieces:
    """Cut a series ``(n,)`` into the stretches of a mask ``(n,)`` that last at least so long (s)."""
    label = np.full(len(values), -1, dtype=np.int64)
    long = [(first, stop) for first, stop in stretches(kept) if (stop - first) * step >= least]
    for number, (first, stop) in enumerate(long):
        label[first:stop] = number
    return Pieces(values, label, step)
