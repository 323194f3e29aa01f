"""Profiles, from their records to their disturbances, by either engine."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.lanes_engine import solve_dives
from gliderhpc.estimation.preparation import PreparedProfile, ProfileTask, prepare_profiles
from gliderhpc.estimation.scipy_engine import solve_window
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.windows import DiveProblem, DiveSolution, WindowPlan, solve_dive
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.observations.resample import ProfileSeries

Array = NDArray[np.float64]
Key = TypeVar("Key")
Keyed = tuple[Key, "ProfileEstimate | ProfileError"]


@dataclass(frozen=True, eq=False)
class ProfileEstimate:
    """The estimate of one profile.

    Attributes
    ----------
    series : ProfileSeries
        The record on the steps.
    shaken : (n+1,) array of bool
        The vibration set.
    prior : FilterEstimate
        The filter's estimate.
    solution : DiveSolution
        The windows'.
    disturbance_prior : str
        Name of the disturbance prior that stands, of `DISTURBANCE_PRIOR`: ``usual``, or ``rough_water`` where that one
        could not follow the record.
    seconds : float
        Computing time, the profile's share of it where several are computed side by side.
    """

    series: ProfileSeries
    shaken: NDArray[np.bool_]
    prior: FilterEstimate
    solution: DiveSolution
    disturbance_prior: str
    seconds: float

    @property
    def residuals(self) -> Array:
        """Reconstructed minus measured ``(n+1, 4)``: roll, pitch, heading (degree, wrapped) and depth (m)."""
        residual = self.solution.states[:, [0, 1, 2, 5]] - self.series.measurements
        residual[:, 2] = np.arctan2(np.sin(residual[:, 2]), np.cos(residual[:, 2]))
        residual[:, :3] = np.degrees(residual[:, :3])
        return residual


def estimate_profile(
    glider: Glider, series: ProfileSeries, settings: EstimationSettings, *, initial_error: Array | None = None
) -> ProfileEstimate:
    """Filter, then invert, one profile (sections 4.1 to 4.3).

    Parameters
    ----------
    glider, series, settings : Glider, ProfileSeries, EstimationSettings
        The hull, the record on the steps, and how.
    initial_error : (12,) array, optional
        Added to the first guess of the state (eq. 16, SI): for the study of what that guess matters.

    Raises
    ------
    ProfileError
        When the record cannot be filtered, or the filter rejected more than the allowed share of it.
    """
    task = ProfileTask(glider, series, initial_error)
    ((_, estimate),) = estimate_profiles([(None, task)], settings)
    if isinstance(estimate, ProfileError):
        raise estimate
    return estimate


def estimate_profiles(tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings) -> Iterator[Keyed[Key]]:
    """Estimate profiles by the engine of the settings; each comes with its key as it is done, or with its error.

    Parameters
    ----------
    tasks : iterable of (key, ProfileTask)
        Taken as they are needed, so that a generator that reads records keeps few of them in memory.
    settings : EstimationSettings
        For all of them.
    """
    return _ENGINES[settings.engine](tasks, settings)


def _one_by_one(tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings) -> Iterator[Keyed[Key]]:
    for key, prepared in _prepared(tasks, settings):
        if isinstance(prepared, ProfileError):
            yield key, prepared
        else:
            solution = solve_dive(prepared.problem, prepared.plan, partial(solve_window, settings=settings))
            yield key, _estimate(prepared, solution)


def _side_by_side(tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings) -> Iterator[Keyed[Key]]:
    under_way: dict[int, tuple[Key, PreparedProfile]] = {}
    refused: deque[Keyed[Key]] = deque()

    def dives() -> Iterator[tuple[int, DiveProblem, WindowPlan]]:
        for number, (key, prepared) in enumerate(_prepared(tasks, settings)):
            if isinstance(prepared, ProfileError):
                refused.append((key, prepared))
            else:
                under_way[number] = key, prepared
                yield number, prepared.problem, prepared.plan

    for number, solution in solve_dives(dives(), settings):
        while refused:
            yield refused.popleft()
        key, prepared = under_way.pop(number)
        yield key, _estimate(prepared, solution)
    yield from refused


def _prepared(
    tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings
) -> Iterator[tuple[Key, PreparedProfile | ProfileError]]:
    """Filter profiles as many at a time as there are lanes, when the last ones have been taken."""
    waiting = iter(tasks)
    while group := list(islice(waiting, LANES)):
        yield from zip((key for key, _ in group), prepare_profiles([task for _, task in group], settings), strict=True)


def _estimate(prepared: PreparedProfile, solution: DiveSolution) -> ProfileEstimate:
    return ProfileEstimate(
        prepared.series, prepared.shaken, prepared.prior, solution, prepared.disturbance_prior,
        prepared.seconds + solution.seconds,
    )  # fmt: skip


_ENGINES: dict[str, Callable[..., Iterator[Keyed[Any]]]] = {"lanes": _side_by_side, "scipy": _one_by_one}
