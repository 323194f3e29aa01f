"""Adopted depth-averaged current of reports and exports: the smoother's where it is usable, else the adjoint's.

Comparisons with known truth show that the smoothed current is more accurate. For the disturbances the adjoint remains
the primary estimate.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT, SMOOTHED

Array = NDArray[np.float64]

ESTIMATE_LABELS = {SMOOTHED: "from the smoother", ADJOINT: "from the adjoint", "": "unknown"}
"""Label of a current by its estimate."""


@dataclass(frozen=True, eq=False)
class AdoptedCurrent:
    """Depth-averaged currents of profiles, as arrays of the same shape; NaN where there is none.

    Attributes
    ----------
    north, east, north_std, east_std : (...) arrays
        Components and their standard deviations, m/s.
    covariance : (...) array
        Covariance of north and east, m2/s2.
    smoothed : (...) array of bool
        Mask of the smoother's currents.
    """

    north: Array
    east: Array
    north_std: Array
    east_std: Array
    covariance: Array
    smoothed: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the known currents."""
        return np.asarray(np.isfinite(self.north) & np.isfinite(self.east))

    @property
    def estimate(self) -> NDArray[np.str_]:
        """Name of the estimate of each current; empty if there is none."""
        return np.where(self.known, np.where(self.smoothed, SMOOTHED, ADJOINT), "")

    @property
    def label(self) -> str:
        """Label of the currents' estimates, with counts if they differ."""
        names = self.estimate[self.known].tolist()
        counts = {name: names.count(name) for name in (SMOOTHED, ADJOINT) if name in names}
        if len(counts) < 2:
            return ESTIMATE_LABELS[next(iter(counts), "")]
        return ", ".join(f"{count} {ESTIMATE_LABELS[name]}" for name, count in counts.items())


def adopted_current(table: Mapping[Any, Any]) -> AdoptedCurrent:
    """Select the current of every profile of an archive's table, or of one of its rows.

    Parameters
    ----------
    table : mapping of str to array_like
        Columns ``dac_*`` of the archive's root, as a Dataset or a row; absent columns are treated as missing. A
        smoothed current is present only if the smoother's outcome is usable.
    """

    def column(name: str) -> Array:
        return np.asarray(table.get(name, np.nan), dtype=np.float64)

    smoothed = np.isfinite(column("dac_north_smoothed")) & np.isfinite(column("dac_east_smoothed"))

    def select(smoothed_name: str, adjoint_name: str) -> Array:
        return np.asarray(np.where(smoothed, column(smoothed_name), column(adjoint_name)))

    return AdoptedCurrent(
        north=select("dac_north_smoothed", "dac_north"),
        east=select("dac_east_smoothed", "dac_east"),
        north_std=select("dac_north_smoothed_std", "dac_north_std"),
        east_std=select("dac_east_smoothed_std", "dac_east_std"),
        covariance=select("dac_smoothed_covariance", "dac_covariance"),
        smoothed=np.asarray(smoothed),
    )
