"""The figures of ``twin windows`` beside those of section 5.1.2 and Fig. 5."""

import numpy as np

from gliderhpc.findings.comparison import Comparison
from gliderhpc.twins.runs import Row
from gliderhpc.twins.windows.results import WindowsResults
from gliderhpc.twins.windows.sweeps import OPERATING_LENGTH


def compare_windows(results: WindowsResults, hull: str, preset: str) -> list[Comparison]:
    """Lay the paper's figures of section 5.1.2 and Fig. 5 beside ours, for one hull and preset."""
    lines = {
        (line["sweep"], line["value"]): line
        for line in results.summary
        if line["hull"] == hull and line["preset"] == preset
    }
    at = next(line for line in results.verdicts if line["hull"] == hull and line["preset"] == preset)
    slid, unslid = lines["sliding", OPERATING_LENGTH], lines["not sliding", OPERATING_LENGTH]
    longest = lines["sliding", max(value for sweep, value in lines if sweep == "sliding")]
    good = ", ".join(f"{value:g}" for value in at["as_good_as_best"])
    return [
        _row("yaw RMSE, 30 s sliding", "N m", slid, "rmse_B_cr", 0.15),
        _row("yaw RMSE, 30 s not sliding", "N m", unslid, "rmse_B_cr"),
        _row("surge RMSE, 30 s sliding", "N", slid, "rmse_B_cu"),
        _row("pitch moment RMSE, 30 s sliding", "N m", slid, "rmse_B_cq"),
        _row("seam ratio, 30 s sliding", "1", slid, "seam_ratio", 1.0, said="near 1"),
        _row("seam ratio, 30 s not sliding", "1", unslid, "seam_ratio", 20.0, said="> 20"),
        _row("jump ratio, 30 s sliding", "1", slid, "jump_ratio"),
        _row("jump ratio, 30 s not sliding", "1", unslid, "jump_ratio", remark="a discontinuity alone"),
        _row("cost, 30 s not sliding over sliding", "1", _quotient(unslid, slid, "cost_per_30s"), "cost_per_30s",
             remark="paper: lower"),
        _row("iterations a window, 30 s", "1", slid, "iterations", 37.0),
        _row(f"share at the cap, {longest['value']:g} s", "1", longest, "capped",
             remark="paper: no convergence beyond 45 s"),
        Comparison("best length by yaw", "s", at["best_length_yaw"], 30.0),
        Comparison("best length by all channels", "s", at["best_length_overall"], 30.0, remark=f"as good: {good} s"),
        Comparison("yaw error at 30 s over the best's", "1", at.get("yaw_over_best", np.nan), 1.0),
        Comparison(
            "largest change of yaw error, tau_c 0.05-3.2", "1", at["tau_c_change"], 0.0, paper_said="invariant",
            remark="relative, over all twins",
        ),
        Comparison("best tolerance by all channels", "1", at["best_tolerance"],
                   remark=f"on max |s g|; by yaw {at['best_tolerance_yaw']:g}"),
    ]  # fmt: skip


def _row(
    quantity: str, unit: str, line: Row, name: str, paper: float | None = None, said: str = "", remark: str = ""
) -> Comparison:
    spread = (line[f"{name}_low"], line[f"{name}_high"]) if f"{name}_low" in line else None
    return Comparison(quantity, unit, line[name], paper, spread, said, remark)


def _quotient(above: Row, below: Row, name: str) -> Row:
    return {name: above[name] / below[name]}
