"""Times that run backwards in a file: samples in another order, and clocks that were set back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.observations.checks.validation import CLOCK_SET_BACK, describe_time
from gliderhpc.observations.importing.clock_steps import times_by_two_clocks
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import SECOND, plausible_times
from gliderhpc.wording import counted

MIN_JUMP, JUMP_RATE, MAX_JUMPS = 1.0, 0.5, 0.05
"""Difference of the depths of two successive samples (m) and its growth with the time between them (m/s) that no glider
exceeds, and share of larger differences from which the samples are by two clocks."""

SAME_STEP, STEP_ALLOWANCE = 0.2, 300.0
"""Relative difference and allowance (s) within which a pause of the record is the forward step that belongs to a
backward one."""

Interval = tuple[np.datetime64, np.datetime64]


@dataclass(frozen=True)
class ClockDoubt:
    """An interval of time in which the samples have times by two clocks.

    Attributes
    ----------
    begin, end : numpy.datetime64
        Limits of the interval.
    step : str
        Clause that describes the step of the clock.
    """

    begin: np.datetime64
    end: np.datetime64
    step: str

    @property
    def remark(self) -> str:
        """Remark for the user, with the remedy."""
        return (
            f"{self.step}: the profiles and fixes between {describe_time(self.begin)} and {describe_time(self.end)} "
            "have no certain time, and these profiles no current; correct the times, or leave these samples out"
        )


def find_clock_doubts(time: TimeArray, depth: FloatArray) -> tuple[list[ClockDoubt], list[str]]:
    """Intervals with times by two clocks, and remarks on them and on samples that are merely in another order.

    If a clock was ahead for a while, the times before the backward step are wrong since the forward step, which looks
    like a pause of the record; likewise those after it if the clock was behind.

    Parameters
    ----------
    time : (n,) array
        Times in the order of the file; NaT where missing.
    depth : (n,) array
        Depths of the samples (m), NaN where missing.
    """
    rows = np.flatnonzero(plausible_times(time))
    time, depth = time[rows], depth[rows]
    steps = np.diff(time) / SECOND
    backwards = np.flatnonzero(steps < 0.0)
    if not len(backwards):
        return [], []
    doubts = [
        _doubt(time, steps, rows, interval)
        for interval in _united(times_by_two_clocks(time))
        if _is_mixed(time, depth, interval)
    ]
    if doubts:
        return doubts, [doubt.remark for doubt in doubts]
    return [], [
        f"{counted(len(backwards), 'sample is', 'samples are')} earlier than the one before in the file, by up to "
        f"{-steps.min():.0f} s: the samples are sorted by time"
    ]


def doubted_by_clock(doubts: Sequence[ClockDoubt], time: TimeArray, profile: IntArray) -> dict[int, str]:
    """Profiles with samples at uncertain times, by number, with the reason.

    Parameters
    ----------
    doubts : sequence of ClockDoubt
        The intervals.
    time : (n,) array
        Times of the samples, increasing.
    profile : (n,) int array
        Number of the profile, 0 outside any.
    """
    found: dict[int, str] = {}
    for doubt in doubts:
        inside = profile[(time >= doubt.begin) & (time <= doubt.end)]
        for number in np.unique(inside[inside > 0]).tolist():
            found.setdefault(number, f"profile {number}: {doubt.step}, so its times are uncertain")
    return found


def _united(intervals: Sequence[Interval]) -> list[Interval]:
    """Unite the intervals that overlap."""
    found: list[Interval] = []
    for begin, end in sorted(intervals):
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    return found


def _is_mixed(time: TimeArray, depth: FloatArray, interval: Interval) -> bool:
    """Return whether the depths of an interval, sorted by time, jump between those of two dives.

    Without any sample of a depth, the clock is uncertain.
    """
    inside = np.flatnonzero((time >= interval[0]) & (time <= interval[1]) & np.isfinite(depth))
    inside = inside[np.argsort(time[inside], kind="stable")]
    if len(inside) < 2:
        return True
    apart = np.diff(time[inside]) / SECOND
    jumps = np.abs(np.diff(depth[inside])) > MIN_JUMP + JUMP_RATE * apart
    return bool(jumps.mean() > MAX_JUMPS)


def _doubt(time: TimeArray, steps: FloatArray, rows: IntArray, interval: Interval) -> ClockDoubt:
    """Describe the greatest backward step into an interval, and extend the interval to the forward steps around it."""
    begin, end = interval
    into = np.flatnonzero((steps < -CLOCK_SET_BACK) & (time[1:] <= end) & (time[:-1] >= begin))
    place = int(into[np.argmin(steps[into])])
    size = -float(steps[place])
    forward = np.flatnonzero((steps > (1.0 - SAME_STEP) * size) & (steps < (1.0 + SAME_STEP) * size + STEP_ALLOWANCE))
    before, after = forward[forward < place], forward[forward > place]
    if len(before):
        begin = min(begin, time[before[-1]])
    if len(after):
        end = max(end, time[after[0] + 1])
    step = f"the clock was set back by {size:.0f} s at {describe_time(time[place])} (sample {rows[place + 1]})"
    return ClockDoubt(begin, end, step)
