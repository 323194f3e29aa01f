"""Text tables from ERDDAP: names and units in the header, times in ISO 8601."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gliderhpc.errors import InputError, first_line
from gliderhpc.observations.files.file_content import describe_content
from gliderhpc.observations.files.foreign import importer_of
from gliderhpc.observations.times import parse_times
from gliderhpc.yaml_text import shown

_UNIT_IN_HEAD = re.compile(r"^(?P<name>[^(]+?)\s*\((?P<unit>.*)\)$")
_VALUE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|\d{4}-\d\d-\d\d.*", re.IGNORECASE)
"""A number, or a time in ISO 8601."""

_NUMERIC_UNITS = ("1", "1e-3", "0.001")
"""Units of dimensionless quantities."""

_COLUMNS = re.compile(r"Expected (?P<expected>\d+) fields in line (?P<line>\d+), saw (?P<found>\d+)")
"""Message of pandas on a row with too many columns."""

_MISSING = ("", "nan", "na", "n/a", "null")
"""Missing values as programs write them, in lower case."""

_TIME_UNIT = "utc"
"""Unit in ERDDAP tables of times in ISO 8601."""


def is_table(path: Path) -> bool:
    """Return whether a path is named like a text table from ERDDAP: ``.csv`` or ``.csvp``."""
    return path.suffix.lower() in (".csv", ".csvp")


def read_table(path: Path) -> xr.Dataset:
    """Read a table from ERDDAP, with units in the second row (``.csv``), or in brackets after the names (``.csvp``).

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    xarray.Dataset
        Columns along ``row``, with their units and decoded times.

    Raises
    ------
    InputError
        The file is not such a table, or a value in it is not a number or time.
    """
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
    except (OSError, UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        what = describe_content(path)
        if not what and isinstance(error, UnicodeDecodeError):
            what = "is not UTF-8 text; convert its encoding"
        if not what and isinstance(error, pd.errors.ParserError):
            what = _describe_rows(path, str(error))
        raise InputError(f"{path}: {what or f'cannot be read as an ERDDAP table ({first_line(error)})'}") from error
    if table.columns[0].startswith("#"):
        raise InputError(f"{path}: begins with a comment; remove it, so that the names of the columns come first")
    _check_separator([str(column) for column in table.columns], path)
    _check_sensors([str(column) for column in table.columns], path)
    heads = [_UNIT_IN_HEAD.match(str(column)) for column in table.columns]
    if any(heads):
        names = [
            str(column) if head is None else head["name"] for head, column in zip(heads, table.columns, strict=True)
        ]
        units = ["" if head is None else head["unit"] for head in heads]
    elif len(table):
        _check_units(table.iloc[0].astype(str).str.strip(), path)
        names, units = [str(column) for column in table.columns], [str(unit) for unit in table.iloc[0]]
        table = table.iloc[1:]
    else:
        raise InputError(f"{path}: is not an ERDDAP table: the row of units is missing")
    columns = {
        name: ("row", *_column(table.iloc[:, place].to_numpy(dtype=str), name, unit, path))
        for place, (name, unit) in enumerate(zip(names, units, strict=True))
    }
    return xr.Dataset(columns, attrs={"title": "ERDDAP table", "id": path.stem})


def _describe_rows(path: Path, error: str) -> str:
    """Describe the separator or the row that has too many columns; empty if the error is another one."""
    counts = _COLUMNS.search(error)
    if counts is None:
        return ""
    with path.open(encoding="utf-8-sig", errors="replace") as text:
        names = next((line for line in text if line.strip()), "")
    if names.count(";") > names.count(","):
        return "its columns are separated by semicolons; write it with commas between columns and decimal points"
    return f"line {counts['line']} has {counts['found']} columns instead of {counts['expected']}; correct it"


def _check_separator(names: Sequence[str], path: Path) -> None:
    """Refuse a table whose only column has a name with another separator.

    Raises
    ------
    InputError
        The columns are separated by semicolons or tabs.
    """
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and separator in names[0]:
            raise InputError(f"{path}: its columns are separated by {word}; separate them by commas")


def _check_sensors(names: Sequence[str], path: Path) -> None:
    """Refuse a text table of a glider's own sensors, such as one exported by dbdreader.

    Raises
    ------
    InputError
        The columns are sensors of a Slocum or a Seaglider.
    """
    importer, held = importer_of(names) or ("", "")
    if importer in ("slocum", "seaglider"):
        raise InputError(
            f"{path}: contains {held} as text; give the glider's own files, or netCDF with the units of each variable, "
            f"to `gliderhpc import {importer}`"
        )


def _check_units(units: pd.Series, path: Path) -> None:
    """Refuse a table whose second row contains values in place of units.

    Raises
    ------
    InputError
        The row contains a time, or a number that is no unit.
    """
    values = {name: text for name, text in units.items() if _VALUE.fullmatch(text) and text not in _NUMERIC_UNITS}
    if values:
        name, text = next(iter(values.items()))
        raise InputError(
            f"{path}: has values where an ERDDAP table has its units, in the row after the names ({name} is '{text}'); "
            "insert a row of units, such as UTC, degrees_north, m, degree"
        )


def _column(texts: np.ndarray, name: str, unit: str, path: Path) -> tuple[np.ndarray, dict[str, str]]:
    """Values of a column and its attributes; a column without any number remains text."""
    texts = np.char.strip(texts)
    if unit.lower() == _TIME_UNIT:
        return parse_times(texts, f"{path}: {name}"), {"standard_name": "time"}
    numbers = pd.to_numeric(pd.Series(texts).replace("", "NaN"), errors="coerce").to_numpy(dtype=np.float64)
    missing = np.isin(np.char.lower(texts), _MISSING)
    odd = np.flatnonzero(np.isnan(numbers) & ~missing)
    if not len(odd):
        return numbers, {"units": unit} if unit else {}
    if len(odd) == np.count_nonzero(~missing):
        return texts, {}
    raise InputError(
        f"{path}: {name} in row {int(odd[0]) + 1} of the values is {shown(str(texts[odd[0]]))}, which is not a number"
    )
