"""Rows of an instrument's files, and the columns of an observation file under construction."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.clock_steps import ClockStep, find_clock_steps
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
        """Mask ``(n,)`` of the rows whose time lies after all before."""
        return increasing(self.time)


def increasing(time: TimeArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the times that are present and lie after all before."""
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


Columns = dict[str, npt.NDArray[np.generic]]
"""Variables of the observation format by name, in its units."""


def join_columns(parts: Sequence[Columns]) -> Columns:
    """Put the samples of several files one after the other; what one of them lacks is missing (NaN) there.

    Parameters
    ----------
    parts : sequence of dict
        Columns along ``time``, which each of them has.
    """
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate([part.get(name, np.full(len(part["time"]), np.nan)) for part in parts]) for name in names
    }


def in_time_order(columns: Columns) -> tuple[Columns, int, list[ClockStep]]:
    """Keep the samples whose time lies after all before them; the number of the others, and the steps of the clock."""
    time = columns["time"].astype("datetime64[ns]")
    keep = increasing(time)
    steps = find_clock_steps(time, keep, columns["depth"].astype(np.float64))
    return {name: values[keep] for name, values in columns.items()}, int(np.count_nonzero(~keep)), steps


def onto_nearest(
    time: TimeArray, sampled: TimeArray, values: FloatArray, within: np.timedelta64 | TimeArray
) -> FloatArray:
    """Put each sample on the nearest of other times, NaN where there is none within reach.

    Nothing is interpolated: a sample that was not measured is no datum.

    Parameters
    ----------
    time : (n,) array
        Where the samples should go, increasing, n >= 1.
    sampled : (m,) array
        When they were taken.
    values : (m,) array
        The samples.
    within : numpy.timedelta64, or (m,) array of them
        How far a sample may be moved, or each of them.

    Returns
    -------
    (n,) array
    """
    right = np.clip(np.searchsorted(time, sampled), 0, len(time) - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(np.abs(sampled - time[left]) <= np.abs(time[right] - sampled), left, right)
    distance = np.abs(sampled - time[nearest])
    # Farthest first, so that of two samples on one place the nearer is the one that stays.
    order = np.argsort(-distance, kind="stable")
    order = order[(distance <= within)[order] & np.isfinite(values[order])]
    placed = np.full(len(time), np.nan)
    for index in order.tolist():
        placed[nearest[index]] = values[index]
    return placed
