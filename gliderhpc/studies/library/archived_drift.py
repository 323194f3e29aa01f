"""What an archive's depth-averaged currents were made from, so that their uncertainty can be stated again."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import SMOOTHED, ProfileData
from gliderhpc.estimation.current_errors import Drift
from gliderhpc.estimation.currents import surface_variance
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.anchored_track import anchors_of

_NOTHING = np.zeros((2, 2))


def archived_drift(archive: xr.DataTree, data: ProfileData, estimate: str) -> Drift | None:
    """Rebuild the drift of one profile's current by an estimate; None where the archive has no such current.

    The displacement through the water is what the current leaves of the way between the fixes, so it is that of the
    run, with the intervals bridged that the run bridged.
    """
    smoothed = estimate == SMOOTHED
    by_adjoint, by_smoother = (_velocity(data, suffix) for suffix in ("", "_smoothed"))
    velocity = by_smoother if smoothed else by_adjoint
    anchors = anchors_of(data)
    if anchors is None or not np.isfinite(velocity).all():
        return None
    begin, end = anchors.acts.tolist()
    errors = settings_of(archive).current.errors(platform_of(archive))
    before, after = data.time[0] - anchors.clock[0], anchors.clock[1] - data.time[-1]
    taken_out = anchors.acts - anchors.clock
    variance = surface_variance(max(float(before), 0.0), float(taken_out[0]), errors)
    variance += surface_variance(max(float(after), 0.0), float(-taken_out[1]), errors)
    return Drift(
        velocity=velocity,
        track=anchors.moved - velocity * (end - begin),
        elapsed=end - begin,
        position_variance=variance,
        bridged=0.0 if smoothed else float(np.nan_to_num(data.table["vibration_displacement"])),
        track_covariance=_smoothed_covariance(archive, data.number) if smoothed else _NOTHING,
        disagreement=np.nan_to_num(by_adjoint - by_smoother),
    )


def _velocity(data: ProfileData, suffix: str) -> NDArray[np.float64]:
    return np.array([float(data.table.get(f"dac_{along}{suffix}", np.nan)) for along in ("north", "east")])


def _smoothed_covariance(archive: xr.DataTree, number: int) -> NDArray[np.float64]:
    """Covariance ``(2, 2)`` (m2) of the displacement as the smoother states it."""
    row = archive[SMOOTHED].to_dataset().sel(profile=number)
    north, east, between = (
        float(row[f"displacement_{name}"]) for name in ("north_std", "east_std", "covariance")
    )  # fmt: skip
    return np.array([[north**2, between], [between, east**2]])
