"""Figures of the twin experiments, built from objects alone so that any thread or worker can draw."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gliderhpc.analysis.twin.recoverability import MODELS, RecoverabilityStudy
from gliderhpc.analysis.twin.sensitivity import SensitivityStudy
from gliderhpc.analysis.twin.windows import OPERATING_LENGTH, Excerpt, WindowsStudy
from gliderhpc.store_schema.schema import CHANNELS

Row = dict[str, Any]

DPI = 130
# Okabe and Ito's palette, which colour-blind readers tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
TRUTH = "#000000"
STYLES = {"recommended": "-", "paper": "--"}
SMALL = 7.0
LEAST_SHIFT = 0.02
"""N or N m a degree: the axis of the offsets is not narrower."""


def write_windows_figure(study: WindowsStudy, path: Path) -> None:
    """Draw Figure 5: sliding and not against the truth, and the scores over every swept setting."""
    figure = Figure(figsize=(12.5, 13.5), layout="constrained")
    grid = figure.add_gridspec(5, 6)
    preset = study.excerpts[0].preset
    shown = [excerpt for excerpt in study.excerpts if excerpt.preset == preset]
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
        _over_lengths(axes, study.summary, score, label, logarithmic)
        if position == 0:
            axes.legend(fontsize=SMALL - 1, ncols=1, frameon=False)
            axes.set_title("(c)", loc="left", fontsize=SMALL + 1)
    for position, (sweeps, label) in enumerate(_OTHER_SWEEPS):
        axes = figure.add_subplot(grid[4, 2 * position : 2 * position + 2])
        _over_settings(axes, study.summary, sweeps, label)
        axes.set_title(f"({'def'[position]})", loc="left", fontsize=SMALL + 1)
    figure.savefig(path, dpi=DPI)


_OTHER_SWEEPS = (
    (("tolerance",), "tolerance on max |s g|"),
    (("margin",), "margin, s (30 s window)"),
    (("scale of yaw", "scale of the others"), "factor of the transform's scale"),
)


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
    _dress(axes, "s", "yaw moment, N m")
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
    _dress(axes, "window length, s", label)


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
    _dress(axes, label, "RMSE: yaw, N m (full); surge, N (dotted)")


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


def write_sensitivity_figure(study: SensitivityStudy, path: Path) -> None:
    """Draw offsets, coefficients, and what step, sample interval, dropouts and gaps do."""
    figure = Figure(figsize=(12.5, 12.0), layout="constrained")
    grid = figure.add_gridspec(3, 4)
    preset = study.biases[0]["preset"]
    offsets = [line for line in study.biases if line["sweep"].startswith("offset") and line["preset"] == preset]
    first = offsets[0]["sweep"]
    for position, name in enumerate(("pitch", "heading")):
        lines = [line for line in offsets if line["value"] == name and line["sweep"] == first]
        axes = figure.add_subplot(grid[0, 2 * position : 2 * position + 2])
        _bars(axes, {line["phase"]: [line[channel] for channel in CHANNELS] for line in lines}, list(CHANNELS))
        # A scale that would blow rounding up to a signal says nothing.
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -LEAST_SHIFT), max(high, LEAST_SHIFT))
        _dress(axes, "", "shift, N or N m a degree")
        axes.set_title(f"{name} {first} degree, preset {preset}", loc="left", fontsize=SMALL + 1)
    singles = [
        line for line in study.biases
        if line["sweep"] in ("one coefficient", "coefficients") and line["phase"] == "dive" and line["preset"] == preset
    ]  # fmt: skip
    axes = figure.add_subplot(grid[1, :])
    shown = ("B_cu", "B_cw", "B_cq", "B_cr")
    _bars(
        axes,
        {name: [line[f"{name}_rms"] for line in singles] for name in shown},
        [str(line["value"]) for line in singles],
    )
    _dress(axes, "", "shift on the dive, RMS, N or N m")
    axes.set_title(
        f"coefficients 15 % too large one by one, and all within 15 %, preset {preset}", loc="left", fontsize=SMALL + 1
    )
    for position, sweep in enumerate(("step", "sample interval", "dropout", "gap")):
        axes = figure.add_subplot(grid[2, position])
        _over_sweep(axes, study, sweep)
    figure.savefig(path, dpi=DPI)


_BASE_VALUES = {"step": 0.1, "sample interval": 1.0, "dropout": 0.0, "gap": 0.0}
_SWEEP_LABELS = {
    "step": "step, s",
    "sample interval": "sample interval, s",
    "dropout": "share lost",
    "gap": "gap, s (one in 300 s)",
}


def _over_sweep(axes: Axes, study: SensitivityStudy, sweep: str) -> None:
    for preset in dict.fromkeys(line["preset"] for line in study.summary):
        lines = [line for line in study.summary if line["preset"] == preset and line["sweep"] == sweep]
        base = [line for line in study.summary if line["preset"] == preset and line["sweep"] == "usual"]
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
    _dress(axes, _SWEEP_LABELS[sweep], "error")


def _bars(axes: Axes, groups: dict[str, list[float]], names: Sequence[str]) -> None:
    width = 0.8 / len(groups)
    for index, (label, values) in enumerate(groups.items()):
        axes.bar(np.arange(len(names)) + (index - 0.5 * (len(groups) - 1)) * width, values, width, label=label,
                 color=COLOURS[index])  # fmt: skip
    axes.axhline(0.0, color=TRUTH, lw=0.5)
    axes.set_xticks(np.arange(len(names)), names, rotation=30 if len(names) > 8 else 0)
    axes.legend(fontsize=SMALL, frameon=False)


def write_recoverability_figure(study: RecoverabilityStudy, path: Path) -> None:
    """Draw detection, height and timing of impulses, axial offsets, and the current's errors under the budget."""
    figure = Figure(figsize=(12.5, 11.0), layout="constrained")
    grid = figure.add_gridspec(3, 2)
    for column, preset in enumerate(study.noise):
        lines = [line for line in study.detection if line["preset"] == preset]
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
        rate.axvline(study.noise[preset]["threshold"], color="#999999", lw=0.7, zorder=0)
        for axes in (rate, gain):
            axes.set_xscale("log")
        gain.axhline(1.0, color="#999999", lw=0.7, zorder=0)
        gain.set_ylim(0.0, 2.0)
        rate.set_title(f"preset {preset}; grey: threshold", loc="left", fontsize=SMALL + 1)
        rate.legend(fontsize=SMALL - 1, frameon=False, title="width", title_fontsize=SMALL - 1)
        _dress(rate, "amplitude, N m", "detection rate")
        _dress(gain, "amplitude, N m", "identified over true height")
    _offset_histogram(figure.add_subplot(grid[2, 0]), study)
    _current_errors(figure.add_subplot(grid[2, 1]), study)
    figure.savefig(path, dpi=DPI)


