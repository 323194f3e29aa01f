"""Averages of what is constant over steps."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def averages_between(values: FloatArray, edges: FloatArray, wanted: FloatArray) -> FloatArray:
    """Average columns that are constant over steps over other steps; exact, whatever the two are.

    Parameters
    ----------
    values : (n, k) array
        Row i holds from ``edges[i]`` to ``edges[i + 1]``.
    edges : (n + 1,) array
        Increasing.
    wanted : (m + 1,) array
        Edges of the steps to average over, increasing; beyond `edges` the values count as zero.

    Returns
    -------
    (m, k) array
    """
    integral = np.vstack([np.zeros(values.shape[1]), np.cumsum(values * np.diff(edges)[:, None], axis=0)])
    at_wanted = np.column_stack([np.interp(wanted, edges, column) for column in integral.T])
    return np.asarray(np.diff(at_wanted, axis=0) / np.diff(wanted)[:, None])
