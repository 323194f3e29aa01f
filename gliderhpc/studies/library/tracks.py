"""Tracks anchored by the fixes before and after a dive (X and Y panels of Figure 2), and the archive's currents."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData
from gliderhpc.archive.reader import Archive
from gliderhpc.estimation.current_errors import Drift
from gliderhpc.estimation.currents import local_displacement, surface_variance
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion, model_motion
from gliderhpc.observations import Fix
from gliderhpc.observations.dive_phases import unrecorded_variance
from gliderhpc.observations.fixes import moved
from gliderhpc.observations.times import SECOND
from gliderhpc.platform import Platform
from gliderhpc.store_schema.digests import digest_of
from gliderhpc.studies.archived import platform_of, series_of, settings_of, states_of
from gliderhpc.studies.library.scores import covariance_matrix

Array = NDArray[np.float64]

_KNOTS = 60.0

CURRENTS = "currents"
"""Name of the study of currents, and of its group."""

HULL = "hull"
"""Name of the group with the hull's information."""

BY_GLIDE_ANGLE = ("dac_north_glide_angle", "dac_east_glide_angle")
"""Columns of the conventional estimate, which has no uncertainty."""


@dataclass(frozen=True, eq=False)
class Motions:
    """Displacements of a profile through the water on the records, from the estimate and from the glide angle."""

    estimate: SelfMotion
    glide_angle: SelfMotion


def motions_of(data: ProfileData, platform: Platform) -> Motions:
    """Return both self-motions, with the vibration intervals bridged."""
    vibrating = data.on_records(data.flagged("vibration"))
    series = series_of(data, platform)
    return Motions(
        model_motion(states_of(data), vibrating, series.step), glide_angle_motion(platform, series, vibrating)
    )


@dataclass(frozen=True, eq=False)
class AnchoredTracks:
    """Two tracks over the ground, north and east of the entry fix.

    Attributes
    ----------
    estimate, glide_angle : (m, 2) arrays
        Tracks on the records, m.
    fix_time : (2,) array
        Times of the entry and exit fixes, s since the profile's first sample.
    fixes : (2, 2) array
        Positions of these fixes, m.
    """

    estimate: Array
    glide_angle: Array
    fix_time: Array
    fixes: Array

    @property
    def spread(self) -> float:
        """Root mean square distance between the two tracks, m."""
        return float(np.sqrt(np.mean(((self.estimate - self.glide_angle) ** 2).sum(axis=1))))


def anchored_tracks(
    archive: Archive, data: ProfileData, model: SelfMotion, conventional: SelfMotion
) -> AnchoredTracks | None:
    """Add to each self-motion the drift that closes it on the fixes; None unless both fixes exist.

    The adjoint's track has a separate drift for each dive-climb cycle (eqs. 39 and 40); the other tracks have a single
    drift. The surface drift that the archive has removed lies between the fixes and the ends of the tracks, in time and
    in place.
    """
    anchors = anchors_of(data)
    if anchors is None:
        return None
    return AnchoredTracks(
        estimate=_track_of_estimate(archive, data, model, anchors),
        glide_angle=anchors.before + _close_on_fixes(track_of(conventional), data, anchors),
        fix_time=anchors.clock,
        fixes=np.array([[0.0, 0.0], anchors.between]),
    )


def estimated_positions(archive: Archive, data: ProfileData, model: SelfMotion) -> Array | None:
    """Latitude and longitude ``(m, 2)`` (degree) of the records on the estimate's track; None without the fixes.

    Longitudes are continuous across the antimeridian. One position per minute is computed on the WGS84 ellipsoid, from
    distance and azimuth relative to the entry fix, like the distance between the fixes. Positions in between are
    interpolated linearly: a glider moves some 20 m in a minute, over which the error is a few micrometres.
    """
    anchors, entry = anchors_of(data), fix_of(data.table, "entry")
    if anchors is None or entry is None:
        return None
    track, time = _track_of_estimate(archive, data, model, anchors), data.record_time
    knots = np.append(np.arange(time[0], time[-1], _KNOTS), time[-1])
    on_knots = np.array([[np.interp(knot, time, axis) for axis in track.T] for knot in knots])
    places = np.array([moved((entry.latitude, entry.longitude), offset) for offset in on_knots])
    latitude, longitude = places[:, 0], np.unwrap(places[:, 1], period=360.0)
    return np.column_stack([np.interp(time, knots, axis) for axis in (latitude, longitude)])


