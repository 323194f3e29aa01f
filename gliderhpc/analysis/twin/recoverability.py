"""``twin recoverability``: what can be found at all, and how far the unobserved part of the motion strays.

Yaw impulses of known amplitude and width against their detection, height and timing; the floor in multiples of the
identification noise; the axial offset and the velocity error of the under-determined self-motion, with exact
coefficients and with every one wrong by up to 15 %; and from these the budget of the current's uncertainty for the
platform at hand.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.analysis.scores import rms
from gliderhpc.analysis.study_output import Comparison
from gliderhpc.analysis.twin.budget import Budget, CurrentError, FittedBudget, fit_budget
from gliderhpc.analysis.twin.hulls import with_coefficient_errors
from gliderhpc.analysis.twin.impulses import find_impulses, high_passed_moments, quiet_peaks, quiet_samples
from gliderhpc.analysis.twin.inversion import TwinCase, TwinInversion, invert_twin
from gliderhpc.analysis.twin.runs import Report, Row, TwinRun, labelled, run_all
from gliderhpc.analysis.twin.scoring import mean, motion_scores
from gliderhpc.analysis.twin.worlds import QUIET, course_of, with_impulses, world
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.currents import CurrentSettings, cycles_of, depth_averaged_current
from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.mission.executors import Executor
from gliderhpc.platform import Platform

PRESETS = ("recommended", "paper")
MAIN = "recommended"
"""The preset that the budget is written for."""

COEFFICIENT_ERROR = 0.15
MODELS = ("exact", "within 15%")
"""What the estimator believes of the hull's coefficients."""

LEAST_SEEDS = 3
"""Twins that a budget needs."""

SPACING = 45.0
"""Mean time between impulses, s."""

BLOCK = 10.0
"""Seconds in which a false alarm counts once."""

FALSE_ALARMS = 1.0
"""An hour of noise alone: the threshold is set by it. What noise leaves is far from normal (bursts where the compass
quantum flips), so that a multiple of its root mean square would cry wolf a dozen times an hour."""

FLOOR_RATE = 0.9
"""Detection rate that the floor is at."""

TYPICAL_WIDTH = 1.2
"""Seconds; the width that the floor is quoted for: the shortest of the usual scenario."""

_COEFFICIENT_STREAM = 3_000


@dataclass(frozen=True)
class RecoverabilitySize:
    """How much is run: depths (m) of impulse, quiet and motion twins, amplitudes (N m), widths (s), twins."""

    impulse_depth: float
    quiet_depth: float
    motion_depth: float
    amplitudes: tuple[float, ...]
    widths: tuple[float, ...]
    impulse_seeds: int
    quiet_seeds: int
    seeds: int


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


@dataclass(frozen=True, eq=False)
class RecoverabilityStudy:
    """What the study gives.

    Attributes
    ----------
    noise : dict
        A preset: identification noise (RMS and largest, N m) and threshold.
    findings, motions : list of dict
        One an impulse; one a dive.
    detection : list of dict
        One an amplitude, width and preset: rate, amplitude error, timing.
    floors : list of dict
        One a width and preset: amplitude found nine times in ten, and in multiples of the noise.
    errors : list of dict
        One a preset and ensemble (exact, 15 %): axial offset, velocity error and the fitted terms.
    budget : Budget
        For preset `MAIN` with the coefficient error.
    """

    noise: dict[str, Row]
    findings: list[Row]
    motions: list[Row]
    detection: list[Row]
    floors: list[Row]
    errors: list[Row]
    budget: Budget


