"""Estimators that are compared, one entry each, and their estimates of a twin."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.estimation.profile import smooth_profile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.outcomes import Outcome
from gliderhpc.twins.cases import TwinCase
from gliderhpc.twins.inversion import TwinInversion, invert_twin

Array = NDArray[np.float64]

DEGREES_OF_FREEDOM = 4.0
"""Degrees of freedom of the heavy-tailed smoother's yaw noise (Student's t)."""

_TRACK = slice(3, 5)


@dataclass(frozen=True, eq=False)
class EstimatorResult:
    """Estimate of a twin by one estimator.

    Attributes
    ----------
    disturbances : (n, 6) array
        Estimated disturbances, N and N m.
    displacement : (2,) array
        Displacement through the water over the profile, north and east, m.
    seconds : float
        Computing time from the record on the steps to the estimate, s.
    rounds : float
        Passes of a smoother, median iterations per window of the adjoint; NaN for the filter, which has none.
    converged : float
        Share of the windows, or of the dive, that converged; NaN for the filter.
    outcome : str
        Worst outcome of the windows, or outcome of the dive; empty for the filter.
    deviations : (n, 6) array, optional
        Standard deviations of the disturbances, with the hull's errors where it is not the true one; None if the
        estimator gives none.
    displacement_covariance : (2, 2) array, optional
        Covariance of the displacement, m2; None if the estimator gives none.
    source : (n,) array, optional
        Number of the window whose solution is selected at each step; None if there are no windows.
    """

    disturbances: Array
    displacement: Array
    seconds: float
    rounds: float = float("nan")
    converged: float = float("nan")
    outcome: str = ""
    deviations: Array | None = None
    displacement_covariance: Array | None = None
    source: NDArray[np.int64] | None = None


class TwinCache:
    """One twin and its usual inversion, which is computed on first use."""

    def __init__(self, case: TwinCase) -> None:
        self.case = case

    @cached_property
    def usual(self) -> TwinInversion:
        """Inversion with the case's settings, except that the adjoint always starts from the filter."""
        return self.invert(start="prior")

    @property
    def filter_seconds(self) -> float:
        """Computing time of the filter, s."""
        return self.usual.estimate.seconds - self.usual.estimate.solution.seconds

    def invert(self, **changes: Any) -> TwinInversion:
        """Invert the twin with changed settings."""
        return invert_twin(replace(self.case, settings=self.settings(**changes)))

    def settings(self, **changes: Any) -> EstimationSettings:
        """Return the case's settings with some replaced, after validation."""
        return EstimationSettings.model_validate({**self.case.settings.model_dump(), **changes})


@dataclass(frozen=True)
class Estimator:
    """One estimator: its name in files, its label in text, and its estimate of a twin."""

    name: str
    label: str
    estimate: Callable[[TwinCache], EstimatorResult]


def _filter(twin: TwinCache) -> EstimatorResult:
    filtered = twin.usual.estimate.filtered
    return EstimatorResult(filtered.disturbances[:-1], _displacement(filtered.states), twin.filter_seconds)


def _smoother(twin: TwinCache) -> EstimatorResult:
    return _smooth(twin, twin.case.settings)


def _heavy_tailed(twin: TwinCache) -> EstimatorResult:
    smoother = twin.case.settings.smoother.model_dump() | {"degrees_of_freedom": DEGREES_OF_FREEDOM}
    return _smooth(twin, twin.settings(smoother=smoother))


def _smooth(twin: TwinCache, settings: EstimationSettings) -> EstimatorResult:
    estimate = twin.usual.estimate
    began = time.perf_counter()
    with threadpool_limits(limits=1):
        smoothed = run_smoother(estimate.profile, estimate.filtered, settings)
        seconds = twin.filter_seconds + time.perf_counter() - began
        uncertainty = _uncertainty(twin, settings, smoothed) if smoothed.outcome.usable else (None, None)
    return EstimatorResult(
        smoothed.disturbances,
        _displacement(smoothed.states),
        seconds,
        smoothed.passes,
        float(smoothed.outcome is Outcome.CONVERGED),
        smoothed.outcome.name,
        *uncertainty,
    )


def _uncertainty(twin: TwinCache, settings: EstimationSettings, smoothed: SmoothedEstimate) -> tuple[Array, Array]:
    """Deviations ``(n, 6)`` of the disturbances and covariance ``(2, 2)`` of the displacement.

    Where the estimator assumes another hull than the true one, they include the errors that the platform file states,
    as those of a run do.
    """
    deviations, covariance = smoothed.disturbances_std, smoothed.displacement_covariance
    if twin.case.assumes_true_hull:
        return deviations, covariance
    estimate, every = twin.usual.estimate, settings.steps_per_record
    with_hull, _ = smooth_profile(estimate.profile, estimate.filtered, settings, smoothed)
    assert with_hull is not None
    of_hull = with_hull.disturbances_std**2 - deviations[::every] ** 2
    steps = np.arange(len(deviations))
    columns = [np.interp(steps, every * np.arange(len(of_hull)), column) for column in of_hull.T]
    return np.sqrt(deviations**2 + np.column_stack(columns)), with_hull.displacement_covariance


def _adjoint_from_prior(twin: TwinCache) -> EstimatorResult:
    return _adjoint(twin.usual)


def _adjoint_from_smoothed(twin: TwinCache) -> EstimatorResult:
    return _adjoint(twin.invert(start="smoothed"))


def _paper(twin: TwinCache) -> EstimatorResult:
    return _adjoint(twin.invert(preset="paper"))


def _adjoint(inversion: TwinInversion) -> EstimatorResult:
    estimate, solution = inversion.estimate, inversion.estimate.solution
    outcomes = [window.outcome for window in solution.windows]
    return EstimatorResult(
        solution.disturbances,
        _displacement(solution.states),
        estimate.seconds,
        float(np.median([window.iterations for window in solution.windows])),
        float(np.mean([outcome is Outcome.CONVERGED for outcome in outcomes])),
        max(outcomes).name,
        source=solution.source,
    )


def _displacement(states: Array) -> Array:
    return np.asarray(states[-1, _TRACK] - states[0, _TRACK])


FILTER = Estimator("filter", "filter", _filter)
SMOOTHER = Estimator("smoother", "smoother", _smoother)
HEAVY_TAILED = Estimator("heavy_tailed", "heavy-tailed smoother", _heavy_tailed)
ADJOINT = Estimator("adjoint", "adjoint from prior", _adjoint_from_prior)
ADJOINT_FROM_SMOOTHED = Estimator("adjoint_smoothed", "adjoint from smoothed", _adjoint_from_smoothed)
PAPER = Estimator("paper", "adjoint, preset paper", _paper)

ESTIMATORS = (FILTER, SMOOTHER, HEAVY_TAILED, ADJOINT, ADJOINT_FROM_SMOOTHED, PAPER)
"""Every estimator, in the order of the tables."""

LABELS = {estimator.name: estimator.label for estimator in ESTIMATORS}
