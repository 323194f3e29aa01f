"""Profiles over the mission: depth and outcome, convergence, currents, and what they took to compute."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import ESTIMATE, FILTER, GLIDE_ANGLE, SHADE, SMALL, SMOOTHER, label, legend, panels
from gliderhpc.report.page.mission_table import MissionTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TALL, _FLAT = (9.0, 9.0), (9.0, 4.6)
_OUTCOMES = {"done": (ESTIMATE, "o"), "failed": (FILTER, "X"), "pending": (SHADE, "s")}
"""Colour and mark of a profile's status."""


def profiles_figure(table: MissionTable) -> Figure:
    """Draw depth and outcome, the windows' convergence, and both components of the current, a mark a profile."""
    figure, (depth, converged, north, east) = panels(4, 1, _TALL, "Profiles of the mission", share_x=True)
    _draw_depth(depth, table)
    converged.plot(table.number, 100.0 * table.converged, ".", color=ESTIMATE, markersize=6)
    converged.set_ylim(-4.0, 104.0)
    label(converged, "windows that converged", y="%")
    for axes, along in ((north, "north"), (east, "east")):
        _draw_current(axes, table, along)
    _by_number(east)
    return figure


def timing_figure(table: MissionTable) -> Figure:
    """Draw what the profiles took to compute, and how many times faster than the dive that was."""
    figure, (seconds, ratio) = panels(2, 1, _FLAT, "Computing time", share_x=True)
    seconds.plot(table.number, table.seconds, "o", color=ESTIMATE, markersize=4)
    seconds.set_ylim(bottom=0.0)
    label(seconds, "time to estimate a profile", y="s")
    ratio.plot(table.number, table.duration / table.seconds, "o", color=ESTIMATE, markersize=4)
    ratio.set_ylim(bottom=0.0)
    label(ratio, "time of the dive over the time to estimate it", y="ratio")
    _by_number(ratio)
    return figure


def _by_number(axes: Axes) -> None:
    """Count profiles along the lower axis, in whole numbers."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("number of the profile", fontsize=SMALL + 0.5)


def _draw_depth(axes: Axes, table: MissionTable) -> None:
    for status, (colour, mark) in _OUTCOMES.items():
        chosen = (table.status == status) & (np.isfinite(table.depth) | (status != "done"))
        depth = np.nan_to_num(table.depth[chosen])
        if chosen.any():
            axes.plot(table.number[chosen], depth, mark, color=colour, markersize=5, label=status, clip_on=False)
    deepest = np.nanmax(table.depth, initial=1.0)
    axes.set_ylim(1.08 * deepest, 0.0)
    label(axes, "greatest depth, by outcome; without a depth at 0", y="m")
    legend(axes)


def _draw_current(axes: Axes, table: MissionTable, along: str) -> None:
    taken, inverted = table.taken, table.column(f"dac_{along}")
    value, deviation = getattr(taken, along), getattr(taken, f"{along}_std")
    axes.axhline(0.0, color="#888888", linewidth=0.5)
    axes.plot(
        table.number, table.column(f"dac_{along}_glide_angle"), "_", color=GLIDE_ANGLE, markersize=9,
        markeredgewidth=1.6, label="by the glide angle",
    )  # fmt: skip
    axes.plot(table.number, inverted, "_", color=ESTIMATE, markersize=9, markeredgewidth=1.6, label="by the inversion")
    for chosen, colour, name in (
        (taken.smoothed, SMOOTHER, "taken: by the smoother, with 1 sigma"),
        (taken.known & ~taken.smoothed, ESTIMATE, "taken: by the inversion, with 1 sigma"),
    ):
        if chosen.any():
            axes.errorbar(
                table.number[chosen], value[chosen], yerr=deviation[chosen], fmt="o", color=colour, markersize=3.5,
                elinewidth=0.8, label=name,
            )  # fmt: skip
    label(axes, f"depth-averaged current to the {along}", y="m/s")
    legend(axes)