def study_recoverability(
    platform: Platform, size: RecoverabilitySize, seeds: Iterable[int], executor: Executor, report: Report
) -> RecoverabilityStudy:
    """Run everything on one hull.

    Raises
    ------
    InputError
        Fewer than three twins, too few for a budget.
    """
    seeds = list(seeds)
    refuse_few(seeds)
    results = run_all(recoverability_runs(platform, size, seeds), executor, report, function=recovered_rows)
    rows = [row for result in results for row in result]
    noise = {preset: identification_noise(rows, preset) for preset in PRESETS}
    findings = [row for row in rows if row["kind"] == "impulse"]
    motions = [row for row in rows if row["kind"] == "motion"]
    detection = detection_table(findings, noise)
    floors = floor_table(detection, noise)
    fitted = {
        (preset, model): fit_budget(_current_errors(motions, preset, model)) for preset in PRESETS for model in MODELS
    }
    errors = [error_row(motions, preset, model, fitted[preset, model]) for preset, model in fitted]
    budget = make_budget(platform, noise, floors, errors, len(seeds))
    return RecoverabilityStudy(noise, findings, motions, detection, floors, errors, budget)


def refuse_few(seeds: Sequence[int]) -> None:
    """Refuse a study too small for a budget.

    Raises
    ------
    InputError
        Fewer twins than `LEAST_SEEDS`.
    """
    if len(seeds) < LEAST_SEEDS:
        raise InputError(f"--seeds {len(seeds)}: a budget needs at least {LEAST_SEEDS} twins")


def recoverability_runs(platform: Platform, size: RecoverabilitySize, seeds: Sequence[int]) -> list[TwinRun]:
    """List every run."""
    runs = []
    for preset in PRESETS:
        settings = EstimationSettings.model_validate({"preset": preset})
        runs += [_quiet_run(platform, size, settings, seed) for seed in seeds[: size.quiet_seeds]]
        runs += [
            _impulse_run(platform, size, settings, seed, amplitude, width)
            for seed in seeds[: size.impulse_seeds]
            for amplitude in size.amplitudes
            for width in size.widths
        ]
        runs += [_motion_run(platform, size, settings, seed, model) for seed in seeds for model in MODELS]
    return runs


def recovered_rows(run: TwinRun) -> list[Row]:
    """Invert one twin and give its rows: one an impulse, or one a dive."""
    labels = {**dict(run.labels), "seed": run.case.seed}
    try:
        inversion = invert_twin(run.case)
    except ProfileError as error:
        return [labels | {"kind": "refused", "refused": str(error)}]
    if labels["kind"] == "impulse":
        return [labels | vars(finding) for finding in find_impulses(inversion)]
    return [labels | (_quiet_row(inversion) if labels["kind"] == "quiet" else motion_row(inversion))]


def identification_noise(rows: Sequence[Row], preset: str) -> Row:
    """RMS and largest size of the high-passed yaw moment that noise alone leaves, and the threshold it asks for."""
    quiet = [row for row in rows if row["kind"] == "quiet" and row["preset"] == preset]
    level = float(np.sqrt(np.mean([row["noise"] ** 2 for row in quiet])))
    peaks = np.concatenate([row["peaks"] for row in quiet])
    threshold = float(np.quantile(peaks, 1.0 - FALSE_ALARMS * BLOCK / 3600.0))
    return {
        "noise": level,
        "largest": max(row["largest"] for row in quiet),
        "threshold": threshold,
        "threshold_multiples": threshold / level,
        "hours": sum(row["hours"] for row in quiet),
    }


def detection_table(findings: Sequence[Row], noise: dict[str, Row]) -> list[Row]:
    """Rate, amplitude error and timing, one line a preset, amplitude and width."""
    lines = []
    labels: Any
    for labels, group in pd.DataFrame(findings).groupby(["preset", "true_amplitude", "true_width"], sort=True):
        preset, amplitude, width = labels
        found = group[group["peak"] > noise[preset]["threshold"]]
        lines.append(
            {
                "preset": preset,
                "amplitude": amplitude,
                "width": width,
                "impulses": len(group),
                "rate": len(found) / len(group),
                "gain": float(group["gain"].median()),
                "gain_low": float(group["gain"].quantile(0.25)),
                "gain_high": float(group["gain"].quantile(0.75)),
                "delay": float(found["delay"].median()) if len(found) else float("nan"),
                "delay_spread": float(found["delay"].std()) if len(found) > 1 else float("nan"),
                "multiples": amplitude / noise[preset]["noise"],
            }
        )
    return lines


