"""What a run will do: which profiles, how large an archive, how long, how much memory and disk."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import LEAST_CYCLE
from gliderhpc.estimation.preparation import plan_windows
from gliderhpc.kernels.elementwise import LANES
from gliderhpc.mission.machine_memory import memory_limit
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations

LARGEST_BATCH = {"lanes": 3 * LANES, "fortran": 3 * LANES, "scipy": 1}
"""Profiles that a worker takes at a time: lanes stay busy until the last few of a batch, so it should hold many."""

# What a dry run reckons with, as `python -m benchmarks.planning` measured it; the run itself measures.
SECONDS_PER_STEP = {
    ("lanes", "recommended"): 6.2e-5, ("lanes", "paper"): 6.1e-5,
    ("fortran", "recommended"): 6.2e-5, ("fortran", "paper"): 6.1e-5,
    ("scipy", "recommended"): 8.7e-5, ("scipy", "paper"): 8.8e-5,
}  # fmt: skip
"""Processor time of a step, smoother included (of engine fortran: that of lanes, which it undercuts by a little).

In rough water, where the smoother needs more passes, about twice as much."""
BYTES_PER_STEP_DISK = 50
_BASE_MEMORY = 320e6
_READY_BYTES_PER_STEP = 550
"""Of a profile that was filtered: record, mass properties, estimates."""
_SMOOTHER_BYTES_PER_STEP = 2200
"""Of the one profile that is being smoothed."""
_BYTES_PER_SAMPLE = 300
"""Of the one profile whose record is being read and put onto the steps."""


@dataclass(frozen=True)
class MissionPlan:
    """Profiles of a run and the sizes of its archive.

    Attributes
    ----------
    profiles : tuple of int
        Numbers, increasing, faulty ones included.
    sizes : dict
        ``sample``, ``record``, ``window`` and ``segment`` of the longest profile.
    steps : int
        Integration steps over all profiles.
    longest : int
        Steps of the longest profile.
    most_samples : int
        Samples of the profile that has most.
    """

    profiles: tuple[int, ...]
    sizes: dict[str, int]
    steps: int
    longest: int
    most_samples: int = 0

    def describe(self, settings: MissionSettings, workers: int) -> str:
        """Sentence for a dry run: how many profiles, how long, how much memory and disk."""
        busy = max(1, min(workers, len(self.profiles)))
        minutes = self.steps * SECONDS_PER_STEP[settings.engine, settings.preset] / busy / 60.0
        memory = self._memory(settings, busy) / 1e9
        disk = self.steps * BYTES_PER_STEP_DISK / 1e6
        hours = self.steps * settings.step / 3600.0
        return (
            f"{len(self.profiles)} profiles, {hours:.1f} h of record, {self.steps} steps; about {minutes:.1f} min on "
            f"{busy} {'worker' if busy == 1 else 'workers'}, {memory:.2f} GB of memory a worker, {disk:.0f} MB of disk"
        )

    def workers_that_fit(self, settings: MissionSettings, most: int) -> int:
        """Largest number of local workers, up to so many, that together fit into the machine's memory; at least one."""
        limit = memory_limit()
        return next((n for n in range(max(most, 1), 1, -1) if self._together(settings, n) <= limit), 1)

    def check_memory(self, settings: MissionSettings, workers: int) -> None:
        """Refuse a run on local workers that together need more memory than the machine has.

        Raises
        ------
        InputError
            With the number of workers that would do.
        """
        limit, needed = memory_limit(), self._together(settings, workers)
        if needed <= limit:
            return
        fitting = self.workers_that_fit(settings, workers)
        fits = self._together(settings, fitting) <= limit
        remedy = f"give --workers {fitting}" if fits else "leave the longest profiles out with --profiles"
        raise InputError(
            f"{workers} {'worker' if workers == 1 else 'workers'} would need {needed / 1e9:.1f} GB of memory, and "
            f"{limit / 1e9:.1f} GB are there; {remedy}"
        )

    def _together(self, settings: MissionSettings, workers: int) -> float:
        """Bytes that so many workers hold at most."""
        busy = max(1, min(workers, len(self.profiles)))
        return busy * self._memory(settings, busy)

    def _memory(self, settings: MissionSettings, workers: int) -> float:
        """Bytes that a worker holds at most."""
        # The lanes' next profiles are filtered, all at once, when the first of those in the lanes ends.
        ready = min(batch_size(settings, len(self.profiles), workers), 2 * LANES)
        steps = self.longest * (ready * _READY_BYTES_PER_STEP + _SMOOTHER_BYTES_PER_STEP)
        return _BASE_MEMORY + steps + self.most_samples * _BYTES_PER_SAMPLE


