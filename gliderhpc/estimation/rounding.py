"""What rounded samples are worth: a value repeated says the same rounding error again, not a new one."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SAME = 1e-9
"""Values this close (rad) are the same."""


def repetitions(values: Array) -> NDArray[np.int64]:
    """Length ``(m,)`` of the run of equal values that each of ``values (m,)`` stands in; a NaN stands alone."""
    new = ~(np.abs(np.diff(values)) <= _SAME)
    starts = np.concatenate([[0], np.flatnonzero(new) + 1]).astype(np.int64)
    counts = np.diff(np.append(starts, len(values)))
    return np.repeat(counts, counts)
