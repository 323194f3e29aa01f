"""Map of depth-averaged currents: an arrow for each dive with its error ellipse, and the track under water."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gliderhpc.archive.current import adopted_current
from gliderhpc.errors import InputError
from gliderhpc.findings.drawing import SHADE, SMALL, footnote, label, new_figure, style_axes
from gliderhpc.observations.regions import wrapped_longitude
from gliderhpc.report.maps import CIRCLE, covariance_factors, dive_midpoints
from gliderhpc.wording import counted

Array = NDArray[np.float64]

SIZE = (7.6, 6.4)
DPI = 110
ARROW_SHARE = 0.28
"""Length of the fastest current's arrow, relative to the longer side of the region with the dives."""

_COLOURS = "viridis"


_ROUND = (1.0, 2.0, 5.0)
_MARGIN = 0.06
_NOTE = (
    "Arrows: depth-averaged current, drawn from the midpoint between a dive's fixes, coloured by time. Ellipses: one "
    "standard deviation, centred on the tip. Grey: estimated track under water; dots: fixes."
)


def currents_map(table: xr.Dataset) -> Figure:
    """Draw the currents of a table of profiles, returned by `gliderhpc.currents` or read from an archive's root."""
    current = adopted_current(table)
    if "entry_latitude" not in table or not current.known.any():
        raise InputError(
            "currents: no profile has a current; pass the dataset returned by currents, run_mission or open_mission"
        )
    rows = table.isel(profile=np.flatnonzero(current.known))
    north, east = current.north[current.known], current.east[current.known]
    places = _middles(rows)
    narrowing = float(np.cos(np.radians(places[:, 1].mean())))
    scale = _degrees_per_speed(places, narrowing, float(np.hypot(north, east).max()))
    figure = new_figure(SIZE, DPI)
    axes = figure.subplots()
    style_axes(axes)
    stretch = scale / np.array([narrowing, 1.0])
    tips = places + np.column_stack([east, north]) * stretch
    factors = covariance_factors(current.north_std, current.east_std, current.covariance)[current.known]
    outlines = tips[:, None, :] + np.einsum("nij,jk->nki", factors, CIRCLE) * stretch
    _draw_tracks(axes, table, float(places[0, 0]))
    _draw_arrows(axes, places, tips, outlines, rows["start_time"].values)
    _set_limits(axes, np.concatenate([places, tips, *outlines]), narrowing)
    _draw_key(axes, float(np.hypot(north, east).max()), stretch)
    label(axes, _title(table, rows.sizes["profile"]), "longitude (degree east)", "latitude (degree north)")
    footnote(figure, _NOTE)
    return figure


def _middles(rows: xr.Dataset) -> Array:
    """Return longitude and latitude ``(n, 2)`` midway between the fixes of each dive, the longitudes near the first."""
    places = dive_midpoints(rows)[:, ::-1]
    places[:, 0] = wrapped_longitude(places[:, 0], float(places[0, 0]))
    return places


def _degrees_per_speed(places: Array, narrowing: float, fastest: float) -> float:
    """Return the length of the arrow of a current of 1 m/s, in degrees of latitude."""
    width, height = np.ptp(places, axis=0) * [narrowing, 1.0]
    return float(ARROW_SHARE * max(width, height, 0.01) / max(fastest, 1e-3))


def _draw_tracks(axes: Axes, table: xr.Dataset, centre: float) -> None:
    """Draw tracks and fixes; those on both sides of the date line are next to each other, near a central longitude."""
    if {"latitude", "longitude", "profile_number"} <= set(table.variables):
        number = table["profile_number"].values
        points = np.column_stack([wrapped_longitude(table["longitude"].values, centre), table["latitude"].values])
        known = np.isfinite(points).all(axis=1)
        tracks = [points[known & (number == dive)] for dive in np.unique(number)]
        axes.add_collection(LineCollection(tracks, colors=SHADE, linewidths=0.8, zorder=1))
    for end in ("entry", "exit"):
        longitude = wrapped_longitude(table[f"{end}_longitude"].values, centre)
        axes.plot(longitude, table[f"{end}_latitude"], ".", color=SHADE, markersize=4.0, zorder=1)


def _draw_arrows(axes: Axes, places: Array, tips: Array, outlines: Array, start: NDArray[Any]) -> None:
    days = np.asarray(date2num(start))  # type: ignore[no-untyped-call]
    shared: dict[str, Any] = {"cmap": _COLOURS, "clim": (days.min(), max(days.max(), days.min() + 1e-3))}
    ellipses = PolyCollection(list(outlines), array=days, alpha=0.25, edgecolors="none", zorder=2, **shared)
    rims = PolyCollection(list(outlines), facecolors="none", edgecolors=SHADE, linewidths=0.5, zorder=3)
    axes.add_collection(ellipses)
    axes.add_collection(rims)
    length = tips - places
    arrows = axes.quiver(
        *places.T, *length.T, days, angles="xy", scale_units="xy", scale=1.0, width=0.0045, zorder=4, **shared
    )
    bar = axes.figure.colorbar(arrows, ax=axes, shrink=0.7, pad=0.02)
    locator = AutoDateLocator(minticks=3, maxticks=7)  # type: ignore[no-untyped-call]
    bar.ax.yaxis.set_major_locator(locator)
    bar.ax.yaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    bar.ax.tick_params(labelsize=SMALL)
    bar.ax.yaxis.get_offset_text().set_fontsize(SMALL)


def _set_limits(axes: Axes, points: Array, narrowing: float) -> None:
    """Set limits that include every arrow and ellipse, and an undistorted aspect ratio."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = _MARGIN * (high - low).max()
    axes.set_xlim(low[0] - room / narrowing, high[0] + room / narrowing)
    # Room for the key below.
    axes.set_ylim(low[1] - 2.0 * room, high[1] + room)
    axes.set_aspect(1.0 / narrowing, adjustable="box")
    axes.ticklabel_format(useOffset=False)


def _draw_key(axes: Axes, fastest: float, stretch: Array) -> None:
    """Draw a scale arrow of a round speed at the lower left."""
    power = 10.0 ** np.floor(np.log10(max(fastest, 1e-3)))
    speed = max(step * power for step in _ROUND if step * power <= max(fastest, 1e-3))
    left, bottom = axes.transData.inverted().transform(axes.transAxes.transform((0.04, 0.05)))
    axes.quiver(
        [left], [bottom], [speed * stretch[0]], [0.0], angles="xy", scale_units="xy", scale=1.0, width=0.0045, zorder=5
    )
    axes.annotate(f"{speed:g} m/s", (left, bottom), xytext=(0.0, 4.0), textcoords="offset points", fontsize=SMALL)


def _title(table: xr.Dataset, count: int) -> str:
    name = str(table.attrs.get("mission") or "").strip()
    dives = counted(count, "dive")
    return f"{name}: currents of {dives}" if name else f"Currents of {dives}"
