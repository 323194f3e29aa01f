"""Error of the GPS fixes, from their scatter about a steady drift at the surface."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import MAD_TO_STD
from gliderhpc.estimation.current_errors import CurrentSettings
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.observations import Fix, ProfileRecord
from gliderhpc.observations.times import SECOND
from gliderhpc.record_checks.finding import Finding, judge_size, undetermined
from gliderhpc.wording import counted

Array = NDArray[np.float64]

_FIX_ERROR = ("fixes", "error of a GPS fix", "m")
"""Check, quantity and unit."""

LONGEST_TRIPLE = 300.0
"""Longest time between the first and the last of three fixes, s; over longer times the drift itself may change."""

LONGEST_PAIR = 120.0
"""Longest time between two fixes whose drift is compared with the drifts at other surfacings, s."""

DRIFT_VARIATION = 0.5
"""Standard deviation of the drift at the surface between surfacings, each component, m/s."""

MIN_COUNT = 4
"""Minimum number of triples or pairs of fixes."""

_MIN_RATIO = 3.0
"""Ratio to the assumed error above which the error of the fixes is reported."""


def fix_finding(surfacings: Iterable[Sequence[Fix]], current: CurrentSettings) -> Finding:
    """Estimate the error of a GPS fix, north and east each.

    Parameters
    ----------
    surfacings : iterable of sequence of Fix
        Consecutive fixes at the surface.
    current : CurrentSettings
        Settings of the currents, with the assumed error of a fix.

    Notes
    -----
    The distance of a fix from the line between the fixes before and after it needs no assumption on the drift. Where
    surfacings have only two fixes, the drift between them is compared with the median of all, and the variance of the
    drift itself (`DRIFT_VARIATION`) is subtracted. The standard deviation is the robust one.
    """
    groups = list({fixes[0].time: tuple(fixes) for fixes in surfacings if len(fixes) > 1}.values())
    distances = np.array([distance for fixes in groups for distance in _distances_from_lines(fixes)])
    if len(distances) >= MIN_COUNT:
        size = MAD_TO_STD * float(np.median(np.abs(distances)))
        basis = counted(len(distances), "fix between two others", "fixes between two others")
        return _finding(size, size / np.sqrt(distances.size), _MIN_RATIO * current.fix_error, basis)
    pairs = [pair for fixes in groups for pair in _drifts(fixes)]
    basis = f"{counted(len(pairs), 'pair')} of fixes at most {LONGEST_PAIR:.0f} s apart"
    if len(pairs) < MIN_COUNT:
        return undetermined(*_FIX_ERROR, f"{basis}, but at least {MIN_COUNT} are needed")
    drifts, times = (np.array(values) for values in zip(*pairs, strict=True))
    apart, elapsed = drifts - np.median(drifts, axis=0), float(np.median(times))
    scatter = MAD_TO_STD * float(np.median(np.abs(apart)))
    size = elapsed * float(np.sqrt(max(scatter**2 - DRIFT_VARIATION**2, 0.0) / 2.0))
    by_drift = elapsed * DRIFT_VARIATION / np.sqrt(2.0)
    error = float(np.hypot(size / np.sqrt(drifts.size), 0.5 * by_drift))
    return _finding(size, error, max(_MIN_RATIO * current.fix_error, by_drift), basis)


def _finding(size: float, error: float, threshold: float, basis: str) -> Finding:
    verdict = judge_size(size, threshold)
    return Finding(*_FIX_ERROR, size, error, threshold, verdict, f"`current.fix_error={size:.2g}`", basis)


def surfacings_of(record: ProfileRecord) -> tuple[tuple[Fix, ...], tuple[Fix, ...]]:
    """Return the fixes at the surface before and after a profile."""
    return record.surface_fixes_before, record.surface_fixes_after


def _distances_from_lines(fixes: Sequence[Fix]) -> Iterator[Array]:
    """Yield distances ``(2,)`` (m) of fixes from the line between their neighbours, relative to their error's share."""
    for before, fix, after in zip(fixes, fixes[1:], fixes[2:], strict=False):
        span = _seconds(before, after)
        if 0.0 < span <= LONGEST_TRIPLE:
            share = _seconds(before, fix) / span
            distance = local_displacement(before, fix) - share * local_displacement(before, after)
            yield distance / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)


def _drifts(fixes: Sequence[Fix]) -> Iterator[tuple[Array, float]]:
    """Yield drifts ``(2,)`` (m/s) between consecutive fixes, with the time between them (s)."""
    for first, second in pairwise(fixes):
        elapsed = _seconds(first, second)
        if 0.0 < elapsed <= LONGEST_PAIR:
            yield local_displacement(first, second) / elapsed, elapsed


def _seconds(first: Fix, second: Fix) -> float:
    return float((second.time - first.time) / SECOND)
