"""``twin recoverability``: detectable disturbances, and the error of the unobserved part of the motion.

Detection, height and timing of yaw impulses of known amplitude and width; the floor in multiples of the identification
noise; the axial offset and the velocity error of the under-determined self-motion, with exact coefficients and with
every one wrong by up to 15 %; and from these the budget of the current's uncertainty for the platform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gliderhpc.errors import InputError
from gliderhpc.estimation.current_budget import MIN_TWINS, Budget, budget_text
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.drawing import SMALL
from gliderhpc.findings.findings import Findings
from gliderhpc.platform import Platform
from gliderhpc.twins.cases import PRESETS
from gliderhpc.twins.recoverability.runs import (
    FALSE_ALARMS,
    FLOOR_RATE,
    MODELS,
    RecoverabilitySize,
    detection_table,
    error_line,
    floor_table,
    identification_noise,
    recoverability_rows,
    recoverability_runs,
)
from gliderhpc.twins.scoring import Row
from gliderhpc.twins.study import (
    COLOURS,
    GREY,
    TwinPlan,
    TwinStudy,
    along_and_across,
    first,
    label_axes,
    new_sheet,
    select,
    twin_findings,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAME = "recoverability"
BUDGET = "budget.yaml"
BUDGET_PRESET = "recommended"
"""Preset of the budget."""

TYPICAL_WIDTH = 1.2
"""Width of the budget's floor, s: the shortest of the usual scenario."""

FULL = RecoverabilitySize(
    impulse_depth=80.0,
    quiet_depth=200.0,
    motion_depth=200.0,
    amplitudes=(0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 3.0),
    widths=(0.3, 0.6, 1.2, 2.0, 3.0, 5.0),
    impulse_seeds=8,
    quiet_seeds=10,
    seeds=30,
)

QUICK = RecoverabilitySize(
    impulse_depth=40.0,
    quiet_depth=40.0,
    motion_depth=40.0,
    amplitudes=(0.1, 0.3, 1.0),
    widths=(0.6, 1.2, 2.0),
    impulse_seeds=1,
    quiet_seeds=3,
    seeds=4,
)


def conclude(plan: TwinPlan[RecoverabilitySize], rows: list[Row]) -> Findings:
    """Make findings, with one table of comparisons per preset, and the budget.

    Raises
    ------
    InputError
        Too few twins for a budget, or no impulse of the grid was detected nine times in ten.
    """
    (platform,) = plan.platforms
    noise = {preset: identification_noise(rows, preset) for preset in PRESETS}
    impulses, motions = select(rows, kind="impulse"), select(rows, kind="motion")
    detection = detection_table(impulses, noise)
    floors = floor_table(detection, noise)
    errors = [error_line(motions, preset, model) for preset in PRESETS for model in MODELS]
    budget = make_budget(platform, noise, floors, errors, len(plan.seeds))
    return twin_findings(
        NAME,
        plan,
        {
            f"{platform.name}, {preset}": compare_recoverability(noise[preset], floors, errors, preset)
            for preset in PRESETS
        },
        [*impulses, *motions],
        draw_recoverability(noise, detection, motions),
        {
            "noise": noise,
            "detection": detection,
            "floors": floors,
            "errors": errors,
            "budget": budget.model_dump(),
        },
        {BUDGET: budget_text(budget)},
    )


STUDY = TwinStudy(NAME, FULL, QUICK, recoverability_runs, conclude, job=recoverability_rows, min_seeds=MIN_TWINS)
"""The study that the program runs."""


