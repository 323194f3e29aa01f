"""The depth-averaged current that reports and exports take: the smoother's wherever it is usable, else the adjoint's.

On truth the smoothed current is the better one. The adjoint stays the method of record for the disturbances.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gliderhpc.archive.profile import ADJOINT, SMOOTHED

Array = NDArray[np.float64]

ESTIMATE_LABELS = {SMOOTHED: "by the smoother", ADJOINT: "by the inversion", "": "unknown"}
"""What a current is made by, in words."""


@dataclass(frozen=True, eq=False)
class TakenCurrent:
    """Currents of profiles, of any shape; NaN where there is none.

    Attributes
    ----------
    north, east, north_std, east_std : (...) arrays
        m/s.
    covariance : (...) array
        Of north and east, m2/s2.
    smoothed : (...) array of bool
        Where it is the smoother's.
    """

    north: Array
    east: Array
    north_std: Array
    east_std: Array
    covariance: Array
    smoothed: NDArray[np.bool_]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where there is a current."""
        return np.asarray(np.isfinite(self.north) & np.isfinite(self.east))

    @property
    def estimate(self) -> NDArray[np.str_]:
        """Name of the estimate that each is made by, empty where there is no current."""
        return np.where(self.known, np.where(self.smoothed, SMOOTHED, ADJOINT), "")

    @property
    def label(self) -> str:
        """Words on what the currents are made by, with counts where they differ."""
        names = self.estimate[self.known].tolist()
        counts = {name: names.count(name) for name in (SMOOTHED, ADJOINT) if name in names}
        if len(counts) < 2:
            return ESTIMATE_LABELS[next(iter(counts), "")]
        return ", ".join(f"{count} {ESTIMATE_LABELS[name]}" for name, count in counts.items())


def taken_current(table: Mapping[Any, Any]) -> TakenCurrent:
    """Take the current of every profile of an archive's table, or of one row of it.

    Parameters
    ----------
    table : mapping of str to array_like
        The columns ``dac_*`` of the archive's root: a Dataset, or a row; columns that are not there count as missing.
        A smoothed current is there only where the smoother came to an end that is usable.
    """

    def column(name: str) -> Array:
        return np.asarray(table.get(name, np.nan), dtype=np.float64)

    smoothed = np.isfinite(column("dac_north_smoothed")) & np.isfinite(column("dac_east_smoothed"))

    def taken(of_smoother: str, of_adjoint: str) -> Array:
        return np.asarray(np.where(smoothed, column(of_smoother), column(of_adjoint)))

    return TakenCurrent(
        north=taken("dac_north_smoothed", "dac_north"),
        east=taken("dac_east_smoothed", "dac_east"),
        north_std=taken("dac_north_smoothed_std", "dac_north_std"),
        east_std=taken("dac_east_smoothed_std", "dac_east_std"),
        covariance=taken("dac_smoothed_covariance", "dac_covariance"),
        smoothed=np.asarray(smoothed),
    )
