"""What every study leaves: a table of the paper's figures beside ours, a CSV of its runs, a JSON of its figures."""

import csv
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

COLUMNS = ("quantity", "unit", "paper", "ours", "spread", "ratio", "remark")
"""Of the table that a study prints."""

_ABSENT = "–"


@dataclass(frozen=True)
class Comparison:
    """One figure of the paper beside ours.

    Attributes
    ----------
    quantity : str
        What it is.
    unit : str
        Of all its numbers; ``1`` for a ratio or a count.
    ours : float
        What this study gives.
    paper : float, optional
        What the paper gives; None where it gives nothing.
    spread : (float, float), optional
        Between what ours lies over the runs; `remark` says how it is taken where it is not the quartiles.
    paper_said : str
        The paper's own words where a number does not do (``<= 0.24``).
    remark : str
        What a reader should know.
    """

    quantity: str
    unit: str
    ours: float
    paper: float | None = None
    spread: tuple[float, float] | None = None
    paper_said: str = ""
    remark: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the paper's, None where that says nothing."""
        if self.paper is None or self.paper == 0.0 or not math.isfinite(self.ours):
            return None
        return self.ours / self.paper

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text, in the order of `COLUMNS`."""
        paper = self.paper_said or number(self.paper)
        spread = _ABSENT if self.spread is None else f"{number(self.spread[0])} … {number(self.spread[1])}"
        return self.quantity, self.unit, paper, number(self.ours), spread, number(self.ratio), self.remark


def number(value: float | None) -> str:
    """Three significant digits, or a dash for what is missing."""
    if value is None or not math.isfinite(value):
        return _ABSENT
    if value != 0.0 and not 1e-3 <= abs(value) < 1e4:
        return f"{value:.2e}"
    digits = 2 if value == 0.0 else max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def comparison_table(rows: Iterable[Comparison], title: str) -> Table:
    """Lay comparisons out for a terminal."""
    table = Table(title=title, title_justify="left")
    for column in COLUMNS:
        table.add_column(column, justify="right" if column in ("paper", "ours", "spread", "ratio") else "left")
    for row in rows:
        table.add_row(*row.cells)
    return table


def plain_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str) -> Table:
    """Lay any cells out for a terminal, the first column to the left and the others to the right."""
    table = Table(title=title, title_justify="left")
    for position, column in enumerate(columns):
        table.add_column(column, justify="right" if position else "left")
    for row in rows:
        table.add_row(*row)
    return table


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lay cells out as a Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write one line a run; the columns are all keys in order of appearance, NaN and None are left empty."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([_csv_cell(row.get(name)) for name in names] for row in rows)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a study's figures; NaN and infinities become null, which every JSON reader takes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(_plain(content), indent=1, ensure_ascii=False) + "\n", "utf-8")


def comparisons_as_json(rows: Iterable[Comparison]) -> list[dict[str, Any]]:
    """Comparisons as plain values, ratio included."""
    return [{**asdict(row), "ratio": row.ratio} for row in rows]


def comparison_from_json(content: Mapping[str, Any]) -> Comparison:
    """Read back what `comparisons_as_json` wrote."""
    values = {name: value for name, value in content.items() if name != "ratio"}
    values["ours"] = float("nan") if values["ours"] is None else values["ours"]
    if values.get("spread") is not None:
        values["spread"] = tuple(float("nan") if end is None else end for end in values["spread"])
    return Comparison(**values)


def _csv_cell(value: Any) -> Any:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.8g}"
    return "" if value is None else value


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
