"""``twin recoverability``: detectable disturbances, and the error of the unobserved part of the motion.

The study measures detection, height and timing of yaw impulses of known amplitude and width, and axial offset and
velocity error of the under-determined self-motion, with exact coefficients and with errors of up to 15 % in each. From
these follows the budget of the current's uncertainty for the platform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.current_errors import MIN_TWINS, Budget, CurrentError, budget_text, fit_budget
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.results import Findings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.studies.library.scores import rms
from gliderhpc.twins.cases import PRESETS, QUIET, TwinCase, course_of, with_coefficient_errors, with_impulses, world
from gliderhpc.twins.inversion import TwinInversion, invert_twin
from gliderhpc.twins.recoverability.figure import draw_recoverability
from gliderhpc.twins.scoring import (
    Row,
    find_impulses,
    high_passed_moments,
    mean,
    motion_scores,
    quiet_peaks,
    quiet_samples,
    twin_current,
)
from gliderhpc.twins.study import TwinPlan, TwinRun, TwinSize, TwinStudy, first, groups, labelled, select, twin_findings

MODELS = ("exact", "within 15%")
"""Coefficients that the estimator assumes: the true ones, or each within 15 % of these."""

SPACING = 45.0
"""Mean time between impulses, s."""

FALSE_ALARM_BLOCK = 10.0
"""Length of the blocks in which at most one false alarm is counted, s."""

FALSE_ALARMS = 1.0
"""False alarms per hour of noise alone that define the threshold. The noise is far from normal (with bursts where the
compass quantum flips), so a multiple of its root mean square would give a dozen false alarms per hour."""

FLOOR_RATE = 0.9
"""Detection rate at the floor."""

_COEFFICIENT_STREAM = 3_000


@dataclass(frozen=True, kw_only=True)
class RecoverabilitySize(TwinSize):
    """Size of the study.

    Attributes
    ----------
    impulse_depth, quiet_depth, motion_depth : float
        Depths of the twins by kind, m.
    amplitudes, widths : tuple of float
        Amplitudes (N m) and standard deviations (s) of the impulses.
    impulse_seeds, quiet_seeds : int
        Numbers of twins per amplitude and width, and without disturbance.
    """

    impulse_depth: float
    quiet_depth: float
    motion_depth: float
    amplitudes: tuple[float, ...]
    widths: tuple[float, ...]
    impulse_seeds: int
    quiet_seeds: int


def recoverability_runs(plan: TwinPlan[RecoverabilitySize]) -> list[TwinRun]:
    """List every run."""
    (platform,), size, seeds = plan.platforms, plan.size, plan.seeds
    quiet = world(size.quiet_depth, disturbances=QUIET)
    motion = world(size.motion_depth)
    return [
        run
        for preset in PRESETS
        for run in (
            *(_run(platform, quiet, seed, preset, kind="quiet") for seed in seeds[: size.quiet_seeds]),
            *(
                _run(
                    platform, with_impulses(world(size.impulse_depth), amplitude, width, SPACING), seed, preset,
                    kind="impulse", true_amplitude=amplitude, true_width=width,
                )
                for seed in seeds[: size.impulse_seeds]
                for amplitude in size.amplitudes
                for width in size.widths
            ),
            *(
                _run(platform, motion, seed, preset, _assumed_hull(platform, model, seed), kind="motion", model=model)
                for seed in seeds
                for model in MODELS
            ),
        )
    ]  # fmt: skip


def _run(
    platform: Platform, scenario: Scenario, seed: int, preset: str, assumed: Platform | None = None, *, kind: str,
    **labels: Any,
) -> TwinRun:  # fmt: skip
    settings = EstimationSettings.model_validate({"preset": preset})
    case = TwinCase(platform, scenario, seed, settings, course_of(seed), assumed)
    return labelled(case, kind=kind, preset=preset, **labels)


def _assumed_hull(platform: Platform, model: str, seed: int) -> Platform | None:
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    return None if model == MODELS[0] else with_coefficient_errors(platform, rng)


def recoverability_rows(run: TwinRun) -> list[Row]:
    """Invert one twin and return its rows: one per impulse, or one per dive."""
    labels = {**dict(run.labels), "seed": run.case.seed}
    try:
        inversion = invert_twin(run.case)
    except ProfileError as error:
        return [labels | {"kind": "refused", "refused": str(error)}]
    if labels["kind"] == "impulse":
        return [labels | vars(finding) for finding in find_impulses(inversion)]
    return [labels | (quiet_row(inversion) if labels["kind"] == "quiet" else motion_row(inversion))]


def quiet_row(inversion: TwinInversion) -> Row:
    """High-passed yaw moment without disturbance: RMS, largest magnitude, largest per block (N m), and hours."""
    high, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    return {
        "noise": rms(high[quiet]),
        "largest": float(np.abs(high[quiet]).max()),
        "peaks": quiet_peaks(inversion, FALSE_ALARM_BLOCK).tolist(),
        "hours": float(np.count_nonzero(quiet)) * inversion.step / 3600.0,
    }


def identification_noise(rows: Sequence[Row], preset: str) -> Row:
    """RMS and largest magnitude of the high-passed yaw moment due to noise alone, and the resulting threshold."""
    quiet = select(rows, kind="quiet", preset=preset)
    if not quiet:
        why = first(rows, kind="refused", preset=preset).get("refused", "none was flown")
        raise InputError(f"recoverability: no twin without disturbance could be inverted, preset {preset}: {why}")
    level = float(np.sqrt(np.mean([row["noise"] ** 2 for row in quiet])))
    peaks = np.concatenate([row["peaks"] for row in quiet])
    threshold = float(np.quantile(peaks, 1.0 - FALSE_ALARMS * FALSE_ALARM_BLOCK / 3600.0))
    return {
        "noise": level,
        "largest": max(row["largest"] for row in quiet),
        "threshold": threshold,
        "threshold_multiples": threshold / level,
        "hours": sum(row["hours"] for row in quiet),
    }


def detection_table(findings: Sequence[Row], noise: dict[str, Row]) -> list[Row]:
    """Detection rate, amplitude error and timing, one line per preset, amplitude and width."""
    lines = []
    by = ("preset", "true_amplitude", "true_width")
    for labels, group in groups(pd.DataFrame(findings), by, sort=True):
        preset, amplitude, width = labels.values()
        detected = group[group["peak"] > noise[preset]["threshold"]]
        lines.append(
            {
                "preset": preset,
                "amplitude": amplitude,
                "width": width,
                "impulses": len(group),
                "rate": len(detected) / len(group),
                "gain": float(group["gain"].median()),
                "gain_low": float(group["gain"].quantile(0.25)),
                "gain_high": float(group["gain"].quantile(0.75)),
                "delay": float(detected["delay"].median()) if len(detected) else float("nan"),
                "delay_spread": float(detected["delay"].std()) if len(detected) > 1 else float("nan"),
                "multiples": amplitude / noise[preset]["noise"],
            }
        )
    return lines


def floor_table(detection: Sequence[Row], noise: dict[str, Row]) -> list[Row]:
    """Amplitude at which the detection rate passes `FLOOR_RATE`, one line per preset and width."""
    lines = []
    for labels, group in groups(pd.DataFrame(detection), ("preset", "width"), sort=True):
        floor = crossing(group["amplitude"].to_numpy(), group["rate"].to_numpy(), FLOOR_RATE)
        lines.append(labels | {"floor": floor, "multiples": floor / noise[labels["preset"]]["noise"]})
    return lines


def crossing(amplitudes: Any, rates: Any, level: float) -> float:
    """Smallest amplitude above which the rate is at least a level, interpolated in the logarithm; NaN if none."""
    below = np.flatnonzero(np.asarray(rates) < level)
    if below.size == 0:
        return float(amplitudes[0])
    last = int(below[-1])
    if last + 1 == len(rates):
        return float("nan")
    share = (level - rates[last]) / (rates[last + 1] - rates[last])
    return float(np.exp(np.interp(share, (0.0, 1.0), np.log(amplitudes[last : last + 2]))))


def motion_row(inversion: TwinInversion) -> Row:
    """Axial offset, velocity error and current of one dive."""
    truth = inversion.profile_truth
    error = twin_current(inversion).velocity - truth.current
    return {
        **motion_scores(inversion),
        **{f"axial_{phase}": mean(inversion.error[mask, 0]) for phase, mask in inversion.phases.items()},
        "current_north": float(truth.current[0]),
        "current_east": float(truth.current[1]),
        "error_north": float(error[0]),
        "error_east": float(error[1]),
        "track_north": float(truth.displacement[0]),
        "track_east": float(truth.displacement[1]),
        "duration": truth.duration,
    }


def error_line(motions: Sequence[Row], preset: str, model: str) -> Row:
    """Axial offset, velocity error and fitted terms of the twins of one preset and model.

    Raises
    ------
    InputError
        There are too few twins for a fit.
    """
    rows = select(motions, preset=preset, model=model)
    fitted = fit_budget([_current_error(row) for row in rows])
    frame = pd.DataFrame(rows)
    axial = frame[["axial_dive", "axial_climb"]].to_numpy(dtype=np.float64)
    error = np.hypot(frame["error_north"].to_numpy(), frame["error_east"].to_numpy())
    return {
        "preset": preset,
        "model": model,
        "twins": len(frame),
        "axial_dive": float(frame["axial_dive"].mean()),
        "axial_climb": float(frame["axial_climb"].mean()),
        "axial_rms": rms(axial),
        "axial_least": float(axial.min()),
        "axial_most": float(axial.max()),
        "along_mean": float(frame["velocity_along"].mean()),
        "along_rms": rms(frame["velocity_along"].to_numpy()),
        "across_rms": rms(frame["velocity_across"].to_numpy()),
        "velocity_error": rms(frame["velocity_error"].to_numpy()),
        "relative_speed_error": rms((frame["velocity_along"] / frame["water_speed"]).to_numpy()),
        "current_error": rms(error),
        "current_error_median": float(np.median(error)),
        **fitted.settings.model_dump(),
        "median_distance": fitted.median_distance,
    }


def _current_error(row: Row) -> CurrentError:
    current, error, track = ((row[f"{name}_north"], row[f"{name}_east"]) for name in ("current", "error", "track"))
    return CurrentError(current, error, track, row["duration"])


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
        There are too few twins for a budget, or no impulse of the grid was detected nine times in ten.
    """
    (platform,) = plan.platforms
    noise = {preset: identification_noise(rows, preset) for preset in PRESETS}
    impulses, motions = select(rows, kind="impulse"), select(rows, kind="motion")
    detection = detection_table(impulses, noise)
    floors = floor_table(detection, noise)
    errors = [error_line(motions, preset, model) for preset in PRESETS for model in MODELS]
    budget = make_budget(platform, noise, floors, errors, len(plan.seeds))
    comparisons = {
        f"{platform.name}, {preset}": compare_recoverability(noise[preset], floors, errors, preset)
        for preset in PRESETS
    }
    facts = {"noise": noise, "detection": detection, "floors": floors, "errors": errors, "budget": budget.model_dump()}
    figure = draw_recoverability(noise, detection, motions)
    documents = {BUDGET: budget_text(budget)}
    rows = [*impulses, *motions]
    return twin_findings(NAME, plan, comparisons, rows=rows, figure=figure, facts=facts, documents=documents)


