"""Horizontal tracks anchored by the fixes on either side of a dive (Figure 2's X and Y panels)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.estimation.currents import local_displacement
from gliderhpc.estimation.self_motion import SelfMotion
from gliderhpc.mission.profile_data import ADJOINT, ProfileData
from gliderhpc.observations import Fix

Array = NDArray[np.float64]

_SECOND = np.timedelta64(1, "s")


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
    table = data.table
    ends = [fix_of(table, "entry"), fix_of(table, "exit")]
    if ends[0] is None or ends[1] is None:
        return None
    clock = np.array([float((fix.time - data.epoch) / _SECOND) for fix in ends if fix is not None])
    between = local_displacement(ends[0], ends[1])
    before, after = (_surface_drift(table, end) for end in ("entry", "exit"))
    acts = clock + np.array([_surface_time(table, "entry"), -_surface_time(table, "exit")])
    moved = between - before - after
    track, cycles = track_of(model), data.estimate == ADJOINT
    return AnchoredTracks(
        estimate=before + (track + _cycle_drift(archive, data, acts) if cycles else _closed(track, data, acts, moved)),
        glide_angle=before + _closed(track_of(conventional), data, acts, moved),
        fix_time=clock,
        fixes=np.array([[0.0, 0.0], between]),
    )


def track_of(motion: SelfMotion) -> Array:
    """Track ``(m, 2)`` of a self-motion, m from its start."""
    return np.concatenate([np.zeros((1, 2)), np.cumsum(motion.steps, axis=0)])


def _closed(track: Array, data: ProfileData, acts: Array, moved: Array) -> Array:
    """Track ``(m, 2)`` with the one drift, acting between two times, that closes it."""
    drift = (moved - track[-1]) / (acts[1] - acts[0])
    return np.asarray(track + drift * (data.record_time - acts[0])[:, None])


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
