"""Profiles, from their records to their disturbances, by any engine."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.engines import FortranRun, Run, fortran_library, solve_dives, solve_window
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile, ProfileTask, prepare_profiles
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.profile import SmoothedRecords, with_smoothed
from gliderhpc.estimation.windows import DiveProblem, DiveSolution, WindowPlan, solve_dive
from gliderhpc.flight.glider import Glider
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.kernels.quasi_newton import run_until_done
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
    vibrating : (n+1,) array of bool
        The vibration set.
    prior : FilterEstimate
        The filter's estimate.
    solution : DiveSolution
        The windows'.
    disturbance_prior : str
        Name of the disturbance prior used, of `DISTURBANCE_PRIOR`: ``usual``, or ``rough_water`` where that one
        could not follow the record.
    seconds : float
        Computing time, the profile's share of it where several are computed side by side.
    smoothed : SmoothedRecords, optional
        The smoother's, where it was asked for.
    """

    series: ProfileSeries
    vibrating: NDArray[np.bool_]
    prior: FilterEstimate
    solution: DiveSolution
    disturbance_prior: str
    seconds: float
    smoothed: SmoothedRecords | None = None

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


def estimate_profiles(
    tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings, *, smooth: bool = False
) -> Iterator[Keyed[Key]]:
    """Estimate profiles by the engine of the settings; each comes with its key as it is done, or with its error.

    Parameters
    ----------
    tasks : iterable of (key, ProfileTask)
        Taken as they are needed, so that a generator that reads records keeps few of them in memory.
    settings : EstimationSettings
        For all of them.
    smooth : bool
        Smooth every profile too, each when its windows are solved, so that profiles whose windows end together are done
        one after the other. Where the windows start from the smoothed disturbance they are smoothed in any case, and
        first.

    Raises
    ------
    InputError
        The engine cannot run here.
    """
    before = settings.start == "smoothed"
    ready = _ready(tasks, settings, smooth=before)
    return _finished(_ENGINES[settings.engine](ready, settings), settings, smooth=smooth and not before)


def check_engine(settings: EstimationSettings) -> None:
    """Refuse, before anything is done, an engine that cannot run here.

    Raises
    ------
    InputError
        The Fortran kernels are not built here.
    """
    if settings.engine == "fortran":
        fortran_library()


Ready = tuple[Key, "PreparedProfile | ProfileError", "SmoothedRecords | None"]


@dataclass(frozen=True, eq=False)
class _Solved:
    """A profile whose windows are solved; `smoothed` where that came before them."""

    prepared: PreparedProfile
    smoothed: SmoothedRecords | None
    solution: DiveSolution


KeyedSolution = tuple[Key, "_Solved | ProfileError"]


def _finished(
    profiles: Iterable[KeyedSolution[Key]], settings: EstimationSettings, *, smooth: bool
) -> Iterator[Keyed[Key]]:
    """Smooth profiles one by one, as their windows end: a smoother's memory is there once, whatever the lanes."""
    for key, solved in profiles:
        if isinstance(solved, ProfileError):
            yield key, solved
        elif smooth:
            yield key, _estimate(_Solved(*with_smoothed(solved.prepared, settings), solved.solution))
        else:
            yield key, _estimate(solved)


def _one_by_one(profiles: Iterable[Ready[Key]], settings: EstimationSettings) -> Iterator[KeyedSolution[Key]]:
    for key, prepared, smoothed in profiles:
        if isinstance(prepared, ProfileError):
            yield key, prepared
        else:
            solution = solve_dive(prepared.problem, prepared.plan, partial(solve_window, settings=settings))
            yield key, _Solved(prepared, smoothed, solution)


def _by_fortran(profiles: Iterable[Ready[Key]], settings: EstimationSettings) -> Iterator[KeyedSolution[Key]]:
    return _side_by_side(profiles, settings, FortranRun())


def _side_by_side(
    profiles: Iterable[Ready[Key]], settings: EstimationSettings, run: Run = run_until_done
) -> Iterator[KeyedSolution[Key]]:
    under_way: dict[int, tuple[Key, PreparedProfile, SmoothedRecords | None]] = {}
    refused: deque[KeyedSolution[Key]] = deque()

    def dives() -> Iterator[tuple[int, DiveProblem, WindowPlan]]:
        for number, (key, prepared, smoothed) in enumerate(profiles):
            if isinstance(prepared, ProfileError):
                refused.append((key, prepared))
            else:
                under_way[number] = key, prepared, smoothed
                yield number, prepared.problem, prepared.plan

    for number, solution in solve_dives(dives(), settings, run):
        while refused:
            yield refused.popleft()
        key, prepared, smoothed = under_way.pop(number)
        yield key, _Solved(prepared, smoothed, solution)
    yield from refused


def _ready(
    tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings, smooth: bool
) -> Iterator[Ready[Key]]:
    """Filter profiles; with `smooth`, smooth them one by one as they are taken, before their windows."""
    for key, prepared in _prepared(tasks, settings):
        if isinstance(prepared, ProfileError) or not smooth:
            yield key, prepared, None
        else:
            yield key, *with_smoothed(prepared, settings)


def _prepared(
    tasks: Iterable[tuple[Key, ProfileTask]], settings: EstimationSettings
) -> Iterator[tuple[Key, PreparedProfile | ProfileError]]:
    """Filter profiles as many at a time as there are lanes, when the last ones have been taken."""
    waiting = iter(tasks)
    while group := list(islice(waiting, LANES)):
        yield from zip((key for key, _ in group), prepare_profiles([task for _, task in group], settings), strict=True)


def _estimate(solved: _Solved) -> ProfileEstimate:
    prepared, solution = solved.prepared, solved.solution
    return ProfileEstimate(
        prepared.series, prepared.vibrating, prepared.prior, solution, prepared.disturbance_prior,
        prepared.seconds + solution.seconds, solved.smoothed,
    )  # fmt: skip


_ENGINES: dict[str, Callable[..., Iterator[KeyedSolution[Any]]]] = {
    "lanes": _side_by_side,
    "scipy": _one_by_one,
    "fortran": _by_fortran,
}
