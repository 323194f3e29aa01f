"""The estimation of a profile: filter, smoother, windows.

`estimate_profile` treats one profile from beginning to end. `estimate_profiles` does the same for many profiles, which
share the lanes of filter and windows; the results are identical bit for bit.
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
from gliderhpc.estimation.engines import invert_windows, solve_dives
from gliderhpc.estimation.filter import FilterEstimate, run_filter, run_filters
from gliderhpc.estimation.preparation import PreparedProfile
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.glide_sensitivity import glide_sensitivity
from gliderhpc.estimation.smoother.hull_errors import stated_errors
from gliderhpc.estimation.smoother.information import smoothed_dive_information
from gliderhpc.estimation.smoother.iterate import smooth_dive
from gliderhpc.estimation.smoother.posterior import HullPart, after_dive, with_hull_errors, with_record_errors
from gliderhpc.estimation.windows import DiveProblem, DiveSolution, StartingPath, misfit, pose_windows
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.observations.series import ProfileSeries

Array = NDArray[np.float64]
Key = TypeVar("Key")

_Smoothing = tuple[SmoothedEstimate | None, HullPart | None]
"""Smoothed estimate at the records and its information on the hull, as far as there are any."""


@dataclass(frozen=True, eq=False)
class ProfileEstimate:
    """The estimate of one profile.

    Attributes
    ----------
    profile : PreparedProfile
        Profile on its steps.
    filtered : FilterEstimate
        Estimate of the filter.
    solution : DiveSolution
        Solution of the windows.
    smoothed : SmoothedEstimate, optional
        Estimate of the smoother at the records, if there is one.
    hull : HullPart, optional
        Information on the hull, and its part in the smoothed uncertainty, if requested with the smoother's estimate.
    seconds : float
        Computing time; the profile's share if several are computed side by side.
    """

    profile: PreparedProfile
    filtered: FilterEstimate
    solution: DiveSolution
    smoothed: SmoothedEstimate | None
    seconds: float
    hull: HullPart | None = None

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
        Whether to return the smoother's estimate with the hull's errors. The smoother runs anyway if the windows start
        from its path.

    Raises
    ------
    ProfileError
        The record cannot be filtered, or the filter rejected more than the allowed share.
    InputError
        The engine cannot run on this machine.
    """
    began = time.perf_counter()
    filtered = run_filter(profile, settings)
    smoothed = smooth_dive(profile, filtered, settings) if _from_smoothed(profile, settings) else None
    solution = invert_windows(profile, filtered, settings, _start(profile, smoothed, settings))
    on_records, hull = smooth_profile(profile, filtered, settings, smoothed, with_hull=with_hull)
    return ProfileEstimate(profile, filtered, solution, on_records, time.perf_counter() - began, hull)


def _from_smoothed(profile: PreparedProfile, settings: EstimationSettings) -> bool:
    return settings.starts_from(profile.glider.platform, profile.series.attitude_interval) == "smoothed"


