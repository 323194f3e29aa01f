"""NetCDF file as plain arrays, edited variable by variable and written again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

Edit = list[Any]


@dataclass
class Variable:
    """A variable as stored: nothing is masked, scaled or decoded."""

    dimensions: tuple[str, ...]
    values: np.ndarray
    attributes: dict[str, Any]
    fill: Any = None
    is_text: bool = False


@dataclass
class File:
    """The content of a netCDF file; `group` and `layout` say how it is to be written."""

    sizes: dict[str, int]
    variables: dict[str, Variable]
    attributes: dict[str, Any]
    group: str | None = None
    layout: str = "NETCDF4"
    calendars: dict[str, str] = field(default_factory=dict)


def read(path: Path) -> File:
    """Read a file whole."""
    with netCDF4.Dataset(path) as source:
        source.set_auto_maskandscale(False)
        variables = {}
        for name, variable in source.variables.items():
            attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
            fill = attributes.pop("_FillValue", None)
            text = variable.dtype is str
            variables[name] = Variable(variable.dimensions, np.asarray(variable[...]), attributes, fill, text)
        sizes = {name: len(dimension) for name, dimension in source.dimensions.items()}
        return File(sizes, variables, {key: source.getncattr(key) for key in source.ncattrs()})


def write(file: File, path: Path) -> None:
    """Write a file; what netCDF cannot hold raises."""
    with netCDF4.Dataset(path, "w", format=file.layout) as root:
        out = root.createGroup(file.group) if file.group else root
        for name, size in file.sizes.items():
            out.createDimension(name, size)
        for name, variable in file.variables.items():
            kind = str if variable.is_text else variable.values.dtype
            made = out.createVariable(name, kind, variable.dimensions, fill_value=variable.fill)
            made.set_auto_maskandscale(False)
            made.setncatts(variable.attributes)
            made[...] = variable.values
        out.setncatts(file.attributes)


def edited(path: Path, edits: list[Edit]) -> list[str]:
    """Apply edits to a file in place; gives those that could not be applied, which leave the file as it was."""
    failed = []
    for edit in edits:
        file = read(path)
        temporary = path.with_name("edited.tmp")
        try:
            EDITS[edit[0]](file, *edit[1:])
            write(file, temporary)
        except (ValueError, TypeError, ArithmeticError, RuntimeError, LookupError, AttributeError) as error:
            failed.append(f"{edit}: {error}")
            temporary.unlink(missing_ok=True)
            continue
        temporary.rename(path)
    return failed


def _name(file: File, which: int | str) -> str:
    """Name a variable by its name or by any number."""
    names = list(file.variables)
    return which if isinstance(which, str) else names[which % len(names)]


def _variable(file: File, which: int | str) -> Variable:
    return file.variables[_name(file, which)]


def _place(values: np.ndarray, fraction: float) -> int:
    return min(int(fraction * values.size), values.size - 1)


def drop(file: File, which: int | str) -> None:
    """Leave a variable out."""
    del file.variables[_name(file, which)]


def rename(file: File, which: int | str, name: str) -> None:
    """Give a variable another name."""
    file.variables[name] = file.variables.pop(_name(file, which))


def retype(file: File, which: int | str, kind: str) -> None:
    """Store a variable as another type; ``str`` as strings, ``S1`` as characters."""
    variable = _variable(file, which)
    variable.fill = None
    if kind == "str":
        variable.values = np.array([str(value) for value in variable.values.ravel()], object)
        variable.values = variable.values.reshape([file.sizes[name] for name in variable.dimensions])
        variable.is_text = True
    else:
        with np.errstate(all="ignore"):
            variable.values = variable.values.astype(kind)


def fill_value(file: File, which: int | str, value: Any, fraction: float, count: int) -> None:
    """Declare a fill value and put it into some samples."""
    variable = _variable(file, which)
    with np.errstate(all="ignore"):
        variable.fill = np.array(value).astype(variable.values.dtype)
    _put(variable, variable.fill, fraction, count)


def put(file: File, which: int | str, value: Any, fraction: float, count: int) -> None:
    """Put a value into some samples."""
    _put(_variable(file, which), value, fraction, count)


def _put(variable: Variable, value: Any, fraction: float, count: int) -> None:
    flat = variable.values.reshape(-1).copy()
    begin = _place(flat, fraction)
    with np.errstate(all="ignore"):
        flat[begin : begin + count] = np.array(value).astype(flat.dtype)
    variable.values = flat.reshape(variable.values.shape)


def constant(file: File, which: int | str, value: Any) -> None:
    """Make every sample the same."""
    put(file, which, value, 0.0, _variable(file, which).values.size)


def scale(file: File, which: int | str, factor: float) -> None:
    """Multiply a variable."""
    variable = _variable(file, which)
    with np.errstate(all="ignore"):
        variable.values = (variable.values * factor).astype(variable.values.dtype)


def shift(file: File, which: int | str, by: float, fraction: float) -> None:
    """Add to all samples from somewhere on: a gap, a clock set back, a position far off."""
    variable = _variable(file, which)
    flat = variable.values.reshape(-1).copy()
    begin = _place(flat, fraction)
    with np.errstate(all="ignore"):
        flat[begin:] = (flat[begin:] + by).astype(flat.dtype)
    variable.values = flat.reshape(variable.values.shape)


def reverse(file: File, which: int | str) -> None:
    """Turn the order of a variable round."""
    variable = _variable(file, which)
    variable.values = variable.values[::-1]


def reverse_dimension(file: File, which: int) -> None:
    """Turn the order of everything along a dimension round."""
    _taken(file, which, lambda size: np.arange(size)[::-1])


def shuffle_dimension(file: File, which: int, seed: int) -> None:
    """Mix the order of everything along a dimension."""
    _taken(file, which, np.random.default_rng(seed).permutation)


def repeat(file: File, which: int, fraction: float, count: int) -> None:
    """Repeat a sample."""
    _taken(file, which, lambda size: np.sort(np.r_[np.arange(size), [min(int(fraction * size), size - 1)] * count]))


def cut(file: File, which: int, count: int) -> None:
    """Keep only the first samples along a dimension."""
    _taken(file, which, lambda size: np.arange(min(size, count)))


def _taken(file: File, which: int, order: Callable[[int], np.ndarray]) -> None:
    names = list(file.sizes)
    name = names[which % len(names)]
    rows = order(file.sizes[name])
    for variable in file.variables.values():
        for axis, dimension in enumerate(variable.dimensions):
            if dimension == name:
                variable.values = np.take(variable.values, rows, axis)
    file.sizes[name] = len(rows)


def attribute(file: File, which: int | str, name: str, value: Any) -> None:
    """Set an attribute; bytes are given as ``{"hex": ...}``, which no text encoding need fit."""
    _variable(file, which).attributes[name] = _decoded(value)


def global_attribute(file: File, name: str, value: Any) -> None:
    """Set a global attribute."""
    file.attributes[name] = _decoded(value)


def _decoded(value: Any) -> Any:
    if isinstance(value, dict):
        return np.array(bytes.fromhex(value["hex"]))  # without a dimension: netCDF4 joins arrays as text
    return np.array(value) if isinstance(value, list) else value


def drop_attribute(file: File, which: int | str, name: str) -> None:
    """Remove an attribute."""
    del _variable(file, which).attributes[name]


def dimensions(file: File, which: int | str, how: str) -> None:
    """Give a variable other dimensions: ``scalar``, ``two`` (a second of length 2) or ``own`` (one of its own)."""
    name = _name(file, which)
    variable = file.variables[name]
    if how == "scalar":
        variable.dimensions, variable.values = (), variable.values.reshape(-1)[0]
        variable.values = np.asarray(variable.values)
    elif how == "two":
        file.sizes["second"] = 2
        variable.dimensions = (*variable.dimensions, "second")
        variable.values = np.stack([variable.values, variable.values], -1)
    else:
        file.sizes[f"{name}_own"] = variable.values.size
        variable.dimensions, variable.values = (f"{name}_own",), variable.values.reshape(-1)


def group(file: File, name: str) -> None:
    """Put everything into a group."""
    file.group = name


def layout(file: File, name: str) -> None:
    """Write another of netCDF's formats."""
    file.layout = name


EDITS: dict[str, Callable[..., None]] = {
    "drop": drop, "rename": rename, "type": retype, "fill": fill_value, "put": put, "constant": constant,
    "scale": scale, "shift": shift, "reverse": reverse, "reverse-dimension": reverse_dimension,
    "shuffle": shuffle_dimension, "repeat": repeat, "cut": cut, "attribute": attribute,
    "global": global_attribute, "drop-attribute": drop_attribute, "dimensions": dimensions, "group": group,
    "layout": layout,
}  # fmt: skip
"""Edits by the name that recipes use."""
