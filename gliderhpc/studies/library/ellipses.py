"""The depth-averaged currents of an archive with their ellipses: those of study ``currents`` where it has been run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT

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
    if studied(archive, estimate):
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


def studied(archive: xr.DataTree, estimate: str) -> bool:
    """Whether study ``currents`` has been run for an estimate."""
    return STUDY in archive.children and archive[STUDY].attrs.get("estimate", ADJOINT) == estimate
