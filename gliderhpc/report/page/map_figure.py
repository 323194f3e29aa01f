"""The mission on a map without tiles: dives between their fixes, and the current of each."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gliderhpc.analysis.drawing import FILTER, MODEL, SMALL, TRUTH, label, legend, panels
from gliderhpc.report.page.mission_table import MissionTable

_SIZE = (8.0, 6.4)
_LONGEST_ARROW = 0.12
"""Of the map's diagonal: how long the 90th percentile of the currents is drawn."""

_DEGREE = 111_195.0
"""Length of a degree of latitude, m."""

_SMALLEST = 2000.0
"""A map is not narrower, m."""


def map_figure(table: MissionTable) -> Figure | None:
    """Draw the dives and their currents, latitude and longitude to one scale; None without any fix."""
    latitude, longitude = table.fixes
    if not np.isfinite(latitude).all(axis=1).any():
        return None
    figure, (axes,) = panels(1, 1, _SIZE, f"Track and depth-averaged currents: {_mission(table)}")
    shrink = math.cos(math.radians(float(np.nanmean(latitude))))
    axes.plot(*_joined(longitude, latitude), color="#888888", linewidth=0.6, zorder=1.0)
    for index, (lon, lat) in enumerate(zip(longitude, latitude, strict=True)):
        axes.plot(
            lon, lat, color=MODEL, linewidth=2.2, zorder=2.0, label="dive, from fix to fix" if not index else None
        )
    _ends(axes, longitude, latitude)
    _frame(axes, longitude, latitude, shrink)
    _currents(axes, table, shrink)
    axes.set_aspect(1.0 / shrink, adjustable="datalim")
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


def _frame(axes: Axes, longitude: np.ndarray, latitude: np.ndarray, shrink: float) -> None:
    """Leave room for arrows around the track."""
    lon, lat = _joined(longitude, latitude)
    width, height = np.ptp(lon) * shrink, np.ptp(lat)
    room = 0.15 * max(width, height, _SMALLEST / _DEGREE)
    least = 0.5 * _SMALLEST / _DEGREE
    axes.set_xlim(lon.min() - (room + least) / shrink, lon.max() + (room + least) / shrink)
    axes.set_ylim(lat.min() - room - least, lat.max() + room + least)


def _currents(axes: Axes, table: MissionTable, shrink: float) -> None:
    """Draw the currents as arrows in their true direction on the map, and one for the scale."""
    (latitude, longitude), (north, east) = table.middle, table.current
    known = table.with_current & np.isfinite(latitude)
    if not known.any():
        return
    speed = np.hypot(north[known], east[known])
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    diagonal = math.hypot((right - left) * shrink, high - low)
    degrees = _LONGEST_ARROW * diagonal / max(float(np.percentile(speed, 90.0)), 1e-3)
    arrows = axes.quiver(
        longitude[known], latitude[known], degrees * east[known] / shrink, degrees * north[known], color=FILTER,
        angles="xy", scale_units="xy", scale=1.0, width=0.004, zorder=4.0,
    )  # fmt: skip
    arrows.set_label("depth-averaged current")
    shown = round_speed(float(np.median(speed)))
    axes.quiverkey(
        arrows, 0.86, 0.04, degrees * shown / shrink, f"{shown:g} m/s", labelpos="N", fontproperties={"size": SMALL + 1},
    )  # fmt: skip


def round_speed(speed: float) -> float:
    """The speed's nearest 1, 2 or 5 times a power of ten, for a scale arrow (m/s)."""
    if speed <= 0.0:
        return 0.1
    power = 10.0 ** math.floor(math.log10(speed))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(digit * power - speed)) * power)