def make_budget(
    platform: Platform, noise: Mapping[str, Row], floors: Sequence[Row], errors: Sequence[Row], twins: int
) -> Budget:
    """Collect the figures of preset `BUDGET_PRESET`.

    Raises
    ------
    InputError
        No amplitude of the grid was detected nine times in ten.
    """
    exact, wrong = (first(errors, preset=BUDGET_PRESET, model=model) for model in MODELS)
    typical = min(select(floors, preset=BUDGET_PRESET), key=lambda row: abs(float(row["width"]) - TYPICAL_WIDTH))
    if not np.isfinite(typical["floor"]):
        raise InputError(f"{platform.name}: no yaw impulse of the grid is found nine times in ten")
    level = noise[BUDGET_PRESET]["noise"]
    fit = f"maximum likelihood of the covariance over {twins} twins, every coefficient wrong by up to 15 %"
    return Budget(
        platform=platform.name,
        axial_error=wrong["axial_error"],
        relative_error=wrong["relative_error"],
        heading_error=wrong["heading_error"],
        identification_noise=level,
        detection_floor=typical["floor"],
        axial_offset_dive=wrong["axial_dive"],
        axial_offset_climb=wrong["axial_climb"],
        axial_offset_rms=wrong["axial_rms"],
        exact_axial_error=exact["axial_error"],
        how={
            "axial_error": f"m/s; {fit}; compass and pitch sensor without offset",
            "relative_error": f"of the current's speed; {fit}",
            "heading_error": f"degree; {fit}",
            "identification_noise": (
                f"N m; RMS of the yaw moment above 0.05 Hz with sensor noise and no disturbance, preset {BUDGET_PRESET}"
            ),
            "detection_floor": (
                f"N m; amplitude of an impulse of {typical['width']:g} s (standard deviation) found in "
                f"{FLOOR_RATE:.0%} of all cases, at a threshold that noise alone passes {FALSE_ALARMS:g} time an hour"
            ),
            "axial_offset": "N; mean of identified minus true B_cu over steady glide, dive and climb apart",
            "exact_axial_error": "m/s; as axial_error, with the true coefficients",
        },
    )


def compare_recoverability(noise: Row, floors: Sequence[Row], errors: Sequence[Row], preset: str) -> list[Comparison]:
    """Compare the paper's figures of sections 5.1.1, 5.3 and 5.5 with ours, for one preset."""
    exact, wrong = (first(errors, preset=preset, model=model) for model in MODELS)
    floors = select(floors, preset=preset)
    return [
        Comparison("identification noise, RMS", "N m", noise["noise"], (0.4, 0.7),
                   remark="the paper's own Table 3 has at most 0.24 as the largest"),
        Comparison("identification noise, largest", "N m", noise["largest"], 0.24, paper_said="<= 0.24"),
        Comparison("threshold: one false alarm an hour", "N m", noise["threshold"],
                   remark=f"{noise['threshold_multiples']:.1f} times the noise; {noise['hours']:.1f} h of noise alone"),
        *(
            Comparison(f"floor, impulse of {row['width']:g} s", "N m", row["floor"], remark="found nine times in ten")
            for row in floors
        ),
        *(
            Comparison(f"floor over noise, impulse of {row['width']:g} s", "1", row["multiples"], (25.0, 40.0))
            for row in floors
        ),
        Comparison("axial offset, exact coefficients", "N", 0.5 * (exact["axial_dive"] + exact["axial_climb"]), -0.5,
                   (exact["axial_least"], exact["axial_most"]), remark="spread: least and most of dive or climb"),
        Comparison("axial offset, coefficients within 15%", "N", 0.5 * (wrong["axial_dive"] + wrong["axial_climb"]),
                   (-0.75, -0.4), (wrong["axial_least"], wrong["axial_most"]), remark="spread as above"),
        Comparison("velocity error, exact coefficients", "m/s", exact["velocity_error"], (0.05, 0.06)),
        Comparison("velocity error, coefficients within 15%", "m/s", wrong["velocity_error"]),
        Comparison("budget: axial error", "m/s", wrong["axial_error"], (0.05, 0.06), remark="coefficients within 15%"),
        Comparison("budget: relative error", "1", wrong["relative_error"], 0.26, remark="coefficients within 15%"),
        Comparison("budget: heading error", "degree", wrong["heading_error"], 8.0, remark="coefficients within 15%"),
        Comparison("median squared distance under the budget", "1", wrong["median_distance"],
                   remark="1.39 if the ellipses fit"),
    ]  # fmt: skip


def draw_recoverability(noise: Mapping[str, Row], detection: Sequence[Row], motions: Sequence[Row]) -> Figure:
    """Draw detection, height and timing of impulses, axial offsets, and the current's errors."""
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
    rows_of = {model: select(motions, preset=PRESETS[0], model=model) for model in MODELS}
    _draw_offsets(figure.add_subplot(grid[2, 0]), rows_of)
    _draw_current_errors(figure.add_subplot(grid[2, 1]), rows_of)
    return figure


def _draw_detection(rate: Axes, gain: Axes, detection: Sequence[Row]) -> None:
    """Detection rate and height over the amplitude, a line per width."""
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
