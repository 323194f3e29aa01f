"""A profile's currents in the archive, and the displacements from which they are recomputed when fixes arrive.

The fixes after a dive often arrive only with the files of the next dive. The displacements through the water are
therefore stored with the profile's commit, and the currents are recomputed from them without another inversion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.estimation.current_errors import CurrentErrors
from gliderhpc.estimation.currents import (
    DepthAveragedCurrent,
    DriftSegment,
    SurfaceInterval,
    Track,
    component_row,
    current_from_displacement,
    current_row,
    cycles_of,
    depth_averaged_current,
    fix_row,
    single_cycle,
    surface_drift_row,
    track_of,
    with_disagreement,
)
from gliderhpc.estimation.profile import ProfileEstimate
from gliderhpc.estimation.self_motion import SelfMotion, model_motion
from gliderhpc.observations import ProfileRecord
from gliderhpc.observations.times import epoch_seconds

Array = NDArray[np.float64]
Row = dict[str, Any]


BY_FIXES = ("entry_", "exit_", "dac_", "surface_drift_")
"""Prefixes of the table's columns that depend on the fixes."""


@dataclass(frozen=True, eq=False)
class SmoothedTrack:
    """Displacement ``(2,)`` through the water from the smoother, m, with its covariance ``(2, 2)``, m2.

    The flag `with_hull` indicates whether the covariance includes the errors of the hull.
    """

    displacement: Array
    covariance: Array
    with_hull: bool


@dataclass(frozen=True, eq=False)
class Tracks:
    """Displacements through the water from which, together with the fixes, a profile's currents are computed.

    Attributes
    ----------
    adjoint : Track
        Displacement from the windows.
    covariance : (2, 2), optional
        Covariance of that displacement including the hull's errors, m2, if the smoother provides it.
    glide_angle : Track
        Displacement from the glide-angle relation.
    smoothed : SmoothedTrack, optional
        Displacement from the smoother, if its outcome is usable.
    filtered : Track, optional
        Displacement from the filter, where the windows start from the smoothed path.
    """

    adjoint: Track
    covariance: Array | None
    glide_angle: Track
    smoothed: SmoothedTrack | None
    filtered: Track | None


def tracks_of(estimate: ProfileEstimate, motion: SelfMotion, conventional: SelfMotion, *, by_hull: bool) -> Tracks:
    """Return the displacements of an estimate.

    Parameters
    ----------
    estimate : ProfileEstimate
        The estimate of the profile.
    motion, conventional : SelfMotion
        Displacement from the windows, and from the glide-angle relation.
    by_hull : bool
        Whether the covariance contains the hull's errors if the estimate has them (setting ``current.budget``).
    """
    series, smoothed = estimate.series, estimate.smoothed
    cycles, with_hull = cycles_of(series), by_hull and estimate.hull is not None
    filtered = None
    if estimate.solution.from_smoothed:
        filter_motion = model_motion(estimate.filtered.states, estimate.vibrating, series.step)
        filtered = track_of(series, filter_motion, cycles)
    return Tracks(
        adjoint=track_of(series, motion, cycles),
        covariance=smoothed.displacement_covariance if with_hull and smoothed is not None else None,
        glide_angle=track_of(series, conventional, single_cycle(series)),
        smoothed=_smoothed_track(estimate, with_hull=with_hull),
        filtered=filtered,
    )


def _smoothed_track(estimate: ProfileEstimate, *, with_hull: bool) -> SmoothedTrack | None:
    smoothed = estimate.smoothed
    if smoothed is None or not smoothed.outcome.usable:
        return None
    covariance = smoothed.displacement_covariance
    if estimate.hull is not None and not with_hull:
        covariance = covariance - estimate.hull.displacement_covariance
    return SmoothedTrack(smoothed.displacement, covariance, with_hull)


def current_rows(record: ProfileRecord, tracks: Tracks, errors: CurrentErrors) -> tuple[Row, Row]:
    """Return the table's columns that depend on the fixes, and the row of group ``drift_current``.

    Parameters
    ----------
    record : ProfileRecord
        Record of the profile, with its fixes.
    tracks : Tracks
        Displacements through the water.
    errors : CurrentErrors
        Terms of the currents' uncertainty.
    """
    adjoint = depth_averaged_current(record, tracks.adjoint, errors, tracks.covariance)
    smoothed = _smoothed_current(record, tracks, errors)
    filtered = None if tracks.filtered is None else depth_averaged_current(record, tracks.filtered, errors)
    conventional = depth_averaged_current(record, tracks.glide_angle, errors)
    if adjoint is not None and smoothed is not None:
        adjoint, smoothed = with_disagreement(adjoint, smoothed, errors, filtered)
    row = _fix_rows(record)
    if adjoint is not None:
        row |= current_row(adjoint, "dac_{}", "dac_covariance")
        row |= _surface_row("entry", adjoint.entry) | _surface_row("exit", adjoint.exit)
    if conventional is not None:
        row |= component_row(conventional, "dac_{}_glide_angle")
    row |= surface_drift_row(record)
    if smoothed is not None:
        row |= current_row(smoothed, "dac_{}_smoothed", "dac_smoothed_covariance")
    if filtered is not None:
        row |= component_row(filtered, "dac_{}_filter")
    return row, _segments(() if adjoint is None else adjoint.segments)


