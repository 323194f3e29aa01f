"""Quantities needed for a current, found among the variables of a Dataset of any source and read in our units."""

import gsw
import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.columns import NamedColumns, find_name
from gliderhpc.observations.fixes import SurfaceFixes
from gliderhpc.observations.format import MAX_VELOCITY, VELOCITY
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.suitability import CURRENT_TERMS, lacking_for_currents, needs_of_inversion

_DECLINATION = ("MAGNETIC_VARIATION", "magnetic_variation", "m_gps_mag_var", "magvar", "declination")
_LIMITS = {
    "depth": (-20.0, 11_000.0), "pressure": (-20.0, 11_500.0), "pitch": (-89.9, 89.9), "heading": (-360.0, 720.0),
    "roll": (-180.0, 180.0), "fix_latitude": (-90.0, 90.0), "fix_longitude": (-180.0, 360.0),
    "latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0), "profile": (0.0, 2.0**31),
    **dict.fromkeys(VELOCITY, (-MAX_VELOCITY, MAX_VELOCITY)),
}  # fmt: skip
"""Plausible ranges; values outside are undeclared fill values and are treated as missing."""


class NavigationColumns(NamedColumns):
    """Variables of a Dataset, and the quantities among them that are needed for a current.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset with decoded or undecoded times.
    source : str
        Its name in messages.
    """

    def __init__(self, dataset: xr.Dataset, source: str) -> None:
        self._dataset, self.source = dataset, source

    @property
    def names(self) -> list[str]:
        """Names of the one-dimensional variables."""
        return [str(name) for name, variable in self._dataset.variables.items() if variable.ndim == 1]

    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of an attribute, of the Dataset or of a variable; empty where absent."""
        owner = self._dataset if variable is None else self._dataset[variable]
        return str(owner.attrs.get(name, ""))

    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` without conversion, NaN where missing."""
        array = self._dataset[name]
        if array.dtype.kind not in "fiu":
            raise InputError(f"{self.source}: {name} does not contain numbers")
        return np.asarray(array.values, dtype=np.float64)

    def times(self, name: str) -> TimeArray:
        """Times ``(n,)``, decoded with the declared CF unit where necessary; NaT where missing."""
        array = self._dataset[name]
        if np.issubdtype(array.dtype, np.datetime64):
            return np.asarray(array.values, dtype="datetime64[ns]")
        return super().times(name)

    def find(self, quantity: str) -> str:
        """Name of a quantity's variable; empty if there is none."""
        return CURRENT_TERMS[quantity].find(self) or ""

    @property
    def dimension(self) -> str:
        """Dimension of the samples."""
        return str(self._dataset[self.find("time")].dims[0])

    def lies_along_samples(self, quantity: str) -> bool:
        """Return whether a quantity's variable has the dimension of the samples."""
        return bool(self._dataset[self.find(quantity)].dims == (self.dimension,))

    def quantity(self, quantity: str, sign: float = 1.0) -> FloatArray:
        """Values of a quantity, multiplied by a sign; NaN where missing or impossible."""
        values = self.converted(self.find(quantity), CURRENT_TERMS[quantity].unit) * sign
        low, high = _LIMITS[quantity]
        with np.errstate(invalid="ignore"):
            return np.where((values >= low) & (values <= high), values, np.nan)

    def check_complete(self) -> None:
        """Refuse a Dataset that lacks a needed quantity, naming all missing ones, or has one on another dimension."""
        lacking = lacking_for_currents(self)
        if lacking:
            raise InputError(
                f"{self.source}: has no {', '.join(lacking)}; a depth-averaged current needs time, depth, pitch, "
                f"heading and GPS fixes; {needs_of_inversion(self)}"
            )
        samples = self.dimension
        found = [self.find(name) for name in ("depth", "pitch", "heading")]
        odd = [name for name in found if name and self._dataset[name].dims != (samples,)]
        if odd:
            raise InputError(f"{self.source}: {odd[0]} does not lie along {samples}, the dimension of the samples")

    def declination(self) -> tuple[float, list[str]]:
        """Declination (degree) to add if the heading is magnetic by its attributes, and remarks on it."""
        array = self._dataset[self.find("heading")]
        if "magnetic" not in " ".join(str(value) for value in array.attrs.values()).lower():
            return 0.0, []
        name = find_name(map(str, self._dataset.variables), _DECLINATION)
        values = np.zeros(0) if name is None else self.numbers(name)
        if np.isfinite(values).any():
            declination = float(np.nanmedian(values))
            return declination, [
                f"the heading is magnetic: the declination in the file, {declination:.1f} degrees, is added"
            ]
        return 0.0, ["the heading is magnetic and the file has no declination: give --declination"]

    def depth(self, fixes: SurfaceFixes) -> FloatArray:
        """Depth (m), positive down; computed from pressure if there is no depth."""
        name = self.find("depth")
        if name:
            depth = self.quantity("depth", -1.0 if self.attribute("positive", name) == "up" else 1.0)
            if np.count_nonzero(np.isfinite(self.numbers(name))) > 2 * np.count_nonzero(np.isfinite(depth)):
                raise InputError(
                    f"{self.source}: {name} is negative under water; make it positive down, or set the "
                    "attribute positive = 'up'"
                )
            return depth
        latitude = float(np.median(fixes.latitude)) if len(fixes.latitude) else 45.0
        return np.asarray(-gsw.z_from_p(self.quantity("pressure"), latitude))
