"""Columns of another program's file: found under one of several names and converted to our units."""

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import NEGATIVE_FILLS, decode_texts, decode_times
from gliderhpc.wording import counted

DEFAULT_UNITS = "seconds since 1970-01-01"
"""Unit of times in a file that gives none."""


def _scales(*groups: tuple[float, str]) -> dict[str, float]:
    """Factors by spelling, from groups of comma-separated spellings of one scale."""
    return {spelling: factor for factor, spellings in groups for spelling in spellings.split(", ")}


_ANGLES = _scales(
    (1.0, "deg, degree, degrees, arc_degree, arc_degrees, °"),
    (float(np.degrees(1.0)), "rad, radian, radians"),
    (0.9, "gon, gons, grad, grads, grade, grades, gradian, gradians"),
)
_NORTHWARD = _scales((1.0, "degrees_north, degree_north, degree_n, degrees_n, degreen, degreesn"))
_EASTWARD = _scales((1.0, "degrees_east, degree_east, degree_e, degrees_e, degreee, degreese"))
_TRUE = _scales((1.0, "degrees_true, degree_true, degrees true, deg true, degt, degree_t, degrees_t"))

FACTORS: Mapping[str, Mapping[str, float]] = {
    "m": _scales(
        (1.0, "m, meter, meters, metre, metres"),
        (0.01, "cm, centimeter, centimeters"),
        (1e-3, "mm"),
        (0.0254, "in, inch, inches"),
        (0.3048, "ft, foot, feet"),
    ),
    "degree": _ANGLES | _NORTHWARD | _EASTWARD | _TRUE,
    "degrees_north": _ANGLES | _NORTHWARD,
    "degrees_east": _ANGLES | _EASTWARD,
    "m s-1": _scales(
        (1.0, "m s-1, m/s, m.s-1, m s^-1, m*s-1, meter second-1, metre second-1, meters per second"),
        (0.01, "cm/s, cm s-1"),
    ),
    "dbar": _scales(
        (1.0, "dbar, decibar, decibars"),
        (0.6894757293168361, "psi"),
        (10.0, "bar"),
        (0.01, "mbar, hpa"),
        (0.1, "kpa"),
        (1e-4, "pa"),
    ),
    "degC": _scales((1.0, "degc, c, celsius, degree_c, degrees_c, deg_c, deg c, degree_celsius, degrees_celsius")),
    "mS/cm": _scales((1.0, "ms/cm, ms.cm-1, ms cm-1"), (10.0, "s/m, s.m-1, s m-1, mho/m, mhos/m, siemens/m")),
    "1": _scales((1.0, "1, 1e-3, 0.001, psu, pss, pss-78, pss78")),
    "cm3": _scales(
        (1.0, "cm3, cm^3, cm**3, cc, ml, milliliter, milliliters, millilitre, millilitres, cubic centimeters"),
        (1e3, "l, liter, liters, litre, litres, dm3"),
        (1e6, "m3, m^3"),
    ),
    "s": _scales((1.0, "s, sec, secs, second, seconds")),
    "kg": _scales((1.0, "kg"), (1e-3, "g")),
}
"""Conversion factors by the wanted unit and the spelling of the declared unit, in lower case."""


USUAL_FILLS = (*NEGATIVE_FILLS, 9999.0, 99999.0, 999999.0)
"""Usual values of missing samples, which some files do not declare; no sensor of a glider reads exactly these."""


