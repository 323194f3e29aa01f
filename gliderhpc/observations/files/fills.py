"""Undeclared fill values in files of another program: values that no sensor can have measured are missing.

Fill values repeat the same few numbers. Many different impossible values are therefore a variable in another unit than
declared; these are left to the checks of the profiles, which name the variable and the unit.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gliderhpc.observations.checks.heading_values import MIN_DISTINCT, RANGE
from gliderhpc.observations.files.columns import USUAL_FILLS, usual_fills
from gliderhpc.observations.format import CONTROLS, VARIABLES
from gliderhpc.observations.records import FloatArray
from gliderhpc.observations.times import NEGATIVE_FILLS

HUGE = 1e30
"""Magnitude at or above which a value is a fill value, such as the netCDF library's 9.96921e36."""


@dataclass(frozen=True, eq=False)
class MeasuredVariable:
    """Values of a file's variable.

    Attributes
    ----------
    quantity : str
        Name of the variable in the observation format.
    stored : (n,) array
        Values as in the file, NaN where missing.
    values : (n,) array
        The same in the unit and sense of the observation format; of the water as stored.
    """

    quantity: str
    stored: FloatArray
    values: FloatArray

    @property
    def limits(self) -> tuple[float, float]:
        """Range of possible values; controls have none, since few different ones may well be in another unit."""
        if self.quantity in CONTROLS:
            return float("-inf"), float("inf")
        known = VARIABLES[self.quantity]
        return RANGE if self.quantity == "heading" else (known.low, known.high)

    @cached_property
    def fills(self) -> npt.NDArray[np.bool_]:
        """Mask ``(n,)`` of the values that are not measurements."""
        low, high = self.limits
        with np.errstate(invalid="ignore"):
            usual = np.abs(self.stored) >= HUGE
            outside = (self.values < low) | (self.values > high)
        # A depth in centimetres may well be 9999, but in metres it is not.
        usual |= np.isin(self.stored, NEGATIVE_FILLS if self.quantity == "depth" else USUAL_FILLS)
        usual |= usual_fills(self.values)
        if self.quantity == "heading":
            # An impossible heading would become another angle.
            return np.asarray(usual | outside)
        in_another_unit = (
            len(np.unique(self.values[outside & ~usual])) >= MIN_DISTINCT
            or not (np.isfinite(self.values) & ~outside).any()
        )
        return np.asarray(usual if in_another_unit else usual | outside)
