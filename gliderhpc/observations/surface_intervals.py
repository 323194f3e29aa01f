"""Surface intervals around the profiles of a file, and doubts about the fixes in them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gliderhpc.observations.checks.validation import Span, clock_set_back
from gliderhpc.observations.fixes import SurfaceFixes
from gliderhpc.observations.profile_numbers import as_ranges
from gliderhpc.observations.records import FloatArray, TimeArray

MAX_FIX_AGE = np.timedelta64(1800, "s")
"""Maximum time between a fix and the beginning or end of the profile whose position it gives."""

MAX_GPS_DEPTH = 20.0
"""Depth (m) below which a glider cannot receive GPS, because the antenna is under water."""

_MAX_SEQUENCES = 3
"""Maximum number of sequences of profiles that a warning lists."""


@dataclass(frozen=True)
class ProfileSpan:
    """Span of one profile in its file.

    Attributes
    ----------
    number : int
        Number of the profile.
    start, stop : int
        Its first sample and the sample after its last.
    start_time, end_time : numpy.datetime64
        Times of its first and its last sample.
    fixes_from, fixes_until : numpy.datetime64
        Beginning of the surface interval before it, and end of the surface interval after it.
    """

    number: int
    start: int
    stop: int
    start_time: np.datetime64
    end_time: np.datetime64
    fixes_from: np.datetime64
    fixes_until: np.datetime64


def time_spans(time: TimeArray, places: dict[int, Span]) -> dict[int, ProfileSpan]:
    """Spans of the profiles with their times and surface intervals.

    A surface interval is limited by the adjacent profile and by the greatest age of a fix (`MAX_FIX_AGE`).
    """
    spans: dict[int, ProfileSpan] = {}
    ordered = sorted(places.items(), key=lambda item: item[1])
    for index, (number, (start, stop)) in enumerate(ordered):
        first, last = time[start], time[stop - 1]
        since, until = first - MAX_FIX_AGE, last + MAX_FIX_AGE
        if index > 0:
            since = max(since, time[ordered[index - 1][1][1] - 1])
        if index + 1 < len(ordered):
            until = min(until, time[ordered[index + 1][1][0]])
        spans[number] = ProfileSpan(number, start, stop, first, last, since, until)
    return spans


def describe_without_fix_between(
    spans: Mapping[int, ProfileSpan], faults: Mapping[int, str], fixes: SurfaceFixes
) -> str | None:
    """Warn of sequences of profiles that have a fix only before the first and after the last; None without any."""
    sequences: list[list[int]] = []
    begun: list[int] = []
    for span in sorted(spans.values(), key=lambda each: each.start):
        if span.number in faults:
            begun = []
            continue
        if fixes.between(span.fixes_from, span.start_time):
            begun = [span.number]
        elif begun:
            begun.append(span.number)
        if fixes.between(span.end_time, span.fixes_until):
            sequences += [begun] if len(begun) > 1 else []
            begun = []
    if not sequences:
        return None
    shown = ", ".join(map(as_ranges, sequences[:_MAX_SEQUENCES]))
    more = f" and {len(sequences) - _MAX_SEQUENCES} more sequences" if len(sequences) > _MAX_SEQUENCES else ""
    return (
        f"no GPS fix between the dives of profiles {shown}{more}: they are inverted, but have no current; `gliderhpc "
        "currents` estimates the mean current from fix to fix"
    )


def profiles_after_clock_steps(
    time: TimeArray, places: Mapping[int, Span], clock_faults: Mapping[int, str]
) -> dict[int, str]:
    """Profiles that follow one in which the clock was set back; the clocks of samples and fixes may differ there."""
    ordered = sorted(places.items(), key=lambda item: item[1])
    doubts: dict[int, str] = {}
    for (number, (start, stop)), (after, _) in pairwise(ordered):
        if number in clock_faults:
            step = clock_set_back(time[start:stop])
            if step is not None:
                doubts[after] = (
                    f"the clock was set back by {step:.0f} s in profile {number}, the preceding one: fixes are not used"
                )
    return doubts


def submerged_fixes(
    time: TimeArray,
    depth: FloatArray,
    spans: Mapping[int, ProfileSpan],
    faults: Mapping[int, str],
    fixes: SurfaceFixes,
) -> dict[int, str]:
    """Profiles with a fix while the glider is under water; the clocks of samples and fixes disagree there."""
    sound = [span for number, span in spans.items() if number not in faults]
    if not sound or not len(fixes.time):
        return {}
    starts = np.array([span.start_time for span in sound])
    ends = np.array([span.end_time for span in sound])
    inside = np.searchsorted(starts, fixes.time) - 1
    candidates = np.flatnonzero((inside >= 0) & (fixes.time < ends[np.maximum(inside, 0)]))
    doubts: dict[int, str] = {}
    for index in candidates.tolist():
        span = sound[inside[index]]
        place = span.start + int(np.searchsorted(time[span.start : span.stop], fixes.time[index]))
        around = depth[max(place - 1, span.start) : place + 1]
        if np.all(around > MAX_GPS_DEPTH) and len(around):
            doubts.setdefault(
                span.number,
                f"GPS fix of {fixes.time[index].astype('datetime64[s]')} at {around.min():.0f} m depth: the clocks of "
                "fixes and samples disagree, so fixes are not used",
            )
    return doubts
