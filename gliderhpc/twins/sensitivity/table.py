"""The figures of ``twin sensitivity`` beside those of section 5.1.1."""

from typing import Any

import numpy as np

from gliderhpc.findings.comparison import Comparison
from gliderhpc.twins.runs import Row
from gliderhpc.twins.sensitivity.runs import BASE, COEFFICIENT_ERROR
from gliderhpc.twins.sensitivity.shifts import PHASES, SensitivityResults
from gliderhpc.vocabulary import CHANNELS

_PAPER_OFFSETS = {("pitch", "B_cu"): 0.43, ("pitch", "B_cq"): 0.11, ("heading", "B_cr"): 0.003}


def compare_sensitivity(results: SensitivityResults, preset: str) -> list[Comparison]:
    """Lay the paper's figures of section 5.1.1 beside ours, for one preset."""
    summary = {(line["sweep"], line["value"]): line for line in results.summary if line["preset"] == preset}
    shifts = {
        (line["sweep"], line["value"], line["phase"]): line for line in results.biases if line["preset"] == preset
    }
    return [
        *_noise_comparisons(summary, shifts["quiet", "noise", "dive"]),
        *_offset_comparisons(shifts),
        *_coefficient_comparisons(shifts),
        *_record_comparisons(summary),
    ]


def _noise_comparisons(summary: dict[tuple[str, Any], Row], shift: Row) -> list[Comparison]:
    noise, perfect = summary["quiet", "noise"], summary["quiet", "perfect sensors"]
    peaks = [
        Comparison(
            "noise: largest yaw moment of a dive", "N m", noise["peak_B_cr"], 0.24, paper_said="<= 0.24",
            remark="high-passed; median over the twins",
        ),
        Comparison(
            "noise: largest yaw moment of all dives", "N m", noise["peak_B_cr_most"], 0.24, paper_said="<= 0.24",
            remark=f"high-passed; perfect sensors {perfect['peak_B_cr_most']:.3f}",
        ),
    ]  # fmt: skip
    channels = [
        Comparison(
            f"noise: {name} left, RMS", unit, noise[f"rmse_{name}"], remark=f"perfect {perfect[f'rmse_{name}']:.2g}"
        )
        for name, (unit, _) in CHANNELS.items()
    ]
    velocity = Comparison(
        "noise: mean velocity through the water", "m/s",
        float(np.hypot(shift["velocity_along_rms"], shift["velocity_across_rms"])), 2e-4,
        remark=f"RMS difference from perfect sensors, whose own error is {perfect['velocity_error']:.1e}",
    )  # fmt: skip
    return [*peaks, *channels, velocity]


def _offset_comparisons(shifts: dict[tuple[str, Any, str], Row]) -> list[Comparison]:
    rows = []
    for sweep in dict.fromkeys(key[0] for key in shifts if key[0].startswith("offset")):
        for name, channels in (("pitch", ("B_cu", "B_cw", "B_cq", "B_cr")), ("heading", ("B_cu", "B_cw", "B_cr"))):
            for channel in channels:
                for phase in PHASES:
                    line = shifts[sweep, name, phase]
                    unit = f"{CHANNELS[channel][0]}/degree"
                    paper = _PAPER_OFFSETS.get((name, channel)) if phase == "dive" else None
                    rows.append(Comparison(f"{name} {sweep} degree: {channel}, {phase}", unit, line[channel], paper))
    return rows


def _coefficient_comparisons(shifts: dict[tuple[str, Any, str], Row]) -> list[Comparison]:
    rows = []
    value = f"within {COEFFICIENT_ERROR:.0%}"
    for phase in PHASES:
        line = shifts["coefficients", value, phase]
        rows += [
            Comparison(
                f"coefficients {value}: {name}, {phase}", CHANNELS[name][0], line[f"{name}_rms"],
                remark=f"RMS; most {line[f'{name}_most']:.2f}",
            )
            for name in ("B_cu", "B_cw", "B_cq", "B_cr")
        ]  # fmt: skip
    line = shifts["coefficients", value, "dive"]
    velocity = Comparison(
        f"coefficients {value}: velocity along track", "m/s", line["velocity_along_rms"], (0.05, 0.06),
        remark="RMS of the shift; the paper's is that of everything",
    )  # fmt: skip
    return [*rows, velocity]


def _record_comparisons(summary: dict[tuple[str, Any], Row]) -> list[Comparison]:
    base = summary["usual", BASE]
    rows = [Comparison("usual twin: yaw RMSE", "N m", base["rmse_B_cr"])]
    for (sweep, value), line in summary.items():
        if sweep in ("step", "sample interval", "dropout", "gap", "initial state"):
            label = f"{value:g}" if isinstance(value, float) else str(value)
            rows.append(
                Comparison(
                    f"{sweep} {label}: yaw RMSE", "N m", line["rmse_B_cr"],
                    remark=f"surge {line['rmse_B_cu']:.3f} N, velocity {line['velocity_error']:.4f} m/s, "
                    f"refused {line['refused']}",
                )
            )  # fmt: skip
    return rows
