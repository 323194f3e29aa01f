"""Figure 9 of the paper: the six disturbances over the mission, dive and climb apart, by both primary estimates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from gliderhpc.archive.profile import ADJOINT, SMOOTHED
from gliderhpc.findings.drawing import FILTER, LANDSCAPE, MODEL, SHADE, footnote, label, legend, panels
from gliderhpc.studies.drift.change_points import Change
from gliderhpc.studies.drift.change_text import shaded
from gliderhpc.studies.drift.drag import DragDrift
from gliderhpc.studies.drift.medians import DRAG, PHASES, PRIOR, UNITS, column
from gliderhpc.studies.drift.series import LATERAL, LONGITUDINAL, EstimateTrends, days_of, values_of
from gliderhpc.studies.drift.trends import SeriesTrend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"dive": MODEL, "climb": FILTER}
_MARKS = {PRIOR: "+", ADJOINT: "o", SMOOTHED: "^"}

_NOTE = (
    "Medians over the steady glide of each profile: circles by the adjoint, triangles by the smoother. Lines are "
    "Theil-Sen slopes: solid where the robust verdict is a drift (Mann-Kendall by the moving-block bootstrap, Holm's "
    "correction, interval of the slope without zero), dotted where only the paper's plain test and interval say so, "
    "dashed where neither does. Bars: two standard deviations in epochs. Axial and heave force are weakly observed, "
    "their levels rest on the prior and on the hull's coefficients."
)


def figure_9(
    title: str, table: pd.DataFrame, found: Sequence[EstimateTrends], changes: Sequence[Change] = ()
) -> Figure:
    """Draw the longitudinal plane above, the lateral one below.

    Parameters
    ----------
    title : str
        Of the mission.
    table : pandas.DataFrame
        A row a profile.
    found : sequence of EstimateTrends
        The estimates to draw.
    changes : sequence of Change
        To shade.
    """
    figure, axes = panels(2, 3, LANDSCAPE, f"Drift of the disturbances: {title}")
    for letter, channel, one in zip("abcdef", (*LONGITUDINAL, *LATERAL), axes, strict=True):
        label(one, f"({letter}) {channel}", "days", UNITS[channel])
        for own in found:
            for phase in PHASES:
                name, trend = column(channel, phase, own.estimate), own.trends[channel, phase]
                _draw(one, table, name, trend, phase, own.estimate)
        _shade(one, table, changes)
    legend(axes[0])
    footnote(figure, _NOTE)
    return figure


def drag_figure(title: str, table: pd.DataFrame, drags: Sequence[DragDrift], changes: Sequence[Change] = ()) -> Figure:
    """Draw the change of K_D0 that the disturbances are equivalent to, a panel an estimate, changes shaded."""
    figure, axes = panels(1, len(drags), (11.0, 4.6), f"Drag that the drift is equivalent to: {title}")
    for one, drag in zip(axes, drags, strict=True):
        label(one, f"{drag.estimate} estimate", "days", "change of K_D0 (kg/m)")
        for phase in PHASES:
            _draw(one, table, column(DRAG, phase, drag.estimate), drag.phases[phase], phase, drag.estimate)
        _shade(one, table, changes)
        legend(one)
    footnote(
        figure,
        "Solid: the robust test, each series by itself, and the slope's interval say drift; dotted: the plain test; "
        "dashed: neither. A change of weight in water, or of the pitch sensor's offset, moves dive and climb apart; "
        "drag moves both alike. Shaded: steps, ramps and episodes; trends of the drag are those outside the episodes. "
        "Small points: profiles outside the epochs.",
    )
    return figure


def _shade(axes: Axes, table: pd.DataFrame, changes: Sequence[Change]) -> None:
    days = days_of(table)
    half = 0.5 * float(np.median(np.diff(days))) if len(days) > 1 else 0.0
    for first, last, name in shaded(changes, float(days[-1])):
        axes.axvspan(first - half, last + half, facecolor=SHADE, alpha=0.3, linewidth=0.0, zorder=0.5, label=name)


def _draw(axes: Axes, table: pd.DataFrame, name: str, one: SeriesTrend, phase: str, estimate: str) -> None:
    from matplotlib.colors import to_rgba

    days, values = days_of(table), values_of(table, name)
    between = table["epoch"].isna().to_numpy()
    colour, mark = _COLOURS[phase], _MARKS[estimate]
    hollow = "none" if estimate == SMOOTHED else colour
    axes.plot(days[between], values[between], mark, color=colour, markersize=1.5, alpha=0.5, markerfacecolor=hollow)
    axes.errorbar(
        days[~between], values[~between], yerr=2.0 * one.floor, fmt=mark, color=colour, ecolor=to_rgba(colour, 0.25),
        markersize=3.5, markerfacecolor=hollow, elinewidth=0.6, label=f"{phase}, {estimate}",
    )  # fmt: skip
    if one.trend.count and one.span > 0.0:
        ends = (float(days[0]), float(days[-1]))
        style = "-" if one.shown else ":" if one.primary else "--"
        axes.plot(ends, (one.trend.first, one.trend.last), style, color=colour, linewidth=1.0)
