"""Samples whose time is missing or implausible: they are left out, and the rest of their profile is used."""

from collections.abc import Mapping

import numpy as np

from gliderhpc.observations.checks.validation import Span
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.times import FIRST_YEAR, LAST_YEAR, DecodedTimes
from gliderhpc.wording import counted

_MAX_UNTIMED = 0.5
"""Fraction of samples without a usable time above which the clock is wrong, so that they are not left out."""

_SPACING = 1_000_000
"""Interval (ns) between interpolated times beyond the first or the last usable one."""


def untimed_samples(clock: DecodedTimes) -> tuple[IntArray, list[str]]:
    """Samples to leave out because their time is missing or implausible, and a remark on them.

    None are left out if most samples have no usable time.
    """
    rows = np.flatnonzero(np.isnat(clock.time))
    if not len(rows) or len(rows) > _MAX_UNTIMED * len(clock.time):
        return np.zeros(0, dtype=np.int64), []
    implausible = np.count_nonzero(clock.implausible)
    kinds = ["missing"] if implausible < len(rows) else []
    kinds += [f"not between {FIRST_YEAR} and {LAST_YEAR}"] if implausible else []
    count = counted(len(rows), "sample")
    remedy = "; correct the clock, or declare the fill value (_FillValue)" if implausible else ""
    return rows, [f"time is {' or '.join(kinds)} in {count}, the first at sample {rows[0]}: left out{remedy}"]


def with_interpolated_times(clock: DecodedTimes, rows: IntArray) -> DecodedTimes:
    """Interpolate the times of some samples; before and after all others, they are a millisecond apart."""
    known = np.setdiff1d(np.arange(len(clock.time)), rows)
    if not len(rows) or not len(known):
        return clock
    time, epoch = clock.time.copy(), clock.time[known[0]]
    elapsed = (time[known] - epoch).astype(np.int64)
    before = np.maximum(np.searchsorted(known, rows) - 1, 0)
    after = np.minimum(before + 1, len(known) - 1)
    share = (rows - known[before]) / np.maximum(known[after] - known[before], 1)
    filled = elapsed[before] + np.rint(share * (elapsed[after] - elapsed[before])).astype(np.int64)
    beyond = (rows < known[0]) | (rows > known[-1])
    nearest = np.where(rows < known[0], 0, len(known) - 1)
    filled[beyond] = (elapsed[nearest] + (rows - known[nearest]) * _SPACING)[beyond]
    time[rows] = epoch + filled.astype("timedelta64[ns]")
    return DecodedTimes(time, clock.implausible & ~np.isin(np.arange(len(time)), rows))


def without_untimed_ends(places: Mapping[int, Span], untimed: IntArray) -> dict[int, Span]:
    """Shorten the spans of profiles that begin or end with samples without a time; one of only such samples remains."""
    found: dict[int, Span] = {}
    for number, (start, stop) in places.items():
        first, last = np.searchsorted(untimed, (start, stop))
        timed = np.setdiff1d(np.arange(start, stop), untimed[first:last]) if last > first else np.arange(0)
        found[number] = (int(timed[0]), int(timed[-1]) + 1) if len(timed) else (start, stop)
    return found
