"""Draw the README's picture of a real mission, ``docs/assets/mission.png``, from its archive, and write its caption.

Usage: ``python -m benchmarks.front_picture ARCHIVE``. The archive is that of the Slocum modena (Gulf of Mexico, July 2015,
days 17 to 29 of its mission), made with the hull calibrated on the days before the event::

    gliderhpc calibrate modena.nc --platform slocum --profiles 1:24 --out modena.yaml
    gliderhpc run-mission modena.nc --platform modena.yaml --store modena.zarr
    gliderhpc analyze modena.zarr drift
"""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.command_line import positional
from benchmarks.readme import README
from benchmarks.sections import with_section
from gliderhpc import open_mission
from gliderhpc.archive.current import AdoptedCurrent, adopted_current
from gliderhpc.findings.drawing import FILTER, MODEL, SHADE, SMOOTHER, label, legend, new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "assets" / "mission.png"

SECTION = "mission"

SIGMAS = 2.0
"""Standard deviations shown as ellipses and bars."""

_PIXELS_AN_INCH = 110
_ARROW = 0.16
"""Length of the strongest current's arrow, in parts of the map's diagonal."""

Array = NDArray[np.float64]


def front_picture(archive: xr.DataTree) -> Figure:
    """Draw track and currents, currents over time, and the drag's course with its changes.

    Parameters
    ----------
    archive : xarray.DataTree
        An archive with the study ``drift``.
    """
    table = archive.to_dataset().load()
    drift = archive["drift"].to_dataset().load()
    current = adopted_current(table)
    days = table["elapsed_days"].to_numpy()
    figure = new_figure((9.2, 4.6), _PIXELS_AN_INCH)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
    panels = [figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])]
    for axes in panels:
        style_axes(axes)
    _draw_map(panels[0], table, current)
    _draw_currents(panels[1], days, current)
    _draw_drag(panels[2], days, drift)
    panels[2].sharex(panels[1])
    return figure


def _draw_map(axes: Axes, table: xr.Dataset, current: AdoptedCurrent) -> None:
    """Draw track, currents as arrows, and their ellipses around the arrows' heads, in kilometres."""
    from matplotlib.patches import Ellipse

    latitude, longitude = (
        table[[f"entry_{name}", f"exit_{name}"]].to_array().mean("variable").to_numpy()
        for name in ("latitude", "longitude")
    )
    known = np.isfinite(latitude) & current.known
    shrink = math.cos(math.radians(float(np.nanmean(latitude))))
    east, north = 111.195 * shrink * (longitude - longitude[known][0]), 111.195 * (latitude - latitude[known][0])
    axes.plot(east[known], north[known], ".-", color="#888888", linewidth=0.8, markersize=3, label="dives")
    extent = math.hypot(float(np.ptp(east[known])), float(np.ptp(north[known])))
    scale = _ARROW * extent / float(np.hypot(current.north[known], current.east[known]).max())
    for i in np.flatnonzero(known):
        place = (east[i] + scale * current.east[i], north[i] + scale * current.north[i])
        width, height, angle = _ellipse(current, int(i))
        axes.add_patch(Ellipse(place, scale * width, scale * height, angle=angle, facecolor=FILTER, alpha=0.22))
    axes.quiver(
        east[known], north[known], scale * current.east[known], scale * current.north[known], color=FILTER, angles="xy",
        scale_units="xy", scale=1.0, width=0.005, label="depth-averaged current",
    )  # fmt: skip
    corner = axes.get_xlim()[0], axes.get_ylim()[0] - 0.08 * extent
    axes.quiver(*corner, 0.2 * scale, 0.0, color="black", angles="xy", scale_units="xy", scale=1.0, width=0.005)
    axes.text(corner[0] + 0.22 * scale, corner[1], "0.2 m/s", fontsize=7, va="center")
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, "(a) dives and currents, 2-sigma ellipses", "km to the east", "km to the north")
    legend(axes)


