"""The currents of a mission's profiles side by side: the glider's by two self-motions, and every model's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.studies.library.ellipses import Current, archived_currents

Array = NDArray[np.float64]

PANELS = 9
"""Profiles of Table 4 and Figure 8."""


@dataclass(frozen=True, eq=False)
class Compared:
    """Depth-averaged currents, north and east in m/s, NaN where there is none.

    Attributes
    ----------
    numbers : (n,) int array
        Of the profiles.
    days : (n,) array
        Since the mission's first observation.
    estimate : str
        Whose self-motion `currents` rest on.
    currents : sequence of Current
        The glider's, with covariance.
    glide_angle : (n, 2) array
        The conventional estimate.
    names : tuple of str
        Of the models.
    models : (n, m, 2) array
    distance : (n, m) array
        Of each model from the glider's current, standard deviations.
    """

    numbers: NDArray[np.int64]
    days: Array
    estimate: str
    currents: Sequence[Current]
    glide_angle: Array
    names: tuple[str, ...]
    models: Array
    distance: Array

    @property
    def glider(self) -> Array:
        """The glider's currents ``(n, 2)``."""
        return np.array([current.velocity for current in self.currents]).reshape(-1, 2)

    def panels(self) -> list[int]:
        """Places of up to nine profiles, evenly spread over those that a model covers, else over those with a current.

        Empty where no profile has a current.
        """
        known = np.isfinite(self.glider).all(axis=1)
        covered = known & np.isfinite(self.models.sum(axis=2)).any(axis=1)
        places = np.flatnonzero(covered if covered.any() else known)
        if not places.size:
            return []
        even = np.linspace(0.0, places.size - 1.0, min(PANELS, places.size))
        return [int(place) for place in places[np.round(even).astype(np.int64)]]


def compare(archive: xr.DataTree, numbers: Sequence[int], estimate: str) -> Compared:
    """Put what an archive's group has of some profiles beside the archive's own currents."""
    group = archive["reanalysis"].to_dataset().sel(profile=list(numbers)).load()
    table = archive.to_dataset().sel(profile=list(numbers)).load()
    return Compared(
        numbers=np.array(numbers, dtype=np.int64),
        days=np.asarray(table["elapsed_days"].values, dtype=np.float64),
        estimate=estimate,
        currents=archived_currents(archive, numbers, estimate),
        glide_angle=np.column_stack([table[f"dac_{along}_glide_angle"].values for along in ("north", "east")]),
        names=tuple(str(name) for name in group["model"].values),
        models=np.stack([group["north"].values, group["east"].values], axis=-1),
        distance=np.asarray(group["distance"].values),
    )