STUDY = TwinStudy(NAME, FULL, QUICK, recoverability_runs, conclude, job=recoverability_rows, min_seeds=MIN_TWINS)
"""The study that the program runs."""


def make_budget(
    platform: Platform, noise: Mapping[str, Row], floors: Sequence[Row], errors: Sequence[Row], twins: int
) -> Budget:
    """Make the budget from the results of preset `BUDGET_PRESET`; without a floor where no amplitude has one."""
    exact, wrong = (first(errors, preset=BUDGET_PRESET, model=model) for model in MODELS)
    typical = min(select(floors, preset=BUDGET_PRESET), key=lambda row: abs(float(row["width"]) - TYPICAL_WIDTH))
    has_floor = bool(np.isfinite(typical["floor"]))
    level = noise[BUDGET_PRESET]["noise"]
    fit = f"maximum likelihood of the covariance over {twins} twins, every coefficient wrong by up to 15 %"
    return Budget(
        platform=platform.name,
        axial_error=wrong["axial_error"],
        relative_error=wrong["relative_error"],
        heading_error=wrong["heading_error"],
        identification_noise=level,
        detection_floor=typical["floor"] if has_floor else None,
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
                f"{FLOOR_RATE:.0%} of all cases; noise alone exceeds the threshold {FALSE_ALARMS:g} time per hour"
                if has_floor
                else f"no impulse of {typical['width']:g} s of the grid is found in {FLOOR_RATE:.0%} of all cases"
            ),
            "axial_offset": "N; mean of identified minus true B_cu over steady glide, separately for dive and climb",
            "exact_axial_error": "m/s; as axial_error, with the true coefficients",
        },
    )