def floor_table(detection: Sequence[Row], noise: dict[str, Row]) -> list[Row]:
    """Amplitude at which the detection rate passes `FLOOR_RATE`, one line a preset and width."""
    lines = []
    labels: Any
    for labels, group in pd.DataFrame(detection).groupby(["preset", "width"], sort=True):
        preset, width = labels
        floor = crossing(group["amplitude"].to_numpy(), group["rate"].to_numpy(), FLOOR_RATE)
        level = noise[preset]["noise"]
        lines.append({"preset": preset, "width": width, "floor": floor, "multiples": floor / level})
    return lines


def crossing(amplitudes: Any, rates: Any, level: float) -> float:
    """Amplitude from which on the rate stays at or above a level, interpolated in the logarithm; NaN for none."""
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
    estimate, truth = inversion.estimate, inversion.profile_truth
    motion = model_motion(estimate.solution.states, estimate.shaken, inversion.step)
    current = depth_averaged_current(
        inversion.record, estimate.series, motion, cycles_of(estimate.series), CurrentSettings()
    )
    if current is None:
        raise InputError("a twin without fixes has no current")
    error = inversion.error[:, 0]
    steady = inversion.steady
    wrong = current.velocity - truth.current
    return {
        **motion_scores(inversion),
        "axial_dive": mean(error[steady & inversion.diving]),
        "axial_climb": mean(error[steady & ~inversion.diving]),
        "current_north": float(truth.current[0]),
        "current_east": float(truth.current[1]),
        "error_north": float(wrong[0]),
        "error_east": float(wrong[1]),
        "track_north": float(truth.displacement[0]),
        "track_east": float(truth.displacement[1]),
    }


def error_row(motions: Sequence[Row], preset: str, model: str, fitted: FittedBudget) -> Row:
    """Axial offset, velocity error and fitted terms of one ensemble."""
    frame = pd.DataFrame([row for row in motions if row["preset"] == preset and row["model"] == model])
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


def make_budget(
    platform: Platform, noise: dict[str, Row], floors: Sequence[Row], errors: Sequence[Row], twins: int
) -> Budget:
    """Put the figures of preset `MAIN` together.

    Raises
    ------
    InputError
        No amplitude of the grid was found nine times in ten.
    """
    exact, wrong = (next(row for row in errors if row["preset"] == MAIN and row["model"] == model) for model in MODELS)
    typical = min(
        (row for row in floors if row["preset"] == MAIN), key=lambda row: abs(float(row["width"]) - TYPICAL_WIDTH)
    )
    if not np.isfinite(typical["floor"]):
        raise InputError(f"{platform.name}: no yaw impulse of the grid is found nine times in ten")
    level = noise[MAIN]["noise"]
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
                f"N m; RMS of the yaw moment above 0.05 Hz with sensor noise and no disturbance, preset {MAIN}"
            ),
            "detection_floor": (
                f"N m; amplitude of an impulse of {typical['width']:g} s (standard deviation) found in "
                f"{FLOOR_RATE:.0%} of all cases, at a threshold that noise alone passes {FALSE_ALARMS:g} time an hour"
            ),
            "axial_offset": "N; mean of identified minus true B_cu over steady glide, dive and climb apart",
            "exact_axial_error": "m/s; as axial_error, with the true coefficients",
        },
    )


