"""The depth-averaged current: displacement by GPS less the glider's own motion (section 4.4, eqs. 39 and 40)."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geographiclib.geodesic import Geodesic
from numpy.typing import NDArray

from gliderhpc.estimation.current_errors import CurrentErrors, Drift, current_uncertainty
from gliderhpc.estimation.self_motion import SelfMotion
from gliderhpc.observations import cycle_boundaries
from gliderhpc.observations.dive_phases import distance_to_surface
from gliderhpc.observations.fixes import MAXIMUM_DRIFT
from gliderhpc.observations.records import Fix, ProfileRecord
from gliderhpc.observations.series import ProfileSeries
from gliderhpc.observations.times import SECOND

Array = NDArray[np.float64]
Row = dict[str, Any]

MIN_CYCLE = 120.0
"""Shortest dive-climb cycle (s); shorter ones are joined to a neighbour."""
STRONG = 1.0
"""Speed of a depth-averaged current (m/s) above which the fixes are doubtful, except in the strongest currents."""
MIN_DRIFT_TIME = 60.0
"""Shortest time between two fixes (s) that determine the surface drift."""


@dataclass(frozen=True, eq=False)
class DriftSegment:
    """Drift velocity (m/s, north and east) of one dive-climb cycle, between two samples of the profile."""

    start: int
    stop: int
    velocity: Array


@dataclass(frozen=True, eq=False)
class SurfaceInterval:
    """Interval at the surface between a fix and the start or the end of the dive.

    Attributes
    ----------
    duration : float
        Duration, s, not negative.
    drift_removed : float
        Part of that time (s) covered by the drift measured at the surface; over the rest the current below acts.
    displacement : (2,)
        Drift over that part, north and east (m).
    variance : float
        Variance of the position where the drift of the dive begins or ends, north and east each (m2): from the fixes,
        whose errors also enter the measured drift, from the difference between the drift over the rest of the time and
        the current below, and from the distance between the surface and a record that begins or ends under water.
    """

    duration: float
    drift_removed: float
    displacement: Array
    variance: float


@dataclass(frozen=True, eq=False)
class DepthAveragedCurrent:
    """Current of one profile from the adjoint's or the smoother's displacement.

    Attributes
    ----------
    velocity : (2,)
        Current, north and east, m/s.
    covariance : (2, 2)
        Covariance of the current, m2/s2.
    drift : Drift
        Displacements, time and variances from which both follow.
    segments : tuple of DriftSegment
        Drift of each dive-climb cycle (eqs. 39 and 40); empty for the smoother.
    entry, exit : SurfaceInterval
        Intervals at the surface between the fixes and the dive, and the drift removed there.
    """

    velocity: Array
    covariance: Array
    drift: Drift
    segments: tuple[DriftSegment, ...]
    entry: SurfaceInterval
    exit: SurfaceInterval


@dataclass(frozen=True, eq=False)
class Track:
    """Displacement through the water at the boundaries of a profile's dive-climb cycles.

    Attributes
    ----------
    samples : (k+1,)
        Samples between which the cycles lie, first 0, last n.
    clock : (k+1,)
        Their times, s since the profile's first sample.
    positions : (k+1, 2)
        Displacement north and east from the first of them, m.
    total : (2,)
        Displacement over the profile, m.
    bridged : float
        Length (m) of the displacement that was interpolated (`SelfMotion`).
    """

    samples: NDArray[np.int64]
    clock: Array
    positions: Array
    total: Array
    bridged: float


def track_of(series: ProfileSeries, motion: SelfMotion, boundaries: NDArray[np.int64]) -> Track:
    """Return the displacement of a motion at the boundaries ``(k+1,)`` of cycles."""
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(motion.steps, axis=0)])[boundaries]
    return Track(boundaries, series.time[boundaries].astype(np.float64), positions, motion.total, motion.bridged)


@dataclass(frozen=True, eq=False)
class SurfaceDrift:
    """Mean drift between the first and the last of consecutive fixes at the surface.

    Attributes
    ----------
    velocity : (2,)
        Velocity, north and east, m/s.
    duration : float
        Time between the two fixes (s).
    """

    velocity: Array
    duration: float

    def weight(self, errors: CurrentErrors) -> float:
        """Weight (0 to 1) of this drift in its weighted mean with the current below, from the errors of both."""
        if errors.surface_shear == 0.0:
            return 0.0
        error = np.sqrt(2.0) * errors.fix_error / self.duration
        return float(1.0 / (1.0 + (error / errors.surface_shear) ** 2))


def local_displacement(start: Fix, end: Fix) -> Array:
    """North and east (m) from one fix to another on the WGS84 ellipsoid: geodesic length and azimuth at the start."""
    geodesic = Geodesic.WGS84.Inverse(start.latitude, start.longitude, end.latitude, end.longitude)
    azimuth = np.radians(geodesic["azi1"])
    return float(geodesic["s12"]) * np.array([np.cos(azimuth), np.sin(azimuth)])


def depth_averaged_current(
    record: ProfileRecord, track: Track, errors: CurrentErrors, track_covariance: Array | None = None
) -> DepthAveragedCurrent | None:
    """Compute the drift of each dive-climb cycle and their mean, or None unless there is a fix on both sides.

    Parameters
    ----------
    record : ProfileRecord
        Fixes before and after the profile.
    track : Track
        Displacement through the water at the boundaries of the cycles (`track_of`).
    errors : CurrentErrors
        Terms of the uncertainty (`current_uncertainty`).
    track_covariance : (2, 2), optional
        Covariance of the displacement through the water including the hull's errors, m2, in place of the terms.

    Notes
    -----
    Between a fix and the dive the glider drifts at the surface with the water and the wind. This drift differs from the
    current that the dive averages. If consecutive fixes determine it, its time and displacement are removed. If they do
    not, the time of the first or last cycle extends to the fix, as if the current below acted there too. In general the
    drift is a weighted mean of the measured one (error ``sqrt(2) fix_error / duration``) and the current below (error
    ``surface_shear``), with weights by their errors; the weight of the measured one is the part of the time removed.
    The glider has no motion of its own at the surface. Where the record begins or ends under water, the unrecorded path
    (`gliderhpc.observations.dive_phases.unrecorded_variance`) is an error of the position there. The segments close:
    ``sum V_k dT_k = dX_GPS - dX_surface - dX_raw``.
    """
    between_fixes = _fix_to_fix_drift(record, track.clock, errors)
    if between_fixes is None:
        return None
    clock = track.clock.copy()
    clock[[0, -1]] = between_fixes.begin, between_fixes.end
    times = np.diff(clock)
    total = float(times.sum())
    velocities = between_fixes.moved / total - np.diff(track.positions, axis=0) / times[:, None]
    velocity = times @ velocities / total
    ends = zip(track.samples[:-1], track.samples[1:], velocities, strict=True)
    segments = tuple(DriftSegment(int(a), int(b), v) for a, b, v in ends)
    drift = Drift(
        velocity, track.total, total, between_fixes.variance, track.bridged,
        np.zeros((2, 2)) if track_covariance is None else track_covariance, with_hull=track_covariance is not None,
    )  # fmt: skip
    covariance = current_uncertainty(drift, errors).covariance
    return DepthAveragedCurrent(velocity, covariance, drift, segments, between_fixes.entry, between_fixes.exit)


def describe_implausible_current(velocity: Array) -> list[str]:
    """Remark on a current ``(2,)`` (m/s) that is so strong that a fix may be wrong; empty for weaker ones."""
    speed = float(np.linalg.norm(velocity))
    if not speed > STRONG:
        return []
    return [f"a current of {speed:.1f} m/s: check the fixes before and after the dive unless currents are strong here"]


def cycles_of(series: ProfileSeries) -> NDArray[np.int64]:
    """Samples ``(k+1,)`` between which the dive-climb cycles lie: first 0, last n (section 4.4)."""
    candidates = cycle_boundaries(series.measurements[:, 3])
    min_steps = round(MIN_CYCLE / series.step)
    boundaries = [0]
    for sample in candidates[1:-1]:
        if sample - boundaries[-1] >= min_steps and candidates[-1] - sample >= min_steps:
            boundaries.append(int(sample))
    return np.array([*boundaries, int(candidates[-1])], dtype=np.int64)


def single_cycle(series: ProfileSeries) -> NDArray[np.int64]:
    """Samples ``(2,)`` at both ends of a profile, the boundaries of a single cycle."""
    return np.array([0, len(series.time) - 1])


def current_from_displacement(
    record: ProfileRecord,
    clock: Array,
    displacement: Array,
    displacement_covariance: Array,
    errors: CurrentErrors,
    *,
    with_hull: bool = False,
) -> DepthAveragedCurrent | None:
    """Compute the current from a displacement through the water, or None unless both sides have a fix.

    Parameters
    ----------
    record : ProfileRecord
        Fixes before and after the profile.
    clock : (k,)
        Times, s since the profile's first sample; first and last are those of the profile.
    displacement, displacement_covariance : (2,), (2, 2)
        Displacement north and east from the profile's start to its end, and its covariance, m and m2.
    errors : CurrentErrors
        Terms of the uncertainty.
    with_hull : bool
        Whether the covariance contains the hull's errors.

    Notes
    -----
    ``V = (dX_GPS - dX_surface - dX) / T``, with the drift at the surface removed as in `depth_averaged_current`. X and
    Y of eq. 16 are north and east, like the geodesic's components. The smoother's own covariance contains the
    uncertainty from the disturbance prior and the sensors, without errors of the hull and the compass. These either are
    added to the covariance (`with_hull`) or enter through the terms of the budget (`current_uncertainty`). Vibration
    intervals are not bridged, because the smoother itself adds noise there.
    """
    between_fixes = _fix_to_fix_drift(record, clock, errors)
    if between_fixes is None:
        return None
    elapsed = between_fixes.end - between_fixes.begin
    velocity = (between_fixes.moved - displacement) / elapsed
    drift = Drift(
        velocity, displacement, elapsed, between_fixes.variance, 0.0, displacement_covariance, with_hull=with_hull
    )
    covariance = current_uncertainty(drift, errors).covariance
    return DepthAveragedCurrent(velocity, covariance, drift, (), between_fixes.entry, between_fixes.exit)


def with_disagreement(
    adjoint: DepthAveragedCurrent,
    smoothed: DepthAveragedCurrent,
    errors: CurrentErrors,
    other: DepthAveragedCurrent | None = None,
) -> tuple[DepthAveragedCurrent, DepthAveragedCurrent]:
    """Widen the covariances of one profile's two currents by the difference of two estimates (`current_uncertainty`).

    The difference is between the smoother's current and the adjoint's, or the `other` one if it is given, since windows
    that start from the smoothed path agree with it whether it is right or wrong. An adjoint whose track has the
    smoother's covariance is also uncertain by its own difference from the smoother.
    """
    adjoint_difference = adjoint.velocity - smoothed.velocity
    difference = adjoint_difference if other is None else other.velocity - smoothed.velocity
    departure = adjoint_difference if adjoint.drift.with_hull else np.zeros(2)
    drifts = [
        replace(adjoint.drift, disagreement=difference, departure=departure),
        replace(smoothed.drift, disagreement=difference),
    ]
    covariances = [current_uncertainty(drift, errors).covariance for drift in drifts]
    return (
        replace(adjoint, drift=drifts[0], covariance=covariances[0]),
        replace(smoothed, drift=drifts[1], covariance=covariances[1]),
    )


def surface_drift(fixes: tuple[Fix, ...]) -> SurfaceDrift | None:
    """Drift between the first and the last of consecutive surface fixes.

    The result is None unless two fixes are at least a minute apart, or if the drift exceeds `MAXIMUM_DRIFT`.
    """
    if len(fixes) < 2:
        return None
    elapsed = float((fixes[-1].time - fixes[0].time) / SECOND)
    if elapsed < MIN_DRIFT_TIME:
        return None
    velocity = local_displacement(fixes[0], fixes[-1]) / elapsed
    return SurfaceDrift(velocity, elapsed) if float(np.linalg.norm(velocity)) <= MAXIMUM_DRIFT else None


def mean_surface_drift(record: ProfileRecord) -> Array | None:
    """Return the mean (2,) of the drifts before and after a dive, north and east, m/s; None if both are unknown."""
    drifts = [surface_drift(fixes) for fixes in (record.surface_fixes_before, record.surface_fixes_after)]
    known = [drift.velocity for drift in drifts if drift is not None]
    return np.asarray(np.mean(known, axis=0)) if known else None


@dataclass(frozen=True, eq=False)
class _FixToFixDrift:
    """Displacement due to the current below, and the times when it begins and ceases to act (s of the record)."""

    moved: Array
    begin: float
    end: float
    entry: SurfaceInterval
    exit: SurfaceInterval

    @property
    def variance(self) -> float:
        """Sum of the variances of the positions where the current begins and ceases to act, per component (m2)."""
        return self.entry.variance + self.exit.variance


def _fix_to_fix_drift(record: ProfileRecord, clock: Array, errors: CurrentErrors) -> _FixToFixDrift | None:
    """Displacement and time from fix to fix less the drift at the surface, or None unless both sides have a fix."""
    begin, end = float(clock[0]), float(clock[-1])
    before, after = surface_interval_before(record, clock, errors), surface_interval_after(record, clock, errors)
    if record.entry_fix is None or record.exit_fix is None or before is None or after is None:
        return None
    return _FixToFixDrift(
        moved=local_displacement(record.entry_fix, record.exit_fix) - before.displacement - after.displacement,
        begin=begin - before.duration + before.drift_removed,
        end=end + after.duration - after.drift_removed,
        entry=before,
        exit=after,
    )


def surface_interval_before(record: ProfileRecord, clock: Array, errors: CurrentErrors) -> SurfaceInterval | None:
    """Return the interval between the last fix before a dive and its start, or None without a fix.

    `clock` are times (s since the profile's first sample), of which the first and the last are those of the dive.
    """
    if record.entry_fix is None:
        return None
    duration = float(clock[0]) - _seconds(record.entry_fix, record)
    unrecorded = distance_to_surface(*_rows_within(record, clock), duration, "start") ** 2
    return _surface_interval(duration, record.surface_fixes_before, unrecorded, errors)


def surface_interval_after(record: ProfileRecord, clock: Array, errors: CurrentErrors) -> SurfaceInterval | None:
    """Return the interval between the end of a dive and the first fix after it (`surface_interval_before`)."""
    if record.exit_fix is None:
        return None
    duration = _seconds(record.exit_fix, record) - float(clock[-1])
    unrecorded = distance_to_surface(*_rows_within(record, clock), duration, "end") ** 2
    return _surface_interval(duration, record.surface_fixes_after, unrecorded, errors)


def _rows_within(record: ProfileRecord, clock: Array) -> tuple[Array, Array, Array]:
    """Times, depth and pitch of a record's rows from the first to the last of some times."""
    rows = (record.time >= clock[0]) & (record.time <= clock[-1])
    return record.time[rows], record.depth[rows], record.pitch[rows]


def _surface_interval(
    duration: float, fixes: tuple[Fix, ...], unrecorded: float, errors: CurrentErrors
) -> SurfaceInterval:
    drift, duration = surface_drift(fixes), max(duration, 0.0)
    if drift is None:
        variance = _position_variance(duration, 0.0, 0.0, errors) + unrecorded
        return SurfaceInterval(duration, 0.0, np.zeros(2), variance)
    drift_removed = drift.weight(errors) * duration
    variance = _position_variance(duration, drift_removed, drift_removed / drift.duration, errors) + unrecorded
    return SurfaceInterval(duration, drift_removed, drift_removed * drift.velocity, variance)


def surface_variance(duration: float, drift_removed: float, errors: CurrentErrors) -> float:
    """Variance (m2) of the position where the drift of a dive begins or ends, from surface times in an archive.

    Parameters
    ----------
    duration, drift_removed : float
        Time between fix and dive, and the part that the drift measured at the surface covers, s. Their ratio gives the
        weight of that drift (`SurfaceDrift.weight`), from which the time between its fixes follows.
    errors : CurrentErrors
        Terms with which the run was made.
    """
    if not 0.0 < drift_removed < duration or errors.fix_error == 0.0:
        return _position_variance(duration, drift_removed, 0.0, errors)
    error = errors.surface_shear * np.sqrt(duration / drift_removed - 1.0)
    return _position_variance(
        duration, drift_removed, drift_removed * error / (np.sqrt(2.0) * errors.fix_error), errors
    )


def _position_variance(duration: float, drift_removed: float, ratio: float, errors: CurrentErrors) -> float:
    """Variance (m2) from the fixes, and from the difference between drift and current below over the remaining time.

    The fix next to the dive is one of the two from which the drift is measured. Its error therefore also enters the
    removed drift, times the `ratio` of the time removed to the time between the two fixes.
    """
    measured = errors.fix_error**2 * ((1.0 + ratio) ** 2 + ratio**2)
    return float(measured + ((duration - drift_removed) * errors.surface_shear) ** 2)


def _seconds(fix: Fix, record: ProfileRecord) -> float:
    return float((fix.time - record.epoch) / SECOND)


# Columns of fixes and currents, as archives and the light currents store them


def fix_row(end: str, fix: Fix) -> Row:
    """Return the time and the place of the fix at one end of a profile, ``entry`` or ``exit``."""
    return {f"{end}_time": fix.time, f"{end}_latitude": fix.latitude, f"{end}_longitude": fix.longitude}


def component_row(current: DepthAveragedCurrent, name: str) -> Row:
    """Return the components of a current; `name` is the columns' name with ``{}`` for the direction."""
    north, east = current.velocity.tolist()
    return {name.format("north"): north, name.format("east"): east}


def current_row(current: DepthAveragedCurrent, name: str, covariance: str) -> Row:
    """Return a current with its standard deviations and its covariance."""
    north, east = np.sqrt(np.diag(current.covariance)).tolist()
    deviations = {f"{name.format('north')}_std": north, f"{name.format('east')}_std": east}
    return component_row(current, name) | deviations | {covariance: float(current.covariance[0, 1])}


def surface_drift_row(record: ProfileRecord) -> Row:
    """Return the mean drift at the surface around a profile; empty if it is not known."""
    drift = mean_surface_drift(record)
    return {} if drift is None else {"surface_drift_north": float(drift[0]), "surface_drift_east": float(drift[1])}
