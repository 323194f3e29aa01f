"""Figure of ``twin sensitivity``: effects of offsets, coefficients, step, sample interval, dropouts and gaps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.twins.drawing import COLOURS, label_axes, new_sheet
from gliderhpc.twins.scoring import LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.study import select
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


LINE_STYLES = {"recommended": "-", "paper": "--"}


MIN_SHIFT = 0.02
"""Half the smallest range of the axis of the offsets, N or N m per degree."""


_BASE_VALUES = {"step": 0.1, "sample interval": 1.0, "dropout": 0.0, "gap": 0.0}


SWEEP_LABELS = {
    "step": "step, s",
    "sample interval": "sample interval, s",
    "dropout": "share lost",
    "gap": "gap, s (one in 300 s)",
}


_SWEEP_SCORES = (("rmse_B_cr", "yaw, N m"), ("rmse_B_cu", "surge, N"), ("velocity_error", "velocity, m/s"))


def draw_sensitivity(summary: Sequence[Row], biases: Sequence[Row]) -> Figure:
    """Draw the effects of offsets, coefficients, step, sample interval, dropouts and gaps.

    Parameters
    ----------
    summary : sequence of dict
        Medians of every score, one line per preset, sweep and value.
    biases : sequence of dict
        Shifts of the channels (N and N m, of offsets per degree), one line per preset, error and phase.
    """
    figure = new_sheet(12.5, 12.0)
    grid = figure.add_gridspec(3, 4)
    preset = biases[0]["preset"]
    biases = select(biases, preset=preset)
    sweep = next(line["sweep"] for line in biases if line["sweep"].startswith("offset"))
    for position, name in enumerate(("pitch", "heading")):
        axes = figure.add_subplot(grid[0, 2 * position : 2 * position + 2])
        lines = select(biases, sweep=sweep, value=name)
        _draw_bars(axes, {line["phase"]: [line[channel] for channel in CHANNELS] for line in lines}, list(CHANNELS))
        # A scale that magnifies rounding to the size of a signal would mislead.
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -MIN_SHIFT), max(high, MIN_SHIFT))
        label_axes(axes, "", "shift, N or N m per degree", f"{name} {sweep} degree, preset {preset}")
    _draw_coefficients(figure.add_subplot(grid[1, :]), select(biases, phase="dive"), preset)
    for position, name in enumerate(SWEEP_LABELS):
        _draw_sweep(figure.add_subplot(grid[2, position]), summary, name)
    return figure


def _draw_coefficients(axes: Axes, biases: Sequence[Row], preset: str) -> None:
    lines = [line for line in biases if line["sweep"] in ("one coefficient", "coefficients")]
    shifts = {name: [line[f"{name}_rms"] for line in lines] for name in LONGITUDINAL_AND_YAW}
    _draw_bars(axes, shifts, [str(line["value"]) for line in lines])
    label_axes(
        axes,
        "",
        "shift on the dive, RMS, N or N m",
        f"coefficients 15 % too large one by one, and all within 15 %, preset {preset}",
    )


def _draw_sweep(axes: Axes, summary: Sequence[Row], sweep: str) -> None:
    for preset in dict.fromkeys(line["preset"] for line in summary):
        base = select(summary, preset=preset, sweep="usual")
        lines = select(summary, preset=preset, sweep=sweep) + [line | {"value": _BASE_VALUES[sweep]} for line in base]
        lines.sort(key=lambda line: float(line["value"]))
        x = [line["value"] for line in lines]
        for colour, (score, label) in zip(COLOURS, _SWEEP_SCORES, strict=False):
            axes.plot(
                x,
                [line[score] for line in lines],
                LINE_STYLES.get(preset, "-"),
                marker="o",
                ms=3,
                lw=1.1,
                color=colour,
                label=f"{label} ({preset})",
            )
    axes.set_yscale("log")
    if sweep == "step":
        axes.legend(fontsize=SMALL - 1.5, frameon=False)
    label_axes(axes, SWEEP_LABELS[sweep], "error")


def _draw_bars(axes: Axes, bars: dict[str, list[float]], names: Sequence[str]) -> None:
    width = 0.8 / len(bars)
    for index, (label, values) in enumerate(bars.items()):
        at = np.arange(len(names)) + (index - 0.5 * (len(bars) - 1)) * width
        axes.bar(at, values, width, label=label, color=COLOURS[index])
    axes.axhline(0.0, color=TRUTH, lw=0.5)
    axes.set_xticks(np.arange(len(names)), names, rotation=30 if len(names) > 8 else 0)
    axes.legend(fontsize=SMALL, frameon=False)
