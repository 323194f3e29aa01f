"""Horizontal tracks anchored by the fixes on either side of a dive (Figure 2's X and Y panels)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT, ProfileData
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.self_motion import SelfMotion, model_motion
from gliderhpc.observations import Fix
from gliderhpc.observations.fixes import moved
from gliderhpc.studies.archived import states_of

Array = NDArray[np.float64]

_SECOND = np.timedelta64(1, "s")
_KNOTS = 60.0


@dataclass(frozen=True, eq=False)
class AnchoredTracks:
    """Two tracks over the ground, north and east of the entry fix.

    Attributes
    ----------
    estimate, glide_angle : (m, 2) arrays
        On the records, m.
    fix_time : (2,) array
        Of entry and exit fix, s since the profile's first sample.
    fixes : (2, 2) array
        Their positions, m.
    """

    estimate: Array
    glide_angle: Array
    fix_time: Array
    fixes: Array

    @property
    def spread(self) -> float:
        """Root mean square distance of the two, m."""
        return float(np.sqrt(np.mean(((self.estimate - self.glide_angle) ** 2).sum(axis=1))))


def anchored_tracks(
    archive: xr.DataTree, data: ProfileData, model: SelfMotion, conventional: SelfMotion
) -> AnchoredTracks | None:
    """Add to either self-motion the drift that closes it on the fixes, or None without a fix on either side.

    The adjoint's track takes the drift of each dive-climb cycle (eqs. 39 and 40), the other tracks one drift for all.
    What the archive says was taken out as drift at the surface lies between the fixes and the times and places at which
    the tracks begin and end.
    """
    anchors = anchors_of(data)
    if anchors is None:
        return None
    return AnchoredTracks(
        estimate=_estimated(archive, data, model, anchors),
        glide_angle=anchors.before + _closed(track_of(conventional), data, anchors),
        fix_time=anchors.clock,
        fixes=np.array([[0.0, 0.0], anchors.between]),
    )


def estimated_positions(archive: xr.DataTree, data: ProfileData, model: SelfMotion) -> Array | None:
    """Latitude and longitude ``(m, 2)`` (degree) of the records on the estimate's track, or None without the fixes.

    Longitudes run on across the antimeridian. The track is laid out on the WGS84 ellipsoid a minute at a time, by
    length and azimuth from the entry fix as the fixes' distance is measured, and is a straight line in between: a
    glider moves some 20 m in that time, over which the two differ by micrometres.
    """
    anchors, entry = anchors_of(data), fix_of(data.table, "entry")
    if anchors is None or entry is None:
        return None
    track, time = _estimated(archive, data, model, anchors), data.record_time
    knots = np.append(np.arange(time[0], time[-1], _KNOTS), time[-1])
    places = np.array([
        moved((entry.latitude, entry.longitude), np.array([np.interp(knot, time, axis) for axis in track.T]))
        for knot in knots
    ])  # fmt: skip
    latitude, longitude = places[:, 0], np.unwrap(places[:, 1], period=360.0)
    return np.column_stack([np.interp(time, knots, axis) for axis in (latitude, longitude)])


@dataclass(frozen=True, eq=False)
class Anchors:
    """Constraints of a track: the fixes' times (s of the record) and distance, and the drift at the surface.

    `acts` holds the times between which the current below acts; `before` (2,), `moved` (2,) are what the glider drifted
    before, and where it came to from there until the surface drift after the dive began, m.
    """

    clock: Array
    acts: Array
    between: Array
    before: Array
    moved: Array


def anchors_of(data: ProfileData) -> Anchors | None:
    """Find what holds a profile's tracks; None without a fix on either side."""
    table = data.table
    entry, leave = fix_of(table, "entry"), fix_of(table, "exit")
    if entry is None or leave is None:
        return None
    clock = np.array([float((fix.time - data.epoch) / _SECOND) for fix in (entry, leave)])
    between = local_displacement(entry, leave)
    before, after = (_surface_drift(table, end) for end in ("entry", "exit"))
    acts = clock + np.array([_surface_time(table, "entry"), -_surface_time(table, "exit")])
    return Anchors(clock, acts, between, before, between - before - after)


def _estimated(archive: xr.DataTree, data: ProfileData, model: SelfMotion, anchors: Anchors) -> Array:
    """The estimate's track ``(m, 2)``: with each cycle's own drift where it is the adjoint's."""
    track = track_of(model)
    if data.estimate == ADJOINT:
        return np.asarray(anchors.before + track + _cycle_drift(archive, data, anchors.acts))
    return np.asarray(anchors.before + _closed(track, data, anchors))


def track_of(motion: SelfMotion) -> Array:
    """Track ``(m, 2)`` of a self-motion, m from its start."""
    return np.concatenate([np.zeros((1, 2)), np.cumsum(motion.steps, axis=0)])


def _closed(track: Array, data: ProfileData, anchors: Anchors) -> Array:
    """Track ``(m, 2)`` with the one drift, acting between two times, that closes it."""
    drift = (anchors.moved - track[-1]) / (anchors.acts[1] - anchors.acts[0])
    return np.asarray(track + drift * (data.record_time - anchors.acts[0])[:, None])


def _surface_time(table: Mapping[str, Any], end: str) -> float:
    """Time taken out at the surface (s); none in archives that do not say so."""
    return float(np.nan_to_num(table.get(f"{end}_surface_time", 0.0)))


def _surface_drift(table: Mapping[str, Any], end: str) -> Array:
    """Drift taken out at the surface ``(2,)`` (m)."""
    return np.array([float(np.nan_to_num(table.get(f"{end}_surface_{along}", 0.0))) for along in ("north", "east")])


def _cycle_drift(archive: xr.DataTree, data: ProfileData, clock: Array) -> Array:
    """Displacement ``(m, 2)`` by the cycles' drift between the times at which it begins and ends to act."""
    cycles = archive["drift_current"].to_dataset().sel(profile=data.number).load()
    known = np.flatnonzero(np.isfinite(cycles["north"].values))
    velocity = np.column_stack([cycles[name].values[known] for name in ("north", "east")])
    boundaries = data.time[cycles["start"].values[known].astype(np.int64)]
    times = np.concatenate([[min(boundaries[0], clock[0])], boundaries[1:], [max(data.time[-1], clock[1])]])
    moved = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity * np.diff(times)[:, None], axis=0)])
    return np.column_stack([np.interp(data.record_time, times, column) for column in moved.T])


def fix_of(table: Mapping[str, Any], end: str) -> Fix | None:
    """Entry or exit fix in a profile's row of the archive's table, None where it has none."""
    values = {name: table[f"{end}_{name}"] for name in ("time", "latitude", "longitude")}
    if np.isnat(values["time"]) or not np.isfinite(values["latitude"] + values["longitude"]):
        return None
    return Fix(values["time"], float(values["latitude"]), float(values["longitude"]))


@dataclass(frozen=True, eq=False)
class DivePath:
    """Places and times.

    Attributes
    ----------
    time : (m,) datetime64 array
    depth : (m,) array
        m, positive down.
    latitude, longitude : (m,) arrays
        Degree, of any branch.
    """

    time: NDArray[Any]
    depth: Array
    latitude: Array
    longitude: Array


def dive_path(archive: xr.DataTree, data: ProfileData) -> DivePath | None:
    """Path of a profile, a place a record, dead-reckoned between its fixes; None without a fix on either side.

    Depth is the measured one, interpolated over gaps; a sensor that reads above the surface is at the surface.
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
