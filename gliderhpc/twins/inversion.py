"""One twin: flown, recorded, changed, inverted by the users' own pipeline, and laid beside its truth."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gliderhpc.archive.profile import SETTLING
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.preparation import ProfileTask, on_steps
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.averages import averages_between
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.simulator import ProfileTruth, Scenario, simulate_profile
from gliderhpc.twins.changes import RecordChanges

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Refused = ProfileError | InputError
"""Why there is no inversion of a twin."""

_CHANGES_STREAM = 1_000
"""Key of the random numbers that the record's changes draw, apart from all that the simulator draws."""


@dataclass(frozen=True)
class TwinCase:
    """A twin and how it is inverted; hashable and picklable, and all that the result depends on.

    Attributes
    ----------
    hull : Platform
        What flies.
    scenario : Scenario
        What happens to it.
    seed, number : int
        Of the random numbers; the number also picks the course that is steered.
    settings : EstimationSettings
        Of the inversion.
    assumed : Platform, optional
        The hull that the estimator believes in; the true one where None.
    changes : RecordChanges
        Of the record.
    initial_error : tuple of 12 floats, optional
        Added to the estimator's first guess of the state (eq. 16, SI).
    """

    hull: Platform
    scenario: Scenario
    seed: int
    settings: EstimationSettings
    number: int = 1
    assumed: Platform | None = None
    changes: RecordChanges = field(default_factory=RecordChanges)
    initial_error: tuple[float, ...] | None = None


@dataclass(frozen=True, eq=False)
class TwinInversion:
    """An inverted twin beside its truth.

    Attributes
    ----------
    estimate : ProfileEstimate
        What the pipeline gives, on ``n`` steps.
    record : ProfileRecord
        What it was given.
    profile_truth : ProfileTruth
        What the simulator knew.
    truth : (n, 6) array
        True disturbance averaged over the estimator's steps, N and N m.
    states : (n + 1, 12) array
        True states at the grid points (eq. 16, SI).
    steady : (n,) mask
        Outside vibration and gaps, settled, and inside the truth.
    diving : (n,) mask
        Before the deepest point.
    seconds : float
        What the inversion took, s.
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
        """Of the estimator, s."""
        return self.estimate.series.step

    @property
    def error(self) -> Array:
        """Identified minus true disturbance ``(n, 6)``, N and N m."""
        return np.asarray(self.estimate.solution.disturbances - self.truth)


def invert_twin(case: TwinCase) -> TwinInversion:
    """Fly, record, change and invert one twin.

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
    """Fly, record and change twins of the same settings and invert them side by side, as a mission's profiles are.

    Returns
    -------
    list
        Each in its place, or why it could not be flown (`InputError`) or inverted (`ProfileError`).
    """
    twins = [_ready(case) for case in cases]
    began = time.perf_counter()
    tasks = [(index, twin.task) for index, twin in enumerate(twins) if not isinstance(twin, Exception)]
    # Threads of linear algebra on vectors this short cost far more than they gain.
    with threadpool_limits(limits=1):
        estimates = dict(estimate_profiles(tasks, cases[0].settings))
    seconds = (time.perf_counter() - began) / len(cases)
    return [
        twin if isinstance(twin, Exception) else _inverted(twin, estimates[index], seconds)
        for index, twin in enumerate(twins)
    ]


@dataclass(frozen=True, eq=False)
class _Ready:
    """A twin that was flown, and what is to be estimated of it."""

    record: ProfileRecord
    truth: ProfileTruth
    task: ProfileTask


def _ready(case: TwinCase) -> _Ready | Refused:
    try:
        record, truth = _flown(case.hull, case.scenario, case.seed, case.number)
        record = case.changes.applied(record, np.random.default_rng([case.seed, case.number, _CHANGES_STREAM]))
        initial_error = None if case.initial_error is None else np.array(case.initial_error)
        task = ProfileTask(Glider(case.assumed or case.hull), on_steps(record, case.settings), initial_error)
    except (ProfileError, InputError) as error:
        return error
    return _Ready(record, truth, task)


def _inverted(twin: _Ready, estimate: ProfileEstimate | ProfileError, seconds: float) -> TwinInversion | ProfileError:
    if isinstance(estimate, ProfileError):
        return estimate
    return _beside_truth(estimate, twin.record, twin.truth, seconds)


@lru_cache(maxsize=4)
def _flown(hull: Platform, scenario: Scenario, seed: int, number: int) -> tuple[ProfileRecord, ProfileTruth]:
    """Simulate a twin, or take it from the few last ones: a sweep inverts the same twin many times."""
    return simulate_profile(hull, scenario, seed, number=number)


def _beside_truth(
    estimate: ProfileEstimate, record: ProfileRecord, truth: ProfileTruth, seconds: float
) -> TwinInversion:
    series = estimate.series
    states = np.column_stack([np.interp(series.time, truth.time, column) for column in truth.states.T])
    measured = series.weights > 0.0
    steady = ~estimate.shaken[:-1] & measured[:-1] & measured[1:] & (series.time[:-1] >= SETTLING)
    steady &= series.time[1:] <= len(truth.disturbances) * truth.step + 1e-6
    diving = np.arange(len(steady)) < int(np.argmax(states[:, 5]))
    own = np.arange(len(truth.disturbances) + 1, dtype=np.float64) * truth.step
    true = averages_between(truth.disturbances, own, series.time)
    return TwinInversion(estimate, record, truth, true, states, steady, diving, seconds)