@dataclass(frozen=True, eq=False)
class Anchors:
    """Constraints of a track: times of the fixes (s of the record), displacement between them, drift at the surface.

    The current below the surface acts between the two times `acts`. The surface drift after the entry fix is `before`
    (2,), and `moved` (2,) is the displacement from its end to the beginning of the surface drift after the dive, m.
    """

    clock: Array
    acts: Array
    between: Array
    before: Array
    moved: Array


def anchors_of(data: ProfileData) -> Anchors | None:
    """Find the constraints of a profile's tracks; None unless both fixes exist."""
    table = data.table
    entry, leave = fix_of(table, "entry"), fix_of(table, "exit")
    if entry is None or leave is None:
        return None
    clock = np.array([float((fix.time - data.epoch) / SECOND) for fix in (entry, leave)])
    between = local_displacement(entry, leave)
    before, after = (_surface_drift(table, end) for end in ("entry", "exit"))
    acts = clock + np.array([_surface_time(table, "entry"), -_surface_time(table, "exit")])
    return Anchors(clock, acts, between, before, between - before - after)


def _track_of_estimate(archive: Archive, data: ProfileData, model: SelfMotion, anchors: Anchors) -> Array:
    """Track ``(m, 2)`` of the estimate, with a separate drift for each cycle if it is the adjoint's."""
    track = track_of(model)
    if data.estimate == ADJOINT:
        return np.asarray(anchors.before + track + _cycle_drift(archive, data, anchors.acts))
    return np.asarray(anchors.before + _close_on_fixes(track, data, anchors))


def track_of(motion: SelfMotion) -> Array:
    """Track ``(m, 2)`` of a self-motion, m from its start."""
    return np.concatenate([np.zeros((1, 2)), np.cumsum(motion.steps, axis=0)])


def _close_on_fixes(track: Array, data: ProfileData, anchors: Anchors) -> Array:
    """Track ``(m, 2)`` with the constant drift between two times that closes it on the fixes."""
    drift = (anchors.moved - track[-1]) / (anchors.acts[1] - anchors.acts[0])
    return np.asarray(track + drift * (data.record_time - anchors.acts[0])[:, None])


def _surface_time(table: Mapping[str, Any], end: str) -> float:
    """Time at the surface that was removed (s); zero in archives that do not record it."""
    return float(np.nan_to_num(table.get(f"{end}_surface_time", 0.0)))


def _surface_drift(table: Mapping[str, Any], end: str) -> Array:
    """Drift at the surface that was removed ``(2,)`` (m)."""
    return np.array([float(np.nan_to_num(table.get(f"{end}_surface_{along}", 0.0))) for along in ("north", "east")])


def _cycle_drift(archive: Archive, data: ProfileData, clock: Array) -> Array:
    """Displacement ``(m, 2)`` due to the cycles' drift, which acts between the two times `clock`."""
    cycles = archive["drift_current"].to_dataset().sel(profile=data.number).load()
    known = np.flatnonzero(np.isfinite(cycles["north"].values))
    velocity = np.column_stack([cycles[name].values[known] for name in ("north", "east")])
    boundaries = data.time[cycles["start"].values[known].astype(np.int64)]
    times = np.concatenate([[min(boundaries[0], clock[0])], boundaries[1:], [max(data.time[-1], clock[1])]])
    moved = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity * np.diff(times)[:, None], axis=0)])
    return np.column_stack([np.interp(data.record_time, times, column) for column in moved.T])


def fix_of(table: Mapping[str, Any], end: str) -> Fix | None:
    """Entry or exit fix in a profile's row of the archive's table; None if it has none."""
    values = {name: table[f"{end}_{name}"] for name in ("time", "latitude", "longitude")}
    if np.isnat(values["time"]) or not np.isfinite(values["latitude"] + values["longitude"]):
        return None
    return Fix(values["time"], float(values["latitude"]), float(values["longitude"]))


