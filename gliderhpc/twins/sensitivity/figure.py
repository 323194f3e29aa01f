"""What offsets, coefficients, step, sample interval, dropouts and gaps do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.twins.drawing import COLOURS, dress, sheet
from gliderhpc.twins.sensitivity.shifts import SensitivityResults
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES = {"recommended": "-", "paper": "--"}
LEAST_SHIFT = 0.02
"""N or N m a degree: the axis of the offsets is not narrower."""

_BASE_VALUES = {"step": 0.1, "sample interval": 1.0, "dropout": 0.0, "gap": 0.0}
_SWEEP_LABELS = {
    "step": "step, s",
    "sample interval": "sample interval, s",
    "dropout": "share lost",
    "gap": "gap, s (one in 300 s)",
}


def draw_sensitivity(results: SensitivityResults) -> Figure:
    """Draw offsets, coefficients, and what step, sample interval, dropouts and gaps do."""
    figure = sheet(12.5, 12.0)
    grid = figure.add_gridspec(3, 4)
    preset = results.biases[0]["preset"]
    offsets = [line for line in results.biases if line["sweep"].startswith("offset") and line["preset"] == preset]
    first = offsets[0]["sweep"]
    for position, name in enumerate(("pitch", "heading")):
        lines = [line for line in offsets if line["value"] == name and line["sweep"] == first]
        axes = figure.add_subplot(grid[0, 2 * position : 2 * position + 2])
        _bars(axes, {line["phase"]: [line[channel] for channel in CHANNELS] for line in lines}, list(CHANNELS))
        # A scale that would blow rounding up to a signal says nothing.
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -LEAST_SHIFT), max(high, LEAST_SHIFT))
        dress(axes, "", "shift, N or N m a degree")
        axes.set_title(f"{name} {first} degree, preset {preset}", loc="left", fontsize=SMALL + 1)
    singles = [
        line for line in results.biases
        if line["sweep"] in ("one coefficient", "coefficients") and line["phase"] == "dive" and line["preset"] == preset
    ]  # fmt: skip
    axes = figure.add_subplot(grid[1, :])
    shown = ("B_cu", "B_cw", "B_cq", "B_cr")
    _bars(
        axes,
        {name: [line[f"{name}_rms"] for line in singles] for name in shown},
        [str(line["value"]) for line in singles],
    )
    dress(axes, "", "shift on the dive, RMS, N or N m")
    axes.set_title(
        f"coefficients 15 % too large one by one, and all within 15 %, preset {preset}", loc="left", fontsize=SMALL + 1
    )
    for position, sweep in enumerate(("step", "sample interval", "dropout", "gap")):
        axes = figure.add_subplot(grid[2, position])
        _over_sweep(axes, results, sweep)
    return figure


def _over_sweep(axes: Axes, results: SensitivityResults, sweep: str) -> None:
    for preset in dict.fromkeys(line["preset"] for line in results.summary):
        lines = [line for line in results.summary if line["preset"] == preset and line["sweep"] == sweep]
        base = [line for line in results.summary if line["preset"] == preset and line["sweep"] == "usual"]
        lines = sorted(
            [*lines, *({**line, "value": _BASE_VALUES[sweep]} for line in base)], key=lambda line: float(line["value"])
        )
        x = [line["value"] for line in lines]
        for index, (score, label) in enumerate(
            (("rmse_B_cr", "yaw, N m"), ("rmse_B_cu", "surge, N"), ("velocity_error", "velocity, m/s"))
        ):
            axes.plot(x, [line[score] for line in lines], STYLES.get(preset, "-"), marker="o", ms=3, lw=1.1,
                      color=COLOURS[index], label=f"{label} ({preset})")  # fmt: skip
    axes.set_yscale("log")
    if sweep == "step":
        axes.legend(fontsize=SMALL - 1.5, frameon=False)
    dress(axes, _SWEEP_LABELS[sweep], "error")


def _bars(axes: Axes, groups: dict[str, list[float]], names: Sequence[str]) -> None:
    width = 0.8 / len(groups)
    for index, (label, values) in enumerate(groups.items()):
        axes.bar(np.arange(len(names)) + (index - 0.5 * (len(groups) - 1)) * width, values, width, label=label,
                 color=COLOURS[index])  # fmt: skip
    axes.axhline(0.0, color=TRUTH, lw=0.5)
    axes.set_xticks(np.arange(len(names)), names, rotation=30 if len(names) > 8 else 0)
    axes.legend(fontsize=SMALL, frameon=False)
