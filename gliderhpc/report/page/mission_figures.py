"""Table of the mission's profiles, and its figures: map, profiles by number, and computing time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.angles import unwrap
from gliderhpc.archive.current import AdoptedCurrent, adopted_current
from gliderhpc.archive.reader import Archive
from gliderhpc.findings.drawing import (
    ESTIMATE,
    FILTER,
    GLIDE_ANGLE,
    MODEL,
    SHADE,
    SMALL,
    SMOOTHER,
    TRUTH,
    label,
    legend,
    panels,
)
from gliderhpc.report.page.content import Row, heading
from gliderhpc.surfacing.dive_results import current_of_dive
from gliderhpc.surfacing.message import Current

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

Array = NDArray[np.float64]
Pair = tuple[Array, Array] | tuple[float, float]

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


def last_current(table: MissionTable) -> tuple[int, Current | None]:
    """Return the number of the last profile with a current, and that current; 0 and None if there is none."""
    known = np.flatnonzero(table.with_current)
    if not known.size:
        return 0, None
    return int(table.number[known[-1]]), current_of_dive(table.dataset.isel(profile=int(known[-1])))


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


_SIZE = (8.0, 6.4)
_ARROW_LENGTH = 0.12
"""Length of the arrow of the 90th percentile of the currents, relative to the map's diagonal."""

DEGREE = 111_195.0
"""Length of a degree of latitude, m."""

MIN_EXTENT = 2000.0
"""Minimum extent of a map, m."""

_ASPECT_RATIO, _MARGIN_FACTOR = 1.3, 1.12
"""Width over height of the map, and size of the map relative to its content."""


def map_figure(table: MissionTable) -> Figure | None:
    """Draw the dives and their currents, with latitude and longitude (degrees) to the same scale.

    Parameters
    ----------
    table : MissionTable
        Profiles of the mission.

    Returns
    -------
    matplotlib.figure.Figure or None
        Map; None if no profile has a fix before and after it.
    """
    latitude, longitude = table.fixes
    if not np.isfinite(latitude).all(axis=1).any():
        return None
    mission = table.dataset.attrs.get("mission") or "mission"
    figure, (axes,) = panels(1, 1, _SIZE, f"Track and depth-averaged currents: {mission}")
    shrink = math.cos(math.radians(float(np.nanmean(latitude))))
    lon, lat = _joined(longitude, latitude)
    axes.plot(lon, lat, color="#888888", linewidth=0.6, zorder=1.0)
    dives = axes.plot(longitude.T, latitude.T, ".-", color=MODEL, linewidth=2.2, markersize=5, zorder=2.0)
    dives[0].set_label("dive, from fix to fix")
    axes.plot(lon[0], lat[0], "o", color=TRUTH, markersize=7, label="start", zorder=3.0)
    axes.plot(lon[-1], lat[-1], "s", color=TRUTH, markersize=7, label="end", zorder=3.0)
    frame_map(axes, _currents(axes, table, shrink), shrink)
    axes.set_aspect(1.0 / shrink)
    axes.ticklabel_format(useOffset=False)
    label(axes, "", "longitude, degrees east", "latitude, degrees north")
    legend(axes)
    return figure


