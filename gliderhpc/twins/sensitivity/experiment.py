"""``twin sensitivity``: effect of noise, offsets, wrong coefficients, steps and gaps on the estimates (section 5.1.1).

Every disturbed run has a twin without that one error: the same dive with the same noise. Biases are differences between
the two, in which the estimator's own error and the truth cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.results import Findings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.twins.cases import (
    COEFFICIENT_ERROR,
    PRESETS,
    QUIET,
    UNCERTAIN_COEFFICIENTS,
    RecordChanges,
    TwinCase,
    course_of,
    noiseless,
    with_coefficient_errors,
    with_factors,
    with_sample_interval,
    world,
)
from gliderhpc.twins.scoring import LONGITUDINAL_AND_YAW, Row
from gliderhpc.twins.sensitivity.figure import SWEEP_LABELS, draw_sensitivity
from gliderhpc.twins.study import (
    TwinPlan,
    TwinRun,
    TwinSize,
    TwinStudy,
    finite,
    groups,
    labelled,
    select,
    tidy_table,
    twin_findings,
)
from gliderhpc.vocabulary import CHANNELS, PHASES

OFFSETS = ("pitch", "heading", "roll")
STEPS = (0.05, 0.2, 0.25)
INTERVALS = (2.0, 4.0, 5.0, 10.0, 20.0)
DROPOUTS = (0.05, 0.2, 0.5)
GAPS = (5.0, 10.0, 30.0, 60.0)
INITIAL_ERRORS = {"u": (6, 0.1), "v": (7, 0.05), "w": (8, 0.05), "q": (10, 0.02), "r": (11, 0.02)}
"""Index in the state (eq. 16) and error, m/s or rad/s."""

BASE = "base"
ALL_COEFFICIENTS = f"within {COEFFICIENT_ERROR:.0%}"
"""Label of the draws of all coefficients together."""

SCORES = (
    *(f"rmse_{name}" for name in CHANNELS), "correlation_B_cr", "noise_B_cr", "peak_B_cr", "tracking_roll",
    "tracking_pitch", "tracking_heading", "tracking_depth", "velocity_along", "velocity_error", "surge_rmse",
    "iterations", "capped",
)  # fmt: skip
"""Scores that are summarised over the twins."""

_COEFFICIENT_STREAM = 2_000
_BIASES = [f"bias_{phase}_{name}" for phase in PHASES for name in CHANNELS]
_COMPARED_WITH_BASE = ("coefficients", "one coefficient", "initial state", "step", "sample interval")

Variant = tuple[str, Any, Scenario, dict[str, Any]]
"""Sweep, value, scenario, and further fields of the case."""


@dataclass(frozen=True, kw_only=True)
class SensitivitySize(TwinSize):
    """Size of the study.

    Attributes
    ----------
    depth, noise_depth : float
        Depths of the twins, and of those without any disturbance, m.
    draws : int
        Number of draws of all coefficients per twin.
    presets, pitches, single_coefficients : tuple
        Presets, pitches of the twins with offsets (degree), coefficients that are also varied one at a time.
    """

    depth: float
    noise_depth: float
    draws: int
    presets: tuple[str, ...]
    pitches: tuple[float, ...]
    single_coefficients: tuple[str, ...]


def sensitivity_runs(plan: TwinPlan[SensitivitySize]) -> list[TwinRun]:
    """List every run, those of one twin together."""
    (platform,), size = plan.platforms, plan.size
    return [
        _run(platform, seed, preset, variant)
        for seed in plan.seeds
        for preset in size.presets
        for variant in (
            *_noise_variants(size),
            *_offset_variants(size),
            *_record_variants(platform, size),
            *_coefficient_variants(platform, size, seed),
        )
    ]


def _run(platform: Platform, seed: int, preset: str, variant: Variant) -> TwinRun:
    sweep, value, scenario, fields = variant
    settings = EstimationSettings.model_validate({"preset": preset} | fields.get("settings", {}))
    case = TwinCase(
        **{
            "hull": platform,
            "scenario": scenario,
            "seed": seed,
            "number": course_of(seed),
            **fields,
            "settings": settings,
        }
    )
    return labelled(case, hull=platform.name, preset=preset, sweep=sweep, value=value)


def _noise_variants(size: SensitivitySize) -> list[Variant]:
    quiet = world(size.noise_depth, disturbances=QUIET)
    return [("quiet", "noise", quiet, {}), ("quiet", "perfect sensors", noiseless(quiet), {})]


def _offset_variants(size: SensitivitySize) -> list[Variant]:
    variants: list[Variant] = []
    for pitch in size.pitches:
        sweep, scenario = f"offset at {pitch:g}", world(size.depth, pitch=pitch)
        variants.append((sweep, BASE, scenario, {}))
        variants += [
            (sweep, f"{name} {sign:+g}", scenario, {"changes": RecordChanges(**{f"{name}_offset": sign})})
            for name in OFFSETS
            for sign in (1.0, -1.0)
        ]
    return variants


def _record_variants(platform: Platform, size: SensitivitySize) -> list[Variant]:
    """Steps, sample intervals, dropouts, gaps and errors of the first guess, on the usual twin."""
    scenario = world(size.depth)
    fields: list[tuple[str, Any, dict[str, Any]]] = [
        ("usual", BASE, {}),
        *(("step", step, {"settings": {"step": step}}) for step in STEPS),
        *(
            (
                "sample interval",
                interval,
                {
                    "changes": RecordChanges(sample_interval=interval),
                    "assumed": with_sample_interval(platform, interval),
                },
            )
            for interval in INTERVALS
        ),
        *(("dropout", share, {"changes": RecordChanges(dropout=share)}) for share in DROPOUTS),
        *(("gap", gap, {"changes": RecordChanges(gap=gap)}) for gap in GAPS),
        *(
            ("initial state", name, {"initial_error": tuple(error if i == index else 0.0 for i in range(12))})
            for name, (index, error) in INITIAL_ERRORS.items()
        ),
    ]
    return [(sweep, value, scenario, others) for sweep, value, others in fields]


def _coefficient_variants(platform: Platform, size: SensitivitySize, seed: int) -> list[Variant]:
    scenario = world(size.depth)
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    return [
        *(
            ("coefficients", f"draw {draw + 1}", scenario, {"assumed": with_coefficient_errors(platform, rng)})
            for draw in range(size.draws)
        ),
        *(
            ("one coefficient", name, scenario, {"assumed": with_factors(platform, {name: 1.0 + COEFFICIENT_ERROR})})
            for name in size.single_coefficients
        ),
    ]


def sensitivity_table(rows: Sequence[Row]) -> pd.DataFrame:
    """Rows as a table whose ``value`` is a number in some sweeps and a name in others."""
    return tidy_table(rows).astype({"value": "object"})


def summarise(table: pd.DataFrame) -> list[Row]:
    """Median and largest size of every score over the twins, one line per setting, in the order of the runs."""
    drawn = table["sweep"] == "coefficients"
    lines = []
    for labels, group in groups(
        table.assign(value=table["value"].mask(drawn, ALL_COEFFICIENTS)), ("preset", "sweep", "value")
    ):
        line = labels | {"runs": len(group), "refused": int(group["refused"].notna().sum())}
        for name in SCORES:
            values = finite(group, name)
            line[name] = float(np.median(values)) if values.size else float("nan")
            line[f"{name}_most"] = float(np.abs(values).max()) if values.size else float("nan")
        lines.append(line)
    return lines


def bias_shifts(table: pd.DataFrame) -> list[Row]:
    """Mean shift of every channel due to every error, for dive and climb: N and N m, for the offsets per degree.

    Noise: difference from perfect sensors on the quiet twin. Offsets: half the difference between plus and minus one
    degree. All others: difference from the usual twin. One line per error, phase and preset: median over the twins, and
    largest size.
    """
    return [
        {"preset": preset, "sweep": sweep, "value": value, "phase": phase, **_statistics(shift, phase)}
        for preset in table["preset"].unique()
        for sweep, value, shift in _shifts(table[table["preset"] == preset])
        for phase in PHASES
    ]


def _shifts(table: pd.DataFrame) -> list[tuple[str, Any, pd.DataFrame]]:
    """Shifts of each seed's mean errors due to every error, for one preset."""
    shifts: list[tuple[str, Any, pd.DataFrame]] = []
    for sweep in table["sweep"].unique():
        group = table[table["sweep"] == sweep]
        if sweep == "quiet":
            shifts.append((sweep, "noise", _biases(group, "noise") - _biases(group, "perfect sensors")))
        elif sweep.startswith("offset"):
            shifts += [
                (sweep, name, 0.5 * (_biases(group, f"{name} +1") - _biases(group, f"{name} -1"))) for name in OFFSETS
            ]
        elif sweep in _COMPARED_WITH_BASE:
            base = _biases(table[table["sweep"] == "usual"], BASE)
            of_value = {value: _biases(group, value) - base for value in group["value"].unique()}
            if sweep == "coefficients":
                of_value = {ALL_COEFFICIENTS: pd.concat(of_value.values())}
            shifts += [(sweep, value, shift) for value, shift in of_value.items()]
    return shifts