def _offset_histogram(axes: Axes, study: RecoverabilityStudy) -> None:
    preset = study.errors[0]["preset"]
    rows_of = {
        model: [row for row in study.motions if row["preset"] == preset and row["model"] == model] for model in MODELS
    }
    offsets_of = {
        model: [row[name] for row in rows for name in ("axial_dive", "axial_climb")] for model, rows in rows_of.items()
    }
    every = np.concatenate([np.array(values) for values in offsets_of.values()])
    bins = np.histogram_bin_edges(every, bins=30).tolist()
    for index, (model, offsets) in enumerate(offsets_of.items()):
        axes.hist(offsets, bins=bins, color=COLOURS[index], alpha=0.6, label=f"coefficients {model}")
    axes.legend(fontsize=SMALL, frameon=False)
    _dress(axes, "axial offset, dive and climb, N", f"dives (preset {preset})")


def _current_errors(axes: Axes, study: RecoverabilityStudy) -> None:
    """Errors of the depth-averaged current along and across the track."""
    preset = study.errors[0]["preset"]
    for index, model in enumerate(MODELS):
        rows = [row for row in study.motions if row["preset"] == preset and row["model"] == model]
        track = np.array([(row["track_north"], row["track_east"]) for row in rows])
        wrong = np.array([(row["error_north"], row["error_east"]) for row in rows])
        unit = track / np.linalg.norm(track, axis=1)[:, None]
        along = (wrong * unit).sum(axis=1)
        across = wrong[:, 1] * unit[:, 0] - wrong[:, 0] * unit[:, 1]
        axes.plot(along, across, "o", ms=4, color=COLOURS[index], alpha=0.7, label=f"coefficients {model}")
    axes.set_aspect("equal", "datalim")
    axes.legend(fontsize=SMALL, frameon=False)
    _dress(axes, "error of the current along the track, m/s", "across, m/s")


def _dress(axes: Axes, x: str, y: str) -> None:
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.tick_params(which="minor", labelsize=SMALL - 2)
    axes.spines[["top", "right"]].set_visible(False)
