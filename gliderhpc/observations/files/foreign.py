"""Files of other programs and instruments: finding them, recognising their contents, converting units and names."""

import logging
import warnings
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import netCDF4
import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.files.classic_netcdf import refuse_cut_off
from gliderhpc.observations.files.columns import DEFAULT_UNITS, NamedColumns, find_name
from gliderhpc.observations.files.file_content import describe_content, describe_failure, describe_missing
from gliderhpc.observations.files.packed import PACKING, packing_number, plain_value
from gliderhpc.observations.files.quality_flags import Rejected, find_rejected, numeric_flags
from gliderhpc.observations.files.valid_limits import LIMITS, limits_of, outside
from gliderhpc.observations.records import FloatArray, TimeArray
from gliderhpc.observations.times import check_resolution

log = logging.getLogger(__name__)

_FILLS = ("_FillValue", "missing_value")

_COMPRESSED = (".gz", ".bz2", ".xz", ".zip")


def files_of(sources: Sequence[Path], belongs: Callable[[Path], bool]) -> Iterator[Path]:
    """Iterate over the given files, and over the files of given folders that `belongs` accepts, sorted by name.

    Raises
    ------
    InputError
        A source does not exist or is not a regular file, or its files are compressed.
    """
    for source in sources:
        if source.is_dir():
            held = sorted(source.iterdir())
            # Reading a pipe or a device that is named like a record would block, or never end.
            chosen = [path for path in held if belongs(path) and path.is_file()]
            name_compressed(chosen, held, belongs)
            yield from chosen
        elif source.is_file():
            if not belongs(source):
                refuse_compressed([source])
            yield source
        else:
            what = "is a device or a pipe, not a regular file" if source.exists() else describe_missing(source)
            raise InputError(f"{source}: {what}")


def name_compressed(chosen: Sequence[Path], held: Sequence[Path], belongs: Callable[[Path], bool]) -> None:
    """Warn once of each compressed file of a folder that is left out, or refuse it if there is no other.

    Parameters
    ----------
    chosen : sequence of Path
        Files of the folder that are read. A compressed file whose unpacked copy is among them is not named.
    held : sequence of Path
        All files of the folder.
    belongs : callable
        Whether a file is a record, by its name.

    Raises
    ------
    InputError
        Nothing is read, and a record is compressed.
    """
    candidates = [path for path in held if belongs(path.with_suffix(""))]
    if not chosen:
        refuse_compressed(candidates)
    for path in candidates:
        # Some instruments' files are read as they are, compressed.
        if path.suffix.lower() in _COMPRESSED and path not in chosen and path.with_suffix("") not in chosen:
            _warn_of_compressed(path)


@cache
def _warn_of_compressed(path: Path) -> None:
    log.warning("%s: is compressed and is left out; unpack it first", path)


def refuse_compressed(paths: Iterable[Path]) -> None:
    """Refuse the first file that is compressed according to its name and content.

    Raises
    ------
    InputError
        A file is compressed; the message gives the remedy.
    """
    for path in paths:
        content = describe_content(path) if path.suffix.lower() in _COMPRESSED and path.is_file() else ""
        if content:
            raise InputError(f"{path}: {content}")


HELPFUL_ORDER = ("ballast_volume", "battery_position", "battery_rotation", "pitch", "roll", "heading", "depth", "time")
"""Required variables; the first is in the glider's own files only, and without it the others are useless."""

ALIASES = {
    "time": ("time",),
    "depth": ("depth", "glider_depth"),
    "pitch": ("pitch", "glider_pitch", "platform_pitch"),
    "roll": ("roll", "glider_roll", "platform_roll"),
    "heading": ("heading", "glider_heading", "platform_heading"),
    "ballast_volume": ("ballast_volume", "vbd_cc"),
    "battery_position": ("battery_position", "pitch_ctl"),
    "battery_rotation": ("battery_rotation", "roll_ctl"),
}
"""Possible names by variable, in lower case; matching ignores case."""

_SLOCUM_SENSORS = ("m_present_time", "m_battpos", "m_de_oil_vol", "m_ballast_pumped", "sci_m_present_time")

_KINDS = (
    ("slocum", "the sensors of a Slocum", _SLOCUM_SENSORS),
    ("seaglider", "a Seaglider's dive", ("log_gps_lat", "eng_vbdcc", "eng_pitchang", "gc_vbd_ad")),
    ("og1", "a Seaglider's controls", ("vbd_cc",)),
)
"""Importer, contents in words, and names that occur only in such a file."""

OWN_FILES = (
    "import the glider's own files instead (`gliderhpc import`: SeaExplorer text, Slocum binary, Seaglider dives)"
)


def importer_of(names: Iterable[str]) -> tuple[str, str] | None:
    """Importer that reads a file with these variables, and the file's contents in words; None if there is none."""
    folded = {name.casefold() for name in names}
    return next(((importer, held) for importer, held, marks in _KINDS if not folded.isdisjoint(marks)), None)


