"""Rows of an OG1 file that are samples of the flight, and the water's values on them."""

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.og1_variables import SEAWATER
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.rows import Columns, onto_nearest, rarely_together
from gliderhpc.observations.times import SECOND


def is_flight(samples: Columns) -> npt.NDArray[np.bool_]:
    """Mask of the rows with attitude, and of those with depth if the two are hardly ever in one row.

    Other rows contain fixes, or sensors that are sampled at other times.
    """
    roll, pitch, heading, depth = (np.isfinite(floats(samples[name])) for name in ("roll", "pitch", "heading", "depth"))
    attitude = roll | pitch | heading
    return attitude | depth if rarely_together(roll, pitch, heading, depth) else attitude


def chosen_samples(samples: Columns, rows: npt.NDArray[np.int64]) -> Columns:
    """Select rows; temperature, salinity and pressure that are sampled in other rows are put on the nearest ones.

    Nothing is interpolated: a sample is moved by half the usual interval between the rows at most.
    """
    chosen = {name: values[rows] for name, values in samples.items()}
    every, time = (one["time"].astype("datetime64[ns]") for one in (samples, chosen))
    usual = usual_interval(without_gaps(np.diff(time) / SECOND))
    for name in [name for name in SEAWATER if name in samples and np.isfinite(usual)]:
        values = floats(samples[name])
        known = np.flatnonzero(np.isfinite(values) & ~np.isnat(every))
        if len(known) > 2 * np.count_nonzero(np.isfinite(values[rows])):
            reach = np.timedelta64(round(0.5e9 * usual), "ns")
            chosen[name] = onto_nearest(time, every[known], values[known], reach)
    return chosen


def floats(values: npt.NDArray[np.generic]) -> FloatArray:
    """Return values as float64."""
    return values.astype(np.float64)
