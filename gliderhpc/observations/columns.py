"""Variables of an observation file under construction, and their pieces put together."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.clock_steps import ClockStep, find_clock_steps
from gliderhpc.observations.rows import increasing

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
