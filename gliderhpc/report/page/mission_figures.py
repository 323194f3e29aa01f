"""Figures of the mission: map, profiles by number, and computing time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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
from gliderhpc.report.maps import draw_arrows, frame_map, map_extent, round_speed, scale_arrow
from gliderhpc.report.page.mission_table import MissionTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


_SIZE = (8.0, 6.4)
_ARROW_LENGTH = 0.12
"""Length of the arrow of the 90th percentile of the currents, relative to the map's diagonal."""


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
    extent = map_extent(track, shrink)
    degrees = _ARROW_LENGTH * extent / max(float(np.percentile(speed, 90.0)), 1e-3)
    along, up = degrees * east[known] / shrink, degrees * north[known]
    arrows = draw_arrows(axes, (longitude[known], latitude[known]), (along, up), width=0.004, name=table.adopted.label)
    shown = round_speed(float(np.median(speed)))
    scale_arrow(axes, arrows, degrees * shown / shrink, f"{shown:g} m/s")
    return np.concatenate([track, np.column_stack([longitude[known] + along, latitude[known] + up])])


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
