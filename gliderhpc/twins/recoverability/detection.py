"""Which yaw impulses are found: identification noise and its threshold, detection rates, and the floor."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.studies.library.scores import rms
from gliderhpc.twins.impulses import high_passed_moments, quiet_peaks, quiet_samples
from gliderhpc.twins.inversion import TwinInversion
from gliderhpc.twins.runs import Row

BLOCK = 10.0
"""Seconds in which a false alarm counts once."""

FALSE_ALARMS = 1.0
"""An hour of noise alone: the threshold is set by it. What noise leaves is far from normal (bursts where the compass
quantum flips), so that a multiple of its root mean square would cry wolf a dozen times an hour."""

FLOOR_RATE = 0.9
"""Detection rate that the floor is at."""


def quiet_row(inversion: TwinInversion) -> Row:
    """High-passed yaw moment of a twin without disturbance: RMS, largest size, largest a block; N m; and the hours."""
    high, _ = high_passed_moments(inversion)
    quiet = quiet_samples(inversion)
    return {
        "noise": rms(high[quiet]),
        "largest": float(np.abs(high[quiet]).max()),
        "peaks": quiet_peaks(inversion, BLOCK).tolist(),
        "hours": float(np.count_nonzero(quiet)) * inversion.step / 3600.0,
    }


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
