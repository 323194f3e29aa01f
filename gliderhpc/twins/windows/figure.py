"""Figure of ``twin windows``: excerpts of the yaw moment, and scores by window length and setting (Figure 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gliderhpc.findings.drawing import SHADE, SMALL, TRUTH
from gliderhpc.twins.cases import OPERATING_LENGTH
from gliderhpc.twins.drawing import COLOURS, label_axes, new_sheet
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import select

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Part of the yaw moment for panels (a) and (b): time and seams from its start (s), truth, estimate (N m)."""

    hull: str
    preset: str
    sliding: bool
    time: NDArray[np.float64]
    truth: NDArray[np.float64]
    estimate: NDArray[np.float64]
    boundaries: NDArray[np.float64]


_LENGTH_PANELS = (
    ("rmse_B_cr", "yaw RMSE, N m", False),
    ("overall", "error of all channels, relative", False),
    ("cost_per_30s", "cost per 30 s, rad² s", True),
    ("seam_ratio", "seam ratio", True),
    ("jump_ratio", "jump ratio", True),
    ("capped", "share at the cap", False),
)


_OTHER_SWEEPS = (
    (("tolerance",), "tolerance on max |s g|"),
    (("margin",), "margin, s (30 s window)"),
    (("scale of yaw", "scale of the others"), "factor of the transform's scale"),
)


def draw_windows(summary: Sequence[Row], excerpts: Sequence[Excerpt]) -> Figure:
    """Draw Figure 5: estimates with overlapping and non-overlapping windows, the truth, and the scores by setting.

    Parameters
    ----------
    summary : sequence of dict
        Median and quartiles of every score, one line per hull, preset, sweep and value.
    excerpts : sequence of Excerpt
        Yaw moment with overlapping and with non-overlapping windows, for panels (a) and (b).
    """
    figure = new_sheet(12.5, 13.5)
    grid = figure.add_gridspec(5, 6)
    for position, excerpt in enumerate(excerpts):
        _draw_excerpt(figure.add_subplot(grid[position, :]), excerpt, "ab"[position])
    for position, (score, label, logarithmic) in enumerate(_LENGTH_PANELS):
        row, column = divmod(position, 3)
        axes = figure.add_subplot(grid[2 + row, 2 * column : 2 * column + 2])
        _draw_lengths(axes, summary, score, label, logarithmic)
        if position == 0:
            axes.legend(fontsize=SMALL - 1, ncols=1, frameon=False)
            axes.set_title("(c)", loc="left", fontsize=SMALL + 1)
    for position, (sweeps, label) in enumerate(_OTHER_SWEEPS):
        axes = figure.add_subplot(grid[4, 2 * position : 2 * position + 2])
        _draw_settings(axes, summary, sweeps, label)
        axes.set_title(f"({'def'[position]})", loc="left", fontsize=SMALL + 1)
    return figure


def _draw_excerpt(axes: Axes, excerpt: Excerpt, letter: str) -> None:
    colour = COLOURS[0] if excerpt.sliding else COLOURS[1]
    axes.plot(excerpt.time, excerpt.truth, color=TRUTH, lw=1.4, label="truth")
    axes.plot(excerpt.time, excerpt.estimate, color=colour, lw=1.0, label="identified")
    for boundary in excerpt.boundaries:
        axes.axvline(boundary, color=SHADE, lw=0.5, zorder=0)
    handover = "overlapping, margin 10 s" if excerpt.sliding else "non-overlapping"
    label_axes(
        axes,
        "s",
        "yaw moment, N m",
        f"({letter}) {excerpt.hull}, {excerpt.preset}: {OPERATING_LENGTH:g} s window, {handover} (grey: boundaries)",
    )
    axes.legend(fontsize=SMALL, frameon=False, ncols=2, loc="upper right")


def _draw_lengths(axes: Axes, summary: Sequence[Row], score: str, label: str, logarithmic: bool) -> None:
    for index, (hull, preset) in enumerate(_hulls_presets(summary)):
        colour = COLOURS[index % len(COLOURS)]
        for sweep, marker, style in (("sliding", "o", "-"), ("not sliding", "x", ":")):
            lines = _lines(summary, hull, preset, sweep)
            if not lines:
                continue
            x = np.array([line["value"] for line in lines])
            value, low, high = ([line[f"{score}{end}"] for line in lines] for end in ("", "_low", "_high"))
            name = f"{hull}, {preset}" + ("" if sweep == "sliding" else ", non-overlapping")
            axes.plot(x, value, style, marker=marker, ms=3.5, lw=1.1, color=colour, label=name)
            if sweep == "sliding":
                axes.fill_between(x, low, high, color=colour, alpha=0.15, lw=0)
    if logarithmic:
        axes.set_yscale("log")
    axes.axvline(OPERATING_LENGTH, color=SHADE, lw=0.6, zorder=0)
    label_axes(axes, "window length, s", label)


def _draw_settings(axes: Axes, summary: Sequence[Row], sweeps: Sequence[str], label: str) -> None:
    """Yaw error in full lines and surge error dotted, over one or two settings."""
    for index, (hull, preset) in enumerate(_hulls_presets(summary)):
        colour = COLOURS[index % len(COLOURS)]
        for sweep, marker in zip(sweeps, ("o", "s"), strict=False):
            lines = _lines(summary, hull, preset, sweep)
            if not lines:
                continue
            x = [line["value"] for line in lines]
            name = f"{hull}, {preset}" + (f", {sweep}" if len(sweeps) > 1 else "")
            yaw, surge = ([line[score] for line in lines] for score in ("rmse_B_cr", "rmse_B_cu"))
            axes.plot(x, yaw, "-", marker=marker, ms=3.5, lw=1.1, color=colour, label=name)
            axes.plot(x, surge, ":", marker=marker, ms=2.5, lw=0.9, color=colour)
    if sweeps[0] != "margin":
        axes.set_xscale("log")
    axes.set_yscale("log")
    axes.legend(fontsize=SMALL - 1.5, frameon=False)
    label_axes(axes, label, "RMSE: yaw, N m (full); surge, N (dotted)")


def _hulls_presets(summary: Sequence[Row]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((line["hull"], line["preset"]) for line in summary))


def _lines(summary: Sequence[Row], hull: str, preset: str, sweep: str) -> list[Row]:
    """Lines of one sweep by value, with the operating point, whose rows belong to the sweep of lengths."""
    chosen = select(summary, hull=hull, preset=preset, sweep=sweep)
    at = select(summary, hull=hull, preset=preset, value=OPERATING_LENGTH)
    if sweep == "margin":
        chosen += [line | {"value": 0.0} for line in select(at, sweep="not sliding")]
        chosen += [line | {"value": OPERATING_LENGTH / 3.0} for line in select(at, sweep="sliding")]
    elif sweep.startswith("scale") and chosen:
        chosen += [line | {"value": 1.0} for line in select(at, sweep="sliding")]
    return sorted(chosen, key=lambda line: float(line["value"]))
