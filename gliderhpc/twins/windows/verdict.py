"""What the runs of ``twin windows`` say: scores over the seeds, and the operating point by the error against truth."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from gliderhpc.findings.tables import number
from gliderhpc.twins.runs import Row
from gliderhpc.twins.windows.sweeps import OPERATING_LENGTH

SCORES = (
    "rmse_B_cr", "rmse_B_cu", "rmse_B_cw", "rmse_B_cq", "overall", "correlation_B_cr", "tracking_roll",
    "tracking_pitch", "tracking_heading", "tracking_depth", "cost_per_30s", "iterations", "capped", "seam_ratio",
    "seam_ratio_signal", "jump_ratio", "retracted", "velocity_error",
)  # fmt: skip
"""What is summarised over the seeds."""

_DISTURBED = ("B_cu", "B_cw", "B_cq", "B_cr")


def overall_error(row: Row) -> float:
    """Error of the four disturbed channels, each over its truth's root mean square, as one root mean square."""
    if "refused" in row:
        return float("nan")
    return float(np.sqrt(np.mean([(row[f"rmse_{name}"] / row[f"truth_{name}"]) ** 2 for name in _DISTURBED])))


def summarise(rows: Sequence[Row]) -> list[Row]:
    """Median and quartiles of the scores over the seeds, one line a setting."""
    frame = pd.DataFrame(rows)
    lines: list[Row] = []
    for labels, group in frame.groupby(["hull", "preset", "sweep", "value"], sort=True):
        line: Row = dict(zip(("hull", "preset", "sweep", "value"), labels, strict=True))
        line["seeds"] = len(group)
        for name in SCORES:
            known = group[name].to_numpy(dtype=np.float64)
            known = known[np.isfinite(known)]
            line[name], line[f"{name}_low"], line[f"{name}_high"] = (
                (float(value) for value in np.percentile(known, (50.0, 25.0, 75.0))) if known.size else (np.nan,) * 3
            )
        lines.append(line)
    return lines


def verdict(rows: Sequence[Row], hull: str, preset: str) -> Row:
    """Say what the evidence says of 30 s, 10 s and 0.2 on a hull.

    A length is *as good as* the best where the error of the best, seed by seed, is not lower in the median by more than
    the quartile spread of that very difference.
    """
    frame = pd.DataFrame([row for row in rows if row["hull"] == hull and row["preset"] == preset])
    tables = {name: _by_seed(frame, "sliding", name) for name in ("rmse_B_cr", "overall", "seam_ratio", "capped")}
    unslid = {name: _by_seed(frame, "not sliding", name) for name in ("rmse_B_cr", "overall", "seam_ratio")}
    best_yaw, best_overall = (_best(tables[name]) for name in ("rmse_B_cr", "overall"))
    capped = tables["capped"].mean()
    line: Row = {
        "hull": hull,
        "preset": preset,
        "best_length_yaw": best_yaw,
        "best_length_overall": best_overall,
        "as_good_as_best": as_good_as_best(tables["overall"]),
        "as_good_as_best_yaw": as_good_as_best(tables["rmse_B_cr"]),
        "capped_from": next((float(length) for length in capped.index if capped[length] > 0.01), None),
    }
    if OPERATING_LENGTH in tables["overall"]:
        at_operating = {name: table[OPERATING_LENGTH] for name, table in tables.items()}
        line["yaw_over_best"] = float((at_operating["rmse_B_cr"] / tables["rmse_B_cr"][best_yaw]).median())
        line["overall_over_best"] = float((at_operating["overall"] / tables["overall"][best_overall]).median())
        for name, table in unslid.items():
            line[f"unslid_over_slid_{name}"] = float((table[OPERATING_LENGTH] / at_operating[name]).median())
    line["tau_c_change"] = _largest_change(frame)
    line["best_tolerance"] = _best(_by_seed(frame, "tolerance", "overall"))
    line["best_tolerance_yaw"] = _best(_by_seed(frame, "tolerance", "rmse_B_cr"))
    return line


def as_good_as_best(table: pd.DataFrame) -> list[float]:
    """Values (columns) whose error is not above the best's beyond the spread over the seeds (rows)."""
    best = table[_best(table)]
    chosen = []
    for value in table.columns:
        excess = table[value] - best
        if excess.median() <= excess.quantile(0.75) - excess.quantile(0.25):
            chosen.append(float(value))
    return chosen


def verdict_sentence(line: Row) -> str:
    """Say in one sentence whether 30 s / 10 s / 0.2 is right for a hull and preset."""
    good = line["as_good_as_best"]
    right = OPERATING_LENGTH in good
    best = f"{line['best_length_overall']:g} s by all channels, {line['best_length_yaw']:g} s by yaw"
    cap = "never hit" if line["capped_from"] is None else f"hit from {line['capped_from']:g} s on"
    slid, seam = line.get("unslid_over_slid_rmse_B_cr", np.nan), line.get("unslid_over_slid_seam_ratio", np.nan)
    return (
        f"{line['hull']}, {line['preset']}: 30 s is {'as good as any' if right else 'not the best'} (best {best}; as "
        f"good by all channels: {', '.join(f'{value:g}' for value in good)} s); its yaw error is "
        f"{number(line.get('yaw_over_best'))} times the best's; not sliding multiplies the yaw error by {number(slid)} "
        f"and the seam ratio by {number(seam)}; the cap is {cap}; tau_c from 0.05 to 3.2 changes the yaw error by at "
        f"most {line['tau_c_change']:.1%}; the best tolerance is {line['best_tolerance']:g} by all channels, "
        f"{line['best_tolerance_yaw']:g} by yaw."
    )


def _by_seed(frame: pd.DataFrame, sweep: str, score: str) -> pd.DataFrame:
    """One score, seeds down and values across."""
    return frame[frame["sweep"] == sweep].pivot_table(index="seed", columns="value", values=score, aggfunc="first")


def _best(table: pd.DataFrame) -> float:
    medians = table.median()
    return float(medians.index.to_numpy()[int(np.argmin(medians.to_numpy()))])


def _largest_change(frame: pd.DataFrame) -> float:
    """Largest relative change of the yaw error as tau_c is swept, over all seeds."""
    table = _by_seed(frame, "tau_c", "rmse_B_cr")
    spread = (table.max(axis=1) - table.min(axis=1)) / table.min(axis=1)
    return float(spread.max())
