"""Rows of an instrument's files as numbers, in the order of the files, before they are an observation file's."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.records import FloatArray, TimeArray

NOT_INCREASING = "time not increasing"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one or more files.

    Attributes
    ----------
    time : (n,) array
        UTC (ns).
    part : (n,) int array
        Number of the file each row comes from.
    columns : dict of str to (n,) array
        The values, in the file's units; NaN where a field is empty.
    """

    time: TimeArray
    part: npt.NDArray[np.int64]
    columns: dict[str, FloatArray]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def where(self, keep: npt.NDArray[np.bool_]) -> "Rows":
        """Keep some of the rows."""
        columns = {name: values[keep] for name, values in self.columns.items()}
        return Rows(self.time[keep], self.part[keep], columns)

    def increasing(self) -> npt.NDArray[np.bool_]:
        """Whether each row's time lies after all before it, ``(n,)``."""
        return increasing(self.time)


def increasing(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Whether each time is there and lies after all before it, ``(n,)``."""
    there = ~np.isnat(time)
    since = np.where(there, time.astype("datetime64[ns]").astype(np.int64), np.iinfo(np.int64).min)
    there[1:] &= since[1:] > np.maximum.accumulate(since)[:-1]
    return there


def keep_rows(rows: Rows, keep: npt.NDArray[np.bool_], reason: str, dropped: Counter[str]) -> Rows:
    """Keep some of the rows and count the others in `dropped` under `reason`."""
    lost = int(np.count_nonzero(~keep))
    if lost:
        dropped[reason] += lost
    return rows.where(keep)


def join_rows(parts: Sequence[Rows], names: Iterable[str]) -> Rows:
    """Put the rows of several files one after the other; the columns are `names`."""
    if not parts:
        return Rows(np.zeros(0, "datetime64[ns]"), np.zeros(0, np.int64), {name: np.zeros(0) for name in names})
    return Rows(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.part for part in parts]),
        {name: np.concatenate([part[name] for part in parts]) for name in names},
    )
