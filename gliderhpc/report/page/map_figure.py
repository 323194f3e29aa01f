"""The mission on a map without tiles: dives between their fixes, and the current of each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import FILTER, MODEL, SMALL, TRUTH, label, legend, panels
from gliderhpc.report.page.mission_table import MissionTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

_SIZE = (8.0, 6.4)
_LONGEST_ARROW = 0.12
"""Of the map's diagonal: how long the 90th percentile of the currents is drawn."""

_DEGREE = 111_195.0
"""Length of a degree of latitude, m."""

_SMALLEST = 2000.0
"""A map is not narrower, m."""

_SHAPE, _ROOM = 1.3, 1.12
"""Of the map: width over height, and how much larger it is than what is on it."""


def map_figure(table: MissionTable) -> Figure | None:
    """Draw the dives and their currents, latitude and longitude to one scale; None without any fix."""
    latitude, longitude = table.fixes
    if not np.isfinite(latitude).all(axis=1).any():
        return None
    figure, (axes,) = panels(1, 1, _SIZE, f"Track and depth-averaged currents: {_mission(table)}")
    shrink = math.cos(math.radians(float(np.nanmean(latitude))))
    axes.plot(*_joined(longitude, latitude), color="#888888", linewidth=0.6, zorder=1.0)
    dives = axes.plot(longitude.T, latitude.T, ".-", color=MODEL, linewidth=2.2, markersize=5, zorder=2.0)
    dives[0].set_label("dive, from fix to fix")
    _ends(axes, longitude, latitude)
    _frame(axes, _currents(axes, table, shrink), shrink)
    axes.set_aspect(1.0 / shrink)
    axes.ticklabel_format(useOffset=False)
    label(axes, "", "longitude, degrees east", "latitude, degrees north")
    legend(axes)
    return figure


def _mission(table: MissionTable) -> str:
    return str(table.dataset.attrs.get("mission") or "mission")


def _joined(longitude: np.ndarray, latitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    known = np.isfinite(latitude).all(axis=1)
    return longitude[known].ravel(), latitude[known].ravel()


def _ends(axes: Axes, longitude: np.ndarray, latitude: np.ndarray) -> None:
    lon, lat = _joined(longitude, latitude)
    axes.plot(lon[0], lat[0], "o", color=TRUTH, markersize=7, label="start", zorder=3.0)
    axes.plot(lon[-1], lat[-1], "s", color=TRUTH, markersize=7, label="end", zorder=3.0)


def _currents(axes: Axes, table: MissionTable, shrink: float) -> np.ndarray:
    """Draw the currents as arrows in their true direction, and one for the scale; return all that must be in sight.

    Longitudes and latitudes ``(k, 2)`` of the fixes and of the arrows' ends.
    """
    fixes, (latitude, longitude), (north, east) = table.fixes, table.middle, table.current
    track = np.column_stack(_joined(fixes[1], fixes[0]))
    known = table.with_current & np.isfinite(latitude)
    if not known.any():
        return track
    speed = np.hypot(north[known], east[known])
    extent = max(float(np.hypot(*(np.ptp(track, axis=0) * [shrink, 1.0]))), _SMALLEST / _DEGREE)
    degrees = _LONGEST_ARROW * extent / max(float(np.percentile(speed, 90.0)), 1e-3)
    along, up = degrees * east[known] / shrink, degrees * north[known]
    arrows = axes.quiver(
        longitude[known], latitude[known], along, up, color=FILTER, angles="xy", scale_units="xy", scale=1.0,
        width=0.004, zorder=4.0,
    )  # fmt: skip
    arrows.set_label(f"depth-averaged current, {table.taken.label}")
    shown = round_speed(float(np.median(speed)))
    scale_arrow(axes, arrows, degrees * shown / shrink, f"{shown:g} m/s")
    return np.concatenate([track, np.column_stack([longitude[known] + along, latitude[known] + up])])


def _frame(axes: Axes, seen: np.ndarray, shrink: float) -> None:
    """Show everything with some room around it, in a frame of the usual shape."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle, (width, height) = 0.5 * (low + high), (high - low) * [shrink, 1.0]
    height = _ROOM * max(height, width / _SHAPE, _SMALLEST / _DEGREE)
    axes.set_xlim(middle[0] - 0.5 * _SHAPE * height / shrink, middle[0] + 0.5 * _SHAPE * height / shrink)
    axes.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)


def scale_arrow(axes: Axes, arrows: Quiver, length: float, text: str) -> None:
    """Draw an arrow of a length (of the axis along x) at the lower right, with what it stands for."""
    axes.quiverkey(arrows, 0.86, 0.04, length, text, labelpos="N", fontproperties={"size": SMALL + 1})


def round_speed(speed: float) -> float:
    """The speed's nearest 1, 2 or 5 times a power of ten, for a scale arrow (m/s)."""
    if speed <= 0.0:
        return 0.1
    power = 10.0 ** math.floor(math.log10(speed))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(digit * power - speed)) * power)
