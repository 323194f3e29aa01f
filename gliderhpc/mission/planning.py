"""Preparation of a run: checks of its inputs, profiles, size of the archive, computing time, memory and disk."""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import MIN_CYCLE
from gliderhpc.estimation.engines import check_engine
from gliderhpc.estimation.preparation import check_seawater
from gliderhpc.estimation.smoother.problem import steps_per_segment
from gliderhpc.estimation.window_plan import plan_windows
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.mission.jobs import batch_size
from gliderhpc.mission.local_workers import default_workers
from gliderhpc.mission.lock import lock_name
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform
from gliderhpc.store_schema.location import Location, check_assertions
from gliderhpc.wording import counted, most_frequent_reason

log = logging.getLogger(__name__)

# Constants for the estimates of a dry run, measured by `python -m benchmarks.planning`.
SECONDS_PER_STEP = {
    ("lanes", "recommended"): 2.7e-5,
    ("lanes", "paper"): 3.0e-5,
    ("fortran", "recommended"): 2.7e-5,
    ("fortran", "paper"): 3.0e-5,
    ("scipy", "recommended"): 4.0e-5,
    ("scipy", "paper"): 5.4e-5,
}
"""Processor time per step (s), including the smoother; fortran is assumed as slow as lanes, but is slightly faster.

It is about twice as long in rough water, where the smoother needs more passes."""
BYTES_PER_STEP_DISK = 50
_BASE_MEMORY = 320e6
_READY_BYTES_PER_STEP = 300
"""Memory of a filtered profile: record, mass properties, estimates, and trajectory from which its windows start."""
_SMOOTHER_BYTES_PER_STEP, _SMOOTHER_BYTES_PER_SEGMENT = 4500, 8000
"""Memory of the one profile that is being smoothed: with its sensitivity to the hull at every record, and its tape."""
_BYTES_PER_SAMPLE = 300
"""Memory of the one profile whose record is being read and resampled."""

_GROUPS = Path("/sys/fs/cgroup")
_GROUPS_OF_PROCESS = Path("/proc/self/cgroup")


@dataclass(frozen=True)
class MissionPlan:
    """Profiles of a run and the sizes of its archive.

    Attributes
    ----------
    profiles : tuple of int
        Profile numbers, increasing, including faulty ones.
    sizes : dict
        Sizes of ``sample``, ``record``, ``window`` and ``segment`` for the longest profile.
    steps : int
        Integration steps over all profiles.
    longest : int
        Steps of the longest profile.
    max_samples : int
        Largest number of samples of a profile.
    """

    profiles: tuple[int, ...]
    sizes: dict[str, int]
    steps: int
    longest: int
    max_samples: int = 0

    def describe(self, settings: MissionSettings, workers: int) -> str:
        """Describe the run: profiles, computing time, memory and disk."""
        busy = max(1, min(workers, len(self.profiles)))
        minutes = self.steps * SECONDS_PER_STEP[settings.engine, settings.preset] / busy / 60.0
        memory = self._memory(settings, busy) / 1e9
        disk = self.steps * BYTES_PER_STEP_DISK / 1e6
        hours = self.steps * settings.step / 3600.0
        return (
            f"{counted(len(self.profiles), 'profile')}, {hours:.1f} h of record, {self.steps} steps; about "
            f"{minutes:.1f} min on {counted(busy, 'worker')}, {memory:.2f} GB of memory per worker, {disk:.0f} MB of "
            "disk"
        )

    def workers_that_fit(self, settings: MissionSettings, maximum: int) -> int:
        """Return the number of local workers, from 1 to `maximum`, that together fit into the machine's memory."""
        limit = memory_limit()
        return next((n for n in range(max(maximum, 1), 1, -1) if self._total_memory(settings, n) <= limit), 1)

    def check_memory(self, settings: MissionSettings, workers: int) -> None:
        """Check that local workers together do not need more memory than the machine has.

        Raises
        ------
        InputError
            They need more; the message gives the number of workers that fit.
        """
        limit, needed = memory_limit(), self._total_memory(settings, workers)
        if needed <= limit:
            return
        fitting = self.workers_that_fit(settings, workers)
        fits = self._total_memory(settings, fitting) <= limit
        remedy = f"give `workers={fitting}`" if fits else "leave the longest profiles out with `profiles`"
        raise InputError(
            f"{counted(workers, 'worker')} would need {needed / 1e9:.1f} GB of memory, but "
            f"{limit / 1e9:.1f} GB are available; {remedy}"
        )

    def _total_memory(self, settings: MissionSettings, workers: int) -> float:
        """Return the peak memory of all workers, bytes."""
        busy = max(1, min(workers, len(self.profiles)))
        return busy * self._memory(settings, busy)

    def _memory(self, settings: MissionSettings, workers: int) -> float:
        """Return the peak memory of one worker, bytes."""
        # When the first profile in the lanes ends, the next profiles are filtered together (fewer if they have a path).
        ready = min(batch_size(settings, len(self.profiles), workers), 2 * LANES)
        steps = self.longest * (ready * _READY_BYTES_PER_STEP + _smoother_bytes(settings.step))
        return _BASE_MEMORY + steps + self.max_samples * _BYTES_PER_SAMPLE


