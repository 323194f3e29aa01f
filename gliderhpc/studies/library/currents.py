"""Depth-averaged currents of an archive: their ellipses, and the terms that their uncertainty is computed from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT, SMOOTHED, ProfileData
from gliderhpc.estimation.current_errors import Drift
from gliderhpc.estimation.currents import surface_variance
from gliderhpc.studies.archived import platform_of, settings_of
from gliderhpc.studies.library.tracks import anchors_of

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
    drift_removed = anchors.acts - anchors.clock
    variance = surface_variance(max(float(before), 0.0), float(drift_removed[0]), errors)
    variance += surface_variance(max(float(after), 0.0), float(-drift_removed[1]), errors)
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


Array = NDArray[np.float64]

STUDY = "currents"
_COMPONENTS = ("north", "east")


@dataclass(frozen=True, eq=False)
class Current:
    """A depth-averaged current with its uncertainty.

    Attributes
    ----------
    velocity : (2,) array
        North and east, m/s.
    covariance : (2, 2) array
        m2/s2.
    """

    velocity: Array
    covariance: Array


def archived_currents(archive: xr.DataTree, numbers: Sequence[int], estimate: str) -> list[Current]:
    """Read the currents of some profiles, by an estimate's self-motion.

    The ellipse is that of study ``currents`` for the profiles and the estimate that it was run for: it knows a budget,
    the fixes and the actuators; for others it is the one that the mission's run left.
    """
    table = archive.to_dataset().sel(profile=list(numbers)).load()
    of = "" if estimate == ADJOINT else f"_{estimate}"
    north, east = (table[f"dac_{along}{of}"].values.astype(np.float64) for along in _COMPONENTS)
    deviations = [table[f"dac_{along}{of}_std"].values for along in _COMPONENTS]
    between = table[f"dac{of}_covariance"].values
    if has_currents_study(archive, estimate):
        study = archive[STUDY].to_dataset().sel(profile=list(numbers)).load()
        known = np.isfinite(study["current_covariance"].values)
        between = np.where(known, study["current_covariance"].values, between)
        deviations = [
            np.where(known, study[f"current_{along}_std"].values, deviation)
            for along, deviation in zip(_COMPONENTS, deviations, strict=True)
        ]
    first, second = deviations
    return [
        Current(np.array([north[i], east[i]]), np.array([[first[i] ** 2, between[i]], [between[i], second[i] ** 2]]))
        for i in range(len(numbers))
    ]


def has_currents_study(archive: xr.DataTree, estimate: str) -> bool:
    """Return whether study ``currents`` has been run for an estimate."""
    return STUDY in archive.children and archive[STUDY].attrs.get("estimate", ADJOINT) == estimate
