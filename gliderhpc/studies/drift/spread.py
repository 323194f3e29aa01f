"""What the coefficients leave of the slopes: their distribution over hulls drawn, beside the hull's own (Table 6)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.studies.drift.coefficients import OWN, SegmentMedians
from gliderhpc.studies.drift.medians import PHASES, UNITS
from gliderhpc.studies.drift.series import LONGITUDINAL, days_of
from gliderhpc.studies.drift.slopes import interval, theil_sen
from gliderhpc.studies.library.trend import LEAST

Array = NDArray[np.float64]

QUANTITIES = tuple(UNITS)
GROUP = "drift"


@dataclass(frozen=True, eq=False)
class CoefficientSlopes:
    """Slope of a series over the segments, by hull.

    Attributes
    ----------
    quantity, phase : str
        Which series.
    nominal : float
        With the hull's own coefficients.
    draws : (draws,) array
        With every drawn hull; NaN where it could not follow the records.
    pitched : (2,) array
        With the hull's own, and a constant error of the pitch, up and down.
    shift : (2,) array
        By which that error moves the series itself, medians.
    """

    quantity: str
    phase: str
    nominal: float
    draws: Array
    pitched: Array
    shift: Array

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the draws."""
        return interval(self.draws)

    @property
    def same_sign(self) -> float:
        """Part of the draws whose slope has the sign of the hull's own."""
        known = self.draws[np.isfinite(self.draws)]
        return float(np.mean(np.sign(known) == np.sign(self.nominal))) if known.size else float("nan")


def coefficient_slopes(table: pd.DataFrame, found: Sequence[SegmentMedians]) -> list[CoefficientSlopes]:
    """Find the slopes of the longitudinal series and of the drag under every hull.

    Parameters
    ----------
    table : pandas.DataFrame
        A row a profile, with ``profile`` and ``elapsed_days``.
    found : sequence of SegmentMedians
        Of the same profiles.
    """
    by_number = {one.number: one.medians for one in found}
    medians = np.stack([by_number[int(number)] for number in table["profile"]])
    days = days_of(table)
    return [
        _slopes(days, medians[:, :, phase, QUANTITIES.index(quantity)], quantity, name)
        for quantity in (*LONGITUDINAL, "K_D0")
        for phase, name in enumerate(PHASES)
    ]


def kept_slopes(archive: xr.DataTree) -> list[CoefficientSlopes]:
    """Read the slopes that an archive's group keeps; none where no coefficients were drawn."""
    group = archive[GROUP].to_dataset()
    own, series = len(OWN), [str(name) for name in group["series"].values]
    kept = zip((name.split() for name in series if name), group["slope"].values, group["shift"].values, strict=False)
    return [
        CoefficientSlopes(quantity, phase, float(slope[0]), slope[own:], slope[1:own], shift)
        for (quantity, phase), slope, shift in kept
    ]


def slopes_to_keep(slopes: Sequence[CoefficientSlopes]) -> dict[str, Array]:
    """Slopes as the group keeps them, a row a series: hull's own, with either error of the pitch, of every draw."""
    return {
        "slope": np.array([[one.nominal, *one.pitched, *one.draws] for one in slopes]),
        "shift": np.array([one.shift for one in slopes]),
    }


def slope_labels(slopes: Sequence[CoefficientSlopes]) -> dict[str, list[str]]:
    """Names along the dimensions of what is kept; without draws there is one series without a name."""
    draws = len(slopes[0].draws) if slopes else 0
    return {
        "series": [f"{one.quantity} {one.phase}" for one in slopes] or [""],
        "hull": [*OWN, *(f"draw {number}" for number in range(1, draws + 1))],
        "offset": list(OWN[1:]),
    }


def _slopes(days: Array, medians: Array, quantity: str, phase: str) -> CoefficientSlopes:
    slopes = np.array([_slope(days, values) for values in medians.T])
    own = len(OWN)
    shift = np.array([_median(medians[:, variant] - medians[:, 0]) for variant in range(1, own)])
    return CoefficientSlopes(quantity, phase, float(slopes[0]), slopes[own:], slopes[1:own], shift)


def _slope(days: Array, values: Array) -> float:
    known = np.isfinite(values)
    return theil_sen(days[known], values[known]) if known.sum() >= LEAST else float("nan")


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