def compare_recoverability(noise: Row, floors: Sequence[Row], errors: Sequence[Row], preset: str) -> list[Comparison]:
    """Compare the paper's figures of sections 5.1.1, 5.3 and 5.5 with ours, for one preset."""
    exact, wrong = (first(errors, preset=preset, model=model) for model in MODELS)
    floors = select(floors, preset=preset)
    return [
        Comparison("identification noise, RMS", "N m", noise["noise"], (0.4, 0.7),
                   remark="the largest value in the paper's own Table 3 is 0.24"),
        Comparison("identification noise, largest", "N m", noise["largest"], 0.24, paper_text="<= 0.24"),
        Comparison("threshold: one false alarm per hour", "N m", noise["threshold"],
                   remark=f"{noise['threshold_multiples']:.1f} times the noise; {noise['hours']:.1f} h of noise alone"),
        *(
            Comparison(f"floor, impulse of {row['width']:g} s", "N m", row["floor"], remark="found in 9 of 10 cases")
            for row in floors
        ),
        *(
            Comparison(f"floor over noise, impulse of {row['width']:g} s", "1", row["multiples"], (25.0, 40.0))
            for row in floors
        ),
        Comparison("axial offset, exact coefficients", "N", 0.5 * (exact["axial_dive"] + exact["axial_climb"]), -0.5,
                   (exact["axial_least"], exact["axial_most"]), remark="spread: minimum and maximum of dive or climb"),
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
