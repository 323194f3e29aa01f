"""The forward model's errors beside the paper's (section 3), and what table and figure are made from."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.tables import number
from gliderhpc.report.captions import data_said, profiles_said
from gliderhpc.report.studies.validation.figure import SHOWN
from gliderhpc.studies.library.trend import Trend
from gliderhpc.studies.provenance import Provenance


def comparisons(table: pd.DataFrame, trend: Trend) -> tuple[Comparison, ...]:
    """Rows of the table, of the profiles that were flown."""
    first = trend.first if np.isfinite(trend.first) else float(table["longitudinal_rmse"].iloc[0])
    last = trend.last if np.isfinite(trend.last) else float(table["longitudinal_rmse"].iloc[-1])
    ends = "fitted line's end" if np.isfinite(trend.first) else "too few profiles for a trend: its own value"

    def middle(name: str) -> float:
        return float(table[name].median()) if name in table else float("nan")

    return (
        Comparison("longitudinal RMSE, start of the mission", "1", first, 0.048, remark=ends),
        Comparison("longitudinal RMSE, end of the mission", "1", last, 0.080, remark=ends),
        Comparison("its relative rise", "1", trend.change, 0.66),
        Comparison(
            "its Mann-Kendall p", "1", trend.p, remark=f"tau {trend.tau:+.2f}, n = {trend.count}; paper 7.5e-06"
        ),
        Comparison("depth RMSE a profile, median", "m", middle("depth_rmse")),
        Comparison("pitch RMSE a profile, median", "degree", middle("pitch_rmse")),
        Comparison("heading RMSE a profile, median", "degree", middle("heading_rmse")),
        Comparison("part of the dive before the model surfaces, median", "1", middle("flown_fraction")),
        Comparison("track's end from dead reckoning's, over its path", "1", middle("horizontal_error_rate")),
        Comparison("the same on the recorded heading", "m", middle("horizontal_error_on_course")),
        Comparison("track's end from the exit fix, over the path", "1", middle("surfacing_error_rate")),
        Comparison("track's end from the exit fix", "m", middle("surfacing_error")),
        Comparison("dead reckoning's end from the exit fix", "m", middle("surfacing_error_glide_angle")),
    )


def captions(made: Provenance, table: pd.DataFrame, trend: Trend, platform: Mapping[str, Any]) -> dict[str, str]:
    """Captions by stem."""
    numbers = table["profile"].tolist()
    flown = (
        f"the fixed-parameter model of {platform['name']}, driven open loop by the recorded controls in still water: "
        f"{data_said(made, numbers)}"
    )
    changes = (
        f"The longitudinal error changes by {trend.change_said} over the mission (Mann-Kendall p = {number(trend.p)}, "
        "which serial correlation makes too small)."
        if np.isfinite(trend.slope)
        else f"{len(table)} profiles are too few for a trend."
    )
    doubt = (
        "Depth and horizontal errors grow with the time flown, and the current is in the distance from the fix but in "
        "neither track."
    )
    return {
        "figure_1": (
            f"Records beside {flown}. Panels (a) and (b): {profiles_said(numbers[:SHOWN])}; (c) and (d): the mission. "
            f"{changes} {doubt}"
        ),
        "profiles": (
            f"Errors over steady glide, a row a profile, of {flown}; the model is at the surface before the record's "
            f"end where flown_fraction is below 1. {changes} {doubt}"
        ),
    }
