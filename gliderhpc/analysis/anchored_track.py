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
    """
    table = data.table
    ends = [_fix(table, "entry"), _fix(table, "exit")]
    if ends[0] is None or ends[1] is None:
        return None
    clock = np.array([float((fix.time - data.epoch) / _SECOND) for fix in ends if fix is not None])
    moved = local_displacement(ends[0], ends[1])
    track = _positions(model)
    cycles = data.estimate == ADJOINT
    return AnchoredTracks(
        estimate=track + _cycle_drift(archive, data, clock) if cycles else _closed(track, data, clock, moved),
        glide_angle=_closed(_positions(conventional), data, clock, moved),
        fix_time=clock,
        fixes=np.array([[0.0, 0.0], moved]),
    )


def _positions(motion: SelfMotion) -> Array:
    return np.concatenate([np.zeros((1, 2)), np.cumsum(motion.steps, axis=0)])


def _closed(track: Array, data: ProfileData, clock: Array, moved: Array) -> Array:
    """Track ``(m, 2)`` with the one drift that closes it."""
    drift = (moved - track[-1]) / (clock[1] - clock[0])
    return np.asarray(track + drift * (data.record_time - clock[0])[:, None])


def _cycle_drift(archive: xr.DataTree, data: ProfileData, clock: Array) -> Array:
    """Displacement ``(m, 2)`` by the cycles' drift since the entry fix, on the records."""
    cycles = archive["drift_current"].to_dataset().sel(profile=data.number).load()
    known = np.flatnonzero(np.isfinite(cycles["north"].values))
    velocity = np.column_stack([cycles[name].values[known] for name in ("north", "east")])
    boundaries = data.time[cycles["start"].values[known].astype(np.int64)]
    times = np.concatenate([[min(boundaries[0], clock[0])], boundaries[1:], [max(data.time[-1], clock[1])]])
    moved = np.concatenate([np.zeros((1, 2)), np.cumsum(velocity * np.diff(times)[:, None], axis=0)])
    return np.column_stack([np.interp(data.record_time, times, column) for column in moved.T])


def _fix(table: Mapping[str, Any], end: str) -> Fix | None:
    values = {name: table[f"{end}_{name}"] for name in ("time", "latitude", "longitude")}
    if np.isnat(values["time"]) or not np.isfinite(values["latitude"] + values["longitude"]):
        return None
    return Fix(values["time"], float(values["latitude"]), float(values["longitude"]))
