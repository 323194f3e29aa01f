"""``twin sensitivity``: effect of noise, offsets, wrong coefficients, steps and gaps on the estimates (section 5.1.1).

Every disturbed run has a twin without that one error: the same dive with the same noise. Biases are differences of the
two, so that neither the estimator's own error nor the truth enters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import SMALL, TRUTH
from gliderhpc.findings.findings import Findings
from gliderhpc.twins.cases import PRESETS, UNCERTAIN_COEFFICIENTS
from gliderhpc.twins.scoring import PHASES, Row
from gliderhpc.twins.sensitivity.runs import (
    ALL_COEFFICIENTS,
    BASE,
    SensitivitySize,
    bias_shifts,
    sensitivity_runs,
    sensitivity_table,
    summarise,
)
from gliderhpc.twins.study import COLOURS, TwinPlan, TwinStudy, label_axes, new_sheet, select, twin_findings
from gliderhpc.vocabulary import CHANNELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "sensitivity"
PITCHES = (23.0, 35.0)
"""Pitches of the twins with offsets, degree: the usual glide and a steep one."""

FULL = SensitivitySize(
    depth=120.0,
    noise_depth=300.0,
    seeds=10,
    draws=4,
    presets=PRESETS,
    pitches=PITCHES,
    single_coefficients=UNCERTAIN_COEFFICIENTS,
)
QUICK = SensitivitySize(
    depth=40.0,
    noise_depth=60.0,
    seeds=2,
    draws=2,
    presets=PRESETS,
    pitches=PITCHES[:1],
    single_coefficients=("K_D0", "K_L"),
)

LINE_STYLES = {"recommended": "-", "paper": "--"}
MIN_SHIFT = 0.02
"""N or N m a degree: half the smallest range of the axis of the offsets."""

_PAPER_OFFSETS = {("pitch", "B_cu"): 0.43, ("pitch", "B_cq"): 0.11, ("heading", "B_cr"): 0.003}
_COMPARED_OFFSETS = (("pitch", ("B_cu", "B_cw", "B_cq", "B_cr")), ("heading", ("B_cu", "B_cw", "B_cr")))
_LONGITUDINAL_AND_YAW = ("B_cu", "B_cw", "B_cq", "B_cr")
_BASE_VALUES = {"step": 0.1, "sample interval": 1.0, "dropout": 0.0, "gap": 0.0}
_SWEEP_LABELS = {
    "step": "step, s",
    "sample interval": "sample interval, s",
    "dropout": "share lost",
    "gap": "gap, s (one in 300 s)",
}
_SWEEP_SCORES = (("rmse_B_cr", "yaw, N m"), ("rmse_B_cu", "surge, N"), ("velocity_error", "velocity, m/s"))

Shifts = dict[tuple[str, Any, str], Row]
Summary = dict[tuple[str, Any], Row]


def conclude(plan: TwinPlan[SensitivitySize], rows: list[Row]) -> Findings:
    """Make findings, with one table of comparisons per preset."""
    table = sensitivity_table(rows)
    summary, biases = summarise(table), bias_shifts(table)
    (platform,) = plan.platforms
    comparisons = {
        f"{platform.name}, {preset}": compare_sensitivity(summary, biases, preset) for preset in plan.size.presets
    }
    facts = {"summary": summary, "biases": biases}
    return twin_findings(NAME, plan, comparisons, rows, draw_sensitivity(summary, biases), facts)


STUDY = TwinStudy(NAME, FULL, QUICK, sensitivity_runs, conclude)
"""The study that the program runs."""


def compare_sensitivity(summary: Sequence[Row], biases: Sequence[Row], preset: str) -> list[Comparison]:
    """Compare the paper's figures of section 5.1.1 with ours, for one preset."""
    scores = {(line["sweep"], line["value"]): line for line in select(summary, preset=preset)}
    shifts = {(line["sweep"], line["value"], line["phase"]): line for line in select(biases, preset=preset)}
    return [
        *_noise_comparisons(scores, shifts["quiet", "noise", "dive"]),
        *_offset_comparisons(shifts),
        *_coefficient_comparisons(shifts),
        *_record_comparisons(scores),
    ]


