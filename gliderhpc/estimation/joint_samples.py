"""Records whose depth and attitude are in different rows, as where files of two computers were joined by time."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.observations.format import MEASURED
from gliderhpc.observations.intervals import usual_interval, without_gaps
from gliderhpc.observations.records import FloatArray, ProfileRecord
from gliderhpc.observations.rows import onto_nearest, rarely_together


def jointly_sampled(record: ProfileRecord) -> ProfileRecord:
    """Put the attitude on the nearest rows with depth if the two are hardly ever in one row.

    Nothing is interpolated or repeated: a sample is moved by half the interval between depths at most, and those that
    are not nearest to a depth stay where they are. The depth is not moved, since it changes more within that time than
    the attitude. Other records are returned unchanged.

    Parameters
    ----------
    record : ProfileRecord
        The record as measured.

    Returns
    -------
    ProfileRecord
        Record with attitude and depth in the same rows.
    """
    if not rarely_together(*(np.isfinite(getattr(record, name)) for name in MEASURED)):
        return record
    deep = np.isfinite(record.depth)
    moved: dict[str, Any] = {
        name: _moved(record.time, getattr(record, name), deep) for name in MEASURED if name != "depth"
    }
    return replace(record, **moved)


def _moved(time: FloatArray, values: FloatArray, deep: NDArray[np.bool_]) -> FloatArray:
    """Return values ``(n,)``, each moved to the nearest row with depth if that is within reach."""
    rows, others = np.flatnonzero(deep), np.flatnonzero(np.isfinite(values) & ~deep)
    reach = 0.5 * usual_interval(without_gaps(np.diff(time[rows])))
    source = onto_nearest(time[rows], time[others], others.astype(np.float64), reach)
    taken = np.isfinite(source) & np.isnan(values[rows])
    moved, result = source[taken].astype(np.int64), values.copy()
    result[rows[taken]] = values[moved]
    result[moved] = np.nan
    return result
