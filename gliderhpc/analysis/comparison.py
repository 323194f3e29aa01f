"""The table that every study ends with: a figure of the paper's, ours, and their ratio."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table
from rich.text import Text

Paper = float | tuple[float, float] | None
"""A figure of the paper's, its range, or None where it has none."""

_ABSENT = "–"
_COLUMNS = ("quantity", "unit", "paper", "ours", "ratio")


@dataclass(frozen=True)
class Comparison:
    """One line of the table.

    Attributes
    ----------
    quantity, unit : str
        What it is; ``1`` for what has no unit.
    paper : float, (float, float) or None
        The paper's value or range.
    ours : float
        Ours, NaN where there is none.
    note : str
        What ours was made from, where that needs saying.
    """

    quantity: str
    unit: str
    paper: Paper
    ours: float
    note: str = ""

    @property
    def ratio(self) -> float:
        """Ours over the paper's; with a range over its nearest end, and 1 inside it. NaN without either."""
        reference = self.paper
        if isinstance(reference, tuple):
            reference = min(max(self.ours, reference[0]), reference[1])
        if reference is None or reference == 0.0 or not math.isfinite(self.ours):
            return float("nan")
        return self.ours / reference

    def as_json(self) -> dict[str, Any]:
        """Plain values, for the JSON beside the table."""
        return {
            "quantity": self.quantity, "unit": self.unit, "paper": self.paper, "ours": self.ours, "ratio": self.ratio,
            "note": self.note,
        }  # fmt: skip


def comparison_table(rows: Sequence[Comparison], title: str) -> Table:
    """Lay the lines out for a terminal."""
    notes = any(row.note for row in rows)
    table = Table(title=Text(title), title_justify="left")
    for position, column in enumerate((*_COLUMNS, "note") if notes else _COLUMNS):
        table.add_column(column, justify="right" if 2 <= position <= 4 else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, _cells(row)), *([Text(row.note)] if notes else []))
    return table


def comparison_markdown(rows: Sequence[Comparison]) -> str:
    """Lay the lines out as a Markdown table."""
    rules = ("---", "---", "---:", "---:", "---:", "---")
    lines = [(*_COLUMNS, "note"), rules, *((*_cells(row), row.note) for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def significant(value: float) -> str:
    """Three significant digits without an exponent where that reads well, and a dash for what is missing."""
    if not math.isfinite(value):
        return _ABSENT
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.2e}"
    digits = 2 if value == 0.0 else max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def _cells(row: Comparison) -> tuple[str, ...]:
    unit = "" if row.unit == "1" else row.unit
    ratio = significant(row.ratio) if abs(row.ratio) < 0.1 else f"{row.ratio:.2f}"
    ratio = ratio if math.isfinite(row.ratio) else _ABSENT
    return row.quantity, unit, _reference(row.paper), significant(row.ours), ratio


def _reference(paper: Paper) -> str:
    if paper is None:
        return _ABSENT
    if isinstance(paper, tuple):
        return f"{significant(paper[0])} to {significant(paper[1])}"
    return significant(paper)