@dataclass(frozen=True, eq=False)
class DivePath:
    """Positions and times along a dive.

    Attributes
    ----------
    time : (m,) datetime64 array
        Times.
    depth : (m,) array
        Depths, m, positive down.
    latitude, longitude : (m,) arrays
        Positions, degree; longitudes in any branch.
    """

    time: NDArray[Any]
    depth: Array
    latitude: Array
    longitude: Array


def dive_path(archive: Archive, data: ProfileData) -> DivePath | None:
    """Path of a profile, dead-reckoned between its fixes, with a position per record; None unless both fixes exist.

    Measured depth is interpolated over gaps, and negative depths are set to zero.
    """
    vibrating = data.on_records(data.flagged("vibration"))
    motion = model_motion(states_of(data), vibrating, float(data.attributes["output_interval"]))
    positions = estimated_positions(archive, data, motion)
    known = np.isfinite(data.measured[:, 3])
    if positions is None or not known.any():
        return None
    depth = np.interp(data.record_time, data.record_time[known], data.measured[known, 3])
    nanoseconds = np.round(data.record_time * 1e9).astype("timedelta64[ns]")
    return DivePath(data.epoch + nanoseconds, np.maximum(depth, 0.0), *positions.T)


class CurrentColumns(NamedTuple):
    """Columns of a depth-averaged current in the mission's table: components, standard deviations and covariance."""

    north: str
    east: str
    north_std: str
    east_std: str
    covariance: str


BY_ADJOINT = CurrentColumns("dac_north", "dac_east", "dac_north_std", "dac_east_std", "dac_covariance")
BY_SMOOTHER = CurrentColumns(
    "dac_north_smoothed",
    "dac_east_smoothed",
    "dac_north_smoothed_std",
    "dac_east_smoothed_std",
    "dac_smoothed_covariance",
)
BY_FILTER = ("dac_north_filter", "dac_east_filter")
"""Columns of the filter's current, which has no uncertainty."""


def current_columns(estimate: str) -> CurrentColumns:
    """Return the columns of the current that follows from an estimate's self-motion."""
    return BY_SMOOTHER if estimate == SMOOTHED else BY_ADJOINT


def archived_drift(archive: Archive, data: ProfileData, estimate: str, *, by_hull: bool = True) -> Drift | None:
    """Rebuild the drift of one profile's current by an estimate; None if the archive has no such current.

    The displacement's covariance contains the hull's errors if it did in the run, unless `by_hull` is false. The
    displacement through the water is computed as the displacement between the fixes minus that due to the current. It
    is therefore the run's displacement, with the same intervals bridged.
    """
    smoothed = estimate == SMOOTHED
    velocity = _velocity(data, current_columns(estimate))
    anchors = anchors_of(data)
    if anchors is None or not np.isfinite(velocity).all():
        return None
    begin, end = anchors.acts.tolist()
    settings = settings_of(archive).current
    errors = settings.errors(platform_of(archive))
    hull = _hull_covariance(archive, data.number)
    with_hull = by_hull and settings.by_hull and bool(np.isfinite(hull).all())
    before, after = data.time[0] - anchors.clock[0], anchors.clock[1] - data.time[-1]
    drift_removed = anchors.acts - anchors.clock
    variance = surface_variance(max(float(before), 0.0), float(drift_removed[0]), errors)
    variance += surface_variance(max(float(after), 0.0), float(-drift_removed[1]), errors)
    depth, pitch = data.measured[:, 3], np.radians(data.measured[:, 1])
    variance += sum(unrecorded_variance(data.record_time, depth, pitch, (float(before), float(after))))
    differences = _differences(data, with_adjoint=with_hull and not smoothed)
    return Drift(
        velocity=velocity,
        track=anchors.moved - velocity * (end - begin),
        elapsed=end - begin,
        position_variance=variance,
        bridged=0.0 if smoothed else float(np.nan_to_num(data.table["vibration_displacement"])),
        track_covariance=_track_covariance(archive, data.number, hull, with_hull=with_hull, smoothed=smoothed),
        with_hull=with_hull,
        disagreement=differences[0],
        departure=differences[1],
    )


