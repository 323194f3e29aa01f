"""Figure of ``twin recoverability``: detection of impulses, axial offsets, and errors of the current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SHADE, SMALL
from gliderhpc.twins.cases import PRESETS
from gliderhpc.twins.drawing import COLOURS, label_axes, new_sheet
from gliderhpc.twins.scoring import Row, along_and_across
from gliderhpc.twins.study import select

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_recoverability(noise: Mapping[str, Row], detection: Sequence[Row], motions: Sequence[Row]) -> Figure:
    """Draw detection, height and timing of impulses, axial offsets, and the current's errors.

    Parameters
    ----------
    noise : mapping of str to dict
        Identification noise and threshold (N m) by preset.
    detection : sequence of dict
        Detection rate, height and delay, one line per preset, amplitude (N m) and width (s).
    motions : sequence of dict
        Axial offset (N) and error of the current (m/s), one row per twin.
    """
    figure = new_sheet(12.5, 11.0)
    grid = figure.add_gridspec(3, 2)
    for column, preset in enumerate(noise):
        rate, gain = figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])
        _draw_detection(rate, gain, select(detection, preset=preset))
        rate.axvline(noise[preset]["threshold"], color=SHADE, lw=0.7, zorder=0)
        for axes in (rate, gain):
            axes.set_xscale("log")
        gain.axhline(1.0, color=SHADE, lw=0.7, zorder=0)
        gain.set_ylim(0.0, 2.0)
        rate.legend(fontsize=SMALL - 1, frameon=False, title="width", title_fontsize=SMALL - 1)
        label_axes(rate, "amplitude, N m", "detection rate", f"preset {preset}; grey: threshold")
        label_axes(gain, "amplitude, N m", "identified over true height")
    models = dict.fromkeys(row["model"] for row in motions)
    rows_of = {model: select(motions, preset=PRESETS[0], model=model) for model in models}
    _draw_offsets(figure.add_subplot(grid[2, 0]), rows_of)
    _draw_current_errors(figure.add_subplot(grid[2, 1]), rows_of)
    return figure


def _draw_detection(rate: Axes, gain: Axes, detection: Sequence[Row]) -> None:
    """Detection rate and height over the amplitude, one line per width."""
    for index, width in enumerate(sorted({line["width"] for line in detection})):
        lines = sorted(select(detection, width=width), key=lambda line: float(line["amplitude"]))
        x = [line["amplitude"] for line in lines]
        rates, gains, low, high = ([line[name] for line in lines] for name in ("rate", "gain", "gain_low", "gain_high"))
        colour = COLOURS[index % len(COLOURS)]
        rate.plot(x, rates, "o-", ms=3, lw=1.1, color=colour, label=f"{width:g} s")
        gain.plot(x, gains, "o-", ms=3, lw=1.1, color=colour)
        gain.fill_between(x, low, high, color=colour, alpha=0.12, lw=0)


def _draw_offsets(axes: Axes, rows_of: Mapping[str, Sequence[Row]]) -> None:
    """Histogram of the axial offsets by the assumed coefficients."""
    offsets_of = {
        model: [row[name] for row in rows for name in ("axial_dive", "axial_climb")] for model, rows in rows_of.items()
    }
    every = np.concatenate([np.array(values) for values in offsets_of.values()])
    bins = np.histogram_bin_edges(every, bins=30).tolist()
    for index, (model, offsets) in enumerate(offsets_of.items()):
        axes.hist(offsets, bins=bins, color=COLOURS[index], alpha=0.6, label=f"coefficients {model}")
    axes.legend(fontsize=SMALL, frameon=False)
    label_axes(axes, "axial offset, dive and climb, N", f"dives (preset {PRESETS[0]})")


def _draw_current_errors(axes: Axes, rows_of: Mapping[str, Sequence[Row]]) -> None:
    """Errors of the depth-averaged current along and across the track."""
    for index, (model, rows) in enumerate(rows_of.items()):
        track = np.array([(row["track_north"], row["track_east"]) for row in rows])
        error = np.array([(row["error_north"], row["error_east"]) for row in rows])
        along, across = along_and_across(error, track)
        axes.plot(along, across, "o", ms=4, color=COLOURS[index], alpha=0.7, label=f"coefficients {model}")
    axes.set_aspect("equal", "datalim")
    axes.legend(fontsize=SMALL, frameon=False)
    label_axes(axes, "error of the current along the track, m/s", "across, m/s")