def _ellipse(current: AdoptedCurrent, i: int) -> tuple[float, float, float]:
    """Axes (m/s, full length) and angle (degrees from east towards north) of a current's ellipse."""
    north, east, between = current.north_std[i] ** 2, current.east_std[i] ** 2, current.covariance[i]
    values, vectors = np.linalg.eigh(np.array([[east, between], [between, north]]))
    width, height = 2.0 * SIGMAS * np.sqrt(np.maximum(values[::-1], 0.0))
    return float(width), float(height), float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))


def _draw_currents(axes: Axes, days: Array, current: AdoptedCurrent) -> None:
    rows = (("north", MODEL, current.north, current.north_std), ("east", FILTER, current.east, current.east_std))
    for name, colour, value, deviation in rows:
        axes.errorbar(
            days, value, yerr=SIGMAS * deviation, fmt=".-", color=colour, linewidth=0.8, markersize=4, elinewidth=0.6,
            label=name,
        )  # fmt: skip
    axes.axhline(0.0, color="#888888", linewidth=0.6)
    label(axes, "(b) depth-averaged current, 2 sigma", "", "m/s")
    legend(axes)


def _draw_drag(axes: Axes, days: Array, drift: xr.Dataset) -> None:
    """Draw the change of the drag coefficient that each dive and climb shows, and shade the changes that were found."""
    for phase, colour, mark in (("dive", MODEL, "o"), ("climb", SMOOTHER, "^")):
        axes.plot(
            days,
            drift[f"K_D0_{phase}_smoothed"].to_numpy(),
            mark,
            color=colour,
            markersize=3,
            linestyle="none",
            label=phase,
        )
    half = 0.5 * float(np.nanmedian(np.diff(days)))
    names = set()
    for first, last, kind in zip(*(drift[n].to_numpy() for n in ("first_day", "last_day", "change_kind")), strict=True):
        if np.isfinite(first):
            name = None if kind in names else f"{kind} found"
            axes.axvspan(first - half, last + half, facecolor=SHADE, alpha=0.3, linewidth=0.0, label=name)
            names.add(kind)
    label(axes, "(c) drag: change of K_D0", "days", "kg/m")
    legend(axes)


def caption(archive: xr.DataTree) -> str:
    """Describe the picture, with the change that the study found."""
    table, drift = archive.to_dataset().load(), archive["drift"].to_dataset().load()
    current = adopted_current(table)
    speed = np.hypot(current.north, current.east)[current.known]
    deviation = np.concatenate([current.north_std[current.known], current.east_std[current.known]])
    first, last = float(drift["first_day"][0]), float(drift["last_day"][0])
    drag = archive.attrs["platform"]["viscous"]["K_D0"]
    largest = max(abs(float(drift[f"K_D0_change_{phase}_adjoint"][0])) for phase in ("dive", "climb"))
    text = (
        f"{float(table['elapsed_days'].max()):.0f} days of a Slocum glider in the Gulf of Mexico, July 2015, from attitude, "
        f"depth, ballast and GPS fixes alone. (a), (b): depth-averaged currents of {current.known.sum()} dives, "
        f"{speed.min():.2f} to {speed.max():.2f} m/s, with a median standard deviation of {np.median(deviation):.3f} m/s. "
        f"(c): change of the drag coefficient. From day {first:.1f} to day {last:.1f} something slowed the glider; the `drift` "
        f"study detected this {drift['change_kind'].item(0)} automatically: on {drift['change_phases'].item(0)}s the drag rose by "
        f"up to {largest / drag:.0%}. The records do not show the cause."
    )
    return textwrap.fill(text, 120, break_on_hyphens=False)


def main(archive: Path) -> None:
    """Draw the picture of an archive and write its caption into the README."""
    with open_mission(archive) as opened:
        front_picture(opened).savefig(PICTURE)
        text = caption(opened)
    README.write_text(with_section(README.read_text("utf-8"), SECTION, text), "utf-8")


if __name__ == "__main__":
    main(positional(__doc__, archive={"type": Path}).archive)
