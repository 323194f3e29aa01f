"""Innovations of the filter: their likelihood, and whether they contradict the prior of the disturbances.

By the prediction-error decomposition, the log-likelihood of a prior is the sum over a record's samples of the log
density of the innovation, ``-1/2 (e^2 / S + log S + log 2 pi)`` with the variance ``S`` that the filter expected.
"""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.observations.format import MEASURED

Array = NDArray[np.float64]

_CONTRADICTION = 4.0
"""Mean square of an angle's standardised innovations above which another prior is tried: it was at most 1.4 on twins in
calm water and in yaw impulses, also of wrong hulls, and 8 to 25 for roll and heading in weak gusts from the side."""


DEPARTURE = 4.0
"""Innovation in standard deviations beyond which a quantity departs from the model."""


def log_density(innovations: Array, variances: Array, gate: float) -> Array:
    """Log density of innovations; those beyond ``gate`` standard deviations are placed at the gate."""
    squares = np.minimum(innovations**2 / variances, gate**2)
    return np.asarray(-0.5 * (squares + np.log(2.0 * np.pi * variances)))


def contradict_prior(innovations: Array, variances: Array, gate: float) -> bool:
    """Return whether roll, pitch or heading move more than the prior lets them.

    Parameters
    ----------
    innovations, variances : (m, 4), (m, 4)
        Innovations of roll, pitch, heading and depth, and the variances that the filter expected.
    gate : float
        Innovation in standard deviations beyond which a sample is rejected, and counts as one at the gate.
    """
    squares = np.minimum(innovations[:, :3] ** 2 / variances[:, :3], gate**2)
    counts = np.isfinite(squares).sum(axis=0)
    return bool((np.nansum(squares, axis=0) > _CONTRADICTION * counts).any())


def departing_quantity(innovations: Array, variances: Array) -> str:
    """Return which of `MEASURED` most often has the largest of the innovations beyond `DEPARTURE`; empty if none does.

    Parameters
    ----------
    innovations, variances : (m, 4), (m, 4)
        Innovations of the samples, NaN where nothing was measured, and the variances that the filter expected.
    """
    with np.errstate(invalid="ignore"):
        sizes = np.nan_to_num(innovations**2 / variances)
    far = sizes[(sizes > DEPARTURE**2).any(axis=1)]
    return MEASURED[int(np.bincount(far.argmax(axis=1)).argmax())] if len(far) else ""
