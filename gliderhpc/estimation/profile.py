"""The estimation of a profile: filter, smoother, windows.

`estimate_profile` estimates one profile. `estimate_profiles` estimates many profiles, which share the lanes of filter
and windows; the results are identical bit for bit.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.engines import invert_windows, solve_profiles, typical_starting_cost
from gliderhpc.estimation.filter import FilterEstimate
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.rests import run_filters_around_rests
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.glide_sensitivity import glide_sensitivity
from gliderhpc.estimation.smoother.hull_errors import stated_errors
from gliderhpc.estimation.smoother.information import HullInformation, smoothed_hull_information
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.smoother.posterior import (
    HullContribution,
    posterior_errors,
    with_hull_errors,
    with_record_errors,
)
from gliderhpc.estimation.windows import ProfileProblem, ProfileSolution, StartingPath, misfit, pose_windows
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.observations.series import ProfileSeries

Array = NDArray[np.float64]
Key = TypeVar("Key")

_Smoothing = tuple[SmoothedEstimate | None, HullContribution | None]
"""Smoothed estimate at the records, and the hull's contribution to it; None for what was not computed."""


@dataclass(frozen=True, eq=False)
class ProfileEstimate:
    """The estimate of one profile.

    Attributes
    ----------
    profile : PreparedProfile
        Profile on its steps.
    filtered : FilterEstimate
        Estimate of the filter.
    solution : ProfileSolution
        Solution of the windows.
    smoothed : SmoothedEstimate, optional
        Estimate of the smoother at the records, if there is one.
    hull : HullContribution, optional
        Errors of the hull and their contribution to the smoothed uncertainty, if requested.
    seconds : float
        Computing time, s; the profile's share if several are computed at the same time.
    """

    profile: PreparedProfile
    filtered: FilterEstimate
    solution: ProfileSolution
    smoothed: SmoothedEstimate | None
    seconds: float
    hull: HullContribution | None = None

    @property
    def series(self) -> ProfileSeries:
        """Record on the steps."""
        return self.profile.series

    @property
    def vibrating(self) -> NDArray[np.bool_]:
        """Mask ``(n+1,)`` of the vibration set."""
        return self.profile.vibrating

    @property
    def residuals(self) -> Array:
        """Reconstructed minus measured ``(n+1, 4)``: roll, pitch, heading (degree, wrapped) and depth (m)."""
        residual = misfit(self.solution.states, self.series.measurements)
        residual[:, :3] = np.degrees(residual[:, :3])
        return residual


def estimate_profile(
    profile: PreparedProfile, settings: EstimationSettings, *, with_hull: bool = False
) -> ProfileEstimate:
    """Filter, smooth and invert one profile (sections 4.1 to 4.3).

    Parameters
    ----------
    profile : PreparedProfile
        Profile on its steps (`prepare_profile`).
    settings : EstimationSettings
        Settings of the estimation.
    with_hull : bool
        Whether to return the smoother's estimate including the hull's errors. The smoother runs in any case if the
        windows start from its path.

    Raises
    ------
    ProfileError
        The record cannot be filtered, or the filter rejected more than the allowed share.
    InputError
        The engine cannot run on this machine.
    """
    began = time.perf_counter()
    ((_, profile),), (filtered,) = run_filters_around_rests([(None, profile)], settings)
    if isinstance(filtered, ProfileError):
        raise filtered
    smoothed, start = _smoothed_start(profile, filtered, settings)
    solution = invert_windows(profile, filtered, settings, start)
    on_records, hull = smooth_profile(profile, filtered, settings, smoothed, with_hull=with_hull)
    return ProfileEstimate(profile, filtered, solution, on_records, time.perf_counter() - began, hull)


def _smoothed_start(
    profile: PreparedProfile, filtered: FilterEstimate, settings: EstimationSettings
) -> tuple[SmoothedEstimate | None, StartingPath | None]:
    """Smooth a profile whose windows are to start from the smoothed path; return the estimate and that path.

    The estimate is None if the windows start from the filter's disturbance by the settings; the path is None also if
    the smoothed one is no better start. A slow record's path must agree with its disturbance: neither smoothed in a
    single pass about the filter's path, nor so far from a run of the model that its windows typically begin above their
    threshold. On real gliders whose hull is not known well, windows that started from such paths converged less often,
    or only after they had been shortened.
    """
    if settings.starts_from != "smoothed":
        return None, None
    smoothed = run_smoother(profile, filtered, settings)
    if not smoothed.outcome.usable:
        return smoothed, None
    start = StartingPath(smoothed.disturbances, smoothed.states)
    if profile.is_slow:
        problem = pose_windows(profile, filtered, settings, start)
        if smoothed.passes == 1 or typical_starting_cost(problem, start.states) > problem.plan.cost_threshold:
            return smoothed, None
    return smoothed, start


def smooth_profile(
    profile: PreparedProfile,
    filtered: FilterEstimate,
    settings: EstimationSettings,
    smoothed: SmoothedEstimate | None = None,
    *,
    with_hull: bool = True,
) -> _Smoothing:
    """Smooth one filtered profile.

    Parameters
    ----------
    profile : PreparedProfile
        Profile on its steps.
    filtered : FilterEstimate
        Estimate of the filter.
    settings : EstimationSettings
        Settings of the estimation.
    smoothed : SmoothedEstimate, optional
        Estimate on the steps, if it was computed for the windows; otherwise it is computed if `with_hull` is set.
    with_hull : bool
        Whether to include the hull's errors in its uncertainty.

    Returns
    -------
    SmoothedEstimate or None, HullContribution or None
        Estimate at the records, and the hull's contribution to its uncertainty.
    """
    if smoothed is None and with_hull:
        smoothed = run_smoother(profile, filtered, settings)
    if smoothed is None:
        return None, None
    on_records, last = smoothed.thinned(settings.steps_per_record), smoothed.last_pass
    if last is None or not smoothed.outcome.usable or not with_hull or settings.smoother.hull == "believed":
        return on_records, None
    information = smoothed_hull_information(profile, smoothed, last, settings)
    return (
        _add_errors(profile, on_records, information, settings) if information.has_sensitivities else (on_records, None)
    )


