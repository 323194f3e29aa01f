"""The estimators that are compared, one entry each, and what each makes of a twin."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.outcomes import Outcome
from gliderhpc.twins.inversion import TwinCase, TwinInversion, invert_twin
from gliderhpc.twins.smoothing import smooth_twin

Array = NDArray[np.float64]

HEAVY_TAILS = 4.0
"""Degrees of freedom of the heavy-tailed smoother's yaw noise."""

_TRACK = slice(3, 5)


@dataclass(frozen=True, eq=False)
class Answer:
    """What one estimator makes of a twin.

    Attributes
    ----------
    disturbances : (n, 6) array
        N and N m.
    displacement : (2,) array
        North and east through the water over the profile, m.
    seconds : float
        From the record on the steps to this, s.
    rounds : float
        Passes of a smoother, median iterations a window of the adjoint; NaN for the filter, which has none.
    converged : float
        Share of the windows, or of the dive, that converged; NaN for the filter.
    outcome : str
        The worst of them.
    deviations : (n, 6) array, optional
        Standard deviations of the disturbances; None where the estimator gives none.
    displacement_covariance : (2, 2) array, optional
        m2; None likewise.
    source : (n,) array, optional
        Number of the window whose solution stands at each step; None where there are no windows.
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


class Bench:
    """One twin and its inversions, each made when the first estimator asks for it."""

    def __init__(self, case: TwinCase) -> None:
        self.case = case

    @cached_property
    def usual(self) -> TwinInversion:
        """By the case's own settings: filter, and adjoint started from it."""
        return invert_twin(self.case)

    def inverted(self, **changes: Any) -> TwinInversion:
        """By other settings."""
        return invert_twin(replace(self.case, settings=self.settings(**changes)))

    def settings(self, **changes: Any) -> EstimationSettings:
        """Give the case's settings with some replaced, validated anew."""
        return EstimationSettings.model_validate({**self.case.settings.model_dump(), **changes})


@dataclass(frozen=True)
class Arm:
    """One estimator: its name in files and for people, and how it answers."""

    name: str
    label: str
    answer: Callable[[Bench], Answer]


def _filter(bench: Bench) -> Answer:
    prior = bench.usual.estimate.prior
    return Answer(prior.disturbances[:-1], _displacement(prior.states), _filter_seconds(bench))


def _filter_seconds(bench: Bench) -> float:
    estimate = bench.usual.estimate
    return estimate.seconds - estimate.solution.seconds


def _smoother(bench: Bench) -> Answer:
    return _smoothed(bench, bench.case.settings)


def _heavy_tailed(bench: Bench) -> Answer:
    smoother = bench.case.settings.smoother.model_dump() | {"degrees_of_freedom": HEAVY_TAILS}
    return _smoothed(bench, bench.settings(smoother=smoother))


def _smoothed(bench: Bench, settings: EstimationSettings) -> Answer:
    twin = smooth_twin(bench.case, bench.usual, settings)
    smoothed, known = twin.smoothed, twin.smoothed.outcome.usable
    return Answer(
        smoothed.disturbances, _displacement(smoothed.states), _filter_seconds(bench) + twin.seconds, smoothed.passes,
        float(smoothed.outcome is Outcome.CONVERGED), smoothed.outcome.name,
        smoothed.disturbances_std if known else None, smoothed.displacement_covariance if known else None,
    )  # fmt: skip


def _from_prior(bench: Bench) -> Answer:
    return _adjoint(bench.usual)


def _from_smoothed(bench: Bench) -> Answer:
    return _adjoint(bench.inverted(start="smoothed"))


def _paper(bench: Bench) -> Answer:
    return _adjoint(bench.inverted(preset="paper"))


def _adjoint(inversion: TwinInversion) -> Answer:
    estimate, solution = inversion.estimate, inversion.estimate.solution
    outcomes = [window.outcome for window in solution.windows]
    return Answer(
        solution.disturbances, _displacement(solution.states), estimate.seconds,
        float(np.median([window.iterations for window in solution.windows])),
        float(np.mean([outcome is Outcome.CONVERGED for outcome in outcomes])), max(outcomes).name,
        source=solution.source,
    )  # fmt: skip


def _displacement(states: Array) -> Array:
    return np.asarray(states[-1, _TRACK] - states[0, _TRACK])


FILTER = Arm("filter", "filter", _filter)
SMOOTHER = Arm("smoother", "smoother", _smoother)
HEAVY_TAILED = Arm("heavy_tailed", "heavy-tailed smoother", _heavy_tailed)
ADJOINT = Arm("adjoint", "adjoint from prior", _from_prior)
RESTARTED = Arm("adjoint_smoothed", "adjoint from smoothed", _from_smoothed)
PAPER = Arm("paper", "adjoint, preset paper", _paper)

ARMS = (FILTER, SMOOTHER, HEAVY_TAILED, ADJOINT, RESTARTED, PAPER)
"""Every estimator, in the order of the tables."""
