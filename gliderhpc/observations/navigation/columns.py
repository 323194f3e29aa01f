"""Quantities of a current among the variables of a Dataset of any source, read in our units; with measured velocity."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gsw
import numpy as np
import numpy.typing as npt
import xarray as xr

from gliderhpc.errors import InputError, first_line
from gliderhpc.observations.checks.heading_values import RANGE, describe_impossible, outside, remove_turns
from gliderhpc.observations.checks.sign_checks import sense_fault
from gliderhpc.observations.checks.suitability import CURRENT_TERMS, lacking_for_currents, needs_of_inversion
from gliderhpc.observations.files.columns import (
    DEFAULT_UNITS,
    NamedColumns,
    UnitError,
    describe_fills,
    find_name,
    usual_fills,
)
from gliderhpc.observations.files.file_content import describe_groups
from gliderhpc.observations.files.headings import VEHICLE_COLUMNS, North, file_declination, north_of
from gliderhpc.observations.files.packed import PACKING
from gliderhpc.observations.files.quality_flags import Rejected, find_rejected, numeric_flags
from gliderhpc.observations.files.valid_limits import check_limits, declared_limits
from gliderhpc.observations.files.valid_limits import outside as outside_limits
from gliderhpc.observations.fixes import SurfaceFixes
from gliderhpc.observations.format import MAX_VELOCITY, VARIABLES, VELOCITY
from gliderhpc.observations.navigation.checks import check_depth_unit
from gliderhpc.observations.profiles import IntArray
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import check_resolution, texts_in

_LIMITS = {
    "depth": (-20.0, 11_000.0), "pressure": (-20.0, 11_500.0), "pitch": (-89.9, 89.9), "heading": RANGE,
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
        self._dataset, self.source = _without_single_dimensions(dataset), source
        self._rejected = Rejected()

    @property
    def names(self) -> list[str]:
        """Names of the one-dimensional variables."""
        return [str(name) for name, variable in self._dataset.variables.items() if variable.ndim == 1]

    @property
    def flag_names(self) -> list[str]:
        """Names of the variables that may hold quality flags."""
        return [str(name) for name, variable in self._dataset.variables.items() if variable.ndim <= 1]

    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of an attribute, of the Dataset or of a variable; empty where absent."""
        owner = self._dataset if variable is None else self._dataset[variable]
        return str(owner.attrs.get(name, ""))

    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` without conversion, NaN where missing or outside the limits that the file declares."""
        values = self.unlimited(name)
        return np.where(outside_limits(values, self.limits(name)), np.nan, values)

    def limits(self, name: str) -> tuple[float, float] | None:
        """Limits that the file declares for the values of a variable; None if there are none that can be used."""
        variable = self._dataset[name].variable
        return declared_limits(variable) if variable.dtype.kind in "fiu" else None

    def unlimited(self, name: str) -> FloatArray:
        """Values ``(n,)`` as `numbers`, including those outside the declared limits."""
        array = self._dataset[name]
        if array.dtype.kind not in "fiu":
            raise InputError(f"{self.source}: {name} does not contain numbers")
        return self._rejected.without(name, np.asarray(self._values(name), dtype=np.float64))

    def _values(self, name: str) -> npt.NDArray[Any]:
        """Values of a variable; `InputError` if they cannot be unpacked."""
        try:
            return np.asarray(self._dataset[name].values)
        except TypeError as error:
            raise InputError(
                f"{self.source}: {name} cannot be unpacked ({first_line(error)}); correct its attributes "
                f"{' and '.join(PACKING)}, which must be numbers"
            ) from error

    def present(self, name: str) -> npt.NDArray[np.bool_]:
        """Mask ``(n,)`` of the values that are not missing."""
        array = self._dataset[name]
        if np.issubdtype(array.dtype, np.datetime64):
            return np.asarray(~np.isnat(self._values(name)))
        return super().present(name)

    def flags(self, name: str) -> FloatArray:
        """Quality flags ``(n,)`` in a variable as numbers, NaN where absent; empty if it has several dimensions."""
        return numeric_flags(self._values(name))

    def reject_flagged(self) -> list[str]:
        """Treat values that are flagged bad or missing as missing from now on; return remarks that count them.

        Values outside the limits that the file declares are missing in any case, and are counted too.

        Raises
        ------
        InputError
            Every value of time, depth, pitch or heading is flagged, or most of them are outside the limits.
        """
        found = {quantity: self.find(quantity) for quantity in CURRENT_TERMS if quantity != "profile"}
        needed = {found[quantity] for quantity in ("time", "depth", "pitch", "heading")}
        self._rejected = find_rejected(self, filter(None, found.values()), needed)
        limited = check_limits(self, filter(None, found.values()), needed)
        return [self._rejected.remark, *limited] if self._rejected.remark else limited

    def times(self, name: str) -> TimeArray:
        """Times ``(n,)``, decoded with the declared CF unit where necessary; NaT where missing."""
        array = self._dataset[name]
        if np.issubdtype(array.dtype, np.datetime64):
            return self._rejected.without_times(name, np.asarray(self._values(name), dtype="datetime64[ns]"))
        if array.dtype.kind in "fiu":
            unit = self.attribute("units", name) or DEFAULT_UNITS
            check_resolution(self._values(name), unit, f"{self.source}: {name}")
        return self._rejected.without_times(name, super().times(name))

    def describe_clock(self) -> str:
        """Clause on the unit of the times, with the remedy; empty if they need no unit."""
        name = self.find("time")
        if self._dataset[name].dtype.kind not in "fiu":
            return ""
        unit = self.attribute("units", name)
        if unit:
            return f"; {name} is in '{unit}': correct its units"
        return f"; {name} has no units, so it is taken as {DEFAULT_UNITS}: declare its unit"

    def texts(self, name: str) -> npt.NDArray[np.str_] | None:
        """Texts ``(n,)`` in a variable; None if it contains numbers."""
        return texts_in(self._values(name)) if self._dataset[name].dtype.kind in "OSUT" else None

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
        if quantity == "heading":
            values, _ = remove_turns(values, f"{self.source}: {self.find(quantity)}")
        if quantity == "depth":
            values = np.where(usual_fills(values), np.nan, values)
        low, high = _LIMITS[quantity]
        with np.errstate(invalid="ignore"):
            return np.where((values >= low) & (values <= high), values, np.nan)

    def check_complete(self) -> None:
        """Refuse a Dataset that lacks a needed quantity, naming all missing ones, or has one on another dimension."""
        lacking = lacking_for_currents(self)
        if lacking:
            raise InputError(
                f"{self.source}: has no {', '.join(lacking)}; a depth-averaged current needs time, depth, pitch, "
                f"heading and GPS fixes; {needs_of_inversion(self)}{self._of_several_dimensions()}"
                f"{describe_groups(Path(self.source))}"
            )
        samples = self.dimension
        found = [self.find(name) for name in ("depth", "pitch", "heading")]
        odd = [name for name in found if name and self._dataset[name].dims != (samples,)]
        if odd:
            raise InputError(f"{self.source}: {odd[0]} does not lie along {samples}, the dimension of the samples")

    def _of_several_dimensions(self) -> str:
        """Clause that names the needed variables that are not series because of their dimensions; empty without any."""
        variables = self._dataset.variables
        many = {str(name): variable for name, variable in variables.items() if variable.ndim > 1}
        wanted = [name for term in CURRENT_TERMS.values() if (name := find_name(many, term.names)) is not None]
        found = [f"{name} ({', '.join(f'{dim} = {n}' for dim, n in many[name].sizes.items())})" for name in wanted]
        return f"; give files in which each has one dimension, that of the samples: {', '.join(found)}" if found else ""

    def declination(self, given: float | None) -> tuple[float, list[str]]:
        """Declination (degree) to add to the heading, and remarks on it.

        A given declination replaces the one in the file. Neither is added to a heading that already refers to true
        north. A given one is also added where the file does not state the reference.
        """
        north, why = self._north()
        if north is North.TRUE:
            refused = f"{why}: the given declination, {given:g} degrees, is not added" if given else ""
            return 0.0, [refused] if refused else []
        if given is not None:
            return given, [f"{why}: the given declination, {given:g} degrees, is added"] if why else []
        if north is North.UNSTATED:
            return 0.0, []
        try:
            found = file_declination(self, map(str, self._dataset.variables))
        except InputError as error:
            return 0.0, [f"{why}, and the declination in the file cannot be used ({error}): give `declination`"]
        if found is None:
            return 0.0, [f"{why}, and the file has no declination: give `declination`"]
        return found.angle, [f"{why}: the declination in the file, {found.angle:.1f} degrees ({found.name}), is added"]

    def _north(self) -> tuple[North, str]:
        """Reference of the heading, and a clause that states it; empty if the file states none."""
        attributes = self._dataset[self.find("heading")].attrs
        # The format's own long name is the same for every file.
        texts = [str(value) for value in attributes.values() if value != VARIABLES["heading"].long_name]
        north = north_of(*texts)
        if north is North.UNSTATED and str(attributes.get("source", "")).strip() in VEHICLE_COLUMNS:
            return North.MAGNETIC, f"the heading is the vehicle's own ({attributes['source']}), which is magnetic"
        if north is North.UNSTATED:
            north = north_of(self.attribute("heading_comment"))
        clauses = {North.TRUE: "the heading already refers to true north", North.MAGNETIC: "the heading is magnetic"}
        return north, clauses.get(north, "")

    def undeclared(self) -> list[str]:
        """Remark on the needed quantities without a unit, which are read in the usual one; none if all have one."""
        needed = ("depth" if self.find("depth") else "pressure", "pitch", "heading")
        taken = [
            f"{self.find(quantity)} (taken as {CURRENT_TERMS[quantity].unit})"
            for quantity in needed
            if not self.attribute("units", self.find(quantity)).strip()
        ]
        return [f"no units are declared for {', '.join(taken)}"] if taken else []

    def out_of_range(self) -> list[str]:
        """Remarks on whole turns in the heading, fill values of depth, and impossible values of pitch and heading.

        All but the whole turns are treated as missing.

        Raises
        ------
        InputError
            Most of the values are impossible, and they are not fill values.
        """
        remarks = []
        if self.find("depth"):
            depth = self.converted(self.find("depth"), "m")
            remarks += [describe_fills(self.find("depth"), depth, fills)] if (fills := usual_fills(depth)).any() else []
        for quantity in ("pitch", "heading"):
            name, unit = self.find(quantity), CURRENT_TERMS[quantity].unit
            values, limits = self.converted(name, unit), _LIMITS[quantity]
            if quantity == "heading":
                values, turns = remove_turns(values, f"{self.source}: {name}")
                remarks += [f"{name} {turns}"] if turns else []
            lost = outside(values, limits)
            if lost.any():
                text = describe_impossible(values, lost, f"{self.source}: {name}", limits)
                remedy = "these are treated as missing: check its unit, or declare its fill value"
                remarks.append(f"{name} {text}; {remedy}")
        return remarks

    def depth(self, fixes: SurfaceFixes) -> FloatArray:
        """Depth (m), positive down; computed from pressure if there is no depth.

        Raises
        ------
        InputError
            Most values are negative, or deeper than any ocean.
        """
        name = self.find("depth")
        if name:
            depth = self.quantity("depth", -1.0 if self.attribute("positive", name).strip().lower() == "up" else 1.0)
            self._check_range(name, "depth", depth)
            return depth
        latitude = float(np.median(fixes.latitude)) if len(fixes.latitude) else 45.0
        pressure = self.quantity("pressure")
        self._check_range(self.find("pressure"), "pressure", pressure)
        return np.asarray(-gsw.z_from_p(pressure, latitude))

    def compare_with_pressure(self, depth: FloatArray, order: npt.NDArray[np.int64]) -> list[str]:
        """Compare a depth (m) with the pressure in the same rows, given in order; remarks on contradictions.

        Raises
        ------
        InputError
            The depth is in another unit than metres.
        """
        if not (self.find("depth") and self.find("pressure") and self.lies_along_samples("pressure")):
            return []
        try:
            pressure = self.quantity("pressure")
        except UnitError as error:
            return [f"{str(error).removeprefix(f'{self.source}: ')}, so the depth is not compared with it"]
        return check_depth_unit(self.source, depth, pressure[order])

    def _check_range(self, name: str, quantity: str, usable: FloatArray) -> None:
        """Refuse a depth or pressure most of whose values are impossible."""
        values = self.converted(name, CURRENT_TERMS[quantity].unit)
        lost = values[np.isfinite(values) & ~np.isfinite(usable)]
        if len(lost) <= np.count_nonzero(np.isfinite(usable)):
            return
        unit = CURRENT_TERMS[quantity].unit
        typical, high = float(np.median(lost)), _LIMITS[quantity][1]
        if abs(typical) <= high:
            found, remedy = sense_fault(self.attribute("positive", name))
            raise InputError(f"{self.source}: {name} is {found}; {remedy}")
        raise InputError(
            f"{self.source}: {name} is typically {typical:.3g} {unit}, but the ocean is at most {high:g} {unit} deep; "
            "convert it, or set its units to those that it is in (such as 'cm' or 'Pa')"
        )


def _without_single_dimensions(dataset: xr.Dataset) -> xr.Dataset:
    """Drop the dimensions of length 1, such as that of a trajectory, of variables with several dimensions."""
    squeezed = {
        name: variable.isel({dim: 0 for dim, size in variable.sizes.items() if size == 1})
        for name, variable in dataset.variables.items()
        if variable.ndim > 1 and 1 in variable.shape
    }
    return dataset.drop_vars(squeezed).assign(squeezed) if squeezed else dataset


# Measured velocity relative to the water; a current needs none


def read_velocity(columns: NavigationColumns, order: IntArray) -> tuple[FloatArray | None, list[str]]:
    """Measured velocity ``(n, 3)`` of rows in an order, and remarks on the components that cannot be used.

    These components are NaN; without any usable one there is no velocity (None).
    """
    found: dict[str, FloatArray] = {}
    remarks: list[str] = []
    for name in (name for name in VELOCITY if columns.find(name)):
        if not columns.lies_along_samples(name):
            remarks.append(
                f"{name} is not used: it does not lie along {columns.dimension}, the dimension of the samples"
            )
            continue
        try:
            found[name] = columns.quantity(name)[order]
        except InputError as error:
            remarks.append(f"{name} is not used: {error}")
    missing = np.full(len(order), np.nan)
    return (np.column_stack([found.get(name, missing) for name in VELOCITY]) if found else None), remarks


def join_velocity(velocities: Sequence[FloatArray | None], counts: Sequence[int], order: IntArray) -> FloatArray | None:
    """Join the velocities of several files, with these numbers of samples, in an order; NaN for files without any."""
    if all(velocity is None for velocity in velocities):
        return None
    parts = zip(velocities, counts, strict=True)
    return np.concatenate([np.full((count, 3), np.nan) if velocity is None else velocity for velocity, count in parts])[
        order
    ]