def compare_recoverability(study: RecoverabilityStudy, preset: str) -> list[Comparison]:
    """Lay the paper's figures of sections 5.1.1, 5.3 and 5.5 beside ours, for one preset."""
    noise = study.noise[preset]
    exact, wrong = (
        next(row for row in study.errors if row["preset"] == preset and row["model"] == model) for model in MODELS
    )
    floors = [row for row in study.floors if row["preset"] == preset]
    return [
        Comparison("identification noise, RMS", "N m", noise["noise"], 0.55, paper_said="0.4-0.7",
                   remark="the paper's own Table 3 has at most 0.24 as the largest"),
        Comparison("identification noise, largest", "N m", noise["largest"], 0.24, paper_said="<= 0.24"),
        Comparison("threshold: one false alarm an hour", "N m", noise["threshold"],
                   remark=f"{noise['threshold_multiples']:.1f} times the noise; {noise['hours']:.1f} h of noise alone"),
        *(
            Comparison(f"floor, impulse of {row['width']:g} s", "N m", row["floor"], remark="found nine times in ten")
            for row in floors
        ),
        *(
            Comparison(f"floor over noise, impulse of {row['width']:g} s", "1", row["multiples"], 32.5, None, "25-40")
            for row in floors
        ),
        Comparison("axial offset, exact coefficients", "N", 0.5 * (exact["axial_dive"] + exact["axial_climb"]), -0.5,
                   (exact["axial_least"], exact["axial_most"]), remark="spread: least and most of dive or climb"),
        Comparison("axial offset, coefficients within 15%", "N", 0.5 * (wrong["axial_dive"] + wrong["axial_climb"]),
                   -0.575, (wrong["axial_least"], wrong["axial_most"]), "-0.4 … -0.75", "spread as above"),
        Comparison("velocity error, exact coefficients", "m/s", exact["velocity_error"], 0.055, paper_said="0.05-0.06"),
        Comparison("velocity error, coefficients within 15%", "m/s", wrong["velocity_error"]),
        Comparison("budget: axial error", "m/s", wrong["axial_error"], 0.055, paper_said="0.05-0.06",
                   remark="coefficients within 15%"),
        Comparison("budget: relative error", "1", wrong["relative_error"], 0.26, remark="coefficients within 15%"),
        Comparison("budget: heading error", "degree", wrong["heading_error"], 8.0, remark="coefficients within 15%"),
        Comparison("median squared distance under the budget", "1", wrong["median_distance"],
                   remark="1.39 if the ellipses fit"),
    ]  # fmt: skip


def _quiet_run(platform: Platform, size: RecoverabilitySize, settings: EstimationSettings, seed: int) -> TwinRun:
    case = TwinCase(platform, world(size.quiet_depth, disturbances=QUIET), seed, settings, course_of(seed))
    return labelled(case, kind="quiet", preset=settings.preset)


def _impulse_run(
    platform: Platform,
    size: RecoverabilitySize,
    settings: EstimationSettings,
    seed: int,
    amplitude: float,
    width: float,
) -> TwinRun:
    scenario = with_impulses(world(size.impulse_depth), amplitude, width, SPACING)
    case = TwinCase(platform, scenario, seed, settings, course_of(seed))
    return labelled(case, kind="impulse", preset=settings.preset, true_amplitude=amplitude, true_width=width)


def _motion_run(
    platform: Platform, size: RecoverabilitySize, settings: EstimationSettings, seed: int, model: str
) -> TwinRun:
    rng = np.random.default_rng([seed, _COEFFICIENT_STREAM])
    assumed = None if model == "exact" else with_coefficient_errors(platform, COEFFICIENT_ERROR, rng)
    case = TwinCase(platform, world(size.motion_depth), seed, settings, course_of(seed), assumed)
    return labelled(case, kind="motion", preset=settings.preset, model=model)


def _quiet_row(inversion: TwinInversion) -> Row:
    high, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    return {
        "noise": rms(high[quiet]),
        "largest": float(np.abs(high[quiet]).max()),
        "peaks": quiet_peaks(inversion, BLOCK).tolist(),
        "hours": float(np.count_nonzero(quiet)) * inversion.step / 3600.0,
    }


def _current_errors(motions: Sequence[Row], preset: str, model: str) -> list[CurrentError]:
    return [
        CurrentError(
            (row["current_north"], row["current_east"]),
            (row["error_north"], row["error_east"]),
            (row["track_north"], row["track_east"]),
        )
        for row in motions
        if row["preset"] == preset and row["model"] == model
    ]
