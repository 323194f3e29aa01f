"""Figure 8: the currents of some profiles as points in the plane, the glider's with its 1- and 2-sigma ellipses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gliderhpc.findings.drawing import FILTER, MODEL, SHADE, SMALL, SMOOTHER, TRUTH, label, legend, panels
from gliderhpc.studies.library.ellipses import Current
from gliderhpc.studies.reanalysis.compared import Compared

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MARKERS = (
    ("*", FILTER, 9.0),
    ("D", SMOOTHER, 5.0),
    ("P", "#CC79A7", 6.0),
    ("X", "#E69F00", 6.0),
    ("v", "#56B4E9", 6.0),
)
"""Shape, colour and size of the models' points, in the order in which the models are given."""

_ROOM = 0.15
_SIDE, _HEAD = 3.2, 0.4


def figure_8(compared: Compared, places: list[int], mission: str) -> Figure:
    """Draw the profiles at some places, a panel each."""
    across = min(3, len(places))
    down = -(-len(places) // across)
    size = (_SIDE * max(across, 2), _SIDE * down + _HEAD)
    figure, axes = panels(down, across, size, f"Depth-averaged currents and ocean models: {mission}")
    for index, (panel, place) in enumerate(zip(axes, places, strict=False)):
        _draw(panel, compared, place)
        if index == 0:
            legend(panel)
    for unused in axes[len(places) :]:
        unused.set_axis_off()
    return figure


def ellipse_axes(covariance: Array) -> tuple[float, float, float]:
    """Semi-axes of the 1-sigma ellipse of a covariance ``(2, 2)`` of north and east, and where the longer one points.

    Returns
    -------
    longer, shorter : float
        In the unit whose square the covariance has.
    angle : float
        Of the longer one, degree anticlockwise from east, as figures with east to the right count it.
    """
    variances, vectors = np.linalg.eigh(covariance)
    shorter, longer = np.sqrt(np.maximum(variances, 0.0))
    north, east = vectors[:, 1]
    return float(longer), float(shorter), float(np.degrees(np.arctan2(north, east)))


def _draw(axes: Axes, compared: Compared, place: int) -> None:
    current = compared.currents[place]
    _draw_ellipses(axes, current)
    points = [("glide angle", compared.glide_angle[place], ("^", MODEL, 6.0))]
    points += [
        (name, compared.models[place, index], MARKERS[index % len(MARKERS)])
        for index, name in enumerate(compared.names)
    ]
    for name, (north, east), (marker, colour, size) in [
        (compared.estimate, current.velocity, ("s", TRUTH, 5.0)), *points
    ]:  # fmt: skip
        if np.isfinite(north + east):
            axes.plot(east, north, marker, color=colour, markersize=size, linestyle="none", label=name)
    axes.axhline(0.0, color=SHADE, linewidth=0.5)
    axes.axvline(0.0, color=SHADE, linewidth=0.5)
    _frame(axes, current, np.array([velocity for _, velocity, _ in points]))
    distances = zip(compared.names, compared.distance[place], strict=True)
    said = ", ".join(f"{name} {value:.1f}σ" for name, value in distances if np.isfinite(value))
    axes.text(0.02, 0.02, said, transform=axes.transAxes, fontsize=SMALL, parse_math=False)
    label(
        axes, f"profile {compared.numbers[place]}, day {compared.days[place]:.0f}", "east (m/s)", "north (m/s)"
    )  # fmt: skip


def _draw_ellipses(axes: Axes, current: Current) -> None:
    from matplotlib.patches import Ellipse

    north, east = current.velocity
    if not np.isfinite(current.covariance).all():
        return
    longer, shorter, angle = ellipse_axes(current.covariance)
    for sigmas, style in ((1.0, "-"), (2.0, "--")):
        axes.add_patch(
            Ellipse(
                (east, north), 2.0 * sigmas * longer, 2.0 * sigmas * shorter, angle=angle, fill=False, color=TRUTH,
                linewidth=0.8, linestyle=style, label=f"{sigmas:.0f}σ",
            )
        )  # fmt: skip


def _frame(axes: Axes, current: Current, points: Array) -> None:
    """Square limits around every point, the 2-sigma ellipse and the origin."""
    reach = 2.0 * np.sqrt(np.nan_to_num(np.diag(current.covariance)))
    corners = np.concatenate([points, [[0.0, 0.0]], [current.velocity - reach, current.velocity + reach]])
    low, high = np.nanmin(corners, axis=0), np.nanmax(corners, axis=0)
    half = (0.5 + _ROOM) * max(float((high - low).max()), 1e-3)
    north, east = 0.5 * (low + high)
    axes.set_xlim(east - half, east + half)
    axes.set_ylim(north - half, north + half)
    axes.set_aspect("equal")
