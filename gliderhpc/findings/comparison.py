"""The table that every study ends with: a figure of the paper's, ours, and their ratio."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.table import Table
from rich.text import Text

from gliderhpc.findings.tables import markdown, number

Paper = float | tuple[float, float] | None
"""A figure of the paper's, its range (lower end first), or None where it has none."""

COLUMNS = ("quantity", "unit", "paper", "ours", "spread", "ratio", "remark")
"""Of the table."""

_OF_NUMBERS = ("paper", "ours", "spread", "ratio")
_OPTIONAL = ("spread", "remark")


@dataclass(frozen=True)
class Comparison:
    """One figure of the paper and ours.

    Attributes
    ----------
    quantity : str
        What it is.
    unit : str
        Of all its numbers; ``1`` for a ratio or a count.
    ours : float
        What this study gives, NaN where it gives nothing.
    paper : float, (float, float), optional
        What the paper gives, a range with its lower end first; None where it gives nothing.
    spread : (float, float), optional
        Between what ours lies over the runs; `remark` says how it is taken where it is not the quartiles.
    paper_said : str
        The paper's own words where neither a number nor a range does (``<= 0.24``).
    remark : str
        What a reader should know, such as what ours was made from.
    """

    quantity: str
    unit: str
    ours: float
    paper: Paper = None
    spread: tuple[float, float] | None = None
    paper_said: str = ""
    remark: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the paper's, with a range over its nearest end and 1 inside it; None where that says nothing."""
        reference = self.paper
        if isinstance(reference, tuple):
            reference = min(max(self.ours, reference[0]), reference[1])
        if reference is None or reference == 0.0 or not math.isfinite(self.ours):
            return None
        return self.ours / reference

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text, in the order of `COLUMNS`."""
        paper = self.paper_said or figure_text(self.paper)
        return (
            self.quantity, self.unit, paper, number(self.ours), figure_text(self.spread), number(self.ratio),
            self.remark,
        )  # fmt: skip


def figure_text(value: Paper) -> str:
    """A figure or a range as text."""
    return f"{number(value[0])} to {number(value[1])}" if isinstance(value, tuple) else number(value)


def comparison_table(rows: Sequence[Comparison], title: str) -> Table:
    """Lay comparisons out for a terminal; spread and remark only where some row has one."""
    shown = [name not in _OPTIONAL or any(getattr(row, name) for row in rows) for name in COLUMNS]
    table = Table(title=Text(title), title_justify="left")
    for column in _shown_of(COLUMNS, shown):
        table.add_column(column, justify="right" if column in _OF_NUMBERS else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, _shown_of(row.cells, shown)))
    return table


def comparison_markdown(rows: Iterable[Comparison]) -> str:
    """Lay comparisons out as a Markdown table, all columns."""
    return markdown(COLUMNS, (row.cells for row in rows), _OF_NUMBERS)


def comparisons_as_json(rows: Iterable[Comparison]) -> list[dict[str, Any]]:
    """Comparisons as plain values, ratio included."""
    return [{**asdict(row), "ratio": row.ratio} for row in rows]


def comparison_from_json(content: Mapping[str, Any]) -> Comparison:
    """Read back what `comparisons_as_json` gave, after a JSON file has held it."""
    values = {name: value for name, value in content.items() if name != "ratio"}
    values["ours"] = _known(values["ours"])
    for name in ("paper", "spread"):
        if isinstance(values.get(name), list):
            values[name] = tuple(_known(end) for end in values[name])
    return Comparison(**values)


def _known(value: float | None) -> float:
    return float("nan") if value is None else value


def _shown_of(values: Sequence[str], shown: Sequence[bool]) -> list[str]:
    return [value for value, keep in zip(values, shown, strict=True) if keep]
