"""What a run will do: which profiles, how large an archive, how long, how much memory and disk."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import LEAST_CYCLE
from gliderhpc.estimation.preparation import plan_windows
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import Observations

SECONDS_PER_STEP = {"recommended": 1.0e-4, "paper": 1.6e-4}
"""Rough computing time a step of 0.1 s, for the estimate of a dry run only; the run itself measures."""
BYTES_PER_STEP_MEMORY = 4000
BYTES_PER_STEP_DISK = 45
_BASE_MEMORY = 250e6


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
    """

    profiles: tuple[int, ...]
    sizes: dict[str, int]
    steps: int
    longest: int

    def describe(self, settings: MissionSettings, workers: int) -> str:
        """Sentence for a dry run: how many profiles, how long, how much memory and disk."""
        minutes = self.steps * SECONDS_PER_STEP[settings.preset] * settings.step / 0.1 / max(workers, 1) / 60.0
        memory = (_BASE_MEMORY + self.longest * BYTES_PER_STEP_MEMORY / 4.0) / 1e9
        disk = self.steps * BYTES_PER_STEP_DISK / 1e6
        hours = self.steps * settings.step / 3600.0
        return (
            f"{len(self.profiles)} profiles, {hours:.1f} h of record, {self.steps} steps; about {minutes:.1f} min on "
            f"{workers} workers, {memory:.2f} GB of memory a worker, {disk:.0f} MB of disk"
        )


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
        match = re.fullmatch(r"\s*(\d+)\s*(?::\s*(\d+)\s*)?", part)
        if match is None:
            raise InputError(f"{option} {text}: '{part}' is neither a number nor a range such as 18:20")
        first, last = int(match[1]), int(match[2] or match[1])
        found = {number for number in available if first <= number <= last}
        if not found or last < first:
            raise InputError(f"{option} {text}: no profile {part.strip()}; the file holds {_ranges(available)}")
        chosen |= found
    return tuple(sorted(chosen))


def plan_mission(observations: Observations, settings: MissionSettings, profiles: tuple[int, ...]) -> MissionPlan:
    """Size the archive for the chosen profiles, from their durations alone."""
    if not profiles:
        raise InputError(f"{observations.path}: no profile found; is depth positive down, in metres?")
    steps = [max(1, int(np.floor(observations.duration(number) / settings.step + 1e-6))) for number in profiles]
    _check_margin(observations, settings, profiles)
    longest = max(steps)
    sizes = {
        "sample": longest + 1,
        "record": longest // settings.steps_per_record + 1,
        # The default window of a fast sensor is the shortest, so it makes the most.
        "window": plan_windows(settings, 0.0).most_windows(longest),
        "segment": int(longest * settings.step / LEAST_CYCLE) + 1,
    }
    return MissionPlan(profiles, sizes, sum(steps), longest)


def _check_margin(observations: Observations, settings: MissionSettings, profiles: tuple[int, ...]) -> None:
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