def _biases(table: pd.DataFrame, value: Any) -> pd.DataFrame:
    """Mean errors of dive and climb, one row per seed."""
    chosen = table[table["value"] == value].set_index("seed")
    return pd.DataFrame(chosen[[*_BIASES, "velocity_along", "velocity_across"]].astype(np.float64))


def _statistics(shift: pd.DataFrame, phase: str) -> Row:
    line: Row = {}
    for name in CHANNELS:
        values = shift[f"bias_{phase}_{name}"].dropna()
        line[name] = float(values.median())
        line[f"{name}_most"] = float(values.abs().max())
        line[f"{name}_rms"] = float(np.sqrt((values**2).mean()))
    for name in ("velocity_along", "velocity_across"):
        line[f"{name}_rms"] = float(np.sqrt((shift[name] ** 2).mean()))
    return line


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


_PAPER_OFFSETS = {("pitch", "B_cu"): 0.43, ("pitch", "B_cq"): 0.11, ("heading", "B_cr"): 0.003}
_COMPARED_OFFSETS = (("pitch", ("B_cu", "B_cw", "B_cq", "B_cr")), ("heading", ("B_cu", "B_cw", "B_cr")))

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
    figure = draw_sensitivity(summary, biases)
    return twin_findings(NAME, plan, comparisons, rows=rows, figure=figure, facts=facts)


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
            "noise: largest yaw moment of a dive", "N m", noise["peak_B_cr"], 0.24, paper_text="<= 0.24",
            remark="high-passed; median over the twins",
        ),
        Comparison(
            "noise: largest yaw moment of all dives", "N m", noise["peak_B_cr_most"], 0.24, paper_text="<= 0.24",
            remark=f"high-passed; perfect sensors {perfect['peak_B_cr_most']:.3f}",
        ),
        *(
            Comparison(
                f"noise: RMSE of {name}", unit, noise[f"rmse_{name}"], remark=f"perfect {perfect[f'rmse_{name}']:.2g}"
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
                f"coefficients {ALL_COEFFICIENTS}: {name}, {phase}",
                CHANNELS[name][0],
                line[f"{name}_rms"],
                remark=f"RMS; maximum {line[f'{name}_most']:.2f}",
            )
            for phase, line in lines.items()
            for name in LONGITUDINAL_AND_YAW
        ),
        Comparison(
            f"coefficients {ALL_COEFFICIENTS}: velocity along track",
            "m/s",
            lines["dive"]["velocity_along_rms"],
            (0.05, 0.06),
            remark="RMS of the shift; the paper's value includes all errors",
        ),
    ]


def _record_comparisons(scores: Summary) -> list[Comparison]:
    rows = [Comparison("usual twin: yaw RMSE", "N m", scores["usual", BASE]["rmse_B_cr"])]
    for (sweep, value), line in scores.items():
        if sweep in (*SWEEP_LABELS, "initial state"):
            label = f"{value:g}" if isinstance(value, float) else str(value)
            remark = (
                f"surge {line['rmse_B_cu']:.3f} N, velocity {line['velocity_error']:.4f} m/s, refused {line['refused']}"
            )
            rows.append(Comparison(f"{sweep} {label}: yaw RMSE", "N m", line["rmse_B_cr"], remark=remark))
    return rows