IN_THE_FORMAT = (
    "is already in the observation format, so there is nothing to import; give it to `gliderhpc currents`, `gliderhpc "
    "inspect` or `gliderhpc run-mission` unchanged"
)


def is_in_the_format(names: Iterable[str]) -> bool:
    """Return whether a file with these variables is in the observation format."""
    return set(HELPFUL_ORDER) <= set(names)


def describe_found(names: Iterable[str], variables: Iterable[str]) -> str:
    """List required variables that a file has under another name (``pitch as GLIDER_PITCH``); empty if there is none.

    Parameters
    ----------
    names : iterable of str
        Names of the file's variables.
    variables : iterable of str
        The variables to look for.
    """
    there = list(names)
    found = {variable: find_name(there, ALIASES[variable]) for variable in variables}
    return ", ".join(f"{variable} as {name}" for variable, name in found.items() if name is not None)


class ForeignFile(NamedColumns):
    """A netCDF file of another program, open for reading (a context manager).

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        It is not a netCDF file, is compressed, or is truncated.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.source = path, str(path)
        self._rejected = Rejected()
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is not a regular file")
        try:
            refuse_cut_off(path)
            self._file = netCDF4.Dataset(path, "r")
        except (OSError, RuntimeError, UnicodeError) as error:
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
        """Return the first of the names that the file has; None if it has none."""
        return next((name for name in names if name in self), None)

    def numbers(self, name: str) -> FloatArray:
        """Values ``(n,)`` without conversion, NaN where missing or infinite, without dimensions of length 1.

        Values outside the limits that the file declares are missing too.

        Raises
        ------
        InputError
            The file has no such variable, the variable is not numeric or has several dimensions longer than 1, or
            the file is truncated.
        """
        if name not in self:
            raise InputError(f"{self.path}: has no variable {name}")
        values = self.unlimited(name)
        return np.where(outside(values, self.limits(name)), np.nan, values)

    def limits(self, name: str) -> tuple[float, float] | None:
        """Limits that the file declares for the values of a variable; None if there are none that can be used."""
        variable = self._file.variables[name]
        declared = {each: variable.getncattr(each) for each in LIMITS if each in variable.ncattrs()}
        if not declared or variable.dtype is str or variable.dtype.kind not in "fiu":
            return None
        return limits_of(declared, self._packing(name), variable.dtype)

    def unlimited(self, name: str) -> FloatArray:
        """Values ``(n,)`` as `numbers`, including those outside the declared limits."""
        variable = self._file.variables[name]
        if set(LIMITS).isdisjoint(variable.ncattrs()):
            return self._as_numbers(name, self._read(name))
        # The library masks fill values and limits together, and takes all limits as packed.
        variable.set_auto_mask(False)
        try:
            values = self._as_numbers(name, self._read(name))
            variable.set_auto_scale(False)
            stored = np.asarray(self._read(name)).ravel()
        finally:
            variable.set_auto_maskandscale(True)
        return np.where(np.isin(stored, _fill_values(variable)), np.nan, values)

    def _as_numbers(self, name: str, read: Any) -> FloatArray:
        values = np.ma.asarray(read)
        if values.dtype.kind not in "fiu":
            raise InputError(f"{self.path}: {name} does not contain numbers")
        if max(values.shape, default=1) != values.size:
            raise InputError(f"{self.path}: {name} has {values.ndim} dimensions; it must have one")
        numbers = np.ma.filled(values.ravel().astype(np.float64), np.nan)
        # An infinite value was not measured.
        return self._rejected.without(name, np.where(np.isfinite(numbers), numbers, np.nan))

    def times(self, name: str) -> TimeArray:
        """Times ``(n,)``, as `NamedColumns.times`; `InputError` too if the stored type does not resolve them."""
        # Most files store times in double precision, and need not be read twice.
        if name in self and self._file.variables[name].dtype != np.float64 and not self._is_text(name):
            stored = np.ma.asarray(self._read(name)).compressed()
            if stored.dtype.kind == "f":
                check_resolution(stored, self.attribute("units", name) or DEFAULT_UNITS, f"{self.path}: {name}")
        return self._rejected.without_times(name, super().times(name))

    def present(self, name: str) -> npt.NDArray[np.bool_]:
        """Mask ``(n,)`` of the values of a variable that are neither missing nor rejected."""
        there, rejected = super().present(name), self._rejected.masks.get(name)
        return there if rejected is None else there & ~rejected

    def texts(self, name: str) -> npt.NDArray[np.str_] | None:
        """Texts ``(n,)`` in a variable; None if it contains numbers."""
        if not self._is_text(name):
            return None
        values = np.ma.filled(self._read(name), "")
        if values.dtype.kind == "S":
            values = netCDF4.chartostring(values) if values.ndim > 1 else values
        return np.asarray(values.ravel().astype("U"))

    def _is_text(self, name: str) -> bool:
        stored = self._file.variables[name].dtype if name in self else None
        return stored is str or (isinstance(stored, np.dtype) and stored.kind in "SU")

    def flags(self, name: str) -> FloatArray:
        """Quality flags ``(n,)`` in a variable as numbers, NaN where absent; empty if it has several dimensions."""
        values = np.ma.asarray(self._read(name))
        if max(values.shape, default=1) != values.size:
            return np.zeros(0)
        values = values.ravel()
        if values.dtype.kind in "fiu":
            return np.ma.filled(values.astype(np.float64), np.nan)
        return numeric_flags(np.ma.filled(values, b"" if values.dtype.kind == "S" else ""))

    def reject_flagged(self, names: Iterable[str], needed: Container[str] = ()) -> str:
        """Treat the values of some variables that are flagged bad or missing as missing from now on.

        Return a remark that counts them, empty if there are none; for `needed` and errors see `find_rejected`.
        """
        self._rejected = find_rejected(self, names, needed)
        return self._rejected.remark

    def reject(self, masks: Mapping[str, npt.NDArray[np.bool_]]) -> None:
        """Treat values, given by a mask ``(n,)`` for each variable, as missing from now on."""
        joined = {name: mask | self._rejected.masks.get(name, False) for name, mask in masks.items()}
        self._rejected = replace(self._rejected, masks=self._rejected.masks | joined)

    def number(self, name: str) -> float:
        """Value of a scalar, NaN if the file does not have it."""
        values = self.numbers(name) if name in self else np.zeros(0)
        return float(values[0]) if len(values) else float("nan")

    def check_lengths(self, names: Iterable[str]) -> None:
        """Refuse variables that belong together but differ in length; variables that the file lacks are skipped.

        Raises
        ------
        InputError
            The lengths differ; the message names the first variable that differs.
        """
        lengths = {name: len(self.present(name)) for name in names if name in self}
        first = next(iter(lengths), "")
        odd = next((name for name, length in lengths.items() if length != lengths[first]), None)
        if odd is not None:
            raise InputError(
                f"{self.path}: {odd} has {lengths[odd]} values and {first} has {lengths[first]}; they must have the "
                "same length"
            )

    def text(self, name: str) -> str:
        """Text in a character variable; empty if the file does not have it."""
        if name not in self:
            return ""
        values = np.ma.asarray(self._read(name))
        if values.dtype.kind == "S":
            return b"".join(values.filled(b"").ravel().tolist()).decode("utf-8", errors="replace")
        return str(values.ravel()[0]) if values.size and values.dtype.kind in "OU" else ""

    def _read(self, name: str) -> Any:
        variable = self._file.variables[name]
        packing = self._packing_in_text(name)
        if packing is not None:
            variable.set_auto_scale(False)
        try:
            # Of attributes that the library cannot use, such as a missing_value of another type, it only warns.
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                values = variable[...]
        except (OSError, RuntimeError, UnicodeDecodeError, ValueError) as error:
            raise self._unreadable(error) from error
        return values if packing is None else values * packing[0] + packing[1]

    def _packing_in_text(self, name: str) -> tuple[float, float] | None:
        """Scale factor and offset of a variable if at least one is written as text; the library uses numbers only."""
        variable = self._file.variables[name]
        given = [variable.getncattr(each) for each in PACKING if each in variable.ncattrs()]
        if not any(isinstance(plain_value(value), str | np.ndarray) for value in given):
            return None
        known = self._packing(name)
        return known.get("scale_factor", 1.0), known.get("add_offset", 0.0)

    def _packing(self, name: str) -> dict[str, float]:
        """Scale factor and offset of a variable, as far as it has them."""
        variable = self._file.variables[name]
        given = {each: variable.getncattr(each) for each in PACKING if each in variable.ncattrs()}
        return {each: packing_number(value, f"{self.path}: {name}", each) for each, value in given.items()}

    def _unreadable(self, error: Exception) -> InputError:
        content = describe_failure(self.path, error)
        if content:
            return InputError(f"{self.path}: {content}")
        return InputError(f"{self.path}: cannot be read as netCDF ({error})")


def _fill_values(variable: "netCDF4.Variable[Any]") -> npt.NDArray[np.generic]:
    """Values of a variable, as stored, that mean missing: declared ones, or the library's own by default."""
    declared = [np.ravel(variable.getncattr(each)) for each in _FILLS if each in variable.ncattrs()]
    known = [values for values in declared if values.dtype.kind in "fiu"]
    if "_FillValue" not in variable.ncattrs() and variable.dtype.itemsize > 1:
        known.append(np.ravel(netCDF4.default_fillvals[variable.dtype.str[1:]]))
    return np.concatenate(known) if known else np.zeros(0)