def batch_size(settings: MissionSettings, profiles: int, workers: int) -> int:
    """Profiles that a worker takes at a time: enough for the engine's lanes, and some for every worker."""
    return min(LARGEST_BATCH[settings.engine], -(-profiles // workers))


def select_profiles(available: Sequence[int], text: str | None, option: str = "--profiles") -> tuple[int, ...]:
    """Choose profiles by a text such as ``18:20,68`` (ranges include both ends), or all.

    Raises
    ------
    InputError
        The text cannot be read, or names a profile that the file does not hold.
    """
    if text is None:
        return tuple(sorted(available))
    chosen: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,18})\s*(?::\s*(\d{1,18})\s*)?", part)
        if match is None:
            raise InputError(f"{option} {text}: '{part}' is neither a number nor a range such as 18:20")
        first, last = int(match[1]), int(match[2] or match[1])
        found = {number for number in available if first <= number <= last}
        if not found or last < first:
            raise InputError(f"{option} {text}: no profile {part.strip()}; the file holds {_ranges(available)}")
        chosen |= found
    return tuple(sorted(chosen))


def plan_mission(observations: Observations, settings: MissionSettings, profiles: tuple[int, ...]) -> MissionPlan:
    """Size the archive for the chosen profiles, from their durations alone.

    A profile that cannot be inverted takes no room: a wrong time in it makes it as long as you like.

    Raises
    ------
    InputError
        There is no profile, the margin is too long, or a profile needs more memory than the machine has.
    """
    if not profiles:
        raise InputError(f"{observations.path}: no profile found; is depth positive down, in metres?")
    sound = [number for number in profiles if number not in observations.faults]
    steps = [max(1, int(np.floor(observations.duration(number) / settings.step + 1e-6))) for number in sound] or [1]
    if sound:
        _check_margin(observations, settings, sound)
    longest = max(steps)
    samples = [observations.sample_count(number) for number in sound] or [0]
    _check_longest(observations, sound, steps, samples)
    sizes = {
        "sample": longest + 1,
        "record": longest // settings.steps_per_record + 1,
        # The default window of a fast sensor is the shortest, so it makes the most.
        "window": plan_windows(settings, 0.0).most_windows(longest),
        "segment": int(longest * settings.step / LEAST_CYCLE) + 1,
    }
    return MissionPlan(profiles, sizes, sum(steps), longest, max(samples))


def _check_longest(
    observations: Observations, profiles: Sequence[int], steps: Sequence[int], samples: Sequence[int]
) -> None:
    """Refuse a profile that alone needs more memory than the machine has."""
    limit = memory_limit()
    for number, step_count, sample_count in zip(profiles, steps, samples, strict=False):
        needed = (
            _BASE_MEMORY
            + step_count * (_READY_BYTES_PER_STEP + _SMOOTHER_BYTES_PER_STEP)
            + sample_count * _BYTES_PER_SAMPLE
        )
        if needed > limit:
            hours = observations.duration(number) / 3600.0
            raise InputError(
                f"{observations.path}: profile {number} lasts {hours:.1f} h with {sample_count} samples and needs "
                f"{needed / 1e9:.1f} GB of memory, and {limit / 1e9:.1f} GB are there; leave it out with --profiles"
            )


def _check_margin(observations: Observations, settings: MissionSettings, profiles: Sequence[int]) -> None:
    """Refuse a margin as long as the shortest window: the sensors decide the window where it is not set."""
    intervals = [observations.duration(n) / max(observations.sample_count(n) - 1, 1) for n in profiles]
    length = settings.window_length(min(intervals))
    if settings.window.margin is not None and settings.window.margin >= length:
        raise InputError(
            f"--set window.margin={settings.window.margin:g}: must be shorter than the window, {length:g} s here; "
            "set window.length too"
        )


def _ranges(numbers: Sequence[int]) -> str:
    ordered = sorted(numbers)
    return f"{ordered[0]} to {ordered[-1]} ({len(ordered)} profiles)" if ordered else "none"
