"""Mean current over several dives that have a fix only before the first and after the last of them.

At the surface between two dives the glider has no motion of its own, and drifts with the water. This drift is unknown;
it is taken as the current below, with an error of ``surface_shear``.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gliderhpc.estimation.current_errors import CurrentErrors, Drift, current_uncertainty
from gliderhpc.estimation.currents import (
    DepthAveragedCurrent,
    local_displacement,
    surface_interval_after,
    surface_interval_before,
)
from gliderhpc.estimation.glide_currents import GlideErrors, GlideTrack, Origin
from gliderhpc.observations.dive_phases import MAX_UNRECORDED, distance_to_surface
from gliderhpc.observations.fixes import pair_fault
from gliderhpc.observations.navigation.records import Navigation
from gliderhpc.observations.profile_numbers import as_ranges
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.times import SECOND

Array = NDArray[np.float64]
Dive = tuple[ProfileRecord, GlideTrack | None]


def with_span_currents(
    dives: Sequence[Dive], navigation: Navigation, errors: GlideErrors
) -> tuple[list[GlideTrack | None], dict[int, str]]:
    """Add the mean current between two fixes to the tracks of dives that have no fix of their own on one side or both.

    Parameters
    ----------
    dives : sequence of (ProfileRecord, GlideTrack or None)
        All profiles in time order, and their tracks; None for those that cannot be used.
    navigation : Navigation
        Records of the mission, of which these are the profiles.
    errors : GlideErrors
        Errors of the records and of the glide.

    Returns
    -------
    tracks : list of GlideTrack or None
        Tracks in the same order.
    notes : dict of int to str
        Remarks by number of the profile: the dives of the mean, or the reason why there is none.
    """
    tracks = [track for _, track in dives]
    notes: dict[int, str] = {}
    for first, stop in _spans(dives):
        part = dives[first:stop]
        numbers = tuple(record.number for record, _ in part)
        fault = _fault(part, navigation)
        if fault is not None:
            notes |= dict.fromkeys(numbers, f"no mean current from fix to fix over the profiles {fault}")
            continue
        tracks[first:stop] = _with_mean_current(part, errors)
        notes |= dict.fromkeys(numbers, f"the current is the mean from fix to fix over profiles {as_ranges(numbers)}")
    return tracks, notes


def _spans(dives: Sequence[Dive]) -> list[tuple[int, int]]:
    """First dive, and dive after the last, of each sequence between two fixes without a fix in it."""
    spans: list[tuple[int, int]] = []
    begin: int | None = None
    for index, (record, _) in enumerate(dives):
        if record.entry_fix is not None:
            begin = index
        if record.exit_fix is not None:
            if begin is not None and begin < index:
                spans.append((begin, index + 1))
            begin = None
    return spans


def _fault(part: Sequence[Dive], navigation: Navigation) -> str | None:
    """Describe why the current of a sequence of dives cannot be estimated; None if it can."""
    records = [record for record, _ in part]
    text = as_ranges([record.number for record in records])
    for record, track in part:
        if track is None:
            return f"{text}: profile {record.number} cannot be used"
        if record.number in navigation.without_fixes:
            return f"{text}: {navigation.without_fixes[record.number]}"
    for before, after in pairwise(records):
        between = f"between profiles {before.number} and {after.number}"
        if navigation.has_unused_dive(before.instants[-1], after.epoch):
            return f"{text}: {between} there is a dive that cannot be used"
        pause = navigation.longest_pause(before.instants[-1], after.epoch)
        if pause > MAX_UNRECORDED:
            return (
                f"{text}: no record for {pause / 60.0:.0f} minutes {between}, in which there may be another dive; add "
                "its records, or a fix"
            )
    entry, leave = records[0].entry_fix, records[-1].exit_fix
    fault = None if entry is None or leave is None else pair_fault(entry, leave)
    return None if fault is None else f"{text}: {fault}"


def _with_mean_current(part: Sequence[Dive], errors: GlideErrors) -> list[GlideTrack | None]:
    """Return the tracks of a sequence of dives with their mean current."""
    tracks = [track for _, track in part if track is not None]
    current = _mean_current(part, tracks, errors)
    fixes = part[0][0].entry_fix, part[-1][0].exit_fix
    if current is None or fixes[0] is None:
        return [*tracks]
    numbers = tuple(record.number for record, _ in part)
    displacement, adrift = current.entry.displacement, current.entry.duration - current.entry.drift_removed
    found: list[GlideTrack | None] = []
    for index, track in enumerate(tracks):
        origin = Origin(fixes[0], displacement, adrift)
        found.append(replace(track, current=current, fixes=fixes, origin=origin, dives=numbers))
        displacement = displacement + track.motion.total
        adrift += float(track.series.time[-1] - track.series.time[0])
        adrift += _pause(part[index], part[index + 1]) if index + 1 < len(part) else 0.0
    return found


def _mean_current(
    part: Sequence[Dive], tracks: Sequence[GlideTrack], errors: GlideErrors
) -> DepthAveragedCurrent | None:
    """Return the mean current of a sequence of dives.

    Notes
    -----
    ``V = (dX_GPS - dX_surface - sum dX) / T``, from the fix before the first dive to that after the last. The errors
    of the drag and the pitch, which all dives have in common, add up, and so do those of the drift at the surface. The
    others are independent.
    """
    (first, track), (last, _) = (part[0][0], tracks[0]), (part[-1][0], tracks[-1])
    terms = errors.of_current
    before = surface_interval_before(first, track.series.time, terms)
    after = surface_interval_after(last, tracks[-1].series.time, terms)
    if before is None or after is None or first.entry_fix is None or last.exit_fix is None:
        return None
    moved = local_displacement(first.entry_fix, last.exit_fix) - before.displacement - after.displacement
    pauses = [_pause(one, other) for one, other in pairwise(part)]
    glided = sum(float(each.series.time[-1] - each.series.time[0]) for each in tracks)
    elapsed = glided + sum(pauses) + sum(end.duration - end.drift_removed for end in (before, after))
    displacement = np.sum([each.motion.total for each in tracks], axis=0)
    displaced = sum((each.errors for each in tracks[1:]), tracks[0].errors)
    variance = before.variance + after.variance + _variance_between(part, pauses, terms)
    velocity = (moved - displacement) / elapsed
    drift = Drift(velocity, displacement, elapsed, variance, 0.0, displaced.covariance)
    return DepthAveragedCurrent(velocity, current_uncertainty(drift, terms).covariance, drift, (), before, after)


def _variance_between(part: Sequence[Dive], pauses: Sequence[float], errors: CurrentErrors) -> float:
    """Variance (m2, per component) of the displacement between the dives: unrecorded ends, and drift at the surface."""
    variance = (errors.surface_shear * sum(pauses)) ** 2
    for ((one, _), (other, _)), pause in zip(pairwise(part), pauses, strict=True):
        variance += distance_to_surface(one.time, one.depth, one.pitch, pause, "end") ** 2
        variance += distance_to_surface(other.time, other.depth, other.pitch, pause, "start") ** 2
    return variance


def _pause(before: Dive, after: Dive) -> float:
    """Time (s) from the end of one track to the start of the next; from record to record where there is no track."""
    (first, track), (second, following) = before, after
    end = first.time[-1] if track is None else track.series.time[-1]
    start = 0.0 if following is None else following.series.time[0]
    return float((second.epoch - first.epoch) / SECOND) + float(start - end)