def _add_errors(
    profile: PreparedProfile, on_records: SmoothedEstimate, information: HullInformation, settings: EstimationSettings
) -> _Smoothing:
    """Include the errors of the record and of the hull in an estimate at the records."""
    if information.record is not None:
        on_records = with_record_errors(on_records, information.record)
    errors = stated_errors(profile.glider.platform, information.parameters)
    if information.narrows_errors:
        errors = posterior_errors(errors, information)
    if not information.is_sound:
        information = information.without_information()
    corrected = settings.smoother.hull == "corrected"
    on_records, variance = with_hull_errors(on_records, information, errors, corrected=corrected)
    glide = glide_sensitivity(profile, on_records, information, settings.steps_per_record)
    # Without the sensitivities at the records, which are large: several profiles wait for their windows.
    return on_records, HullContribution(information.without_records(), errors, *variance, glide)


def estimate_profiles(
    profiles: Iterable[tuple[Key, PreparedProfile]],
    settings: EstimationSettings,
    *,
    with_hull: bool = False,
    threads: Executor | None = None,
) -> Iterator[tuple[Key, ProfileEstimate | ProfileError]]:
    """Filter, smooth and invert many profiles as `estimate_profile` does one; yield each with its key when complete.

    Parameters
    ----------
    profiles : iterable of (key, PreparedProfile)
        Profiles, taken only when they are needed: if they come from a generator, only few are in memory.
    settings : EstimationSettings
        Settings for all of them.
    with_hull : bool
        Whether to return the smoother's estimates. They are computed after the windows, or before if these start from
        the smoothed path.
    threads : concurrent.futures.Executor, optional
        Threads in which a profile is smoothed while its windows are solved, if these do not depend on the smoother; by
        default it is smoothed afterwards. For a single profile only, because smoothing takes much memory.

    Yields
    ------
    (key, ProfileEstimate or ProfileError)
        Estimate, or the error with the reason of the refusal; other profiles are not affected.

    Raises
    ------
    InputError
        The engine cannot run on this machine.
    """
    refused: deque[tuple[Key, ProfileError]] = deque()
    posed = _pose_profiles(profiles, _Options(settings, with_hull, threads), refused)
    for work, solution in solve_profiles(posed, settings):
        while refused:
            yield refused.popleft()
        began = time.perf_counter()
        smoothed, hull = work.smoothing()
        seconds = work.seconds + solution.seconds + time.perf_counter() - began
        yield work.key, ProfileEstimate(work.profile, work.filtered, solution, smoothed, seconds, hull)
    yield from refused


class _Options(NamedTuple):
    """Arguments of `estimate_profiles` that are common to all profiles."""

    settings: EstimationSettings
    with_hull: bool
    threads: Executor | None


class _Work(NamedTuple, Generic[Key]):
    """A profile whose windows are being solved, and the function that then returns its smoothed estimate."""

    key: Key
    profile: PreparedProfile
    filtered: FilterEstimate
    smoothing: Callable[[], _Smoothing]
    seconds: float


def _pose_profiles(
    profiles: Iterable[tuple[Key, PreparedProfile]], options: _Options, refused: deque[tuple[Key, ProfileError]]
) -> Iterator[tuple[_Work[Key], ProfileProblem]]:
    """Filter as many profiles at a time as there are lanes, and pose the windows of each when it is taken."""
    waiting = iter(profiles)
    while group := list(islice(waiting, LANES)):
        began = time.perf_counter()
        group, estimates = run_filters_around_rests(group, options.settings)
        share = (time.perf_counter() - began) / len(group)
        # Only waiting profiles are referenced here; those whose windows are solved can thus be freed.
        ready = deque(zip(group, estimates, strict=True))
        group, estimates = [], []
        while ready:
            (key, profile), filtered = ready.popleft()
            if isinstance(filtered, ProfileError):
                refused.append((key, filtered))
                continue
            # A separate function, whose memory, mainly the smoother's, is freed before the next profile is posed.
            yield _pose_profile(key, profile, filtered, options, share)


def _pose_profile(
    key: Key, profile: PreparedProfile, filtered: FilterEstimate, options: _Options, seconds: float
) -> tuple[_Work[Key], ProfileProblem]:
    """Pose the windows of a filtered profile, after smoothing it if they start from that path; add the time."""
    began, settings = time.perf_counter(), options.settings
    smoothed, start = _smoothed_start(profile, filtered, settings)
    problem = pose_windows(profile, filtered, settings, start)
    smoothing: Callable[[], _Smoothing]
    smoothing = partial(smooth_profile, profile, filtered, settings, smoothed, with_hull=options.with_hull)
    if options.threads is not None:
        smoothing = options.threads.submit(smoothing).result
    elif smoothed is not None:
        # At once, since the smoother's last pass is large and several profiles wait for their windows.
        result = smoothing()
        smoothing = lambda: result  # noqa: E731
    return _Work(key, profile, filtered, smoothing, seconds + time.perf_counter() - began), problem
