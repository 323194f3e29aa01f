"""Detection, height and timing of impulses, axial offsets, and the current's errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL
from gliderhpc.twins.drawing import COLOURS, dress, sheet
from gliderhpc.twins.recoverability.results import RecoverabilityResults
from gliderhpc.twins.recoverability.runs import MODELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_recoverability(results: RecoverabilityResults) -> Figure:
    """Draw detection, height and timing of impulses, axial offsets, and the current's errors under the budget."""
    figure = sheet(12.5, 11.0)
    grid = figure.add_gridspec(3, 2)
    for column, preset in enumerate(results.noise):
        lines = [line for line in results.detection if line["preset"] == preset]
        widths = sorted({line["width"] for line in lines})
        rate, gain = figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])
        for index, width in enumerate(widths):
            of_width = sorted(
                (line for line in lines if line["width"] == width), key=lambda line: float(line["amplitude"])
            )
            x = [line["amplitude"] for line in of_width]
            colour = COLOURS[index % len(COLOURS)]
            rate.plot(x, [line["rate"] for line in of_width], "o-", ms=3, lw=1.1, color=colour, label=f"{width:g} s")
            gain.plot(x, [line["gain"] for line in of_width], "o-", ms=3, lw=1.1, color=colour)
            gain.fill_between(x, [line["gain_low"] for line in of_width], [line["gain_high"] for line in of_width],
                              color=colour, alpha=0.12, lw=0)  # fmt: skip
        rate.axvline(results.noise[preset]["threshold"], color="#999999", lw=0.7, zorder=0)
        for axes in (rate, gain):
            axes.set_xscale("log")
        gain.axhline(1.0, color="#999999", lw=0.7, zorder=0)
        gain.set_ylim(0.0, 2.0)
        rate.set_title(f"preset {preset}; grey: threshold", loc="left", fontsize=SMALL + 1)
        rate.legend(fontsize=SMALL - 1, frameon=False, title="width", title_fontsize=SMALL - 1)
        dress(rate, "amplitude, N m", "detection rate")
        dress(gain, "amplitude, N m", "identified over true height")
    _offset_histogram(figure.add_subplot(grid[2, 0]), results)
    _current_errors(figure.add_subplot(grid[2, 1]), results)
    return figure


def _offset_histogram(axes: Axes, results: RecoverabilityResults) -> None:
    preset = results.errors[0]["preset"]
    rows_of = {
        model: [row for row in results.motions if row["preset"] == preset and row["model"] == model] for model in MODELS
    }
    offsets_of = {
        model: [row[name] for row in rows for name in ("axial_dive", "axial_climb")] for model, rows in rows_of.items()
    }
    every = np.concatenate([np.array(values) for values in offsets_of.values()])
    bins = np.histogram_bin_edges(every, bins=30).tolist()
    for index, (model, offsets) in enumerate(offsets_of.items()):
        axes.hist(offsets, bins=bins, color=COLOURS[index], alpha=0.6, label=f"coefficients {model}")
    axes.legend(fontsize=SMALL, frameon=False)
    dress(axes, "axial offset, dive and climb, N", f"dives (preset {preset})")


def _current_errors(axes: Axes, results: RecoverabilityResults) -> None:
    """Errors of the depth-averaged current along and across the track."""
    preset = results.errors[0]["preset"]
    for index, model in enumerate(MODELS):
        rows = [row for row in results.motions if row["preset"] == preset and row["model"] == model]
        track = np.array([(row["track_north"], row["track_east"]) for row in rows])
        wrong = np.array([(row["error_north"], row["error_east"]) for row in rows])
        unit = track / np.linalg.norm(track, axis=1)[:, None]
        along = (wrong * unit).sum(axis=1)
        across = wrong[:, 1] * unit[:, 0] - wrong[:, 0] * unit[:, 1]
        axes.plot(along, across, "o", ms=4, color=COLOURS[index], alpha=0.7, label=f"coefficients {model}")
    axes.set_aspect("equal", "datalim")
    axes.legend(fontsize=SMALL, frameon=False)
    dress(axes, "error of the current along the track, m/s", "across, m/s")