def _joined(longitude: np.ndarray, latitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    known = np.isfinite(latitude).all(axis=1)
    return longitude[known].ravel(), latitude[known].ravel()


def _currents(axes: Axes, table: MissionTable, shrink: float) -> np.ndarray:
    """Draw the currents as arrows in their true direction, with a scale arrow.

    Returns
    -------
    (k, 2) array
        Longitudes and latitudes (degrees) of the fixes and of the arrows' ends, all of which the map must show.
    """
    fixes, (latitude, longitude), (north, east) = table.fixes, table.middle, table.current
    track = np.column_stack(_joined(fixes[1], fixes[0]))
    known = table.with_current & np.isfinite(latitude)
    if not known.any():
        return track
    speed = np.hypot(north[known], east[known])
    extent = max(float(np.hypot(*(np.ptp(track, axis=0) * [shrink, 1.0]))), MIN_EXTENT / DEGREE)
    degrees = _ARROW_LENGTH * extent / max(float(np.percentile(speed, 90.0)), 1e-3)
    along, up = degrees * east[known] / shrink, degrees * north[known]
    arrows = draw_arrows(axes, (longitude[known], latitude[known]), (along, up), width=0.004, name=table.adopted.label)
    shown = round_speed(float(np.median(speed)))
    scale_arrow(axes, arrows, degrees * shown / shrink, f"{shown:g} m/s")
    return np.concatenate([track, np.column_stack([longitude[known] + along, latitude[known] + up])])


def frame_map(axes: Axes, seen: np.ndarray, shrink: float) -> None:
    """Set limits around the points `seen`, with a margin and a fixed aspect ratio."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle, (width, height) = 0.5 * (low + high), (high - low) * [shrink, 1.0]
    height = _MARGIN_FACTOR * max(height, width / _ASPECT_RATIO, MIN_EXTENT / DEGREE)
    axes.set_xlim(middle[0] - 0.5 * _ASPECT_RATIO * height / shrink, middle[0] + 0.5 * _ASPECT_RATIO * height / shrink)
    axes.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)


def draw_arrows(axes: Axes, tails: Pair, lengths: Pair, *, width: float, name: str) -> Quiver:
    """Draw depth-averaged currents as arrows in their true direction.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Panel.
    tails, lengths : pair of (k,) arrays or floats
        Positions and components along x and y, in units of the axes.
    width : float
        Width of a shaft relative to the panel's.
    name : str
        Estimate of the current, for the legend.
    """
    arrows = axes.quiver(
        *tails, *lengths, color=FILTER, angles="xy", scale_units="xy", scale=1.0, width=width, zorder=4.0
    )
    arrows.set_label(f"depth-averaged current, {name}")
    return arrows


def scale_arrow(axes: Axes, arrows: Quiver, length: float, text: str) -> None:
    """Draw a labelled scale arrow at the lower right; its length is in units of the x axis."""
    axes.quiverkey(arrows, 0.86, 0.04, length, text, labelpos="N", fontproperties={"size": SMALL + 1})


def round_speed(speed: float) -> float:
    """Round a speed (m/s) to 1, 2 or 5 times a power of ten, for a scale arrow."""
    if speed <= 0.0:
        return 0.1
    power = 10.0 ** math.floor(math.log10(speed))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(digit * power - speed)) * power)


_TALL, _FLAT = (9.0, 9.0), (9.0, 4.6)
_OUTCOMES = {"done": (ESTIMATE, "o"), "failed": (FILTER, "X"), "pending": (SHADE, "s")}
"""Colour and mark of a profile's status."""


def profiles_figure(table: MissionTable) -> Figure:
    """Draw depth and outcome, the windows' convergence, and both components of the current of every profile."""
    figure, (depth, converged, north, east) = panels(4, 1, _TALL, "Profiles of the mission", share_x=True)
    _draw_depth(depth, table)
    converged.plot(table.number, 100.0 * table.converged, ".", color=ESTIMATE, markersize=6)
    converged.set_ylim(-4.0, 104.0)
    label(converged, "converged windows", y="%")
    for axes, along in ((north, "north"), (east, "east")):
        _draw_current(axes, table, along)
    _by_number(east)
    return figure


def timing_figure(table: MissionTable) -> Figure:
    """Draw the computing time of every profile, and the ratio of the dive's duration to it."""
    figure, (seconds, ratio) = panels(2, 1, _FLAT, "Computing time", share_x=True)
    seconds.plot(table.number, table.seconds, "o", color=ESTIMATE, markersize=4)
    seconds.set_ylim(bottom=0.0)
    label(seconds, "computing time of a profile", y="s")
    ratio.plot(table.number, table.duration / table.seconds, "o", color=ESTIMATE, markersize=4)
    ratio.set_ylim(bottom=0.0)
    label(ratio, "duration of the dive over its computing time", y="ratio")
    _by_number(ratio)
    return figure


def _by_number(axes: Axes) -> None:
    """Label the lower axis with integer profile numbers."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("profile number", fontsize=SMALL + 0.5)


def _draw_depth(axes: Axes, table: MissionTable) -> None:
    for status, (colour, mark) in _OUTCOMES.items():
        chosen = (table.status == status) & (np.isfinite(table.depth) | (status != "done"))
        depth = np.nan_to_num(table.depth[chosen])
        if chosen.any():
            axes.plot(table.number[chosen], depth, mark, color=colour, markersize=5, label=status, clip_on=False)
    deepest = np.nanmax(table.depth, initial=1.0)
    axes.set_ylim(1.08 * deepest, 0.0)
    label(axes, "maximum depth, by outcome; profiles without a depth are drawn at 0", y="m")
    legend(axes)


def _draw_current(axes: Axes, table: MissionTable, along: str) -> None:
    adopted, inverted = table.adopted, table.column(f"dac_{along}")
    value, deviation = getattr(adopted, along), getattr(adopted, f"{along}_std")
    axes.axhline(0.0, color="#888888", linewidth=0.5)
    axes.plot(
        table.number,
        table.column(f"dac_{along}_glide_angle"),
        "_",
        color=GLIDE_ANGLE,
        markersize=9,
        markeredgewidth=1.6,
        label="from the glide angle",
    )
    axes.plot(table.number, inverted, "_", color=ESTIMATE, markersize=9, markeredgewidth=1.6, label="from the adjoint")
    for chosen, colour, name in (
        (adopted.smoothed, SMOOTHER, "adopted: from the smoother, with 1 sigma"),
        (adopted.known & ~adopted.smoothed, ESTIMATE, "adopted: from the adjoint, with 1 sigma"),
    ):
        if chosen.any():
            axes.errorbar(
                table.number[chosen],
                value[chosen],
                yerr=deviation[chosen],
                fmt="o",
                color=colour,
                markersize=3.5,
                elinewidth=0.8,
                label=name,
            )
    label(axes, f"depth-averaged current to the {along}", y="m/s")
    legend(axes)