def usual_fills(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Mask ``(n,)`` of the values that equal a usual fill value."""
    return np.isin(values, USUAL_FILLS)


def describe_fills(
    name: str, values: FloatArray, lost: npt.NDArray[np.bool_], why: str = "has a usual fill value"
) -> str:
    """Sentence that counts the undeclared fill values of a variable, given by a mask ``(n,)``, with the remedy."""
    first, count = int(np.flatnonzero(lost)[0]), counted(int(np.count_nonzero(lost)), "sample")
    return (
        f"{name} {why} in {count}, the first {values[first]:g} at sample {first}; these are treated as missing: "
        "declare its fill value"
    )


_FROM_NORTH, _DOWNWARD = r"clockwise from (?:true |geographic )?north", r"positive down(?:wards?)?"

_SENSE = re.compile(
    rf"\s*[,;]?\s*(?:\(\s*(?:{_DOWNWARD}|nose up|fore up|starboard down|{_FROM_NORTH})\s*\)"
    rf"|(?<=\s)(?:{_DOWNWARD}|{_FROM_NORTH}|below (?:the )?(?:sea )?surface))$",
    re.IGNORECASE,
)
"""Positive direction after a unit, if it is that of the observation format: down, nose up, starboard down, north."""


def bare_unit(text: str) -> str:
    """Return a declared unit without spaces around it and without its usual sense, as of ``m (positive down)``."""
    return _SENSE.sub("", " ".join(text.split()))


def find_name(names: Iterable[str], wanted: Sequence[str]) -> str | None:
    """First of the wanted names that is among the given names: an exact match, otherwise one that ignores case.

    Parameters
    ----------
    names : iterable of str
        Names of a file's variables.
    wanted : sequence of str
        Names to look for, in order of preference.
    """
    there = list(names)
    folded = {name.casefold(): name for name in reversed(there)}
    exact = next((name for name in wanted if name in there), None)
    return exact or next((folded[name.casefold()] for name in wanted if name.casefold() in folded), None)


class UnitError(InputError):
    """The declared unit of a variable cannot be converted to the wanted one."""


class NamedColumns(ABC):
    """Variables of a file or Dataset by name, read in our units.

    Attributes
    ----------
    source : str
        Name of the file or Dataset in messages.
    """

    source: str

    @property
    @abstractmethod
    def names(self) -> list[str]:
        """Names of the variables."""

    @abstractmethod
    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of a global attribute, or of an attribute of one variable; empty where absent."""

    @abstractmethod
    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` without conversion, NaN where missing or outside the limits that the file declares.

        Raises
        ------
        InputError
            They are not numbers.
        """

    @abstractmethod
    def limits(self, name: str) -> tuple[float, float] | None:
        """Limits that the file declares for the values of a variable; None if there are none that can be used."""

    @abstractmethod
    def unlimited(self, name: str) -> FloatArray:
        """Values ``(n,)`` as `numbers`, including those outside the declared limits."""

    def texts(self, name: str) -> npt.NDArray[np.str_] | None:
        """Texts ``(n,)`` in a variable; None if it contains numbers."""
        return None

    @property
    def flag_names(self) -> list[str]:
        """Names of the variables that may hold quality flags; flags written as characters may have no dimension."""
        return self.names

    @abstractmethod
    def flags(self, name: str) -> FloatArray:
        """Quality flags ``(n,)`` in a variable as numbers, NaN where absent; empty if it has several dimensions."""

    def present(self, name: str) -> npt.NDArray[np.bool_]:
        """Mask ``(n,)`` of the values of a variable that are not missing."""
        texts = self.texts(name)
        return np.isfinite(self.numbers(name)) if texts is None else np.char.strip(texts) != ""

    def converted(self, name: str, unit: str, *, undeclared: str | None = None) -> FloatArray:
        """Values ``(n,)`` in one of our units.

        Parameters
        ----------
        name : str
            Name of the variable.
        unit : str
            The wanted unit.
        undeclared : str, optional
            Unit of the variable if the file declares none; by default `unit`.

        Raises
        ------
        InputError
            As for `numbers`.
        UnitError
            The declared unit cannot be converted to the wanted one.
        """
        values = self.numbers(name)
        declared = self.attribute("units", name).strip() or undeclared or unit
        factor = FACTORS[unit].get(bare_unit(declared).lower())
        if factor is None:
            is_pressure = unit == "m" and bare_unit(declared).lower() in FACTORS["dbar"]
            hint = "; it is a pressure, not a depth: name it so" if is_pressure else ""
            raise UnitError(f"{self.source}: {name} is in '{declared}', which cannot be converted to '{unit}'{hint}")
        return values * factor

    def times(self, name: str) -> TimeArray:
        """Times ``(n,)``, decoded with the declared CF unit; NaT where missing, or outside the years of gliders.

        Times may also be texts in ISO 8601.

        Raises
        ------
        InputError
            As for `numbers`, or the unit is not a unit of time, or it names a time zone, or a text is no time.
        """
        texts = self.texts(name)
        if texts is not None:
            return decode_texts(texts, f"{self.source}: {name}").time
        values = self.numbers(name)
        units, calendar = (" ".join(self.attribute(key, name).split()) for key in ("units", "calendar"))
        units = units or DEFAULT_UNITS
        return decode_times(values, units, calendar, f"{self.source}: {name}").time


@dataclass(frozen=True)
class Term:
    """Names and units of one quantity.

    Attributes
    ----------
    names : tuple of str
        Possible names of its variable; the first one found is taken.
    unit : str
        Unit of the quantity in an observation file.
    standard_names : tuple of str
        Its CF standard names, present and past; none where they would be ambiguous.
    undeclared : str
        Its unit in a file that gives none.
    """

    names: tuple[str, ...]
    unit: str
    standard_names: tuple[str, ...] = ()
    undeclared: str = ""

    def find(self, columns: NamedColumns) -> str | None:
        """Name of the file's variable of this quantity, found by name or by standard name; None if there is none."""
        named = find_name(columns.names, self.names)
        if named is not None:
            return named
        return next(
            (name for name in columns.names if columns.attribute("standard_name", name) in self.standard_names), None
        )

    def require(self, columns: NamedColumns, what: str) -> str:
        """Name of the file's variable of this quantity.

        Raises
        ------
        InputError
            The file has no such variable.
        """
        name = self.find(columns)
        if name is None:
            raise InputError(f"{columns.source}: has no {what} ({self.describe()})")
        return name

    def describe(self) -> str:
        """Possible names of the variable, as a phrase."""
        return " or ".join(self.names)
