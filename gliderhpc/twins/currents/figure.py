"""Figure of ``twin currents``: errors and coverage of the current, and transfer functions by vertical scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SHADE, SMALL, TRUTH, footnote
from gliderhpc.studies.library.passband import Passband, describe_unresolved
from gliderhpc.studies.library.scores import COVERAGE
from gliderhpc.twins.cases import PRESETS
from gliderhpc.twins.currents.results import (
    ALL,
    CurrentsResults,
    error_of,
)
from gliderhpc.twins.currents.runs import (
    GUSTS,
    WORLDS,
)
from gliderhpc.twins.drawing import COLOURS, label_axes, new_sheet
from gliderhpc.twins.scoring import Row, along_and_across
from gliderhpc.twins.study import select

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_currents(results: CurrentsResults) -> Figure:
    """Draw the depth-averaged current's errors and coverage above, the transfer functions below, from the results."""
    figure = new_sheet(12.5, 8.6)
    grid = figure.add_gridspec(2, 3)
    _draw_errors(figure.add_subplot(grid[0, 0]), results.averaged)
    for column, sigma in enumerate(COVERAGE, start=1):
        _draw_shares(figure.add_subplot(grid[0, column]), results.coverage, sigma)
    scores = (
        ("gain_current", "lateral current over true"),
        ("phase", "phase on the forcing, degree"),
        ("coherence", "coherence"),
    )
    for column, (score, name) in enumerate(scores):
        axes = figure.add_subplot(grid[1, column])
        _draw_transfer(axes, results.transfer, score, name)
        _mark_unresolved(axes, results.band)
        if score == "gain_current":
            scales = np.geomspace(*axes.get_xlim(), 200)
            axes.plot(scales, results.band.response(scales / results.band.vertical_speed), color=TRUTH, lw=1.0, ls=":",
                      label="by formula")  # fmt: skip
            axes.set_ylim(0.0, 1.4 * axes.dataLim.ymax)
            axes.legend(fontsize=SMALL - 1, frameon=False, ncols=2, loc="upper left")
    footnote(
        figure,
        f"{describe_unresolved(results.band)}\nGrey: scales removed by moving average and smoothing; "
        "dash-dotted: scale from which the hull follows the water more than it slips.",
    )
    return figure


def _draw_errors(axes: Axes, rows: Sequence[Row]) -> None:
    """Errors of the current along and across the track."""
    track = np.array([(row["track_north"], row["track_east"]) for row in rows])
    axes.plot(
        *along_and_across(np.array([error_of(row) for row in rows]), track), "o", ms=2.5, color=COLOURS[0], alpha=0.5
    )
    for line in (axes.axhline, axes.axvline):
        line(0.0, color=SHADE, lw=0.7, zorder=0)
    axes.set_aspect("equal", "datalim")
    title = f"depth-averaged current, {len(rows)} twins"
    label_axes(axes, "error along the track, m/s", "error across the track, m/s", title)


def _draw_shares(axes: Axes, coverage: Sequence[Row], sigma: int) -> None:
    """Share of the truths inside an ellipse by speed, with its sampling error."""
    speeds = list(dict.fromkeys(line["speed"] for line in coverage if line["speed"] != ALL))
    names = list(dict.fromkeys(line["constants"] for line in coverage))
    for index, name in enumerate(names):
        lines = [line for line in coverage if line["constants"] == name and line["speed"] != ALL]
        x = [speeds.index(line["speed"]) + 0.12 * (index - 0.5 * (len(names) - 1)) for line in lines]
        axes.errorbar(
            x, [line[f"inside_{sigma}"] for line in lines], [line[f"inside_{sigma}_error"] for line in lines],
            fmt="o", ms=4, lw=1.0, capsize=2, color=COLOURS[index], label=name,
        )  # fmt: skip
    axes.axhline(COVERAGE[sigma], color=TRUTH, lw=0.8, ls="--", zorder=0)
    axes.set_ylim(-0.02, 1.05)
    axes.set_xticks(range(len(speeds)), speeds, rotation=15)
    if sigma == max(COVERAGE):
        axes.legend(fontsize=SMALL - 1, frameon=False)
    title = f"truth within {sigma} sigma (dashed: {COVERAGE[sigma]:.1%})"
    label_axes(axes, "speed of the current", "share of the twins", title)


def _draw_transfer(axes: Axes, transfer: Sequence[Row], score: str, name: str) -> None:
    """One score by vertical scale, of the broadband water."""
    for index, preset in enumerate(PRESETS):
        for factor, style in zip(WORLDS[GUSTS][0], ("--", "-"), strict=True):
            lines = select(transfer, preset=preset, world=GUSTS, factor=factor)
            axes.plot([line["scale"] for line in lines], [line[score] for line in lines], style, marker="o", ms=2.5,
                      lw=1.1, color=COLOURS[index], label=f"{preset}, {GUSTS} x {factor:g}")  # fmt: skip
    axes.set_xscale("log")
    if score != "phase":
        axes.set_ylim(0.0, None)
    label_axes(axes, "vertical scale, m", name)


def _mark_unresolved(axes: Axes, band: Passband) -> None:
    """Shade the scales that moving average and smoothing remove; mark where the hull begins to follow the water."""
    low, high = axes.get_xlim()
    axes.axvspan(min(band.baseline_limit, high), high, color=SHADE, alpha=0.25, lw=0)
    axes.axvspan(low, max(band.smoothing_limit, low), color=SHADE, alpha=0.25, lw=0)
    axes.axvline(band.following_limit, color=SHADE, lw=0.9, ls="-.")
    axes.set_xlim(low, high)
