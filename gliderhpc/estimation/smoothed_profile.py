"""A profile's smoothed estimate as the archive keeps it, and as the windows may start from it."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.profile_smoother import smooth_profile, stand_in
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother import SmoothedEstimate
from gliderhpc.outcomes import Outcome

Array = NDArray[np.float64]

_KNOWN = (ProfileError, ArithmeticError, np.linalg.LinAlgError)
"""What a record may do to the smoother; anything else is a fault of the program."""


@dataclass(frozen=True, eq=False)
class SmoothedRecords:
    """A smoothed profile on its ``m`` records; the steps in between, ten times as much, are not kept.

    Attributes
    ----------
    states, states_std : (m, 12)
        States (eq. 16, SI and rad) at the records and their standard deviations.
    disturbances, disturbances_std : (m', 6)
        Disturbance over the step that starts at each record, and its standard deviation, N and N m; m' is m, or one
        less where the profile ends with a record.
    displacement, displacement_covariance : (2,), (2, 2)
        North and east from start to end, m and m2.
    cost : float
        Of the maximum a posteriori problem; NaN where it could not be solved.
    passes : int
        Linearisations.
    noise_factor : (6,)
        Variance that the steps added in the end, over that of the prior.
    outcome : Outcome
        Where it is not usable, the filter's estimate stands in, without standard deviations.
    trouble : str
        Why it could not even be tried to the end; empty as a rule.
    """

    states: Array
    states_std: Array
    disturbances: Array
    disturbances_std: Array
    displacement: Array
    displacement_covariance: Array
    cost: float
    passes: int
    noise_factor: Array
    outcome: Outcome
    trouble: str = ""


def with_smoothed(prepared: PreparedProfile, settings: EstimationSettings) -> tuple[PreparedProfile, SmoothedRecords]:
    """Smooth a profile that is ready for its windows, and let these start from the result where the settings say so.

    A profile that cannot be smoothed keeps the filter's estimate and the filter's start.
    """
    began = time.perf_counter()
    problem, every = prepared.problem, settings.steps_per_record
    try:
        smoothed = _smooth(prepared, settings)
    except _KNOWN as error:
        records = replace(_thinned(stand_in(prepared.prior), every), trouble=str(error))
    else:
        records = _thinned(smoothed, every)
        if settings.start == "smoothed" and smoothed.outcome.usable:
            problem = replace(problem, start=smoothed.disturbances)
    return replace(prepared, problem=problem, seconds=prepared.seconds + time.perf_counter() - began), records


def _smooth(prepared: PreparedProfile, settings: EstimationSettings) -> SmoothedEstimate:
    return smooth_profile(
        prepared.glider, prepared.series, prepared.shaken, prepared.prior, prepared.disturbance_prior, settings
    )


def _thinned(smoothed: SmoothedEstimate, every: int) -> SmoothedRecords:
    # Copies, not views, so that the steps' arrays are freed.
    states, states_std, disturbances, disturbances_std = (
        values[::every].copy()
        for values in (smoothed.states, smoothed.states_std, smoothed.disturbances, smoothed.disturbances_std)
    )
    return SmoothedRecords(
        states, states_std, disturbances, disturbances_std, smoothed.states[-1, 3:5] - smoothed.states[0, 3:5],
        smoothed.displacement_covariance, smoothed.cost, smoothed.passes, smoothed.noise_factor, smoothed.outcome,
    )  # fmt: skip
