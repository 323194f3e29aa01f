"""Figures of ``twin windows``, ``sensitivity`` and ``recoverability``, from lines of their tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gliderhpc.findings.drawing import SMALL, TRUTH, new_figure
from gliderhpc.twins.cases import OPERATING_LENGTH, PRESETS
from gliderhpc.twins.scoring import LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.study import select
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

DPI = 130
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY = "#999999"


def new_sheet(width: float, height: float) -> Figure:
    """Empty figure of a size in inches."""
    return new_figure((width, height), DPI)


def label_axes(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Label a panel's axes, add a title if one is given, and remove the frame on two sides."""
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.tick_params(which="minor", labelsize=SMALL - 2)
    axes.spines[["top", "right"]].set_visible(False)
    if title:
        axes.set_title(title, loc="left", fontsize=SMALL + 1, parse_math=False)


def along_and_across(error: Array, track: Array) -> tuple[Array, Array]:
    """Components ``(n,)`` of errors ``(n, 2)`` along and to starboard of tracks ``(n, 2)``, north and east."""
    unit = track / np.linalg.norm(track, axis=1)[:, None]
    return (error * unit).sum(axis=1), error[:, 1] * unit[:, 0] - error[:, 0] * unit[:, 1]


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
        axes.axvline(boundary, color=GREY, lw=0.5, zorder=0)
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
    axes.axvline(OPERATING_LENGTH, color=GREY, lw=0.6, zorder=0)
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
        rate.axvline(noise[preset]["threshold"], color=GREY, lw=0.7, zorder=0)
        for axes in (rate, gain):
            axes.set_xscale("log")
        gain.axhline(1.0, color=GREY, lw=0.7, zorder=0)
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
