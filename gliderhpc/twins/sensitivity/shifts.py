"""What every error of ``twin sensitivity`` does: scores a setting, and the shifts of the channels that it causes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.twins.runs import Row
from gliderhpc.twins.sensitivity.runs import BASE, COEFFICIENT_ERROR, OFFSETS
from gliderhpc.vocabulary import CHANNELS

PHASES = ("dive", "climb")
_BIASES = [f"bias_{phase}_{name}" for phase in PHASES for name in CHANNELS]
SUMMARISED = (
    *(f"rmse_{name}" for name in CHANNELS), "correlation_B_cr", "noise_B_cr", "peak_B_cr", "tracking_roll",
    "tracking_pitch", "tracking_heading", "tracking_depth", "velocity_along", "velocity_error", "surge_rmse",
    "iterations", "capped",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class SensitivityResults:
    """What the study gives: a row a run, medians a setting, and the biases that each error causes."""

    rows: list[Row]
    summary: list[Row]
    biases: list[Row]


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Median and largest size of every score over the twins, one line a setting, in the order of the runs."""
    frame = _frame(rows)
    frame.loc[frame["sweep"] == "coefficients", "value"] = f"within {COEFFICIENT_ERROR:.0%}"
    lines: list[Row] = []
    for labels, group in frame.groupby(["preset", "sweep", "value"], sort=False):
        line: Row = dict(zip(("preset", "sweep", "value"), labels, strict=True))
        line["runs"] = len(group)
        line["refused"] = int(group["refused"].notna().sum())
        for name in SUMMARISED:
            known = group[name].to_numpy(dtype=np.float64)
            known = known[np.isfinite(known)]
            line[name] = float(np.median(known)) if known.size else float("nan")
            line[f"{name}_most"] = float(np.abs(known).max()) if known.size else float("nan")
        lines.append(line)
    return lines


def biases(rows: Sequence[Row]) -> list[Row]:
    """Mean shift of every channel by every error, dive and climb apart: N and N m, a degree for the offsets.

    Noise: difference from perfect sensors on the quiet twin. Offsets: half the difference between plus and minus one
    degree. All others: difference from the usual twin. One line an error, phase and preset: median over the twins, and
    largest size.
    """
    frame = _frame(rows)
    lines = []
    for preset in frame["preset"].unique():
        ours = frame[frame["preset"] == preset]
        for sweep in ours["sweep"].unique():
            of_sweep = ours[ours["sweep"] == sweep]
            if sweep == "quiet":
                shift = _biases_of(of_sweep, "noise") - _biases_of(of_sweep, "perfect sensors")
                lines += _bias_lines(preset, sweep, "noise", shift)
            elif sweep.startswith("offset"):
                for name in OFFSETS:
                    shift = 0.5 * (_biases_of(of_sweep, f"{name} +1") - _biases_of(of_sweep, f"{name} -1"))
                    lines += _bias_lines(preset, sweep, name, shift)
            elif sweep in ("coefficients", "one coefficient", "initial state", "step", "sample interval"):
                base = _biases_of(ours[ours["sweep"] == "usual"], BASE)
                shifts = {value: _biases_of(of_sweep, value) - base for value in of_sweep["value"].unique()}
                if sweep == "coefficients":
                    lines += _bias_lines(preset, sweep, f"within {COEFFICIENT_ERROR:.0%}", pd.concat(shifts.values()))
                else:
                    for value, shift in shifts.items():
                        lines += _bias_lines(preset, sweep, value, shift)
    return lines


def _frame(rows: Sequence[Row]) -> pd.DataFrame:
    frame = pd.DataFrame(rows)
    if "refused" not in frame:
        frame["refused"] = None
    return frame.astype({"value": "object"})


def _biases_of(frame: pd.DataFrame, value: Any) -> pd.DataFrame:
    """Mean errors a seed, dive and climb."""
    chosen = frame[frame["value"] == value].set_index("seed")
    return pd.DataFrame(chosen[[*_BIASES, "velocity_along", "velocity_across"]].astype(np.float64))


def _bias_lines(preset: str, sweep: str, value: Any, shift: pd.DataFrame) -> list[Row]:
    lines = []
    for phase in PHASES:
        line: Row = {"preset": preset, "sweep": sweep, "value": value, "phase": phase}
        for name in CHANNELS:
            of_channel = shift[f"bias_{phase}_{name}"].dropna()
            line[name] = float(of_channel.median())
            line[f"{name}_most"] = float(of_channel.abs().max())
            line[f"{name}_rms"] = float(np.sqrt((of_channel**2).mean()))
        line["velocity_along_rms"] = float(np.sqrt((shift["velocity_along"] ** 2).mean()))
        line["velocity_across_rms"] = float(np.sqrt((shift["velocity_across"] ** 2).mean()))
        lines.append(line)
    return lines
