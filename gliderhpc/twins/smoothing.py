"""A smoothed twin, and whether intervals hold what they promise."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.estimation.profile_smoother import smooth_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import SmoothedEstimate
from gliderhpc.flight.glider import Glider
from gliderhpc.twins.inversion import TwinCase, TwinInversion

Array = NDArray[np.float64]

INTERVALS = {"68": 0.9944578832097532, "95": 1.959963984540054}
"""Half widths, in standard deviations, of the intervals whose coverage is counted: 68 % and 95 %."""


@dataclass(frozen=True, eq=False)
class SmoothedTwin:
    """A smoothed twin.

    Attributes
    ----------
    smoothed : SmoothedEstimate
        The smoother's, from the filter's estimate.
    seconds : float
        What the smoother took, s.
    """

    smoothed: SmoothedEstimate
    seconds: float


def smooth_twin(case: TwinCase, inversion: TwinInversion, settings: EstimationSettings) -> SmoothedTwin:
    """Smooth a twin that was inverted.

    Parameters
    ----------
    case, inversion : TwinCase, TwinInversion
        The twin and what `invert_twin` made of it.
    settings : EstimationSettings
        The smoother's; the case's own or a variant of them.
    """
    estimate = inversion.estimate
    began = time.perf_counter()
    with threadpool_limits(limits=1):
        smoothed = smooth_profile(
            Glider(case.assumed or case.hull), estimate.series, estimate.shaken, estimate.prior,
            estimate.disturbance_prior, settings,
        )  # fmt: skip
    return SmoothedTwin(smoothed, time.perf_counter() - began)


def coverage(error: Array, deviation: Array, width: float) -> float:
    """Share of the errors ``(n,)`` within `width` of their standard deviations ``(n,)``; NaN for none."""
    return float(np.mean(np.abs(error) <= width * deviation)) if error.size else float("nan")


def mahalanobis(error: Array, covariance: Array) -> float:
    """Length of an error ``(k,)`` in standard deviations; for two components 1.2 is the usual median."""
    return float(np.sqrt(error @ np.linalg.solve(covariance, error)))