def _smoother_bytes(step: float) -> float:
    """Return the memory per step (bytes) of the profile that is being smoothed, for the length of a step (s)."""
    return max(_SMOOTHER_BYTES_PER_STEP, _SMOOTHER_BYTES_PER_SEGMENT / steps_per_segment(step))


def plan_mission(observations: Observations, settings: MissionSettings, profiles: tuple[int, ...]) -> MissionPlan:
    """Size the archive for the chosen profiles from their durations.

    Faulty profiles are left out, since a wrong time can make one arbitrarily long.

    Raises
    ------
    InputError
        There is no profile, the margin is too long, or a profile alone needs more memory than the machine has.
    """
    if not profiles:
        raise InputError(f"{observations.path}: no profile found; check that depth is positive down, in metres")
    usable = [number for number in profiles if number not in observations.faults]
    steps = [max(1, int(np.floor(observations.duration(number) / settings.step + 1e-6))) for number in usable] or [1]
    if usable:
        _check_margin(observations, settings, usable)
    longest = max(steps)
    samples = [observations.sample_count(number) for number in usable] or [0]
    _check_longest(observations, usable, steps, samples, settings.step)
    sizes = {
        "sample": longest + 1,
        "record": longest // settings.steps_per_record + 1,
        # The default window is shortest for a fast sensor, which gives the largest number of windows.
        "window": plan_windows(settings, 0.0).max_windows(longest),
        "segment": int(longest * settings.step / MIN_CYCLE) + 1,
    }
    return MissionPlan(profiles, sizes, sum(steps), longest, max(samples))


def _check_longest(
    observations: Observations, profiles: Sequence[int], steps: Sequence[int], samples: Sequence[int], step: float
) -> None:
    """Check that no profile alone needs more memory than the machine has."""
    limit = memory_limit()
    for number, step_count, sample_count in zip(profiles, steps, samples, strict=False):
        needed = (
            _BASE_MEMORY
            + step_count * (_READY_BYTES_PER_STEP + _smoother_bytes(step))
            + sample_count * _BYTES_PER_SAMPLE
        )
        if needed > limit:
            hours = observations.duration(number) / 3600.0
            raise InputError(
                f"{observations.path}: profile {number} lasts {hours:.1f} h with {sample_count} samples and needs "
                f"{needed / 1e9:.1f} GB of memory, but {limit / 1e9:.1f} GB are available; leave it out with `profiles`"
            )


def _check_margin(observations: Observations, settings: MissionSettings, profiles: Sequence[int]) -> None:
    """Check that the margin is shorter than the window, which depends on the sensors if it is not set."""
    intervals = [observations.duration(n) / max(observations.sample_count(n) - 1, 1) for n in profiles]
    length = settings.window_length(min(intervals))
    if settings.window.margin is not None and settings.window.margin >= length:
        raise InputError(
            f"`window.margin={settings.window.margin:g}`: must be shorter than the window, {length:g} s here; "
            "set `window.length` too"
        )


