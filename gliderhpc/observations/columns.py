"""Columns of a file of another program, by name and unit: found under one of several names, converted to our units."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import decode_times


def _scales(*groups: tuple[float, str]) -> dict[str, float]:
    """Factors from groups of spellings, parted by commas, that mean one scale."""
    return {spelling: factor for factor, spellings in groups for spelling in spellings.split(", ")}


FACTORS: Mapping[str, Mapping[str, float]] = {
    "m": _scales(
        (1.0, "m, meter, meters, metre, metres"),
        (0.01, "cm, centimeter, centimeters"),
        (1e-3, "mm"),
        (0.0254, "in, inch, inches"),
    ),
    "degree": _scales(
        (1.0, "deg, degree, degrees, degrees_north, degree_north, degrees_east, degree_east"),
        (float(np.degrees(1.0)), "rad, radian, radians"),
    ),
    "m s-1": _scales((1.0, "m s-1, m/s, m.s-1"), (0.01, "cm/s, cm s-1")),
    "dbar": _scales((1.0, "dbar, decibar"), (10.0, "bar"), (0.01, "mbar, hpa"), (0.1, "kpa"), (1e-4, "pa")),
    "degC": _scales((1.0, "degc, c, celsius, degree_c, degrees_c, deg_c, degree_celsius, degrees_celsius")),
    "mS/cm": _scales((1.0, "ms/cm, ms.cm-1"), (10.0, "s/m, s.m-1")),
    "1": _scales((1.0, "1, 1e-3, 0.001, psu")),
    "cm3": _scales((1.0, "cm3, cm^3, cc, ml"), (1e3, "l, liter, litre"), (1e6, "m3, m^3")),
    "s": _scales((1.0, "s, sec, secs, second, seconds")),
    "kg": _scales((1.0, "kg"), (1e-3, "g")),
}
"""Factors by the unit wanted and the spelling of the unit declared, in small letters."""


def find_name(names: Iterable[str], wanted: Sequence[str]) -> str | None:
    """First of the wanted names that is among some names: exactly, else ignoring case.

    Parameters
    ----------
    names : iterable of str
        Names of a file's variables.
    wanted : sequence of str
        In order of preference.
    """
    there = list(names)
    folded = {name.casefold(): name for name in reversed(there)}
    exact = next((name for name in wanted if name in there), None)
    return exact or next((folded[name.casefold()] for name in wanted if name.casefold() in folded), None)


class NamedColumns(ABC):
    """Variables of a file or Dataset by their names in it, read in our units.

    Attributes
    ----------
    source : str
        Its name in messages.
    """

    source: str

    @property
    @abstractmethod
    def names(self) -> list[str]:
        """Names of the variables."""

    @abstractmethod
    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of an attribute, of the whole or of one of the variables; empty where absent."""

    @abstractmethod
    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` as they stand, NaN where missing; `InputError` where they are no numbers."""

    def converted(self, name: str, unit: str, *, undeclared: str | None = None) -> FloatArray:
        """Values ``(n,)`` in one of our units.

        Parameters
        ----------
        name : str
            The variable.
        unit : str
            The unit wanted.
        undeclared : str, optional
            The unit that it has where the file does not say; `unit` if not given.

        Raises
        ------
        InputError
            As `numbers`, or the unit declared does not lead to the one wanted.
        """
        values = self.numbers(name)
        declared = self.attribute("units", name).strip() or undeclared or unit
        factor = FACTORS[unit].get(declared.lower())
        if factor is None:
            raise InputError(f"{self.source}: {name} is in '{declared}', which cannot be converted to '{unit}'")
        return values * factor

    def times(self, name: str) -> TimeArray:
        """Times ``(n,)`` by the CF unit declared; NaT where missing, or outside the years of gliders.

        Raises
        ------
        InputError
            As `numbers`, or the unit is not one of time, or in a time zone by name.
        """
        values = self.numbers(name)
        units, calendar = (" ".join(self.attribute(key, name).split()) for key in ("units", "calendar"))
        units = units or "seconds since 1970-01-01"
        return decode_times(values, units, calendar, f"{self.source}: {name}").time


@dataclass(frozen=True)
class Term:
    """One quantity.

    Attributes
    ----------
    names : tuple of str
        Names of its variable; the first found is taken.
    unit : str
        The unit that an observation file has it in.
    standard_names : tuple of str
        Its CF standard names, present and past; none where they would not be unambiguous.
    undeclared : str
        Its unit where a file gives none.
    """

    names: tuple[str, ...]
    unit: str
    standard_names: tuple[str, ...] = ()
    undeclared: str = ""

    def find(self, columns: NamedColumns) -> str | None:
        """Name of the file's variable of this quantity, by name or by standard name."""
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
            The file has none.
        """
        name = self.find(columns)
        if name is None:
            raise InputError(f"{columns.source}: has no {what} ({self.describe()})")
        return name

    def describe(self) -> str:
        """Names that are looked for, as a phrase."""
        return " or ".join(self.names)