def _smoothed_current(record: ProfileRecord, tracks: Tracks, errors: CurrentErrors) -> DepthAveragedCurrent | None:
    """Return the smoother's current, or None if its outcome is not usable or a fix is missing."""
    track = tracks.smoothed
    if track is None:
        return None
    return current_from_displacement(
        record, tracks.adjoint.clock, track.displacement, track.covariance, errors, with_hull=track.with_hull
    )


def _segments(segments: Sequence[DriftSegment]) -> Row:
    return {
        "north": [segment.velocity[0] for segment in segments],
        "east": [segment.velocity[1] for segment in segments],
        "start": np.array([segment.start for segment in segments], dtype=np.int64),
        "stop": np.array([segment.stop for segment in segments], dtype=np.int64),
    }


def _fix_rows(record: ProfileRecord) -> Row:
    row: Row = {}
    for end, fix in (("entry", record.entry_fix), ("exit", record.exit_fix)):
        if fix is not None:
            row |= fix_row(end, fix) | {f"{end}_time": epoch_seconds(fix.time)}
    return row


def _surface_row(end: str, interval: SurfaceInterval) -> Row:
    north, east = interval.displacement.tolist()
    return {
        f"{end}_surface_time": interval.drift_removed,
        f"{end}_surface_north": north,
        f"{end}_surface_east": east,
    }


# Content stored with the commit, as JSON, which reproduces every finite number exactly


def tracks_as_json(tracks: Tracks, remarks: list[str]) -> Row:
    """Return displacements and the estimate's remarks as plain JSON."""
    smoothed = tracks.smoothed
    return {
        "adjoint": _track_as_json(tracks.adjoint),
        "covariance": None if tracks.covariance is None else _numbers(tracks.covariance),
        "glide_angle": _track_as_json(tracks.glide_angle),
        "smoothed": None
        if smoothed is None
        else {
            "displacement": _numbers(smoothed.displacement),
            "covariance": _numbers(smoothed.covariance),
            "with_hull": smoothed.with_hull,
        },
        "filtered": None if tracks.filtered is None else _track_as_json(tracks.filtered),
        "remarks": remarks,
    }


def tracks_from_json(content: Mapping[str, Any]) -> tuple[Tracks, list[str]]:
    """Return displacements and remarks from `tracks_as_json`."""
    smoothed, filtered, covariance = content["smoothed"], content["filtered"], content["covariance"]
    tracks = Tracks(
        adjoint=_track_from_json(content["adjoint"]),
        covariance=None if covariance is None else _array(covariance),
        glide_angle=_track_from_json(content["glide_angle"]),
        smoothed=None
        if smoothed is None
        else SmoothedTrack(
            _array(smoothed["displacement"]), _array(smoothed["covariance"]), bool(smoothed["with_hull"])
        ),
        filtered=None if filtered is None else _track_from_json(filtered),
    )
    return tracks, list(content["remarks"])


def _track_as_json(track: Track) -> Row:
    return {
        "samples": track.samples.tolist(),
        "clock": _numbers(track.clock),
        "positions": _numbers(track.positions),
        "total": _numbers(track.total),
        "bridged": _numbers(np.float64(track.bridged)),
    }


def _track_from_json(content: Mapping[str, Any]) -> Track:
    clock, positions, total, bridged = (_array(content[name]) for name in ("clock", "positions", "total", "bridged"))
    return Track(np.array(content["samples"], dtype=np.int64), clock, positions, total, float(bridged))


def _numbers(values: ArrayLike) -> Any:
    """Return numbers as lists, with None instead of NaN, which JSON lacks."""
    array = np.asarray(values)
    return np.where(np.isfinite(array), array.astype(object), None).tolist()  # type: ignore[call-overload]


def _array(numbers: Any) -> Array:
    return np.array(numbers, dtype=np.float64)
