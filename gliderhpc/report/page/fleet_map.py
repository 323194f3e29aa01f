"""Map of a fleet: all tracks, and the last current of each glider with its error ellipse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gliderhpc.distributions import chi_square_quantile
from gliderhpc.findings.drawing import (
    FILTER,
    GLIDE_ANGLE,
    MEASURED,
    MODEL,
    SMALL,
    SMOOTHER,
    TRUTH,
    footnote,
    label,
    new_figure,
    style_axes,
)
from gliderhpc.report.maps import CIRCLE, covariance_factors, frame_map, map_extent, round_speed
from gliderhpc.surfacing.next_surfacing import PROBABILITY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_SIZE = (7.0, 6.0)
_LEGEND_ROW = 0.18
"""Height of a row of the legend, inches."""

_COLOURS = (MODEL, FILTER, SMOOTHER, GLIDE_ANGLE, MEASURED, "#56B4E9", TRUTH)
"""Okabe and Ito's palette, repeated for more gliders, which their numbers then distinguish."""

_ARROW_LENGTH = 0.2
"""Length of the fastest current's arrow, relative to the map's diagonal."""

_NAME_LENGTH = 40
_NOTE = (
    "Lines: dives from fix to fix. Arrows: the last known depth-averaged current of each glider, drawn from the "
    f"midpoint between the dive's fixes. Ellipses: {PROBABILITY:.0%} probability, centred on the tip."
)


@dataclass(frozen=True, eq=False)
class FleetTrack:
    """Track of one mission and its last known current.

    Attributes
    ----------
    number, name : int, str
        Number on the map, and name in the legend.
    fixes : (n, 2) array
        Longitude and latitude of all fixes in order, degrees; missing ones are omitted.
    position : (2,) array
        Longitude and latitude of the current, degrees; NaN without a current.
    current : (2,) array
        East and north component of the current, m/s; NaN without a current.
    deviations : (3,) array
        Standard deviations of north and east (m/s), and their covariance (m2/s2).
    """

    number: int
    name: str
    fixes: Array
    position: Array
    current: Array
    deviations: Array

    @property
    def has_current(self) -> bool:
        """Return whether an arrow can be drawn."""
        return bool(np.isfinite(self.position).all() and np.isfinite(self.current).all())

    def shifted(self, longitude: float) -> tuple[Array, Array]:
        """Return fixes and place, shifted by full turns near a longitude, to avoid a split at the date line."""
        shift = np.array([360.0 * round((longitude - self.fixes[:, 0].mean()) / 360.0), 0.0])
        return self.fixes + shift, self.position + shift


def fleet_map(tracks: Sequence[FleetTrack]) -> Figure | None:
    """Draw the tracks of a fleet and their last currents; return None if no mission has a fix."""
    shown = [track for track in tracks if len(track.fixes)]
    if not shown:
        return None
    reference = float(shown[0].fixes[:, 0].mean())
    placed = [track.shifted(reference) for track in shown]
    every = np.concatenate([fixes for fixes, _ in placed])
    shrink = math.cos(math.radians(0.5 * float(every[:, 1].min() + every[:, 1].max())))
    width, height = _SIZE
    figure = new_figure((width, height + _LEGEND_ROW * max(0, len(shown) // 2 - 2)))
    axes = figure.subplots()
    style_axes(axes)
    for track, (fixes, _) in zip(shown, placed, strict=True):
        _draw_track(axes, track, fixes)
    tips = _draw_currents(axes, shown, placed, every, shrink)
    frame_map(axes, np.concatenate([every, *tips]), shrink)
    axes.set_aspect(1.0 / shrink)
    axes.ticklabel_format(useOffset=False)
    label(axes, "Tracks and last currents", "longitude, degrees east", "latitude, degrees north")
    _draw_legend(figure, axes)
    footnote(figure, _NOTE)
    return figure


def _colour(track: FleetTrack) -> str:
    return _COLOURS[(track.number - 1) % len(_COLOURS)]


def _draw_track(axes: Axes, track: FleetTrack, fixes: Array) -> None:
    printable = "".join(letter if letter.isprintable() else " " for letter in track.name)
    name = printable if len(printable) <= _NAME_LENGTH else f"{printable[: _NAME_LENGTH - 4]} ..."
    axes.plot(
        *fixes.T, ".-", color=_colour(track), linewidth=1.4, markersize=4.0, zorder=2.0, label=f"{track.number}  {name}"
    )
    axes.annotate(
        str(track.number),
        tuple(fixes[-1]),
        xytext=(4.0, 4.0),
        textcoords="offset points",
        fontsize=SMALL + 2,
        fontweight="bold",
        color=_colour(track),
        zorder=6.0,
    )


def _draw_currents(
    axes: Axes, tracks: Sequence[FleetTrack], placed: Sequence[tuple[Array, Array]], every: Array, shrink: float
) -> list[Array]:
    """Draw arrows in their true direction with their ellipses, and return the outlines that the map must include."""
    known = [(track, position) for track, (_, position) in zip(tracks, placed, strict=True) if track.has_current]
    if not known:
        return []
    extent = map_extent(every, shrink)
    fastest = max(float(np.hypot(*track.current)) for track, _ in known)
    degrees = _ARROW_LENGTH * extent / max(fastest, 1e-3)
    stretch = degrees * np.array([1.0 / shrink, 1.0])
    outlines = []
    for track, position in known:
        outline = position + (track.current + _ellipse(track)) * stretch
        axes.fill(*outline.T, facecolor=_colour(track), alpha=0.25, edgecolor="none", zorder=3.0)
        outlines.append(outline)
    places, lengths = (
        np.array(pairs) for pairs in ([position for _, position in known], [t.current * stretch for t, _ in known])
    )
    arrows = axes.quiver(
        *places.T,
        *lengths.T,
        color=[_colour(track) for track, _ in known],
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.006,
        zorder=4.0,
    )
    shown = round_speed(0.7 * fastest)
    # The key is above the panel, where it covers no track.
    axes.quiverkey(
        arrows,
        0.76,
        1.03,
        shown * stretch[0],
        f"{shown:g} m/s",
        labelpos="W",
        color=TRUTH,
        fontproperties={"size": SMALL + 1},
    )
    return outlines


def _ellipse(track: FleetTrack) -> Array:
    """Return the outline (61, 2) of the current's error about zero, m/s."""
    factor = covariance_factors(*(np.atleast_1d(value) for value in track.deviations))[0]
    return np.asarray(math.sqrt(chi_square_quantile(PROBABILITY, 2)) * (factor @ CIRCLE).T)


def _draw_legend(figure: Figure, axes: Axes) -> None:
    legend = figure.legend(
        *axes.get_legend_handles_labels(), loc="outside upper left", ncols=2, fontsize=SMALL + 1, frameon=False
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