@dataclass(frozen=True, eq=False)
class PreparedMission:
    """A run that is ready to begin: its inputs are checked, and its workers fit into memory.

    Attributes
    ----------
    observations, platform, settings : Observations, Platform, MissionSettings
        The open file, the hull and the settings.
    plan : MissionPlan
        Chosen profiles, and the sizes of their archive.
    workers : int
        Number of local worker processes.
    """

    observations: Observations
    platform: Platform
    settings: MissionSettings
    plan: MissionPlan
    workers: int

    def needed(self, location: Location) -> tuple[Path, ...]:
        """Return the files that workers on other machines must see: observations, and the lock of a local archive."""
        return (self.observations.path, *([Path(lock_name(location))] if isinstance(location, Path) else []))


def prepare_mission(
    observations: Observations,
    platform: Platform,
    settings: MissionSettings,
    profiles: str | Sequence[int] | None = None,
    workers: int | None = None,
    *,
    on_cluster: bool = False,
    warn: Callable[[str], None] = log.warning,
) -> PreparedMission:
    """Check the inputs of a run, and choose its profiles and the number of its workers.

    Parameters
    ----------
    observations, platform, settings : Observations, Platform, MissionSettings
        The open file, the hull and the settings.
    profiles : str or sequence of int, optional
        Choice of profiles, such as ``18:20,68``, or their numbers; all by default.
    workers : int, optional
        Number of local worker processes; by default one per core, if memory allows.
    on_cluster : bool
        Whether the run is on a cluster, whose memory is not checked.
    warn : callable
        Function called with each warning about the file.

    Raises
    ------
    InputError
        There is no such profile or no usable one, or the workers need more memory than the machine has; or buoyancy by
        density is set for a hull without compressibility; or the engine cannot run on this machine; or zarr cannot read
        archives in this Python.
    """
    check_assertions()
    check_engine(settings)
    if profiles is None or isinstance(profiles, str):
        profiles = select_profiles(observations.profile_numbers, profiles)
    chosen = tuple(profiles)
    for warning in observations.warnings:
        warn(warning)
    if not set(chosen) - set(observations.faults):
        reason = most_frequent_reason(observations.faults[number] for number in chosen)
        raise InputError(f"{observations.path}: no usable profile; {reason}")
    check_seawater(platform, settings)
    plan = plan_mission(observations, settings, chosen)
    count = default_workers() if workers is None else workers
    if not on_cluster:
        if workers is None:
            count = plan.workers_that_fit(settings, count)
        plan.check_memory(settings, count)
    return PreparedMission(observations, platform, settings, plan, count)


# Memory of this machine


def memory_limit() -> float:
    """Return the memory (bytes) available to all processes of a run on this machine; infinite if unknown.

    It is the smallest of the physical memory, the limits of the control groups and the limit of the address space.
    """
    return min(_physical(), *_group_limits(), _address_space())


def _physical() -> float:
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (ValueError, OSError):
        return float("inf")


def _address_space() -> float:
    try:
        import resource
    except ImportError:  # Windows has no such limit.
        return float("inf")
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)


def _group_limits() -> Iterator[float]:
    """Yield the limits of this process's control groups (versions 2 and 1) and of their parents."""
    try:
        lines = _GROUPS_OF_PROCESS.read_text("utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, group = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        root, name = (_GROUPS, "memory.max") if not controllers else (_GROUPS / "memory", "memory.limit_in_bytes")
        group_folder = root / group.lstrip("/")
        for folder in (group_folder, *group_folder.parents):
            if folder.is_relative_to(root):
                yield _limit_in(folder / name)


def _limit_in(file: Path) -> float:
    try:
        text = file.read_text("utf-8").strip()
    except OSError:
        return float("inf")
    return float(text) if text.isdigit() else float("inf")
