"""A netCDF-4 file that is written piece by piece along growing axes.

The file appears only when it is complete, and the same content always gives the same bytes.
"""

import math
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import netCDF4
import numpy as np
import numpy.typing as npt

from gliderhpc.errors import InputError
from gliderhpc.observations.writer import Attribute
from gliderhpc.output_files import full_disk_error, written_aside

CHUNK = 16_384
"""Rows in a chunk of the file along an axis that grows."""


@dataclass(frozen=True, eq=False)
class Column:
    """A piece of one variable.

    Attributes
    ----------
    dimensions : tuple of str
        Its axes; none for a single value, which is written once.
    values : array
        Values of the piece. Times are ``datetime64``; they are stored as seconds since the day of the file's first
        time. A single value may be text.
    attributes : dict
        Attributes of the variable; those of its first piece are used.
    grows : bool
        True if the first axis grows with every piece; otherwise only the first piece is written.
    fill : float, optional
        Fill value of missing values; by default NaN for floating-point numbers, and none for others.
    """

    dimensions: tuple[str, ...]
    values: npt.NDArray[np.generic]
    attributes: Mapping[str, Any]
    grows: bool = True
    fill: float | None = None


class AppendedFile:
    """A file under construction (a context manager).

    It is written to a temporary file, which replaces `path` on completion and is removed after a failure.

    Parameters
    ----------
    path : Path
        The file to write.
    attributes : mapping
        Global attributes.
    chunks : mapping of str to int, optional
        Rows in a chunk by axis; `CHUNK` for the other axes.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    InputError
        The file exists and may not be replaced, is not a regular file, or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        attributes: Mapping[str, Attribute],
        chunks: Mapping[str, int] | None = None,
        *,
        overwrite: bool = False,
    ) -> None:
        self._path = path
        self._place = ExitStack()
        self._aside = self._place.enter_context(written_aside(path, overwrite=overwrite))
        self._chunks = dict(chunks or {})
        self._epoch: np.datetime64 | None = None
        try:
            self._file = netCDF4.Dataset(self._aside, "w", format="NETCDF4")
        except OSError as error:
            failure = self._failure(error)
            self._place.__exit__(type(failure), failure, None)
            raise failure from error
        self._file.setncatts(dict(attributes))
        self._variables: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            # The temporary file is removed if the block or the final write has failed.
            with self._place:
                self._file.close()
                if error is not None:
                    self._place.__exit__(kind, error, traceback)
        except (OSError, RuntimeError) as failure:
            raise self._failure(failure) from failure

    def describe(self, attributes: Mapping[str, Attribute]) -> None:
        """Add global attributes, such as those of the whole file that are known only at its end."""
        try:
            self._file.setncatts(dict(attributes))
        except (OSError, RuntimeError) as error:
            raise self._failure(error) from error

    def append(self, columns: Mapping[str, Column]) -> None:
        """Append a piece of every variable that grows; other variables are written with their first piece.

        A name ``GROUP/NAME`` denotes a variable of a group. The group is created with its first variable; all axes
        belong to the file.

        Raises
        ------
        InputError
            The file cannot be written.
        OSError
            The disk is full.
        """
        try:
            begins = {name: len(dimension) for name, dimension in self._file.dimensions.items()}
            for name, column in columns.items():
                self._write(name, column, begins)
        except (OSError, RuntimeError) as error:
            raise self._failure(error) from error

    def _write(self, name: str, column: Column, begins: Mapping[str, int]) -> None:
        values = self._encoded(column.values)
        known = name in self._variables
        if not column.dimensions:
            if not known:
                self._create_single(name, column, values)
            return
        variable = self._variables[name] if known else self._create(name, column, values.dtype)
        axis = column.dimensions[0]
        if column.grows:
            begin = begins.get(axis, 0)
            variable[begin : begin + len(values)] = values
        elif not known:
            variable[:] = values

    def _create(self, name: str, column: Column, dtype: np.dtype[Any]) -> Any:
        for place, (dimension, size) in enumerate(zip(column.dimensions, column.values.shape, strict=True)):
            if dimension not in self._file.dimensions:
                self._file.createDimension(dimension, None if column.grows and place == 0 else size)
        shape = tuple(self._chunk(dimension) for dimension in column.dimensions)
        # Missing values are NaN; whole numbers and times are never missing, unless the column gives a fill value.
        fill = np.nan if dtype.kind == "f" and column.values.dtype.kind != "M" else False
        fill = fill if column.fill is None else column.fill
        variable = self._file.createVariable(
            name, dtype, column.dimensions, zlib=True, complevel=4, shuffle=True, chunksizes=shape, fill_value=fill
        )
        # Rows are only appended, so a cache of two chunks is enough; the library's default is tens of megabytes.
        variable.set_var_chunk_cache(2 * math.prod(shape) * dtype.itemsize, 11, 1.0)
        variable.set_auto_maskandscale(False)
        self._variables[name] = variable
        variable.setncatts(dict(column.attributes))
        if column.values.dtype.kind == "M":
            variable.setncatts({"units": f"seconds since {self._epoch}T00:00:00", "calendar": "standard"})
        return variable

    def _create_single(self, name: str, column: Column, value: npt.NDArray[Any]) -> None:
        variable = self._file.createVariable(name, str if value.dtype.kind == "U" else value.dtype, ())
        self._variables[name] = variable
        variable.setncatts(dict(column.attributes))
        variable[...] = value.item()

    def _chunk(self, dimension: str) -> int:
        size = self._file.dimensions[dimension]
        return self._chunks.get(dimension, CHUNK) if size.isunlimited() else len(size)

    def _encoded(self, values: npt.NDArray[np.generic]) -> npt.NDArray[Any]:
        if values.dtype.kind != "M":
            return values
        if self._epoch is None:
            self._epoch = np.datetime64(values[0], "D")
        elapsed = (values.astype("datetime64[ns]") - self._epoch.astype("datetime64[ns]")).astype(np.int64)
        seconds: npt.NDArray[np.float64] = elapsed / 1e9
        return seconds

    def _failure(self, error: Exception) -> Exception:
        full = full_disk_error(error, self._aside, self._path)
        return full or InputError(f"{self._path}: cannot be written: {getattr(error, 'strerror', None) or error}")
