"""Stored files as Datasets, also where `scale_factor` or `add_offset` is a number that was written as text."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.errors import InputError
from gliderhpc.observations.files.classic_netcdf import refuse_cut_off

PACKING = ("scale_factor", "add_offset")
"""Attributes by which stored values are multiplied, and to which they are added."""

_STORAGE = ("engine", "consolidated", "cache")
"""Options of `xarray.open_dataset` that `xarray.decode_cf` does not accept."""


def open_dataset(path: Path, **options: Any) -> xr.Dataset:
    """Open a file with options of `xarray.open_dataset`.

    Raises
    ------
    InputError
        An attribute `scale_factor` or `add_offset` is not a number, or the file is truncated.
    OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError
        As for `xarray.open_dataset`.
    """
    if path.is_file():
        refuse_cut_off(path)
    dataset = xr.open_dataset(path, **options)
    packing = [variable.encoding.get(name) for variable in dataset.variables.values() for name in PACKING]
    if not any(isinstance(plain_value(value), str) for value in packing):
        return dataset
    dataset.close()
    return _with_numbers(path, options)


def _with_numbers(path: Path, options: dict[str, Any]) -> xr.Dataset:
    """Open a file after these attributes have been converted to numbers."""
    storage = {name: value for name, value in options.items() if name in _STORAGE}
    stored = xr.open_dataset(path, decode_cf=False, **storage)
    try:
        for name, variable in stored.variables.items():
            for attribute in PACKING:
                if isinstance(text := plain_value(variable.attrs.get(attribute)), str):
                    variable.attrs[attribute] = packing_number(text, f"{path}: {name}", attribute)
    except InputError:
        stored.close()
        raise
    decoded = xr.decode_cf(stored, **{name: value for name, value in options.items() if name not in storage})
    return decoded.load() if options.get("cache") else decoded


def plain_value(value: Any) -> Any:
    """Return the only value of an array of size 1; anything else unchanged."""
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def packing_number(value: Any, where: str, attribute: str) -> float:
    """Number that an attribute `scale_factor` or `add_offset` gives, also as text.

    Parameters
    ----------
    value : str, number or array of size 1
        The attribute.
    where, attribute : str
        Names of the file and variable, and of the attribute, in messages.

    Raises
    ------
    InputError
        The value is not a number.
    """
    plain = plain_value(value)
    try:
        return float(plain)
    except (TypeError, ValueError):
        raise InputError(
            f"{where} has the {attribute} '{plain}', which is not a number; correct this attribute"
        ) from None
