"""Table 1 of the paper for any profiles: exponent and coefficient of determination by depth; and the comparisons."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from gliderhpc.findings.comparison import Comparison
from gliderhpc.findings.tables import markdown, number
from gliderhpc.studies.spectra.profile_spectra import PARTS

KOLMOGOROV = 11.0 / 3.0
"""Exponent of Kolmogorov's velocities with the f^-2 that the paper gives the hull."""

PAPER = {"whole": (4.33, 5.72), "shallow": (4.01, 6.97), "middle": (3.53, 5.13), "deep": (2.61, 4.98)}
"""Ranges of the paper's Table 1."""

PAPER_GROUPS = {"calm": 5.53, "middle": 4.27, "harsh": 3.86}
PAPER_R2 = 0.91


def table_1(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Exponents, a row a profile and part: on the band of the fit, and on the part of it that the records resolve."""
    return [_row(row, part) for _, row in table.iterrows() for part in PARTS]


def table_1_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Lay the table out."""
    lines = [[number(cell) if isinstance(cell, float) else str(cell) for cell in row.values()] for row in rows]
    columns = list(rows[0]) if rows else []
    return (
        "# Exponents by depth\n\nOn the band of the fit, and on the part of it that the records resolve; 95 % "
        "intervals by a bootstrap of Welch's segments.\n\n" + markdown(columns, lines, columns[3:]) + "\n"
    )


def _row(row: pd.Series, part: str) -> dict[str, Any]:
    def value(name: str) -> float:
        return float(row.get(f"{part}_{name}", np.nan))

    def fit(name: str, label: str) -> dict[str, Any]:
        interval = f"{number(value(name + '_low'))} to {number(value(name + '_high'))}"
        return {label: value(name), f"{label}, 95 %": interval, f"{label}, R2": value(f"{name}_r2")}

    depths = f"{number(value('from'))} to {number(value('to'))}"
    return {
        "profile": int(row["profile"]), "group": str(row["group"]), "part": part, "depth, m": depths,
        **fit("beta", "beta"), **fit("beta_resolved", "beta resolved"),
    }  # fmt: skip


def comparisons(table: pd.DataFrame) -> tuple[Comparison, ...]:
    """Medians of the exponents beside the paper's ranges and the groups' means beside its means."""
    rows = [_of_part(table, part) for part in PARTS]
    for group, paper in PAPER_GROUPS.items():
        own = table.loc[table["group"] == group, "whole_beta"] if "whole_beta" in table else pd.Series(dtype=float)
        if len(own):
            rows.append(
                Comparison(
                    f"exponent, mean of the {group} profiles", "1", float(own.mean()), paper,
                    remark=f"{len(own)} profiles",
                )
            )  # fmt: skip
    return (
        *rows,
        Comparison(
            "exponent on the resolved part, whole profile", "1", _median(table, "whole_beta_resolved"),
            spread=_range(table, "whole_beta_resolved"), remark="the paper gives none; spread is the range",
        ),
        Comparison(
            "exponent with actuated samples included", "1", _median(table, "beta_all"),
            spread=_range(table, "beta_all"), remark="spread is the range",
        ),
        Comparison("Kolmogorov's with the paper's f^-2", "1", KOLMOGOROV, KOLMOGOROV),
        Comparison("least R2 of any part", "1", _least_r2(table), PAPER_R2, paper_said="> 0.91"),
    )  # fmt: skip


def _of_part(table: pd.DataFrame, part: str) -> Comparison:
    name = f"{part}_beta"
    where = "whole profile" if part == "whole" else f"{part} third"
    return Comparison(
        f"exponent, {where}, median", "1", _median(table, name), PAPER[part], _range(table, name),
        remark="spread is the range",
    )  # fmt: skip


def _least_r2(table: pd.DataFrame) -> float:
    names = [f"{part}_beta_r2" for part in PARTS if f"{part}_beta_r2" in table]
    return float(table[names].min().min()) if names else float("nan")


def _median(table: pd.DataFrame, name: str) -> float:
    return float(table[name].median()) if name in table else float("nan")


def _range(table: pd.DataFrame, name: str) -> tuple[float, float] | None:
    if name not in table or not table[name].notna().any():
        return None
    return float(table[name].min()), float(table[name].max())
