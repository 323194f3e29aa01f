"""Variables of another program's netCDF file, converted by the units that the file declares."""

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import netCDF4
import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.content import describe_content
from gliderhpc.observations.records import FloatArray, TimeArray
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
        try:
            self._file = netCDF4.Dataset(path, "r")
        except OSError as error:
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
        return str(getattr(owner, name, ""))

    def first(self, names: Iterable[str]) -> str | None:
        """Give the first of some names that the file has."""
        return next((name for name in names if name in self), None)

    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` as they stand, NaN where missing; a scalar gives one value.

        Raises
        ------
        InputError
            The file has no such variable, it holds no numbers, or the file was cut short.
        """
        if name not in self:
            raise InputError(f"{self.path}: has no variable {name}")
        values = self._read(name)
        if values.dtype.kind not in "fiu":
            raise InputError(f"{self.path}: {name} holds no numbers")
        return np.atleast_1d(np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan))

    def number(self, name: str) -> float:
        """Value of a scalar, NaN where the file does not have it."""
        return float(self.numbers(name)[0]) if name in self else float("nan")

    def text(self, name: str) -> str:
        """Text in a variable of characters; empty where the file does not have it."""
        if name not in self:
            return ""
        values = np.ma.filled(self._read(name), b"" if self._file.variables[name].dtype == "S1" else "")
        return b"".join(values.ravel().tolist()).decode() if values.dtype.kind == "S" else str(values.ravel()[0])

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
        """Times ``(n,)`` by the CF unit declared; NaT where missing.

        Raises
        ------
        InputError
            As `numbers`, or the unit is not one of time.
        """
        units = " ".join(self.attribute("units", name).split()) if name in self else ""
        encoded = xr.Variable(("sample",), self.numbers(name), {"units": units or "seconds since 1970-01-01"})
        try:
            decoded = xr.conventions.decode_cf_variable(name, encoded)
        except ValueError as error:
            raise InputError(f"{self.path}: {name} is in '{units}', which is no unit of time") from error
        return np.asarray(decoded.values, dtype="datetime64[ns]")

    def _read(self, name: str) -> Any:
        try:
            return self._file.variables[name][...]
        except (OSError, RuntimeError) as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: Exception) -> InputError:
        content = describe_content(self.path)
        if content:
            return InputError(f"{self.path}: {content}")
        return InputError(f"{self.path}: cannot be read as netCDF, it may have been cut short ({error})")