def _velocity(data: ProfileData, columns: Sequence[str]) -> Array:
    """Velocity ``(2,)`` (m/s) from the first two columns, NaN if the run stored none."""
    return np.array([float(data.table.get(name, np.nan)) for name in columns[:2]])


def _differences(data: ProfileData, *, with_adjoint: bool) -> tuple[Array, Array]:
    """Differences (2,) (m/s) from the smoother's current: the second estimate's and, if `with_adjoint`, the adjoint's.

    The second estimate is the filter if the run stored its current, else the adjoint. Missing currents differ by zero.
    """
    by_smoother = _velocity(data, BY_SMOOTHER)
    by_adjoint, by_filter = (_velocity(data, columns) - by_smoother for columns in (BY_ADJOINT, BY_FILTER))
    second = by_filter if np.isfinite(by_filter).all() else by_adjoint
    return np.nan_to_num(second), np.nan_to_num(by_adjoint) if with_adjoint else np.zeros(2)


def _track_covariance(archive: Archive, number: int, hull: Array, *, with_hull: bool, smoothed: bool) -> Array:
    """Covariance ``(2, 2)`` (m2) of the displacement, with or without the hull's part."""
    if with_hull:
        return _smoothed_covariance(archive, number)
    return _smoothed_covariance(archive, number) - np.nan_to_num(hull) if smoothed else np.zeros((2, 2))


def _hull_covariance(archive: Archive, number: int) -> Array:
    """Hull's part ``(2, 2)`` (m2) of the displacement's covariance; NaN if there is none."""
    if HULL not in archive.children:
        return np.full((2, 2), np.nan)
    return np.asarray(archive[HULL].to_dataset()["displacement_covariance"].sel(profile=number).values)


def _smoothed_covariance(archive: Archive, number: int) -> Array:
    """Covariance ``(2, 2)`` (m2) of the smoother's displacement."""
    row = archive[SMOOTHED].to_dataset().sel(profile=number)
    names = ("displacement_north_std", "displacement_east_std", "displacement_covariance")
    return covariance_matrix(*(row[name] for name in names))


@dataclass(frozen=True, eq=False)
class UncertainCurrent:
    """A depth-averaged current with its uncertainty.

    Attributes
    ----------
    velocity : (2,) array
        North and east components, m/s.
    covariance : (2, 2) array
        Covariance of the components, m2/s2.
    """

    velocity: Array
    covariance: Array


def archived_currents(archive: Archive, numbers: Sequence[int], estimate: str) -> list[UncertainCurrent]:
    """Read the currents of some profiles that follow from an estimate's self-motion.

    The covariance is that of study ``currents``, which can use a budget, for the profiles and the estimate that the
    study was run for. In other cases it is that of the mission's run.
    """
    table = archive.to_dataset().sel(profile=list(numbers)).load()
    columns = current_columns(estimate)
    north, east, first, second, between = (table[name].values for name in columns)
    if has_currents_study(archive, estimate):
        study = archive[CURRENTS].to_dataset().sel(profile=list(numbers)).load()
        known = np.isfinite(study["current_covariance"].values)
        between = np.where(known, study["current_covariance"].values, between)
        first = np.where(known, study["current_north_std"].values, first)
        second = np.where(known, study["current_east_std"].values, second)
    velocities, covariances = np.column_stack([north, east]), covariance_matrix(first, second, between)
    return [UncertainCurrent(velocities[i], covariances[i]) for i in range(len(numbers))]


def has_currents_study(archive: Archive, estimate: str) -> bool:
    """Return whether study ``currents`` has been run for an estimate."""
    return CURRENTS in archive.children and archive[CURRENTS].attrs.get("estimate", ADJOINT) == estimate


def ellipses_used(archive: Archive, estimate: str) -> dict[str, Any]:
    """Return attributes by which a study that used the ellipses of study ``currents`` recognises a later run of it."""
    if not has_currents_study(archive, estimate):
        return {"ellipses_of_study": False, "ellipses_digest": ""}
    study = archive[CURRENTS].to_dataset()
    names = ("current_north_std", "current_east_std", "current_covariance")
    values = np.stack([study[name].values for name in names]).astype("<f8")
    return {"ellipses_of_study": True, "ellipses_digest": digest_of(values.tobytes())}
