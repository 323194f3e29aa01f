"""A smoothed twin beside its truth: how far off, and whether its intervals hold what they promise."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.analysis.scores import correlation, rms
from gliderhpc.analysis.twin.inversion import TwinCase, TwinInversion, invert_twin
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import SmoothedEstimate, smooth_profile
from gliderhpc.flight.glider import Glider
from gliderhpc.store_schema.schema import CHANNELS

Array = NDArray[np.float64]
Row = dict[str, float | int | str]

INTERVALS = {"68": 0.9944578832097532, "95": 1.959963984540054}
"""Half widths, in standard deviations, of the intervals whose coverage is counted: 68 % and 95 %."""


@dataclass(frozen=True, eq=False)
class SmoothedTwin:
    """A twin, inverted and smoothed.

    Attributes
    ----------
    inversion : TwinInversion
        The pipeline's estimate beside the truth.
    smoothed : SmoothedEstimate
        The smoother's, from the same filter's.
    seconds : float
        What the smoother took, s.
    """

    inversion: TwinInversion
    smoothed: SmoothedEstimate
    seconds: float

    @property
    def error(self) -> Array:
        """Smoothed minus true disturbance ``(n, 6)``, N and N m."""
        return np.asarray(self.smoothed.disturbances - self.inversion.truth)


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
    return SmoothedTwin(inversion, smoothed, time.perf_counter() - began)


def smoothing_scores(twin: SmoothedTwin) -> Row:
    """Score the smoother over steady glide.

    Returns
    -------
    dict
        ``smoothed_rmse_B_cu`` ..., ``smoothed_bias_...`` (mean error), ``smoothed_correlation_...``,
        ``smoothed_width_...`` (mean standard deviation), ``coverage_68_B_cu`` ..., ``coverage_95_...`` (share of the
        steps whose interval holds the truth), ``prior_rmse_...`` (the filter's); ``displacement_error`` over its
        standard deviation as ``displacement_deviations`` (of two, so 1.2 is usual); ``passes``, ``damped``,
        ``outcome``, ``smoother_seconds``.
    """
    inversion, smoothed, steady = twin.inversion, twin.smoothed, twin.inversion.steady
    error, deviation = twin.error[steady], smoothed.disturbances_std[steady]
    true, filtered = inversion.truth[steady], inversion.estimate.prior.disturbances[:-1][steady]
    row: Row = {}
    for i, name in enumerate(CHANNELS):
        row[f"smoothed_rmse_{name}"] = rms(error[:, i])
        row[f"smoothed_bias_{name}"] = float(error[:, i].mean())
        row[f"smoothed_correlation_{name}"] = correlation(smoothed.disturbances[steady, i], true[:, i])
        row[f"smoothed_width_{name}"] = float(deviation[:, i].mean())
        for label, width in INTERVALS.items():
            row[f"coverage_{label}_{name}"] = float(np.mean(np.abs(error[:, i]) <= width * deviation[:, i]))
        row[f"prior_rmse_{name}"] = rms(filtered[:, i] - true[:, i])
    return row | _displacement(twin) | {
        "passes": smoothed.passes,
        "damped": smoothed.damped,
        "outcome": smoothed.outcome.name,
        "smoother_seconds": twin.seconds,
    }  # fmt: skip


def _displacement(twin: SmoothedTwin) -> Row:
    states, true = twin.smoothed.states, twin.inversion.states
    wrong = (states[-1, 3:5] - states[0, 3:5]) - (true[-1, 3:5] - true[0, 3:5])
    covariance = twin.smoothed.displacement_covariance
    return {
        "displacement_error": float(np.linalg.norm(wrong)),
        "displacement_deviations": float(np.sqrt(wrong @ np.linalg.solve(covariance, wrong))),
    }


def smoothed_row(case: TwinCase) -> Row:
    """Invert and smooth one twin: the smoother's scores, and the RMSE of the adjoint with the case's preset.

    Raises
    ------
    ProfileError
        The pipeline refuses the record.
    """
    inversion = invert_twin(case)
    row: Row = {"seed": case.seed, "preset": case.settings.preset, "adjoint_seconds": inversion.seconds}
    for i, name in enumerate(CHANNELS):
        row[f"adjoint_rmse_{name}"] = rms(inversion.error[inversion.steady, i])
    return row | smoothing_scores(smooth_twin(case, inversion, case.settings))
