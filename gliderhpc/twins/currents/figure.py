"""Errors and ellipses, shares inside by speed, and gain, phase and coherence by vertical scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL, TRUTH, footnote
from gliderhpc.studies.currents.passband import Passband, unseen
from gliderhpc.studies.library.current_difference import COVERAGE
from gliderhpc.twins.currents.coverage import ALL, error_of
from gliderhpc.twins.currents.results import CurrentsResults
from gliderhpc.twins.currents.runs import GUSTS, PRESETS, WORLDS
from gliderhpc.twins.drawing import COLOURS, dress, sheet
from gliderhpc.twins.runs import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREY = "#999999"


def draw_currents(results: CurrentsResults) -> Figure:
    """Draw the depth-averaged current's errors and coverage above, the transfer functions below."""
    figure = sheet(12.5, 8.6)
    grid = figure.add_gridspec(2, 3)
    _errors(figure.add_subplot(grid[0, 0]), results.averaged)
    for column, sigma in enumerate(COVERAGE, start=1):
        _inside(figure.add_subplot(grid[0, column]), results.coverage, sigma)
    scores = (("gain_current", "lateral current over true"), ("phase", "phase on the forcing, degree"),
              ("coherence", "coherence"))  # fmt: skip
    for column, (score, name) in enumerate(scores):
        axes = figure.add_subplot(grid[1, column])
        _transfer(axes, results.transfer, score, name)
        _mark_unseen(axes, results.band)
        if score == "gain_current":
            scales = np.geomspace(*axes.get_xlim(), 200)
            axes.plot(scales, results.band.response(scales / results.band.vertical_speed), color=TRUTH, lw=1.0, ls=":",
                      label="by formula")  # fmt: skip
            axes.set_ylim(0.0, 1.4 * axes.dataLim.ymax)
            axes.legend(fontsize=SMALL - 1, frameon=False, ncols=2, loc="upper left")
    footnote(
        figure,
        unseen(results.band) + "\nGrey: what moving average and smoothing take; dash-dotted: from here on the hull "
        "follows the water more than it slips.",
    )
    return figure


def _errors(axes: Axes, rows: Sequence[Row]) -> None:
    """Errors of the current along and across the track."""
    track = np.array([(row["track_north"], row["track_east"]) for row in rows])
    unit = track / np.linalg.norm(track, axis=1)[:, None]
    wrong = np.array([error_of(row) for row in rows])
    across = wrong[:, 1] * unit[:, 0] - wrong[:, 0] * unit[:, 1]
    axes.plot((wrong * unit).sum(axis=1), across, "o", ms=2.5, color=COLOURS[0], alpha=0.5)
    for line in (axes.axhline, axes.axvline):
        line(0.0, color=_GREY, lw=0.7, zorder=0)
    axes.set_aspect("equal", "datalim")
    axes.set_title(f"depth-averaged current, {len(rows)} twins", loc="left", fontsize=SMALL + 1)
    dress(axes, "error along the track, m/s", "error across the track, m/s")


def _inside(axes: Axes, coverage: Sequence[Row], sigma: int) -> None:
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
    axes.set_title(f"truth within {sigma} sigma (dashed: {COVERAGE[sigma]:.1%})", loc="left", fontsize=SMALL + 1)
    if sigma == max(COVERAGE):
        axes.legend(fontsize=SMALL - 1, frameon=False)
    dress(axes, "speed of the current", "share of the twins")


def _transfer(axes: Axes, transfer: Sequence[Row], score: str, name: str) -> None:
    """One score by vertical scale, of the broadband water."""
    for index, preset in enumerate(PRESETS):
        for factor, style in zip(WORLDS[GUSTS][0], ("--", "-"), strict=True):
            lines = [
                line for line in transfer
                if (line["preset"], line["world"], line["factor"]) == (preset, GUSTS, factor)
            ]  # fmt: skip
            axes.plot([line["scale"] for line in lines], [line[score] for line in lines], style, marker="o", ms=2.5,
                      lw=1.1, color=COLOURS[index], label=f"{preset}, {GUSTS} x {factor:g}")  # fmt: skip
    axes.set_xscale("log")
    if score != "phase":
        axes.set_ylim(0.0, None)
    dress(axes, "vertical scale, m", name)


def _mark_unseen(axes: Axes, band: Passband) -> None:
    """Shade what moving average and smoothing take, and draw where the hull begins to follow the water."""
    low, high = axes.get_xlim()
    axes.axvspan(min(band.baseline_limit, high), high, color=_GREY, alpha=0.25, lw=0)
    axes.axvspan(low, max(band.smoothing_limit, low), color=_GREY, alpha=0.25, lw=0)
    axes.axvline(band.following_limit, color=_GREY, lw=0.9, ls="-.")
    axes.set_xlim(low, high)
