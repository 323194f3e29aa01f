"""Rows of an instrument's files, and columns of an observation file under construction."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.importing.excursions import in_excursion
from gliderhpc.observations.records import FloatArray, TimeArray

NOT_INCREASING = "time not increasing"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one or more files.

    Attributes
    ----------
    time : (n,) array
        Times of the rows (UTC, ns).
    part : (n,) int array
        Number of the file from which each row comes.
    columns : dict of str to (n,) array
        Values by column, in the file's units; NaN where a field is empty.
    """

    time: TimeArray
    part: npt.NDArray[np.int64]
    columns: dict[str, FloatArray]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def where(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> "Rows":
        """Select some of the rows, by a mask or by their indices."""
        columns = {name: values[chosen] for name, values in self.columns.items()}
        return Rows(self.time[chosen], self.part[chosen], columns)


def increasing(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the times that are present, in no excursion of the clock, and later than all preceding ones."""
    there = ~np.isnat(time) & ~in_excursion(time)
    since = np.where(there, time.astype("datetime64[ns]").astype(np.int64), np.iinfo(np.int64).min)
    there[1:] &= since[1:] > np.maximum.accumulate(since)[:-1]
    return there


def keep_rows(rows: Rows, keep: npt.NDArray[np.bool_], reason: str, dropped: Counter[str]) -> Rows:
    """Keep the rows selected by a mask, and count the others in `dropped` under `reason`."""
    lost = int(np.count_nonzero(~keep))
    if lost:
        dropped[reason] += lost
    return rows.where(keep)


def join_rows(parts: Sequence[Rows], names: Iterable[str]) -> Rows:
    """Concatenate the rows of several files; the columns are `names`."""
    if not parts:
        return Rows(np.zeros(0, "datetime64[ns]"), np.zeros(0, np.int64), {name: np.zeros(0) for name in names})
    return Rows(
        np.concatenate([part.time for part in parts]),
        np.concatenate([part.part for part in parts]),
        {name: np.concatenate([part[name] for part in parts]) for name in names},
    )


Columns = dict[str, npt.NDArray[np.generic]]
"""Variables of the observation format by name, in the units of the format."""


def join_columns(parts: Sequence[Columns]) -> Columns:
    """Concatenate the samples of several files; a column that a file lacks is NaN there.

    Parameters
    ----------
    parts : sequence of dict
        Columns of each file, including ``time``.
    """
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate([part.get(name, np.full(len(part["time"]), np.nan)) for part in parts]) for name in names
    }
