"""Runs of ``twin sensitivity``, each error with the same twin without it, and the shifts that every error causes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.twins.cases import (
    COEFFICIENT_ERROR,
    QUIET,
    RecordChanges,
    TwinCase,
    course_of,
    noiseless,
    with_coefficient_errors,
    with_factors,
    with_sample_interval,
    world,
)
from gliderhpc.twins.scoring import PHASES, Row
from gliderhpc.twins.study import TwinPlan, TwinRun, TwinSize, finite, groups, labelled, tidy_table
from gliderhpc.vocabulary import CHANNELS

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
        Draws of all coefficients per twin.
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
        _run(platform, seed, preset, *variant)
        for seed in plan.seeds
        for preset in size.presets
        for variant in (
            *_noise_variants(size),
            *_offset_variants(size),
            *_record_variants(platform, size),
            *_coefficient_variants(platform, size, seed),
        )
    ]


def _run(
    platform: Platform, seed: int, preset: str, sweep: str, value: Any, scenario: Scenario, fields: dict[str, Any]
) -> TwinRun:
    settings = EstimationSettings.model_validate({"preset": preset} | fields.get("settings", {}))
    case = TwinCase(**{"hull": platform, "scenario": scenario, "seed": seed, "number": course_of(seed), **fields,
                       "settings": settings})  # fmt: skip
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
    """Mean shift of every channel by every error, dive and climb apart: N and N m, for the offsets per degree.

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
    """Shifts of the mean errors per seed that every error causes, of one preset."""
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
    """Mean errors of dive and climb, a row per seed."""
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
