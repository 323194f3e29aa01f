"""The archive's table of profiles as arrays: what the overview is drawn from."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.archive.taken_current import TakenCurrent, taken_current
from gliderhpc.report.page.content import Row

Array = NDArray[np.float64]

FIRST = ("status", "start_time", "max_depth", "duration", "converged_fraction")
"""Columns of the archive's that the table begins with, behind the number."""

CURRENT = ("current_north, m s-1", "current_north_std, m s-1", "current_east, m s-1", "current_east_std, m s-1",
           "current_by")  # fmt: skip
"""Columns of the current that is taken; they come next, then the message."""

SHOWN = len(FIRST) + len(CURRENT) + 2
"""Columns that a page shows, the number and the message among them."""


@dataclass(frozen=True, eq=False)
class MissionTable:
    """Profiles in the order of the archive.

    Attributes
    ----------
    dataset : xarray.Dataset
        The table, loaded.
    number : (n,) array of int
        Their numbers.
    status : (n,) array of str
        ``pending``, ``done`` or ``failed``.
    days, depth, duration, converged, seconds : (n,) arrays
        Days since the mission's first observation, greatest depth (m), length (s), share of windows that converged, and
        computing time (s); NaN where unknown.
    """

    dataset: xr.Dataset
    number: NDArray[np.int64]
    status: NDArray[np.str_]
    days: Array
    depth: Array
    duration: Array
    converged: Array
    seconds: Array

    @classmethod
    def of(cls, archive: xr.DataTree) -> "MissionTable":
        """Read an archive's table."""
        table = archive.to_dataset().load()
        status = np.array([str(one) for one in table["status"].values], dtype=np.str_)
        columns = ("elapsed_days", "max_depth", "duration", "converged_fraction", "run_seconds")
        return cls(table, table["profile"].values, status, *(table[name].values.astype(float) for name in columns))

    @property
    def done(self) -> NDArray[np.bool_]:
        """Profiles that are estimated."""
        return np.asarray(self.status == "done")

    @cached_property
    def taken(self) -> TakenCurrent:
        """The smoother's current where it is usable, else the adjoint's."""
        return taken_current(self.dataset)

    @property
    def current(self) -> tuple[Array, Array]:
        """Depth-averaged current to the north and to the east (m/s) as taken, NaN where there is none."""
        return self.taken.north, self.taken.east

    @property
    def current_std(self) -> Array:
        """Standard deviations of both components (m/s), one after the other."""
        return np.concatenate([self.taken.north_std, self.taken.east_std])

    @property
    def with_current(self) -> NDArray[np.bool_]:
        """Profiles with a current."""
        return np.asarray(np.isfinite(self.current).all(axis=0))

    @property
    def fixes(self) -> tuple[Array, Array]:
        """Latitudes and longitudes ``(n, 2)`` of entry and exit (degree), longitudes running on across 180."""
        latitude, longitude = (
            np.column_stack([self.column(f"{end}_{axis}") for end in ("entry", "exit")])
            for axis in ("latitude", "longitude")
        )
        return latitude, _running_on(longitude)

    @property
    def middle(self) -> tuple[Array, Array]:
        """Latitudes and longitudes ``(n,)`` halfway between the fixes."""
        latitude, longitude = self.fixes
        return latitude.mean(axis=1), longitude.mean(axis=1)

    def column(self, name: str) -> Array:
        """One column of numbers."""
        return np.asarray(self.dataset[name].values.astype(np.float64))

    def rows(self) -> list[Row]:
        """The whole table, the columns that matter most first."""
        taken = self.taken
        current = (taken.north, taken.north_std, taken.east, taken.east_std, taken.estimate)
        rest = [str(name) for name in self.dataset.data_vars if str(name) not in FIRST and str(name) != "message"]
        columns = self._columns(FIRST) | dict(zip(CURRENT, current, strict=True)) | self._columns(["message", *rest])
        return [
            {"profile": int(number), **{name: _plain(values[index]) for name, values in columns.items()}}
            for index, number in enumerate(self.number)
        ]

    def _columns(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        return {heading(self.dataset[name]): self.dataset[name].values for name in names}


def heading(variable: xr.DataArray) -> str:
    """Name of a variable and its unit, for the head of a column."""
    units = str(variable.attrs.get("units", "1"))
    timed = np.issubdtype(variable.dtype, np.datetime64)
    return str(variable.name) if units == "1" or timed else f"{variable.name}, {units}"


def _plain(value: Any) -> Any:
    if isinstance(value, np.datetime64):
        return value
    return value.item() if isinstance(value, np.generic) else value


def _running_on(longitude: Array) -> Array:
    """Longitudes without the jump at the antimeridian, missing ones left missing."""
    running = longitude.copy()
    known = np.isfinite(longitude)
    running[known] = np.unwrap(longitude[known], period=360.0)
    return running
