"""Figure 9 of the paper: the six disturbances over the mission, dive and climb apart, by both primary estimates."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from gliderhpc.analysis.drawing import FILTER, LANDSCAPE, MODEL, footnote, label, legend, panels
from gliderhpc.analysis.drift.drag import DragDrift
from gliderhpc.analysis.drift.medians import DRAG, PHASES, PRIOR, UNITS, column
from gliderhpc.analysis.drift.series import LATERAL, LONGITUDINAL, EstimateTrends, days_of, values_of
from gliderhpc.analysis.drift.trends import SeriesTrend
from gliderhpc.mission.profile_data import ADJOINT, SMOOTHED

_COLOURS = {"dive": MODEL, "climb": FILTER}
_MARKS = {PRIOR: "+", ADJOINT: "o", SMOOTHED: "^"}

_NOTE = (
    "Medians over the steady glide of each profile: circles by the adjoint, triangles by the smoother. Lines are "
    "Theil-Sen slopes: solid where the robust verdict is a drift (Mann-Kendall by the moving-block bootstrap, Holm's "
    "correction, interval of the slope without zero), dotted where only the paper's plain test and interval say so, "
    "dashed where neither does. Bars: two standard deviations in epochs. Axial and heave force are weakly observed, "
    "their levels rest on the prior and on the hull's coefficients."
)


def figure_9(title: str, table: pd.DataFrame, found: Sequence[EstimateTrends]) -> Figure:
    """Draw the longitudinal plane above, the lateral one below.

    Parameters
    ----------
    title : str
        Of the mission.
    table : pandas.DataFrame
        A row a profile.
    found : sequence of EstimateTrends
        The estimates to draw.
    """
    figure, axes = panels(2, 3, LANDSCAPE, f"Drift of the disturbances: {title}")
    for letter, channel, one in zip("abcdef", (*LONGITUDINAL, *LATERAL), axes, strict=True):
        label(one, f"({letter}) {channel}", "days", UNITS[channel])
        for own in found:
            for phase in PHASES:
                name, trend = column(channel, phase, own.estimate), own.trends[channel, phase]
                _draw(one, table, name, trend, phase, own.estimate)
    legend(axes[0])
    footnote(figure, _NOTE)
    return figure


def drag_figure(title: str, table: pd.DataFrame, drags: Sequence[DragDrift]) -> Figure:
    """Draw the change of K_D0 that the disturbances are equivalent to, a panel an estimate."""
    figure, axes = panels(1, len(drags), (11.0, 4.6), f"Drag that the drift is equivalent to: {title}")
    for one, drag in zip(axes, drags, strict=True):
        label(one, f"{drag.estimate} estimate", "days", "change of K_D0 (kg/m)")
        for phase in PHASES:
            _draw(one, table, column(DRAG, phase, drag.estimate), drag.phases[phase], phase, drag.estimate)
        legend(one)
    footnote(
        figure,
        "Solid: the robust test, each series by itself, and the slope's interval say drift; dotted: the plain test; "
        "dashed: neither. A change of weight in water, or of the pitch sensor's offset, moves dive and climb apart; "
        "drag moves both alike.",
    )
    return figure


def _draw(axes: Axes, table: pd.DataFrame, name: str, one: SeriesTrend, phase: str, estimate: str) -> None:
    days, values = days_of(table), values_of(table, name)
    colour, mark = _COLOURS[phase], _MARKS[estimate]
    hollow = "none" if estimate == SMOOTHED else colour
    axes.errorbar(
        days, values, yerr=2.0 * one.floor, fmt=mark, color=colour, ecolor=to_rgba(colour, 0.25), markersize=3.5,
        markerfacecolor=hollow, elinewidth=0.6, label=f"{phase}, {estimate}",
    )  # fmt: skip
    if one.trend.count and one.span > 0.0:
        ends = (float(days[0]), float(days[-1]))
        style = "-" if one.shown else ":" if one.primary else "--"
        axes.plot(ends, (one.trend.first, one.trend.last), style, color=colour, linewidth=1.0)