def _start(
    profile: PreparedProfile, smoothed: SmoothedEstimate | None, settings: EstimationSettings
) -> StartingPath | None:
    """Return the smoothed path if the windows start from it, None if they start from the filter's disturbance."""
    if smoothed is None or not smoothed.outcome.usable or not _from_smoothed(profile, settings):
        return None
    return StartingPath(smoothed.disturbances, smoothed.states)


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
        Estimate on the steps, if it was computed for the windows; otherwise it is computed if `with_hull`.
    with_hull : bool
        Whether the hull's errors are to be in its uncertainty.

    Returns
    -------
    SmoothedEstimate, HullPart or None
        Estimate at the records, and its information on the hull if it has any.
    """
    if smoothed is None and with_hull:
        smoothed = smooth_dive(profile, filtered, settings)
    if smoothed is None:
        return None, None
    on_records, last = smoothed.thinned(settings.steps_per_record), smoothed.last_pass
    if last is None or not smoothed.outcome.usable or not with_hull or settings.smoother.hull == "believed":
        return on_records, None
    information = smoothed_dive_information(profile, smoothed, last, settings)
    if not information.has_sensitivities:
        return on_records, None
    if information.record is not None:
        on_records = with_record_errors(on_records, information.record)
    errors = stated_errors(profile.glider.platform, information.parameters)
    if information.narrows_errors:
        errors = after_dive(errors, information)
    if not information.is_sound:
        information = information.without_information()
    on_records, part = with_hull_errors(
        on_records, information, errors, corrected=settings.smoother.hull == "corrected"
    )
    glide = glide_sensitivity(profile, on_records, information, settings.steps_per_record)
    # The sensitivities at the records are large, and several dives wait for their windows.
    return on_records, HullPart(information.without_records(), errors, *part, glide)


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
        Profiles, taken when they are needed: a generator that reads records has only few of them in memory.
    settings : EstimationSettings
        Settings for all of them.
    with_hull : bool
        Whether to return the smoother's estimates. They are computed after the windows, or before if these start from
        the smoothed path.
    threads : concurrent.futures.Executor, optional
        Threads in which profiles are smoothed while their windows are solved, as far as these do not depend on it; by
        default one follows the other. Only for a single profile: each one that is being smoothed needs much memory.

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
    posed = _posed(profiles, settings, refused, with_hull=with_hull, threads=threads)
    for work, solution in solve_dives(posed, settings):
        while refused:
            yield refused.popleft()
        began = time.perf_counter()
        smoothed, hull = work.smoothing()
        seconds = work.seconds + solution.seconds + time.perf_counter() - began
        yield work.key, ProfileEstimate(work.profile, work.filtered, solution, smoothed, seconds, hull)
    yield from refused


class _Work(NamedTuple, Generic[Key]):
    """A profile whose windows are being solved, and the function that returns its smoothed estimate after them."""

    key: Key
    profile: PreparedProfile
    filtered: FilterEstimate
    smoothing: Callable[[], _Smoothing]
    seconds: float


def _posed(
    profiles: Iterable[tuple[Key, PreparedProfile]],
    settings: EstimationSettings,
    refused: deque[tuple[Key, ProfileError]],
    *,
    with_hull: bool,
    threads: Executor | None,
) -> Iterator[tuple[_Work[Key], DiveProblem]]:
    """Filter as many profiles at a time as there are lanes, and pose the windows of each when it is taken."""
    waiting = iter(profiles)
    while group := list(islice(waiting, LANES)):
        began = time.perf_counter()
        found = run_filters([profile for _, profile in group], settings)
        share = (time.perf_counter() - began) / len(group)
        # Only profiles that wait are held here, so that those whose windows are solved free their memory.
        ready = deque(zip(group, found, strict=True))
        group, found = [], []
        while ready:
            (key, profile), filtered = ready.popleft()
            if isinstance(filtered, ProfileError):
                refused.append((key, filtered))
                continue
            # A separate function, to free its memory, mainly the smoother's, before the next profile is posed.
            yield _posed_profile(key, profile, filtered, settings, share, with_hull=with_hull, threads=threads)


def _posed_profile(
    key: Key,
    profile: PreparedProfile,
    filtered: FilterEstimate,
    settings: EstimationSettings,
    seconds: float,
    *,
    with_hull: bool,
    threads: Executor | None,
) -> tuple[_Work[Key], DiveProblem]:
    """Smooth a filtered profile if its windows start from that path, and pose them; add the time to its seconds."""
    began = time.perf_counter()
    smoothed = smooth_dive(profile, filtered, settings) if _from_smoothed(profile, settings) else None
    problem = pose_windows(profile, filtered, settings, _start(profile, smoothed, settings))
    rest: Callable[[], _Smoothing]
    rest = partial(smooth_profile, profile, filtered, settings, smoothed, with_hull=with_hull)
    if threads is not None:
        rest = threads.submit(rest).result
    elif smoothed is not None:
        # Not after the windows: the smoother's last pass is large, and several dives wait for their windows.
        found = rest()
        rest = lambda: found  # noqa: E731
    return _Work(key, profile, filtered, rest, seconds + time.perf_counter() - began), problem
