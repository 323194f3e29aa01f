"""Table 5: trends of the twelve series by every estimate, the robust verdict beside the paper's grade."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gliderhpc.findings.tables import markdown, number
from gliderhpc.studies.drift.medians import UNITS
from gliderhpc.studies.drift.series import EstimateTrends

_TIERS = {"primary": "Primary", "supporting": "Supp.", "negligible": "(neg.)", "none": "–"}
_COLUMNS = (
    "estimate", "component", "phase", "n", "tau", "p", "slope a day", "95 % interval", "drift", "drift, %", "floor",
    "drift/floor", "tier", "robust p", "block", "Holm p", "verdict",
)  # fmt: skip
_TEXT = ("estimate", "component", "phase", "95 % interval", "tier", "verdict")


def table_5(found: Sequence[EstimateTrends]) -> list[dict[str, Any]]:
    """Rows of the table: forces in N, moments in N m, slopes a day, the drift in percent of the line's first level."""
    return [
        {
            "estimate": own.estimate, "component": channel, "unit": UNITS[channel], "phase": phase,
            "count": one.trend.count, "tau": one.trend.tau, "p": one.trend.p, "slope": one.trend.slope,
            "slope_low": one.trend.low, "slope_high": one.trend.high, "drift": one.drift,
            "drift_percent": 100.0 * one.drift / abs(one.trend.first) if one.trend.first else float("nan"),
            "floor": one.floor, "ratio": one.ratio, "tier": own.tier((channel, phase)), "robust_p": one.robust.p,
            "block": one.robust.block, "holm_p": one.corrected, "shown": one.shown,
        }
        for own in found
        for (channel, phase), one in own.trends.items()
    ]  # fmt: skip


def table_5_text(rows: Sequence[dict[str, Any]]) -> str:
    """Lay the table out as Markdown."""
    heading = (
        "Trends. tau, p: plain Mann-Kendall test; slope: Theil-Sen, its interval by drawing epochs; "
        "floor: standard deviation within epochs; tier: as the paper grades it (p < 0.05 and an interval without zero: "
        "primary). robust p: Mann-Kendall by the moving-block bootstrap; Holm p: the same, corrected for the series of "
        "the estimate; verdict: Holm p < 0.05 and an interval without zero.\n\n"
    )
    cells = (
        (
            str(row["estimate"]), f"{row['component']} ({row['unit']})", str(row["phase"]), str(row["count"]),
            f"{row['tau']:+.2f}" if np.isfinite(row["tau"]) else "–", number(row["p"]), number(row["slope"]),
            f"{number(row['slope_low'])} to {number(row['slope_high'])}", number(row["drift"]),
            number(row["drift_percent"]), number(row["floor"]), number(row["ratio"]), _TIERS[row["tier"]],
            number(row["robust_p"]), str(row["block"]), number(row["holm_p"]), "drift" if row["shown"] else "not shown",
        )
        for row in rows
    )  # fmt: skip
    return heading + markdown(_COLUMNS, cells, [name for name in _COLUMNS if name not in _TEXT]) + "\n"
