"""Standard deviation of the windows' disturbances, by the smoother's posterior."""

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.windows import DiveSolution

Array = NDArray[np.float64]

AVERAGED = 30.0
"""Interval over which the squared difference from the smoother's estimate is averaged, s; the length of a window."""


def adjoint_deviation(solution: DiveSolution, smoothed: SmoothedEstimate, every: int, interval: float) -> Array:
    """Standard deviation of the windows' disturbances at the records.

    Parameters
    ----------
    solution : DiveSolution
        Solution of the windows, on the steps.
    smoothed : SmoothedEstimate
        Estimate of the smoother at the records, with the hull's part in its uncertainty.
    every : int
        Steps from record to record.
    interval : float
        Time from record to record, s.

    Returns
    -------
    (m, 6) array
        Standard deviation of the disturbance of the step that starts at each record, N and N m; NaN if the smoother
        has no estimate.
    """
    width = 2 * round(0.5 * AVERAGED / interval) + 1
    return deviation_about(solution.disturbances[::every], smoothed.disturbances, smoothed.disturbances_std, width)


def deviation_about(estimate: Array, mean: Array, std: Array, width: int) -> Array:
    """Standard deviation of an estimate, given only the posterior of another method.

    Parameters
    ----------
    estimate : (m, k)
        The estimate.
    mean, std : (m, k)
        Mean and standard deviation of the posterior at the same times.
    width : int
        Odd number of entries over which the squared difference is averaged; fewer are available at both ends.

    Returns
    -------
    (m, k) array
        Root of the expected squared error; NaN where the posterior's standard deviation is.

    Notes
    -----
    If the truth has the posterior ``N(mean, std^2)``, the expected squared error of any other estimate is ``std^2 +
    (estimate - mean)^2``. The second term is averaged over `width` entries: one difference is small where the estimate
    crosses the mean, by chance.
    """
    apart = scipy.ndimage.uniform_filter1d((estimate - mean) ** 2, width, axis=0)
    # The filter's running sum may leave a rounding error below zero after large differences.
    return np.asarray(np.sqrt(std**2 + np.maximum(apart, 0.0)))