def _noise_comparisons(scores: Summary, shift: Row) -> list[Comparison]:
    noise, perfect = scores["quiet", "noise"], scores["quiet", "perfect sensors"]
    return [
        Comparison(
            "noise: largest yaw moment of a dive", "N m", noise["peak_B_cr"], 0.24, paper_said="<= 0.24",
            remark="high-passed; median over the twins",
        ),
        Comparison(
            "noise: largest yaw moment of all dives", "N m", noise["peak_B_cr_most"], 0.24, paper_said="<= 0.24",
            remark=f"high-passed; perfect sensors {perfect['peak_B_cr_most']:.3f}",
        ),
        *(
            Comparison(
                f"noise: {name} left, RMS", unit, noise[f"rmse_{name}"], remark=f"perfect {perfect[f'rmse_{name}']:.2g}"
            )
            for name, (unit, _) in CHANNELS.items()
        ),
        Comparison(
            "noise: mean velocity through the water", "m/s",
            float(np.hypot(shift["velocity_along_rms"], shift["velocity_across_rms"])), 2e-4,
            remark=f"RMS difference from perfect sensors, whose own error is {perfect['velocity_error']:.1e}",
        ),
    ]  # fmt: skip


def _offset_comparisons(shifts: Shifts) -> list[Comparison]:
    return [
        Comparison(
            f"{name} {sweep} degree: {channel}, {phase}",
            f"{CHANNELS[channel][0]}/degree",
            shifts[sweep, name, phase][channel],
            _PAPER_OFFSETS.get((name, channel)) if phase == "dive" else None,
        )
        for sweep in dict.fromkeys(key[0] for key in shifts if key[0].startswith("offset"))
        for name, channels in _COMPARED_OFFSETS
        for channel in channels
        for phase in PHASES
    ]


def _coefficient_comparisons(shifts: Shifts) -> list[Comparison]:
    lines = {phase: shifts["coefficients", ALL_COEFFICIENTS, phase] for phase in PHASES}
    return [
        *(
            Comparison(
                f"coefficients {ALL_COEFFICIENTS}: {name}, {phase}", CHANNELS[name][0], line[f"{name}_rms"],
                remark=f"RMS; most {line[f'{name}_most']:.2f}",
            )
            for phase, line in lines.items()
            for name in _LONGITUDINAL_AND_YAW
        ),
        Comparison(
            f"coefficients {ALL_COEFFICIENTS}: velocity along track", "m/s", lines["dive"]["velocity_along_rms"],
            (0.05, 0.06), remark="RMS of the shift; the paper's is that of everything",
        ),
    ]  # fmt: skip


def _record_comparisons(scores: Summary) -> list[Comparison]:
    rows = [Comparison("usual twin: yaw RMSE", "N m", scores["usual", BASE]["rmse_B_cr"])]
    for (sweep, value), line in scores.items():
        if sweep in (*_SWEEP_LABELS, "initial state"):
            label = f"{value:g}" if isinstance(value, float) else str(value)
            remark = (
                f"surge {line['rmse_B_cu']:.3f} N, velocity {line['velocity_error']:.4f} m/s, refused {line['refused']}"
            )
            rows.append(Comparison(f"{sweep} {label}: yaw RMSE", "N m", line["rmse_B_cr"], remark=remark))
    return rows


def draw_sensitivity(summary: Sequence[Row], biases: Sequence[Row]) -> Figure:
    """Draw the effects of offsets, coefficients, step, sample interval, dropouts and gaps."""
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
        label_axes(axes, "", "shift, N or N m a degree", f"{name} {sweep} degree, preset {preset}")
    _draw_coefficients(figure.add_subplot(grid[1, :]), select(biases, phase="dive"), preset)
    for position, name in enumerate(_SWEEP_LABELS):
        _draw_sweep(figure.add_subplot(grid[2, position]), summary, name)
    return figure


def _draw_coefficients(axes: Axes, biases: Sequence[Row], preset: str) -> None:
    lines = [line for line in biases if line["sweep"] in ("one coefficient", "coefficients")]
    shifts = {name: [line[f"{name}_rms"] for line in lines] for name in _LONGITUDINAL_AND_YAW}
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
            axes.plot(x, [line[score] for line in lines], LINE_STYLES.get(preset, "-"), marker="o", ms=3, lw=1.1,
                      color=colour, label=f"{label} ({preset})")  # fmt: skip
    axes.set_yscale("log")
    if sweep == "step":
        axes.legend(fontsize=SMALL - 1.5, frameon=False)
    label_axes(axes, _SWEEP_LABELS[sweep], "error")


def _draw_bars(axes: Axes, bars: dict[str, list[float]], names: Sequence[str]) -> None:
    width = 0.8 / len(bars)
    for index, (label, values) in enumerate(bars.items()):
        at = np.arange(len(names)) + (index - 0.5 * (len(bars) - 1)) * width
        axes.bar(at, values, width, label=label, color=COLOURS[index])
    axes.axhline(0.0, color=TRUTH, lw=0.5)
    axes.set_xticks(np.arange(len(names)), names, rotation=30 if len(names) > 8 else 0)
    axes.legend(fontsize=SMALL, frameon=False)
