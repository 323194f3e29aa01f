"""Table of a mission's profiles, as the pages show it, with its adopted currents."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.angles import unwrap
from gliderhpc.archive.current import AdoptedCurrent, adopted_current
from gliderhpc.archive.reader import Archive
from gliderhpc.report.page.content import Row, heading
from gliderhpc.surfacing.dive_results import current_of_dive
from gliderhpc.surfacing.message import Current

Array = NDArray[np.float64]

LEADING_COLUMNS = ("status", "start_time", "max_depth", "duration", "converged_fraction")
"""Columns of the archive that follow the profile number on the page."""

CURRENT = (
    "current_north, m s-1",
    "current_north_std, m s-1",
    "current_east, m s-1",
    "current_east_std, m s-1",
    "current_by",
)
"""Columns of the adopted current, between the leading columns and the message."""

SHOWN = len(LEADING_COLUMNS) + len(CURRENT) + 2
"""Number of columns on the page, including the profile number and the message."""


@dataclass(frozen=True, eq=False)
class MissionTable:
    """Profiles in the order of the archive.

    Attributes
    ----------
    dataset : xarray.Dataset
        The archive's root group, loaded.
    number : (n,) array of int
        Profile numbers.
    status : (n,) array of str
        ``pending``, ``done`` or ``failed``.
    days, depth, duration, converged, seconds : (n,) arrays
        Days since the mission's first observation, maximum depth (m), duration (s), share of converged windows, and
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
    def of(cls, archive: Archive) -> MissionTable:
        """Read an archive's table."""
        table = archive.to_dataset().load()
        status = np.array([str(value) for value in table["status"].values], dtype=np.str_)
        columns = ("elapsed_days", "max_depth", "duration", "converged_fraction", "run_seconds")
        return cls(table, table["profile"].values, status, *(table[name].values.astype(float) for name in columns))

    @property
    def done(self) -> NDArray[np.bool_]:
        """Mask of the estimated profiles, shape (n,)."""
        return np.asarray(self.status == "done")

    @cached_property
    def adopted(self) -> AdoptedCurrent:
        """Adopted current: the smoother's where it is usable, otherwise the adjoint's."""
        return adopted_current(self.dataset)

    @property
    def current(self) -> tuple[Array, Array]:
        """Adopted depth-averaged current, north and east (m/s), shape (n,) each, NaN if unknown."""
        return self.adopted.north, self.adopted.east

    @property
    def current_std(self) -> Array:
        """Standard deviations of both components (m/s), concatenated to shape (2n,)."""
        return np.concatenate([self.adopted.north_std, self.adopted.east_std])

    @property
    def with_current(self) -> NDArray[np.bool_]:
        """Mask of the profiles with a current, shape (n,)."""
        return np.asarray(np.isfinite(self.current).all(axis=0))

    @property
    def fixes(self) -> tuple[Array, Array]:
        """Latitudes and longitudes ``(n, 2)`` of entry and exit (degrees), longitudes continuous across 180 degrees."""
        latitude, longitude = (
            np.column_stack([self.column(f"{end}_{axis}") for end in ("entry", "exit")])
            for axis in ("latitude", "longitude")
        )
        return latitude, unwrap(longitude)

    @property
    def middle(self) -> tuple[Array, Array]:
        """Latitudes and longitudes ``(n,)`` midway between the fixes (degrees)."""
        latitude, longitude = self.fixes
        return latitude.mean(axis=1), longitude.mean(axis=1)

    def column(self, name: str) -> Array:
        """Return one numeric column, shape (n,)."""
        return np.asarray(self.dataset[name].values.astype(np.float64))

    def rows(self) -> list[Row]:
        """Return the rows of the whole table, with the most relevant columns first."""
        adopted = self.adopted
        current = (adopted.north, adopted.north_std, adopted.east, adopted.east_std, adopted.estimate)
        rest = [
            str(name) for name in self.dataset.data_vars if str(name) not in LEADING_COLUMNS and str(name) != "message"
        ]
        columns = (
            self._columns(LEADING_COLUMNS)
            | dict(zip(CURRENT, current, strict=True))
            | self._columns(["message", *rest])
        )
        return [
            {"profile": int(number), **{name: _plain(values[index]) for name, values in columns.items()}}
            for index, number in enumerate(self.number)
        ]

    def _columns(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        return {heading(self.dataset[name]): self.dataset[name].values for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, np.datetime64):
        return value
    return value.item() if isinstance(value, np.generic) else value


def last_current(table: MissionTable) -> tuple[int, Current | None]:
    """Return the number of the last profile with a current, and that current; 0 and None if there is none."""
    known = np.flatnonzero(table.with_current)
    if not known.size:
        return 0, None
    return int(table.number[known[-1]]), current_of_dive(table.dataset.isel(profile=int(known[-1])))
