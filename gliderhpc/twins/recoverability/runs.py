"""Runs of ``twin recoverability`` (quiet, impulse and motion twins), their rows, and tables made of the rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.current_budget import CurrentError, fit_budget
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario
from gliderhpc.studies.library.scores import rms
from gliderhpc.twins.cases import (
    PRESETS,
    QUIET,
    TwinCase,
    course_of,
    with_coefficient_errors,
    with_impulses,
    world,
)
from gliderhpc.twins.impulses import find_impulses, high_passed_moments, quiet_peaks, quiet_samples
from gliderhpc.twins.inversion import TwinInversion, invert_twin
from gliderhpc.twins.scoring import Row, mean, motion_scores, twin_current
from gliderhpc.twins.study import TwinPlan, TwinRun, TwinSize, groups, labelled, select

MODELS = ("exact", "within 15%")
"""Coefficients that the estimator assumes: the true ones, or each within 15 % of these."""

SPACING = 45.0
"""Mean time between impulses, s."""

FALSE_ALARM_BLOCK = 10.0
"""Seconds in which a false alarm counts once."""

FALSE_ALARMS = 1.0
"""False alarms per hour of noise alone that define the threshold. The noise is far from normal (bursts where the
compass quantum flips), so that a multiple of its root mean square would give a dozen false alarms per hour."""

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
        Twins per amplitude and width, and without disturbance.
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
                _run(platform, motion, seed, preset, _assumed(platform, model, seed), kind="motion", model=model)
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


def _assumed(platform: Platform, model: str, seed: int) -> Platform | None:
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
    """High-passed yaw moment without disturbance: RMS, largest size, largest size per block (N m), and the hours."""
    high, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    return {
        "noise": rms(high[quiet]),
        "largest": float(np.abs(high[quiet]).max()),
        "peaks": quiet_peaks(inversion, FALSE_ALARM_BLOCK).tolist(),
        "hours": float(np.count_nonzero(quiet)) * inversion.step / 3600.0,
    }


def identification_noise(rows: Sequence[Row], preset: str) -> Row:
    """RMS and largest size of the high-passed yaw moment under noise alone, and the threshold that follows."""
    quiet = select(rows, kind="quiet", preset=preset)
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
    """Amplitude at which the detection rate passes `FLOOR_RATE`, one line per preset and width."""
    lines = []
    for labels, group in groups(pd.DataFrame(detection), ("preset", "width"), sort=True):
        floor = crossing(group["amplitude"].to_numpy(), group["rate"].to_numpy(), FLOOR_RATE)
        lines.append(labels | {"floor": floor, "multiples": floor / noise[labels["preset"]]["noise"]})
    return lines


def crossing(amplitudes: Any, rates: Any, level: float) -> float:
    """Smallest amplitude above which the rate is at least a level, interpolated in the logarithm; NaN of none."""
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
        Too few twins for a fit.
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
