"""Variables of another program's netCDF file, converted by the units that the file declares."""

import warnings
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import netCDF4
import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.observations.content import describe_content
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import decode_times
from gliderhpc.observations.units import FACTORS


class ForeignFile:
    """A netCDF file of another program, open for reading (a context manager).

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        It is no netCDF file, compressed, or cut short.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is no regular file")
        try:
            self._file = netCDF4.Dataset(path, "r")
        except (OSError, RuntimeError, UnicodeDecodeError) as error:
            raise self._unreadable(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.close()

    def __contains__(self, name: str) -> bool:
        return name in self._file.variables

    @property
    def dimensions(self) -> list[str]:
        """Names of its dimensions."""
        return list(self._file.dimensions)

    @property
    def names(self) -> list[str]:
        """Names of its variables."""
        return list(self._file.variables)

    def attribute(self, name: str, variable: str | None = None) -> str:
        """Text of an attribute, of the file or of one of its variables; empty where absent."""
        owner = self._file if variable is None else self._file.variables[variable]
        if name not in owner.ncattrs():
            return ""
        try:
            return str(owner.getncattr(name))
        except UnicodeDecodeError:
            return str(owner.getncattr(name, encoding="latin-1"))

    def first(self, names: Iterable[str]) -> str | None:
        """Give the first of some names that the file has."""
        return next((name for name in names if name in self), None)

    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` as they stand, NaN where missing or infinite; a scalar gives one value.

        Raises
        ------
        InputError
            The file has no such variable, it holds no numbers or a table of them, or the file was cut short.
        """
        if name not in self:
            raise InputError(f"{self.path}: has no variable {name}")
        values = np.ma.asarray(self._read(name))
        if values.dtype.kind not in "fiu":
            raise InputError(f"{self.path}: {name} holds no numbers")
        if values.ndim > 1:
            raise InputError(f"{self.path}: {name} has {values.ndim} dimensions; it must have one")
        numbers = np.atleast_1d(np.ma.filled(values.astype(np.float64), np.nan))
        # What is infinite was not measured.
        return np.where(np.isfinite(numbers), numbers, np.nan)

    def number(self, name: str) -> float:
        """Value of a scalar, NaN where the file does not have it."""
        values = self.numbers(name) if name in self else np.zeros(0)
        return float(values[0]) if len(values) else float("nan")

    def check_lengths(self, names: Iterable[str]) -> None:
        """Refuse variables that belong together but differ in length; those that the file does not have are left out.

        Raises
        ------
        InputError
            Naming the first that differs.
        """
        lengths = {name: len(self.numbers(name)) for name in names if name in self}
        first = next(iter(lengths), "")
        odd = next((name for name, length in lengths.items() if length != lengths[first]), None)
        if odd is not None:
            raise InputError(
                f"{self.path}: {odd} has {lengths[odd]} values and {first} has {lengths[first]}; they belong together"
            )

    def text(self, name: str) -> str:
        """Text in a variable of characters; empty where the file does not have it."""
        if name not in self:
            return ""
        values = np.ma.asarray(self._read(name))
        if values.dtype.kind == "S":
            return b"".join(values.filled(b"").ravel().tolist()).decode("utf-8", errors="replace")
        return str(values.ravel()[0]) if values.size and values.dtype.kind in "OU" else ""

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
            raise InputError(f"{self.path}: {name} is in '{declared}', of which no '{unit}' can be made")
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
        return decode_times(values, units, calendar, f"{self.path}: {name}").time

    def _read(self, name: str) -> Any:
        try:
            # The library only warns of a scale that is none, and gives the values without it.
            with warnings.catch_warnings():
                warnings.simplefilter("error", UserWarning)
                return self._file.variables[name][...]
        except UserWarning as error:
            raise InputError(f"{self.path}: {name} cannot be decoded ({error})") from error
        except (OSError, RuntimeError, UnicodeDecodeError, ValueError) as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> InputError:
        content = describe_content(self.path)
        if content:
            return InputError(f"{self.path}: {content}")
        return InputError(f"{self.path}: cannot be read as netCDF, it may have been cut short ({error})")
