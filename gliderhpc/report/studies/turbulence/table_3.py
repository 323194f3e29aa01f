"""Table 3 of the paper for any profiles: ranges of the statistics, measured, of surrogates and of the nulls."""

from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.tables import markdown, number
from gliderhpc.studies.library.turbulence.ensembles import FAMILIES, Ensembles

STATISTICS = {
    "flatness": "F({lag:g} s)",
    "zeta_ratio": "zeta_6 / zeta_3",
    "kurtosis": "kurtosis",
    "peak": "largest amplitude, {unit}",
    "beta": "beta",
    "beta_resolved": "beta, resolved",
}

PAPER: dict[str, dict[str, tuple[float, float]]] = {
    "measured": {
        "flatness": (57.0, 448.0), "zeta_ratio": (1.72, 1.82), "kurtosis": (30.0, 187.0), "peak": (0.36, 2.98),
        "beta": (3.4, 5.6),
    },
    "surrogates": {"flatness": (30.0, 221.0), "zeta_ratio": (1.85, 1.98)},
    "noise_only": {
        "flatness": (18.0, 87.0), "zeta_ratio": (0.85, 1.98), "kurtosis": (13.0, 43.0), "peak": (0.0, 0.24),
        "beta": (2.4, 5.8),
    },
    "model_error": {
        "flatness": (16.0, 52.0), "zeta_ratio": (0.46, 1.99), "kurtosis": (14.0, 40.0), "peak": (0.0, 0.48),
        "beta": (2.4, 5.2),
    },
}  # fmt: skip
"""The paper's Table 3."""

_CALLED = {"measured": "measured", "measured_all": "measured, actuated samples included", "surrogates": "surrogates"}


def table_3(ensembles: Ensembles) -> pd.DataFrame:
    """Least and largest of each statistic, a row an ensemble."""
    rows: list[dict[str, Any]] = []
    for name, values in _columns(ensembles).items():
        row: dict[str, Any] = {"ensemble": name, "count": len(next(iter(values.values()), ()))}
        for statistic, column in values.items():
            known = column[np.isfinite(column)]
            row[f"{statistic}_least"] = float(known.min()) if known.size else float("nan")
            row[f"{statistic}_most"] = float(known.max()) if known.size else float("nan")
        rows.append(row)
    return pd.DataFrame(rows)


def table_3_text(ensembles: Ensembles) -> str:
    """Lay the ranges out with the paper's in brackets."""
    unit = unit_of(ensembles.settings.channel)
    titles = [text.format(lag=ensembles.settings.lag, unit=unit) for text in STATISTICS.values()]
    lines = [
        [_CALLED.get(str(row["ensemble"]), FAMILIES.get(str(row["ensemble"]), "")), str(row["count"])]
        + [_cell(row, statistic) for statistic in STATISTICS]
        for _, row in table_3(ensembles).iterrows()
    ]
    return (
        "# Intermittency and nulls\n\nRanges over each ensemble; the publication's, of its own, in brackets.\n\n"
        + markdown(("ensemble", "number", *titles), lines, titles)
        + "\n"
    )


def comparisons(ensembles: Ensembles) -> tuple[Comparison, ...]:
    """Medians and ranges of each ensemble beside the paper's ranges."""
    rows = []
    for name, values in _columns(ensembles).items():
        for statistic, column in values.items():
            known = column[np.isfinite(column)]
            what = STATISTICS[statistic].format(lag=ensembles.settings.lag, unit="").rstrip(", ")
            called = _CALLED.get(name, FAMILIES.get(name, name))
            rows.append(
                Comparison(
                    f"{what}, {called}", unit_of(ensembles.settings.channel) if statistic == "peak" else "1",
                    float(np.median(known)) if known.size else float("nan"),
                    PAPER.get(name, {}).get(statistic),
                    (float(known.min()), float(known.max())) if known.size else None,
                    remark=f"median and range of {known.size}",
                )
            )  # fmt: skip
    return tuple(rows)


def unit_of(channel: str) -> str:
    """Unit of a channel."""
    return "N" if channel in ("B_cu", "B_cv", "B_cw") else "N m"


def _columns(ensembles: Ensembles) -> dict[str, dict[str, np.ndarray[Any, np.dtype[np.float64]]]]:
    """Values of the statistics by ensemble: the surrogates' are the ends of their envelopes."""
    measured = ensembles.measured
    columns = {}
    if len(measured):
        columns["measured"] = {name: measured[name].to_numpy() for name in STATISTICS}
        columns["measured_all"] = {name: measured[f"{name}_all"].to_numpy() for name in STATISTICS}
        columns["surrogates"] = {
            name: measured[[f"surrogate_{name}_least", f"surrogate_{name}_most"]].to_numpy().ravel()
            for name in ("flatness", "zeta_ratio")
        }
    for family in FAMILIES:
        own = ensembles.family(family)
        if len(own):
            columns[family] = {name: own[name].to_numpy(dtype=np.float64) for name in STATISTICS}
    return columns


def _cell(row: pd.Series, statistic: str) -> str:
    least, most = (float(row.get(f"{statistic}_{end}", np.nan)) for end in ("least", "most"))
    if not np.isfinite(least):
        return "preserved" if row["ensemble"] == "surrogates" else "–"
    own = f"{number(least)} to {number(most)}"
    paper = PAPER.get(str(row["ensemble"]), {}).get(statistic)
    return own if paper is None else f"{own} [{number(paper[0])} to {number(paper[1])}]"
