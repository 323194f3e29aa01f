"""Figure 5 of the paper: windows sliding and not against the truth, and the scores over every swept setting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.twins.drawing import COLOURS, dress, sheet
from gliderhpc.twins.runs import Row
from gliderhpc.twins.windows.excerpt import Excerpt
from gliderhpc.twins.windows.results import WindowsResults
from gliderhpc.twins.windows.sweeps import OPERATING_LENGTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OTHER_SWEEPS = (
    (("tolerance",), "tolerance on max |s g|"),
    (("margin",), "margin, s (30 s window)"),
    (("scale of yaw", "scale of the others"), "factor of the transform's scale"),
)


def draw_windows(results: WindowsResults) -> Figure:
    """Draw Figure 5: sliding and not against the truth, and the scores over every swept setting."""
    figure = sheet(12.5, 13.5)
    grid = figure.add_gridspec(5, 6)
    preset = results.excerpts[0].preset
    shown = [excerpt for excerpt in results.excerpts if excerpt.preset == preset]
    for position, excerpt in enumerate(shown):
        _excerpt(figure.add_subplot(grid[position, :]), excerpt, "ab"[position])
    panels = (
        ("rmse_B_cr", "yaw RMSE, N m", False), ("overall", "error of all channels, relative", False),
        ("cost_per_30s", "cost a 30 s, rad² s", True), ("seam_ratio", "seam ratio", True),
        ("jump_ratio", "jump ratio", True), ("capped", "share at the cap", False),
    )  # fmt: skip
    for position, (score, label, logarithmic) in enumerate(panels):
        row, column = divmod(position, 3)
        axes = figure.add_subplot(grid[2 + row, 2 * column : 2 * column + 2])
        _over_lengths(axes, results.summary, score, label, logarithmic)
        if position == 0:
            axes.legend(fontsize=SMALL - 1, ncols=1, frameon=False)
            axes.set_title("(c)", loc="left", fontsize=SMALL + 1)
    for position, (sweeps, label) in enumerate(_OTHER_SWEEPS):
        axes = figure.add_subplot(grid[4, 2 * position : 2 * position + 2])
        _over_settings(axes, results.summary, sweeps, label)
        axes.set_title(f"({'def'[position]})", loc="left", fontsize=SMALL + 1)
    return figure


def _excerpt(axes: Axes, excerpt: Excerpt, letter: str) -> None:
    axes.plot(excerpt.time, excerpt.truth, color=TRUTH, lw=1.4, label="truth")
    axes.plot(
        excerpt.time, excerpt.estimate, color=COLOURS[0] if excerpt.sliding else COLOURS[1], lw=1.0, label="identified"
    )
    for boundary in excerpt.boundaries:
        axes.axvline(boundary, color="#999999", lw=0.5, zorder=0)
    how = "sliding, margin 10 s" if excerpt.sliding else "not sliding"
    axes.set_title(
        f"({letter}) {excerpt.hull}, {excerpt.preset}: {OPERATING_LENGTH:g} s window, {how} (grey: boundaries)",
        loc="left", fontsize=SMALL + 1,
    )  # fmt: skip
    dress(axes, "s", "yaw moment, N m")
    axes.legend(fontsize=SMALL, frameon=False, ncols=2, loc="upper right")


def _over_lengths(axes: Axes, summary: Sequence[Row], score: str, label: str, logarithmic: bool) -> None:
    for index, (hull, preset, sliding) in enumerate(_series(summary)):
        lines = _lines(summary, hull, preset, "sliding" if sliding else "not sliding")
        if not lines:
            continue
        x = np.array([line["value"] for line in lines])
        colour = COLOURS[(index // 2) % len(COLOURS)]
        marker, style = ("o", "-") if sliding else ("x", ":")
        axes.plot(x, [line[score] for line in lines], style, marker=marker, ms=3.5, lw=1.1, color=colour,
                  label=f"{hull}, {preset}{'' if sliding else ', not sliding'}")  # fmt: skip
        if sliding:
            axes.fill_between(x, [line[f"{score}_low"] for line in lines], [line[f"{score}_high"] for line in lines],
                              color=colour, alpha=0.15, lw=0)  # fmt: skip
    if logarithmic:
        axes.set_yscale("log")
    axes.axvline(OPERATING_LENGTH, color="#999999", lw=0.6, zorder=0)
    dress(axes, "window length, s", label)


def _over_settings(axes: Axes, summary: Sequence[Row], sweeps: Sequence[str], label: str) -> None:
    """Yaw error in full colour and that of all channels pale, over one or two settings."""
    hulls_presets = list(dict.fromkeys((line["hull"], line["preset"]) for line in summary))
    for index, (hull, preset) in enumerate(hulls_presets):
        for sweep, marker in zip(sweeps, ("o", "s"), strict=False):
            lines = _lines(summary, hull, preset, sweep)
            if not lines:
                continue
            x = [line["value"] for line in lines]
            name = f"{hull}, {preset}" + (f", {sweep}" if len(sweeps) > 1 else "")
            colour = COLOURS[index % len(COLOURS)]
            axes.plot(
                x, [line["rmse_B_cr"] for line in lines], "-", marker=marker, ms=3.5, lw=1.1, color=colour, label=name
            )
            axes.plot(x, [line["rmse_B_cu"] for line in lines], ":", marker=marker, ms=2.5, lw=0.9, color=colour)
    if sweeps[0] != "margin":
        axes.set_xscale("log")
    axes.set_yscale("log")
    axes.legend(fontsize=SMALL - 1.5, frameon=False)
    dress(axes, label, "RMSE: yaw, N m (full); surge, N (dotted)")


def _series(summary: Sequence[Row]) -> list[tuple[str, str, bool]]:
    pairs = list(dict.fromkeys((line["hull"], line["preset"]) for line in summary))
    return [(hull, preset, sliding) for hull, preset in pairs for sliding in (True, False)]


def _lines(summary: Sequence[Row], hull: str, preset: str, sweep: str) -> list[Row]:
    """Lines of one sweep by value; the operating point belongs to the sweep of margins."""
    chosen = [line for line in summary if line["hull"] == hull and line["preset"] == preset and line["sweep"] == sweep]
    at = [
        line for line in summary
        if line["hull"] == hull and line["preset"] == preset and line["value"] == OPERATING_LENGTH
    ]  # fmt: skip
    if sweep == "margin":
        chosen += [{**line, "value": 0.0} for line in at if line["sweep"] == "not sliding"]
        chosen += [{**line, "value": OPERATING_LENGTH / 3.0} for line in at if line["sweep"] == "sliding"]
    elif sweep.startswith("scale") and chosen:
        chosen += [{**line, "value": 1.0} for line in at if line["sweep"] == "sliding"]
    return sorted(chosen, key=lambda line: float(line["value"]))
