"""Simulation and inversion of twins with the users' own pipeline, with their truth on the estimator's steps."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.profile import SETTLING
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.resample import on_steps
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import averages_between
from gliderhpc.platform import Platform
from gliderhpc.simulator import ProfileTruth, Scenario, simulate_profile
from gliderhpc.twins.cases import TwinCase

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Refused = ProfileError | InputError
"""Reason why a twin has no inversion."""

_CHANGES_STREAM = 1_000
"""Key of the random numbers for the record's changes, which are independent of the simulator's."""


@dataclass(frozen=True, eq=False)
class TwinInversion:
    """An inverted twin and its truth.

    Attributes
    ----------
    estimate : ProfileEstimate
        Result of the pipeline, on ``n`` steps.
    record : ProfileRecord
        Record that was inverted.
    profile_truth : ProfileTruth
        Truth from the simulator.
    truth : (n, 6) array
        True disturbance averaged over the estimator's steps, N and N m.
    states : (n + 1, 12) array
        True states at the grid points (eq. 16, SI).
    steady : (n,) mask
        Steps outside vibration and gaps, settled, and within the time of the truth.
    diving : (n,) mask
        Steps before the deepest point.
    seconds : float
        Computing time of the inversion, s.
    """

    estimate: ProfileEstimate
    record: ProfileRecord
    profile_truth: ProfileTruth
    truth: Array
    states: Array
    steady: Mask
    diving: Mask
    seconds: float

    @property
    def step(self) -> float:
        """Time step of the estimator, s."""
        return self.estimate.series.step

    @property
    def error(self) -> Array:
        """Identified minus true disturbance ``(n, 6)``, N and N m."""
        return np.asarray(self.estimate.solution.disturbances - self.truth)

    @property
    def phases(self) -> dict[str, Mask]:
        """Steady steps ``(n,)`` of dive and climb."""
        return {"dive": self.steady & self.diving, "climb": self.steady & ~self.diving}


def invert_twin(case: TwinCase) -> TwinInversion:
    """Simulate, change and invert one twin.

    Raises
    ------
    ProfileError
        The pipeline refuses the record.
    InputError
        The hull cannot fly the scenario.
    """
    (inversion,) = invert_twins([case])
    if isinstance(inversion, Exception):
        raise inversion
    return inversion


def invert_twins(cases: Sequence[TwinCase]) -> list[TwinInversion | Refused]:
    """Simulate and change twins with the same settings, and invert them in parallel lanes like a mission's profiles.

    Returns
    -------
    list
        Inversions in the order of the cases; instead of an inversion, the reason why the twin could not be simulated
        (`InputError`) or inverted (`ProfileError`).
    """
    twins = [_simulate(case) for case in cases]
    began = time.perf_counter()
    tasks = [(index, twin[2]) for index, twin in enumerate(twins) if not isinstance(twin, Exception)]
    # Threads of linear algebra cost far more than they gain on such short vectors.
    with threadpool_limits(limits=1):
        estimates = dict(estimate_profiles(tasks, cases[0].settings))
    seconds = (time.perf_counter() - began) / len(cases)
    return [
        twin if isinstance(twin, Exception) else _with_truth(*twin[:2], estimates[index], seconds)
        for index, twin in enumerate(twins)
    ]


def _simulate(case: TwinCase) -> tuple[ProfileRecord, ProfileTruth, PreparedProfile] | Refused:
    """Return the record of a twin, its truth, and the record prepared for inversion."""
    try:
        record, truth = _cached_profile(case.recorded_hull, case.scenario, case.seed, case.number)
        record = case.changes.apply(record, np.random.default_rng([case.seed, case.number, _CHANGES_STREAM]))
        initial_error = None if case.initial_error is None else np.array(case.initial_error)
        assumed = case.assumed or case.hull
        task = prepare_profile(Glider(assumed), on_steps(record, case.settings, assumed), initial_error)
    except (ProfileError, InputError) as error:
        return error
    return record, truth, task


@lru_cache(maxsize=4)
def _cached_profile(hull: Platform, scenario: Scenario, seed: int, number: int) -> tuple[ProfileRecord, ProfileTruth]:
    """Simulate a twin; the last few are cached, because a sweep inverts the same twin many times."""
    return simulate_profile(hull, scenario, seed, number=number)


def _with_truth(
    record: ProfileRecord, truth: ProfileTruth, estimate: ProfileEstimate | ProfileError, seconds: float
) -> TwinInversion | ProfileError:
    if isinstance(estimate, ProfileError):
        return estimate
    series = estimate.series
    states = np.column_stack([np.interp(series.time, truth.time, column) for column in truth.states.T])
    measured = series.weights > 0.0
    steady = ~estimate.vibrating[:-1] & measured[:-1] & measured[1:] & (series.time[:-1] >= SETTLING)
    steady &= series.time[1:] <= len(truth.disturbances) * truth.step + 1e-6
    diving = np.arange(len(steady)) < int(np.argmax(states[:, 5]))
    truth_time = np.arange(len(truth.disturbances) + 1, dtype=np.float64) * truth.step
    disturbances = averages_between(truth.disturbances, truth_time, series.time)
    return TwinInversion(estimate, record, truth, disturbances, states, steady, diving, seconds)
