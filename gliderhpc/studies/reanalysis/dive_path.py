"""Where and when a glider was during a dive: what a model is asked about."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ProfileData
from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.studies.archived import states_of
from gliderhpc.studies.library.anchored_track import estimated_positions

Array = NDArray[np.float64]


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
    shaken = data.on_records(data.flagged("vibration"))
    motion = model_motion(states_of(data), shaken, float(data.attributes["output_interval"]))
    positions = estimated_positions(archive, data, motion)
    known = np.isfinite(data.measured[:, 3])
    if positions is None or not known.any():
        return None
    depth = np.interp(data.record_time, data.record_time[known], data.measured[known, 3])
    nanoseconds = np.round(data.record_time * 1e9).astype("timedelta64[ns]")
    return DivePath(data.epoch + nanoseconds, np.maximum(depth, 0.0), *positions.T)
